//! What one request may cost.

use crate::error::{Error, Result};
use crate::task::Scene;

/// Most of everything that one request may ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RequestLimits {
    /// Actions, or worlds, in one batch.
    pub actions: usize,
    /// Sampled body states in one answer; 8 numbers each.
    pub samples: u64,
    /// Body-time-steps.
    pub body_steps: u64,
}

/// What [`RequestLimits::body_steps`] is about, as its error says.
pub const WORK: &str = "bodies x time steps x actions";

/// Body-time-steps up to which a rollout is light: at most about 0.2 ms.
pub(super) const LIGHT: u64 = 100;

impl RequestLimits {
    /// An answer stays below half a gigabyte, and a request takes about a minute of two cores at most.
    pub const STANDARD: RequestLimits =
        RequestLimits { actions: 4096, samples: 4_000_000, body_steps: 100_000_000 };

    /// Errors if so many body-time-steps are more than one request may cost.
    pub(super) fn bearable(&self, work: u64) -> Result<()> {
        if work <= self.body_steps {
            return Ok(());
        }
        let advice = "take fewer actions, steps or bodies";
        Err(Error::TooLarge { what: WORK, asked: work, limit: self.body_steps, advice })
    }

    /// Errors if so many actions or worlds are more than one request may name.
    pub(super) fn countable(&self, what: &'static str, asked: usize) -> Result<()> {
        if asked <= self.actions {
            return Ok(());
        }
        let (asked, limit) = (asked as u64, self.actions as u64);
        Err(Error::TooLarge { what, asked, limit, advice: "send several batches" })
    }

    /// Errors if `rollouts` of `scene` are more than one request may cost.
    pub(super) fn affordable(&self, scene: &Scene, rollouts: u64, samples_kept: bool) -> Result<()> {
        let bodies = scene.bodies.len() as u64;
        self.bearable(rollouts.saturating_mul(u64::from(scene.steps)).saturating_mul(bodies))?;
        let each = u64::from(scene.steps / scene.observe_every.max(1)) + 2;
        let samples = rollouts.saturating_mul(each).saturating_mul(bodies);
        if samples_kept && samples > self.samples {
            let advice = "take fewer actions or a larger `observe_every`";
            let (what, limit) = ("sampled body states", self.samples);
            return Err(Error::TooLarge { what, asked: samples, limit, advice });
        }
        Ok(())
    }
}
