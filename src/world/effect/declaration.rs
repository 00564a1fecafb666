//! Declarations of effects: parameters, equation, and metadata for estimation and diagnosis.

use super::law::EffectKind;
use crate::names::names;

/// An effect: name, parameters, law, and metadata for the diagnosis.
pub struct Effect {
    /// Name in scenes and reports.
    pub name: &'static str,
    /// Other names that people look for; scenes and reports use `name` alone.
    pub aliases: &'static [&'static str],
    /// Description in one sentence.
    pub summary: &'static str,
    /// Observable signature: how the effect shows in trajectories, and how it differs from similar effects.
    pub signature: &'static str,
    /// The law in words and symbols.
    pub equation: &'static str,
    /// Parameters in the order of the values that `kind` takes.
    pub parameters: &'static [ParameterDeclaration],
    /// The law, by kind.
    pub kind: EffectKind,
    /// Effects that are special cases of this one; the search tries them instead.
    pub special_cases: &'static [&'static Effect],
    /// Whether it is a force against the velocity, at any position.
    pub opposes_motion: bool,
    /// Whether its acceleration changes at once where a body comes to rest.
    pub is_abrupt: bool,
    /// Plausible between-trial standard deviation of each amplitude, in its unit, where it has a physical
    /// cause (a ball's spin, air movements); empty where it has none. Between-trial variation up to this
    /// size is not evidence for the effect.
    pub between_trial_sd: &'static [f64],
    /// Whether the richest model of a recording, from which variance components are estimated, includes it.
    pub in_richest_model: bool,
    /// Whether a contact changes what its amplitude depends on (a ball's spin), so that it is independent
    /// before and after a contact.
    pub reset_by_contact: bool,
    /// A check of the instrument that distinguishes it from effects with the same trajectories.
    pub instrument_check: Option<&'static str>,
    /// How the model search starts it.
    pub search: SearchStrategy,
    /// Motion without which a recording does not identify it.
    pub identified_by: Option<IdentifyingMotion>,
}

/// The declaration of an effect's parameter.
pub struct ParameterDeclaration {
    /// Name in scenes and reports.
    pub name: &'static str,
    /// SI unit.
    pub unit: &'static str,
    /// Allowed values, inclusive.
    pub bounds: [f64; 2],
    /// Value at which the effect vanishes.
    pub neutral: f64,
    /// Its role in the effect.
    pub role: ParameterRole,
    /// Typical deviation from the neutral value in scenes of some metres, without other information.
    pub typical_size: f64,
    /// Prior standard deviation about the neutral value: weak, but excludes for example a wind as strong
    /// as gravity. Infinite for shape parameters without prior information.
    pub prior_sd: f64,
    /// Whether sizes far beyond `prior_sd` are plausible too: of media and instruments of any kind.
    pub heavy_tailed: bool,
    /// Whether predictions are piecewise constant in it.
    pub stepwise: bool,
    /// The coordinate in which the prior is symmetric.
    pub prior_coordinate: PriorCoordinate,
    /// Finite-difference step: far above rounding errors and far below the scale of the effect; for edges
    /// of a region wide enough that some trajectory crosses the strip in between.
    pub fd_step: f64,
}

/// Motion by which a recording identifies an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IdentifyingMotion {
    /// Movable bodies collide.
    Collision,
    /// Bodies roll.
    Rolling,
    /// Bodies move without gravity in their plane.
    SeenFromAbove,
}

/// The role of a parameter in its effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterRole {
    /// The effect vanishes when all amplitudes are neutral; significance tests test them.
    Amplitude,
    /// Shapes the effect without scaling it.
    Shape(ShapeParameter),
}

/// The coordinate of a parameter in which its prior is symmetric about the neutral value. Effects with the same trajectories
/// declare coordinates that make them as probable at every size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PriorCoordinate {
    /// The value.
    Value,
    /// The logarithm of the value's ratio to the neutral one.
    LogRatio,
    /// The logarithm of the ratio of the gravity that the value is added to before and after.
    LogGravity,
}

