//! The forms in which effects act, and what they may know of the rollout that they act in.

/// The forms in which an effect can act.
#[derive(Clone, Copy)]
pub enum Act {
    /// Changes a body's velocity once per time step, before gravity and contacts.
    Motion(&'static dyn Motion),
    /// Changes what contacts give back, or slows what rolls on them.
    Contact(&'static dyn Touch),
    /// Changes what is seen of a rollout: see `world::observe`.
    Sensor(&'static dyn Sensor),
    /// Changes where things start that an action places.
    Action(&'static dyn Placing),
}

/// Number of rollouts the batched kernel advances together.
pub const LANES: usize = 8;

/// What an effect may know of the rollout it acts in.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings {
    /// s
    pub time_step: f64,
    /// m/s^2
    pub gravity: [f64; 2],
}

/// A law of motion, written for one body; engines that advance many at once use [`Motion::kick_lanes`].
pub trait Motion: Sync {
    /// What is worth computing once per rollout; by default the parameters as they are. Constants that are
    /// all 0 stand for an empty lane, and must give finite kicks.
    fn constants(&self, parameters: &[f64], _around: &Surroundings) -> Constants {
        constants(parameters)
    }

    /// (vx, vy, omega) after `dt` seconds of the effect alone. Pure: the same bits for the same arguments.
    fn kick(&self, constants: &Constants, body: Moving, dt: f64) -> [f64; 3];

    /// Whether [`Motion::kick`] ignores the clock: only then may an engine take a state that a step leaves
    /// unchanged for the rollout's last word.
    fn timeless(&self) -> bool {
        false
    }

    /// [`Motion::kick`] for every lane of a batch: `constants[c][lane]`. An override must return the same
    /// bits.
    fn kick_lanes(&self, constants: &[[f64; LANES]; MOST_PARAMETERS], bodies: &mut MovingLanes, dt: f64) {
        #[expect(clippy::needless_range_loop, reason = "a lane is a column of every array")]
        for lane in 0..LANES {
            let own: Constants = std::array::from_fn(|c| constants[c][lane]);
            let body = Moving {
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

/// A law of contact. Engines ask [`Touch::meet`] at the beginning of a step, about every contact that pushes,
/// and [`Touch::roll`] when its contacts are resolved.
pub trait Touch: Sync {
    /// As [`Motion::constants`].
    fn constants(&self, parameters: &[f64], _around: &Surroundings) -> Constants {
        constants(parameters)
    }

    /// What the contact is to give back in this step; `answer` is what it would without this law.
    fn meet(&self, _constants: &Constants, _meeting: Meeting, answer: Answer) -> Answer {
        answer
    }

    /// m/s to be taken off a disc's rolling speed, given the normal impulse of a step over the disc's mass,
    /// m/s.
    fn roll(&self, _constants: &Constants, _load: f64) -> f64 {
        0.0
    }
}

/// A contact at the beginning of a step.
#[derive(Clone, Copy, Debug)]
pub struct Meeting {
    /// Speed of approach along the normal, m/s; 0 if the surfaces part.
    pub approach: f64,
    /// Tangential speed of one surface along the other, m/s.
    pub slip: f64,
    /// Whether the contact bore no load in the step before.
    pub begins: bool,
}

/// What a contact gives back.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    /// Share of the speed of approach, in [0, 1].
    pub restitution: f64,
    /// Tangential speed of one surface along the other that friction drives at, m/s, in the sense of
    /// [`Meeting::slip`].
    pub slip: f64,
}

/// What a disc of `radius` (m) with a centre speed `along` a static (m/s) and spin `omega` (rad/s) loses of
/// each when `off` (m/s) is taken off its rolling: the speed that centre and rim have in common.
pub fn rolled_off(along: f64, omega: f64, radius: f64, off: f64) -> [f64; 2] {
    let rim = radius * omega;
    if along * rim <= 0.0 {
        return [0.0; 2];
    }
    let lost = along.signum() * off.min(along.abs()).min(rim.abs());
    [lost, lost / radius]
}

/// A sensor: what is seen of the truth, as a function of time and state.
pub trait Sensor: Sync {
    /// As [`Motion::constants`].
    fn constants(&self, parameters: &[f64], _around: &Surroundings) -> Constants {
        constants(parameters)
    }

    /// (rate, offset in s): what is stamped t was true at rate * t + offset; rate > 0.
    fn clock(&self, _constants: &Constants) -> [f64; 2] {
        [1.0, 0.0]
    }

    /// What is seen of a state.
    fn show(&self, _constants: &Constants, state: Shown) -> Shown {
        state
    }
}

/// The state of a body as a sensor shows it: m, rad, m/s, rad/s.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    pub x: f64,
    pub y: f64,
    pub angle: f64,
    pub vx: f64,
    pub vy: f64,
    pub omega: f64,
}

/// How what an action asks for is carried out.
pub trait Placing: Sync {
    /// As [`Motion::constants`].
    fn constants(&self, parameters: &[f64], _around: &Surroundings) -> Constants {
        constants(parameters)
    }

    /// Where a thing ends up that was to be placed at `asked`, m.
    fn placed(&self, constants: &Constants, asked: [f64; 2]) -> [f64; 2];
}

/// Most parameters an effect may have.
pub const MOST_PARAMETERS: usize = 8;
/// What [`Motion::constants`] computes.
pub type Constants = [f64; MOST_PARAMETERS];

/// The values, and 0 where there are fewer than [`MOST_PARAMETERS`].
pub(super) fn constants(values: &[f64]) -> Constants {
    let mut all = [0.0; MOST_PARAMETERS];
    all[..values.len()].copy_from_slice(values);
    all
}

/// What a law of motion may depend on.
#[derive(Clone, Copy, Debug)]
pub struct Moving {
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

/// [`Moving`] for a batch.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct MovingLanes {
    pub time: [f64; LANES],
    pub x: [f64; LANES],
    pub y: [f64; LANES],
    pub vx: [f64; LANES],
    pub vy: [f64; LANES],
    pub omega: [f64; LANES],
}
