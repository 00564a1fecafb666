//! Where two outlines touch: rounded corners and straight sides that turn with their bodies.

use crate::task::geometry::dot;

/// A vector fixed to a body that turns steadily.
#[derive(Clone, Copy, Debug, Default)]
pub struct TurningVector {
    /// At the segment's start, m.
    pub at_start: [f64; 2],
    /// rad/s
    pub rate: f64,
}

impl TurningVector {
    /// The vector at a time since the segment's start, s.
    pub fn at(&self, time: f64) -> [f64; 2] {
        // A disc's centre, and sides that do not turn.
        if self.rate == 0.0 || self.at_start == [0.0; 2] {
            return self.at_start;
        }
        let (sin, cos) = libm::sincos(self.rate * time);
        let [x, y] = self.at_start;
        [cos * x - sin * y, sin * x + cos * y]
    }

    /// The vector turned by an angle, rad.
    pub fn turned_by(&self, angle: f64) -> TurningVector {
        let turned = TurningVector { rate: 1.0, ..*self }.at(angle);
        TurningVector { at_start: turned, ..*self }
    }

    /// Its derivative at a time since the segment's start (s), m/s.
    pub fn velocity_at(&self, time: f64) -> [f64; 2] {
        let [x, y] = self.at(time);
        [-self.rate * y, self.rate * x]
    }
}

/// A corner, rounded with a radius (m), at a place relative to the body's centre. A disc is one corner at its centre.
#[derive(Clone, Copy, Debug, Default)]
pub struct RoundedCorner {
    pub place: TurningVector,
    pub radius: f64,
}

/// The part of an outline that touches another one.
#[derive(Clone, Copy, Debug)]
pub enum ContactFeature {
    Corner(RoundedCorner),
    /// A side with a unit normal outwards at a distance (m) from the body's centre.
    Side {
        normal: TurningVector,
        distance: f64,
    },
}

/// The gap between two bodies and the geometry of their contact.
#[derive(Clone, Copy, Debug)]
pub struct ContactGap {
    /// m
    pub gap: f64,
    /// Unit normal from the second body to the first.
    pub normal: [f64; 2],
    /// Contact point relative to each body's centre, m.
    pub arms: [[f64; 2]; 2],
}

/// The gap between two features of bodies at some positions (m) at a time since the segment's start (s), less an `excess` (m).
/// Two sides do not touch in one point: their gap is infinite.
pub fn contact_gap(
    features: &[ContactFeature; 2],
    time: f64,
    [a, b]: [[f64; 2]; 2],
    excess: f64,
) -> ContactGap {
    use ContactFeature::{Corner as C, Side};
    let between = [a[0] - b[0], a[1] - b[1]];
    match features {
        [C(first), C(second)] => {
            let [p, q] = [first.place.at(time), second.place.at(time)];
            let d = [between[0] + p[0] - q[0], between[1] + p[1] - q[1]];
            let length = d[0].hypot(d[1]);
            let normal = d.map(|d| d / length.max(f64::MIN_POSITIVE));
            let arms = [shifted(p, normal, -first.radius), shifted(q, normal, second.radius)];
            ContactGap { gap: length - (first.radius + second.radius + excess), normal, arms }
        }
        [C(corner), Side { normal, distance }] => {
            let (place, normal) = (corner.place.at(time), normal.at(time));
            let gap = dot(between, normal) + dot(place, normal) - (distance + corner.radius + excess);
            let arm = shifted(place, normal, -corner.radius);
            ContactGap { gap, normal, arms: [arm, [between[0] + arm[0], between[1] + arm[1]]] }
        }
        [Side { .. }, C(_)] => {
            let swapped = contact_gap(&[features[1], features[0]], time, [b, a], excess);
            let [second, first] = swapped.arms;
            ContactGap { normal: swapped.normal.map(|n| -n), arms: [first, second], ..swapped }
        }
        [Side { .. }, Side { .. }] => {
            ContactGap { gap: f64::INFINITY, normal: [0.0, 1.0], arms: [[0.0; 2]; 2] }
        }
    }
}

impl RoundedCorner {
    /// The corner of a body turned by an angle, rad.
    pub fn turned_by(&self, angle: f64) -> RoundedCorner {
        RoundedCorner { place: self.place.turned_by(angle), ..*self }
    }
}

impl ContactFeature {
    /// The feature of a body turned by an angle, rad.
    pub fn turned_by(&self, angle: f64) -> ContactFeature {
        match self {
            ContactFeature::Corner(corner) => ContactFeature::Corner(corner.turned_by(angle)),
            ContactFeature::Side { normal, distance } => {
                ContactFeature::Side { normal: normal.turned_by(angle), distance: *distance }
            }
        }
    }

    /// Turning rate of the body, rad/s; 0 for a disc.
    pub fn rate(&self) -> f64 {
        match self {
            ContactFeature::Corner(corner) => corner.place.rate,
            ContactFeature::Side { normal, .. } => normal.rate,
        }
    }
}

fn shifted(place: [f64; 2], by: [f64; 2], size: f64) -> [f64; 2] {
    [place[0] + size * by[0], place[1] + size * by[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vector(at_start: [f64; 2], rate: f64) -> TurningVector {
        TurningVector { at_start, rate }
    }

    /// A corner at (1, 0) that turns a quarter in 1 s meets a side that faces down at a height of 3 m.
    #[test]
    fn corners_turn_towards_sides() {
        let corner = ContactFeature::Corner(RoundedCorner {
            place: vector([1.0, 0.0], std::f64::consts::FRAC_PI_2),
            radius: 0.25,
        });
        let side = ContactFeature::Side { normal: vector([0.0, -1.0], 0.0), distance: 0.5 };
        for (features, positions, sign) in [
            ([corner, side], [[0.0, 0.0], [0.0, 3.5]], 1.0),
            ([side, corner], [[0.0, 3.5], [0.0, 0.0]], -1.0),
        ] {
            let at = |time| contact_gap(&features, time, positions, 0.0);
            assert!((at(0.0).gap - 2.75).abs() < 1e-12 && (at(1.0).gap - 1.75).abs() < 1e-12);
            let own = if sign > 0.0 { 0 } else { 1 };
            let met = at(1.0);
            assert!((met.normal[1] + sign).abs() < 1e-12, "{met:?}");
            assert!(
                (met.arms[own][1] - 1.25).abs() < 1e-12 && (met.arms[1 - own][1] + 2.25).abs() < 1e-12,
                "{met:?}"
            );
        }
    }

    #[test]
    fn discs_touch_on_the_line_of_their_centres() {
        let disc = |radius| ContactFeature::Corner(RoundedCorner { place: TurningVector::default(), radius });
        let met = contact_gap(&[disc(1.0), disc(2.0)], 7.0, [[0.0, 0.0], [3.0, 4.0]], 0.0);
        assert!((met.gap - 2.0).abs() < 1e-12, "{met:?}");
        assert!((met.arms[0][0] - 0.6).abs() < 1e-12 && (met.arms[1][1] + 1.6).abs() < 1e-12, "{met:?}");
    }
}
