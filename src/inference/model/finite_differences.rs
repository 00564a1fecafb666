//! Predictions of a segment's observations with their derivatives.
//!
//! Derivatives are finite differences: one-sided for the smooth trajectories of `dynamics`, two-sided for
//! engines and for discontinuous parameters.

use super::fit_state::{FitState, Perturbation};
use super::parameters::{Parameter, ParameterKind, ParameterLayout};
use crate::inference::dynamics::{Impact, SegmentPhysics, predict_batch};
use crate::inference::segment::{Segment, SegmentKind};

/// Finite-difference steps of a supported body's distance, speed, offset, slope and spin; of x, y, vx, vy, omega, the surface's
/// offset and the error of the angle; and of x, y, vx, vy, omega of two bodies, their offset and the errors of their angles.
const SUPPORTED_FD_STEPS: [f64; 5] = [1e-4, 1e-3, 1e-4, 1e-4, 1e-1];
const FLIGHT_FD_STEPS: [f64; 7] = [1e-4, 1e-4, 1e-3, 1e-3, 1e-1, 1e-4, 1e-3];
const COLLISION_FD_STEPS: [f64; 13] =
    [1e-4, 1e-4, 1e-3, 1e-3, 1e-1, 1e-4, 1e-4, 1e-3, 1e-3, 1e-1, 1e-4, 1e-3, 1e-3];

/// Predicted positions of a segment's observations, two numbers each, and their derivatives.
#[derive(Default)]
pub struct Prediction {
    pub positions: Vec<f64>,
    pub by_nuisance: Vec<Vec<f64>>,
    /// By stencil.
    pub by_parameter: Vec<Vec<f64>>,
    /// By perturbation, per unit.
    pub by_perturbation: Vec<Vec<f64>>,
    /// Impact of a contact segment.
    pub impact: Option<Impact>,
}

/// An active parameter of a segment, with the two values of its difference quotient.
pub struct Stencil {
    pub parameter: usize,
    pub low: f64,
    pub high: f64,
}

/// Active parameters of a segment: without those of other settings, fixed ones, and latents if there is no
/// contact.
pub fn stencils(layout: &ParameterLayout, values: &[f64], segment: &Segment) -> Vec<Stencil> {
    let concerns = |parameter: &Parameter| {
        let latent = matches!(parameter.kind, ParameterKind::Latent(_));
        parameter.setting.is_none_or(|s| s == segment.setting)
            && !parameter.is_fixed
            && !(latent && matches!(segment.kind, SegmentKind::Flight | SegmentKind::Rolling))
    };
    let parameters = (0..layout.parameters.len()).filter(|i| concerns(&layout.parameters[*i]));
    parameters
        .map(|i| {
            let (parameter, value) = (&layout.parameters[i], values[i]);
            let wide = parameter.fd_step * if segment.kind.uses_engine() { 3.0 } else { 1.0 };
            let h = wide.max(1e-4 * value.abs());
            let (mut low, mut high) =
                ((value - h).max(parameter.bounds[0]), (value + h).min(parameter.bounds[1]));
            if !segment.kind.uses_engine() && !layout.is_discontinuous(i) {
                // Trajectories of `dynamics` are smooth: a one-sided difference suffices.
                if value + h <= parameter.bounds[1] { low = value } else { high = value }
            }
            Stencil { parameter: i, low, high }
        })
        .collect()
}

