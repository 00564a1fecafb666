//! Discrimination of rival models by a further throw.
//!
//! The criterion is the residual square with which one model fits the predictions of another, with initial
//! states and parameters refitted as far as the trials so far permit (T-optimality: Atkinson and Fedorov,
//! Biometrika 62 (1975) 57).

use nalgebra::{DMatrix, DVector};

use crate::inference::data::noise::Noise;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::segment::{Observation, Segment, SegmentKind};
use crate::inference::statistics::{median, pseudo_inverse};

/// Number of repetitions, and assumed observations of each.
pub const REPEATS: f64 = 6.0;
const OBSERVATIONS: usize = 40;
/// Difference of squares that discriminates two models: a likelihood ratio of 1000.
const CLEAR_DIFFERENCE: f64 = 14.0;

/// The throw that discriminates most pairs of rivals, with the smallest difference among the discriminated
/// pairs.
pub fn best_throw(
    segments: &[Segment],
    rivals: &[&FittedModel],
    noise: &Noise,
) -> Option<(CandidateThrow, f64, Vec<[usize; 2]>)> {
    let pairs: Vec<[usize; 2]> = (0..rivals.len())
        .flat_map(|i| (0..rivals.len()).map(move |j| [i, j]))
        .filter(|[i, j]| i != j)
        .collect();
    let mut best: Option<(f64, CandidateThrow, Vec<f64>)> = None;
    for trial in candidate_throws(segments, rivals[0]) {
        let apart: Vec<f64> =
            pairs.iter().map(|[i, j]| discrimination(&trial, rivals[*i], rivals[*j], noise)).collect();
        // Differences beyond the required one hardly count.
        let score = apart.iter().map(|a| a.min(4.0 * CLEAR_DIFFERENCE)).sum::<f64>()
            + 1e-3 * apart.iter().sum::<f64>().min(1e3);
        if best.as_ref().is_none_or(|b| score > b.0) {
            best = Some((score, trial, apart));
        }
    }
    let (_, trial, apart) = best?;
    let clear: Vec<usize> = (0..pairs.len()).filter(|k| apart[*k] >= CLEAR_DIFFERENCE).collect();
    let least = clear.iter().map(|k| apart[*k]).fold(f64::INFINITY, f64::min);
    Some((trial, least, clear.into_iter().map(|k| pairs[k]).collect()))
}

/// A candidate throw: description and segment.
pub struct CandidateThrow {
    pub description: String,
    pub segment: Segment,
    nuisances: [f64; 4],
}

/// Variations of a typical throw, each as long as the longest flight.
fn candidate_throws(segments: &[Segment], fit: &FittedModel) -> Vec<CandidateThrow> {
    let flights: Vec<usize> =
        (0..segments.len()).filter(|w| segments[*w].kind == SegmentKind::Flight).collect();
    let length = |w: usize| segments[w].observations.last().map_or(0.0, |p| p.time);
    let Some(typical) = flights.iter().copied().max_by(|a, b| length(*a).total_cmp(&length(*b))) else {
        return Vec::new();
    };
    let [x, y, ..] = fit.state.nuisances[typical][..] else { return Vec::new() };
    let speeds: Vec<f64> = flights
        .iter()
        .filter_map(|w| match fit.state.nuisances[*w][..] {
            [_, _, vx, vy, ..] => Some(vx.hypot(vy)),
            _ => None,
        })
        .collect();
    let [_, _, vx, _, ..] = fit.state.nuisances[typical][..] else { return Vec::new() };
    let (speed, side) = (median(&speeds).max(0.5), if vx < 0.0 { -1.0 } else { 1.0 });
    let mut out = Vec::new();
    for (share, how) in
        [(0.0, "drop it from rest"), (1.0 / 3.0, "a third of the usual speed"), (1.0, "the usual speed")]
            .into_iter()
            .chain([(2.0, "twice the usual speed"), (3.0, "three times the usual speed")])
    {
        for degrees in [10.0f64, 45.0, 70.0, 110.0, 170.0] {
            let (v, angle) = (share * speed, degrees.to_radians());
            let words = match share {
                0.0 => how.to_string(),
                _ => format!(
                    "launch at {how}, {v:.1} m/s, {:.0} degrees above the horizontal{}, from ({x:.2}, {y:.2}) m",
                    degrees.min(180.0 - degrees),
                    if degrees > 90.0 { " the other way" } else { "" }
                ),
            };
            let start = [x, y, side * v * libm::cos(angle), v * libm::sin(angle)];
            out.push(CandidateThrow {
                description: words,
                segment: observed_segment(&segments[typical], start),
                nuisances: start,
            });
            if share == 0.0 {
                break;
            }
        }
    }
    out
}

