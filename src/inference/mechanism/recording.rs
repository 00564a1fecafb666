//! A recording of a mechanism, cut into segments, with its noise and scales.
//!
//! Trials are cut into segments of about one oscillation, each with an unknown initial state (multiple shooting): the
//! prediction of a segment stays close to linear in the parameters. Velocities and accelerations are those of local
//! quadratic polynomials; they set scales and starting values and are never data.

use std::collections::HashMap;
use std::f64::consts::PI;
use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::resolution::{EncoderResolution, encoder_resolution};
use crate::error::{Error, Result};
use crate::inference::kernels;
use crate::inference::statistics::median;
use crate::reality::JointTrial;
use crate::task::joint::JointKind;
use crate::world::mechanism::effect::JointScale;
use crate::world::mechanism::{JointTerm, Tree, required_torques};

/// Minimum number of observations of a segment, and maximum number of averages that it is reduced to.
const MIN_OBSERVATIONS: usize = 12;
const MAX_ROWS: usize = 48;
/// Duration of a segment, and of the window of a local polynomial, in typical oscillation periods.
const SEGMENT_PERIODS: f64 = 0.5;
const WINDOW_PERIODS: f64 = 0.1;
/// Half-width of the first window, observations, and the least one.
const FIRST_HALF_WIDTH: usize = 5;
const MIN_HALF_WIDTH: usize = 2;
/// Least half range of positions of some joint, in units of the noise.
const MIN_RANGE: f64 = 5.0;
/// Standard deviation of a step of an initial state, in units of the range of positions and of the typical velocity.
const STATE_PRIOR: f64 = 0.1;
/// Length scale of the trial discrepancy as a share of a segment's duration.
const GP_LENGTH_SHARE: f64 = 0.25;

/// A recording with what inference needs of it.
pub struct JointRecording<'a> {
    pub tree: &'a Tree,
    /// Effects that the scene has.
    pub scene_terms: Vec<JointTerm>,
    pub trials: &'a [JointTrial],
    pub segments: Vec<JointSegment>,
    /// Standard deviation of the noise of each joint's positions.
    pub noise: Vec<f64>,
    /// By joint.
    pub scales: Vec<JointScales>,
    /// By joint, unless the scene has it.
    pub resolutions: Vec<Option<EncoderResolution>>,
}

/// A part of a trial with its own initial state.
pub struct JointSegment {
    pub trial: usize,
    pub range: Range<usize>,
    /// Local polynomials at its observations: position, velocity and acceleration of each joint.
    pub states: Vec<Vec<[f64; 3]>>,
    /// From observations of a joint to white coordinates, for unit noise, and the variances of the unit trial discrepancy there.
    pub map: std::sync::Arc<(DMatrix<f64>, DVector<f64>)>,
}

/// Typical sizes in a joint.
#[derive(Clone, Copy, Debug)]
pub struct JointScales {
    /// rad/s
    pub velocity: f64,
    /// Torque that the motion and gravity need, and that the simulation lacks, N m.
    pub torque: f64,
    pub missing_torque: f64,
    /// m, kg
    pub length: f64,
    pub mass: f64,
    /// Half the range of positions.
    pub range: f64,
}

impl JointScales {
    /// The unit of a parameter with this scale.
    pub fn of(&self, scale: JointScale) -> f64 {
        match scale {
            JointScale::Absolute => 1.0,
            JointScale::Torque => self.torque,
            JointScale::TorquePerVelocity => self.torque / self.velocity,
            JointScale::PerTorque => 1.0 / self.torque,
            JointScale::Velocity => self.velocity,
            JointScale::Mass => self.mass,
            JointScale::Length => self.length,
        }
    }
}

