//! Linearization of segments that an engine simulates, in one batch.

use super::finite_differences::{Prediction, Stencil, difference_quotient, stencils};
use super::fit_state::{FitState, Perturbation};
use super::parameters::ParameterLayout;
use super::segment_data::{CachedJacobian, SegmentData};
use crate::error::Result;
use crate::inference::segment::Segment;
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::trajectory::{Termination, Trajectory};
use crate::world::{Latents, Rollout, Simulator};

/// Finite-difference steps for x, y, vx, vy, omega of a body.
pub const STATE_FD_STEPS: [f64; 5] = [1e-3, 1e-3, 1e-2, 1e-2, 5e-2];

/// Predictions with Jacobians of all segments that an engine simulates, in their order.
pub fn linearise_engine(
    data: &SegmentData,
    layout: &ParameterLayout,
    state: &FitState,
    perturbations: &[Perturbation],
) -> Result<Vec<Prediction>> {
    let mut batch = RolloutBatch::default();
    let mut plans: Vec<(usize, Vec<Stencil>)> = Vec::new();
    for (w, segment) in data.segments.iter().enumerate().filter(|(_, w)| w.kind.uses_engine()) {
        let shared = stencils(layout, &state.values, segment);
        batch.add_segment(data, layout, state, w, &shared, perturbations);
        plans.push((w, shared));
    }
    if plans.is_empty() {
        return Ok(Vec::new());
    }
    let mut observed = batch.predict(data)?.into_iter();
    let mut next = || observed.next().unwrap_or_default();
    let mut out = Vec::new();
    for (w, shared) in plans {
        let base = next();
        let mut difference = |by: f64| {
            let low = next();
            difference_quotient(&next(), &low, by)
        };
        let cached = data.cached_jacobian(w);
        let nuisances = match cached {
            Some(known) => known.nuisances.clone(),
            None => (0..state.nuisances[w].len()).map(|k| difference(2.0 * STATE_FD_STEPS[k % 5])).collect(),
        };
        let mut by_slot = |s: &Stencil| match cached.and_then(|f| f.latents.get(s.parameter)) {
            Some(known) => known.clone(),
            None => difference(s.high - s.low),
        };
        let parameters = shared.iter().map(&mut by_slot).collect();
        let perturbations =
            perturbations.iter().map(|e| difference_quotient(&next(), &base, e.unit)).collect();
        out.push(Prediction {
            positions: base,
            by_nuisance: nuisances,
            by_parameter: parameters,
            by_perturbation: perturbations,
            impact: None,
        });
    }
    Ok(out)
}

/// Scenes and the rollouts in them.
#[derive(Default)]
struct RolloutBatch {
    scenes: Vec<Scene>,
    /// Segment, scene, and effects with latents.
    jobs: Vec<(usize, usize, (Vec<EffectTerm>, Latents))>,
}

impl RolloutBatch {
    /// Adds the rollouts of a segment: at the state, then with each nuisance decreased and increased, each
    /// parameter, and each perturbation; cached derivatives are omitted.
    fn add_segment(
        &mut self,
        data: &SegmentData,
        layout: &ParameterLayout,
        state: &FitState,
        w: usize,
        shared: &[Stencil],
        perturbations: &[Perturbation],
    ) {
        let (segment, nuisances, cached) = (&data.segments[w], &state.nuisances[w], data.cached_jacobian(w));
        let physics = |values: &[f64]| layout.effects_and_latents(values, segment.setting, segment.start);
        let (effects, latents) = physics(&state.values);
        let current = self.scenes.len();
        self.scenes.push(apply_initial_state(segment, nuisances));
        self.jobs.push((w, current, (effects.clone(), latents)));
        if cached.is_none() {
            for (k, to) in (0..nuisances.len()).flat_map(|k| [(k, -1.0), (k, 1.0)]) {
                let mut moved = nuisances.clone();
                moved[k] += to * STATE_FD_STEPS[k % 5];
                self.jobs.push((w, self.scenes.len(), (effects.clone(), latents)));
                self.scenes.push(apply_initial_state(segment, &moved));
            }
        }
        let unknown = |s: &&Stencil| cached.is_none_or(|f| f.latents.get(s.parameter).is_none());
        for (parameter, end) in
            shared.iter().filter(unknown).flat_map(|s| [(s.parameter, s.low), (s.parameter, s.high)])
        {
            let mut moved = state.values.clone();
            moved[parameter] = end;
            self.jobs.push((w, current, physics(&moved)));
        }
        for e in perturbations {
            let mut effects = effects.clone();
            effects.push(e.effect.term_at_clock(&e.values, segment.start));
            self.jobs.push((w, current, (effects, latents)));
        }
    }

    /// Predicted positions by job.
    fn predict(&self, data: &SegmentData) -> Result<Vec<Vec<f64>>> {
        let rollouts: Vec<Rollout> = self
            .jobs
            .iter()
            .map(|(w, scene, physics)| data.segments[*w].rollout(&self.scenes[*scene], physics))
            .collect();
        Simulator::new(data.engine)
            .budget(&data.progress)
            .map(&rollouts, |i, path| positions_at_observations(&data.segments[self.jobs[i].0], &path))
    }
}

