//! What an effect's file declares beside its law.

use std::f64::consts::PI;

use super::law::Act;
use crate::task::scene::EffectTerm;

/// One effect: what it is called, what it takes, what it does, and what whoever looks for causes should know of it.
pub struct Effect {
    /// Name in scenes and reports.
    pub name: &'static str,
    /// The law in words and symbols.
    pub equation: &'static str,
    /// Parameters in the order of the values that `act` is given.
    pub parameters: &'static [Parameter],
    /// What it does.
    pub act: Act,
    /// Effects that it is for some values of its parameters, or in a limit: they are tried in its place.
    pub holds: &'static [&'static Effect],
    /// Whether it is a force against the velocity, wherever a body is.
    pub opposes_motion: bool,
    /// Standard deviation of each amplitude from launch to launch where that has a reason of its own (a ball's spin, a breath
    /// of air), in the amplitudes' units; none where it has not. Every launch may have so much of it without its naming
    /// anything.
    pub differs: &'static [f64],
    /// Whether a contact changes what it depends on (a ball's spin): after one its size is another.
    pub renewed: bool,
    /// What tells it from effects that look the same in any launch: a look at the instrument.
    pub check: Option<&'static str>,
    /// How a search for causes tries it.
    pub search: Search,
}

/// A parameter of an effect.
pub struct Parameter {
    /// Name in scenes and reports.
    pub name: &'static str,
    /// SI unit.
    pub unit: &'static str,
    /// Allowed values, inclusive.
    pub bounds: [f64; 2],
    /// Value at which the effect vanishes.
    pub neutral: f64,
    /// What it is to the effect.
    pub role: Role,
    /// How far from the neutral value it usually is in scenes of some metres, where nothing else is known of it.
    pub size: f64,
    /// Standard deviation of what may be believed of it before anything was measured, about the neutral value: weak, but it
    /// rules out a wind as strong as gravity. Infinite for shapes of which nothing is known.
    pub plausible: f64,
    /// Difference for derivatives by it: far above rounding, far below what changes a path's shape; for edges in
    /// space wide enough that some path crosses what is between.
    pub step: f64,
}

/// What a parameter is to its effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The effect vanishes when all of these are neutral: it is what a test of the effect tests.
    Amplitude,
    /// It only shapes what the amplitudes scale.
    Shape(Shape),
}

/// What a parameter shapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A coordinate of a place, m.
    Place,
    /// An edge of the region within which the effect acts, m: the lower (`end` 0) or upper (1) one along an axis
    /// (0 for x, 1 for y). A path feels it only where it crosses it.
    Edge { axis: usize, end: usize },
    /// A velocity, m/s.
    Velocity,
    /// The time after which what swings with the clock comes again, s.
    Period,
    /// Where in its period it is at the start of the clock, rad.
    Phase,
    /// A time on the clock, s.
    Time,
    /// How wide what it acts within is, in the unit of the place, velocity or time that this is about.
    Width,
    /// A power in a formula.
    Power,
}

/// How a search for causes tries an effect.
#[derive(Clone, Copy)]
pub enum Search {
    /// Not at all: the effect is no cause, but a way to write one down, or one that positions do not tell.
    Never,
    /// Downhill from the neutral values, by small steps off them.
    Downhill,
    /// From these values, best guesses first: for parameters that no way downhill from nothing leads to.
    From(fn(&Span) -> Vec<Vec<f64>>),
}

/// What data span, for places to start a search from.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    /// x_min, y_min, x_max, y_max of observed positions, m
    pub area: [f64; 4],
    /// Latest time on a trial's clock, s
    pub duration: f64,
    /// Typical speed, m/s
    pub speed: f64,
    /// Usual time between observations, s
    pub interval: f64,
}

/// What an effect acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ActsOn {
    /// Whatever moves.
    Motion,
    /// What touches.
    Contact,
    /// Whatever moves within a region.
    Region,
    /// What is seen.
    Sensor,
    /// What is placed.
    Action,
}

/// An amplitude of a usual and of a plausible size, and the step for derivatives by it; the rest of the row is still to be
/// said.
pub(super) const fn amplitude(size: f64, plausible: f64, step: f64) -> Parameter {
    Parameter {
        name: "",
        unit: "",
        bounds: [0.0; 2],
        neutral: 0.0,
        role: Role::Amplitude,
        size,
        plausible,
        step,
    }
}

/// As [`amplitude`], for what only shapes the effect; of where and when nothing is known.
pub(super) const fn shape(shape: Shape, size: f64, step: f64) -> Parameter {
    Parameter { role: Role::Shape(shape), ..amplitude(size, f64::INFINITY, step) }
}

/// As [`shape`], for an edge.
pub(super) const fn edge(axis: usize, end: usize, size: f64, step: f64) -> Parameter {
    shape(Shape::Edge { axis, end }, size, step)
}

impl ActsOn {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            ActsOn::Motion => "motion",
            ActsOn::Contact => "contact",
            ActsOn::Region => "region",
            ActsOn::Sensor => "sensor",
            ActsOn::Action => "action",
        }
    }
}

impl Effect {
    /// What it acts on.
    pub fn acts_on(&self) -> ActsOn {
        match self.act {
            Act::Motion(_) if self.parameters.iter().any(Parameter::is_edge) => ActsOn::Region,
            Act::Motion(_) => ActsOn::Motion,
            Act::Contact(_) => ActsOn::Contact,
            Act::Sensor(_) => ActsOn::Sensor,
            Act::Action(_) => ActsOn::Action,
        }
    }

    /// The effect with these values, one a parameter, in a rollout that starts at `clock` s of the clock that they
    /// are of.
    pub fn at_clock(&self, values: &[f64], clock: f64) -> EffectTerm {
        let mut values = values.to_vec();
        let of = |shape| self.parameters.iter().position(|p| p.role == Role::Shape(shape));
        if let (true, Some(period), Some(phase)) = (clock != 0.0, of(Shape::Period), of(Shape::Phase)) {
            values[phase] = (values[phase] + 2.0 * PI * clock / values[period]).rem_euclid(2.0 * PI);
        }
        if let Some(time) = of(Shape::Time) {
            values[time] -= clock;
        }
        let parameters = self.parameters.iter().zip(values).map(|(p, v)| (p.name.to_string(), v)).collect();
        EffectTerm { name: self.name.to_string(), parameters }
    }

    /// Whether `other` is one of those it holds.
    pub fn holds(&self, other: &Effect) -> bool {
        self.holds.iter().any(|held| held.name == other.name)
    }
}

/// Deviation of a parameter's weak prior, in usual sizes: drag of 0.3 +- 0.3 /s, which served every estimate with the
/// drag fitted along.
const WEAK: f64 = 0.6;

impl Parameter {
    /// Whether the effect vanishes by it, rather than being shaped by it.
    pub fn is_amplitude(&self) -> bool {
        self.role == Role::Amplitude
    }

    /// Whether it is an edge in space.
    pub fn is_edge(&self) -> bool {
        matches!(self.role, Role::Shape(Shape::Edge { .. }))
    }

    /// Mean and standard deviation of what is believed of it where nothing is known: about the neutral value, or to
    /// the side of it that is allowed.
    pub fn prior(&self) -> (f64, f64) {
        let deviation = WEAK * self.size;
        let [low, high] = self.bounds;
        let mean = match self.neutral {
            neutral if neutral == low => neutral + deviation,
            neutral if neutral == high => neutral - deviation,
            neutral => neutral,
        };
        (mean, deviation)
    }
}
