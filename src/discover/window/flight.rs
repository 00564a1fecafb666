//! Windows of one body: its flights, the bounces between them, and where it rolls.

use nalgebra::{DMatrix, DVector};

use super::hold::without_holds;
use super::kind::{FLIGHT, Kind, Point, Surface, Window, seen};
use super::touch::{Touch, rolls, touches};
use crate::discover::smooth::{Row, smooth};
use crate::discover::stats::{median, slope};
use crate::reality::Trial;
use crate::task::Scene;

/// Observations on each side of a bounce, and the fewest.
const AROUND: usize = 8;
const BEFORE: usize = 5;
/// Longest gap between observations within a window, as a multiple of the usual one, and about a bounce.
const GAP: f64 = 6.0;
const GAP_AT_BOUNCE: f64 = 3.0;
/// Observations that a first guess of a start is made from.
const FIRST: usize = 12;
/// rad/s: what a ball may spin at that nobody watched, and the error of a spin that was seen.
const UNSEEN_SPIN: f64 = 300.0;
const SEEN_SPIN: f64 = 0.5;

/// All windows of one body.
pub fn flights(trial: &Trial, body: usize) -> Vec<Window> {
    let track = &trial.observed.bodies[body];
    let rows: Vec<Row> =
        trial.observed.times.iter().enumerate().filter_map(|(i, t)| Some((*t, seen(track, i)?))).collect();
    if rows.len() < 3 {
        return Vec::new();
    }
    let touches = touches(trial, body, &rows);
    let usual = median(&rows.windows(2).map(|w| w[1].0 - w[0].0).collect::<Vec<_>>());
    let seen = Seen { trial, body, rows, touches, usual };
    let [gx, gy] = trial.scene.gravity;
    let of = |piece: (usize, usize)| without_holds(&seen.rows, piece, gx.hypot(gy));
    let pieces: Vec<(usize, usize)> = seen.pieces().into_iter().map(of).collect();
    let flights = pieces.iter().filter(|(a, b)| b - a >= FLIGHT).map(|piece| seen.flight(*piece));
    let contacts = pieces.windows(2).filter_map(|pair| seen.contact(pair[0], pair[1]));
    let rolls = rolls(&seen.touches, &seen.rows);
    flights.chain(contacts).chain(rolls.into_iter().filter_map(|roll| seen.roll(roll))).collect()
}

/// What was seen of one body.
struct Seen<'a> {
    trial: &'a Trial,
    body: usize,
    rows: Vec<Row>,
    /// By row.
    touches: Vec<Option<Touch>>,
    /// Time from row to row, s.
    usual: f64,
}

impl Seen<'_> {
    /// Pieces of flight (first row, end): rows without touch and without a long gap.
    fn pieces(&self) -> Vec<(usize, usize)> {
        let (rows, mut pieces, mut first) = (&self.rows, Vec::new(), None);
        for i in 0..=rows.len() {
            let touches = self.touches.get(i).is_none_or(Option::is_some);
            let broken = touches || (i > 0 && rows[i].0 - rows[i - 1].0 > GAP * self.usual);
            if broken && let Some(from) = first.take() {
                pieces.push((from, i));
            }
            if !touches && first.is_none() {
                first = Some(i);
            }
        }
        pieces
    }

    fn flight(&self, (from, to): (usize, usize)) -> Window {
        let rows = &self.rows[from..to];
        let scene = Scene { statics: Vec::new(), carriers: None, ..self.alone() };
        let mut window = smoothed(rows, self.window(rows, scene, Kind::Flight));
        window.nuisances = start_of(&rows[..rows.len().min(FIRST)], window.scene.gravity).to_vec();
        window
    }

    /// The bounce between two pieces of flight, if it is one on a static that a disc meets once.
    fn contact(&self, (a, b): (usize, usize), (c, d): (usize, usize)) -> Option<Window> {
        let rows = &self.rows;
        let touch = (b..c).find_map(|i| self.touches[i])?;
        let single = c == b + 1 && rows[c].0 - rows[b - 1].0 < GAP_AT_BOUNCE * self.usual;
        if !single || b - a < BEFORE || d - c < BEFORE {
            return None;
        }
        let surface = self.surface(touch)?;
        let (before, after) = (&rows[b - AROUND.min(b - a)..b], &rows[c..c + AROUND.min(d - c)]);
        let mut window = self.window(&[before, after].concat(), self.alone(), Kind::Contact);
        let spin = self.spin(before);
        let held = if spin.is_some() { SEEN_SPIN } else { UNSEEN_SPIN };
        window.nuisances =
            [&start_of(before, window.scene.gravity)[..], &[spin.unwrap_or(0.0), 0.0]].concat();
        window.surface = Some(Surface { spin: held, ..surface });
        Some(window)
    }

    fn roll(&self, (from, to, touch): (usize, usize, Touch)) -> Option<Window> {
        let rows = &self.rows[from..to];
        let mut window = smoothed(rows, self.window(rows, self.alone(), Kind::Roll));
        let [_, _, vx, vy] = start_of(&rows[..rows.len().min(FIRST)], [0.0; 2]);
        window.nuisances = vec![0.0, vx * touch.normal[1] - vy * touch.normal[0], 0.0, 0.0];
        window.surface = Some(self.surface(touch)?);
        Some(window)
    }

    /// The trial's scene with no other body in it.
    fn alone(&self) -> Scene {
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

    fn window(&self, rows: &[Row], mut scene: Scene, kind: Kind) -> Window {
        let start = rows[0].0;
        let point = |(t, seen): &Row| Point { body: 0, time: t - start, seen: *seen, weight: 1.0 };
        let points: Vec<Point> = rows.iter().map(point).collect();
        scene.steps = steps(rows[rows.len() - 1].0 - start, scene.time_step);
        Window::new(kind, scene, start, points)
    }

    /// What a disc touches; `None` for other shapes, which turn as they touch, and for what is no static.
    fn surface(&self, touch: Touch) -> Option<Surface> {
        let scene = &self.trial.scene;
        let fixed = touch.fixed?;
        let (own, other) = (&scene.bodies[self.body], &scene.statics[fixed]);
        let radius = own.shape.disc_radius()?;
        let (mass, inertia) = own.mass_properties(None);
        Some(Surface {
            fixed,
            normal: touch.normal,
            level: touch.level,
            friction: [own.friction, other.friction],
            restitution: [own.restitution, other.restitution],
            carries: [scene.carries_latents(&own.name), scene.carries_latents(&other.name)],
            radius,
            inertia: inertia / (mass * radius * radius),
            spin: UNSEEN_SPIN,
        })
    }

    /// Spin over some rows, from angles if they were seen, rad/s.
    fn spin(&self, rows: &[Row]) -> Option<f64> {
        let observed = &self.trial.observed;
        let angle = |t: f64| {
            let at = observed.times.iter().position(|s| *s == t)?;
            observed.bodies[self.body].angle.get(at).copied().filter(|a| a.is_finite())
        };
        let seen: Vec<(f64, f64)> = rows.iter().filter_map(|(t, _)| Some((*t, angle(*t)?))).collect();
        if seen.len() < 4 { None } else { slope(&seen) }
    }
}

