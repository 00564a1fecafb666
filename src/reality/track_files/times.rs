//! Times of a trial's rows.

use super::track_rows::{TrackRow, invalid_value};
use crate::error::Result;
use crate::line_fit::LineFit;

/// How the times of rows are given.
#[derive(Clone, Copy, Debug)]
pub enum TrackClock {
    /// A column of times or frame numbers, and the size of its unit, s.
    Column(usize, f64),
    /// A column of times since the row above, and the size of its unit, s.
    Intervals(usize, f64),
    /// One row per frame, of this duration, s.
    Rows(f64),
}

impl TrackClock {
    /// The column, if there is one, and the size of its unit, s.
    pub fn column(self) -> Option<(usize, f64)> {
        match self {
            TrackClock::Column(i, seconds) | TrackClock::Intervals(i, seconds) => Some((i, seconds)),
            TrackClock::Rows(_) => None,
        }
    }

    /// Replaces what the rows of a trial state by times, s; those of its first row for intervals and frames are as good as any
    /// other.
    pub fn complete(self, trial: &mut [TrackRow]) {
        match self {
            TrackClock::Column(..) => {}
            TrackClock::Intervals(..) => {
                let mut t = 0.0;
                for (i, row) in trial.iter_mut().enumerate() {
                    t += if i == 0 { 0.0 } else { row.t };
                    row.t = t;
                }
            }
            TrackClock::Rows(seconds) => {
                trial.iter_mut().enumerate().for_each(|(i, row)| row.t = i as f64 * seconds)
            }
        }
    }
}

/// Largest rounding of times, relative to the step between them, that is left alone.
const NEGLIGIBLE_ROUNDING: f64 = 0.01;
/// Largest deviation of rounded times from equal steps, relative to the last decimal place. Rounding alone gives 0.5; the fitted
/// step adds a little.
const MAX_ROUNDING_DEVIATION: f64 = 0.6;
/// Deviation from equal steps, relative to the last decimal place, below which times are exact.
const EXACT: f64 = 1e-6;
/// Largest number of missing frames that is looked for.
const MAX_MISSING_FRAMES: usize = 50;
/// Smallest step, relative to the last decimal place, with which missing frames can be told from rounding.
const MIN_STEP_WITH_GAPS: f64 = 2.0;
/// Smallest number of rows whose step can be found.
const MIN_ROWS: usize = 5;

/// Undoes the rounding of a camera's times: if they are equal steps (with missing frames, where those are visible) rounded to
/// `place`, s, the rows take the equal steps. Returns the step, s.
pub fn undo_rounding(trial: &mut [TrackRow], place: f64) -> Option<f64> {
    let n = trial.len();
    let times: Vec<f64> = trial.iter().map(|r| r.t).collect();
    if n < MIN_ROWS || times.windows(2).any(|w| w[1] < w[0]) {
        return None;
    }
    let duration = times[n - 1] - times[0];
    let mean_step = duration / (n - 1) as f64;
    if place <= NEGLIGIBLE_ROUNDING * mean_step {
        return None;
    }
    (0..=MAX_MISSING_FRAMES).find_map(|missing| {
        let step = duration / (n - 1 + missing) as f64;
        if missing > 0 && step < MIN_STEP_WITH_GAPS * place {
            return None;
        }
        let frame = |i: usize| if missing == 0 { i as f64 } else { ((times[i] - times[0]) / step).round() };
        let frames: Vec<f64> = (0..n).map(frame).collect();
        if frames.windows(2).any(|w| w[1] <= w[0]) {
            return None;
        }
        let points: Vec<(f64, f64)> = frames.iter().copied().zip(times.iter().copied()).collect();
        let LineFit { intercept: start, slope: step, .. } = LineFit::new(&points);
        let fitted = |i: usize| start + step * frames[i];
        let largest = (0..n).map(|i| (times[i] - fitted(i)).abs()).fold(0.0, f64::max);
        let is_rounded = (EXACT * place..=MAX_ROUNDING_DEVIATION * place).contains(&largest);
        is_rounded.then(|| {
            (0..n).for_each(|i| trial[i].t = fitted(i));
            step
        })
    })
}

