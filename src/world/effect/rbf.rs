//! Gaussian radial basis functions, f = exp(-(d1^2 + d2^2) / 2) of distances d in widths, the basis of
//! empirical force fields.
//!
//! Source: radial basis functions (Broomhead and Lowe, Complex Systems 2 (1988) 321). A sum of Gaussians on a
//! grid with spacing equal to their width approximates any smooth function, and each vanishes a few widths away: unlike
//! polynomials they do not extrapolate. A diagnosis fits such a sum (`inference::field`) and writes it as
//! effects.
//!
//! Differences from the source: widths differ by axis, and the functions are not normalised to sum to 1.

use super::vectorize::map_lanes;
use super::{ConstantLanes, LANES, ParameterDeclaration, ShapeParameter, amplitude, parameter, shape};

/// The Gaussian at distances in widths.
#[inline(always)]
pub fn gaussian([a, b]: [f64; 2]) -> f64 {
    exp_down(0.5 * (a * a + b * b))
}

/// [`gaussian`] in every lane; the same bits.
pub fn gaussian_lanes(a: &[f64; LANES], b: &[f64; LANES]) -> [f64; LANES] {
    map_lanes(|lane| gaussian([a[lane], b[lane]]))
}

/// The Gaussian of constants 2 to 5 (its centre, and the inverse of its widths), at a pair of coordinates in
/// every lane.
pub fn gaussian_of_pair(constants: &ConstantLanes, [a, b]: [&[f64; LANES]; 2]) -> [f64; LANES] {
    let [_, _, u, v, per_wu, per_wv, ..] = constants;
    map_lanes(|l| gaussian([(a[l] - u[l]) * per_wu[l], (b[l] - v[l]) * per_wv[l]]))
}

/// Argument from which the exponential is 0.
const MAX_EXPONENT: f64 = 700.0;
/// Adding it to a number rounds it to an integer, whose bits are the last of the sum.
const ROUNDING_SHIFT: f64 = 6_755_399_441_055_744.0;
/// ln 2 in two parts, the first short enough for its multiples to be exact.
const LN_2: [f64; 2] = [0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10];
/// Inverse factorials in decreasing order of the factorial.
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

/// exp(-u) for u >= 0, to a relative error of 1e-15, without branches so that compilers vectorise it; 0 from
/// [`MAX_EXPONENT`].
#[inline(always)]
fn exp_down(u: f64) -> f64 {
    let rounded = u * std::f64::consts::LOG2_E + ROUNDING_SHIFT;
    let whole = rounded - ROUNDING_SHIFT;
    let rest = (u - whole * LN_2[0]) - whole * LN_2[1];
    // A plain loop, which compilers vectorise; an iterator's `reduce` is not.
    let mut power = TAYLOR[0];
    for next in &TAYLOR[1..] {
        power = next - rest * power;
    }
    // 2 to the power of minus the integer part.
    let scale = f64::from_bits(1023u64.wrapping_sub(rounded.to_bits() & 0xfff) << 52);
    if u >= MAX_EXPONENT { 0.0 } else { power * scale }
}

/// Amplitude of a Gaussian, an acceleration, m/s^2.
pub(super) const fn height(name: &'static str) -> ParameterDeclaration {
    parameter(name, "m/s^2", [-1e3, 1e3], amplitude(1.0, 2.0, 1e-2))
}

/// Centre of a Gaussian, in a unit.
pub(super) const fn centre(
    name: &'static str,
    unit: &'static str,
    of: ShapeParameter,
) -> ParameterDeclaration {
    parameter(name, unit, [-1e5, 1e5], shape(of, 10.0, 2e-3))
}

/// Width of a Gaussian, in the unit of its centre.
pub(super) const fn width(name: &'static str, unit: &'static str) -> ParameterDeclaration {
    parameter(name, unit, [1e-4, 1e5], shape(ShapeParameter::Width, 1.0, 2e-3).neutral_at(1.0))
}

#[cfg(test)]
mod tests {
    use super::{exp_down, gaussian};

    /// Against the exponential of libm.
    #[test]
    fn matches_libm_exponential() {
        for i in 0..200_000 {
            let u = 699.9 * (f64::from(i) / 200_000.0).powi(3);
            let wanted = libm::exp(-u);
            assert!((exp_down(u) / wanted - 1.0).abs() < 2e-15, "{u}: {} for {wanted}", exp_down(u));
        }
        assert_eq!((exp_down(0.0), exp_down(f64::INFINITY)), (1.0, 0.0));
        assert!(exp_down(f64::NAN).is_nan());
    }

    #[test]
    fn gaussian_is_maximal_at_its_centre_and_round() {
        assert_eq!(gaussian([0.0, 0.0]), 1.0);
        assert!((gaussian([1.0, 0.0]) - 0.606_530_659_712_633_4).abs() < 1e-15);
        assert!((gaussian([0.6, -0.8]) - gaussian([0.0, 1.0])).abs() < 1e-15);
        assert_eq!(gaussian([1e200, 0.0]), 0.0);
    }
}
