//! Limits of one request.

use crate::error::{Error, Result};
use crate::task::Scene;

/// Maximum work of one request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RequestLimits {
    /// Actions, or worlds, in one batch.
    pub actions: usize,
    /// Sampled body states in one response, 8 numbers each.
    pub samples: u64,
    /// Time steps times the work of a step ([`Scene::step_cost`]), in all rollouts: the number of body-time-steps of simple bodies.
    pub body_steps: u64,
    /// Peak memory of a request or job, estimated before it starts, bytes.
    pub memory_bytes: u64,
}

/// Name of the quantity limited by [`RequestLimits::body_steps`], in its error.
pub const BODY_STEPS_LABEL: &str =
    "bodies x time steps x actions (more for shapes of many pieces or corners)";

/// Rollouts up to this many body-time-steps run inline, in at most about 0.2 ms.
pub(super) const MAX_INLINE_BODY_STEPS: u64 = 100;

impl RequestLimits {
    /// Keeps a response below 0.5 GB and a request within about a minute on two cores.
    pub const STANDARD: RequestLimits =
        RequestLimits { actions: 4096, samples: 4_000_000, body_steps: 100_000_000, memory_bytes: 512 << 20 };

    /// Fails if an estimate of peak memory, bytes, exceeds the limit.
    pub fn check_memory(&self, estimate_bytes: u64, advice: &'static str) -> Result<()> {
        if estimate_bytes <= self.memory_bytes {
            return Ok(());
        }
        let megabytes = |bytes: u64| bytes.div_ceil(1_000_000);
        let (asked, limit) = (megabytes(estimate_bytes), megabytes(self.memory_bytes));
        Err(Error::TooLarge { what: "memory, MB", asked, limit, advice })
    }

    /// Fails if `work` body-time-steps exceed the limit.
    pub(super) fn check_work(&self, work: u64) -> Result<()> {
        if work <= self.body_steps {
            return Ok(());
        }
        let advice = "take fewer actions, steps or bodies, or simpler shapes";
        Err(Error::TooLarge { what: BODY_STEPS_LABEL, asked: work, limit: self.body_steps, advice })
    }

    /// Fails if a request has too many actions or worlds.
    pub(super) fn check_count(&self, what: &'static str, asked: usize) -> Result<()> {
        if asked <= self.actions {
            return Ok(());
        }
        let (asked, limit) = (asked as u64, self.actions as u64);
        Err(Error::TooLarge { what, asked, limit, advice: "send several batches" })
    }

    /// Fails if `rollouts` of `scene` exceed a limit.
    pub(super) fn check_cost(&self, scene: &Scene, rollouts: u64, samples_kept: bool) -> Result<()> {
        let bodies = scene.bodies.len() as u64;
        self.check_work(rollouts.saturating_mul(rollout_work(scene)))?;
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

/// Work of a rollout of a scene, body-time-steps.
pub(super) fn rollout_work(scene: &Scene) -> u64 {
    u64::from(scene.steps).saturating_mul(scene.step_cost())
}
