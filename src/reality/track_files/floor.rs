//! The floor that a ball bounces off or rolls on: found from the tracks, or checked against them.
//!
//! Without a floor, bounces would be explained by spurious forces. The centre's height at a bounce is where the parabolas
//! before and after it cross, which is closer than the samples are.

use super::track_rows::TrialPoints;
use super::unit_checks::{parabola, range};
use crate::error::{Error, Result};
use crate::line_fit::LineFit;

/// The height of a floor.
pub struct FloorEstimate {
    /// m
    pub height: f64,
    /// How it was found.
    pub evidence: String,
    /// By trial, what brings it to this floor.
    pub films: Vec<FilmFloor>,
}

/// How a trial lies to the floor of all.
#[derive(Clone, Debug, PartialEq)]
pub enum FilmFloor {
    /// Its heights, moved up by this much, m: the origin of a film is where its camera stood.
    Shifted(f64),
    /// Not used, since no level floor explains it.
    LeftOut(String),
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
/// Least number of points on each side of a bounce that show the curvature of the flights.
const MIN_CURVATURE_POINTS: usize = 5;
/// Share of trials that must bounce off a floor or roll on it; a single bounce may be a tracking error.
const MIN_SHARE: f64 = 0.1;
/// Largest median deviation of the heights of bounces off one floor, m.
const MAX_FLOOR_DEVIATION_M: f64 = 0.01;
/// Minimum number of bounces of a film that show a floor of its own.
const MIN_FILM_BOUNCES: usize = 3;
/// Largest share of points, outliers, whose centre is below a floor that was found.
const MAX_SHARE_BELOW: f64 = 0.02;
/// Most points of a trial, outliers, that may be below the floor of the others.
const MAX_OUTLIERS_BELOW: usize = 2;
/// Time, s, over which a supported ball keeps its height, and how much it may change, relative to a free fall.
const SUPPORTED: (f64, f64) = (0.1, 0.05);

/// The floor that a ball of this radius bounces off or rolls on; `None` if it does neither. Films of many bounces may have floors
/// of their own; otherwise bounces at different heights are an error.
pub fn find_floor(trials: &[TrialPoints], radius: f64, gravity: f64) -> Result<Option<FloorEstimate>> {
    let all: Vec<Vec<BounceEstimate>> = trials.iter().map(|t| bounces(t, gravity)).collect();
    let bouncing = all.iter().filter(|b| !b.is_empty()).count();
    let count = all.iter().flatten().count();
    if count < 2 || bouncing as f64 <= MIN_SHARE * trials.len() as f64 {
        return Ok(supported(trials, gravity).map(|centre| FloorEstimate {
            height: centre - radius,
            evidence: "the ball keeps this height although nothing else holds it".into(),
            films: vec![FilmFloor::Shifted(0.0); trials.len()],
        }));
    }
    let level = Level::of(&all);
    if level.deviation > MAX_FLOOR_DEVIATION_M {
        return film_floors(trials, &all, radius)
            .map_or_else(|| Err(no_common_floor(&all, &level)), |f| Ok(Some(f)));
    }
    let floor = level.centre - radius;
    let below = |t: &TrialPoints| t.points.iter().filter(|p| p[2] < floor).count();
    let points: usize = trials.iter().map(|t| t.points.len()).sum();
    let mut films = vec![FilmFloor::Shifted(0.0); trials.len()];
    if trials.iter().map(below).sum::<usize>() as f64 > MAX_SHARE_BELOW * points as f64 {
        for (film, trial) in
            films.iter_mut().zip(trials).filter(|(_, trial)| below(trial) > MAX_OUTLIERS_BELOW)
        {
            let lowest = trial.points.iter().map(|p| p[2]).fold(f64::INFINITY, f64::min);
            *film = FilmFloor::LeftOut(format!(
                "it falls to {lowest:.3} m, below the floor of the others at {floor:.3} m; does the camera move, or the ball come nearer \
                 to it?"
            ));
        }
        let kept = films.iter().filter(|film| matches!(film, FilmFloor::Shifted(_))).count();
        if 2 * kept <= trials.len() {
            let value = format!(
                "missing: {bouncing} of {} trials bounce, and fall below what they bounce off",
                trials.len()
            );
            let allowed = "the height of a floor below all points; a scene; or tracks that end before";
            return Err(Error::input("floor", value, allowed));
        }
    }
    let evidence = format!(
        "where {count} bounces of {bouncing} trials cross, less the radius; median deviation {:.1} mm",
        1e3 * level.deviation
    );
    Ok(Some(FloorEstimate { height: floor, evidence, films }))
}

fn no_common_floor(all: &[Vec<BounceEstimate>], level: &Level) -> Error {
    let bouncing = all.iter().filter(|b| !b.is_empty()).count();
    let first = all.iter().flatten().next();
    let (trial, time) = first.map_or(("", 0.0), |b| (b.trial.as_str(), b.time));
    let value = format!(
        "missing: {bouncing} of {} trials turn upwards sharply (first {trial:?} at {time:.3} s), at heights that differ by {:.0} mm",
        all.len(),
        1e3 * level.deviation
    );
    let allowed =
        "the height of what they bounce off; a scene, if it is not level; or tracks that end before";
    Error::input("floor", value, allowed)
}

/// Median height of the centre at bounces, and the median deviation from it, m.
struct Level {
    centre: f64,
    deviation: f64,
}

impl Level {
    fn of(bounces: &[Vec<BounceEstimate>]) -> Level {
        let heights = || bounces.iter().flatten().map(|b| b.centre);
        let centre = median(heights().collect());
        Level { centre, deviation: median(heights().map(|h| (h - centre).abs()).collect()) }
    }
}

/// The floor of films with floors of their own: each that bounces at one height is moved to the height of the first. Films of few bounces,
/// or at several heights, are left out; `None` unless those that are kept are more.
fn film_floors(trials: &[TrialPoints], all: &[Vec<BounceEstimate>], radius: f64) -> Option<FloorEstimate> {
    let levels: Vec<Option<Level>> = all
        .iter()
        .map(|b| (b.len() >= MIN_FILM_BOUNCES).then(|| Level::of(std::slice::from_ref(b))))
        .collect();
    let is_level = |level: &&Level| level.deviation <= MAX_FLOOR_DEVIATION_M;
    let kept: Vec<&Level> = levels.iter().flatten().filter(is_level).collect();
    let first = *kept.first()?;
    if 2 * kept.len() <= trials.len() {
        return None;
    }
    let film = |(bounces, level): (&Vec<BounceEstimate>, &Option<Level>)| match level {
        Some(level) if is_level(&level) => FilmFloor::Shifted(first.centre - level.centre),
        Some(_) => {
            let heights = bounces.iter().map(|b| b.centre - radius);
            let [low, high] = [f64::min, f64::max].map(|of| heights.clone().reduce(of).unwrap_or(f64::NAN));
            FilmFloor::LeftOut(format!(
                "it bounces at heights from {low:.3} to {high:.3} m; does the camera move, or the ball come nearer to it?"
            ))
        }
        None => FilmFloor::LeftOut(format!(
            "it has {} bounces, and {MIN_FILM_BOUNCES} are needed to find its floor, since the others' floors differ",
            bounces.len()
        )),
    };
    let films = all.iter().zip(&levels).map(film).collect();
    let evidence = format!(
        "where the bounces of {} films cross, less the radius; each film has its own origin",
        kept.len()
    );
    Some(FloorEstimate { height: first.centre - radius, evidence, films })
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

/// The bounces of a trial: the lowest points between a fall and a rise that two flights fit better than one smooth turn. The
/// flights' curvature is the trial's own, since the scale may be wrong.
fn bounces(trial: &TrialPoints, gravity: f64) -> Vec<BounceEstimate> {
    let points = &trial.points;
    let noise = noise(points);
    let is_lowest = |i: &usize| points[i - 1][2] > points[*i][2] && points[i + 1][2] >= points[*i][2];
    let turns = (1..points.len().saturating_sub(1)).filter(is_lowest).filter_map(|i| Turn::at(points, i));
    let turns: Vec<Turn> = turns.filter(|turn| turn.crossing(gravity, noise).is_some()).collect();
    let curvatures: Vec<f64> = turns.iter().filter_map(Turn::curvature).collect();
    let curvature = if curvatures.is_empty() { gravity } else { median(curvatures) };
    let bounce = |turn: &Turn| {
        let (time, centre) = turn.crossing(curvature, noise)?;
        Some(BounceEstimate { trial: trial.trial.clone(), time, centre })
    };
    turns.iter().filter_map(bounce).collect()
}

/// Points before and after a lowest one: time since it, s, and height, m, each outwards from it.
struct Turn {
    time: f64,
    before: Vec<(f64, f64)>,
    after: Vec<(f64, f64)>,
    /// Times of the points next to the lowest one, s.
    neighbours: [f64; 2],
}

impl Turn {
    /// `None` with too few points on either side.
    fn at(points: &[[f64; 3]], lowest: usize) -> Option<Turn> {
        let falls = (0..lowest).rev().take_while(|k| points[*k][2] > points[k + 1][2]);
        let rises = (lowest + 1..points.len()).take_while(|k| points[*k][2] > points[k - 1][2]);
        let point = |k: usize| (points[k][0] - points[lowest][0], points[k][2]);
        let before: Vec<(f64, f64)> = falls.take(FLIGHT_POINTS[0]).map(point).collect();
        let after: Vec<(f64, f64)> = rises.take(FLIGHT_POINTS[0]).map(point).collect();
        let neighbours = [before.first()?.0, after.first()?.0];
        let enough = before.len().min(after.len()) >= FLIGHT_POINTS[1];
        enough.then_some(Turn { time: points[lowest][0], before, after, neighbours })
    }

    /// Lines through the points of both flights without the share of an acceleration downwards.
    fn lines(&self, gravity: f64) -> [LineFit; 2] {
        [&self.before, &self.after].map(|flight| {
            let straight: Vec<(f64, f64)> =
                flight.iter().map(|(t, height)| (*t, height + 0.5 * gravity * t * t)).collect();
            LineFit::new(&straight)
        })
    }

    /// Acceleration downwards, m/s^2, with which both flights fit best; `None` with few points.
    fn curvature(&self) -> Option<f64> {
        if self.before.len().min(self.after.len()) < MIN_CURVATURE_POINTS {
            return None;
        }
        // The sum of squares is a parabola of the acceleration.
        let square = |g: f64| self.lines(g).iter().map(|line| line.square).sum::<f64>();
        let [low, middle, high] = [-1.0, 0.0, 1.0].map(square);
        let curvature = low - 2.0 * middle + high;
        (curvature > 0.0).then(|| 0.5 * (low - high) / curvature)
    }

    /// Time and height where the flights cross, if they do as in a bounce.
    fn crossing(&self, gravity: f64, noise: f64) -> Option<(f64, f64)> {
        let [first, second] = self.lines(gravity);
        let jump = second.slope - first.slope;
        let standard_error = noise * (first.slope_variance + second.slope_variance).sqrt();
        if jump < MIN_JUMP_M_S.max(MIN_JUMP_SIGNIFICANCE * standard_error) {
            return None;
        }
        let straight = |(t, height): &(f64, f64)| (*t, height + 0.5 * gravity * t * t);
        let turn: Vec<(f64, f64)> = self.before.iter().rev().chain(&self.after).map(straight).collect();
        let misfit = ((first.square + second.square) / turn.len() as f64).sqrt();
        if misfit > MAX_MISFIT_RATIO * parabola(&turn)?.1 {
            return None;
        }
        let t = (first.intercept - second.intercept) / jump;
        let height = first.intercept + first.slope * t - 0.5 * gravity * t * t;
        (self.neighbours[0]..=self.neighbours[1]).contains(&t).then_some((self.time + t, height))
    }
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

    fn moved(mut trial: TrialPoints, up: impl Fn(f64) -> f64) -> TrialPoints {
        trial.points.iter_mut().for_each(|p| p[2] += up(p[0]));
        trial
    }

    /// Films whose cameras stood elsewhere have floors of their own; a film of a ball that comes nearer has none.
    #[test]
    fn films_have_their_own_origin() {
        let films: Vec<TrialPoints> = drops(60.0, 0.85)
            .into_iter()
            .enumerate()
            .map(|(k, film)| moved(film, |t| 0.1 * k as f64 + if k == 5 { -0.4 * t } else { 0.0 }))
            .collect();
        let found = find_floor(&films, 0.02, 9.81).unwrap().unwrap();
        assert!((found.height + 0.3).abs() < 3e-3, "{}", found.height);
        for (k, film) in found.films[..5].iter().enumerate() {
            let FilmFloor::Shifted(up) = film else { panic!("{k}: {film:?}") };
            assert!((up + 0.1 * k as f64).abs() < 4e-3, "{k}: {up}");
        }
        assert!(
            matches!(&found.films[5], FilmFloor::LeftOut(reason) if reason.contains("bounces at heights"))
        );
    }

    /// A film that falls below the floor of the others is left out.
    #[test]
    fn film_with_a_lower_floor_is_left_out() {
        let mut films = drops(60.0, 0.85);
        let last = films.pop().map(|film| moved(film, |t| -0.5 * t));
        films.extend(last);
        let found = find_floor(&films, 0.02, 9.81).unwrap().unwrap();
        assert!((found.height + 0.3).abs() < 3e-3, "{}", found.height);
        assert_eq!(found.films[..5], vec![FilmFloor::Shifted(0.0); 5]);
        assert!(matches!(&found.films[5], FilmFloor::LeftOut(reason) if reason.contains("below the floor")));
    }

    /// A wrong scale changes the curvature of flights, not where they cross.
    #[test]
    fn bounces_cross_at_one_height_whatever_the_scale() {
        let mut films = drops(30.0, 0.8);
        films.iter_mut().flat_map(|film| &mut film.points).for_each(|p| p[2] *= 0.8);
        let found = find_floor(&films, 0.016, 9.81).unwrap().unwrap();
        assert!((found.height + 0.24).abs() < 2e-3, "{}", found.height);
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