/// Size of the last decimal place of a number as written, in its unit; 0 with an exponent.
pub fn last_place(cell: &str) -> f64 {
    let cell = cell.trim();
    if cell.contains(['e', 'E']) {
        return 0.0;
    }
    let decimals = cell.split_once(['.', ',']).map_or(0, |(_, digits)| digits.len());
    10f64.powi(-(decimals as i32))
}

/// Errors unless the times of a trial increase.
pub fn check_increasing(trial: &[TrackRow], clock: &str) -> Result<()> {
    match trial.windows(2).find(|w| w[1].t <= w[0].t) {
        None => Ok(()),
        Some(w) => {
            let allowed = format!("a time after {} s; one trial a file, or a column `trial`", w[0].t);
            Err(invalid_value(w[1].line, clock, &format!("{} s", w[1].t), &allowed))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(times: impl IntoIterator<Item = f64>) -> Vec<TrackRow> {
        let row = |t| TrackRow {
            line: 1,
            trial: String::new(),
            setting: None,
            body: String::new(),
            t,
            values: [0.0; 6],
        };
        times.into_iter().map(row).collect()
    }

    #[test]
    fn undoes_rounding_of_equal_steps() {
        let rounded = |t: f64| (t * 100.0).round() / 100.0;
        let truncated = |t: f64| (t * 100.0).floor() / 100.0;
        for round in [rounded, truncated] {
            for rate in [24.0, 29.97, 60.0, 120.0, 240.0] {
                let mut trial = rows((0..40).map(|i| round(f64::from(i) / rate)));
                let step = undo_rounding(&mut trial, 0.01).unwrap_or_else(|| panic!("{rate}"));
                assert!((step * rate - 1.0).abs() < 0.02, "{rate}: {step}");
                check_increasing(&trial, "t").unwrap();
                let far =
                    (0..40).map(|i| (trial[i].t - trial[0].t - i as f64 / rate).abs()).fold(0.0, f64::max);
                assert!(far < 0.005, "{rate}: {far}");
            }
        }
        // Missing frames.
        let mut trial = rows((0..40).filter(|i| i % 9 != 4).map(|i| rounded(f64::from(i) / 30.0)));
        let step = undo_rounding(&mut trial, 0.01).unwrap();
        assert!((step * 30.0 - 1.0).abs() < 1e-3, "{step}");
    }

    #[test]
    fn keeps_times_that_are_not_rounded_steps() {
        let drifting = rows(
            (0..40)
                .map(|i| (f64::from(i) / 30.0 + 1e-4 * f64::from(i * i)) * 100.0)
                .map(|t| t.round() / 100.0),
        );
        let exact = rows((0..40).map(|i| f64::from(i) / 30.0));
        for (trial, place) in [(drifting, 0.01), (exact, 1e-6)] {
            let before: Vec<f64> = trial.iter().map(|r| r.t).collect();
            let mut trial = trial;
            assert_eq!(undo_rounding(&mut trial, place), None);
            assert_eq!(before, trial.iter().map(|r| r.t).collect::<Vec<_>>());
        }
    }

    #[test]
    fn counts_rows_and_adds_intervals() {
        let times = |clock: TrackClock| {
            let mut trial = rows([0.25, 0.5, 0.5]);
            clock.complete(&mut trial);
            trial.iter().map(|r| r.t).collect::<Vec<_>>()
        };
        assert_eq!(times(TrackClock::Rows(0.5)), [0.0, 0.5, 1.0]);
        assert_eq!(times(TrackClock::Intervals(0, 1.0)), [0.0, 0.5, 1.0]);
        assert_eq!(times(TrackClock::Column(0, 1.0)), [0.25, 0.5, 0.5]);
        assert_eq!((last_place("0.010"), last_place("3"), last_place("1e-3")), (1e-3, 1.0, 0.0));
    }
}
