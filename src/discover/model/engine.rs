//! Windows that a world's engine simulates, all of a pass in one batch.

use super::data::{Data, Frozen};
use super::layout::Layout;
use super::moved::{Moved, Shared, shared, slope};
use super::state::{Extra, State};
use crate::discover::window::Window;
use crate::error::Result;
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::trajectory::{Termination, Trajectory};
use crate::world::{Latents, Rollout, Simulator};

/// Differences for derivatives by a body's x, y, vx, vy, omega in a shot.
pub const NUDGE: [f64; 5] = [1e-3, 1e-3, 1e-2, 1e-2, 5e-2];

/// What windows show that an engine simulates, in their order.
pub fn simulated(data: &Data, layout: &Layout, state: &State, extras: &[Extra]) -> Result<Vec<Moved>> {
    let mut batch = Batch::default();
    let mut plans: Vec<(usize, Vec<Shared>)> = Vec::new();
    for (w, window) in data.windows.iter().enumerate().filter(|(_, w)| w.kind.simulated()) {
        let shared = shared(layout, &state.values, window);
        batch.plan(data, layout, state, w, &shared, extras);
        plans.push((w, shared));
    }
    if plans.is_empty() {
        return Ok(Vec::new());
    }
    let mut seen = batch.shown(data)?.into_iter();
    let mut next = || seen.next().unwrap_or_default();
    let mut out = Vec::new();
    for (w, shared) in plans {
        let base = next();
        let mut difference = |by: f64| {
            let low = next();
            slope(&next(), &low, by)
        };
        let frozen = data.frozen(w);
        let nuisances = match frozen {
            Some(known) => known.nuisances.clone(),
            None => (0..state.nuisances[w].len()).map(|k| difference(2.0 * NUDGE[k % 5])).collect(),
        };
        let mut by_slot = |s: &Shared| match frozen.and_then(|f| f.latents.get(s.slot)) {
            Some(known) => known.clone(),
            None => difference(s.high - s.low),
        };
        let slots = shared.iter().map(&mut by_slot).collect();
        let extras = extras.iter().map(|e| slope(&next(), &base, e.unit)).collect();
        out.push(Moved { base, nuisances, slots, extras, impact: None });
    }
    Ok(out)
}

/// Scenes, and what is to be simulated in them.
#[derive(Default)]
struct Batch {
    scenes: Vec<Scene>,
    /// Window, scene, and what acts.
    jobs: Vec<(usize, usize, (Vec<EffectTerm>, Latents))>,
}

impl Batch {
    /// Adds a window as it stands, then with each nuisance moved down and up, each slot, and each extra; what is known of it
    /// already is left out.
    fn plan(
        &mut self,
        data: &Data,
        layout: &Layout,
        state: &State,
        w: usize,
        shared: &[Shared],
        extras: &[Extra],
    ) {
        let (window, nuisances, frozen) = (&data.windows[w], &state.nuisances[w], data.frozen(w));
        let physics = |values: &[f64]| layout.physics(values, window.setting, window.start);
        let (effects, latents) = physics(&state.values);
        let here = self.scenes.len();
        self.scenes.push(placed(window, nuisances));
        self.jobs.push((w, here, (effects.clone(), latents)));
        if frozen.is_none() {
            for (k, to) in (0..nuisances.len()).flat_map(|k| [(k, -1.0), (k, 1.0)]) {
                let mut moved = nuisances.clone();
                moved[k] += to * NUDGE[k % 5];
                self.jobs.push((w, self.scenes.len(), (effects.clone(), latents)));
                self.scenes.push(placed(window, &moved));
            }
        }
        let unknown = |s: &&Shared| frozen.is_none_or(|f| f.latents.get(s.slot).is_none());
        for (slot, end) in shared.iter().filter(unknown).flat_map(|s| [(s.slot, s.low), (s.slot, s.high)]) {
            let mut moved = state.values.clone();
            moved[slot] = end;
            self.jobs.push((w, here, physics(&moved)));
        }
        for e in extras {
            let mut effects = effects.clone();
            effects.push(e.effect.term_at_clock(&e.values, window.start));
            self.jobs.push((w, here, (effects, latents)));
        }
    }

    /// What the windows' points show, by job.
    fn shown(&self, data: &Data) -> Result<Vec<Vec<f64>>> {
        let rollouts: Vec<Rollout> = self
            .jobs
            .iter()
            .map(|(w, scene, physics)| data.windows[*w].rollout(&self.scenes[*scene], physics))
            .collect();
        Simulator::new(data.engine)
            .budget(&data.progress)
            .map(&rollouts, |i, path| predicted(&data.windows[self.jobs[i].0], &path))
    }
}

/// Derivatives by the nuisances of every window that is simulated and by the latents, to be kept: they change little with what
/// a search tries. `layout`: of latents alone.
pub fn freeze(data: &mut Data, layout: &Layout, state: &State) -> Result<()> {
    data.frozen.clear();
    let mut found = simulated(data, layout, state, &[])?.into_iter();
    let known = |w: &Window| {
        let moved = if w.kind.simulated() { found.next().unwrap_or_default() } else { Moved::default() };
        Frozen { nuisances: moved.nuisances, latents: moved.slots }
    };
    data.frozen = data.windows.iter().map(known).collect();
    Ok(())
}

/// A shot's scene with its bodies where the nuisances say; a run's as it is.
pub fn placed(window: &Window, nuisances: &[f64]) -> Scene {
    let mut scene = window.scene.clone();
    for (body, own) in scene.bodies.iter_mut().zip(nuisances.chunks_exact(5)) {
        body.position = Some([own[0], own[1]]);
        body.velocity = [own[2], own[3]];
        body.angular_velocity = own[4];
    }
    scene
}

