//! What happens along fitted paths: where they lead, what pushes there, what a contact does.

use super::data::Data;
use super::engine::placed;
use super::layout::Layout;
use super::state::State;
use crate::discover::path::{Impact, Physics};
use crate::discover::window::{Point, Window};
use crate::error::Result;
use crate::trajectory::Trajectory;
use crate::world::{Rollout, Simulator};

/// States (x, y, vx, vy) at every window's points, for pictures and for what acts along a path.
pub fn paths(data: &Data, layout: &Layout, state: &State) -> Result<Vec<Vec<[f64; 4]>>> {
    let windows = || data.windows.iter().enumerate();
    let run = |(w, window): (usize, &Window)| {
        (placed(window, &state.nuisances[w]), layout.physics(&state.values, window.setting, window.start))
    };
    let simulated: Vec<&Window> = data.windows.iter().filter(|w| w.kind.simulated()).collect();
    let runs: Vec<_> = windows().filter(|(_, w)| w.kind.simulated()).map(run).collect();
    let rollouts: Vec<Rollout> =
        runs.iter().zip(&simulated).map(|((scene, physics), w)| w.rollout(scene, physics)).collect();
    let states = |i: usize, path| simulated[i].points.iter().map(|p| state_at(&path, p)).collect::<Vec<_>>();
    let mut simulated =
        Simulator::new(data.engine).budget(&data.progress).map(&rollouts, states)?.into_iter();
    let path = |w: usize, window: &Window| {
        if window.kind.simulated() {
            return simulated.next().unwrap_or_default();
        }
        let mut states = vec![[f64::NAN; 4]; window.points.len()];
        own(window, w, layout, state, |physics| physics.seen(&state.nuisances[w], |i, s| states[i] = s));
        states
    };
    data.each_window(path)
}

/// What happens in a contact window.
pub fn impact(window: &Window, w: usize, layout: &Layout, state: &State) -> Option<Impact> {
    own(window, w, layout, state, |physics| physics.impact(&state.nuisances[w]))
}

/// What `of` makes of what acts in window number `w`, as its launch's mode has it.
fn own<T>(window: &Window, w: usize, layout: &Layout, state: &State, of: impl FnOnce(&Physics) -> T) -> T {
    of(&layout.path(window, &state.values_in(w), &state.beside(w)))
}

/// Accelerations at true states (x, y, vx, vy) of a window's points, m/s^2.
pub fn pushes(window: &Window, layout: &Layout, values: &[f64], states: &[[f64; 4]]) -> Vec<[f64; 2]> {
    let physics = layout.path(window, values, &[]);
    window.points.iter().zip(states).map(|(point, s)| physics.push(point.time, *s)).collect()
}

fn state_at(path: &Trajectory, point: &Point) -> [f64; 4] {
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
    use crate::discover::fixture::{flights, shots, term};
    use crate::world::Engine;

    /// The same wind along a path integrated here and along one of an engine: where it leads, and what pushes there.
    #[test]
    fn paths_are_parabolas_whoever_follows_them() {
        let layout = Layout::new(&[], vec![term("wind")], 1);
        for ((windows, settings), allowed) in [(flights([0.0, 0.0], 1), 1e-9), (shots(), 0.02)] {
            let data = Data::new(&windows, &settings, vec![1e-3], Engine::Lanes);
            let state = State::new(vec![0.6, 0.0], vec![windows[0].nuisances.clone()]);
            let paths = paths(&data, &layout, &state).unwrap();
            for (point, [x, _, vx, _]) in windows[0].points.iter().zip(&paths[0]) {
                let (own, t) = (&windows[0].nuisances[5 * point.body..], point.time);
                assert!((x - own[0] - own[2] * t - 0.3 * t * t).abs() < allowed, "{x} at {t}");
                assert!((vx - own[2] - 0.6 * t).abs() < allowed, "{vx} at {t}");
            }
            let pushes = pushes(&windows[0], &layout, &state.values, &paths[0]);
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
        let layout = Layout::new(&[], vec![term("gust")], 1);
        let states = vec![[0.0; 4]; windows[0].points.len()];
        let pushes = pushes(&windows[0], &layout, &[1.5, 0.0, 2.0, 0.4], &states);
        for (point, [x, _]) in windows[0].points.iter().zip(pushes) {
            let wanted = 1.5 * libm::sin(std::f64::consts::PI * (0.3 + point.time) + 0.4);
            assert!((x - wanted).abs() < 1e-5, "{x} for {wanted}");
        }
    }
}