/// Caches the derivatives by nuisances and latents of all engine-simulated segments. `layout`: latents only.
pub fn cache_jacobians(data: &mut SegmentData, layout: &ParameterLayout, state: &FitState) -> Result<()> {
    data.cached_jacobians.clear();
    let mut found = linearise_engine(data, layout, state, &[])?.into_iter();
    let known = |w: &Segment| {
        let moved =
            if w.kind.uses_engine() { found.next().unwrap_or_default() } else { Prediction::default() };
        CachedJacobian { nuisances: moved.by_nuisance, latents: moved.by_parameter }
    };
    data.cached_jacobians = data.segments.iter().map(known).collect();
    Ok(())
}

/// The segment's scene with the initial states that its nuisances define; unchanged without nuisances.
pub fn apply_initial_state(segment: &Segment, nuisances: &[f64]) -> Scene {
    let mut scene = segment.scene.clone();
    for (body, own) in scene.bodies.iter_mut().zip(nuisances.chunks_exact(5)) {
        body.position = Some([own[0], own[1]]);
        body.velocity = [own[2], own[3]];
        body.angular_velocity = own[4];
    }
    scene
}

/// Simulated positions at a segment's observations, two numbers each; NaN if the trajectory diverged.
pub fn positions_at_observations(segment: &Segment, trajectory: &Trajectory) -> Vec<f64> {
    let mut out = Vec::with_capacity(2 * segment.observations.len());
    if trajectory.outcome.end == Termination::Diverged || trajectory.times.is_empty() {
        out.resize(2 * segment.observations.len(), f64::NAN);
        return out;
    }
    let times = &trajectory.times;
    let last = times.len() - 1;
    let mut at = 0;
    for point in &segment.observations {
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
        let between = |x: &[f64], v: &[f64]| interpolate([x[i], x[j]], [v[i], v[j]], span, s);
        out.extend([between(&track.x, &track.vx), between(&track.y, &track.vy)]);
    }
    out
}

/// Position at the fraction `s` between two states: cubic Hermite interpolation; linear across a bounce,
/// where a cubic would overshoot.
fn interpolate(x: [f64; 2], v: [f64; 2], span: f64, s: f64) -> f64 {
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
    use crate::inference::testing::segments::{multi_step_segments, term};
    use crate::world::Engine;
    use crate::world::latent::factor_index;

    /// Interpolation is exact for a cubic and linear across a bounce.
    #[test]
    fn interpolation_is_cubic_or_linear_at_bounces() {
        let (x, v) = (|t: f64| 1.0 + t - 2.0 * t * t + t * t * t, |t: f64| 1.0 - 4.0 * t + 3.0 * t * t);
        let (a, b) = (1.5, 2.0);
        let met = interpolate([x(a), x(b)], [v(a), v(b)], b - a, 0.3);
        assert!((met - x(a + 0.3 * (b - a))).abs() < 1e-12);
        assert_eq!(interpolate([1.0, 2.0], [-5.0, 4.0], 0.1, 0.25), 1.25);
    }

    /// Derivatives by initial states of two balls in free flight equal the exact ones.
    #[test]
    fn multi_step_derivatives_match_free_flight() {
        let (segments, settings) = multi_step_segments();
        let data = SegmentData::new(&segments, &settings, vec![1e-3], Engine::Lanes);
        let state = FitState::new(vec![0.0, 0.0], vec![segments[0].nuisances.clone()]);
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        let moved = &linearise_engine(&data, &layout, &state, &[]).unwrap()[0];
        for (i, p) in segments[0].observations.iter().enumerate() {
            let near =
                |a: f64, b: f64| assert!((a - b).abs() < 1e-3 * (1.0 + p.time), "{a} for {b} at {}", p.time);
            for body in 0..2 {
                let own = f64::from(p.body == body);
                near(moved.by_nuisance[5 * body][2 * i], own);
                near(moved.by_nuisance[5 * body + 3][2 * i + 1], own * p.time);
                near(moved.by_nuisance[5 * body + 3][2 * i], 0.0);
            }
            near(moved.by_parameter[0][2 * i], 0.5 * p.time * p.time);
        }
    }

    /// Cached derivatives are returned unchanged; all others are computed at the new state.
    #[test]
    fn cached_derivatives_are_reused() {
        let (segments, settings) = multi_step_segments();
        let mut data = SegmentData::new(&segments, &settings, vec![1e-3], Engine::Lanes);
        let latents = [factor_index("friction").unwrap()];
        let nuisances = vec![segments[0].nuisances.clone()];
        let base = FitState::new(vec![0.5], nuisances.clone());
        cache_jacobians(&mut data, &ParameterLayout::new(&latents, Vec::new(), 1), &base).unwrap();
        let layout = ParameterLayout::new(&latents, vec![term("wind")], 1);
        let state = FitState::new(vec![0.5, 0.0, 0.0], nuisances);
        let warm = linearise_engine(&data, &layout, &state, &[]).unwrap();
        data.cached_jacobians[0].nuisances[0].fill(7.0);
        let marked = linearise_engine(&data, &layout, &state, &[]).unwrap();
        data.cached_jacobians.clear();
        let cold = linearise_engine(&data, &layout, &state, &[]).unwrap();
        assert!(marked[0].by_nuisance[0].iter().all(|v| *v == 7.0));
        for (a, b) in [(&warm[0], &cold[0]), (&warm[0], &marked[0])] {
            assert_eq!(
                (&a.positions, &a.by_parameter, &a.by_nuisance[1..]),
                (&b.positions, &b.by_parameter, &b.by_nuisance[1..])
            );
        }
    }
}