/// The quantity that a shape parameter stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShapeParameter {
    /// A coordinate of a position, m.
    Place,
    /// An edge of the region within which the effect acts, m: the lower (`end` 0) or upper (1) one along
    /// an axis (0 for x, 1 for y). Only trajectories that cross it depend on it.
    Edge { axis: usize, end: usize },
    /// A velocity, m/s.
    Velocity,
    /// The period of an oscillation in time, s.
    Period,
    /// The phase of an oscillation at time 0, rad.
    Phase,
    /// A time, s.
    Time,
    /// A width, in the unit of the position, velocity or time that it belongs to.
    Width,
    /// An exponent.
    Power,
}

/// How the model search starts an effect.
#[derive(Clone, Copy)]
pub enum SearchStrategy {
    /// The search does not try it: the effect only writes an empirical force, or positions do not
    /// identify it.
    Excluded,
    /// A local search from the neutral values.
    FromNeutral,
    /// Local searches from these starting values, best guesses first: for effects that a search from
    /// neutral values does not reach.
    FromStarts(fn(&DataRange) -> Vec<Vec<f64>>),
}

/// The ranges of the data, for starting values.
#[derive(Clone, Copy, Debug)]
pub struct DataRange {
    /// x_min, y_min, x_max, y_max of observed positions, m
    pub area: [f64; 4],
    /// Latest time on a trial's clock, s
    pub duration: f64,
    /// Typical speed, m/s
    pub speed: f64,
    /// Typical time between observations, s
    pub interval: f64,
}

/// The part of the simulation that an effect changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EffectTarget {
    /// The motion of bodies.
    Motion,
    /// Contacts.
    Contact,
    /// Masses and moments of inertia.
    Body,
    /// The motion of bodies within a region.
    Region,
    /// Measurements.
    Sensor,
    /// Placements by actions.
    Action,
}

/// An effect of this kind with the values that most effects share; the caller fills the other fields.
pub(super) const fn effect(kind: EffectKind) -> Effect {
    Effect {
        name: "",
        aliases: &[],
        summary: "",
        signature: "",
        equation: "",
        parameters: &[],
        kind,
        special_cases: &[],
        opposes_motion: false,
        is_abrupt: false,
        between_trial_sd: &[],
        in_richest_model: false,
        reset_by_contact: false,
        instrument_check: None,
        search: SearchStrategy::FromNeutral,
        identified_by: None,
    }
}

/// A parameter with its name, SI unit and bounds; `base` has the other fields.
pub(super) const fn parameter(
    name: &'static str,
    unit: &'static str,
    bounds: [f64; 2],
    base: ParameterDeclaration,
) -> ParameterDeclaration {
    ParameterDeclaration { name, unit, bounds, ..base }
}

/// An amplitude with its typical size, prior standard deviation and finite-difference step, neutral at 0; the
/// caller fills the other fields.
pub(super) const fn amplitude(size: f64, prior_sd: f64, fd_step: f64) -> ParameterDeclaration {
    ParameterDeclaration {
        name: "",
        unit: "",
        bounds: [0.0; 2],
        neutral: 0.0,
        role: ParameterRole::Amplitude,
        typical_size: size,
        prior_sd,
        heavy_tailed: false,
        stepwise: false,
        prior_coordinate: PriorCoordinate::Value,
        fd_step,
    }
}

/// A factor `s` by which a measurement is off, neutral at 1, as likely too large as too small by the same ratio.
pub(super) const fn scale_factor(prior_sd: f64, bounds: [f64; 2]) -> ParameterDeclaration {
    let base = amplitude(0.1, prior_sd, 2e-3).neutral_at(1.0).heavy_tailed(PriorCoordinate::LogRatio);
    parameter("s", "1", bounds, base)
}

/// As [`amplitude`], for a shape parameter with a flat prior.
pub(super) const fn shape(shape: ShapeParameter, size: f64, fd_step: f64) -> ParameterDeclaration {
    ParameterDeclaration { role: ParameterRole::Shape(shape), ..amplitude(size, f64::INFINITY, fd_step) }
}

/// As [`shape`], for an edge.
pub(super) const fn edge(axis: usize, end: usize, size: f64, fd_step: f64) -> ParameterDeclaration {
    shape(ShapeParameter::Edge { axis, end }, size, fd_step)
}

names!(EffectTarget: Motion = "motion", Contact = "contact", Body = "body", Region = "region", Sensor = "sensor",
    Action = "action");

