//! What worlds as recordings are hide: kinds of worlds, and effects whose size is open.

use std::sync::Arc;

use super::law::{Law, Motion};
use super::{Force, OUTSIDE, SINGLES, outside, single};
use iplw::rng;
use rand::RngExt;

/// What a kind of world hides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Nothing(Motion),
    /// An effect on flights: of [`single`], then the three of [`SENSORS`].
    Single(usize),
    /// A drag and a lift, a drag and a wind, an error of gravity and a drag.
    Pair(usize),
    /// An effect of [`CONTACTS`].
    Contact(usize),
    /// Quadratic drag of balls whose spin varies.
    Spin,
    /// A force that no library holds.
    Outside(usize),
}

const SENSORS: [&str; 3] = ["position_scale", "time_scale", "camera_tilt"];
const CONTACTS: [&str; 5] =
    ["restitution_speed", "tangential_restitution", "rolling_resistance", "linear_drag", "sticky_patch"];

impl Kind {
    /// Without commas.
    pub fn name(self) -> String {
        match self {
            Kind::Nothing(motion) => format!("nothing / {}", format!("{motion:?}").to_lowercase()),
            Kind::Single(_) => "single".into(),
            Kind::Pair(_) => "pair".into(),
            Kind::Contact(_) => "contact".into(),
            Kind::Spin => "spin varies".into(),
            Kind::Outside(k) => format!("outside / {}", OUTSIDE[k % OUTSIDE.len()]),
        }
    }
}

/// Every kind of world; what is rare in a library's list but has a figure of its own stands in it more than once.
pub fn kinds() -> Vec<Kind> {
    let mut out: Vec<Kind> = (0..SINGLES + SENSORS.len()).map(Kind::Single).collect();
    out.extend((0..CONTACTS.len()).map(Kind::Contact));
    out.extend((0..3).map(Kind::Pair));
    out.extend([Kind::Spin; 2]);
    out.extend((0..OUTSIDE.len()).map(Kind::Outside));
    out.extend([Kind::Nothing(Motion::Flies); 3]);
    out.extend([Kind::Nothing(Motion::Bounces), Kind::Nothing(Motion::Rolls)]);
    out
}

/// A parameter to compare, of the mean over launches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Size {
    pub effect: &'static str,
    pub parameter: &'static str,
    pub value: f64,
    /// The value of no effect.
    pub neutral: f64,
}

type Act = Arc<dyn Fn(&mut Law, f64) + Send + Sync>;

/// A hidden effect whose size is open.
pub struct Part {
    pub name: &'static str,
    /// A parameter, its value at size 0 and what a size of 1 adds.
    parameter: Option<(&'static str, f64, f64)>,
    /// The largest size that such an effect may have.
    most: f64,
    act: Act,
    /// Of which the parameter's value is a multiple.
    pub size: f64,
}

impl Part {
    fn new(
        name: &'static str,
        parameter: Option<(&'static str, f64, f64)>,
        most: f64,
        act: impl Fn(&mut Law, f64) + Send + Sync + 'static,
    ) -> Part {
        Part { name, parameter, most, act: Arc::new(act), size: 1.0 }
    }

    fn push(name: &'static str, parameter: Option<(&'static str, f64, f64)>, force: Force) -> Part {
        Part::new(name, parameter, 20.0, move |law, size| law.pushes.push((size, force.clone())))
    }

    /// Adds so many times the effect of size 1 to a law.
    pub fn act(&self, law: &mut Law, size: f64) {
        (self.act)(law, size);
    }

    /// Whether the effect pushes along x only, or seems to.
    pub fn across(&self) -> bool {
        let mut law = Law::plain(0.0, 0.0);
        self.act(&mut law, 1.0);
        law.pushes.iter().all(|(size, push)| size * push(0.0, [0.0; 4])[1] == 0.0)
    }

    /// Sets the size so that paths change by `target` m, if one is given; what they change by.
    pub fn fit(&mut self, target: Option<f64>, base: &Law, apart: &impl Fn(&Law) -> f64) -> f64 {
        let changed = |size: f64| {
            let mut law = base.clone();
            self.act(&mut law, size);
            apart(&law)
        };
        let mut size = self.size;
        for _ in 0..target.map_or(0, |_| 4) {
            size = (size * target.unwrap_or(0.0) / changed(size).max(1e-12)).min(self.most);
        }
        let moved = changed(size);
        self.size = size;
        moved
    }

