//! Segments around collisions of two movable bodies.

use std::ops::Range;

use super::contact_detection::Obstacle;
use super::contact_geometry::{ContactFeature, RoundedCorner};
use super::corner_contact::{TouchingParts, touching_parts};
use super::definition::{CollidingPair, Observation, Segment, SegmentKind};
use super::single_body::{BodyObservations, MAX_IMPACT_DURATION, MIN_OBSERVATIONS_AROUND_BOUNCE};
use crate::inference::data::smoothing::TimedPosition;
use crate::task::Scene;

/// Collisions of the bodies of a trial.
pub fn collision_segments(observed: &[BodyObservations]) -> Vec<Segment> {
    let pairs = (0..observed.len()).flat_map(|i| (i + 1..observed.len()).map(move |j| [i, j]));
    pairs.flat_map(|pair| Pair(pair.map(|k| &observed[k])).segments()).collect()
}

/// Observations of two bodies.
struct Pair<'a>([&'a BodyObservations<'a>; 2]);

impl Pair<'_> {
    fn segments(&self) -> Vec<Segment> {
        let first = self.0[0];
        let touches =
            |i: &usize| first.contacts[*i].is_some_and(|c| c.obstacle == Obstacle::Body(self.0[1].body));
        let mut out = Vec::new();
        let mut i = 0;
        while let Some(from) = (i..first.rows.len()).find(touches) {
            let end = (from..first.rows.len()).find(|k| !touches(k)).unwrap_or(first.rows.len());
            out.extend(self.segment(from..end));
            i = end;
        }
        out
    }

    /// The collision during which the first body's rows `near` are near the second; `None` with too few observations
    /// before or after it, or if it is not known where the outlines touch.
    fn segment(&self, near: Range<usize>) -> Option<Segment> {
        let (first, trial) = (self.0[0], self.0[0].trial);
        let begins = first.rows[near.start].0;
        let lasting = |i: &usize| first.rows[*i].0 - begins < MAX_IMPACT_DURATION;
        let distance = |i: &usize| self.distance(*i);
        let closest = near.clone().take_while(lasting).min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        // Bodies that stay near each other move freely after the collision all the same.
        let last = near.end - 1;
        let ends = first.rows[if lasting(&last) { last } else { closest }].0;
        let sides = [0, 1].map(|k| self.sides(k, begins, ends));
        if sides.iter().flatten().any(|rows| rows.len() < MIN_OBSERVATIONS_AROUND_BOUNCE) {
            return None;
        }
        let start = sides.iter().map(|[before, _]| before[0].0).fold(f64::INFINITY, f64::min);
        let (parts, excess) = match self.discs() {
            Some((features, radii)) => {
                (TouchingParts { features, angle_sd: [0.0; 2] }, self.distance(closest) - radii)
            }
            None => {
                let around = [0, 1].map(|k| self.0[k].around_impact(sides[k]));
                (touching_parts(&around, None, start)?, 0.0)
            }
        };
        let (mut points, mut nuisances, mut spin_prior_sd) = (Vec::new(), Vec::new(), [0.0; 2]);
        for (k, [before, after]) in sides.iter().enumerate() {
            let (mut state, held) = self.0[k].state_with_spin(before);
            let earlier = start - before[0].0;
            (0..2).for_each(|axis| state[axis] += earlier * state[2 + axis]);
            spin_prior_sd[k] = held;
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
        if self.discs().is_none() {
            nuisances.extend([0.0; 2]);
        }
        let scene = Scene {
            bodies: self.0.map(|o| trial.scene.bodies[o.body].clone()).to_vec(),
            statics: Vec::new(),
            goal: None,
            action: None,
            carriers: None,
            settings: Default::default(),
            ..trial.scene.clone()
        };
        let carries_latents = self.0.map(|o| trial.scene.carries_latents(&trial.scene.bodies[o.body].name));
        let size = self.0.iter().filter_map(|o| o.size()).fold(f64::INFINITY, f64::min);
        let pair = CollidingPair {
            bodies: self.0.map(|o| o.body),
            features: parts.features,
            size,
            carries_latents,
            spin_prior_sd,
            angle_prior_sd: parts.angle_sd,
        };
        let segment = Segment::new(SegmentKind::Collision, scene, start, points);
        Some(Segment { nuisances, pair: Some(pair), ..segment })
    }

    /// The outlines of two discs, and the sum of their radii, m; `None` for other bodies.
    fn discs(&self) -> Option<([ContactFeature; 2], f64)> {
        let scene = &self.0[0].trial.scene;
        let [a, b] = [0, 1].map(|k| scene.bodies[self.0[k].body].shape.disc_radius());
        let disc = |radius| ContactFeature::Corner(RoundedCorner { radius, ..RoundedCorner::default() });
        Some(([disc(a?), disc(b?)], a? + b?))
    }

    /// The rows of body `k` before and after a collision that touch nothing, except that a disc may stay near the other one.
    fn sides(&self, k: usize, begins: f64, ends: f64) -> [&[TimedPosition]; 2] {
        let (own, other) = (self.0[k], self.0[1 - k].body);
        let discs = self.discs().is_some();
        let free = |i: &usize| own.contacts[*i].is_none_or(|c| discs && c.obstacle == Obstacle::Body(other));
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
