//! Tangential restitution: an impact reverses the fraction et of the surfaces' sliding speed, within the
//! limit of friction.
//!
//! Source: Garwin, Am. J. Phys. 37 (1969) 88 (the ultra-elastic rough ball, et = 1); Walton and Braun, J.
//! Rheol. 30 (1986) 949: slip after = -et slip before in sticking impacts, Coulomb friction in sliding ones.
//! et is 0.4 to 0.8 for rubber, 0 for surfaces that grip without elasticity, -1 for frictionless surfaces.
//! Valid for impacts, not for lasting contacts.
//!
//! Implementation: acts in the first step of a contact in approach that had no normal impulse in the previous
//! step. Slip is the tangential speed of the surfaces at the contact at the beginning of the step.
//!
//! Differences from the source: the engines' own friction is the limit: in `lanes` friction times the normal
//! impulse, in `rapier` the smaller fraction of it that its solver applies in an impact (below a half in our
//! test).

use super::{
    Constants, ContactLaw, ContactResponse, ContactState, Effect, EffectKind, amplitude, effect, parameter,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "tangential_restitution",
    summary: "Tangential restitution: an impact reverses part of the sliding velocity.",
    signature: "Visible only in the change of spin and sideways speed at impacts, and most in steep ones \
        with spin; a ball with et > 0 thrown without spin bounces back from floor and ceiling. \
        Friction changes only grazing impacts, where it is the limit; flights are unaffected, unlike \
        by lift.",
    equation: "slip after an impact = -et * slip before, within friction",
    parameters: &[parameter("et", "1", [-1.0, 1.0], amplitude(0.1, 0.5, 2e-3))],
    ..effect(EffectKind::Contact(&TangentialRestitution))
};

struct TangentialRestitution;

impl ContactLaw for TangentialRestitution {
    fn respond(
        &self,
        constants: &Constants,
        contact: ContactState,
        base: ContactResponse,
    ) -> ContactResponse {
        if contact.begins && contact.approach > 0.0 {
            ContactResponse { slip: -constants[0] * contact.slip, ..base }
        } else {
            base
        }
    }
}
