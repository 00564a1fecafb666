//! The floor that a ball bounces off or rolls on: found from the tracks, or checked against them.
//!
//! Without a floor, bounces would be explained by spurious forces. The centre's height at a bounce is where the parabolas
//! before and after it cross, which is closer than the samples are.

use super::track_rows::TrialPoints;
use crate::error::{Error, Result};

/// The height of a floor.
pub struct FloorEstimate {
    /// m
    pub height: f64,
    /// How it was found.
    pub evidence: String,
}

/// Minimum upward change of velocity in a bounce: as a multiple of the change due to gravity, and in m/s.
const MIN_BOUNCE_VELOCITY_CHANGE: [f64; 2] = [5.0, 0.5];
/// Minimum upward change of velocity in a bounce, as a multiple of noise over the duration of the turn. The standard error of the
/// change is five times that ratio, and many samples are tested.
const MIN_BOUNCE_NOISE_MULTIPLE: f64 = 25.0;
/// Tolerance of the floor's height, m.
const FLOOR_TOLERANCE_M: f64 = 0.02;
/// Number of points of each parabola beside a bounce, and the least number.
const FLIGHT_POINTS: [usize; 2] = [8, 3];
/// Share of trials that must bounce off a floor or roll on it; a single bounce may be a tracking error.
const MIN_SHARE: f64 = 0.1;
/// Largest median deviation of the heights of bounces off one floor, m.
const MAX_FLOOR_DEVIATION_M: f64 = 0.01;
/// Time, s, over which a supported ball keeps its height, and how much it may change, relative to a free fall.
const SUPPORTED: (f64, f64) = (0.1, 0.05);

/// The floor that a ball of this radius bounces off or rolls on; `None` if it does neither. Bounces at different heights are an
/// error.
pub fn find_floor(trials: &[TrialPoints], radius: f64, gravity: f64) -> Result<Option<FloorEstimate>> {
    let all: Vec<Vec<BounceEstimate>> = trials.iter().map(|t| bounces(t, gravity)).collect();
    let bouncing = all.iter().filter(|b| !b.is_empty()).count();
    let bounces: Vec<&BounceEstimate> = all.iter().flatten().collect();
    if bounces.len() < 2 || bouncing as f64 <= MIN_SHARE * trials.len() as f64 {
        return Ok(supported(trials, gravity).map(|centre| FloorEstimate {
            height: centre - radius,
            evidence: "the ball keeps this height although nothing else holds it".into(),
        }));
    }
    let centre = median(bounces.iter().map(|b| b.centre).collect());
    let deviation = median(bounces.iter().map(|b| (b.centre - centre).abs()).collect());
    if deviation > MAX_FLOOR_DEVIATION_M {
        let first = bounces[0];
        let value = format!(
            "missing: {bouncing} of {} trials turn upwards sharply (first {:?} at {:.3} s), at heights that differ by {:.0} mm",
            trials.len(),
            first.trial,
            first.time,
            1e3 * deviation
        );
        let allowed =
            "the height of what they bounce off; a scene, if it is not level; or tracks that end before";
        return Err(Error::input("floor", value, allowed));
    }
    let evidence = format!(
        "where {} bounces of {bouncing} trials cross, less the radius; median deviation {:.1} mm",
        bounces.len(),
        1e3 * deviation
    );
    Ok(Some(FloorEstimate { height: centre - radius, evidence }))
}

/// Remark on a bounce, if there are too few for a floor.
pub fn remark_on_bounce(trials: &[TrialPoints], gravity: f64) -> Option<String> {
    let found = trials.iter().flat_map(|t| bounces(t, gravity)).next()?;
    Some(format!(
        "trial {:?} turns upwards sharply at {:.3} s; if it bounces, give `floor`, the height of what it bounces off",
        found.trial, found.time
    ))
}

/// Checks a given floor: the ball must not be below it, and must bounce off it, not far above.
pub fn check_floor(trials: &[TrialPoints], radius: f64, height: f64, gravity: f64) -> Result<()> {
    let mut heights: Vec<f64> = trials.iter().flat_map(|t| &t.points).map(|p| p[2]).collect();
    heights.sort_by(f64::total_cmp);
    // Robust against two outliers.
    let lowest = heights.get(2).copied().unwrap_or(f64::INFINITY);
    if lowest < height {
        let allowed = format!("a height below the ball's centre, which comes down to {lowest:.4} m");
        return Err(Error::input("floor", height, allowed));
    }
    let first: Vec<BounceEstimate> =
        trials.iter().filter_map(|t| bounces(t, gravity).into_iter().next()).collect();
    let beyond = |b: &BounceEstimate| b.centre > height + FLOOR_TOLERANCE_M + 2.0 * radius;
    if first.len() > 1 && first.iter().all(beyond) {
        let least = first.iter().map(|b| b.centre).fold(f64::INFINITY, f64::min);
        let allowed = format!(
            "the height of what the ball bounces off: {} of {} trials bounce, with the centre at {least:.3} m or above",
            first.len(),
            trials.len()
        );
        return Err(Error::input("floor", height, allowed));
    }
    Ok(())
}

/// A sharp upward turn of a path.
struct BounceEstimate {
    trial: String,
    /// Time, s.
    time: f64,
    /// Height of the centre, m.
    centre: f64,
}

