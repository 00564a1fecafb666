//! Segments of one body: flights, bounces and rolling.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};

use super::contact_detection::{ContactEvent, Obstacle, detect_contacts, observed_angle, rolling_intervals};
use super::contact_geometry::ContactFeature;
use super::corner_contact::{TouchingParts, touching_parts};
use super::definition::{
    MIN_FLIGHT_OBSERVATIONS, Observation, Segment, SegmentKind, Surface, observed_position,
};
use super::free_motion::AroundImpact;
use super::holds::without_holds;
use super::sliding::{Slide, slide};
use crate::error::Result;
use crate::inference::data::noise::third_difference_noise;
use crate::inference::data::smoothing::{TimedPosition, fit_polynomials};
use crate::inference::statistics::{median, slope};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;

/// Number of observations on each side of a bounce, or those within a time, s, if there are more: many pictures a second measure
/// velocities no better unless they span the same time. And the minimum number.
const OBSERVATIONS_AROUND_BOUNCE: usize = 8;
const TIME_AROUND_BOUNCE: f64 = 0.05;
pub const MIN_OBSERVATIONS_AROUND_BOUNCE: usize = 5;
/// Longest gap between observations within a segment, and around a bounce, as multiples of the typical
/// interval.
const MAX_GAP: f64 = 6.0;
const MAX_GAP_AT_BOUNCE: f64 = 3.0;
/// Longest time between the observations before and after an impact of a corner or a collision, s: slow bodies are near each other for
/// that long.
pub const MAX_IMPACT_DURATION: f64 = 0.1;
/// Number of observations from which an initial state is estimated.
const INITIAL_STATE_OBSERVATIONS: usize = 12;
/// Largest deviation of a sliding block's observed angles from their median: rad, and more in units of their noise. A block that
/// rocks is not always supported.
const MAX_TURN: f64 = 2e-3;
const ROCKING: f64 = 1.3;
/// Prior standard deviation of a spin that was not observed and of one that was, rad/s.
const UNOBSERVED_SPIN_SD: f64 = 300.0;
const OBSERVED_SPIN_SD: f64 = 0.5;

/// Observations of one body.
pub struct BodyObservations<'a> {
    pub trial: &'a Trial,
    pub body: usize,
    pub rows: Vec<TimedPosition>,
    /// Detected contact by row.
    pub contacts: Vec<Option<ContactEvent>>,
    /// Typical interval between rows, s.
    pub typical_interval: f64,
}

