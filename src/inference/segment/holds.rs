//! Rows in which a body is held: at rest in the air for longer than gravity allows, before a throw or after a
//! catch. They do not belong to a flight.

use crate::inference::data::smoothing::TimedPosition;
use crate::inference::statistics::median;

/// Minimum number of observations of a hold.
const MIN_OBSERVATIONS: usize = 5;
/// Multiples of the noise within which a body at rest stays, and beyond which gravity would have moved it.
const MAX_REST_DEVIATION: f64 = 4.0;
const MIN_FALL_DEVIATION: f64 = 8.0;

/// The rows among `from..to` in which a body under gravity `g`, m/s^2, is not held; none where it always is.
pub fn without_holds(rows: &[TimedPosition], (from, to): (usize, usize), g: f64) -> (usize, usize) {
    let noise = second_difference_noise(&rows[from..to]);
    if g <= 0.0 || noise <= 0.0 {
        return (from, to);
    }
    let forwards = held_count(rows[from..to].iter(), noise, g);
    let backwards = held_count(rows[from..to].iter().rev(), noise, g);
    let first = from + forwards;
    (first, first.max(to - backwards))
}

/// Number of the first rows in which the body is held.
fn held_count<'a>(rows: impl Iterator<Item = &'a TimedPosition>, noise: f64, g: f64) -> usize {
    let (mut count, mut sum, mut first, mut last) = (0usize, [0.0; 2], None, 0.0);
    for (time, observed) in rows {
        let mean = sum.map(|s| s / count.max(1) as f64);
        if count > 0 && (0..2).any(|axis| (observed[axis] - mean[axis]).abs() > MAX_REST_DEVIATION * noise) {
            break;
        }
        (0..2).for_each(|axis| sum[axis] += observed[axis]);
        count += 1;
        last = *time;
        first.get_or_insert(*time);
    }
    let duration = (last - first.unwrap_or(last)).abs();
    // A parabola leaves the line through its ends by g T^2 / 8.
    if count >= MIN_OBSERVATIONS && g * duration * duration / 8.0 > MIN_FALL_DEVIATION * noise {
        count
    } else {
        0
    }
}

/// Noise from second differences of the coordinate that moves least, m.
fn second_difference_noise(rows: &[TimedPosition]) -> f64 {
    let of = |axis: usize| {
        let second = rows.windows(3).map(|w| (w[0].1[axis] - 2.0 * w[1].1[axis] + w[2].1[axis]).abs());
        median(&second.collect::<Vec<_>>()) / (0.6745 * 6f64.sqrt())
    };
    let both = if rows.len() < 3 { [0.0; 2] } else { [of(0), of(1)] };
    both.into_iter().filter(|sd| *sd > 0.0).reduce(f64::min).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Thrown after 0.2 s in a hand, caught after 0.8 s, observed with noise of half a millimetre.
    #[test]
    fn holds_are_cut_off() {
        let at = |i: u32| {
            let t = 0.02 * f64::from(i);
            let flown = (t - 0.2).clamp(0.0, 0.6);
            let noise = |k: u32| 7e-4 * libm::sin(f64::from(k * k + k));
            (t, [3.0 * flown + noise(3 * i), 1.0 + 3.0 * flown - 4.905 * flown * flown + noise(3 * i + 1)])
        };
        let rows: Vec<TimedPosition> = (0..50).map(at).collect();
        let (from, to) = without_holds(&rows, (0, 50), 9.81);
        assert!((10..13).contains(&from) && (38..42).contains(&to), "{from} {to}");
        assert_eq!(without_holds(&rows, (12, 38), 9.81), (12, 38), "a flight is none");
        assert_eq!(without_holds(&rows[..10], (0, 10), 100.0), (10, 10), "never released");
        assert_eq!(without_holds(&rows, (0, 50), 0.0), (0, 50), "without gravity anything may rest");
    }
}
