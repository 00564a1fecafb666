//! Kinds of recorded worlds, and their hidden effects with adjustable size.

use std::sync::Arc;

use super::law::{Law, Motion};
use super::{Force, OUTSIDE, SINGLES, outside, single};
use iplw::rng;
use rand::RngExt;

/// Kind of a recorded world by its hidden effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Nothing(Motion),
    /// An effect on flight: of [`single`], then the three of [`SENSORS`].
    Single(usize),
    /// A drag and a lift, a drag and a wind, an error of gravity and a drag.
    Pair(usize),
    /// An effect of [`CONTACTS`].
    Contact(usize),
    /// Quadratic drag of balls with varying spin.
    Spin,
    /// A force that the library lacks.
    Outside(usize),
}

const SENSORS: [&str; 3] = ["position_scale", "time_scale", "camera_tilt"];
const CONTACTS: [&str; 5] =
    ["restitution_speed", "tangential_restitution", "rolling_resistance", "linear_drag", "sticky_patch"];

impl Kind {
    /// Name without commas.
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

/// Every kind of world; rare kinds with a figure of their own occur repeatedly.
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

/// True value of a parameter, as a mean over trials.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Size {
    pub effect: &'static str,
    pub parameter: &'static str,
    pub value: f64,
    /// Value without the effect.
    pub neutral: f64,
}

type ApplyEffect = Arc<dyn Fn(&mut Law, f64) + Send + Sync>;

/// A hidden effect with adjustable size.
pub struct HiddenEffect {
    pub name: &'static str,
    /// Parameter name, its value at size 0 and its increment per size.
    parameter: Option<(&'static str, f64, f64)>,
    /// Maximum size.
    most: f64,
    act: ApplyEffect,
    /// Size; the parameter's value is proportional to it.
    pub size: f64,
}

impl HiddenEffect {
    fn new(
        name: &'static str,
        parameter: Option<(&'static str, f64, f64)>,
        most: f64,
        act: impl Fn(&mut Law, f64) + Send + Sync + 'static,
    ) -> HiddenEffect {
        HiddenEffect { name, parameter, most, act: Arc::new(act), size: 1.0 }
    }

    fn push(name: &'static str, parameter: Option<(&'static str, f64, f64)>, force: Force) -> HiddenEffect {
        HiddenEffect::new(name, parameter, 20.0, move |law, size| law.pushes.push((size, force.clone())))
    }

    /// Adds `size` times the unit effect to a law.
    pub fn act(&self, law: &mut Law, size: f64) {
        (self.act)(law, size);
    }

    /// Whether the effect acts, or seems to act, along x only.
    pub fn across(&self) -> bool {
        let mut law = Law::plain(0.0, 0.0);
        self.act(&mut law, 1.0);
        law.pushes.iter().all(|(size, push)| size * push(0.0, [0.0; 4])[1] == 0.0)
    }

    /// Sets the size so that paths shift by `target` m, if given; returns the shift.
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
        let shift = changed(size);
        self.size = size;
        shift
    }

    /// True parameter value at the current size.
    pub fn size(&self) -> Option<Size> {
        let (parameter, neutral, amount) = self.parameter?;
        // A period does not scale with the size.
        let value = neutral + amount * if parameter == "period" { 1.0 } else { self.size };
        Some(Size { effect: self.name, parameter, value, neutral })
    }
}

/// Motion and hidden effects of a kind of world.
pub fn hidden(kind: Kind, seed: u64) -> (Motion, Vec<HiddenEffect>) {
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
            // Size 1 is the drawn value.
            let drawn = part.parameter.map_or(1.0, |p| p.2);
            part.size = k / drawn;
            (Motion::Flies, vec![part])
        }
        Kind::Outside(k) => {
            (Motion::Flies, vec![HiddenEffect::push("outside", None, outside(k, seed).force)])
        }
    }
}

/// A library effect on flight.
fn flying(kind: usize, seed: u64) -> HiddenEffect {
    let mut r = rng::stream(seed, "recorded effect");
    let sign = if r.random::<bool>() { 1.0 } else { -1.0 };
    let along = r.random::<bool>();
    match kind {
        // Wind along x looks like a tilted camera.
        2 if along => HiddenEffect::push("wind", Some(("ax", 0.0, sign)), Arc::new(move |_, _| [sign, 0.0])),
        k if k < SINGLES => {
            let hidden = single(k, seed);
            let parameter = hidden.parameter.map(|(_, name, value)| (name, 0.0, value));
            HiddenEffect::push(hidden.names[0], parameter, hidden.force)
        }
        k => match SENSORS[(k - SINGLES) % SENSORS.len()] {
            "position_scale" => {
                let most = 0.08;
                HiddenEffect::new("position_scale", Some(("s", 1.0, sign)), most, move |l, size| {
                    l.scale += sign * size
                })
            }
            "time_scale" => {
                let most = 0.04;
                HiddenEffect::new("time_scale", Some(("s", 1.0, sign)), most, move |l, size| {
                    l.clock += sign * size
                })
            }
            _ => {
                let most = 0.06;
                HiddenEffect::new("camera_tilt", Some(("angle", 0.0, sign)), most, move |l, size| {
                    l.turn += sign * size
                })
            }
        },
    }
}

/// Motion, and a library effect on contacts.
fn contact(kind: usize, seed: u64) -> (Motion, Vec<HiddenEffect>) {
    let name = CONTACTS[kind % CONTACTS.len()];
    let (motion, part) = match name {
        "restitution_speed" => {
            let act = |law: &mut Law, size: f64| law.slope = size;
            (Motion::Bounces, HiddenEffect::new(name, Some(("slope", 0.0, 1.0)), 0.08, act))
        }
        "tangential_restitution" => {
            let act = |law: &mut Law, size: f64| law.tangential = size;
            (Motion::Bounces, HiddenEffect::new(name, Some(("et", 0.0, 1.0)), 0.9, act))
        }
        "rolling_resistance" => {
            let act = |law: &mut Law, size: f64| law.rolling = size;
            (Motion::Rolls, HiddenEffect::new(name, Some(("crr", 0.0, 1.0)), 0.06, act))
        }
        "linear_drag" => {
            let force: Force = Arc::new(|_, s| [-s[2], 0.0]);
            (
                Motion::Rolls,
                HiddenEffect { most: 0.6, ..HiddenEffect::push(name, Some(("c", 0.0, 1.0)), force) },
            )
        }
        _ => {
            let at = rng::stream(seed, "patch").random_range(0.5..1.0);
            let force: Force =
                Arc::new(move |_, s| if (at..at + 1.0).contains(&s[0]) { [-s[2], 0.0] } else { [0.0; 2] });
            (
                Motion::Rolls,
                HiddenEffect { most: 3.0, ..HiddenEffect::push(name, Some(("c", 0.0, 1.0)), force) },
            )
        }
    };
    (motion, vec![HiddenEffect { size: 0.5 * part.most, ..part }])
}