impl<'a> JointRecording<'a> {
    pub fn new(
        tree: &'a Tree,
        scene_terms: Vec<JointTerm>,
        trials: &'a [JointTrial],
    ) -> Result<JointRecording<'a>> {
        let joints = tree.links.len();
        let first: Vec<Vec<Vec<[f64; 3]>>> =
            trials.iter().map(|t| local_states(t, |_| FIRST_HALF_WIDTH)).collect();
        let period = typical_period(tree, &first);
        let half_width = |t: &JointTrial| {
            let interval = (t.times[t.times.len() - 1] - t.times[0]) / (t.times.len() - 1) as f64;
            ((0.5 * WINDOW_PERIODS * period / interval) as usize).clamp(MIN_HALF_WIDTH, t.times.len() / 2)
        };
        let states: Vec<Vec<Vec<[f64; 3]>>> = trials.iter().map(|t| local_states(t, half_width)).collect();
        let mut maps = HashMap::new();
        let mut segments = Vec::new();
        for (k, (trial, states)) in trials.iter().zip(&states).enumerate() {
            for range in ranges(trial, SEGMENT_PERIODS * period) {
                let times: Vec<f64> =
                    trial.times[range.clone()].iter().map(|t| t - trial.times[range.start]).collect();
                let map =
                    maps.entry(rounded(&times)).or_insert_with(|| std::sync::Arc::new(white_map(&times)));
                let states = states[range.clone()].to_vec();
                segments.push(JointSegment { trial: k, range, states, map: map.clone() });
            }
        }
        if segments.is_empty() {
            let value = "trials with too few rows";
            return Err(Error::input("trials", value, format!("trials of {MIN_OBSERVATIONS} rows or more")));
        }
        let noise: Vec<f64> = (0..joints).map(|j| noise_sd(trials, j)).collect();
        let scales = joint_scales(tree, trials, &segments)?;
        if scales.iter().zip(&noise).all(|(own, noise)| own.range < MIN_RANGE * noise) {
            return Err(Error::input(
                "trials",
                "no joint moves",
                "a recording in which a joint moves by more than the noise",
            ));
        }
        let is_known = |j: usize| scene_terms.iter().any(|t| t.joint == j && t.effect.is_resolution());
        let resolution = |j: usize| encoder_resolution(trials, j, noise[j]).filter(|_| !is_known(j));
        let resolutions = (0..joints).map(resolution).collect();
        Ok(JointRecording { tree, scene_terms, trials, segments, noise, scales, resolutions })
    }

    /// Initial states of all segments from the local polynomials: positions, then velocities.
    pub fn initial_states(&self) -> Vec<Vec<f64>> {
        let part = |segment: &JointSegment, k: usize| {
            segment.states[0].iter().map(move |s| s[k]).collect::<Vec<f64>>()
        };
        self.segments.iter().map(|segment| [part(segment, 0), part(segment, 1)].concat()).collect()
    }

    /// Columns with one row per observation, joint by joint, in white coordinates.
    pub fn white(&self, segment: &JointSegment, columns: &DMatrix<f64>) -> DMatrix<f64> {
        let (map, _) = &*segment.map;
        let (rows, count) = map.shape();
        let mut out = DMatrix::zeros(rows * self.noise.len(), columns.ncols());
        for (j, sd) in self.noise.iter().enumerate() {
            out.rows_mut(j * rows, rows).copy_from(&(map * columns.rows(j * count, count) / *sd));
        }
        out
    }

    /// A column in white coordinates.
    pub fn white_column(&self, segment: &JointSegment, column: &DVector<f64>) -> DVector<f64> {
        self.white(segment, &DMatrix::from_column_slice(column.len(), 1, column.as_slice()))
            .column(0)
            .into_owned()
    }

    /// The step of a segment's initial state that fits a residual in white coordinates best. A weak prior holds what does not
    /// show, such as the velocity of a joint that sticks.
    pub fn state_step(
        &self,
        segment: &JointSegment,
        nuisances: &DMatrix<f64>,
        residual: &DVector<f64>,
    ) -> DVector<f64> {
        let (positions, velocities) =
            (self.scales.iter().map(|s| s.range), self.scales.iter().map(|s| s.velocity));
        let mut sizes = positions.chain(velocities).map(|scale| STATE_PRIOR * scale);
        let white = self.white(segment, nuisances);
        let sizes = DVector::from_fn(white.ncols(), |_, _| sizes.next().unwrap_or(1.0));
        let scaled = white * DMatrix::from_diagonal(&sizes);
        let gram = scaled.tr_mul(&scaled) + DMatrix::identity(sizes.len(), sizes.len());
        let solved = gram.cholesky().map(|factor| factor.solve(&scaled.tr_mul(residual)));
        solved.map_or_else(|| DVector::zeros(sizes.len()), |step| step.component_mul(&sizes))
    }

    /// Variances of the unit trial discrepancy in white coordinates.
    pub fn gp_variances(&self, segment: &JointSegment) -> DVector<f64> {
        let own = &segment.map.1;
        DVector::from_fn(own.len() * self.noise.len(), |i, _| own[i % own.len()])
    }
}

