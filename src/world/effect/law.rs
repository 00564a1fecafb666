//! The kinds of effects, as traits, and the simulation state available to them.

/// The kinds of effects.
#[derive(Clone, Copy)]
pub enum EffectKind {
    /// Changes a body's velocity once per time step, before gravity and contacts.
    Motion(&'static dyn MotionLaw),
    /// Changes the response of contacts, or slows bodies that roll on them.
    Contact(&'static dyn ContactLaw),
    /// Changes masses and moments of inertia.
    Body(&'static dyn BodyLaw),
    /// Changes the measured states: see `world::observe`.
    Sensor(&'static dyn Sensor),
    /// Changes the initial positions of objects that an action places.
    Action(&'static dyn PlacementLaw),
}

/// Number of rollouts that the batched engine advances together; on graphics processors a thread advances one.
pub const LANES: usize = if cfg!(kernel) { 1 } else { 8 };

/// Properties of the simulation that an effect may use.
#[derive(Clone, Copy, Debug)]
pub struct SimulationContext {
    /// s
    pub time_step: f64,
    /// m/s^2
    pub gravity: [f64; 2],
}

/// A law of motion for one body; the batched engine uses [`MotionLaw::kick_lanes`].
pub trait MotionLaw: Sync {
    /// Quantities computed once per rollout; by default the parameters. Constants that are all 0 stand
    /// for an empty lane, and must give finite kicks.
    fn constants(&self, parameters: &[f64], _context: &SimulationContext) -> Constants {
        constants(parameters)
    }

    /// (vx, vy, omega) after `dt` seconds of the effect alone. Pure: the same bits for the same
    /// arguments.
    fn kick(&self, constants: &Constants, body: MotionState, dt: f64) -> [f64; 3];

    /// Whether [`MotionLaw::kick`] is independent of time: only then may an engine stop when a step
    /// leaves the state unchanged.
    fn is_autonomous(&self) -> bool {
        true
    }

    /// [`MotionLaw::kick`] for every lane of a batch: `constants[c][lane]`. An override must return the
    /// same bits.
    fn kick_lanes(&self, constants: &ConstantLanes, bodies: &mut MotionStateLanes, dt: f64) {
        #[expect(clippy::needless_range_loop, reason = "a lane is a column of every array")]
        for lane in 0..LANES {
            let own: Constants = std::array::from_fn(|c| constants[c][lane]);
            let body = MotionState {
                time: bodies.time[lane],
                x: bodies.x[lane],
                y: bodies.y[lane],
                vx: bodies.vx[lane],
                vy: bodies.vy[lane],
                omega: bodies.omega[lane],
            };
            let [vx, vy, omega] = self.kick(&own, body, dt);
            (bodies.vx[lane], bodies.vy[lane], bodies.omega[lane]) = (vx, vy, omega);
        }
    }
}

/// A law of contact. Engines call [`ContactLaw::respond`] at the beginning of a step for every active
/// contact, and [`ContactLaw::rolling_loss`] after the contacts are resolved.
pub trait ContactLaw: Sync {
    /// As [`MotionLaw::constants`].
    fn constants(&self, parameters: &[f64], _context: &SimulationContext) -> Constants {
        constants(parameters)
    }

    /// The response of the contact in this step; `base` is the response without this law.
    fn respond(&self, _: &Constants, _contact: ContactState, base: ContactResponse) -> ContactResponse {
        base
    }

    /// Reduction of a disc's rolling speed, m/s, for a normal impulse per mass, m/s, in a step.
    fn rolling_loss(&self, _constants: &Constants, _load: f64) -> f64 {
        0.0
    }
}

/// The state of a contact at the beginning of a step.
#[derive(Clone, Copy, Debug)]
pub struct ContactState {
    /// Speed of approach along the normal, m/s; 0 if the surfaces separate.
    pub approach: f64,
    /// Tangential speed of one surface relative to the other, m/s.
    pub slip: f64,
    /// Whether the contact had no normal impulse in the previous step.
    pub begins: bool,
}

/// The response of a contact.
#[derive(Clone, Copy, Debug)]
pub struct ContactResponse {
    /// Coefficient of restitution, in [0, 1].
    pub restitution: f64,
    /// Tangential target speed of one surface relative to the other that friction enforces, m/s, with the
    /// sign of [`ContactState::slip`].
    pub slip: f64,
}

/// Velocity losses [centre, m/s; spin, rad/s] of a disc of `radius` (m) with centre speed `along` a static
/// (m/s) and spin `omega` (rad/s) when its rolling speed, the speed that centre and rim have in common, is
/// reduced by `off` (m/s).
pub fn rolling_velocity_loss(along: f64, omega: f64, radius: f64, off: f64) -> [f64; 2] {
    let rim = radius * omega;
    if along * rim <= 0.0 {
        return [0.0; 2];
    }
    let lost = along.signum() * off.min(along.abs()).min(rim.abs());
    [lost, lost / radius]
}

/// Inertial properties of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassProperties {
    /// kg
    pub mass: f64,
    /// Moment of inertia about the centre of mass, kg m^2.
    pub inertia: f64,
}

/// An error of the scene's masses or moments of inertia.
pub trait BodyLaw: Sync {
    /// As [`MotionLaw::constants`].
    fn constants(&self, parameters: &[f64], _context: &SimulationContext) -> Constants {
        constants(parameters)
    }

    /// Actual properties of the scene's body with index `body`.
    fn apply(&self, constants: &Constants, body: usize, own: MassProperties) -> MassProperties;
}

/// A sensor: the measured state as a function of the true state and time.
pub trait Sensor: Sync {
    /// As [`MotionLaw::constants`].
    fn constants(&self, parameters: &[f64], _context: &SimulationContext) -> Constants {
        constants(parameters)
    }

    /// (rate, offset in s): the state stamped t is that of true time rate * t + offset; rate > 0.
    fn clock(&self, _constants: &Constants) -> [f64; 2] {
        [1.0, 0.0]
    }

    /// The measurement of a state.
    fn measure(&self, _constants: &Constants, state: Measurement) -> Measurement {
        state
    }
}

/// The measured state of a body: m, rad, m/s, rad/s.
#[derive(Clone, Copy, Debug)]
pub struct Measurement {
    pub x: f64,
    pub y: f64,
    pub angle: f64,
    pub vx: f64,
    pub vy: f64,
    pub omega: f64,
}

/// A placement error of actions.
pub trait PlacementLaw: Sync {
    /// As [`MotionLaw::constants`].
    fn constants(&self, parameters: &[f64], _context: &SimulationContext) -> Constants {
        constants(parameters)
    }

    /// Actual position for the intended position `asked`, m.
    fn place(&self, constants: &Constants, asked: [f64; 2]) -> [f64; 2];
}

/// Maximum number of parameters of an effect.
pub const MAX_PARAMETERS: usize = 8;
/// Constants of a law: see [`MotionLaw::constants`].
pub type Constants = [f64; MAX_PARAMETERS];
/// [`Constants`] of a batch: `[constant][lane]`.
pub type ConstantLanes = [[f64; LANES]; MAX_PARAMETERS];

/// The values, padded with zeros to [`MAX_PARAMETERS`].
pub(super) fn constants(values: &[f64]) -> Constants {
    let mut all = [0.0; MAX_PARAMETERS];
    all[..values.len()].copy_from_slice(values);
    all
}

/// The state of a body as available to a law of motion.
#[derive(Clone, Copy, Debug)]
pub struct MotionState {
    /// s since the start of the rollout
    pub time: f64,
    /// m
    pub x: f64,
    /// m
    pub y: f64,
    /// m/s
    pub vx: f64,
    /// m/s
    pub vy: f64,
    /// rad/s
    pub omega: f64,
}

/// [`MotionState`] of a batch.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
#[cfg_attr(not(kernel), repr(align(64)))]
pub struct MotionStateLanes {
    pub time: [f64; LANES],
    pub x: [f64; LANES],
    pub y: [f64; LANES],
    pub vx: [f64; LANES],
    pub vy: [f64; LANES],
    pub omega: [f64; LANES],
}
