//! Restitution that falls with the speed of impact: e = e0 - slope * speed, within [0, 1].
//!
//! Source: Goldsmith, Impact (1960), chapter VI; Johnson, Contact Mechanics, section 11.5: real balls lose a
//! larger share of speed in harder impacts, metals roughly as speed^(-1/4), table-tennis balls roughly
//! linearly from 0.94 at 1 m/s to 0.8 at 10 m/s (slope 0.015 s/m). Valid about the speeds it was fitted to.
//!
//! Signature: successive apexes of a bouncing ball fall by a factor that itself grows towards e0^2; drag,
//! too, takes more from higher bounces, but shows in the flights between them. One drop height cannot tell it
//! from another e0.
//!
//! Where: each step's target rebound speed of a contact, from the speed of approach along the normal at the
//! beginning of the step.
//!
//! Differences from the source: linear in the speed. e0 is the product of both surfaces' coefficients.

use super::{Act, Answer, Constants, Effect, Meeting, Parameter, Search, Touch, amplitude};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "restitution_speed",
    equation: "e = e0 - slope * impact speed, within [0, 1]",
    parameters: &[Parameter {
        name: "slope",
        unit: "s/m",
        bounds: [-10.0, 10.0],
        neutral: 0.0,
        ..amplitude(0.03, 0.05, 2e-3)
    }],
    act: Act::Contact(&RestitutionSpeed),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::Downhill,
};

struct RestitutionSpeed;

impl Touch for RestitutionSpeed {
    fn meet(&self, constants: &Constants, meeting: Meeting, answer: Answer) -> Answer {
        let restitution = (answer.restitution - constants[0] * meeting.approach).clamp(0.0, 1.0);
        Answer { restitution, ..answer }
    }
}