/// A window with its data's own smooth, by which outliers do not count.
fn smoothed(rows: &[Row], mut window: Window) -> Window {
    let smooth = smooth(rows);
    for (point, kept) in window.points.iter_mut().zip(&smooth.kept) {
        point.weight = if *kept { 1.0 } else { 0.0 };
    }
    window.smooth = Some(smooth);
    window
}

/// Steps that cover a time and a twentieth more: a sensor's clock may run ahead.
fn steps(time: f64, step: f64) -> u32 {
    (1.05 * time / step + 1e-9).ceil().max(1.0) as u32 + 1
}

impl Window {
    /// Initial state of a flight from its first observations alone, whatever acts: position and velocity by least squares on
    /// parabolas; `None` for other segments.
    pub fn start_whatever_acts(&self) -> Option<Vec<f64>> {
        let points: Vec<&Point> = self.points.iter().filter(|p| p.weight > 0.0).take(FIRST).collect();
        if self.kind != Kind::Flight || points.len() < 4 {
            return None;
        }
        let basis = DMatrix::from_fn(points.len(), 3, |i, k| points[i].time.powi(k as i32));
        let fit = |axis: usize| {
            let seen = DVector::from_fn(points.len(), |i, _| points[i].seen[axis]);
            basis.clone().svd(true, true).solve(&seen, 1e-12).ok()
        };
        let (x, y) = (fit(0)?, fit(1)?);
        Some(vec![x[0], y[0], x[1], y[1]])
    }
}

/// Position and velocity at the first of some rows: least squares on a parabola with the scene's gravity.
fn start_of(rows: &[Row], gravity: [f64; 2]) -> [f64; 4] {
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

    /// A start is met exactly by a flight under gravity, at uneven times.
    #[test]
    fn the_start_of_a_parabola_is_its_start() {
        let at = |t: f64| (5.0 + t, [1.0 + 3.0 * t, 2.0 + 4.0 * t - 4.905 * t * t]);
        let rows = [0.0, 0.1, 0.15, 0.4].map(at);
        let found = start_of(&rows, [0.0, -9.81]);
        assert!(found.iter().zip([1.0, 2.0, 3.0, 4.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }

    fn seen(trial: &Trial, times: &[f64], touched: &[usize]) -> Vec<(usize, usize)> {
        let rows: Vec<Row> = times.iter().map(|t| (*t, [0.0; 2])).collect();
        let touch = |i| touched.contains(&i).then_some(Touch { normal: [0.0, 1.0], level: 0.0, fixed: None });
        let touches = (0..times.len()).map(touch).collect();
        Seen { trial, body: 0, rows, touches, usual: 1.0 }.pieces()
    }

    #[test]
    fn touches_and_long_gaps_end_a_flight() {
        let (scene, observed) = (Scene::empty(), Default::default());
        let trial = Trial { name: String::new(), setting: None, scene, observed };
        let times = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        assert_eq!(seen(&trial, &times, &[]), [(0, 6)]);
        assert_eq!(seen(&trial, &times, &[0, 3]), [(1, 3), (4, 6)]);
        assert_eq!(
            seen(&trial, &[0.0, 1.0, 6.5, 13.0, 14.0], &[]),
            [(0, 3), (3, 5)],
            "longer than six times the usual"
        );
    }
}
