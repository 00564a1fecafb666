//! Gaussian bumps, f = exp(-(d1^2 + d2^2) / 2), by distances d in widths: what forces without a name are made of.
//!
//! Source: radial basis functions (Broomhead and Lowe, Complex Systems 2 (1988) 321). A sum of bumps on a grid as wide as it
//! is spaced comes as near as one likes to any smooth function, and each is nothing a few widths away: unlike powers they
//! say nothing of where no data were. A diagnosis fits such a sum (`discover::field`) and writes it down as effects.
//!
//! Differences from the source: widths differ by axis, and bumps are not normalised to sum to 1.

use super::wide::lanes;
use super::{LANES, MOST_PARAMETERS, Parameter, Shape, amplitude, shape};

/// A bump at distances in widths.
#[inline(always)]
pub fn bump([a, b]: [f64; 2]) -> f64 {
    exp_down(0.5 * (a * a + b * b))
}

/// [`bump`] in every lane; the same bits.
pub fn bumps(a: &[f64; LANES], b: &[f64; LANES]) -> [f64; LANES] {
    lanes(|lane| bump([a[lane], b[lane]]))
}

/// The bump that effects' constants 2 to 5 are of (its middle, and one over its widths), at a pair of numbers of every lane.
pub fn near(constants: &[[f64; LANES]; MOST_PARAMETERS], [a, b]: [&[f64; LANES]; 2]) -> [f64; LANES] {
    let [_, _, u, v, per_wu, per_wv, ..] = constants;
    lanes(|l| bump([(a[l] - u[l]) * per_wu[l], (b[l] - v[l]) * per_wv[l]]))
}

/// Where an exponential is nothing.
const NOTHING: f64 = 700.0;
/// Added to a number, it rounds it to a whole one, whose bits are then the last of the sum.
const ROUNDS: f64 = 6_755_399_441_055_744.0;
/// ln 2 in two pieces, the first short enough for its multiples to be exact.
const LN_2: [f64; 2] = [0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10];
/// Inverse factorials, the highest first.
const TAYLOR: [f64; 14] = [
    1.0 / 6_227_020_800.0,
    1.0 / 479_001_600.0,
    1.0 / 39_916_800.0,
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5_040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    0.5,
    1.0,
    1.0,
];

/// exp(-u) for u of at least 0, to 1e-15 of it, without branches, so that compilers advance many at once; 0 beyond [`NOTHING`].
#[inline(always)]
fn exp_down(u: f64) -> f64 {
    let rounded = u * std::f64::consts::LOG2_E + ROUNDS;
    let whole = rounded - ROUNDS;
    let rest = (u - whole * LN_2[0]) - whole * LN_2[1];
    // A loop that compilers see through: over an iterator's `reduce` they work lane by lane.
    let mut power = TAYLOR[0];
    for next in &TAYLOR[1..] {
        power = next - rest * power;
    }
    // 2 to the power of minus the whole number.
    let scale = f64::from_bits(1023u64.wrapping_sub(rounded.to_bits() & 0xfff) << 52);
    if u >= NOTHING { 0.0 } else { power * scale }
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
    use super::{bump, exp_down};

    /// Against the exponential of a library.
    #[test]
    fn powers_are_those_of_e() {
        for i in 0..200_000 {
            let u = 699.9 * (f64::from(i) / 200_000.0).powi(3);
            let wanted = libm::exp(-u);
            assert!((exp_down(u) / wanted - 1.0).abs() < 2e-15, "{u}: {} for {wanted}", exp_down(u));
        }
        assert_eq!((exp_down(0.0), exp_down(f64::INFINITY)), (1.0, 0.0));
        assert!(exp_down(f64::NAN).is_nan());
    }

    #[test]
    fn a_bump_is_highest_at_its_centre_and_round() {
        assert_eq!(bump([0.0, 0.0]), 1.0);
        assert!((bump([1.0, 0.0]) - 0.606_530_659_712_633_4).abs() < 1e-15);
        assert!((bump([0.6, -0.8]) - bump([0.0, 1.0])).abs() < 1e-15);
        assert_eq!(bump([1e200, 0.0]), 0.0);
    }
}