impl<'a> BodyObservations<'a> {
    /// `None` if the body was observed fewer than three times.
    pub fn of(
        trial: &'a Trial,
        body: usize,
        progress: &dyn Progress,
    ) -> Result<Option<BodyObservations<'a>>> {
        let track = &trial.observed.bodies[body];
        let row = |(i, t): (usize, &f64)| Some((*t, observed_position(track, i)?));
        let rows: Vec<TimedPosition> = trial.observed.times.iter().enumerate().filter_map(row).collect();
        if rows.len() < 3 {
            return Ok(None);
        }
        let contacts = detect_contacts(trial, body, &rows, progress)?;
        let typical_interval = median(&rows.windows(2).map(|w| w[1].0 - w[0].0).collect::<Vec<_>>());
        Ok(Some(BodyObservations { trial, body, rows, contacts, typical_interval }))
    }

    /// Flights, bounces and rolling of the body.
    pub fn segments(&self, progress: &dyn Progress) -> Result<Vec<Segment>> {
        let [gx, gy] = self.trial.scene.gravity;
        let of = |piece: (usize, usize)| without_holds(&self.rows, piece, gx.hypot(gy));
        let pieces: Vec<(usize, usize)> = self.flight_intervals().into_iter().map(of).collect();
        let flights = pieces.iter().filter(|(a, b)| b - a >= MIN_FLIGHT_OBSERVATIONS);
        let flights = flights.map(|piece| self.flight(*piece, progress));
        let contacts = pieces.windows(2).filter_map(|pair| self.contact(pair[0], pair[1])).map(Ok);
        let rolls = rolling_intervals(&self.contacts, &self.rows);
        let landings = pieces.iter().filter_map(|piece| self.landing(*piece, &rolls));
        flights
            .chain(contacts)
            .chain(landings.collect::<Vec<_>>().into_iter().map(Ok))
            .chain(rolls.into_iter().filter_map(|roll| self.rolling(roll, progress).transpose()))
            .collect()
    }

    /// Number of observations on each side of an impact.
    pub fn count_around_impact(&self) -> usize {
        let within = (TIME_AROUND_BOUNCE / self.typical_interval) as usize;
        OBSERVATIONS_AROUND_BOUNCE.max(within.min(self.rows.len()))
    }

    /// Intervals of flight (first row, end): rows without contact and without long gaps.
    fn flight_intervals(&self) -> Vec<(usize, usize)> {
        let (rows, mut pieces, mut first) = (&self.rows, Vec::new(), None);
        for i in 0..=rows.len() {
            let touches = self.contacts.get(i).is_none_or(Option::is_some);
            let broken = touches || (i > 0 && rows[i].0 - rows[i - 1].0 > MAX_GAP * self.typical_interval);
            if broken && let Some(from) = first.take() {
                pieces.push((from, i));
            }
            if !touches && first.is_none() {
                first = Some(i);
            }
        }
        pieces
    }

    fn flight(&self, (from, to): (usize, usize), progress: &dyn Progress) -> Result<Segment> {
        let rows = &self.rows[from..to];
        let scene = Scene { statics: Vec::new(), carriers: None, ..self.single_body_scene() };
        let mut segment = with_smooth(rows, self.segment(rows, scene, SegmentKind::Flight), progress)?;
        segment.nuisances =
            initial_state(&rows[..rows.len().min(INITIAL_STATE_OBSERVATIONS)], segment.scene.gravity)
                .to_vec();
        Ok(segment)
    }

    /// Contact segment between two flight intervals; `None` unless a disc or a corner bounces once on a static.
    fn contact(&self, (a, b): (usize, usize), (c, d): (usize, usize)) -> Option<Segment> {
        let rows = &self.rows;
        let contact = (b..c).find_map(|i| self.contacts[i])?;
        let between = rows[c].0 - rows[b - 1].0;
        // A corner is near the surface for longer than a disc.
        let single = match self.is_round() {
            true => c == b + 1 && between < MAX_GAP_AT_BOUNCE * self.typical_interval,
            false => between < MAX_IMPACT_DURATION,
        };
        if !single {
            return None;
        }
        self.impact(SegmentKind::Contact, contact, [&rows[a..b], &rows[c..d]])
    }

    /// The impact at the end of a flight interval after which a surface supports a disc.
    fn landing(&self, (a, b): (usize, usize), rolls: &[(usize, usize, ContactEvent)]) -> Option<Segment> {
        let follows = |roll: &&(usize, usize, ContactEvent)| {
            roll.0 >= b
                && (b..roll.0).all(|i| self.contacts[i].is_some_and(|c| c.obstacle == roll.2.obstacle))
        };
        let (_, end, contact) = rolls.iter().find(follows)?;
        self.impact(SegmentKind::Landing, *contact, [&self.rows[a..b], &self.rows[b..*end]])
    }

    /// The impact of a disc or a corner on a static between the last rows before it and the first after it; `None` with too few
    /// rows.
    fn impact(
        &self,
        kind: SegmentKind,
        contact: ContactEvent,
        [before, after]: [&[TimedPosition]; 2],
    ) -> Option<Segment> {
        if before.len().min(after.len()) < MIN_OBSERVATIONS_AROUND_BOUNCE {
            return None;
        }
        let count = self.count_around_impact();
        let before = &before[before.len().saturating_sub(count)..];
        let after = &after[..after.len().min(count)];
        let surface = match (self.is_round(), kind) {
            (true, _) => self.surface(contact)?,
            (false, SegmentKind::Contact) => self.corner_surface(contact, [before, after])?,
            (false, _) => return None,
        };
        let mut segment = self.segment(&[before, after].concat(), self.single_body_scene(), kind);
        let (state, held) = self.state_with_spin(before);
        segment.nuisances = [&state[..], &[0.0]].concat();
        segment.nuisances.extend(surface.corner.map(|_| 0.0));
        segment.surface = Some(Surface { spin_prior_sd: held, ..surface });
        Some(segment)
    }

    /// Position, velocity and spin at the first of some rows, and the prior standard deviation of the spin, rad/s.
    pub fn state_with_spin(&self, rows: &[TimedPosition]) -> ([f64; 5], f64) {
        let spin = self.observed_spin(rows);
        let [x, y, vx, vy] = initial_state(rows, self.trial.scene.gravity);
        let held = if spin.is_some() { OBSERVED_SPIN_SD } else { UNOBSERVED_SPIN_SD };
        ([x, y, vx, vy, spin.unwrap_or(0.0)], held)
    }

    fn rolling(
        &self,
        (from, to, contact): (usize, usize, ContactEvent),
        progress: &dyn Progress,
    ) -> Result<Option<Segment>> {
        let rows = &self.rows[from..to];
        let Some(surface) = self.surface(contact) else { return Ok(None) };
        // A block that has landed hops and rocks.
        let landed = self.contacts[..from].iter().any(Option::is_none);
        if surface.inertia.is_infinite() && (landed || !self.keeps_angle(rows)) {
            return Ok(None);
        }
        let slide = slide(rows, &surface, &self.trial.scene);
        let kind = if slide.is_some() { SegmentKind::Sliding } else { SegmentKind::Rolling };
        let mut segment = with_smooth(rows, self.segment(rows, self.single_body_scene(), kind), progress)?;
        let [_, _, vx, vy] = initial_state(&rows[..rows.len().min(INITIAL_STATE_OBSERVATIONS)], [0.0; 2]);
        segment.nuisances = vec![0.0, vx * contact.normal[1] - vy * contact.normal[0], 0.0, 0.0];
        if let Some(Slide { speed, slip }) = slide {
            segment.nuisances[1] = speed;
            if surface.inertia.is_finite() {
                segment.nuisances.push((slip - speed) / surface.radius);
            }
        }
        segment.surface = Some(surface);
        Ok(Some(segment))
    }

    /// The trial's scene with this body alone.
    fn single_body_scene(&self) -> Scene {
        let scene = &self.trial.scene;
        Scene {
            bodies: vec![scene.bodies[self.body].clone()],
            goal: None,
            action: None,
            settings: Default::default(),
            observe_every: 1,
            ..scene.clone()
        }
    }

    fn segment(&self, rows: &[TimedPosition], mut scene: Scene, kind: SegmentKind) -> Segment {
        let start = rows[0].0;
        let point = |(t, seen): &TimedPosition| Observation {
            body: 0,
            time: t - start,
            position: *seen,
            weight: 1.0,
        };
        let points: Vec<Observation> = rows.iter().map(point).collect();
        scene.steps = step_count(rows[rows.len() - 1].0 - start, scene.time_step);
        Segment::new(kind, scene, start, points)
    }

    /// The surface of a contact; `None` if the contact is not with a static. A body that is no disc cannot turn.
    fn surface(&self, contact: ContactEvent) -> Option<Surface> {
        let scene = &self.trial.scene;
        let Obstacle::Static(fixed) = contact.obstacle else { return None };
        let (own, other) = (&scene.bodies[self.body], &scene.statics[fixed]);
        let radius = match own.shape.disc_radius() {
            Some(radius) => radius,
            None => self.size()?,
        };
        let inertia = match own.shape.disc_radius() {
            Some(_) => {
                let (mass, inertia) = own.mass_properties(None);
                inertia / (mass * radius * radius)
            }
            None => f64::INFINITY,
        };
        Some(Surface {
            static_index: fixed,
            normal: contact.normal,
            level: contact.level,
            friction: [own.friction, other.friction],
            restitution: [own.restitution, other.restitution],
            carries_latents: [scene.carries_latents(&own.name), scene.carries_latents(&other.name)],
            radius,
            inertia,
            corner: None,
            angle_prior_sd: 0.0,
            spin_prior_sd: UNOBSERVED_SPIN_SD,
        })
    }

    /// The surface that a corner bounces off between some rows; `None` if it is not known which corner.
    fn corner_surface(&self, contact: ContactEvent, rows: [&[TimedPosition]; 2]) -> Option<Surface> {
        let own = self.surface(contact)?;
        let fixed = self.trial.scene.statics[own.static_index].placed();
        let around = self.around_impact(rows);
        let TouchingParts { features, angle_sd } =
            touching_parts(&[around], Some(&fixed), rows[0].first()?.0)?;
        let [ContactFeature::Corner(corner), ContactFeature::Side { normal, distance }] = features else {
            return None;
        };
        let (mass, inertia) = self.trial.scene.bodies[self.body].mass_properties(None);
        Some(Surface {
            normal: normal.at_start,
            level: distance + corner.radius,
            inertia: inertia / (mass * own.radius * own.radius),
            corner: Some(corner),
            angle_prior_sd: angle_sd[0],
            ..own
        })
    }

    /// Observations around an impact: rows before and after it.
    pub fn around_impact<'b>(&'b self, rows: [&'b [TimedPosition]; 2]) -> AroundImpact<'b> {
        let last = rows[0].last().map_or(f64::NEG_INFINITY, |r| r.0);
        let first = rows[1].first().map_or(f64::INFINITY, |r| r.0);
        let from = self.rows.partition_point(|r| r.0 <= last);
        let to = self.rows.partition_point(|r| r.0 < first).max(from);
        AroundImpact {
            body: &self.trial.scene.bodies[self.body],
            gravity: self.trial.scene.gravity,
            typical_interval: self.typical_interval,
            rows,
            between: &self.rows[from..to],
            angles: self.angles(&rows.concat()),
        }
    }

    /// Half the body's size, m.
    pub fn size(&self) -> Option<f64> {
        Some(self.trial.scene.bodies[self.body].shape.pieces()?.half_size())
    }

    /// Whether the body is a disc.
    pub fn is_round(&self) -> bool {
        self.trial.scene.bodies[self.body].shape.disc_radius().is_some()
    }

    /// Whether the observed angles, if any, vary by no more than their noise.
    fn keeps_angle(&self, rows: &[TimedPosition]) -> bool {
        let angles: Vec<f64> = self.angles(rows).into_iter().map(|(_, angle)| angle).collect();
        let (usual, count) = (median(&angles), angles.len().max(1) as f64);
        let spread = (angles.iter().map(|a| (a - usual).powi(2)).sum::<f64>() / count).sqrt();
        let noise = third_difference_noise(&[angles]).unwrap_or(0.0);
        spread < MAX_TURN + ROCKING * noise
    }

    /// Spin from observed angles, rad/s; `None` with fewer than four.
    fn observed_spin(&self, rows: &[TimedPosition]) -> Option<f64> {
        let seen = self.angles(rows);
        if seen.len() < 4 { None } else { slope(&seen) }
    }

    /// Observed angles with their times, without jumps by whole turns.
    fn angles(&self, rows: &[TimedPosition]) -> Vec<(f64, f64)> {
        let mut last = None;
        let unwrapped = |(t, _): &TimedPosition| {
            let angle = observed_angle(self.trial, self.body, *t)?;
            let turns = last.map_or(0.0, |last: f64| ((last - angle) / TAU).round());
            last = Some(angle + turns * TAU);
            Some((*t, angle + turns * TAU))
        };
        rows.iter().filter_map(unwrapped).collect()
    }
}

