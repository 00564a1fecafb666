//! How well a latent is known, and whether the trials tell it at all.
//!
//! Intervals: a cloud of samples around the estimate is simulated on every trial once; trials are then
//! resampled with replacement (a bootstrap by trial, so that errors within a trajectory may depend on each
//! other) and the loss's minimum located anew each time. The 2.5 % and 97.5 % points bound the interval.
//!
//! Identifiability: a latent is moved across its prior's width with the others held; where not even the median
//! trial's residual notices, no amount of such trials will tell it. The interval is then infinite.
//!
//! Range of validity: intervals describe scatter between trials. They do not cover what the simulation leaves
//! out: an estimate that compensates for a missing effect is tightly known and still not the true value.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::cem::Sample;
use super::fitness::{Simulation, matrix};
use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng;
use crate::world::latent::{FACTORS, clamp};

/// What is known of one latent factor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LatentEstimate {
    /// Name of the factor.
    pub name: String,
    /// The estimate; for a latent that cannot be identified, merely where the search ended.
    pub value: f64,
    /// 95 % interval; `[null, null]` stands for an infinite one.
    pub ci95: [Option<f64>; 2],
    /// Whether the trials tell it.
    pub identifiable: bool,
}

/// Samples in the cloud; more smooth the interval's ends.
const CLOUD: usize = 192;
/// Bootstrap repetitions.
const REPEATS: usize = 400;
/// Best samples averaged for one repetition's estimate.
const BEST: usize = 5;
/// Relative change of the median trial's residual below which a latent is not identifiable. Chance differences
/// from rounding stay below 1e-6 in the median trial; a tenfold weaker effect than friction's is above 1e-2.
const NOTICEABLE: f64 = 1e-3;

/// Intervals and identifiability around an estimate. `spread` is the standard deviation of the search for each
/// factor, `prior` that of its start.
pub fn intervals(
    estimate: Sample,
    spread: [f64; 4],
    prior: [f64; 4],
    trials: &[Trial],
    simulation: Simulation,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Vec<LatentEstimate>> {
    let mut samples = vec![estimate];
    for i in 0..4 {
        for to in [-1.0, 1.0] {
            let mut moved = estimate;
            moved[i] = (moved[i] + to * prior[i]).max(moved[i] * 0.25);
            samples.push(bounded(moved));
        }
    }
    let probes = samples.len();
    let mut stream = rng::stream(seed, "interval");
    for _ in 0..CLOUD {
        let drawn = std::array::from_fn(|i| {
            let width = (2.5 * spread[i]).max(0.1 * prior[i]);
            if width == 0.0 {
                return estimate[i];
            }
            estimate[i] + width * (stream.random::<f64>() + stream.random::<f64>() - 1.0)
        });
        samples.push(bounded(drawn));
    }
    let rows = matrix(&samples, trials, simulation, progress)?;
    let identifiable: Vec<bool> =
        (0..4).map(|i| notices(&rows[0], &[&rows[1 + 2 * i], &rows[2 + 2 * i]])).collect();
    let cloud: Vec<usize> = std::iter::once(0).chain(probes..samples.len()).collect();
    let mut found: Vec<Sample> = Vec::with_capacity(REPEATS);
    for _ in 0..REPEATS {
        let picked: Vec<usize> = trials.iter().map(|_| stream.random_range(0..trials.len())).collect();
        let mut order: Vec<(f64, usize)> =
            cloud.iter().map(|s| (picked.iter().map(|t| rows[*s][*t]).sum::<f64>(), *s)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let best = &order[..BEST.min(order.len())];
        found.push(std::array::from_fn(|i| {
            best.iter().map(|(_, s)| samples[*s][i]).sum::<f64>() / best.len() as f64
        }));
    }
    // A component that was not searched is not reported.
    Ok((0..4)
        .filter(|i| prior[*i] > 0.0)
        .map(|i| {
            let mut values: Vec<f64> = found.iter().map(|f| f[i]).collect();
            values.sort_by(f64::total_cmp);
            let at = |q: f64| values[(q * (values.len() - 1) as f64).round() as usize];
            let ci95 = if identifiable[i] {
                [Some(at(0.025).min(estimate[i])), Some(at(0.975).max(estimate[i]))]
            } else {
                [None, None]
            };
            LatentEstimate {
                name: FACTORS.get(i).map_or("linear_drag.c", |f| f.name).into(),
                value: estimate[i],
                ci95,
                identifiable: identifiable[i],
            }
        })
        .collect())
}

fn bounded(x: Sample) -> Sample {
    let [density, friction, restitution] = clamp([x[0], x[1], x[2]]);
    [density, friction, restitution, x[3].clamp(0.0, 100.0)]
}

/// Whether moving a latent changes the median trial's residual noticeably.
fn notices(base: &[f64], moved: &[&Vec<f64>]) -> bool {
    let scale = median(base.to_vec()).max(1e-9);
    moved.iter().any(|row| {
        let changes = row.iter().zip(base).map(|(m, b)| (m - b).abs() / scale.max(*b)).collect();
        median(changes) > NOTICEABLE
    })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