/// Times as a key: the same up to rounding.
fn rounded(times: &[f64]) -> Vec<i64> {
    times.iter().map(|t| (t * 1e7).round() as i64).collect()
}

/// Averages of neighbouring observations, rotated to coordinates in which the trial discrepancy is diagonal.
fn white_map(times: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
    let size = times.len().div_ceil(MAX_ROWS);
    let blocks: Vec<&[f64]> = times.chunks(size).collect();
    let average = DMatrix::from_fn(blocks.len(), times.len(), |b, i| {
        if i / size == b { (blocks[b].len() as f64).sqrt().recip() } else { 0.0 }
    });
    let length = GP_LENGTH_SHARE * (times[times.len() - 1] - times[0]).max(1e-9);
    let covariance = &average * kernels::matern(times, length, &average.transpose());
    let eigen = (0.5 * (&covariance + covariance.transpose())).symmetric_eigen();
    (eigen.eigenvectors.tr_mul(&average), eigen.eigenvalues.map(|v| v.max(0.0)))
}

/// Ranges of the segments of a trial.
fn ranges(trial: &JointTrial, duration: f64) -> Vec<Range<usize>> {
    let (count, whole) = (trial.times.len(), trial.times[trial.times.len() - 1] - trial.times[0]);
    let parts = ((whole / duration).round() as usize).clamp(1, (count / MIN_OBSERVATIONS).max(1));
    let edges: Vec<usize> = (0..=parts).map(|k| k * count / parts).collect();
    edges.windows(2).map(|e| e[0]..e[1]).filter(|range| range.len() >= MIN_OBSERVATIONS).collect()
}

/// Position, velocity and acceleration of each joint at each observation, by local quadratic polynomials.
fn local_states(trial: &JointTrial, half_width: impl Fn(&JointTrial) -> usize) -> Vec<Vec<[f64; 3]>> {
    let (count, half) = (trial.times.len(), half_width(trial));
    let joints = trial.positions[0].len();
    let at = |i: usize| {
        let from = i.saturating_sub(half).min(count.saturating_sub(2 * half + 1));
        let window = from..(from + 2 * half + 1).min(count);
        let design = DMatrix::from_fn(window.len(), 3, |k, p| {
            (trial.times[window.start + k] - trial.times[i]).powi(p as i32)
        });
        let observed = DMatrix::from_fn(window.len(), joints, |k, j| trial.positions[window.start + k][j]);
        let solved = design
            .clone()
            .svd(true, true)
            .solve(&observed, 1e-14)
            .unwrap_or_else(|_| DMatrix::zeros(3, joints));
        (0..joints).map(|j| [solved[(0, j)], solved[(1, j)], 2.0 * solved[(2, j)]]).collect()
    };
    (0..count).map(at).collect()
}