/// Adds the polynomial fit; outliers get weight 0.
fn with_smooth(rows: &[TimedPosition], mut segment: Segment, progress: &dyn Progress) -> Result<Segment> {
    let smooth = fit_polynomials(rows, progress)?;
    for (point, used) in segment.observations.iter_mut().zip(&smooth.is_inlier) {
        point.weight = if *used { 1.0 } else { 0.0 };
    }
    segment.smooth = Some(smooth);
    Ok(segment)
}

/// Number of steps that cover a duration and 5 % more, since a sensor's clock may be fast.
fn step_count(time: f64, step: f64) -> u32 {
    (1.05 * time / step + 1e-9).ceil().max(1.0) as u32 + 1
}

impl Segment {
    /// Initial state of a flight from its first observations, independent of the forces: position and
    /// velocity by least squares on parabolas; `None` for other segments.
    pub fn parabola_initial_state(&self) -> Option<Vec<f64>> {
        let points: Vec<&Observation> =
            self.observations.iter().filter(|p| p.weight > 0.0).take(INITIAL_STATE_OBSERVATIONS).collect();
        if self.kind != SegmentKind::Flight || points.len() < 4 {
            return None;
        }
        let basis = DMatrix::from_fn(points.len(), 3, |i, k| points[i].time.powi(k as i32));
        let fit = |axis: usize| {
            let seen = DVector::from_fn(points.len(), |i, _| points[i].position[axis]);
            basis.clone().svd(true, true).solve(&seen, 1e-12).ok()
        };
        let (x, y) = (fit(0)?, fit(1)?);
        Some(vec![x[0], y[0], x[1], y[1]])
    }
}

