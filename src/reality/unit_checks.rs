//! Plausibility checks of units and of the direction of y.
//!
//! A thrown object falls with approximately the acceleration of gravity. With coordinates in pixels or millimetres, or times in frames
//! or milliseconds, the acceleration differs by factors of hundreds, and its sign is reversed if y points down. The
//! acceleration is estimated as the median, over segments of all tracks, of the curvature of a fitted parabola. Only moving
//! segments with the best fits count, which excludes bounces and rest.

use super::Trial;
use crate::error::{Error, Result};
use crate::task::Scene;

/// Units that the user or the file declares explicitly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeclaredUnits {
    /// Whether the unit of length is declared.
    pub length: bool,
    /// Whether the unit of time is declared.
    pub time: bool,
    /// Whether the direction of y is declared.
    pub up: bool,
}

/// Plausible downward accelerations, relative to gravity. The range allows for drag, lift and buoyancy.
const PLAUSIBLE_FALL: [f64; 2] = [0.03, 8.0];
/// Plausible upward acceleration, relative to gravity: larger than that of a ball with back spin.
const PLAUSIBLE_RISE: f64 = -0.5;
/// Maximum plausible extent of a trial, m.
const MAX_EXTENT_M: f64 = 300.0;
/// Minimum upward change of velocity in a bounce: as a multiple of the change due to gravity, and in m/s.
const MIN_BOUNCE_VELOCITY_CHANGE: [f64; 2] = [5.0, 0.5];
/// Minimum upward change of velocity in a bounce, as a multiple of noise over the duration of the turn. The standard error of the
/// change is five times that ratio, and many samples are tested.
const MIN_BOUNCE_NOISE_MULTIPLE: f64 = 25.0;
/// Tolerance of the floor's height, m.
const FLOOR_TOLERANCE_M: f64 = 0.02;

/// Checks the units of trials of one body. An implausible unit is an error, or a note if it is declared.
pub fn check_units(trials: &[Trial], declared: DeclaredUnits) -> Result<Option<String>> {
    let Some(ImplausibleUnit { field, value, allowed, is_declared }) = implausible_unit(trials, declared)
    else {
        return Ok(None);
    };
    match is_declared {
        true => Ok(Some(format!("{field} is {value}; the declared units are used"))),
        false => Err(Error::input(field, value, allowed)),
    }
}

/// Checks the height of the floor; `floor` is `None` if the scene has none. Without a floor, bounces would be explained by spurious
/// forces.
pub fn check_floor(trials: &[Trial], radius: f64, floor: Option<f64>) -> Result<Option<String>> {
    let bounces: Vec<BounceEstimate> = trials.iter().filter_map(bounce).collect();
    let seen = bounces.iter().map(|b| b.centre).fold(f64::INFINITY, f64::min);
    let Some(height) = floor else {
        let Some(first) = bounces.first() else { return Ok(None) };
        let text = format!(
            "{} of {} trials turn upwards sharply (first {:?} at {:.3} s), as in a bounce",
            bounces.len(),
            trials.len(),
            first.trial,
            first.time
        );
        let advice = format!(
            "the height of what they bounce off, at most {:.3} m (centre less radius); or tracks that end before",
            seen - radius
        );
        // A single bounce may be a tracking error.
        return match bounces.len() > 1 && bounces.len() > trials.len() / 10 {
            true => Err(Error::input("floor", format!("missing: {text}"), advice)),
            false => Ok(Some(format!("{text}: if so, give `floor`, {advice}"))),
        };
    };
    let mut heights: Vec<f64> =
        trials.iter().flat_map(|t| &t.observed.bodies[0].y).copied().filter(|y| y.is_finite()).collect();
    heights.sort_by(f64::total_cmp);
    // Robust against two outliers.
    let lowest = heights.get(2).copied().unwrap_or(f64::INFINITY);
    if lowest < height {
        let allowed = format!("a height below the ball's centre, which comes down to {lowest:.4} m");
        return Err(Error::input("floor", height, allowed));
    }
    let beyond = |b: &BounceEstimate| b.centre - b.missed > height + FLOOR_TOLERANCE_M + 2.0 * radius;
    if bounces.len() > 1 && bounces.iter().all(beyond) {
        let allowed = format!(
            "the height of what the ball bounces off: {} of {} trials bounce, with the centre at {seen:.3} m or above",
            bounces.len(),
            trials.len()
        );
        return Err(Error::input("floor", height, allowed));
    }
    Ok(None)
}

