//! What a window's points are predicted to show, and by how much more when a number moves.
//!
//! Derivatives are differences of rollouts: one-sided of paths that are integrated here, which are smooth, two-sided of
//! those that an engine simulates and across edges.

use super::layout::{Parameter, ParameterKind, ParameterLayout};
use super::state::{FitState, Perturbation};
use crate::discover::path::{Impact, SegmentPhysics, predict_batch};
use crate::discover::window::{Segment, SegmentKind};

/// Differences for derivatives by a roll's way, speed, height and slope, and by x, y, vx, vy, omega and the surface's offset.
const ROLLING_FD_STEPS: [f64; 4] = [1e-4, 1e-3, 1e-4, 1e-4];
const FLIGHT_FD_STEPS: [f64; 6] = [1e-4, 1e-4, 1e-3, 1e-3, 1e-1, 1e-4];

/// What a window's points are predicted to show, two numbers each, and derivatives of it.
#[derive(Default)]
pub struct Prediction {
    pub positions: Vec<f64>,
    pub by_nuisance: Vec<Vec<f64>>,
    /// By [`Shared`].
    pub by_parameter: Vec<Vec<f64>>,
    /// Differences over their units.
    pub by_perturbation: Vec<Vec<f64>>,
    /// What happens in a contact window.
    pub impact: Option<Impact>,
}

/// A slot that concerns a window, and its values below and above.
pub struct Stencil {
    pub parameter: usize,
    pub low: f64,
    pub high: f64,
}

/// The slots that concern a window: all but other settings', those that are fixed and, where nothing is met, latents.
pub fn stencils(layout: &ParameterLayout, values: &[f64], window: &Segment) -> Vec<Stencil> {
    let concerns = |slot: &Parameter| {
        let latent = matches!(slot.kind, ParameterKind::Latent(_));
        slot.setting.is_none_or(|s| s == window.setting)
            && !slot.is_fixed
            && !(latent && matches!(window.kind, SegmentKind::Flight | SegmentKind::Rolling))
    };
    let slots = (0..layout.parameters.len()).filter(|i| concerns(&layout.parameters[*i]));
    slots
        .map(|i| {
            let (slot, value) = (&layout.parameters[i], values[i]);
            let wide = slot.fd_step * if window.kind.uses_engine() { 3.0 } else { 1.0 };
            let h = wide.max(1e-4 * value.abs());
            let (mut low, mut high) = ((value - h).max(slot.bounds[0]), (value + h).min(slot.bounds[1]));
            if !window.kind.uses_engine() && !layout.is_discontinuous(i) {
                // Paths integrated here are smooth: one side is enough.
                if value + h <= slot.bounds[1] { low = value } else { high = value }
            }
            Stencil { parameter: i, low, high }
        })
        .collect()
}

/// Window number `w`, which is integrated here, as its launch's mode has it.
pub fn linearise_ode(
    window: &Segment,
    w: usize,
    layout: &ParameterLayout,
    state: &FitState,
    shared: &[Stencil],
    extras: &[Perturbation],
) -> Prediction {
    let (nuisances, values, beside) =
        (state.nuisances[w].as_slice(), state.values_in(w), state.random_effect_terms(w));
    let here = layout.segment_physics(window, &values, &beside);
    let steps: &[f64] =
        if window.kind == SegmentKind::Rolling { &ROLLING_FD_STEPS } else { &FLIGHT_FD_STEPS };
    let starts: Vec<Vec<f64>> = (0..nuisances.len().min(steps.len()))
        .map(|k| {
            let mut moved = nuisances.to_vec();
            moved[k] += steps[k];
            moved
        })
        .collect();
    // The ends of every slot's difference that are not where the state is.
    let ends = shared.iter().flat_map(|s| [(s.parameter, s.low), (s.parameter, s.high)]);
    let with_value = |(slot, value): (usize, f64)| {
        (value != values[slot]).then(|| {
            let mut moved = values.clone();
            moved[slot] = value;
            layout.segment_physics(window, &moved, &beside)
        })
    };
    let ends: Vec<Option<SegmentPhysics>> = ends.map(with_value).collect();
    let with_extra = |e: &Perturbation| {
        layout.segment_physics(
            window,
            &values,
            &[beside.as_slice(), &[(e.effect, e.values.clone())]].concat(),
        )
    };
    let besides: Vec<SegmentPhysics> = extras.iter().map(with_extra).collect();

    let from_here = [(&here, nuisances)].into_iter().chain(starts.iter().map(|s| (&here, s.as_slice())));
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
    let slots = shared.iter().enumerate().map(by_slot).collect();
    let extras = extras.iter().map(|e| difference_quotient(&next(), &base, e.unit)).collect();
    Prediction {
        positions: base,
        by_nuisance: nuisances,
        by_parameter: slots,
        by_perturbation: extras,
        impact,
    }
}

/// Difference over what made it.
pub fn difference_quotient(high: &[f64], low: &[f64], by: f64) -> Vec<f64> {
    high.iter().zip(low).map(|(a, b)| (a - b) / by).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{flights, term};

    /// In a flight everything is known: x moves by 1 for each metre of the start, by t for each m/s, and by t^2 / 2 for each
    /// m/s^2 of wind.
    #[test]
    fn derivatives_of_a_flight_are_those_of_a_parabola() {
        let (windows, _) = flights([0.0, 0.0], 1);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let state = FitState::new(vec![0.5, 0.0], vec![windows[0].nuisances.clone()]);
        let shared = stencils(&layout, &state.values, &windows[0]);
        let drag = term("quadratic_drag").effect;
        let extra = Perturbation { effect: drag, values: vec![1e-3], unit: 1e-3 };
        let moved = linearise_ode(&windows[0], 0, &layout, &state, &shared, &[extra]);
        for (i, t) in windows[0].observations.iter().map(|p| p.time).enumerate() {
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
    fn a_number_at_its_bound_moves_inwards() {
        let (windows, _) = flights([0.0, 0.0], 1);
        let layout = ParameterLayout::new(&[1], vec![term("wind")], 1);
        let [low, high] = layout.parameters[1].bounds;
        for (value, inwards) in [(low, true), (high, false)] {
            let shared = stencils(&layout, &[0.5, value, 0.0], &windows[0]);
            assert_eq!(
                shared.iter().map(|s| s.parameter).collect::<Vec<_>>(),
                [1, 2],
                "friction concerns no flight"
            );
            assert_eq!((shared[0].low == value, shared[0].high == value), (inwards, !inwards));
        }
    }
}
