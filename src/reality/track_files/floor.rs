//! The floor that a ball bounces off or rolls on: found from the tracks, or checked against them.
//!
//! Without a floor, bounces would be explained by spurious forces. The centre's height at a bounce is where the parabolas
//! before and after it cross, which is closer than the samples are.

use super::line_fit::LineFit;
use super::track_rows::TrialPoints;
use super::unit_checks::{parabola, range};
use crate::error::{Error, Result};

/// The height of a floor.
pub struct FloorEstimate {
    /// m
    pub height: f64,
    /// How it was found.
    pub evidence: String,
}

/// Minimum jump of the vertical velocity in a bounce, m/s, and relative to its standard error.
const MIN_JUMP_M_S: f64 = 0.5;
const MIN_JUMP_SIGNIFICANCE: f64 = 8.0;
/// Largest misfit of two flights around a bounce, relative to that of one parabola, which fits a smooth turn (of a spring) as well.
const MAX_MISFIT_RATIO: f64 = 0.5;
/// Tolerance of the floor's height, m.
const FLOOR_TOLERANCE_M: f64 = 0.02;
/// Number of points of each parabola beside a bounce, and the least number.
const FLIGHT_POINTS: [usize; 2] = [8, 3];
/// Share of trials that must bounce off a floor or roll on it; a single bounce may be a tracking error.
const MIN_SHARE: f64 = 0.1;
/// Largest median deviation of the heights of bounces off one floor, m.
const MAX_FLOOR_DEVIATION_M: f64 = 0.01;
/// Largest share of points, outliers, whose centre is below a floor that was found.
const MAX_SHARE_BELOW: f64 = 0.02;
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
    let points = || trials.iter().flat_map(|t| &t.points);
    let below = points().filter(|p| p[2] < centre - radius).count();
    if below as f64 > MAX_SHARE_BELOW * points().count() as f64 {
        let value = format!(
            "missing: {bouncing} of {} trials bounce, and fall below what they bounce off",
            trials.len()
        );
        let allowed = "the height of a floor below all points; a scene; or tracks that end before";
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

/// Number of points on each side of a bounce in a part of a film.
const MIN_PART_POINTS: usize = 5;

/// Times, s, that cut a film of many bounces into parts with one bounce each: where the ball is highest between two bounces.
/// Bounces with few points around them stay in the last part.
pub fn cuts_between_bounces(trial: &TrialPoints, gravity: f64) -> Vec<f64> {
    let bounces = bounces(trial, gravity);
    let mut cuts = Vec::new();
    for pair in bounces.windows(2) {
        let between: Vec<&[f64; 3]> =
            trial.points.iter().filter(|p| (pair[0].time..pair[1].time).contains(&p[0])).collect();
        let highest =
            (0..between.len()).max_by(|a, b| between[*a][2].total_cmp(&between[*b][2])).unwrap_or(0);
        if highest < MIN_PART_POINTS || between.len() - highest < MIN_PART_POINTS {
            break;
        }
        cuts.push(between[highest][0]);
    }
    cuts
}

/// A sharp upward turn of a path.
struct BounceEstimate {
    trial: String,
    /// Time, s.
    time: f64,
    /// Height of the centre, m.
    centre: f64,
}

/// The bounces of a trial: the lowest points between a fall and a rise that two flights fit better than one smooth turn.
fn bounces(trial: &TrialPoints, gravity: f64) -> Vec<BounceEstimate> {
    let points = &trial.points;
    let noise = noise(points);
    let is_lowest = |i: &usize| points[i - 1][2] > points[*i][2] && points[i + 1][2] >= points[*i][2];
    let lowest = (1..points.len().saturating_sub(1)).filter(is_lowest);
    let bounce = |i: usize| {
        let (time, centre) = crossing(points, i, gravity, noise)?;
        Some(BounceEstimate { trial: trial.trial.clone(), time, centre })
    };
    lowest.filter_map(bounce).collect()
}

/// Time and height where the flights before and after a lowest point cross, if they do as in a bounce.
fn crossing(points: &[[f64; 3]], lowest: usize, gravity: f64, noise: f64) -> Option<(f64, f64)> {
    let before = (0..lowest).rev().take_while(|k| points[*k][2] > points[k + 1][2]).take(FLIGHT_POINTS[0]);
    let after =
        (lowest + 1..points.len()).take_while(|k| points[*k][2] > points[k - 1][2]).take(FLIGHT_POINTS[0]);
    // Without gravity's share a flight is a line.
    let straight = |k: usize| {
        let t = points[k][0] - points[lowest][0];
        (t, points[k][2] + 0.5 * gravity * t * t)
    };
    let [before, after]: [Vec<(f64, f64)>; 2] =
        [before.map(straight).collect(), after.map(straight).collect()];
    if before.len().min(after.len()) < FLIGHT_POINTS[1] {
        return None;
    }
    let [first, second] = [&before, &after].map(|flight| LineFit::new(flight));
    let jump = second.slope - first.slope;
    let standard_error = noise * (first.slope_variance + second.slope_variance).sqrt();
    if jump < MIN_JUMP_M_S.max(MIN_JUMP_SIGNIFICANCE * standard_error) {
        return None;
    }
    let n = (before.len() + after.len()) as f64;
    let misfit = ((first.square + second.square) / n).sqrt();
    let turn: Vec<(f64, f64)> = before.into_iter().rev().chain(after).collect();
    if misfit > MAX_MISFIT_RATIO * parabola(&turn)?.1 {
        return None;
    }
    let t = (first.intercept - second.intercept) / jump;
    let within = points[lowest - 1][0] - points[lowest][0]..=points[lowest + 1][0] - points[lowest][0];
    let height = first.intercept + first.slope * t - 0.5 * gravity * t * t;
    within.contains(&t).then_some((points[lowest][0] + t, height))
}

/// Height that the ball keeps for most of the time in most trials.
fn supported(trials: &[TrialPoints], gravity: f64) -> Option<f64> {
    let mut levels = Vec::new();
    for trial in trials {
        let points = &trial.points;
        let largest_change = SUPPORTED.1 * gravity * SUPPORTED.0 * SUPPORTED.0 / 8.0;
        let change = largest_change.max(6.0 * noise(points));
        let (mut level, mut all) = (Vec::new(), 0);
        let mut i = 0;
        while i < points.len() {
            let end = i + points[i..].iter().take_while(|p| p[0] <= points[i][0] + SUPPORTED.0).count();
            let heights = points[i..end].iter().map(|p| p[2]);
            // Windows overlap by half, so that the work does not grow with the rate of pictures.
            i += ((end - i) / 2).max(1);
            if heights.len() < 3 || end == points.len() {
                continue;
            }
            all += 1;
            if range(heights.clone()) < change {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Heights of the centre at `fps` frames per second of balls that fall from several heights on a floor at -0.3 m.
    fn drops(fps: f64, restitution: f64) -> Vec<TrialPoints> {
        let drop = |k: usize| {
            let (mut flight, mut speed, mut start) = (0.5 + 0.1 * k as f64, 0.0, 0.0);
            let mut points = Vec::new();
            for frame in 0..(2.0 * fps) as usize {
                let t = frame as f64 / fps;
                let duration = |h: f64, v: f64| (v + f64::sqrt(v * v + 2.0 * 9.81 * h)) / 9.81;
                while speed >= 0.0 && t - start > duration(flight, speed) {
                    let time = duration(flight, speed);
                    (start, speed, flight) = (start + time, restitution * (9.81 * time - speed), 0.0);
                    if speed < 0.05 {
                        // At rest from here on.
                        (start, speed) = (f64::INFINITY, 0.0);
                    }
                }
                let s = if start.is_finite() { t - start } else { 0.0 };
                // Noise of half a millimetre.
                let noise = 5e-4 * ((frame * 7919 + k * 104_729) as f64).sin();
                points.push([t, 0.0, -0.28 + flight + speed * s - 4.905 * s * s + noise]);
            }
            TrialPoints { trial: format!("drop{k}"), points }
        };
        (0..6).map(drop).collect()
    }

    #[test]
    fn finds_floor_of_bouncing_balls() {
        for fps in [25.0, 30.0, 60.0, 240.0] {
            for restitution in [0.55, 0.7, 0.9] {
                let found = find_floor(&drops(fps, restitution), 0.02, 9.81).unwrap();
                let found = found.unwrap_or_else(|| panic!("{fps} {restitution}"));
                assert!((found.height + 0.3).abs() < 2e-3, "{fps} {restitution}: {}", found.height);
            }
        }
    }

    /// A racket that hits a ball in the air is no floor, since the ball falls below it later.
    #[test]
    fn a_racket_is_no_floor() {
        let hit = |k: usize| {
            let height = |t: f64| {
                if t < 0.3 { 1.0 - 2.0 * t } else { 0.4 + 3.0 * (t - 0.3) - 4.905 * (t - 0.3).powi(2) }
            };
            let points = (0..80).map(|i| [i as f64 / 60.0, 0.0, height(i as f64 / 60.0)]).collect();
            TrialPoints { trial: k.to_string(), points }
        };
        let error =
            find_floor(&(0..4).map(hit).collect::<Vec<_>>(), 0.02, 9.81).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("fall below what they bounce off"), "{error}");
    }

    #[test]
    fn cuts_film_between_bounces() {
        let film = drops(60.0, 0.8).swap_remove(0);
        let cuts = cuts_between_bounces(&film, 9.81);
        assert!((2..=4).contains(&cuts.len()), "{cuts:?}");
        // The first bounce is at the end of the fall from half a metre, the highest point after it a flight of 0.8 times its speed later.
        let fall = f64::sqrt(2.0 * 0.5 / 9.81);
        assert!((cuts[0] - 1.8 * fall).abs() < 0.05, "{cuts:?}");
    }

    #[test]
    fn finds_floor_of_rolling_ball() {
        let roll = |k: usize| {
            let noise = |i: usize| 5e-4 * ((i * 7919 + k) as f64).sin();
            let points = (0..60).map(|i| [i as f64 / 30.0, 0.1 * i as f64, 1.03 + noise(i)]).collect();
            TrialPoints { trial: k.to_string(), points }
        };
        let found = find_floor(&(0..4).map(roll).collect::<Vec<_>>(), 0.03, 9.81).unwrap().unwrap();
        assert!((found.height - 1.0).abs() < 1e-3, "{}", found.height);
    }

    /// A mass on a spring turns smoothly, and a thrown ball does not turn upwards.
    #[test]
    fn smooth_turns_are_no_bounces() {
        for fps in [30.0, 120.0] {
            let trials = |height: &dyn Fn(f64, usize) -> f64| -> Vec<TrialPoints> {
                let trial = |k: usize| {
                    let points = (0..(1.5 * fps) as usize).map(|i| i as f64 / fps);
                    let noise = |t: f64| 5e-4 * (7919.0 * t).sin();
                    let points = points.map(|t| [t, 0.0, height(t, k) + noise(t)]).collect();
                    TrialPoints { trial: k.to_string(), points }
                };
                (0..6).map(trial).collect()
            };
            let spring = trials(&|t, k| -0.25 + (0.1 + 0.05 * k as f64) * (40f64.sqrt() * t).cos());
            let throw = trials(&|t, k| (3.0 + 0.5 * k as f64) * t - 4.905 * t * t);
            for trials in [spring, throw] {
                assert!(find_floor(&trials, 0.02, 9.81).unwrap().is_none(), "{fps}");
                assert!(remark_on_bounce(&trials, 9.81).is_none(), "{fps}");
            }
        }
    }
}
