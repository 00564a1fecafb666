//! What a window's points are predicted to show, and by how much more when a number moves.
//!
//! Derivatives are differences of rollouts: one-sided of paths that are integrated here, which are smooth, two-sided of
//! those that an engine simulates and across edges.

use super::layout::{Layout, Slot, What};
use super::state::{Extra, State};
use crate::discover::path::{Impact, Physics, seen};
use crate::discover::window::{Kind, Window};

/// Differences for derivatives by a roll's way, speed, height and slope, and by x, y, vx, vy, omega and the surface's offset.
const ROLL: [f64; 4] = [1e-4, 1e-3, 1e-4, 1e-4];
const FLIGHT: [f64; 6] = [1e-4, 1e-4, 1e-3, 1e-3, 1e-1, 1e-4];

/// What a window's points are predicted to show, two numbers each, and derivatives of it.
#[derive(Default)]
pub struct Moved {
    pub base: Vec<f64>,
    pub nuisances: Vec<Vec<f64>>,
    /// By [`Shared`].
    pub slots: Vec<Vec<f64>>,
    /// Differences over their units.
    pub extras: Vec<Vec<f64>>,
    /// What happens in a contact window.
    pub impact: Option<Impact>,
}

/// A slot that concerns a window, and its values below and above.
pub struct Shared {
    pub slot: usize,
    pub low: f64,
    pub high: f64,
}

/// The slots that concern a window: all but other settings', those that are fixed and, where nothing is met, latents.
pub fn shared(layout: &Layout, values: &[f64], window: &Window) -> Vec<Shared> {
    let concerns = |slot: &Slot| {
        let latent = matches!(slot.what, What::Latent(_));
        slot.setting.is_none_or(|s| s == window.setting)
            && !slot.is_fixed
            && !(latent && matches!(window.kind, Kind::Flight | Kind::Roll))
    };
    let slots = (0..layout.slots.len()).filter(|i| concerns(&layout.slots[*i]));
    slots
        .map(|i| {
            let (slot, value) = (&layout.slots[i], values[i]);
            let wide = slot.step * if window.kind.simulated() { 3.0 } else { 1.0 };
            let h = wide.max(1e-4 * value.abs());
            let (mut low, mut high) = ((value - h).max(slot.bounds[0]), (value + h).min(slot.bounds[1]));
            if !window.kind.simulated() && !layout.edged(i) {
                // Paths integrated here are smooth: one side is enough.
                if value + h <= slot.bounds[1] { low = value } else { high = value }
            }
            Shared { slot: i, low, high }
        })
        .collect()
}

/// Window number `w`, which is integrated here, as its launch's mode has it.
pub fn integrated(
    window: &Window,
    w: usize,
    layout: &Layout,
    state: &State,
    shared: &[Shared],
    extras: &[Extra],
) -> Moved {
    let (nuisances, values, beside) = (state.nuisances[w].as_slice(), state.values_in(w), state.beside(w));
    let here = layout.path(window, &values, &beside);
    let steps: &[f64] = if window.kind == Kind::Roll { &ROLL } else { &FLIGHT };
    let starts: Vec<Vec<f64>> = (0..nuisances.len().min(steps.len()))
        .map(|k| {
            let mut moved = nuisances.to_vec();
            moved[k] += steps[k];
            moved
        })
        .collect();
    // The ends of every slot's difference that are not where the state is.
    let ends = shared.iter().flat_map(|s| [(s.slot, s.low), (s.slot, s.high)]);
    let with_value = |(slot, value): (usize, f64)| {
        (value != values[slot]).then(|| {
            let mut moved = values.clone();
            moved[slot] = value;
            layout.path(window, &moved, &beside)
        })
    };
    let ends: Vec<Option<Physics>> = ends.map(with_value).collect();
    let with_extra = |e: &Extra| {
        layout.path(window, &values, &[beside.as_slice(), &[(e.effect, e.values.clone())]].concat())
    };
    let besides: Vec<Physics> = extras.iter().map(with_extra).collect();

    let from_here = [(&here, nuisances)].into_iter().chain(starts.iter().map(|s| (&here, s.as_slice())));
    let others = ends.iter().flatten().chain(&besides).map(|p| (p, nuisances));
    let mut found = seen(&from_here.chain(others).collect::<Vec<_>>()).into_iter();
    let (base, impact) = found.next().unwrap_or_default();
    let mut next = || found.next().unwrap_or_default().0;
    let nuisances = starts.iter().zip(steps).map(|(_, h)| slope(&next(), &base, *h)).collect();
    let mut end = |k: usize| if ends[k].is_some() { next() } else { base.clone() };
    let by_slot = |(k, s): (usize, &Shared)| {
        let low = end(2 * k);
        slope(&end(2 * k + 1), &low, s.high - s.low)
    };
    let slots = shared.iter().enumerate().map(by_slot).collect();
    let extras = extras.iter().map(|e| slope(&next(), &base, e.unit)).collect();
    Moved { base, nuisances, slots, extras, impact }
}

/// Difference over what made it.
pub fn slope(high: &[f64], low: &[f64], by: f64) -> Vec<f64> {
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
        let layout = Layout::new(&[], vec![term("wind")], 1);
        let state = State::new(vec![0.5, 0.0], vec![windows[0].nuisances.clone()]);
        let shared = shared(&layout, &state.values, &windows[0]);
        let drag = term("quadratic_drag").effect;
        let extra = Extra { effect: drag, values: vec![1e-3], unit: 1e-3 };
        let moved = integrated(&windows[0], 0, &layout, &state, &shared, &[extra]);
        for (i, t) in windows[0].points.iter().map(|p| p.time).enumerate() {
            let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-6, "{a} for {b} at {t}");
            near(moved.nuisances[0][2 * i], 1.0);
            near(moved.nuisances[2][2 * i], t);
            near(moved.nuisances[2][2 * i + 1], 0.0);
            near(moved.slots[0][2 * i], 0.5 * t * t);
            near(moved.slots[1][2 * i + 1], 0.5 * t * t);
            assert!(moved.extras[0][2 * i] <= 0.0, "drag holds back");
        }
    }

    #[test]
    fn a_number_at_its_bound_moves_inwards() {
        let (windows, _) = flights([0.0, 0.0], 1);
        let layout = Layout::new(&[1], vec![term("wind")], 1);
        let [low, high] = layout.slots[1].bounds;
        for (value, inwards) in [(low, true), (high, false)] {
            let shared = shared(&layout, &[0.5, value, 0.0], &windows[0]);
            assert_eq!(
                shared.iter().map(|s| s.slot).collect::<Vec<_>>(),
                [1, 2],
                "friction concerns no flight"
            );
            assert_eq!((shared[0].low == value, shared[0].high == value), (inwards, !inwards));
        }
    }
}
