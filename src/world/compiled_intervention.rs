//! Interventions compiled for engines: numbers only, without names or options.

use super::goal::ObjectId;

/// A compiled intervention.
#[derive(Clone, Debug)]
pub struct CompiledIntervention {
    /// Time step after which it is applied.
    pub step: u32,
    /// Index in the scene's list of interventions.
    pub number: usize,
    pub op: InterventionOp,
}

/// The change that it makes; objects by index.
#[derive(Clone, Debug)]
pub enum InterventionOp {
    /// N s, and the point of application (the centre of mass if `None`), m.
    Impulse {
        body: usize,
        impulse: [f64; 2],
        point: Option<[f64; 2]>,
    },
    SetState {
        body: usize,
        position: Option<[f64; 2]>,
        angle: Option<f64>,
        velocity: Option<[f64; 2]>,
        omega: Option<f64>,
    },
    Add(ObjectId),
    Remove(ObjectId),
    /// Material properties from the latents, of the scene's own bodies and statics in order.
    SetMaterials {
        bodies: Vec<MaterialProperties>,
        statics: Vec<[f64; 2]>,
    },
}

/// Properties of a body that depend on latents.
#[derive(Clone, Copy, Debug)]
pub struct MaterialProperties {
    /// kg
    pub mass: f64,
    /// kg m^2
    pub inertia: f64,
    /// Friction and restitution.
    pub surface: [f64; 2],
}