/// A flight segment with another initial state and evenly spaced observations.
fn observed_segment(typical: &Segment, start: [f64; 4]) -> Segment {
    let mut window = typical.clone();
    let body = &mut window.scene.bodies[0];
    (body.position, body.velocity) = (Some([start[0], start[1]]), [start[2], start[3]]);
    let duration = typical.observations.last().map_or(0.0, |p| p.time);
    (window.start, window.setting) = (0.0, 0);
    window.observations = (0..OBSERVATIONS)
        .map(|i| Observation {
            body: 0,
            time: duration * i as f64 / (OBSERVATIONS - 1) as f64,
            position: [0.0; 2],
            weight: 1.0,
        })
        .collect();
    window
}

/// Residual square in units of the noise with which `other` fits [`REPEATS`] throws predicted by `own`, after
/// refitting initial states and parameters, the latter with the information of the trials so far.
fn discrimination(trial: &CandidateThrow, own: &FittedModel, other: &FittedModel, noise: &Noise) -> f64 {
    let observed = |fit: &FittedModel, values: &[f64], start: &[f64]| {
        DVector::from_vec(
            fit.layout.segment_physics(&trial.segment, values, &[]).predict_positions(start, |_, _| ()),
        )
    };
    let (values, parameters) = (&other.state.values, &other.layout.parameters);
    let truth = observed(own, &own.state.values, &trial.nuisances);
    let mut start = trial.nuisances;
    let mut left = 0.0;
    // Two Gauss-Newton steps for the initial state.
    for _ in 0..2 {
        let base = observed(other, values, &start);
        let mut residual = &truth - &base;
        let from = DMatrix::from_columns(
            &(0..4)
                .map(|k| {
                    let mut moved = start;
                    moved[k] += 1e-4;
                    (observed(other, values, &moved) - &base) / 1e-4
                })
                .collect::<Vec<_>>(),
        );
        let mut columns = DMatrix::zeros(residual.len(), parameters.len());
        for (k, parameter) in parameters.iter().enumerate().filter(|(_, s)| s.setting.is_none_or(|s| s == 0))
        {
            let mut moved = values.clone();
            let by = if values[k] + parameter.fd_step > parameter.bounds[1] {
                -parameter.fd_step
            } else {
                parameter.fd_step
            };
            moved[k] += by;
            columns.set_column(k, &((observed(other, &moved, &start) - &base) / by));
        }
        if !residual.iter().chain(columns.iter()).chain(from.iter()).all(|v| v.is_finite()) {
            return 0.0;
        }
        let project = pseudo_inverse(&from.tr_mul(&from)) * from.transpose();
        let moved = &project * &residual;
        start.iter_mut().zip(moved.iter()).for_each(|(s, m)| *s += m);
        residual -= &from * moved;
        columns -= &from * (&project * &columns);
        let unit = noise.sd * noise.sd * noise.smooth_variance_factor();
        let mut known = columns.tr_mul(&columns) * (REPEATS / unit);
        let score = columns.tr_mul(&residual) * (REPEATS / unit);
        let square = residual.norm_squared() * REPEATS / unit;
        for t in &other.evaluation.normal_equations {
            known += &t.gram / noise.smooth_variance_factor();
        }
        for (k, parameter) in parameters.iter().enumerate() {
            known[(k, k)] += parameter.min_information();
        }
        left = square - score.dot(&(pseudo_inverse(&known) * &score));
    }
    left.max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::fitted_models;

    /// No throw discriminates an upward wind from weaker gravity; every long flight discriminates both from
    /// neither.
    #[test]
    fn throws_discriminate_different_models_only() {
        let (segments, fits, noise) = fitted_models(&[&["gravity_error"], &["wind"], &[]]);
        for trial in candidate_throws(&segments, &fits[0]) {
            let apart = |i: usize, j: usize| discrimination(&trial, &fits[i], &fits[j], &noise);
            assert!(apart(0, 1) < 1.0 && apart(1, 0) < 1.0, "{}", trial.description);
            assert!(apart(0, 2) > CLEAR_DIFFERENCE, "{}", trial.description);
        }
    }

    /// Parameters that the trials determine cannot be refitted; without that information they can.
    #[test]
    fn free_parameters_reduce_discrimination() {
        let (segments, mut fits, noise) = fitted_models(&[&["gravity_error"], &["wind"]]);
        let trial = candidate_throws(&segments, &fits[0]).remove(3);
        fits[1].state.values.fill(0.0);
        let apart = |fits: &[FittedModel]| discrimination(&trial, &fits[0], &fits[1], &noise);
        assert!(apart(&fits) > CLEAR_DIFFERENCE, "{}", apart(&fits));
        fits[1].evaluation.normal_equations.clear();
        assert!(apart(&fits) < 1.0, "{}", apart(&fits));
    }
}
