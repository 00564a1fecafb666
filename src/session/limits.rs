//! What one request may cost.

use crate::error::{Error, Result};
use crate::task::Scene;

/// Most actions in one batch.
pub const MOST_ACTIONS: usize = 4096;
/// Most sampled body states in one answer; 8 numbers each, so that an answer stays below half a gigabyte.
const MOST_SAMPLES: u64 = 4_000_000;
/// Body-time-steps up to which a rollout is light: at most about 0.2 ms.
pub(super) const LIGHT: u64 = 100;
/// Most body-time-steps in one request: about a minute on two cores.
const MOST_WORK: u64 = 100_000_000;

/// Errors if so many body-time-steps are more than one request may cost.
pub(super) fn bearable(work: u64) -> Result<()> {
    if work <= MOST_WORK {
        return Ok(());
    }
    let what = "bodies x time steps x actions";
    let advice = "take fewer actions, steps or bodies";
    Err(Error::TooLarge { what, asked: work, limit: MOST_WORK, advice })
}

/// Errors if `rollouts` of `scene` are more than one request may cost.
pub(super) fn affordable(scene: &Scene, rollouts: u64, samples_kept: bool) -> Result<()> {
    let bodies = scene.bodies.len() as u64;
    bearable(rollouts.saturating_mul(u64::from(scene.steps)).saturating_mul(bodies))?;
    let each = u64::from(scene.steps / scene.observe_every.max(1)) + 2;
    let samples = rollouts.saturating_mul(each).saturating_mul(bodies);
    if samples_kept && samples > MOST_SAMPLES {
        let advice = "take fewer actions or a larger `observe_every`";
        return Err(Error::TooLarge {
            what: "sampled body states",
            asked: samples,
            limit: MOST_SAMPLES,
            advice,
        });
    }
    Ok(())
}
