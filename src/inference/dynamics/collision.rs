//! Two bodies that collide: each flies as without the other until they touch, and again from there with the velocities after
//! the impact.

use std::array::from_fn;

use super::integrator::{
    BatchedIntegrator, DenseTrajectory, InitialCondition, LaneValues, SmoothArc, find_root,
};
use super::physics::{Impact, MAX_STEPS, SegmentPhysics};
use super::supported::PlanarState;
use crate::inference::segment::{BODY_NUISANCES, CollidingPair, contact_gap};
use crate::world::effect::LANES;

/// Largest relative displacement in a step, in units of the smaller body's size, so that no glancing collision is stepped over.
const MAX_DISPLACEMENT: f64 = 0.2;
const MAX_STEP_COUNT: f64 = 1000.0;

/// As [`integrator::integrate`](super::integrator::integrate), for collision segments.
pub fn integrate(
    paths: &[InitialCondition],
    visit: &mut dyn FnMut(usize, usize, PlanarState),
) -> Vec<Option<Impact>> {
    let Some((lead, start)) = paths.first() else { return Vec::new() };
    let Some(pair) = lead.segment.pair else { return vec![None; paths.len()] };
    let mut counts = [None; 2];
    let step = longest_step(lead, start, &pair);
    let mut impacts = Vec::with_capacity(paths.len());
    for (first, group) in paths.chunks(LANES).enumerate().map(|(g, group)| (g * LANES, group)) {
        let (bodies, met) = trajectories(group, &pair, step, &mut counts);
        for (lane, (physics, _)) in group.iter().enumerate() {
            let mut places = [[0; 2]; 2];
            for (i, point) in physics.segment.observations.iter().enumerate() {
                let time = physics.true_time(point.time);
                visit(first + lane, i, bodies[point.body].at(lane, time, &mut places[point.body]));
            }
        }
        impacts.extend(met.into_iter().take(group.len()));
    }
    impacts
}

/// Trajectories of both bodies with their impacts by lane. `counts`: numbers of steps before and after the impact, set by the
/// first group.
fn trajectories(
    group: &[InitialCondition],
    pair: &CollidingPair,
    step: f64,
    counts: &mut [Option<usize>; 2],
) -> ([DenseTrajectory; 2], [Option<Impact>; LANES]) {
    let solver = BatchedIntegrator::of(group, step);
    let points = &solver.paths[0].0.segment.observations;
    let [from, until] = [f64::min, f64::max]
        .map(|of| solver.true_times(points.iter().map(|p| p.time).reduce(of).unwrap_or(0.0)));
    let start: [[PlanarState; LANES]; 2] = from_fn(|k| from_fn(|lane| body_state(solver.paths[lane].1, k)));
    let arc = |from: &LaneValues, start: &[PlanarState; LANES], count: usize| {
        solver.integrate_arc(uniform_times(from, &until, count), start, |_| true)
    };
    let count = |from: f64, until: f64| ((until - from) / step).ceil().clamp(1.0, MAX_STEP_COUNT) as usize;
    let before_count = *counts[0].get_or_insert_with(|| count(from[0], until[0]));
    let before = [0, 1].map(|k| arc(&from, &start[k], before_count));
    let events: [Option<(f64, [PlanarState; 2], Impact)>; LANES] = from_fn(|lane| {
        let (physics, nuisances) = solver.paths[lane];
        let excess = nuisances.get(2 * BODY_NUISANCES).copied().unwrap_or(0.0);
        let pair = &pair.with_angles(nuisances);
        let (time, met) = first_touch(&before, lane, physics, pair, excess)?;
        let (after, impact) = physics.resolve_collision(time, met, pair);
        Some((time, after, impact))
    });
    let impact_times: LaneValues = from_fn(|lane| events[lane].map_or(f64::INFINITY, |e| e.0));
    let restart: LaneValues = from_fn(|lane| events[lane].map_or(from[lane], |e| e.0));
    let after = [0, 1].map(|k| {
        if events.iter().all(Option::is_none) {
            return SmoothArc::default();
        }
        let state: [PlanarState; LANES] = from_fn(|lane| events[lane].map_or(start[k][lane], |e| e.1[k]));
        let count = *counts[1].get_or_insert_with(|| count(restart[0], until[0]));
        arc(&restart, &state, count)
    });
    let [a, b] = before;
    let [c, d] = after;
    let discs = [[a, c], [b, d]].map(|arcs| DenseTrajectory { arcs, impact_times });
    (discs, events.map(|e| e.map(|e| e.2)))
}

