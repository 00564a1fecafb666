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
}