/// The bounces of a trial.
fn bounces(trial: &TrialPoints, gravity: f64) -> Vec<BounceEstimate> {
    let points = &trial.points;
    let noise = noise(points);
    let speed = |a: usize, b: usize| (points[b][2] - points[a][2]) / (points[b][0] - points[a][0]);
    let mut found = Vec::new();
    let mut i = 0;
    while i + 7 <= points.len() {
        let time = points[i + 6][0] - points[i][0];
        let least = (MIN_BOUNCE_VELOCITY_CHANGE[0] * gravity * time)
            .max(MIN_BOUNCE_VELOCITY_CHANGE[1])
            .max(MIN_BOUNCE_NOISE_MULTIPLE * noise / time);
        let down = |a: usize, b: usize| points[i + b][2] < points[i + a][2];
        // A single outlier is not a bounce.
        let turns = down(0, 1) && down(1, 2) && down(5, 4) && down(6, 5);
        if !turns || speed(i + 3, i + 6) - speed(i, i + 3) <= least {
            i += 1;
            continue;
        }
        if let Some((time, centre)) = crossing(points, i, gravity) {
            found.push(BounceEstimate { trial: trial.trial.clone(), time, centre });
        }
        i += 4;
    }
    found
}

/// Time and height where the flights before and after the turn in the seven points from `i` cross.
fn crossing(points: &[[f64; 3]], i: usize, gravity: f64) -> Option<(f64, f64)> {
    let lowest = (i + 2..i + 5).min_by(|a, b| points[*a][2].total_cmp(&points[*b][2]))?;
    // Flights are monotonic: the ball falls before the turn and rises after it.
    let before = (0..lowest).rev().take_while(|k| points[*k][2] > points[k + 1][2]).take(FLIGHT_POINTS[0]);
    let after =
        (lowest + 1..points.len()).take_while(|k| points[*k][2] > points[k - 1][2]).take(FLIGHT_POINTS[0]);
    let [before, after] = [before.collect::<Vec<_>>(), after.collect()].map(|at| {
        at.into_iter().map(|k| (points[k][0] - points[lowest][0], points[k][2])).collect::<Vec<_>>()
    });
    if before.len().min(after.len()) < FLIGHT_POINTS[1] {
        return None;
    }
    // Without gravity's share a flight is a line.
    let [(a, b), (c, d)] = [before, after].map(|flight| line(&flight, gravity));
    let t = (c - a) / (b - d);
    let within = points[lowest - 1][0] - points[lowest][0]..=points[lowest + 1][0] - points[lowest][0];
    within.contains(&t).then(|| (points[lowest][0] + t, a + b * t - 0.5 * gravity * t * t))
}

/// Intercept and slope of y + g t^2 / 2 over t.
fn line(points: &[(f64, f64)], gravity: f64) -> (f64, f64) {
    let n = points.len() as f64;
    let straight = |p: &(f64, f64)| p.1 + 0.5 * gravity * p.0 * p.0;
    let (mt, my) =
        (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(straight).sum::<f64>() / n);
    let covariance: f64 = points.iter().map(|p| (p.0 - mt) * (straight(p) - my)).sum();
    let slope = covariance / points.iter().map(|p| (p.0 - mt).powi(2)).sum::<f64>();
    (my - slope * mt, slope)
}

/// Height that the ball keeps for most of the time in most trials.
fn supported(trials: &[TrialPoints], gravity: f64) -> Option<f64> {
    let mut levels = Vec::new();
    for trial in trials {
        let points = &trial.points;
        let largest_change = SUPPORTED.1 * gravity * SUPPORTED.0 * SUPPORTED.0 / 8.0;
        let change = largest_change.max(6.0 * noise(points));
        let (mut level, mut all) = (Vec::new(), 0);
        for (i, start) in points.iter().enumerate() {
            let end = points[i..].iter().take_while(|p| p[0] <= start[0] + SUPPORTED.0).count();
            let window = &points[i..i + end];
            if window.len() < 3 || i + end == points.len() {
                continue;
            }
            all += 1;
            let heights = window.iter().map(|p| p[2]);
            let range = heights.clone().fold(f64::NEG_INFINITY, f64::max)
                - heights.clone().fold(f64::INFINITY, f64::min);
            if range < change {
                level.push(median(heights.collect()));
            }
        }
        if 2 * level.len() > all && all > 0 {
            levels.push(median(level));
        }
    }
    (4 * levels.len() >= 3 * trials.len() && !levels.is_empty()).then(|| median(levels)).filter(|level| {
        // Nothing is lower.
        let below = |p: &&[f64; 3]| p[2] < level - MAX_FLOOR_DEVIATION_M;
        trials.iter().flat_map(|t| &t.points).filter(below).count() <= 2
    })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Standard deviation of the noise from third differences, which are close to zero for smooth motion.
fn noise(points: &[[f64; 3]]) -> f64 {
    let third = |v: &[[f64; 3]]| (v[3][2] - 3.0 * v[2][2] + 3.0 * v[1][2] - v[0][2]).abs();
    let thirds: Vec<f64> = points.windows(4).map(third).collect();
    if thirds.is_empty() { 0.0 } else { 1.4826 * median(thirds) / 20f64.sqrt() }
}
