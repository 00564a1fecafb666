//! Paths of one window that start nearly alike, integrated together in lanes: a fit asks for a dozen of them at a time, each with
//! one number moved a little.
//!
//! The classical Runge-Kutta method of fourth order; what lies between the ends of a step is the polynomial of fifth degree with
//! their places, velocities and accelerations. Where nothing has an edge steps go by themselves, elsewhere they end where
//! observations are. A surface is met where the polynomial crosses it, and the path goes on from there. All paths take as many
//! steps as the first: differences between them are then those of one smooth map.

use std::array::from_fn;

use super::physics::{INSTANT, Impact, Physics};
use super::roll::Body;

use crate::discover::window::{Kind, Surface};
use crate::world::effect::{
    Effect, EffectKind, LANES, MAX_PARAMETERS, MotionLaw, MotionStateLanes, SimulationContext,
};

/// Most steps in which the time of meeting a surface is refined: halving alone tells it to a picosecond.
const REFINED: usize = 40;

type Lanes = [f64; LANES];
/// x, y, vx, vy, omega by lane.
type Bodies = [Lanes; 5];

/// What acts, and from where it starts.
pub type Start<'a, 'b> = (&'b Physics<'a>, &'b [f64]);

/// Hands over every path's body at every point (path, point, body), and gives what happens where it meets its surface. All
/// paths are of one window, and either none has an edge or all may.
pub fn fly(paths: &[Start], mut visit: impl FnMut(usize, usize, Body)) -> Vec<Option<Impact>> {
    let mut steps = [None; 2];
    let longest = paths.first().map_or(f64::INFINITY, |(physics, start)| physics.step_from(&body_of(start)));
    let mut impacts = Vec::with_capacity(paths.len());
    for (first, group) in paths.chunks(LANES).enumerate().map(|(g, group)| (g * LANES, group)) {
        let (flight, met) = Fan::of(group, longest).flight(&mut steps);
        for (lane, (physics, _)) in group.iter().enumerate() {
            let mut places = [0; 2];
            for (i, point) in physics.window.points.iter().enumerate() {
                visit(first + lane, i, flight.at(lane, physics.stamp(point.time), &mut places));
            }
        }
        impacts.extend(met.into_iter().take(group.len()));
    }
    impacts
}

/// The body that nuisances start from.
fn body_of(nuisances: &[f64]) -> Body {
    match nuisances {
        [x, y, vx, vy, rest @ ..] => [*x, *y, *vx, *vy, rest.first().copied().unwrap_or(0.0)],
        _ => [f64::NAN; 5],
    }
}

/// Up to as many paths as there are lanes; those left over go as the first.
struct Fan<'a, 'b> {
    paths: [Start<'a, 'b>; LANES],
    laws: Vec<(&'static dyn MotionLaw, [Lanes; MAX_PARAMETERS])>,
    gravity: [f64; 2],
    /// Longest step, s.
    longest: f64,
}

/// All of a flight: up to the surface, if one is met, and beyond it.
struct Flight {
    legs: [Leg; 2],
    /// When the surface is met; never, if it is not.
    met: Lanes,
}

/// Steps from one time to the next, and what lies within each that was taken.
#[derive(Default)]
struct Leg {
    times: Vec<Lanes>,
    pieces: Vec<Piece>,
}

/// How a lane leaves a surface: when, as what, and what happened there.
type Off = Option<(f64, Body, Impact)>;

/// A step: where it begins and ends.
struct Step<'s> {
    now: &'s Lanes,
    h: Lanes,
    bodies: &'s Bodies,
    slope: &'s Bodies,
    next: &'s Bodies,
    piece: &'s Piece,
}

/// Coefficients of the polynomials in the share of a step: of x and y, and of the spin.
struct Piece {
    place: [[Lanes; 6]; 2],
    spin: [Lanes; 4],
}

impl<'a, 'b> Fan<'a, 'b> {
    fn of(group: &[Start<'a, 'b>], longest: f64) -> Fan<'a, 'b> {
        let paths: [Start; LANES] = from_fn(|lane| *group.get(lane).unwrap_or(&group[0]));
        let gravity = paths[0].0.window.scene.gravity;
        // A law that some lanes have not acts on those with neutral values, which changes nothing.
        let mut known: Vec<(usize, &'static Effect)> = Vec::new();
        for acting in paths.iter().flat_map(|p| &p.0.motions) {
            let (place, effect) = (acting.place, acting.effect);
            if !known.iter().any(|k| k.0 == place && k.1.name == effect.name) {
                known.push((place, effect));
            }
        }
        known.sort_by_key(|k| k.0);
        let law = |(place, effect): (usize, &'static Effect)| {
            let EffectKind::Motion(law) = effect.kind else { return None };
            let own = |(physics, _): &Start| {
                let acting =
                    physics.motions.iter().find(|m| m.place == place && m.effect.name == effect.name);
                acting.map_or_else(
                    || {
                        let neutral: Vec<f64> = effect.parameters.iter().map(|p| p.neutral).collect();
                        law.constants(&neutral, &SimulationContext { time_step: INSTANT, gravity })
                    },
                    |m| m.constants,
                )
            };
            let constants: [_; LANES] = from_fn(|lane| own(&paths[lane]));
            Some((law, from_fn(|c| from_fn(|lane| constants[lane][c]))))
        };
        Fan { paths, laws: known.into_iter().filter_map(law).collect(), gravity, longest }
    }

    /// The flight, and what happens where its surface is met. `steps`: how many before and after it, once that is known.
    fn flight(&self, steps: &mut [Option<usize>; 2]) -> (Flight, [Option<Impact>; LANES]) {
        let window = self.paths[0].0.window;
        let start: [Body; LANES] = from_fn(|lane| body_of(self.paths[lane].1));
        let mut off: [Off; LANES] = [None; LANES];
        let surface = window.surface.as_ref().filter(|_| window.kind == Kind::Contact);
        let from = self.stamps(window.points.first().map_or(0.0, |p| p.time));
        let first = self.leg(self.times(&from, &mut steps[0]), &start, |step| {
            let Some(surface) = surface else { return true };
            for (lane, off) in off.iter_mut().enumerate().filter(|(_, off)| off.is_none()) {
                *off = self.meet(step, lane, surface);
            }
            off.iter().any(Option::is_none)
        });
        let met: Lanes = from_fn(|lane| off[lane].map_or(f64::INFINITY, |o| o.0));
        let mut second = Leg::default();
        if off.iter().any(Option::is_some) {
            let until = first.times.last().copied().unwrap_or(from);
            let from: Lanes = from_fn(|lane| off[lane].map_or(until[lane], |o| o.0));
            let start: [Body; LANES] = from_fn(|lane| off[lane].map_or(start[lane], |o| o.1));
            second = self.leg(self.times(&from, &mut steps[1]), &start, |_| true);
        }
        (Flight { legs: [first, second], met }, off.map(|o| o.map(|o| o.2)))
    }

    /// True times of a time since the window's start, s.
    fn stamps(&self, time: f64) -> Lanes {
        from_fn(|lane| self.paths[lane].0.stamp(time))
    }

    /// Ends of the steps from some times to the last point: `steps` of one length, counted if that is not known, or such that
    /// they end at every point.
    fn times(&self, from: &Lanes, steps: &mut Option<usize>) -> Vec<Lanes> {
        let lead = self.paths[0].0;
        let points = &lead.window.points;
        let count = |from: f64, until: f64| ((until - from) / self.longest).ceil().max(1.0) as usize;
        let mut out = vec![*from];
        let mut on = |until: &Lanes, count: usize| {
            let last = out[out.len() - 1];
            out.extend((1..=count).map(|k| -> Lanes {
                from_fn(|lane| last[lane] + (until[lane] - last[lane]) * (k as f64 / count as f64))
            }));
        };
        if lead.is_smooth() {
            let until = self.stamps(points.last().map_or(0.0, |p| p.time));
            on(&until, *steps.get_or_insert_with(|| count(from[0], until[0])));
            return out;
        }
        for pair in points.windows(2) {
            let [before, after] = [pair[0].time, pair[1].time].map(|time| self.stamps(time));
            if from.iter().zip(&after).any(|(from, after)| from < after) {
                // Those that start within take a shorter way, those that start later none.
                let until: Lanes = from_fn(|lane| after[lane].max(from[lane]));
                on(&until, count(before[0], after[0]));
            }
        }
        if out.len() < 2 {
            out.push(*from);
        }
        out
    }

    /// Steps between some times; fewer if `goes_on`, which is shown each, says so.
    fn leg(&self, times: Vec<Lanes>, start: &[Body; LANES], mut goes_on: impl FnMut(&Step) -> bool) -> Leg {
        let mut bodies: Bodies = from_fn(|k| from_fn(|lane| start[lane][k]));
        let mut slope = self.slope(&times[0], &bodies);
        let mut pieces = Vec::with_capacity(times.len());
        for pair in times.windows(2) {
            let [now, then] = [&pair[0], &pair[1]];
            let h: Lanes = from_fn(|lane| then[lane] - now[lane]);
            let next = self.onwards(now, &bodies, &slope, &h);
            let beyond = self.slope(then, &next);
            let piece = Piece::between([&bodies, &next], [&slope, &beyond], &h);
            let on = goes_on(&Step { now, h, bodies: &bodies, slope: &slope, next: &next, piece: &piece });
            pieces.push(piece);
            if !on {
                break;
            }
            (bodies, slope) = (next, beyond);
        }
        Leg { times, pieces }
    }

    /// How a lane leaves its surface if it meets it within a step.
    fn meet(&self, step: &Step, lane: usize, surface: &Surface) -> Off {
        let (physics, nuisances) = self.paths[lane];
        let offset = nuisances.get(5).copied().unwrap_or(0.0);
        let next: Body = from_fn(|k| step.next[k][lane]);
        if !(surface.below(&next, offset) && surface.approaches(&next)) {
            return None;
        }
        let h = step.h[lane];
        let body = |share: f64| match physics.is_smooth() {
            true => step.piece.body(lane, share, h),
            // Where a push has an edge no polynomial leads across it.
            false => {
                let at = self.onwards(step.now, step.bodies, step.slope, &step.h.map(|h| share * h));
                from_fn(|k| at[k][lane])
            }
        };
        let share = crossing(|share| {
            let at = body(share);
            [surface.height(&at, offset), h * surface.rising(&at)]
        });
        let time = step.now[lane] + h * share;
        let (after, impact) = physics.struck(time, body(share), surface);
        Some((time, after, impact))
    }

    fn slope(&self, time: &Lanes, s: &Bodies) -> Bodies {
        let mut moving = MotionStateLanes { time: *time, x: s[0], y: s[1], vx: s[2], vy: s[3], omega: s[4] };
        for (law, constants) in &self.laws {
            law.kick_lanes(constants, &mut moving, INSTANT);
        }
        let [gx, gy] = self.gravity;
        let mut out = [s[2], s[3], moving.vx, moving.vy, moving.omega];
        for (gained, (before, g)) in out[2..].iter_mut().zip(s[2..].iter().zip([gx, gy, 0.0])) {
            gained.iter_mut().zip(before).for_each(|(a, v)| *a = (*a - v) / INSTANT + g);
        }
        out
    }

    /// A step from where the slope is known.
    fn onwards(&self, time: &Lanes, s: &Bodies, k1: &Bodies, h: &Lanes) -> Bodies {
        let half = h.map(|h| h / 2.0);
        let middle = added(time, &half);
        let k2 = self.slope(&middle, &ahead(s, k1, &half));
        let k3 = self.slope(&middle, &ahead(s, &k2, &half));
        let k4 = self.slope(&added(time, h), &ahead(s, &k3, h));
        let mut mean = *k1;
        for (mean, (k2, (k3, k4))) in mean.iter_mut().zip(k2.iter().zip(k3.iter().zip(&k4))) {
            for (mean, (k2, (k3, k4))) in mean.iter_mut().zip(k2.iter().zip(k3.iter().zip(k4))) {
                *mean = *mean + 2.0 * k2 + 2.0 * k3 + k4;
            }
        }
        ahead(s, &mean, &h.map(|h| h / 6.0))
    }
}

fn added(a: &Lanes, b: &Lanes) -> Lanes {
    let mut out = *a;
    out.iter_mut().zip(b).for_each(|(a, b)| *a += b);
    out
}

/// Bodies `h` seconds along a slope.
fn ahead(s: &Bodies, slope: &Bodies, h: &Lanes) -> Bodies {
    let mut out = *s;
    for (body, slope) in out.iter_mut().zip(slope) {
        body.iter_mut().zip(slope.iter().zip(h)).for_each(|(b, (slope, h))| *b += h * slope);
    }
    out
}

impl Leg {
    /// When a lane's step begins, and how long it is, s.
    fn step(&self, k: usize, lane: usize) -> [f64; 2] {
        let now = self.times[k][lane];
        [now, self.times[k + 1][lane] - now]
    }
}

impl Flight {
    /// A lane's body at a time. `places`: the steps, by leg, at which an earlier time was.
    fn at(&self, lane: usize, time: f64, places: &mut [usize; 2]) -> Body {
        let which = usize::from(time > self.met[lane]);
        let (leg, k) = (&self.legs[which], &mut places[which]);
        while *k + 1 < leg.pieces.len() && leg.times[*k + 1][lane] < time {
            *k += 1;
        }
        let [now, h] = leg.step(*k, lane);
        let share = if h > 0.0 { (time - now) / h } else { 0.0 };
        leg.pieces[*k].body(lane, share, h)
    }
}

impl Piece {
    /// From both ends of steps of `h` seconds and their slopes: quintic Hermite interpolation of the place, cubic of the spin.
    fn between([a, b]: [&Bodies; 2], [from, to]: [&Bodies; 2], h: &Lanes) -> Piece {
        let mut out = Piece { place: [[[0.0; LANES]; 6]; 2], spin: [[0.0; LANES]; 4] };
        for (k, c) in out.place.iter_mut().enumerate() {
            for (l, h) in h.iter().enumerate() {
                let (v, w) = (h * a[k + 2][l], h * b[k + 2][l]);
                let (f, g) = (h * h * from[k + 2][l], h * h * to[k + 2][l]);
                // What the parabola of the start leaves at the end: place, velocity, acceleration.
                let (p, q, r) = (b[k][l] - a[k][l] - v - 0.5 * f, w - v - f, g - f);
                (c[0][l], c[1][l], c[2][l]) = (a[k][l], v, 0.5 * f);
                c[3][l] = 10.0 * p - 4.0 * q + 0.5 * r;
                c[4][l] = -15.0 * p + 7.0 * q - r;
                c[5][l] = 6.0 * p - 3.0 * q + 0.5 * r;
            }
        }
        for (l, h) in h.iter().enumerate() {
            let (v, w) = (h * from[4][l], h * to[4][l]);
            let (p, q) = (b[4][l] - a[4][l] - v, w - v);
            (out.spin[0][l], out.spin[1][l]) = (a[4][l], v);
            (out.spin[2][l], out.spin[3][l]) = (3.0 * p - q, q - 2.0 * p);
        }
        out
    }

    /// A lane's body a share `s` of the way through a step of `h` seconds.
    fn body(&self, lane: usize, s: f64, h: f64) -> Body {
        let [x, y] = [0, 1].map(|k| value(&self.place[k], lane, s));
        let per_second = if h > 0.0 { 1.0 / h } else { 1.0 };
        let [vx, vy] = [0, 1].map(|k| change(&self.place[k], lane, s) * per_second);
        [x, y, vx, vy, value(&self.spin, lane, s)]
    }
}

/// The share of a step at which a height is nothing that is less at its end, given it and its slope: Newton's steps, and halving
/// where those would leave the interval in which that is.
fn crossing(height: impl Fn(f64) -> [f64; 2]) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    let mut at = 0.5;
    for _ in 0..REFINED {
        let [value, slope] = height(at);
        if value > 0.0 {
            low = at
        } else {
            high = at
        }
        let newton = at - value / slope;
        let next = if low < newton && newton < high { newton } else { 0.5 * (low + high) };
        if (next - at).abs() < 1e-14 {
            break;
        }
        at = next;
    }
    at
}

/// A lane's polynomial, constant first, and its derivative.
fn value(c: &[Lanes], lane: usize, s: f64) -> f64 {
    c.iter().rev().fold(0.0, |sum, c| sum * s + c[lane])
}

fn change(c: &[Lanes], lane: usize, s: f64) -> f64 {
    c.iter().enumerate().skip(1).rev().fold(0.0, |sum, (i, c)| sum * s + i as f64 * c[lane])
}

#[cfg(test)]
mod tests {
    use super::super::physics::STEP;
    use super::*;
    use crate::discover::fixture::{bounces, flights};
    use crate::discover::window::Window;
    use crate::world::Latents;
    use crate::world::effect::find;

    fn with<'a>(window: &'a Window, name: &str, values: &[f64]) -> Physics<'a> {
        Physics::new(window, &[(find(name).unwrap(), values)], &Latents::default())
    }

    const LAWS: [(&str, &[f64]); 4] = [
        ("gust", &[2.0, 1.0, 3.0, 0.4]),
        ("lift", &[0.8]),
        ("quadratic_drag", &[0.2]),
        ("time_scale", &[1.01]),
    ];

    /// All bodies of some paths, by path and point.
    fn flown(paths: &[Start]) -> Vec<Vec<Body>> {
        let mut out = vec![Vec::new(); paths.len()];
        fly(paths, |p, _, body| out[p].push(body));
        out
    }

    /// Wherever steps end, a path is where shorter ones from observation to observation lead; off a surface too.
    #[test]
    fn a_path_is_where_shorter_steps_lead() {
        let ((flights, _), (bounces, _)) = (flights([0.0, 0.0], 1), bounces(0.8, 1));
        let contact = bounces.iter().find(|w| w.kind == Kind::Contact).expect("one bounce");
        for ((name, values), window) in LAWS.iter().flat_map(|law| [(law, &flights[0]), (law, contact)]) {
            let physics = with(window, name, values);
            let shorter = Physics { step: STEP[1], ..with(window, name, values) };
            let paths: [Start; 2] = [(&physics, &window.nuisances), (&shorter, &window.nuisances)];
            let [own, wanted] = paths.map(|path| flown(&[path]).remove(0));
            for (at, wanted) in own.iter().zip(wanted) {
                let off = |k: usize| (at[k] - wanted[k]).hypot(at[k + 1] - wanted[k + 1]);
                assert!(off(0) < 1e-6 && off(2) < 1e-5, "{name}: {} and {}", off(0), off(2));
            }
            let met = paths.map(|path| fly(&[path], |_, _, _| ())[0]);
            assert!(met.iter().all(|m| m.is_some() == (window.kind == Kind::Contact)));
            if let [Some(a), Some(b)] = met {
                let off =
                    [a.time - b.time, a.approach - b.approach, a.normal - b.normal, a.tangent - b.tangent];
                assert!(off.iter().all(|o| o.abs() < 1e-6), "{name}: {off:?}");
            }
        }
    }

    /// In company of others, with laws that it has not and more than there are lanes, a path is to the bit what it is alone.
    #[test]
    fn a_path_in_company_is_the_path_alone() {
        let (windows, _) = bounces(0.8, 1);
        for (window, step) in windows.iter().flat_map(|w| STEP.map(|step| (w, step))) {
            let physics = |k: usize| Physics { step, ..with(window, LAWS[k % 3].0, LAWS[k % 3].1) };
            for (k, (name, _)) in LAWS.iter().take(3).enumerate() {
                // The first, which all take as many steps as; and again, beyond the lanes.
                let all: Vec<Physics> = (k..k + LANES + 2).map(physics).collect();
                let paths: Vec<Start> = all.iter().map(|p| (p, window.nuisances.as_slice())).collect();
                let (together, alone) = (flown(&paths), flown(&paths[..1]));
                assert!(together[0] == alone[0] && together[LANES + 1] == alone[0], "{name}");
            }
        }
    }
}
