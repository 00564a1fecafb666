//! Films whose frame rate was converted by repeating pictures: every third to tenth picture shows the same as the one before.
//!
//! A repeat looks like a body that stops for one picture. Repeats are left out, and the other pictures spaced evenly, as they were
//! taken.

/// A picture: time, s, and position in any unit.
pub type Picture = (f64, [f64; 2]);

/// Periods of repeats that are looked for, pictures.
const PERIODS: std::ops::RangeInclusive<usize> = 3..=10;
/// Movement below which a picture repeats the one before, as a share of the typical movement of a moving body: this quantile of
/// all movements, since the body may rest for half of the film.
const STILL: f64 = 0.05;
const MOVING_QUANTILE: f64 = 0.75;
/// Minimum number of repeats that follow another one after a period, and their minimum share of all repeats of a moving body.
const MIN_REPEATS: usize = 6;
const MIN_SHARE: f64 = 0.6;
/// Largest deviation of the times from equal steps, as a share of a step.
const MAX_UNEVENNESS: f64 = 0.05;

/// A film without its repeats.
#[derive(Debug, PartialEq)]
pub struct WithoutRepeats {
    /// Indices of the pictures that are kept, with their new times, s.
    pub kept: Vec<(usize, f64)>,
    /// Number of pictures after which one repeats.
    pub period: usize,
}

/// The pictures of a film without periodic repeats; `None` if there are none.
pub fn without_repeats(pictures: &[Picture]) -> Option<WithoutRepeats> {
    let n = pictures.len();
    if n < 2 * MIN_REPEATS {
        return None;
    }
    let step = (pictures[n - 1].0 - pictures[0].0) / (n - 1) as f64;
    let is_even = |i: usize| (pictures[i].0 - pictures[0].0 - i as f64 * step).abs() < MAX_UNEVENNESS * step;
    if !(0..n).all(is_even) {
        return None;
    }
    let moved = |i: usize| {
        let ([x, y], [a, b]) = (pictures[i].1, pictures[i - 1].1);
        (x - a).hypot(y - b)
    };
    let mut sizes: Vec<f64> = (1..n).map(moved).filter(|m| *m > 0.0).collect();
    sizes.sort_by(f64::total_cmp);
    let still = STILL * sizes.get((MOVING_QUANTILE * sizes.len() as f64) as usize)?;
    let repeats = |i: usize| moved(i) <= still;
    // Of a body that moves before and after.
    let isolated: Vec<usize> =
        (2..n - 1).filter(|i| repeats(*i) && !repeats(i - 1) && !repeats(i + 1)).collect();
    let followed = |period: usize| isolated.iter().filter(|i| isolated.contains(&(*i + period))).count();
    let period = PERIODS.max_by_key(|p| (followed(*p), usize::MAX - p))?;
    let count = followed(period);
    if count < MIN_REPEATS || (count as f64) < MIN_SHARE * isolated.len() as f64 {
        return None;
    }
    // A repeat that was measured as movement lies a multiple of the period from its neighbour.
    let periodic: Vec<usize> = (isolated.iter().copied())
        .filter(|i| {
            isolated.contains(&(i + period)) || i.checked_sub(period).is_some_and(|k| isolated.contains(&k))
        })
        .collect();
    let is_dropped = |i: usize| {
        let near = periodic.iter().rev().find(|k| **k <= i).or(periodic.first());
        near.is_some_and(|k| i.abs_diff(*k).is_multiple_of(period))
    };
    let taken = step * period as f64 / (period - 1) as f64;
    let kept = (0..n).filter(|i| !is_dropped(*i)).enumerate();
    Some(WithoutRepeats { kept: kept.map(|(k, i)| (i, pictures[0].0 + k as f64 * taken)).collect(), period })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bouncing ball in pixels; every fifth picture repeats, but for a false detection.
    fn film(period: usize) -> Vec<Picture> {
        let mut out: Vec<Picture> = Vec::new();
        let mut taken = 0;
        for i in 0..100usize {
            let t = taken as f64 / 20.0;
            let height = 400.0 * (libm::sin(3.0 * t)).abs();
            out.push((i as f64 / 25.0, [2.0 * (50.0 * t).round(), height.round()]));
            taken += usize::from(period == 0 || i % period != 0);
        }
        out[60].1 = [17.0, 900.0];
        out
    }

    #[test]
    fn periodic_repeats_are_left_out() {
        let found = without_repeats(&film(5)).expect("every fifth picture repeats");
        assert_eq!((found.period, found.kept.len()), (5, 80));
        let times: Vec<f64> = found.kept.iter().map(|k| k.1).collect();
        assert!(times.windows(2).all(|w| (w[1] - w[0] - 0.05).abs() < 1e-12), "twenty a second");
        assert_eq!(without_repeats(&film(0)), None);
    }

    /// A ball that is tracked to a pixel while it rests, before and after it moves.
    #[test]
    fn repeats_are_found_in_a_film_of_long_rests() {
        let mut pictures = film(5);
        let rest = |k: usize| [pictures[0].1[0] + (k / 2 % 2) as f64, pictures[0].1[1]];
        let rests: Vec<[f64; 2]> = (0..120).map(rest).collect();
        let positions: Vec<[f64; 2]> = rests.into_iter().chain(pictures.iter().map(|p| p.1)).collect();
        pictures = positions.into_iter().enumerate().map(|(i, p)| (i as f64 / 25.0, p)).collect();
        assert_eq!(without_repeats(&pictures).map(|found| found.period), Some(5));
    }

    /// A body that rests now and then does not repeat pictures.
    #[test]
    fn rests_are_no_repeats() {
        let rests = |i: i32| (f64::from(i) / 25.0, [f64::from((i / 10) * 7 + (i % 10).min(6)), 3.0]);
        assert_eq!(without_repeats(&(0..100).map(rests).collect::<Vec<_>>()), None);
    }
}
