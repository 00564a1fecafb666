//! Nothing bounces that approaches slower than a threshold.
//!
//! Source: Box2D (`b2_velocityThreshold`, 1 m/s as it is shipped), Bullet and PhysX, so that stacks come to rest; and real
//! things: a ball on a soft or sticky ground that no longer comes off it, adhesion below a few cm/s (Johnson, Contact Mechanics,
//! section 11.5).
//!
//! Signature: a bouncing ball's apexes fall as they should, and then it stays down at once; impacts above the threshold are as
//! without it. Only data whose impacts straddle the threshold tell of it.
//!
//! Where: each step's target rebound speed of a contact, from the speed of approach along the normal at the beginning of the
//! step. Before other laws of contact if it is a scene's `contact_rules`, else in the order of the scene's effects.
//!
//! Differences from the source: in Box2D a contact that approaches at exactly the threshold does not bounce; here it does, so that
//! a threshold of 0 is none.

use super::{Act, Answer, Constants, Effect, Meeting, Parameter, Search, Span, Touch, amplitude};
use crate::task::scene::MOST_THRESHOLD;

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "restitution_threshold",
    equation: "e = 0 where the impact speed < speed",
    parameters: &[Parameter {
        name: "speed",
        unit: "m/s",
        bounds: [0.0, MOST_THRESHOLD],
        neutral: 0.0,
        ..amplitude(1.0, 2.0, 0.05)
    }],
    act: Act::Contact(&RestitutionThreshold),
    holds: &[],
    opposes_motion: false,
    differs: &[],
    renewed: false,
    check: None,
    search: Search::From(starts),
};

/// Near nothing a path does not change by it: shares of the typical speed.
fn starts(span: &Span) -> Vec<Vec<f64>> {
    [0.1, 0.3, 0.6].map(|share| vec![share * span.speed]).to_vec()
}

struct RestitutionThreshold;

impl Touch for RestitutionThreshold {
    fn meet(&self, constants: &Constants, meeting: Meeting, answer: Answer) -> Answer {
        if meeting.approach < constants[0] { Answer { restitution: 0.0, ..answer } } else { answer }
    }
}
