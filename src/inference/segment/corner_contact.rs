//! Which corner or side of a body touches in an impact.

use super::closest_features::closest_features;
use super::contact_geometry::{ContactFeature, RoundedCorner, TurningVector, contact_gap};
use super::free_motion::{AroundImpact, ImpactMotion, crossing};
use crate::task::solid::Solid;

/// Largest torque that the observed motions lack for an impulse at the place of contact, as a share of the largest possible one:
/// more means another place, or several.
const MAX_MISSING_TORQUE: f64 = 0.1;

/// The parts of two outlines that touch, and the standard deviations of the bodies' angles then, rad; 0 for statics.
pub struct TouchingParts {
    pub features: [ContactFeature; 2],
    pub angle_sd: [f64; 2],
}

/// The parts of two outlines that touch in one impact. `around`: the movable bodies, one or two; `fixed`: the static that a single
/// body hits; `start`: of the segment, s. `None` if angles are missing, the motions do not cross in one impact, several places
/// touch at once, or the impulse acts elsewhere.
pub fn touching_parts(around: &[AroundImpact], fixed: Option<&Solid>, start: f64) -> Option<TouchingParts> {
    let motions: Vec<ImpactMotion> = around.iter().map(ImpactMotion::of).collect::<Option<_>>()?;
    let size = around.iter().filter_map(AroundImpact::size).fold(f64::INFINITY, f64::min);
    let time = crossing(&motions, around, size)?;
    let placed = |k: usize| -> Option<(Solid, [f64; 2])> {
        let Some((motion, around)) = motions.get(k).zip(around.get(k)) else {
            return Some((fixed?.clone(), [0.0; 2]));
        };
        let (position, angle, _) = motion.pose(time);
        let solid = around.body.shape.solid();
        Some((solid.placed(position, angle), position))
    };
    let [a, b] = [placed(0)?, placed(1)?];
    let features = closest_features([(&a.0, a.1), (&b.0, b.1)], size)?;
    let gap = contact_gap(&features, 0.0, [a.1, b.1], 0.0);
    let turned = motions.iter().zip(around).zip(gap.arms);
    if !turned.into_iter().all(|((motion, around), arm)| acts_at(arm, motion.kick(time), around)) {
        return None;
    }
    let from_start = |vector: TurningVector, k: usize| {
        let rate = motions.get(k).map_or(0.0, ImpactMotion::spin);
        let turning = TurningVector { rate, ..vector };
        TurningVector { at_start: turning.at(start - time), ..turning }
    };
    let features = [0, 1].map(|k| match features[k] {
        ContactFeature::Corner(RoundedCorner { place, radius }) => {
            ContactFeature::Corner(RoundedCorner { place: from_start(place, k), radius })
        }
        ContactFeature::Side { normal, distance } => {
            ContactFeature::Side { normal: from_start(normal, k), distance }
        }
    });
    let angle_sd = [0, 1].map(|k| motions.get(k).map_or(0.0, |motion| motion.pose(time).2));
    Some(TouchingParts { features, angle_sd })
}

/// Whether the changes of velocity (m/s) and spin (rad/s) are those of an impulse at a place relative to the centre (m).
fn acts_at(arm: [f64; 2], [vx, vy, spin]: [f64; 3], around: &AroundImpact) -> bool {
    if around.is_round() {
        return true;
    }
    let (mass, inertia) = around.body.mass_properties(None);
    let missing = arm[0] * vy - arm[1] * vx - inertia / mass * spin;
    missing.abs() <= MAX_MISSING_TORQUE * arm[0].hypot(arm[1]) * vx.hypot(vy)
}