/// An implausible unit or direction.
struct ImplausibleUnit {
    field: &'static str,
    value: String,
    /// Allowed values, and the option that declares the unit.
    allowed: String,
    /// Whether the implausible unit is declared explicitly.
    is_declared: bool,
}

fn implausible_unit(trials: &[Trial], declared: DeclaredUnits) -> Option<ImplausibleUnit> {
    let scene: &Scene = &trials.first()?.scene;
    let g = scene.gravity[0].hypot(scene.gravity[1]);
    let extent = [0, 1].map(|axis| extent(trials, axis)).into_iter().fold(0.0, f64::max);
    if extent > MAX_EXTENT_M && !declared.length {
        let value = format!("spread over {extent:.0} m");
        let allowed = format!("metres; {PIXELS}; if they are m, `length_unit` m");
        return Some(ImplausibleUnit { field: "x, y", value, allowed, is_declared: false });
    }
    if g == 0.0 {
        return None;
    }
    let along = acceleration(trials, scene.gravity)? / g;
    if (PLAUSIBLE_FALL[0]..=PLAUSIBLE_FALL[1]).contains(&along)
        || (PLAUSIBLE_RISE..=-PLAUSIBLE_FALL[0]).contains(&along)
    {
        return None;
    }
    let speed = format!("{:.3e} m/s^2, {:.2e} times gravity", (along * g).abs(), along.abs());
    let (units, fall) = (declared.length && declared.time, if along > 0.0 { "falling" } else { "rising" });
    let lengths =
        if declared.length { "is the unit, or the size of a pixel, the right one?" } else { PIXELS };
    let (field, value, allowed, is_declared) = if along.abs() < PLAUSIBLE_FALL[0] {
        let fps = along.abs().sqrt().recip();
        let like = if along.abs() < 1e-5 { String::new() } else { format!(" (of about {fps:.0} a second)") };
        let times = match declared.time {
            true => "is the unit, or the number of pictures a second, the right one?".into(),
            false => format!("of pictures{like} give `fps`, of milliseconds `time_unit` ms"),
        };
        let allowed =
            format!("seconds, with coordinates in metres; {times}; {}", declaration_advice(declared));
        ("t", format!("such that things fall with {speed}"), allowed, units)
    } else if along > 0.0 {
        let allowed = format!("metres and seconds; {lengths}; {}", declaration_advice(declared));
        ("y", format!("{fall} with {speed}"), allowed, units)
    } else if along > -PLAUSIBLE_FALL[1] {
        let allowed = "counted upwards; counted from above, as in pictures, give `y_down`; if it is upwards, `y_down` false";
        ("y", format!("{fall} with {speed}"), allowed.to_string(), declared.up)
    } else {
        let allowed = format!("metres, upwards; {lengths}; counted from above, give `y_down` as well");
        ("y", format!("{fall} with {speed}"), allowed, units && declared.up)
    };
    Some(ImplausibleUnit { field, value, allowed, is_declared })
}

const PIXELS: &str = "of pixels give `metres_per_pixel`, of millimetres `length_unit` mm (or cm)";

/// Advice on how to declare the assumed units.
fn declaration_advice(declared: DeclaredUnits) -> String {
    let missing = [("`length_unit` m", declared.length), ("`time_unit` s", declared.time)];
    let missing: Vec<&str> =
        missing.iter().filter(|(_, declared)| !declared).map(|(option, _)| *option).collect();
    format!("if it is right, say so: {}", missing.join(" and "))
}

/// Largest extent of a track along an axis.
fn extent(trials: &[Trial], axis: usize) -> f64 {
    let of = |trial: &Trial| {
        let track = &trial.observed.bodies[0];
        let values = if axis == 0 { &track.x } else { &track.y };
        let seen = || values.iter().copied().filter(|v| v.is_finite());
        seen().fold(f64::NEG_INFINITY, f64::max) - seen().fold(f64::INFINITY, f64::min)
    };
    trials.iter().map(of).fold(0.0, f64::max)
}

