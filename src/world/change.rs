//! Interventions with everything decided: numbers only, as engines take them.

use super::goal::Party;

/// A change with everything decided.
#[derive(Clone, Debug)]
pub struct Change {
    /// Happens after so many steps.
    pub step: u32,
    /// Number of the scene's intervention.
    pub number: usize,
    pub act: Act,
}

/// What is done; things by their numbers.
#[derive(Clone, Debug)]
pub enum Act {
    /// N s, and where (the centre of mass if `None`), m.
    Push {
        body: usize,
        impulse: [f64; 2],
        point: Option<[f64; 2]>,
    },
    Put {
        body: usize,
        position: Option<[f64; 2]>,
        angle: Option<f64>,
        velocity: Option<[f64; 2]>,
        omega: Option<f64>,
    },
    Add(Party),
    Remove(Party),
    /// What latents decide, of the scene's own bodies and statics in their order.
    Matter {
        bodies: Vec<Matter>,
        statics: Vec<[f64; 2]>,
    },
}

/// What latents decide of a body.
#[derive(Clone, Copy, Debug)]
pub struct Matter {
    /// kg
    pub mass: f64,
    /// kg m^2
    pub inertia: f64,
    /// Friction, restitution.
    pub surface: [f64; 2],
}
