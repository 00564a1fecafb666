//! Effects: physics beyond gravity and contact, one file each, listed in [`REGISTRY`].
//!
//! An effect declares its parameters with units, bounds and the neutral values at which it vanishes, and
//! acts through one of the forms of [`Act`]. Engines call the forms; no engine knows an effect by name.

mod linear_drag;

use crate::error::{Error, Result, within};
use crate::task::scene::EffectTerm;

/// Every known effect.
pub static REGISTRY: [&Effect; 1] = [&linear_drag::EFFECT];

/// One effect: what it is called, what it takes, what it does.
pub struct Effect {
    /// Name in scenes and reports.
    pub name: &'static str,
    /// What the effect acts on: `motion`, `contact`, `region`, `sensor` or `action`.
    pub acts_on: &'static str,
    /// The law in words and symbols.
    pub equation: &'static str,
    /// Parameters in the order of the values that `act` is given.
    pub parameters: &'static [Parameter],
    /// What it does.
    pub act: Act,
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
}

/// The forms in which an effect can act.
#[derive(Clone, Copy)]
pub enum Act {
    /// Changes a body's velocity once per time step, before gravity and contacts.
    Motion(&'static dyn Motion),
}

/// Number of rollouts the batched kernel advances together.
pub const LANES: usize = 8;

/// A law of motion, written for one body; engines that advance many at once use [`Motion::kick_lanes`].
pub trait Motion: Sync {
    /// What is worth computing once per rollout; by default the parameters as they are.
    fn constants(&self, parameters: &[f64], _dt: f64) -> Constants {
        let mut constants = [0.0; MOST_PARAMETERS];
        constants[..parameters.len()].copy_from_slice(parameters);
        constants
    }

    /// (vx, vy, omega) after `dt` seconds of the effect alone. Pure: the same bits for the same arguments.
    fn kick(&self, constants: &Constants, body: Moving, dt: f64) -> [f64; 3];

    /// Whether [`Motion::kick`] ignores the clock: only then may an engine take a state that a step leaves
    /// unchanged for the rollout's last word.
    fn timeless(&self) -> bool {
        false
    }

    /// [`Motion::kick`] for every lane of a batch: `constants[c][lane]`. An override must return the same bits.
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

/// Most parameters an effect may have.
pub const MOST_PARAMETERS: usize = 8;
/// What [`Motion::constants`] computes.
pub type Constants = [f64; MOST_PARAMETERS];

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

/// An effect with its parameter values, in the registry's order.
#[derive(Clone)]
pub struct Active {
    /// The registry's row.
    pub effect: &'static Effect,
    /// One value per parameter.
    pub values: Vec<f64>,
}

/// Looks up a term and checks its parameters; `place` prefixes the error's field.
pub fn resolve(term: &EffectTerm, place: &str) -> Result<Active> {
    let effect = find(&term.name).map_err(|_| {
        let known = REGISTRY.iter().map(|e| e.name).collect::<Vec<_>>().join(", ");
        Error::input(format!("{place}.name"), format!("{:?}", term.name), format!("one of {known}"))
    })?;
    for given in term.parameters.keys() {
        if !effect.parameters.iter().any(|p| p.name == given) {
            let known = effect.parameters.iter().map(|p| p.name).collect::<Vec<_>>().join(", ");
            let field = format!("{place}.parameters.{given}");
            return Err(Error::input(field, "unknown", format!("parameters of {}: {known}", effect.name)));
        }
    }
    let value = |p: &Parameter| {
        let v = term.parameters.get(p.name).copied().unwrap_or(p.neutral);
        within(&format!("{place}.parameters.{}", p.name), v, p.bounds[0], p.bounds[1])
    };
    Ok(Active { effect, values: effect.parameters.iter().map(value).collect::<Result<_>>()? })
}

/// The effect named `name`.
pub fn find(name: &str) -> Result<&'static Effect> {
    REGISTRY.iter().copied().find(|e| e.name == name).ok_or_else(|| Error::NotFound {
        kind: "effect",
        id: name.to_string(),
        known: REGISTRY.iter().map(|e| e.name.to_string()).collect(),
    })
}

/// The term that a kept share of velocity per second stands for (Pymunk's damping).
pub fn damping(kept: f64) -> EffectTerm {
    linear_drag(-kept.ln())
}

/// Linear drag with coefficient `c`, 1/s.
pub fn linear_drag(c: f64) -> EffectTerm {
    EffectTerm { name: "linear_drag".into(), parameters: [("c".to_string(), c)].into() }
}
