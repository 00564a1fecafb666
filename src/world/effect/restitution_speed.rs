//! Speed-dependent restitution: e = e0 - slope * speed, within [0, 1].
//!
//! Source: Goldsmith, Impact (1960), chapter VI; Johnson, Contact Mechanics, section 11.5: real balls lose a
//! larger fraction of speed in harder impacts, metals roughly as speed^(-1/4), table-tennis balls roughly
//! linearly from 0.94 at 1 m/s to 0.8 at 10 m/s (slope 0.015 s/m). Valid near the speeds that it was fitted
//! to.
//!
//! Implementation: sets the target rebound speed of a contact in each step, from the approach speed at the
//! beginning of the step.
//!
//! Differences from the source: linear in the speed. e0 is the product of both surfaces' coefficients.

use super::{
    Constants, ContactLaw, ContactResponse, ContactState, Effect, EffectKind, amplitude, effect, parameter,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "restitution_speed",
    summary: "Speed-dependent restitution: harder impacts lose a larger share of the speed.",
    signature: "Successive apexes of a bouncing ball fall by a factor that itself grows towards e0^2; \
        drag also reduces higher bounces more, but is visible in the flights between them. One drop \
        height cannot distinguish it from another e0.",
    equation: "e = e0 - slope * impact speed, within [0, 1]",
    parameters: &[parameter("slope", "s/m", [-10.0, 10.0], amplitude(0.03, 0.05, 2e-3))],
    ..effect(EffectKind::Contact(&RestitutionSpeed))
};

struct RestitutionSpeed;

impl ContactLaw for RestitutionSpeed {
    fn respond(
        &self,
        constants: &Constants,
        contact: ContactState,
        base: ContactResponse,
    ) -> ContactResponse {
        let restitution = (base.restitution - constants[0] * contact.approach).clamp(0.0, 1.0);
        ContactResponse { restitution, ..base }
    }
}