/// The shortest over joints of 2 pi rms(v) / rms(a), and of the duration of a revolution at the typical velocity.
fn typical_period(tree: &Tree, states: &[Vec<Vec<[f64; 3]>>]) -> f64 {
    let of = |j: usize| {
        let rms = |k: usize| {
            let squares = states.iter().flatten().map(|s| s[j][k] * s[j][k]);
            (squares.sum::<f64>() / states.iter().map(Vec::len).sum::<usize>() as f64).sqrt()
        };
        let oscillation = rms(1) / rms(2).max(1e-300);
        match tree.kinds[j] {
            JointKind::Revolute => 2.0 * PI * oscillation.min(1.0 / rms(1).max(1e-300)),
            JointKind::Prismatic => 2.0 * PI * oscillation,
        }
    };
    (0..tree.links.len()).map(of).filter(|p| *p > 0.0).fold(f64::INFINITY, f64::min).min(1e6)
}

/// Noise by third differences, and not less than that of rounding to the smallest observed difference.
fn noise_sd(trials: &[JointTrial], joint: usize) -> f64 {
    let of = |t: &JointTrial, i: usize| t.positions[i][joint];
    let (mut differences, mut steps) = (Vec::new(), Vec::new());
    for t in trials {
        for i in 3..t.times.len() {
            differences.push((of(t, i) - 3.0 * of(t, i - 1) + 3.0 * of(t, i - 2) - of(t, i - 3)).abs());
            steps.push((of(t, i) - of(t, i - 1)).abs());
        }
    }
    let least = steps.iter().copied().filter(|s| *s > 0.0).fold(f64::INFINITY, f64::min);
    let rounding = if least.is_finite() { least / 12f64.sqrt() } else { 0.0 };
    // The variance of a third difference is 20 times that of the noise; the median is that of a normal distribution.
    (median(&differences) / (0.6745 * 20f64.sqrt())).max(rounding).max(1e-9)
}

fn joint_scales(tree: &Tree, trials: &[JointTrial], segments: &[JointSegment]) -> Result<Vec<JointScales>> {
    let joints = tree.links.len();
    // Sums of squares: velocity, required torque, torque of gravity, motor torque, missing torque.
    let mut sums = vec![[0.0f64; 5]; joints];
    let mut ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; joints];
    let mut count = 0.0;
    for segment in segments {
        let trial = &trials[segment.trial];
        for (k, states) in segment.states.iter().enumerate() {
            let column = |p: usize| states.iter().map(|s| s[p]).collect::<Vec<f64>>();
            let torques = required_torques(tree, &column(0), &column(1), &column(2))
                .ok_or_else(|| Error::Failed("the mechanism's masses are singular".into()))?;
            let time = trial.times[segment.range.start + k];
            count += 1.0;
            for j in 0..joints {
                let motor = motor_torque(tree, trial, j, time, &states[j]);
                let own =
                    [states[j][1], torques.total[j], torques.gravity[j], motor, torques.total[j] - motor];
                sums[j].iter_mut().zip(own).for_each(|(sum, v)| *sum += v * v);
                let [low, high] = ranges[j];
                ranges[j] = [low.min(states[j][0]), high.max(states[j][0])];
            }
        }
    }
    let scale = |j: usize| {
        let [velocity, total, gravity, motor, missing] = sums[j].map(|sum| (sum / count).sqrt());
        let link = &tree.links[j];
        JointScales {
            velocity: velocity.max(1e-9),
            torque: total.max(gravity).max(motor).max(1e-12),
            missing_torque: missing,
            length: link.tip[0].hypot(link.tip[1]).max(1e-9),
            mass: link.mass,
            range: (0.5 * (ranges[j][1] - ranges[j][0])).clamp(1e-9, most_range(tree.kinds[j])),
        }
    };
    Ok((0..joints).map(scale).collect())
}

/// Largest half range of positions: a joint that turns is periodic.
fn most_range(kind: JointKind) -> f64 {
    match kind {
        JointKind::Revolute => PI,
        JointKind::Prismatic => f64::INFINITY,
    }
}

/// Torque of a joint's motor as commanded.
pub fn motor_torque(tree: &Tree, trial: &JointTrial, joint: usize, time: f64, state: &[f64; 3]) -> f64 {
    tree.motors[joint]
        .as_ref()
        .map_or(0.0, |m| m.torque(trial.commands.mean(joint, [time, time]), state[0], state[1]))
}
