//! How one body moves in a window: through the air, against one surface once, or rolling along it; integrated here in
//! microseconds, since a diagnosis needs a hundred thousand such paths.
//!
//! Effects enter as the registry has them: a law of motion's kick over [`INSTANT`] is its acceleration, a law of contact
//! is asked once at the bounce, a sensor shows each state at the time its clock stands for. `fan` integrates
//! flights, with a bounce on the way or without, `roll` what rolls.
//!
//! Differences from the engines: these are the continuous equations, which engines approach as their step shrinks. A
//! bounce takes no time: normal speed turns by the restitution, slip goes to what the laws of contact ask for as far
//! as friction reaches. Rolling is without slip.

mod fan;
mod roll;

use super::window::{Kind, Surface, Window};
use crate::world::Latents;
use crate::world::effect::{
    Act, ActsOn, Answer, Constants, Effect, Meeting, Motion, Moving, Sensor, Shown, Surroundings, Touch,
};
pub use fan::Start;
use roll::{Body, Rolling};

/// s; accelerations are speeds gained in it. Small against every motion, large against rounding.
pub const INSTANT: f64 = 1e-6;
/// Longest step of integration, s, and the longest where a law has edges in space.
const STEP: [f64; 2] = [0.03, 0.007];

/// What acts in a window.
pub struct Physics<'a> {
    window: &'a Window,
    motions: Vec<Acting>,
    touches: Vec<(&'static dyn Touch, Constants)>,
    sensors: Vec<(&'static dyn Sensor, Constants)>,
    /// True time = rate * stamp + offset.
    clock: [f64; 2],
    step: f64,
    restitution: f64,
    friction: f64,
}

/// A law of motion, with its effect's place among all that act.
struct Acting {
    place: usize,
    effect: &'static Effect,
    law: &'static dyn Motion,
    constants: Constants,
}

/// What a body does to a surface and gets back.
#[derive(Clone, Copy, Debug)]
pub struct Impact {
    /// s since the window's start, by the clock of the observations
    pub time: f64,
    /// Speed towards the surface, m/s.
    pub approach: f64,
    /// Speed of the rim along (-ny, nx), m/s.
    pub slip: f64,
    /// Impulse over mass along the normal (nx, ny), m/s.
    pub normal: f64,
    /// The same along (-ny, nx).
    pub tangent: f64,
}

impl<'a> Physics<'a> {
    /// The scene's own effects and `terms`, with the registry's order of values.
    pub fn new(window: &'a Window, terms: &[(&'static Effect, &[f64])], latents: &Latents) -> Physics<'a> {
        let around = Surroundings { time_step: INSTANT, gravity: window.scene.gravity };
        let own = window.own.iter().map(|a| (a.effect, a.values.as_slice()));
        let (mut motions, mut touches, mut sensors) = (Vec::new(), Vec::new(), Vec::new());
        let mut step = STEP[0];
        for (place, (effect, values)) in own.chain(terms.iter().copied()).enumerate() {
            if effect.parameters.iter().zip(values).all(|(p, v)| p.neutral == *v) {
                continue;
            }
            match effect.act {
                Act::Motion(law) => {
                    let constants = law.constants(values, &around);
                    motions.push(Acting { place, effect, law, constants });
                }
                Act::Contact(law) => touches.push((law, law.constants(values, &around))),
                Act::Sensor(sensor) => sensors.push((sensor, sensor.constants(values, &around))),
                // A start of its own takes up whatever a placement does.
                Act::Action(_) => {}
            }
            if effect.acts_on() == ActsOn::Region {
                step = STEP[1];
            }
        }
        let clock = sensors.iter().fold([1.0, 0.0], |[rate, offset], (sensor, c)| {
            let [r, o] = sensor.clock(c);
            [rate * r, rate * o + offset]
        });
        let (mut restitution, mut friction) = (1.0, 1.0);
        if let Some(s) = &window.surface {
            for k in 0..2 {
                let carried =
                    |latent: Option<f64>, own: f64| if s.carries[k] { latent.unwrap_or(own) } else { own };
                restitution *= carried(latents.restitution, s.restitution[k]);
                friction *= carried(latents.friction, s.friction[k]);
            }
        }
        Physics { window, motions, touches, sensors, clock, step, restitution, friction }
    }

    /// Seen positions at the window's points, two numbers each; NaN where the path leaves all bounds. `visit` is given
    /// every true state: index of the point, (x, y, vx, vy).
    pub fn seen(&self, nuisances: &[f64], visit: impl FnMut(usize, [f64; 4])) -> Vec<f64> {
        self.run(nuisances, visit).0
    }

    /// What happens in a contact window; `None` if the surface is not met.
    pub fn impact(&self, nuisances: &[f64]) -> Option<Impact> {
        self.run(nuisances, |_, _| ()).1
    }

    fn run(&self, nuisances: &[f64], mut visit: impl FnMut(usize, [f64; 4])) -> (Vec<f64>, Option<Impact>) {
        let mut out = Vec::with_capacity(2 * self.window.points.len());
        let mut show = |i: usize, body: Body| {
            visit(i, [body[0], body[1], body[2], body[3]]);
            out.extend(self.shown(&body));
        };
        if self.window.kind == Kind::Roll {
            self.roll(nuisances, show);
            return (out, None);
        }
        let impacts = fan::fly(&[(self, nuisances)], |_, i, body| show(i, body));
        (out, impacts[0])
    }

    /// Hands over the body at every point of a roll.
    fn roll(&self, nuisances: &[f64], mut visit: impl FnMut(usize, Body)) {
        let points = &self.window.points;
        let (Some(first), Some(surface)) = (points.first(), &self.window.surface) else { return };
        let Some(mut rolling) = Rolling::new(surface, first.seen, nuisances) else {
            (0..points.len()).for_each(|i| visit(i, [f64::NAN; 5]));
            return;
        };
        let resists = |load: f64| {
            self.touches.iter().map(|(law, c)| law.roll(c, load * INSTANT)).sum::<f64>() / INSTANT
        };
        let resists = (!self.touches.is_empty()).then_some(resists);
        let mut time = self.stamp(first.time);
        for (i, point) in points.iter().enumerate() {
            let until = self.stamp(point.time);
            let count = ((until - time) / self.step).ceil().max(1.0);
            let h = (until - time) / count;
            for k in (0..count as usize).filter(|_| h > 1e-12) {
                let now = time + h * k as f64;
                rolling.advance(h, |body| self.acceleration(now, body), resists);
            }
            time = until;
            visit(i, rolling.body());
        }
    }

    /// Where sensors see a body; NaN where its path has left all bounds.
    fn shown(&self, body: &Body) -> [f64; 2] {
        let state = Shown { x: body[0], y: body[1], angle: 0.0, vx: body[2], vy: body[3], omega: body[4] };
        let shown = self.sensors.iter().fold(state, |s, (sensor, c)| sensor.show(c, s));
        let fine = shown.x.abs() < 1e7 && shown.y.abs() < 1e7;
        if fine { [shown.x, shown.y] } else { [f64::NAN; 2] }
    }

    /// Whether nothing that acts has an edge: then steps need not end where observations are.
    fn is_smooth(&self) -> bool {
        self.step == STEP[0]
    }

    /// Acceleration at a time since the window's start and a true state (x, y, vx, vy) without spin, m/s^2.
    pub fn push(&self, time: f64, [x, y, vx, vy]: [f64; 4]) -> [f64; 2] {
        let [ax, ay, _] = self.acceleration(self.stamp(time), &[x, y, vx, vy, 0.0]);
        [ax, ay]
    }

    /// [`Physics::stamp`] backwards.
    fn seen_at(&self, true_time: f64) -> f64 {
        (true_time - self.clock[1]) / self.clock[0] - self.window.start
    }

    /// True time of a time since the window's start, s.
    fn stamp(&self, time: f64) -> f64 {
        self.clock[0] * (self.window.start + time) + self.clock[1]
    }

    fn acceleration(&self, time: f64, s: &Body) -> [f64; 3] {
        let mut v = [s[2], s[3], s[4]];
        for acting in &self.motions {
            let moving = Moving { time, x: s[0], y: s[1], vx: v[0], vy: v[1], omega: v[2] };
            v = acting.law.kick(&acting.constants, moving, INSTANT);
        }
        let g = self.window.scene.gravity;
        [(v[0] - s[2]) / INSTANT + g[0], (v[1] - s[3]) / INSTANT + g[1], (v[2] - s[4]) / INSTANT]
    }

    /// A body that meets a surface, as it leaves it.
    fn struck(&self, time: f64, mut at: Body, surface: &Surface) -> (Body, Impact) {
        let n = surface.normal;
        let speed = at[2] * n[0] + at[3] * n[1];
        let slip = at[3] * n[0] - at[2] * n[1] - surface.radius * at[4];
        let meeting = Meeting { approach: (-speed).max(0.0), slip, begins: true };
        let own = Answer { restitution: self.restitution, slip: 0.0 };
        let answer = self.touches.iter().fold(own, |a, (law, c)| law.meet(c, meeting, a));
        // Impulses over the mass; along the tangent (-ny, nx) of the slip.
        let normal = -(1.0 + answer.restitution) * speed;
        let mobility = 1.0 + 1.0 / surface.inertia;
        // What leaves by itself at the very moment of meeting is not held.
        let most = (self.friction * normal).max(0.0);
        let tangent = ((answer.slip - slip) / mobility).clamp(-most, most);
        at[2] += normal * n[0] - tangent * n[1];
        at[3] += normal * n[1] + tangent * n[0];
        at[4] -= tangent / (surface.inertia * surface.radius);
        let impact = Impact { time: self.seen_at(time), approach: meeting.approach, slip, normal, tangent };
        (at, impact)
    }
}

