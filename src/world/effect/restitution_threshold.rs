//! Restitution threshold: impacts slower than a threshold do not bounce.
//!
//! Source: Box2D (`b2_velocityThreshold`, 1 m/s by default), Bullet and PhysX, for the stability of stacks;
//! and physical causes: a ball on soft or sticky ground, adhesion below a few cm/s (Johnson, Contact
//! Mechanics, section 11.5).
//!
//! Implementation: sets the target rebound speed of a contact in each step, from the approach speed at the
//! beginning of the step. It precedes other laws of contact if it comes from a scene's `contact_rules`;
//! otherwise the order of the scene's effects applies.
//!
//! Differences from the source: in Box2D a contact at exactly the threshold does not bounce; here it does, so
//! that a threshold of 0 has no effect.

use super::{
    Constants, ContactLaw, ContactResponse, ContactState, DataRange, Effect, EffectKind, SearchStrategy,
    amplitude, effect, parameter,
};
use crate::task::constants::MAX_RESTITUTION_THRESHOLD_M_S;

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "restitution_threshold",
    summary: "Restitution threshold: slow impacts do not bounce.",
    signature: "The apexes of a bouncing ball fall as usual, and then it stops at once; impacts above \
        the threshold are unchanged. Only data with impacts on both sides of the threshold identify \
        it.",
    equation: "e = 0 where the impact speed < speed",
    parameters: &[parameter(
        "speed",
        "m/s",
        [0.0, MAX_RESTITUTION_THRESHOLD_M_S],
        amplitude(1.0, 2.0, 0.05).stepwise(),
    )],
    search: SearchStrategy::FromStarts(starts),
    ..effect(EffectKind::Contact(&RestitutionThreshold))
};

/// Fractions of the typical speed: near 0 a small change of the threshold does not change the trajectory.
fn starts(span: &DataRange) -> Vec<Vec<f64>> {
    [0.1, 0.3, 0.6].map(|share| vec![share * span.speed]).to_vec()
}

struct RestitutionThreshold;

impl ContactLaw for RestitutionThreshold {
    fn respond(
        &self,
        constants: &Constants,
        contact: ContactState,
        base: ContactResponse,
    ) -> ContactResponse {
        if contact.approach < constants[0] { ContactResponse { restitution: 0.0, ..base } } else { base }
    }
}