/// Positions at a window's points, two numbers each; NaN where the path diverged.
pub fn predicted(window: &Window, trajectory: &Trajectory) -> Vec<f64> {
    let mut out = Vec::with_capacity(2 * window.points.len());
    if trajectory.outcome.end == Termination::Diverged || trajectory.times.is_empty() {
        out.resize(2 * window.points.len(), f64::NAN);
        return out;
    }
    let times = &trajectory.times;
    let last = times.len() - 1;
    let mut at = 0;
    for point in &window.points {
        while at + 1 < last && times[at + 1] < point.time - 1e-12 {
            at += 1;
        }
        let (i, j) = (at, (at + 1).min(last));
        let track = &trajectory.bodies[point.body];
        let span = times[j] - times[i];
        let s = if span > 0.0 { ((point.time - times[i]) / span).clamp(0.0, 1.0) } else { 0.0 };
        if s >= 1.0 - 1e-9 || s <= 1e-9 {
            let k = if s > 0.5 { j } else { i };
            out.extend([track.x[k], track.y[k]]);
            continue;
        }
        let between = |x: &[f64], v: &[f64]| between([x[i], x[j]], [v[i], v[j]], span, s);
        out.extend([between(&track.x, &track.vx), between(&track.y, &track.vy)]);
    }
    out
}

/// A place a share `s` of the way between two: cubic Hermite; straight across a bounce, whose kink a cubic would overshoot.
fn between(x: [f64; 2], v: [f64; 2], span: f64, s: f64) -> f64 {
    let kink = (v[1] - v[0]).abs() > 0.5 * (v[0].abs() + v[1].abs()) && v[0] * v[1] < 0.0;
    if kink {
        return x[0] + s * (x[1] - x[0]);
    }
    let (s2, s3) = (s * s, s * s * s);
    (2.0 * s3 - 3.0 * s2 + 1.0) * x[0]
        + (s3 - 2.0 * s2 + s) * span * v[0]
        + (3.0 * s2 - 2.0 * s3) * x[1]
        + (s3 - s2) * span * v[1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{shots, term};
    use crate::world::Engine;
    use crate::world::latent::factor_index;

    /// A cubic is met exactly between its ends; a bounce is cut straight.
    #[test]
    fn between_two_states_lies_a_cubic_or_a_bounce() {
        let (x, v) = (|t: f64| 1.0 + t - 2.0 * t * t + t * t * t, |t: f64| 1.0 - 4.0 * t + 3.0 * t * t);
        let (a, b) = (1.5, 2.0);
        let met = between([x(a), x(b)], [v(a), v(b)], b - a, 0.3);
        assert!((met - x(a + 0.3 * (b - a))).abs() < 1e-12);
        assert_eq!(between([1.0, 2.0], [-5.0, 4.0], 0.1, 0.25), 1.25);
    }

    /// Two balls in the air: each moves by its own start alone, as far as a straight line says.
    #[test]
    fn derivatives_of_a_shot_are_those_of_free_flight() {
        let (windows, settings) = shots();
        let data = Data::new(&windows, &settings, vec![1e-3], Engine::Lanes);
        let state = State::new(vec![0.0, 0.0], vec![windows[0].nuisances.clone()]);
        let layout = Layout::new(&[], vec![term("wind")], 1);
        let moved = &simulated(&data, &layout, &state, &[]).unwrap()[0];
        for (i, p) in windows[0].points.iter().enumerate() {
            let near =
                |a: f64, b: f64| assert!((a - b).abs() < 1e-3 * (1.0 + p.time), "{a} for {b} at {}", p.time);
            for body in 0..2 {
                let own = f64::from(p.body == body);
                near(moved.nuisances[5 * body][2 * i], own);
                near(moved.nuisances[5 * body + 3][2 * i + 1], own * p.time);
                near(moved.nuisances[5 * body + 3][2 * i], 0.0);
            }
            near(moved.slots[0][2 * i], 0.5 * p.time * p.time);
        }
    }

    /// What is frozen is handed out as it was found, and the rest is simulated about the new place.
    #[test]
    fn what_is_frozen_is_not_simulated_again() {
        let (windows, settings) = shots();
        let mut data = Data::new(&windows, &settings, vec![1e-3], Engine::Lanes);
        let latents = [factor_index("friction").unwrap()];
        let nuisances = vec![windows[0].nuisances.clone()];
        let base = State::new(vec![0.5], nuisances.clone());
        freeze(&mut data, &Layout::new(&latents, Vec::new(), 1), &base).unwrap();
        let layout = Layout::new(&latents, vec![term("wind")], 1);
        let state = State::new(vec![0.5, 0.0, 0.0], nuisances);
        let warm = simulated(&data, &layout, &state, &[]).unwrap();
        data.frozen[0].nuisances[0].fill(7.0);
        let marked = simulated(&data, &layout, &state, &[]).unwrap();
        data.frozen.clear();
        let cold = simulated(&data, &layout, &state, &[]).unwrap();
        assert!(marked[0].nuisances[0].iter().all(|v| *v == 7.0));
        for (a, b) in [(&warm[0], &cold[0]), (&warm[0], &marked[0])] {
            assert_eq!((&a.base, &a.slots, &a.nuisances[1..]), (&b.base, &b.slots, &b.nuisances[1..]));
        }
    }
}
