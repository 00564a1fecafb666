//! What a window's points are predicted to show, and by how much more when a number moves.
//!
//! Derivatives are differences of rollouts: one-sided of paths that are integrated here, which are smooth, two-sided of
//! those that an engine simulates and across edges.

use super::layout::{Layout, Slot, What};
use super::state::{Extra, State};
use crate::discover::path::Physics;
use crate::discover::window::{Kind, Window};
use crate::world::effect::Effect;

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
}

/// A slot that concerns a window, and its values below and above.
pub struct Shared {
    pub slot: usize,
    pub low: f64,
    pub high: f64,
}

/// The slots that concern a window: all but other settings' and, where nothing is met, latents.
pub fn shared(layout: &Layout, values: &[f64], window: &Window) -> Vec<Shared> {
    let concerns = |slot: &Slot| {
        let latent = matches!(slot.what, What::Latent(_));
        slot.setting.is_none_or(|s| s == window.setting)
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
    let seen = |physics: &Physics, nuisances: &[f64]| physics.seen(nuisances, |_, _| ());
    let (nuisances, values, own) = (state.nuisances[w].as_slice(), state.values_in(w), state.beside(w));
    let beside: Vec<(&Effect, &[f64])> = own.iter().map(|(e, v)| (*e, v.as_slice())).collect();
    let here = layout.path(window, &values, &beside);
    let base = seen(&here, nuisances);
    let by_nuisance = |(k, h): (usize, &f64)| {
        let mut moved = nuisances.to_vec();
        moved[k] += h;
        slope(&seen(&here, &moved), &base, *h)
    };
    let by_slot = |s: &Shared| {
        let end = |value: f64| {
            if value == values[s.slot] {
                return base.clone();
            }
            let mut moved = values.clone();
            moved[s.slot] = value;
            seen(&layout.path(window, &moved, &beside), nuisances)
        };
        slope(&end(s.high), &end(s.low), s.high - s.low)
    };
    let by_extra = |e: &Extra| {
        let with = [beside.as_slice(), &[(e.effect, &e.values)]].concat();
        slope(&seen(&layout.path(window, &values, &with), nuisances), &base, e.unit)
    };
    let steps: &[f64] = if window.kind == Kind::Roll { &ROLL } else { &FLIGHT };
    Moved {
        nuisances: steps.iter().enumerate().take(nuisances.len()).map(by_nuisance).collect(),
        slots: shared.iter().map(by_slot).collect(),
        extras: extras.iter().map(by_extra).collect(),
        base,
    }
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
