//! Segments around collisions of two movable discs.

use std::ops::Range;

use super::contact_detection::Obstacle;
use super::definition::{CollidingPair, Observation, Segment, SegmentKind};
use super::single_body::{BodyObservations, MIN_OBSERVATIONS_AROUND_BOUNCE};
use crate::inference::data::smoothing::TimedPosition;
use crate::task::Scene;

/// Longest time between the observations before and after a collision, s: slow discs are near each other for that long.
const MAX_DURATION: f64 = 0.1;

/// Collisions of the bodies of a trial.
pub fn collision_segments(observed: &[BodyObservations]) -> Vec<Segment> {
    let pairs = (0..observed.len()).flat_map(|i| (i + 1..observed.len()).map(move |j| [i, j]));
    pairs.flat_map(|pair| Pair(pair.map(|k| &observed[k])).segments()).collect()
}

/// Observations of two bodies.
struct Pair<'a>([&'a BodyObservations<'a>; 2]);

impl Pair<'_> {
    fn segments(&self) -> Vec<Segment> {
        let Some(pair) = self.colliding_pair() else { return Vec::new() };
        let first = self.0[0];
        let touches =
            |i: &usize| first.contacts[*i].is_some_and(|c| c.obstacle == Obstacle::Body(self.0[1].body));
        let mut out = Vec::new();
        let mut i = 0;
        while let Some(from) = (i..first.rows.len()).find(touches) {
            let end = (from..first.rows.len()).find(|k| !touches(k)).unwrap_or(first.rows.len());
            out.extend(self.segment(from..end, pair));
            i = end;
        }
        out
    }

    /// `None` unless both are discs.
    fn colliding_pair(&self) -> Option<CollidingPair> {
        let scene = &self.0[0].trial.scene;
        let body = |k: usize| &scene.bodies[self.0[k].body];
        Some(CollidingPair {
            bodies: self.0.map(|o| o.body),
            radii: [body(0).shape.disc_radius()?, body(1).shape.disc_radius()?],
            carries_latents: [0, 1].map(|k| scene.carries_latents(&body(k).name)),
            spin_prior_sd: [0.0; 2],
        })
    }

    /// The collision during which the first body's rows `near` are near the second; `None` with too few observations
    /// before or after it.
    fn segment(&self, near: Range<usize>, mut pair: CollidingPair) -> Option<Segment> {
        let (first, trial) = (self.0[0], self.0[0].trial);
        let begins = first.rows[near.start].0;
        let lasting = |i: &usize| first.rows[*i].0 - begins < MAX_DURATION;
        let gap = |i: &usize| self.distance(*i) - pair.radii[0] - pair.radii[1];
        let closest = near.clone().take_while(lasting).min_by(|a, b| gap(a).total_cmp(&gap(b)))?;
        let excess = gap(&closest);
        // Bodies that stay near each other move freely after the collision all the same.
        let last = near.end - 1;
        let ends = first.rows[if lasting(&last) { last } else { closest }].0;
        let sides = [0, 1].map(|k| self.sides(k, begins, ends));
        if sides.iter().flatten().any(|rows| rows.len() < MIN_OBSERVATIONS_AROUND_BOUNCE) {
            return None;
        }
        let start = sides.iter().map(|[before, _]| before[0].0).fold(f64::INFINITY, f64::min);
        let (mut points, mut nuisances) = (Vec::new(), Vec::new());
        for (k, [before, after]) in sides.iter().enumerate() {
            let (mut state, held) = self.0[k].state_with_spin(before);
            let earlier = start - before[0].0;
            (0..2).for_each(|axis| state[axis] += earlier * state[2 + axis]);
            pair.spin_prior_sd[k] = held;
            nuisances.extend(state);
            let point = |(t, position): &TimedPosition| Observation {
                body: k,
                time: t - start,
                position: *position,
                weight: 1.0,
            };
            points.extend(before.iter().chain(*after).map(point));
        }
        nuisances.push(excess);
        let scene = Scene {
            bodies: self.0.map(|o| trial.scene.bodies[o.body].clone()).to_vec(),
            statics: Vec::new(),
            goal: None,
            action: None,
            carriers: None,
            settings: Default::default(),
            ..trial.scene.clone()
        };
        let segment = Segment::new(SegmentKind::Collision, scene, start, points);
        Some(Segment { nuisances, pair: Some(pair), ..segment })
    }

    /// The rows of body `k` before and after a collision that touch nothing but the other body.
    fn sides(&self, k: usize, begins: f64, ends: f64) -> [&[TimedPosition]; 2] {
        let (own, other) = (self.0[k], self.0[1 - k].body);
        let free = |i: &usize| own.contacts[*i].is_none_or(|c| c.obstacle == Obstacle::Body(other));
        let count = own.count_around_impact();
        let (until, from) =
            (own.rows.partition_point(|r| r.0 < begins), own.rows.partition_point(|r| r.0 <= ends));
        let before = (0..until).rev().take(count).take_while(free).count();
        let after = (from..own.rows.len()).take(count).take_while(free).count();
        [&own.rows[until - before..until], &own.rows[from..from + after]]
    }

    /// Distance of the centres at a row of the first body, m; infinite where the second was not observed.
    fn distance(&self, i: usize) -> f64 {
        let [first, second] = self.0;
        let (time, p) = first.rows[i];
        let q = second.rows.iter().find(|r| r.0 == time).map(|r| r.1);
        q.map_or(f64::INFINITY, |q| (p[0] - q[0]).hypot(p[1] - q[1]))
    }
}
