//! Establishes contacts at the start of a rollout: repeats the first step until the contact impulses have
//! converged, as in `lanes::settle`.

use super::RapierWorld;
use crate::world::compile::RolloutModel;
use crate::world::record::BodyState;

/// Repetitions of the first step before the one that counts. The remaining error is at the level of single
/// precision.
const WARM_START_STEPS: u32 = 12;

impl RapierWorld {
    /// Warm-starts the contacts of the initial state `states`.
    pub(super) fn settle(&mut self, model: &RolloutModel, states: &[BodyState]) {
        for _ in 0..WARM_START_STEPS {
            self.step(model, 0);
            let after_step = self.states();
            for (i, (before, after)) in after_step.iter().zip(states).enumerate() {
                self.move_body(model, i, before, after);
            }
        }
    }
}