impl Effect {
    /// The part of the simulation that it changes.
    pub fn target(&self) -> EffectTarget {
        match self.kind {
            EffectKind::Motion(_) if self.parameters.iter().any(ParameterDeclaration::is_edge) => {
                EffectTarget::Region
            }
            EffectKind::Motion(_) => EffectTarget::Motion,
            EffectKind::Contact(_) => EffectTarget::Contact,
            EffectKind::Body(_) => EffectTarget::Body,
            EffectKind::Sensor(_) => EffectTarget::Sensor,
            EffectKind::Action(_) => EffectTarget::Action,
        }
    }

    /// Whether `other` is a special case of this effect.
    pub fn has_special_case(&self, other: &Effect) -> bool {
        self.special_cases.iter().any(|held| held.name == other.name)
    }
}

/// Ratio below which a logarithm continues as its tangent.
const LEAST_RATIO: f64 = 0.02;
/// Standard deviation of a parameter's weak prior, in typical sizes; for linear drag 0.3 +- 0.3 /s.
const PRIOR_SD_PER_TYPICAL_SIZE: f64 = 0.6;

impl ParameterDeclaration {
    /// The same with another neutral value.
    pub(super) const fn neutral_at(self, neutral: f64) -> ParameterDeclaration {
        ParameterDeclaration { neutral, ..self }
    }

    /// The value with a deviation of the prior's coordinate: [`Self::prior_deviation`] backwards, without its tangent.
    pub fn at_prior_deviation(&self, deviation: f64, gravity: f64) -> f64 {
        match self.prior_coordinate {
            PriorCoordinate::LogRatio => self.neutral * libm::exp(deviation / self.neutral),
            PriorCoordinate::LogGravity if gravity > 0.0 => gravity * libm::expm1(deviation / gravity),
            PriorCoordinate::Value | PriorCoordinate::LogGravity => self.neutral + deviation,
        }
    }

    /// The same for a parameter in which predictions are piecewise constant.
    pub(super) const fn stepwise(self) -> ParameterDeclaration {
        ParameterDeclaration { stepwise: true, ..self }
    }

    /// The same with a heavy-tailed prior that is symmetric in a coordinate.
    pub(super) const fn heavy_tailed(self, prior_coordinate: PriorCoordinate) -> ParameterDeclaration {
        ParameterDeclaration { heavy_tailed: true, prior_coordinate, ..self }
    }

    /// Deviation of a value from the neutral one in the prior's coordinate, in the parameter's unit, and its derivative by
    /// the value, which is 1 at the neutral one. `gravity`: of the scene, m/s^2.
    pub fn prior_deviation(&self, value: f64, gravity: f64) -> [f64; 2] {
        let logarithm = |scale: f64, ratio: f64| match ratio > LEAST_RATIO {
            true => [scale * ratio.ln(), ratio.recip()],
            // The tangent: gravity may be reversed.
            false => [scale * (LEAST_RATIO.ln() + ratio / LEAST_RATIO - 1.0), LEAST_RATIO.recip()],
        };
        match self.prior_coordinate {
            PriorCoordinate::LogRatio => logarithm(self.neutral, value / self.neutral),
            PriorCoordinate::LogGravity if gravity > 0.0 => logarithm(gravity, 1.0 + value / gravity),
            PriorCoordinate::Value | PriorCoordinate::LogGravity => [value - self.neutral, 1.0],
        }
    }

    /// Whether it scales the effect, rather than shaping it.
    pub fn is_amplitude(&self) -> bool {
        self.role == ParameterRole::Amplitude
    }

    /// Whether it is an edge of a region.
    pub fn is_edge(&self) -> bool {
        matches!(self.role, ParameterRole::Shape(ShapeParameter::Edge { .. }))
    }

    /// Mean and standard deviation of a weak prior: centred on the neutral value, or shifted to its
    /// allowed side.
    pub fn weak_prior(&self) -> (f64, f64) {
        let deviation = PRIOR_SD_PER_TYPICAL_SIZE * self.typical_size;
        let [low, high] = self.bounds;
        let mean = match self.neutral {
            neutral if neutral == low => neutral + deviation,
            neutral if neutral == high => neutral - deviation,
            neutral => neutral,
        };
        (mean, deviation)
    }
}
