//! Discrimination of rival models by a further throw.
//!
//! The criterion is the residual square with which one model explains the predictions of another, with initial
//! states and parameters refitted as far as the trials so far permit (T-optimality: Atkinson and Fedorov,
//! Biometrika 62 (1975) 57). The best throw is then simulated, and a pair that the outcomes do not decide is no
//! part of its promise.

use crate::inference::data::noise::Noise;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::next_experiment::planned_flight::PlannedFlight;
use crate::inference::segment::{Observation, Segment, SegmentKind};
use crate::inference::selection::{SETTINGS, SharedDiscrepancy};
use crate::inference::statistics::median;
use crate::rng::{self, Stream};

/// Number of repetitions, and assumed observations of each.
pub const REPEATS: f64 = 6.0;
const OBSERVATIONS: usize = 40;
/// Difference of squares that discriminates two models: a likelihood ratio of 1000.
const CLEAR_DIFFERENCE: f64 = 14.0;
/// Simulated outcomes of a throw by pair of rivals, and the share of them that it must decide.
const SIMULATIONS: usize = 40;
const MIN_SUCCESS_RATE: f64 = 0.9;

/// A throw, the pairs of rivals (the true one first) that it discriminates, and the smallest share of simulated outcomes in
/// which it does.
pub struct Discrimination {
    pub throw: CandidateThrow,
    pub pairs: Vec<[usize; 2]>,
    pub success_rate: f64,
}

/// The throw that should discriminate most pairs of rivals, checked by simulated outcomes.
pub fn best_throw(
    segments: &[Segment],
    rivals: &[&FittedModel],
    discrepancy: Option<&SharedDiscrepancy>,
    noise: &Noise,
    seed: u64,
) -> Option<Discrimination> {
    let pairs: Vec<[usize; 2]> = (0..rivals.len())
        .flat_map(|i| (0..rivals.len()).map(move |j| [i, j]))
        .filter(|[i, j]| i != j)
        .collect();
    let mut best: Option<(f64, CandidateThrow, Vec<f64>)> = None;
    for throw in candidate_throws(segments, rivals[0]) {
        let flight = throw.flight(rivals[0], discrepancy, noise);
        let apart: Vec<f64> =
            pairs.iter().map(|[i, j]| discrimination(&flight, rivals[*i], rivals[*j])).collect();
        // Differences beyond the required one hardly count.
        let score = apart.iter().map(|a| a.min(4.0 * CLEAR_DIFFERENCE)).sum::<f64>()
            + 1e-3 * apart.iter().sum::<f64>().min(1e3);
        if best.as_ref().is_none_or(|b| score > b.0) {
            best = Some((score, throw, apart));
        }
    }
    let (_, throw, apart) = best?;
    let flight = throw.flight(rivals[0], discrepancy, noise);
    let mut stream = rng::stream(seed, "next experiment");
    let mut rate = |k: usize| success_rate(&flight, rivals[pairs[k][0]], rivals[pairs[k][1]], &mut stream);
    let expected = (0..pairs.len()).filter(|k| apart[*k] >= CLEAR_DIFFERENCE);
    let mut checked: Vec<([usize; 2], f64)> = expected.map(|k| (pairs[k], rate(k))).collect();
    checked.retain(|(_, rate)| *rate >= MIN_SUCCESS_RATE);
    let success_rate = checked.iter().map(|(_, rate)| *rate).fold(1.0, f64::min);
    let pairs = checked.into_iter().map(|(pair, _)| pair).collect();
    Some(Discrimination { throw, pairs, success_rate })
}

/// A candidate throw: description and segment.
pub struct CandidateThrow {
    pub description: String,
    pub segment: Segment,
    nuisances: [f64; 4],
}

impl CandidateThrow {
    fn flight(
        &self,
        by: &FittedModel,
        discrepancy: Option<&SharedDiscrepancy>,
        noise: &Noise,
    ) -> PlannedFlight<'_> {
        PlannedFlight::new(&self.segment, self.nuisances, by, discrepancy, noise, REPEATS)
    }
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

/// Residual square in units of the noise with which `other` explains [`REPEATS`] throws as `own` predicts them.
fn discrimination(flight: &PlannedFlight, own: &FittedModel, other: &FittedModel) -> f64 {
    flight.misfit(other, &flight.prediction(own))
}

/// Share of simulated outcomes under `own` in which `other` is certainly less probable.
fn success_rate(flight: &PlannedFlight, own: &FittedModel, other: &FittedModel, stream: &mut Stream) -> f64 {
    let decides = |_: &usize| {
        let outcome = flight.simulated(own, stream);
        flight.misfit(other, &outcome) - flight.misfit(own, &outcome) > 2.0 * SETTINGS.log_odds_of_certainty()
    };
    (0..SIMULATIONS).filter(decides).count() as f64 / SIMULATIONS as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::fitted_models;

    /// No throw discriminates an upward wind from weaker gravity; every long flight discriminates both from
    /// neither, in simulations too.
    #[test]
    fn throws_discriminate_different_models_only() {
        let (segments, fits, noise) = fitted_models(&[&["gravity_error"], &["wind"], &[]]);
        for throw in candidate_throws(&segments, &fits[0]) {
            let flight = throw.flight(&fits[0], None, &noise);
            let apart = |i: usize, j: usize| discrimination(&flight, &fits[i], &fits[j]);
            assert!(apart(0, 1) < 1.0 && apart(1, 0) < 1.0, "{}", throw.description);
            assert!(apart(0, 2) > CLEAR_DIFFERENCE, "{}", throw.description);
        }
        let rivals: Vec<&FittedModel> = fits.iter().collect();
        let best = best_throw(&segments, &rivals, None, &noise, 1).unwrap();
        assert!(best.pairs.contains(&[0, 2]) && !best.pairs.contains(&[0, 1]), "{:?}", best.pairs);
        assert!(best.success_rate > 0.95, "{}", best.success_rate);
    }

    /// Parameters that the trials determine cannot be refitted; without that information they can.
    #[test]
    fn free_parameters_reduce_discrimination() {
        let (segments, mut fits, noise) = fitted_models(&[&["gravity_error"], &["wind"]]);
        let throw = candidate_throws(&segments, &fits[0]).remove(3);
        fits[1].state.values.fill(0.0);
        let apart =
            |fits: &[FittedModel]| discrimination(&throw.flight(&fits[0], None, &noise), &fits[0], &fits[1]);
        assert!(apart(&fits) > CLEAR_DIFFERENCE, "{}", apart(&fits));
        fits[1].covariance *= 1e6;
        assert!(apart(&fits) < 1.0, "{}", apart(&fits));
    }
}