/// What several paths of one window show, as [`Physics::seen`] has it, and what happens in a contact window.
pub fn seen(paths: &[Start]) -> Vec<(Vec<f64>, Option<Impact>)> {
    if paths.first().is_some_and(|(physics, _)| physics.window.kind == Kind::Roll) {
        return paths.iter().map(|(physics, nuisances)| physics.run(nuisances, |_, _| ())).collect();
    }
    let room = |(physics, _): &Start| (Vec::with_capacity(2 * physics.window.points.len()), None);
    let mut out: Vec<(Vec<f64>, Option<Impact>)> = paths.iter().map(room).collect();
    for smooth in [true, false] {
        let those: Vec<usize> = (0..paths.len()).filter(|i| paths[*i].0.is_smooth() == smooth).collect();
        let together: Vec<Start> = those.iter().map(|i| paths[*i]).collect();
        let impacts = fan::fly(&together, |p, _, body| out[those[p]].0.extend(together[p].0.shown(&body)));
        those.iter().zip(impacts).for_each(|(i, impact)| out[*i].1 = impact);
    }
    out
}

impl Surface {
    fn height(&self, s: &Body, offset: f64) -> f64 {
        s[0] * self.normal[0] + s[1] * self.normal[1] - self.level - offset
    }

    fn below(&self, s: &Body, offset: f64) -> bool {
        self.height(s, offset) < 0.0
    }

