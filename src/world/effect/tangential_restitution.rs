//! Tangential restitution: an impact turns the surfaces' sliding speed round by the share et, as far as
//! friction can.
//!
//! Source: Garwin, Am. J. Phys. 37 (1969) 88 (the ultra-elastic rough ball, et = 1); Walton and Braun, J.
//! Rheol. 30 (1986) 949: slip after = -et slip before in sticking impacts, Coulomb friction in sliding ones.
//! et is 0.4 to 0.8 for rubber, 0 for surfaces that grip without spring, -1 for surfaces that do not grip at
//! all. Valid for impacts, not for lasting contacts.
//!
//! Signature: shows only in the change of spin and sideways speed at impacts, and most in steep ones with
//! spin; a ball with et > 0 thrown without spin bounces back from floor and ceiling. Friction changes only
//! grazing impacts, where it is the limit; flights are left alone, unlike by lift.
//!
//! Where: the step in which a contact that bore no load in the step before is met in approach. Slip is the
//! tangential speed of the surfaces at the contact at the beginning of the step.
//!
//! Differences from the source: the engines' own friction is the limit: in `lanes` friction times the normal
//! impulse, in `rapier` the smaller share of it that its solver lets friction have in an impact (under a
//! half, in a test of ours).

use super::{Act, Answer, Constants, Effect, Meeting, Parameter, Search, Touch, amplitude};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "tangential_restitution",
    equation: "slip after an impact = -et * slip before, within friction",
    parameters: &[Parameter {
        name: "et",
        unit: "1",
        bounds: [-1.0, 1.0],
        neutral: 0.0,
        ..amplitude(0.1, 0.5, 2e-3)
    }],
    act: Act::Contact(&TangentialRestitution),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Downhill,
};

struct TangentialRestitution;

impl Touch for TangentialRestitution {
    fn meet(&self, constants: &Constants, meeting: Meeting, answer: Answer) -> Answer {
        if meeting.begins && meeting.approach > 0.0 {
            Answer { slip: -constants[0] * meeting.slip, ..answer }
        } else {
            answer
        }
    }
}