/// Time at which two bodies first touch, with their states; `None` if they never do, or begin nearer. `excess`: of their
/// distance at contact over that of their outlines, m.
fn first_touch(
    arcs: &[SmoothArc; 2],
    lane: usize,
    physics: &SegmentPhysics,
    pair: &CollidingPair,
    excess: f64,
) -> Option<(f64, [PlanarState; 2])> {
    let states = |k: usize, share: f64| [0, 1].map(|body| arcs[body].state(k, lane, share));
    let met = |time: f64, [a, b]: &[PlanarState; 2]| {
        contact_gap(&pair.features, physics.observed_time(time), [[a[0], a[1]], [b[0], b[1]]], excess)
    };
    let rates = pair.features.map(|f| f.rate());
    let mut apart = met(arcs[0].times[0][lane], &states(0, 0.0)).gap > 0.0;
    for k in 0..arcs[0].times.len() - 1 {
        let [now, h] = arcs[0].step(k, lane);
        let touching = met(now + h, &states(k, 1.0)).gap < 0.0;
        if apart && touching {
            let share = find_root(|share| {
                let at = states(k, share);
                let contact = met(now + h * share, &at);
                let [a, b] = at;
                // The outlines turn as observed, whatever the spins.
                let [p, q] = contact.arms;
                let v = [
                    a[2] - b[2] - rates[0] * p[1] + rates[1] * q[1],
                    a[3] - b[3] + rates[0] * p[0] - rates[1] * q[0],
                ];
                [contact.gap, h * (contact.normal[0] * v[0] + contact.normal[1] * v[1])]
            });
            return Some((now + h * share, states(k, share)));
        }
        apart = !touching;
    }
    None
}

/// Longest step, s: by the laws of motion, and short against the passage of the bodies.
fn longest_step(physics: &SegmentPhysics, nuisances: &[f64], pair: &CollidingPair) -> f64 {
    let [a, b] = [0, 1].map(|k| body_state(nuisances, k));
    let turning = pair.features.map(|f| f.rate().abs() * pair.size);
    let speed = (a[2] - b[2]).hypot(a[3] - b[3]) + turning[0] + turning[1];
    let passage = MAX_DISPLACEMENT * pair.size / speed;
    let own = physics.max_step_from(&a).min(physics.max_step_from(&b)).min(MAX_STEPS[1]);
    if passage.is_finite() { own.min(passage) } else { own }
}

/// Initial state of a body from the nuisances of a collision.
fn body_state(nuisances: &[f64], body: usize) -> PlanarState {
    let own = nuisances.get(BODY_NUISANCES * body..BODY_NUISANCES * (body + 1));
    own.and_then(|own| own.try_into().ok()).unwrap_or([f64::NAN; 5])
}

