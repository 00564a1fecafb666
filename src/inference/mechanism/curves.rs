//! Measured and simulated joint positions of the trial that the simulation predicts worst.

use serde::{Deserialize, Serialize};

use super::model_fit::JointFit;
use super::recording::JointRecording;

/// Positions in one trial. Simulations start anew in every segment, from the initial state that fits it best.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct JointCurves {
    pub trial: String,
    /// s
    pub t: Vec<f64>,
    pub joints: Vec<JointCurve>,
}

/// Positions of a joint, rad or m.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct JointCurve {
    pub joint: String,
    pub measured: Vec<f64>,
    /// Simulated as given.
    pub simulated: Vec<f64>,
    /// Simulated with the most probable set of effects; absent if none is named.
    pub extended: Option<Vec<f64>>,
}

/// Curves of the trial whose largest residual from `base` is largest.
pub fn worst_trial(recording: &JointRecording, base: &JointFit, best: Option<&JointFit>) -> JointCurves {
    let every: Vec<usize> = (0..recording.segments.len()).collect();
    let residuals = |fit: &JointFit, which: &[usize]| recording.residuals(&fit.terms, &fit.states, which);
    let all = residuals(base, &every);
    let largest = |w: usize| all[w].amax();
    let worst = every.iter().copied().max_by(|a, b| largest(*a).total_cmp(&largest(*b))).unwrap_or(0);
    let trial = recording.segments[worst].trial;
    let own: Vec<usize> = every.into_iter().filter(|w| recording.segments[*w].trial == trial).collect();
    let extended = best.map(|fit| residuals(fit, &own));
    let count = recording.noise.len();
    let mut joints: Vec<JointCurve> = (0..count)
        .map(|j| JointCurve {
            joint: recording.tree.names[j].clone(),
            measured: Vec::new(),
            simulated: Vec::new(),
            extended: best.map(|_| Vec::new()),
        })
        .collect();
    let mut t = Vec::new();
    for (k, w) in own.iter().copied().enumerate() {
        let segment = &recording.segments[w];
        let (rows, observed) = (segment.range.len(), recording.observed(segment));
        t.extend_from_slice(&recording.trials[trial].times[segment.range.clone()]);
        for (j, curve) in joints.iter_mut().enumerate() {
            for i in j * rows..(j + 1) * rows {
                curve.measured.push(observed[i]);
                curve.simulated.push(observed[i] - all[w][i]);
                if let (Some(to), Some(from)) = (&mut curve.extended, &extended) {
                    to.push(observed[i] - from[k][i]);
                }
            }
        }
    }
    JointCurves { trial: recording.trials[trial].id.clone(), t, joints }
}