/// Prediction with Jacobian of segment `w` by `dynamics`, at the conditional modes of its trial.
pub fn linearise_ode(
    segment: &Segment,
    w: usize,
    layout: &ParameterLayout,
    state: &FitState,
    shared: &[Stencil],
    perturbations: &[Perturbation],
) -> Prediction {
    let (nuisances, values, random_effect_terms) =
        (state.nuisances[w].as_slice(), state.values_in(w), state.random_effect_terms(w));
    let current = layout.segment_physics(segment, &values, &random_effect_terms);
    let steps: &[f64] = match segment.kind {
        SegmentKind::Rolling | SegmentKind::Sliding => &SUPPORTED_FD_STEPS,
        SegmentKind::Collision => &COLLISION_FD_STEPS,
        _ => &FLIGHT_FD_STEPS,
    };
    let starts: Vec<Vec<f64>> = (0..nuisances.len().min(steps.len()))
        .map(|k| {
            let mut moved = nuisances.to_vec();
            moved[k] += steps[k];
            moved
        })
        .collect();
    // Stencil values that differ from the state.
    let ends = shared.iter().flat_map(|s| [(s.parameter, s.low), (s.parameter, s.high)]);
    let with_value = |(parameter, value): (usize, f64)| {
        (value != values[parameter]).then(|| {
            let mut moved = values.clone();
            moved[parameter] = value;
            layout.segment_physics(segment, &moved, &random_effect_terms)
        })
    };
    let ends: Vec<Option<SegmentPhysics>> = ends.map(with_value).collect();
    let with_extra = |e: &Perturbation| {
        layout.segment_physics(
            segment,
            &values,
            &[random_effect_terms.as_slice(), &[(e.effect, e.values.clone())]].concat(),
        )
    };
    let besides: Vec<SegmentPhysics> = perturbations.iter().map(with_extra).collect();

    let from_here =
        [(&current, nuisances)].into_iter().chain(starts.iter().map(|s| (&current, s.as_slice())));
    let others = ends.iter().flatten().chain(&besides).map(|p| (p, nuisances));
    let mut found = predict_batch(&from_here.chain(others).collect::<Vec<_>>()).into_iter();
    let (base, impact) = found.next().unwrap_or_default();
    let mut next = || found.next().unwrap_or_default().0;
    let nuisances = starts.iter().zip(steps).map(|(_, h)| difference_quotient(&next(), &base, *h)).collect();
    let mut end = |k: usize| if ends[k].is_some() { next() } else { base.clone() };
    let by_slot = |(k, s): (usize, &Stencil)| {
        let low = end(2 * k);
        difference_quotient(&end(2 * k + 1), &low, s.high - s.low)
    };
    let parameters = shared.iter().enumerate().map(by_slot).collect();
    let perturbations = perturbations.iter().map(|e| difference_quotient(&next(), &base, e.unit)).collect();
    Prediction {
        positions: base,
        by_nuisance: nuisances,
        by_parameter: parameters,
        by_perturbation: perturbations,
        impact,
    }
}

/// Difference quotient.
pub fn difference_quotient(high: &[f64], low: &[f64], by: f64) -> Vec<f64> {
    high.iter().zip(low).map(|(a, b)| (a - b) / by).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::{flights, term};

    /// The derivatives of a flight equal the exact ones.
    #[test]
    fn flight_derivatives_match_a_parabola() {
        let (segments, _) = flights([0.0, 0.0], 1);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let state = FitState::new(vec![0.5, 0.0], vec![segments[0].nuisances.clone()]);
        let shared = stencils(&layout, &state.values, &segments[0]);
        let drag = term("quadratic_drag").effect;
        let perturbation = Perturbation { effect: drag, values: vec![1e-3], unit: 1e-3 };
        let moved = linearise_ode(&segments[0], 0, &layout, &state, &shared, &[perturbation]);
        for (i, t) in segments[0].observations.iter().map(|p| p.time).enumerate() {
            let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-6, "{a} for {b} at {t}");
            near(moved.by_nuisance[0][2 * i], 1.0);
            near(moved.by_nuisance[2][2 * i], t);
            near(moved.by_nuisance[2][2 * i + 1], 0.0);
            near(moved.by_parameter[0][2 * i], 0.5 * t * t);
            near(moved.by_parameter[1][2 * i + 1], 0.5 * t * t);
            assert!(moved.by_perturbation[0][2 * i] <= 0.0, "drag holds back");
        }
    }

    #[test]
    fn differences_at_bounds_point_inwards() {
        let (segments, _) = flights([0.0, 0.0], 1);
        let layout = ParameterLayout::new(&[1], vec![term("wind")], 1);
        let [low, high] = layout.parameters[1].bounds;
        for (value, inwards) in [(low, true), (high, false)] {
            let shared = stencils(&layout, &[0.5, value, 0.0], &segments[0]);
            assert_eq!(
                shared.iter().map(|s| s.parameter).collect::<Vec<_>>(),
                [1, 2],
                "friction concerns no flight"
            );
            assert_eq!((shared[0].low == value, shared[0].high == value), (inwards, !inwards));
        }
    }
}