/// Acceleration along gravity in the assumed units; `None` if no segment identifies it.
fn acceleration(trials: &[Trial], gravity: [f64; 2]) -> Option<f64> {
    let g = gravity[0].hypot(gravity[1]);
    let mut pieces: Vec<(f64, f64)> = Vec::new();
    for trial in trials {
        let track = &trial.observed.bodies[0];
        let along = |i: usize| (track.x[i] * gravity[0] + track.y[i] * gravity[1]) / g;
        let all = trial.observed.times.iter().enumerate().map(|(i, t)| (*t, along(i)));
        let points: Vec<(f64, f64)> = all.filter(|p| p.1.is_finite()).collect();
        let n = (points.len() / 8).clamp(7, 60);
        let span = |p: &[(f64, f64)]| {
            let values = || p.iter().map(|p| p.1);
            values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
        };
        let whole = span(&points);
        let moving = points.windows(n).step_by(n / 2).filter(|p| span(p) > 0.02 * whole);
        pieces.extend(moving.filter_map(parabola));
    }
    // The absolute misfit is used, since the misfit relative to the curvature would favour curved segments.
    pieces.sort_by(|a, b| a.1.total_cmp(&b.1));
    pieces.truncate(pieces.len().div_ceil(2));
    let mut found: Vec<f64> = pieces.iter().map(|p| p.0).collect();
    found.sort_by(f64::total_cmp);
    found.get(found.len() / 2).copied()
}

/// Second derivative of the least-squares parabola through points (t, y), and its root-mean-square misfit.
fn parabola(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let n = points.len() as f64;
    let (t0, y0) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let square = points.iter().map(|p| (p.0 - t0).powi(2)).sum::<f64>() / n;
    // Regression of y on t and t^2, all centred.
    let rows = points.iter().map(|p| (p.0 - t0, (p.0 - t0).powi(2) - square, p.1 - y0));
    let sums = rows.clone().fold([0.0; 5], |s, (u, q, y)| {
        [s[0] + u * u, s[1] + u * q, s[2] + q * q, s[3] + u * y, s[4] + q * y]
    });
    let determinant = sums[0] * sums[2] - sums[1] * sums[1];
    let slope = (sums[3] * sums[2] - sums[4] * sums[1]) / determinant;
    let curve = (sums[4] * sums[0] - sums[3] * sums[1]) / determinant;
    let misfit = rows.map(|(u, q, y)| (y - slope * u - curve * q).powi(2)).sum::<f64>();
    let found = (2.0 * curve, (misfit / n).sqrt());
    (found.0.is_finite() && found.1.is_finite()).then_some(found)
}

/// A sharp upward turn of a path.
struct BounceEstimate {
    trial: String,
    /// Time, s.
    time: f64,
    /// Lowest observed height of the centre, and how much lower it may have been between samples, m.
    centre: f64,
    missed: f64,
}

/// A trial's first bounce.
fn bounce(trial: &Trial) -> Option<BounceEstimate> {
    let (track, times) = (&trial.observed.bodies[0], &trial.observed.times);
    let g = trial.scene.gravity[1].abs();
    let seen: Vec<usize> = (0..track.len()).filter(|i| track.y[*i].is_finite()).collect();
    let heights: Vec<f64> = seen.iter().map(|i| track.y[*i]).collect();
    let noise = noise(&heights);
    let speed = |a: usize, b: usize| (track.y[b] - track.y[a]) / (times[b] - times[a]);
    seen.windows(7).find_map(|w| {
        let (before, after, time) = (speed(w[0], w[3]), speed(w[3], w[6]), times[w[6]] - times[w[0]]);
        let least = (MIN_BOUNCE_VELOCITY_CHANGE[0] * g * time)
            .max(MIN_BOUNCE_VELOCITY_CHANGE[1])
            .max(MIN_BOUNCE_NOISE_MULTIPLE * noise / time);
        let down = |a: usize, b: usize| track.y[w[b]] < track.y[w[a]];
        // A single outlier is not a bounce.
        let turns = down(0, 1) && down(1, 2) && down(5, 4) && down(6, 5);
        (turns && after - before > least).then(|| BounceEstimate {
            trial: trial.name.clone(),
            time: times[w[3]],
            centre: w.iter().map(|i| track.y[*i]).fold(f64::INFINITY, f64::min),
            missed: before.abs().max(after.abs()) * time / 6.0,
        })
    })
}

/// Standard deviation of the noise from third differences, which are close to zero for smooth motion.
fn noise(values: &[f64]) -> f64 {
    let mut thirds: Vec<f64> =
        values.windows(4).map(|v| (v[3] - 3.0 * v[2] + 3.0 * v[1] - v[0]).abs()).collect();
    thirds.sort_by(f64::total_cmp);
    1.4826 * thirds.get(thirds.len() / 2).copied().unwrap_or(0.0) / 20f64.sqrt()
}