    /// Speed away from the surface, m/s.
    fn rising(&self, s: &Body) -> f64 {
        s[2] * self.normal[0] + s[3] * self.normal[1]
    }

    fn approaches(&self, s: &Body) -> bool {
        self.rising(s) < 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{bounces, flights};
    use crate::world::effect::find;

    fn with<'a>(window: &'a Window, name: &str, values: &[f64]) -> Physics<'a> {
        Physics::new(window, &[(find(name).unwrap(), values)], &Latents::default())
    }

    /// Along a straight line without gravity: v = v0 / (1 + k v0 t), x = ln(1 + k v0 t) / k.
    #[test]
    fn quadratic_drag_is_met() {
        let (mut windows, _) = flights([0.0, 9.81], 1);
        windows[0].scene.gravity = [0.0, 0.0];
        let (k, v) = (0.15, 8.0);
        let mut speeds = Vec::new();
        let seen =
            with(&windows[0], "quadratic_drag", &[k]).seen(&[1.0, 2.0, v, 0.0], |_, s| speeds.push(s[2]));
        for (i, t) in windows[0].points.iter().map(|p| p.time).enumerate() {
            let wanted = 1.0 + libm::log(1.0 + k * v * t) / k;
            let off = [seen[2 * i] - wanted, seen[2 * i + 1] - 2.0, speeds[i] - v / (1.0 + k * v * t)];
            assert!(off.iter().all(|o| o.abs() < 2e-5), "{off:?} at {t}");
        }
    }

    /// A clock that runs fast shows the path of a longer time; a scale shows it larger.
    #[test]
    fn sensors_show_the_path_at_their_time_and_scale() {
        let (windows, _) = flights([0.0, 0.0], 1);
        let (start, last) = ([0.0, 1.0, 3.0, 4.0], windows[0].points[19].time);
        let show = |name, values: &[f64]| with(&windows[0], name, values).seen(&start, |_, _| ())[38];
        assert!((show("position_scale", &[1.1]) - 3.3 * last).abs() < 1e-9);
        assert!((show("time_scale", &[1.1]) - 3.0 * last / 1.1).abs() < 1e-9);
    }

    /// Normal speed turns by the restitution; slip goes as far as friction reaches, and to nothing at most, which leaves a disc
    /// two thirds of its speed.
    #[test]
    fn a_bounce_turns_speed_and_takes_slip() {
        let (mut windows, _) = bounces(0.8, 1);
        let window = windows.iter_mut().find(|w| w.kind == Kind::Contact).expect("one bounce");
        for (friction, kept) in [(0.02, 1.0 - 0.02 * 1.8 * 5.0), (9.0, 2.0 / 3.0)] {
            let surface = window.surface.as_mut().unwrap();
            (surface.friction, surface.restitution) = ([friction, 1.0], [0.8, 1.0]);
            let surface = surface.clone();
            let physics = Physics::new(window, &[], &Latents::default());
            // At the surface, 5 m/s down and 1 m/s along.
            let (after, met) = physics.struck(0.0, [0.0, 0.05, 1.0, -5.0, 0.0], &surface);
            assert!((after[2] - kept).abs() < 1e-6 && (after[3] - 4.0).abs() < 1e-6, "{after:?}");
            assert!((met.approach - 5.0).abs() < 1e-6 && (met.normal - 9.0).abs() < 1e-6);
        }
    }

    /// What leaves a surface at the very moment of meeting it is not held, and nothing breaks.
    #[test]
    fn a_surface_met_while_leaving_holds_nothing() {
        let (windows, _) = bounces(0.8, 1);
        let window = windows.iter().find(|w| w.kind == Kind::Contact).expect("one bounce");
        let surface = window.surface.as_ref().expect("what it bounces off");
        let physics = Physics::new(window, &[], &Latents::default());
        let (after, met) = physics.struck(0.0, [0.0, 0.051, 1.0, 0.5, 0.0], surface);
        assert_eq!((met.approach, met.tangent), (0.0, 0.0));
        assert!(after.iter().all(|v| v.is_finite()));
    }
}
