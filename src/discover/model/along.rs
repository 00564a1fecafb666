//! What happens along fitted paths: where they lead, what pushes there, what a contact does.

use super::data::SegmentData;
use super::engine::apply_initial_state;
use super::layout::ParameterLayout;
use super::state::FitState;
use crate::discover::path::{Impact, SegmentPhysics};
use crate::discover::window::{Observation, Segment};
use crate::error::Result;
use crate::trajectory::Trajectory;
use crate::world::{Rollout, Simulator};

/// States (x, y, vx, vy) at every window's points, for pictures and for what acts along a path.
pub fn segment_states(
    data: &SegmentData,
    layout: &ParameterLayout,
    state: &FitState,
) -> Result<Vec<Vec<[f64; 4]>>> {
    let windows = || data.segments.iter().enumerate();
    let run = |(w, window): (usize, &Segment)| {
        (
            apply_initial_state(window, &state.nuisances[w]),
            layout.effects_and_latents(&state.values, window.setting, window.start),
        )
    };
    let simulated: Vec<&Segment> = data.segments.iter().filter(|w| w.kind.uses_engine()).collect();
    let runs: Vec<_> = windows().filter(|(_, w)| w.kind.uses_engine()).map(run).collect();
    let rollouts: Vec<Rollout> =
        runs.iter().zip(&simulated).map(|((scene, physics), w)| w.rollout(scene, physics)).collect();
    let states =
        |i: usize, path| simulated[i].observations.iter().map(|p| state_at(&path, p)).collect::<Vec<_>>();
    let mut simulated = Simulator::new(data.engine).map(&rollouts, states)?.into_iter();
    let path = |(w, window): (usize, &Segment)| {
        if window.kind.uses_engine() {
            return simulated.next().unwrap_or_default();
        }
        let mut states = vec![[f64::NAN; 4]; window.observations.len()];
        with_physics(window, w, layout, state, |physics| {
            physics.predict_positions(&state.nuisances[w], |i, s| states[i] = s)
        });
        states
    };
    Ok(windows().map(path).collect())
}

/// What happens in a contact window.
pub fn impact(window: &Segment, w: usize, layout: &ParameterLayout, state: &FitState) -> Option<Impact> {
    with_physics(window, w, layout, state, |physics| physics.impact(&state.nuisances[w]))
}

/// What `of` makes of what acts in window number `w`, as its launch's mode has it.
fn with_physics<T>(
    window: &Segment,
    w: usize,
    layout: &ParameterLayout,
    state: &FitState,
    of: impl FnOnce(&SegmentPhysics) -> T,
) -> T {
    of(&layout.segment_physics(window, &state.values_in(w), &state.random_effect_terms(w)))
}

/// Accelerations at true states (x, y, vx, vy) of a window's points, m/s^2.
pub fn accelerations(
    window: &Segment,
    layout: &ParameterLayout,
    values: &[f64],
    states: &[[f64; 4]],
) -> Vec<[f64; 2]> {
    let physics = layout.segment_physics(window, values, &[]);
    window.observations.iter().zip(states).map(|(point, s)| physics.acceleration_at(point.time, *s)).collect()
}

fn state_at(path: &Trajectory, point: &Observation) -> [f64; 4] {
    let after = path.times.partition_point(|t| *t < point.time - 1e-9);
    match path.bodies.get(point.body) {
        Some(track) if !track.is_empty() => {
            let i = after.min(track.len() - 1);
            [track.x[i], track.y[i], track.vx[i], track.vy[i]]
        }
        _ => [f64::NAN; 4],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{flights, multi_step_segments, term};
    use crate::world::Engine;

    /// The same wind along a path integrated here and along one of an engine: where it leads, and what pushes there.
    #[test]
    fn paths_are_parabolas_whoever_follows_them() {
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        for ((windows, settings), allowed) in [(flights([0.0, 0.0], 1), 1e-9), (multi_step_segments(), 0.02)]
        {
            let data = SegmentData::new(&windows, &settings, vec![1e-3], Engine::Lanes);
            let state = FitState::new(vec![0.6, 0.0], vec![windows[0].nuisances.clone()]);
            let paths = segment_states(&data, &layout, &state).unwrap();
            for (point, [x, _, vx, _]) in windows[0].observations.iter().zip(&paths[0]) {
                let (own, t) = (&windows[0].nuisances[5 * point.body..], point.time);
                assert!((x - own[0] - own[2] * t - 0.3 * t * t).abs() < allowed, "{x} at {t}");
                assert!((vx - own[2] - 0.6 * t).abs() < allowed, "{vx} at {t}");
            }
            let pushes = accelerations(&windows[0], &layout, &state.values, &paths[0]);
            assert!(
                pushes.iter().all(|[x, y]| (x - 0.6).abs() < 1e-6 && (y + 9.81).abs() < 1e-6),
                "{pushes:?}"
            );
        }
    }

    /// A gust pushes by the clock: that of the trial, not of the window.
    #[test]
    fn what_changes_with_time_pushes_by_the_clock() {
        let (mut windows, _) = flights([0.0, 0.0], 1);
        windows[0].start = 0.3;
        let layout = ParameterLayout::new(&[], vec![term("gust")], 1);
        let states = vec![[0.0; 4]; windows[0].observations.len()];
        let pushes = accelerations(&windows[0], &layout, &[1.5, 0.0, 2.0, 0.4], &states);
        for (point, [x, _]) in windows[0].observations.iter().zip(pushes) {
            let wanted = 1.5 * libm::sin(std::f64::consts::PI * (0.3 + point.time) + 0.4);
            assert!((x - wanted).abs() < 1e-5, "{x} for {wanted}");
        }
    }
}