/// Initial position and velocity: least squares on a parabola with the scene's gravity.
fn initial_state(rows: &[TimedPosition], gravity: [f64; 2]) -> [f64; 4] {
    let n = rows.len() as f64;
    let t0 = rows[0].0;
    let mean_t = rows.iter().map(|r| r.0 - t0).sum::<f64>() / n;
    let mut out = [0.0; 4];
    for axis in 0..2 {
        let fallen = |t: f64| 0.5 * gravity[axis] * t * t;
        let straight: Vec<(f64, f64)> =
            rows.iter().map(|(t, p)| (t - t0, p[axis] - fallen(t - t0))).collect();
        let mean = straight.iter().map(|r| r.1).sum::<f64>() / n;
        let speed = slope(&straight).unwrap_or(0.0);
        (out[axis], out[2 + axis]) = (mean - speed * mean_t, speed);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The initial state of a parabola is recovered exactly from uneven times.
    #[test]
    fn initial_state_of_a_parabola_is_exact() {
        let at = |t: f64| (5.0 + t, [1.0 + 3.0 * t, 2.0 + 4.0 * t - 4.905 * t * t]);
        let rows = [0.0, 0.1, 0.15, 0.4].map(at);
        let found = initial_state(&rows, [0.0, -9.81]);
        assert!(found.iter().zip([1.0, 2.0, 3.0, 4.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }

    fn intervals(trial: &Trial, times: &[f64], touched: &[usize]) -> Vec<(usize, usize)> {
        let rows: Vec<TimedPosition> = times.iter().map(|t| (*t, [0.0; 2])).collect();
        let contact = |i| {
            touched.contains(&i).then_some(ContactEvent {
                normal: [0.0, 1.0],
                level: 0.0,
                obstacle: Obstacle::Body(1),
            })
        };
        let touches = (0..times.len()).map(contact).collect();
        BodyObservations { trial, body: 0, rows, contacts: touches, typical_interval: 1.0 }.flight_intervals()
    }

    #[test]
    fn contacts_and_gaps_end_flights() {
        let (scene, observed) = (Scene::empty(), Default::default());
        let trial = Trial { name: String::new(), setting: None, scene, observed };
        let times = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        assert_eq!(intervals(&trial, &times, &[]), [(0, 6)]);
        assert_eq!(intervals(&trial, &times, &[0, 3]), [(1, 3), (4, 6)]);
        assert_eq!(
            intervals(&trial, &[0.0, 1.0, 6.5, 13.0, 14.0], &[]),
            [(0, 3), (3, 5)],
            "longer than six times the usual"
        );
    }
}
