//! The input of a simulation.

use super::latent::Latents;
use crate::task::Scene;
use crate::task::scene::EffectTerm;

/// One rollout to simulate.
#[derive(Clone, Copy, Debug)]
pub struct Rollout<'a> {
    /// The scene with everything placed.
    pub scene: &'a Scene,
    /// Latent factors; `None` keeps the scene's own.
    pub latents: Latents,
    /// Effects in addition to the scene's own.
    pub effects: &'a [EffectTerm],
    /// `false` continues after the goal is reached, whatever the scene's setting.
    pub stop_at_goal: bool,
    /// `true` warm-starts contacts that touch at the start: their impulses, which are not part of an
    /// observed state, are computed before the first step. For segments from the middle of an observed
    /// trajectory; ignored in scenes with a goal or with interventions.
    pub contacts_established: bool,
}

impl<'a> Rollout<'a> {
    /// A rollout with the scene's own latents and effects, until its goal, with contacts that begin at
    /// the start.
    pub fn of(scene: &'a Scene) -> Rollout<'a> {
        Rollout {
            scene,
            latents: Latents::default(),
            effects: &[],
            stop_at_goal: true,
            contacts_established: false,
        }
    }
}
