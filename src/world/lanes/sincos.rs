//! Sine and cosine of every lane's angle, with the same bits on every machine and instruction set.
//!
//! Range reduction by the nearest multiple of pi/2 (Cody and Waite 1980: pi/2 in three parts, of which two
//! have few enough digits that a few million multiples are exact), then the Taylor polynomials of both on
//! [-pi/4, pi/4] to full f64 precision.

use super::simd::{Register, Wide};

/// pi/2 as a sum of 33 bits, 33 bits, and the rest.
const HALF_PI_PARTS: [f64; 3] =
    [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21];
/// Adding and subtracting it rounds to an integer: 1.5 * 2^52.
const ROUNDING_SHIFT: f64 = 6_755_399_441_055_744.0;

/// (sine, cosine) of angles, rad: to two units in the last place up to a few million rad.
#[inline(always)]
pub fn sincos<R: Register, const N: usize>(angle: Wide<R, N>) -> (Wide<R, N>, Wide<R, N>) {
    let quarters = whole(angle * all(std::f64::consts::FRAC_2_PI));
    let x = angle
        - quarters * all(HALF_PI_PARTS[0])
        - quarters * all(HALF_PI_PARTS[1])
        - quarters * all(HALF_PI_PARTS[2]);
    let x2 = x * x;
    let (sine, cosine) = (x + x * x2 * series(x2, &SINE), series(x2, &COSINE) * x2 + all(1.0));
    // Quadrant, 0 to 3.
    let quarter = quarters - all(4.0) * whole(quarters * all(0.25) - all(0.375));
    let odd = all(0.5).less(quarter).and(quarter.less(all(1.5))).or(all(2.5).less(quarter));
    let (s, c) = (odd.select(cosine, sine), odd.select(sine, cosine));
    let turned = all(1.5).less(quarter);
    let beyond = all(0.5).less(quarter).and(quarter.less(all(2.5)));
    (turned.select(s.minus(), s), beyond.select(c.minus(), c))
}

#[inline(always)]
fn all<R: Register, const N: usize>(value: f64) -> Wide<R, N> {
    Wide::all(value)
}

/// The nearest integer.
#[inline(always)]
fn whole<R: Register, const N: usize>(x: Wide<R, N>) -> Wide<R, N> {
    (x + all(ROUNDING_SHIFT)) - all(ROUNDING_SHIFT)
}

/// Terms after the leading one: x^17 / 17! is below 1e-16 on [-pi/4, pi/4].
const TERMS: usize = 8;
/// -1/2!, 1/4!, ...
const COSINE: [f64; TERMS] = terms(0);
/// -1/3!, 1/5!, ...
const SINE: [f64; TERMS] = terms(1);

/// (-1)^k / (2 k + odd)! for k = 1, 2, ...
const fn terms(odd: usize) -> [f64; TERMS] {
    let (mut all, mut factorial, mut k) = ([0.0; TERMS], 1.0, 1);
    while k <= TERMS {
        let n = 2 * k + odd;
        factorial *= -((n - 1) as f64) * n as f64;
        all[k - 1] = 1.0 / factorial;
        k += 1;
    }
    all
}

/// Horner evaluation: the sum of each term times a power of x2.
#[inline(always)]
fn series<R: Register, const N: usize>(x2: Wide<R, N>, terms: &[f64; TERMS]) -> Wide<R, N> {
    let mut sum = Wide::all(terms[TERMS - 1]);
    for term in terms[..TERMS - 1].iter().rev() {
        sum = sum * x2 + Wide::all(*term);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::effect::LANES;

    #[test]
    fn matches_libm() {
        let mut angles: Vec<f64> = (-4000..4000).map(|i| f64::from(i) * 0.0123).collect();
        angles.extend((0..64).map(|i| f64::from(i) * std::f64::consts::FRAC_PI_4));
        angles.extend([1e3, -1e4, 123_456.789, -1e6]);
        angles.resize(angles.len().next_multiple_of(LANES), 0.0);
        for own in angles.chunks_exact(LANES) {
            let (mut s, mut c) = ([0.0; LANES], [0.0; LANES]);
            let (sine, cosine) = sincos::<f64, 8>(Wide::load(own.try_into().unwrap()));
            sine.store(&mut s);
            cosine.store(&mut c);
            for (l, angle) in own.iter().enumerate() {
                let (sin, cos) = libm::sincos(*angle);
                assert!(
                    (s[l] - sin).abs() < 4e-16 && (c[l] - cos).abs() < 4e-16,
                    "{angle}: {} {}",
                    s[l],
                    c[l]
                );
            }
        }
        let (s, c) = sincos::<f64, 8>(Wide::all(0.0));
        let (mut zero, mut one) = ([1.0; LANES], [0.0; LANES]);
        s.store(&mut zero);
        c.store(&mut one);
        assert_eq!((zero[0].to_bits(), one[0]), (0.0f64.to_bits(), 1.0));
    }
}
