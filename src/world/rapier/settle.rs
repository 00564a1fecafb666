//! Contacts that have lasted before a rollout begins: their impulses are found by making its first step again and again, as in
//! `lanes::settle`.

use super::World;
use crate::world::prepare::Prepared;
use crate::world::record::State;

/// Times that the first step is made before the one that counts. Its own error is that of single precision after as many.
const TIMES: u32 = 12;

impl World {
    /// Finds what contacts bear at the start, where bodies are at `states`.
    pub(super) fn settle(&mut self, prepared: &Prepared, states: &[State]) {
        for _ in 0..TIMES {
            self.step(prepared, 0);
            let moved = self.states();
            for (i, (before, after)) in moved.iter().zip(states).enumerate() {
                self.move_body(prepared, i, before, after);
            }
        }
    }
}
