//! How well a latent is known, and whether the trials tell it at all.
//!
//! Identifiability: a latent is moved across its prior's width with the others held; where not even the median
//! trial's residual notices, no amount of such trials will tell it. (Of trials cut into stretches, in which chance
//! does not grow, one in five must notice.) The interval is then infinite, as it is where it would reach from one limit
//! of the latent to the other: trials that contradict each other, as those of a world that the simulation cannot match
//! may. Else it is [`Refined::interval`], which
//! says what it covers.

use serde::{Deserialize, Serialize};

use super::fitness::{Simulation, vectors};
use super::piece::Piece;
use super::refine::{Field, Refined};
use crate::error::Result;
use crate::progress::Progress;
use crate::world::{Coordinates, Sample};

/// What is known of one coordinate: a latent factor, or an effect's parameter that is fitted along.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LatentEstimate {
    /// Name of the factor, or `effect.parameter`.
    pub name: String,
    /// The estimate; for a latent that cannot be identified, merely where the search ended.
    pub value: f64,
    /// 95 % interval; `[null, null]` stands for an infinite one.
    pub ci95: [Option<f64>; 2],
    /// Whether the trials tell it.
    pub identifiable: bool,
}

/// Relative change of the median trial's residual below which a latent is not identifiable. Chance differences
/// from rounding stay below 1e-6 in the median trial; a tenfold weaker effect than friction's is above 1e-2.
const NOTICEABLE: f64 = 1e-3;

/// Which coordinates the trials tell, seen from `estimate`; and the rollouts it took to see it.
pub fn told(
    estimate: &Sample,
    field: &Field,
    pieces: &[Piece],
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(Vec<bool>, u64)> {
    let mut samples = vec![estimate.clone()];
    for i in 0..estimate.len() {
        for to in [-1.0, 1.0] {
            let mut moved = estimate.clone();
            // A coefficient is not taken for nothing: close to zero laws bend.
            let least = if field.limits[i][0] >= 0.0 { moved[i] * 0.25 } else { f64::NEG_INFINITY };
            let far = (moved[i] + to * field.prior[i]).max(least);
            moved[i] = far.clamp(field.limits[i][0], field.limits[i][1]);
            samples.push(moved);
        }
    }
    let rows = vectors(&samples, pieces, simulation, "measuring confidence", progress)?;
    let trials = pieces.iter().map(|p| p.trial + 1).max().unwrap_or(0);
    let by_trial = |row: &[Vec<f64>]| {
        let mut sums = vec![0.0; trials];
        for (piece, vector) in pieces.iter().zip(row) {
            sums[piece.trial] += vector.iter().filter(|r| r.is_finite()).map(|r| r * r).sum::<f64>();
        }
        sums
    };
    let sums: Vec<Vec<f64>> = rows.iter().map(|row| by_trial(row)).collect();
    let silent = if pieces.iter().any(|p| p.weighing.is_some()) { 0.8 } else { 0.5 };
    let told =
        |i: usize| field.prior[i] > 0.0 && notices(&sums[0], &[&sums[1 + 2 * i], &sums[2 + 2 * i]], silent);
    let told = (0..estimate.len()).map(told).collect();
    Ok((told, (samples.len() * pieces.len()) as u64))
}

/// What is known of every coordinate that was searched, for an `estimate` and what refining it found.
pub fn intervals(
    estimate: &Sample,
    refined: &Refined,
    field: &Field,
    coordinates: &Coordinates,
) -> Vec<LatentEstimate> {
    (0..coordinates.len())
        .filter(|i| field.prior[*i] > 0.0)
        .map(|i| {
            let [low, high] = refined.interval(i, field);
            // An interval from end to end of what is allowed says nothing, whatever single trials react to.
            let everything = low <= field.limits[i][0] && high >= field.limits[i][1];
            let identifiable = field.told[i] && refined.error[i].is_finite() && !everything;
            LatentEstimate {
                name: coordinates.name(i),
                value: estimate[i],
                ci95: match identifiable {
                    true => [Some(low.min(estimate[i])), Some(high.max(estimate[i]))],
                    false => [None, None],
                },
                identifiable,
            }
        })
        .collect()
}

/// Whether moving a latent changes the residuals noticeably in more trials than the share that may be `silent`.
fn notices(base: &[f64], moved: &[&Vec<f64>], silent: f64) -> bool {
    let scale = quantile(base.to_vec(), 0.5).max(1e-9);
    moved.iter().any(|row| {
        let changes = row.iter().zip(base).map(|(m, b)| (m - b).abs() / scale.max(*b)).collect();
        quantile(changes, silent) > NOTICEABLE
    })
}

fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get((values.len() as f64 * share) as usize).copied().unwrap_or(0.0)
}
