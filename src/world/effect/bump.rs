//! Gaussian bumps, f = exp(-(d1^2 + d2^2) / 2), by distances d in widths: what forces without a name are made of.
//!
//! Source: radial basis functions (Broomhead and Lowe, Complex Systems 2 (1988) 321). A sum of bumps on a grid as wide as it
//! is spaced comes as near as one likes to any smooth function, and each is nothing a few widths away: unlike powers they
//! say nothing of where no data were. A diagnosis fits such a sum (`discover::field`) and writes it down as effects.
//!
//! Differences from the source: widths differ by axis, and bumps are not normalised to sum to 1.

use super::{Parameter, Shape, amplitude, shape};

/// A bump at distances in widths.
pub fn bump([a, b]: [f64; 2]) -> f64 {
    libm::exp(-0.5 * (a * a + b * b))
}

/// An acceleration at the top of a bump, m/s^2.
pub(super) const fn height(name: &'static str) -> Parameter {
    Parameter { name, unit: "m/s^2", bounds: [-1e3, 1e3], ..amplitude(1.0, 2.0, 1e-2) }
}

/// Where a bump stands, in a unit.
pub(super) const fn centre(name: &'static str, unit: &'static str, what: Shape) -> Parameter {
    Parameter { name, unit, bounds: [-1e5, 1e5], ..shape(what, 10.0, 2e-3) }
}

/// How wide it is, in the unit of where it stands.
pub(super) const fn width(name: &'static str, unit: &'static str) -> Parameter {
    Parameter { name, unit, bounds: [1e-4, 1e5], neutral: 1.0, ..shape(Shape::Width, 1.0, 2e-3) }
}

#[cfg(test)]
mod tests {
    use super::bump;

    #[test]
    fn a_bump_is_highest_at_its_centre_and_round() {
        assert_eq!(bump([0.0, 0.0]), 1.0);
        assert!((bump([1.0, 0.0]) - 0.606_530_659_712_633_4).abs() < 1e-15);
        assert!((bump([0.6, -0.8]) - bump([0.0, 1.0])).abs() < 1e-15);
        assert_eq!(bump([1e200, 0.0]), 0.0);
    }
}