/// Ends of equal steps by lane.
fn uniform_times(from: &LaneValues, until: &LaneValues, count: usize) -> Vec<LaneValues> {
    let at = |k: usize| from_fn(|lane| from[lane] + (until[lane] - from[lane]) * (k as f64 / count as f64));
    (0..=count).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::segment::{
        ContactFeature, Observation, RoundedCorner, Segment, SegmentKind, TurningVector,
    };
    use crate::task::Scene;
    use crate::world::Latents;
    use crate::world::effect::find;

    /// Two discs of 1 and 2 kg and radius 0.1 m; the first comes from the left.
    fn segment(friction: f64, restitution: f64) -> Segment {
        let scene = Scene::from_json(&format!(
            r#"{{"format": "iplw.scene/1", "gravity": [0, 0], "time_step": 0.005, "bodies": [
                {{"name": "a", "shape": {{"type": "disc", "radius": 0.1}}, "mass": 1, "friction": {friction}, "restitution": {restitution}}},
                {{"name": "b", "shape": {{"type": "disc", "radius": 0.1}}, "mass": 2, "friction": 1, "restitution": 1}}]}}"#
        ));
        let times = (0..41).map(|i| 0.01 * f64::from(i));
        let of = |body: usize| {
            let point = move |time| Observation { body, time, position: [0.0; 2], weight: 1.0 };
            times.clone().map(point).collect::<Vec<_>>()
        };
        let pair = CollidingPair {
            bodies: [0, 1],
            features: [ContactFeature::Corner(RoundedCorner { radius: 0.1, ..RoundedCorner::default() }); 2],
            size: 0.1,
            carries_latents: [true; 2],
            spin_prior_sd: [1.0; 2],
            angle_prior_sd: [0.0; 2],
        };
        let own = Segment::new(SegmentKind::Collision, scene.unwrap(), 0.0, [of(0), of(1)].concat());
        Segment { pair: Some(pair), ..own }
    }

    /// States at the last observation of each disc, and the impact.
    fn collided(physics: &SegmentPhysics, nuisances: &[f64]) -> ([PlanarState; 2], Option<Impact>) {
        let mut states = [[f64::NAN; 5]; 2];
        let points = &physics.segment.observations;
        let impacts = integrate(&[(physics, nuisances)], &mut |_, i, s| states[points[i].body] = s);
        (states, impacts[0])
    }

    /// Off-centre with friction: momentum, angular momentum and Newton's law of restitution hold.
    #[test]
    fn collisions_conserve_momentum() {
        let segment = segment(0.3, 0.7);
        let physics = SegmentPhysics::new(&segment, &[], &Latents::default());
        let start = [-0.4, 0.05, 2.0, 0.1, 3.0, 0.0, 0.0, -0.2, 0.3, -5.0, 0.0];
        let ([a, b], impact) = collided(&physics, &start);
        let impact = impact.expect("they collide");
        let before = [start[2] + 2.0 * start[7], start[3] + 2.0 * start[8]];
        assert!((a[2] + 2.0 * b[2] - before[0]).abs() < 1e-9 && (a[3] + 2.0 * b[3] - before[1]).abs() < 1e-9);
        let spin = |m: f64, s: &[f64]| m * (s[0] * s[3] - s[1] * s[2]) + m * 0.005 * s[4];
        let (whole, then) =
            (spin(1.0, &start[..5]) + spin(2.0, &start[5..10]), spin(1.0, &a) + spin(2.0, &b));
        assert!((whole - then).abs() < 1e-9, "{whole} {then}");
        let n = impact.direction;
        let leaves = (a[2] - b[2]) * n[0] + (a[3] - b[3]) * n[1];
        assert!((leaves - 0.7 * impact.approach).abs() < 1e-9, "{leaves} {}", impact.approach);
        assert!(
            impact.tangent.abs() > 0.01 && impact.tangent.abs() <= 0.3 * impact.normal + 1e-12,
            "{impact:?}"
        );
    }

    /// The time of the collision is exact, and depends on the excess of the distance.
    #[test]
    fn collisions_happen_at_contact() {
        let segment = segment(0.0, 1.0);
        let physics = SegmentPhysics::new(&segment, &[], &Latents::default());
        for excess in [0.0, 0.02] {
            let start = [-0.5, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, excess];
            let (_, impact) = collided(&physics, &start);
            assert!((impact.unwrap().time - (0.3 - excess) / 2.0).abs() < 1e-9);
        }
        let apart = [-0.5, 0.3, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert!(collided(&physics, &apart).1.is_none(), "they miss each other");
    }

    /// With the first three times as heavy, two discs share momentum as 3 and 2 kg do.
    #[test]
    fn mass_ratios_act_in_collisions() {
        let segment = segment(0.0, 1.0);
        let effect = find("mass_ratio").unwrap();
        let physics = SegmentPhysics::new(&segment, &[(effect, &[3.0])], &Latents::default());
        let ([a, b], _) = collided(&physics, &[-0.5, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!((a[2] - 0.4).abs() < 1e-9 && (b[2] - 2.4).abs() < 1e-9, "{a:?} {b:?}");
    }

    /// A corner hits a side off the centres of both bodies: momentum, angular momentum, and at the contact point Newton's and
    /// Coulomb's laws hold; a rough corner sticks.
    #[test]
    fn corners_collide_by_the_laws_of_contact() {
        for friction in [0.1, 3.0] {
            let mut segment = segment(friction, 0.6);
            let vector = |at_start| TurningVector { at_start, rate: 0.0 };
            let pair = segment.pair.as_mut().expect("two bodies");
            pair.features = [
                ContactFeature::Corner(RoundedCorner { place: vector([0.08, 0.05]), radius: 0.0 }),
                ContactFeature::Side { normal: vector([-0.8, -0.6]), distance: 0.1 },
            ];
            let pair = *pair;
            let physics = SegmentPhysics::new(&segment, &[], &Latents::default());
            let start = [-0.4, 0.03, 2.0, 0.4, 3.0, 0.0, 0.0, -0.2, 0.3, -5.0, 0.0];
            let ([a, b], impact) = collided(&physics, &start);
            let impact = impact.expect("they collide");
            assert!((a[2] + 2.0 * b[2] - 1.6).abs() < 1e-9 && (a[3] + 2.0 * b[3] - 1.0).abs() < 1e-9);
            let spin = |m: f64, s: &[f64]| m * (s[0] * s[3] - s[1] * s[2]) + m * 0.005 * s[4];
            let whole = [&start[..5], &a].map(|s| spin(1.0, s));
            let other = [&start[5..10], &b].map(|s| spin(2.0, s));
            assert!((whole[0] + other[0] - whole[1] - other[1]).abs() < 1e-9, "{whole:?} {other:?}");
            // Both move freely: from the impact to the last observation.
            let moved = 0.4 - impact.time;
            let at = [&a, &b].map(|s| [s[0] - moved * s[2], s[1] - moved * s[3]]);
            let met = contact_gap(&pair.features, 0.0, at, 0.0);
            assert!(met.gap.abs() < 1e-9, "{met:?}");
            let [p, q] = met.arms;
            let v = [a[2] - b[2] - a[4] * p[1] + b[4] * q[1], a[3] - b[3] + a[4] * p[0] - b[4] * q[0]];
            let n = impact.direction;
            let [away, slip] = [v[0] * n[0] + v[1] * n[1], v[1] * n[0] - v[0] * n[1]];
            assert!((away - 0.6 * impact.approach).abs() < 1e-9, "{away} {impact:?}");
            if friction < 1.0 {
                assert!((impact.tangent.abs() - friction * impact.normal).abs() < 1e-9, "{impact:?}");
                assert!(slip * impact.tangent < 0.0, "friction opposes the slip: {slip} {impact:?}");
            } else {
                assert!(slip.abs() < 1e-9, "it sticks: {slip}");
            }
        }
    }
}
