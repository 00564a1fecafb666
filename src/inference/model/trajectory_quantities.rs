//! States and accelerations along fitted trajectories, and impacts.

use super::engine_linearization::apply_initial_state;
use super::fit_state::FitState;
use super::parameters::ParameterLayout;
use super::segment_data::SegmentData;
use crate::error::Result;
use crate::inference::dynamics::{Impact, SegmentPhysics};
use crate::inference::segment::{Observation, Segment};
use crate::trajectory::Trajectory;
use crate::world::{Rollout, Simulator};

/// States (x, y, vx, vy) at the observations of every segment.
pub fn segment_states(
    data: &SegmentData,
    layout: &ParameterLayout,
    state: &FitState,
) -> Result<Vec<Vec<[f64; 4]>>> {
    let segments = || data.segments.iter().enumerate();
    let run = |(w, segment): (usize, &Segment)| {
        (
            apply_initial_state(segment, &state.nuisances[w]),
            layout.effects_and_latents(&state.values, segment.setting, segment.start),
        )
    };
    let simulated: Vec<&Segment> = data.segments.iter().filter(|w| w.kind.uses_engine()).collect();
    let runs: Vec<_> = segments().filter(|(_, w)| w.kind.uses_engine()).map(run).collect();
    let rollouts: Vec<Rollout> =
        runs.iter().zip(&simulated).map(|((scene, physics), w)| w.rollout(scene, physics)).collect();
    let states =
        |i: usize, path| simulated[i].observations.iter().map(|p| state_at(&path, p)).collect::<Vec<_>>();
    let mut simulated =
        Simulator::new(data.engine).budget(&data.progress).map(&rollouts, states)?.into_iter();
    let path = |w: usize, segment: &Segment| {
        if segment.kind.uses_engine() {
            return simulated.next().unwrap_or_default();
        }
        let mut states = vec![[f64::NAN; 4]; segment.observations.len()];
        with_physics(segment, w, layout, state, |physics| {
            physics.predict_positions(&state.nuisances[w], |i, s| states[i] = s)
        });
        states
    };
    data.each_segment(path)
}

/// Impact of a contact segment.
pub fn impact(segment: &Segment, w: usize, layout: &ParameterLayout, state: &FitState) -> Option<Impact> {
    with_physics(segment, w, layout, state, |physics| physics.impact(&state.nuisances[w]))
}

/// Passes the physics of segment `w`, at the conditional modes of its trial, to `of`.
fn with_physics<T>(
    segment: &Segment,
    w: usize,
    layout: &ParameterLayout,
    state: &FitState,
    of: impl FnOnce(&SegmentPhysics) -> T,
) -> T {
    of(&layout.segment_physics(segment, &state.values_in(w), &state.random_effect_terms(w)))
}

/// Accelerations at the states (x, y, vx, vy) of a segment's observations, m/s^2.
pub fn accelerations(
    segment: &Segment,
    layout: &ParameterLayout,
    values: &[f64],
    states: &[[f64; 4]],
) -> Vec<[f64; 2]> {
    let physics = layout.segment_physics(segment, values, &[]);
    segment
        .observations
        .iter()
        .zip(states)
        .map(|(point, s)| physics.acceleration_at(point.time, *s))
        .collect()
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
    use crate::inference::testing::segments::{flights, multi_step_segments, term};
    use crate::world::Engine;

    /// The integrator and the engine give the same parabola and acceleration under wind.
    #[test]
    fn integrator_and_engine_agree_on_parabolas() {
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        for ((segments, settings), allowed) in [(flights([0.0, 0.0], 1), 1e-9), (multi_step_segments(), 0.02)]
        {
            let data = SegmentData::new(&segments, &settings, vec![1e-3], Engine::Lanes);
            let state = FitState::new(vec![0.6, 0.0], vec![segments[0].nuisances.clone()]);
            let paths = segment_states(&data, &layout, &state).unwrap();
            for (point, [x, _, vx, _]) in segments[0].observations.iter().zip(&paths[0]) {
                let (own, t) = (&segments[0].nuisances[5 * point.body..], point.time);
                assert!((x - own[0] - own[2] * t - 0.3 * t * t).abs() < allowed, "{x} at {t}");
                assert!((vx - own[2] - 0.6 * t).abs() < allowed, "{vx} at {t}");
            }
            let accelerations = accelerations(&segments[0], &layout, &state.values, &paths[0]);
            assert!(
                accelerations.iter().all(|[x, y]| (x - 0.6).abs() < 1e-6 && (y + 9.81).abs() < 1e-6),
                "{accelerations:?}"
            );
        }
    }

    /// A gust depends on the clock of the trial, not on the time since the segment's start.
    #[test]
    fn time_dependent_effects_use_the_trial_clock() {
        let (mut segments, _) = flights([0.0, 0.0], 1);
        segments[0].start = 0.3;
        let layout = ParameterLayout::new(&[], vec![term("gust")], 1);
        let states = vec![[0.0; 4]; segments[0].observations.len()];
        let accelerations = accelerations(&segments[0], &layout, &[1.5, 0.0, 2.0, 0.4], &states);
        for (point, [x, _]) in segments[0].observations.iter().zip(accelerations) {
            let expected = 1.5 * libm::sin(std::f64::consts::PI * (0.3 + point.time) + 0.4);
            assert!((x - expected).abs() < 1e-5, "{x} for {expected}");
        }
    }
}
