//! Confidence intervals and identifiability of latents.
//!
//! A latent is identifiable if moving it by its prior standard deviation, with the others fixed, changes the
//! residual of the median trial noticeably. (For segments, in which chaos does not grow, one trial in five must
//! change.) The interval of an unidentifiable latent is infinite. So is an interval that spans the latent's
//! limits, as contradictory trials produce (for example of a world that the simulation cannot match). Otherwise
//! the interval is [`RefinedEstimate::confidence_interval`], which documents its coverage.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::loss::{Simulation, segment_residuals};
use super::refine::{RefinedEstimate, SearchBounds};
use super::segment::{TrialSegment, finite_sum_of_squares};
use crate::error::Result;
use crate::progress::Progress;
use crate::world::{ParameterSpace, ParameterVector};

/// Estimate of a latent or of a free effect parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = LatentEstimateOut)]
pub struct LatentEstimate {
    /// Name of the latent, or `effect.parameter`.
    pub name: String,
    /// The estimate; if not identifiable, the search's current value.
    pub value: f64,
    /// 95 % interval; `[null, null]` if infinite.
    pub ci95: [Option<f64>; 2],
    /// Whether the trials determine it.
    pub identifiable: bool,
}

/// Relative change of the median trial's residual below which a latent is not identifiable. Rounding changes
/// the median trial's residual by less than 1e-6; an effect ten times weaker than friction changes it by more
/// than 1e-2.
const MIN_RELATIVE_CHANGE: f64 = 1e-3;

/// Identifiable coordinates at `estimate`, and the number of rollouts used.
pub fn identifiable_coordinates(
    estimate: &ParameterVector,
    bounds: &SearchBounds,
    segments: &[TrialSegment],
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(Vec<bool>, u64)> {
    let mut samples = vec![estimate.clone()];
    for i in 0..estimate.len() {
        for sign in [-1.0, 1.0] {
            let mut moved = estimate.clone();
            // The lower end stays at a quarter of a coefficient: force laws are non-linear near zero.
            let least = if bounds.limits[i][0] >= 0.0 { moved[i] * 0.25 } else { f64::NEG_INFINITY };
            let end = (moved[i] + sign * bounds.prior_sd[i]).max(least);
            moved[i] = end.clamp(bounds.limits[i][0], bounds.limits[i][1]);
            samples.push(moved);
        }
    }
    let rows = segment_residuals(&samples, segments, simulation, "measuring confidence", progress)?;
    let trials = segments.iter().map(|p| p.trial + 1).max().unwrap_or(0);
    let by_trial = |row: &[Vec<f64>]| {
        let mut sums = vec![0.0; trials];
        for (segment, vector) in segments.iter().zip(row) {
            sums[segment.trial] += finite_sum_of_squares(vector);
        }
        sums
    };
    let sums: Vec<Vec<f64>> = rows.iter().map(|row| by_trial(row)).collect();
    let insensitive_share = if segments.iter().any(|p| p.whitening.is_some()) { 0.8 } else { 0.5 };
    let identifiable = |i: usize| {
        bounds.prior_sd[i] > 0.0
            && is_sensitive(&sums[0], &[&sums[1 + 2 * i], &sums[2 + 2 * i]], insensitive_share)
    };
    let identifiable = (0..estimate.len()).map(identifiable).collect();
    Ok((identifiable, (samples.len() * segments.len()) as u64))
}

/// Estimates with intervals for every searched coordinate, from `estimate` and the result of refinement.
pub fn confidence_intervals(
    estimate: &ParameterVector,
    refinement: &RefinedEstimate,
    bounds: &SearchBounds,
    coordinates: &ParameterSpace,
) -> Vec<LatentEstimate> {
    (0..coordinates.len())
        .filter(|i| bounds.prior_sd[*i] > 0.0)
        .map(|i| {
            let [low, high] = refinement.confidence_interval(i, bounds);
            // An interval that spans the limits carries no information.
            let everything = low <= bounds.limits[i][0] && high >= bounds.limits[i][1];
            let identifiable =
                bounds.identifiable[i] && refinement.standard_error[i].is_finite() && !everything;
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

/// Whether moving a latent changes the residuals noticeably in more trials than the share `silent`.
fn is_sensitive(base: &[f64], moved: &[&Vec<f64>], insensitive_share: f64) -> bool {
    let scale = quantile(base.to_vec(), 0.5).max(1e-9);
    moved.iter().any(|row| {
        let changes = row.iter().zip(base).map(|(m, b)| (m - b).abs() / scale.max(*b)).collect();
        quantile(changes, insensitive_share) > MIN_RELATIVE_CHANGE
    })
}

fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get((values.len() as f64 * share) as usize).copied().unwrap_or(0.0)
}
