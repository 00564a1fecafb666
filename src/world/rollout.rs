//! What is simulated.

use super::latent::Latents;
use crate::task::Scene;
use crate::task::scene::EffectTerm;

/// One rollout to simulate.
#[derive(Clone, Copy, Debug)]
pub struct Rollout<'a> {
    /// The scene with everything placed.
    pub scene: &'a Scene,
    /// Latent factors; `None` leaves the scene's own.
    pub latents: Latents,
    /// Effects beyond the scene's own.
    pub effects: &'a [EffectTerm],
    /// `false` simulates on after the goal is reached, whatever the scene says.
    pub stop: bool,
    /// `true` takes what touches at the start to have done so for long: what each contact bears, which is no part of a state that was
    /// seen, is found before the first step. For stretches from the middle of what was seen; ignored in scenes with a goal or with
    /// interventions.
    pub settled: bool,
}

impl<'a> Rollout<'a> {
    /// A scene as it is: its own latents and effects, to its goal, from a start at which nothing has touched yet.
    pub fn of(scene: &'a Scene) -> Rollout<'a> {
        Rollout { scene, latents: Latents::default(), effects: &[], stop: true, settled: false }
    }
}