    /// What the size makes of the parameter.
    pub fn size(&self) -> Option<Size> {
        let (parameter, neutral, amount) = self.parameter?;
        // A period, say, does not grow with the size.
        let value = neutral + amount * if parameter == "period" { 1.0 } else { self.size };
        Some(Size { effect: self.name, parameter, value, neutral })
    }
}

/// How the ball of a kind of world moves, and what is hidden there.
pub fn hidden(kind: Kind, seed: u64) -> (Motion, Vec<Part>) {
    let mut r = rng::stream(seed, "recorded parts");
    let drag = usize::from(r.random::<bool>());
    match kind {
        Kind::Nothing(motion) => (motion, Vec::new()),
        Kind::Single(k) => (Motion::Flies, vec![flying(k, seed)]),
        Kind::Pair(0) => (Motion::Flies, vec![flying(drag, seed), flying(5, seed + 1)]),
        Kind::Pair(1) => (Motion::Flies, vec![flying(drag, seed), flying(2, seed + 1)]),
        Kind::Pair(_) => (Motion::Flies, vec![flying(4, seed), flying(drag, seed + 1)]),
        Kind::Contact(k) => contact(k, seed),
        Kind::Spin => {
            let k = 0.15 * r.random_range(0.85..1.15);
            let mut part = flying(1, seed);
            // At size 1 it is what was drawn.
            let drawn = part.parameter.map_or(1.0, |p| p.2);
            part.size = k / drawn;
            (Motion::Flies, vec![part])
        }
        Kind::Outside(k) => (Motion::Flies, vec![Part::push("outside", None, outside(k, seed).force)]),
    }
}

/// An effect of the library on flights.
fn flying(kind: usize, seed: u64) -> Part {
    let mut r = rng::stream(seed, "recorded effect");
    let sign = if r.random::<bool>() { 1.0 } else { -1.0 };
    let along = r.random::<bool>();
    match kind {
        // Wind along x looks like a tilted camera.
        2 if along => Part::push("wind", Some(("ax", 0.0, sign)), Arc::new(move |_, _| [sign, 0.0])),
        k if k < SINGLES => {
            let hidden = single(k, seed);
            let parameter = hidden.parameter.map(|(_, name, value)| (name, 0.0, value));
            Part::push(hidden.names[0], parameter, hidden.force)
        }
        k => match SENSORS[(k - SINGLES) % SENSORS.len()] {
            "position_scale" => {
                let most = 0.08;
                Part::new("position_scale", Some(("s", 1.0, sign)), most, move |l, size| {
                    l.scale += sign * size
                })
            }
            "time_scale" => {
                let most = 0.04;
                Part::new("time_scale", Some(("s", 1.0, sign)), most, move |l, size| l.clock += sign * size)
            }
            _ => {
                let most = 0.06;
                Part::new("camera_tilt", Some(("angle", 0.0, sign)), most, move |l, size| {
                    l.turn += sign * size
                })
            }
        },
    }
}

/// How the ball moves, and an effect of the library at contacts.
fn contact(kind: usize, seed: u64) -> (Motion, Vec<Part>) {
    let name = CONTACTS[kind % CONTACTS.len()];
    let (motion, part) = match name {
        "restitution_speed" => {
            let act = |law: &mut Law, size: f64| law.slope = size;
            (Motion::Bounces, Part::new(name, Some(("slope", 0.0, 1.0)), 0.08, act))
        }
        "tangential_restitution" => {
            let act = |law: &mut Law, size: f64| law.tangential = size;
            (Motion::Bounces, Part::new(name, Some(("et", 0.0, 1.0)), 0.9, act))
        }
        "rolling_resistance" => {
            let act = |law: &mut Law, size: f64| law.rolling = size;
            (Motion::Rolls, Part::new(name, Some(("crr", 0.0, 1.0)), 0.06, act))
        }
        "linear_drag" => {
            let force: Force = Arc::new(|_, s| [-s[2], 0.0]);
            (Motion::Rolls, Part { most: 0.6, ..Part::push(name, Some(("c", 0.0, 1.0)), force) })
        }
        _ => {
            let at = rng::stream(seed, "patch").random_range(0.5..1.0);
            let force: Force =
                Arc::new(move |_, s| if (at..at + 1.0).contains(&s[0]) { [-s[2], 0.0] } else { [0.0; 2] });
            (Motion::Rolls, Part { most: 3.0, ..Part::push(name, Some(("c", 0.0, 1.0)), force) })
        }
    };
    (motion, vec![Part { size: 0.5 * part.most, ..part }])
}
