//! New contacts of two objects.

use super::contact_pair::ContactPair;
use super::state::BatchState;
use crate::world::contact_criteria::CONTACT_GAP_STEPS;

impl BatchState {
    /// Whether the contact of a pair in `new_contacts` is a new contact of its two objects in a lane, none of whose
    /// other pieces already touch; of several pairs that begin in one step the first counts.
    pub fn is_new_contact(&self, index: usize, lane: usize) -> bool {
        let new = self.contact(index);
        let touched = |(i, contact): (usize, &ContactPair)| {
            if contact.first != new.first || contact.other != new.other || i == index {
                return false;
            }
            if contact.begins[lane] > 0.0 && self.new_contacts.contains(&i) {
                return i < index;
            }
            self.tick - contact.last_touch[lane] <= f64::from(CONTACT_GAP_STEPS)
        };
        new.begins[lane] > 0.0 && !self.all_contacts().enumerate().any(touched)
    }
}
