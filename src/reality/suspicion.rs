//! Whether what was measured can be in the units, and the right way up, that it was taken for.
//!
//! A thrown thing falls with about the acceleration of gravity. In pixels, millimetres, pictures or milliseconds it
//! seems to fall hundreds of times faster or slower, and upwards where y points down. The acceleration is the median, over
//! pieces of all tracks, of the curvature of a parabola fitted to the piece; of the pieces in which something moves, those
//! count that a parabola fits best, so that bounces and rest do not.

use super::Trial;
use crate::error::{Error, Result};
use crate::task::Scene;

/// What the user or the file said outright.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Said {
    /// The unit of lengths.
    pub length: bool,
    /// The unit of times.
    pub time: bool,
    /// Which way y points.
    pub up: bool,
}

/// Accelerations along gravity, over gravity, that are believed whatever was said: air and spin make several of it, and
/// something light hardly falls at all.
const BELIEVED: [f64; 2] = [0.03, 8.0];
/// The same upwards: a ball with back spin rises with less.
const RISES: f64 = -0.5;
/// m: farther than balls fly.
const FAR: f64 = 300.0;
/// Times the change of velocity that gravity makes, and m/s: by which a path must turn upwards to have bounced.
const SHARPLY: [f64; 2] = [5.0, 0.5];
/// Times the noise over the time of the turn: the change of velocity errs by five times that, and there are many pictures.
const CERTAIN: f64 = 25.0;
/// m: by how much floors are not level, and heights not well known.
const LEVEL: f64 = 0.02;

/// What is suspicious about trials of one body: an error, or a note where what it doubts was said outright.
pub fn units(trials: &[Trial], said: Said) -> Result<Option<String>> {
    let Some(Doubt { field, value, allowed, insisted }) = doubt(trials, said) else { return Ok(None) };
    match insisted {
        true => Ok(Some(format!("{field} is {value}; it is taken as it was said to be"))),
        false => Err(Error::input(field, value, allowed)),
    }
}

/// What is suspicious about where the floor is said to be; `floor` is none where the scene has none. Without what they
/// bounce off, trials that bounce would be explained by forces that are not there.
pub fn floor(trials: &[Trial], radius: f64, floor: Option<f64>) -> Result<Option<String>> {
    let bounces: Vec<Bounce> = trials.iter().filter_map(bounce).collect();
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
        // A slip of the tracking, perhaps.
        return match bounces.len() > 1 && bounces.len() > trials.len() / 10 {
            true => Err(Error::input("floor", format!("missing: {text}"), advice)),
            false => Ok(Some(format!("{text}: if so, give `floor`, {advice}"))),
        };
    };
    let mut heights: Vec<f64> =
        trials.iter().flat_map(|t| &t.observed.bodies[0].y).copied().filter(|y| y.is_finite()).collect();
    heights.sort_by(f64::total_cmp);
    // An outlier or two may be anywhere.
    let lowest = heights.get(2).copied().unwrap_or(f64::INFINITY);
    if lowest < height {
        let allowed = format!("a height below the ball's centre, which comes down to {lowest:.4} m");
        return Err(Error::input("floor", height, allowed));
    }
    let beyond = |b: &Bounce| b.centre - b.missed > height + LEVEL + 2.0 * radius;
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

/// Something that cannot well be.
struct Doubt {
    field: &'static str,
    value: String,
    /// What would not be, and how to say so.
    allowed: String,
    /// Whether all that it doubts was said outright.
    insisted: bool,
}

fn doubt(trials: &[Trial], said: Said) -> Option<Doubt> {
    let scene: &Scene = &trials.first()?.scene;
    let g = scene.gravity[0].hypot(scene.gravity[1]);
    let extent = [0, 1].map(|axis| extent(trials, axis)).into_iter().fold(0.0, f64::max);
    if extent > FAR && !said.length {
        let value = format!("spread over {extent:.0} m");
        let allowed = format!("metres; {PIXELS}; if they are m, `length_unit` m");
        return Some(Doubt { field: "x, y", value, allowed, insisted: false });
    }
    if g == 0.0 {
        return None;
    }
    let along = acceleration(trials, scene.gravity)? / g;
    if (BELIEVED[0]..=BELIEVED[1]).contains(&along) || (RISES..=-BELIEVED[0]).contains(&along) {
        return None;
    }
    let speed = format!("{:.3e} m/s^2, {:.2e} times gravity", (along * g).abs(), along.abs());
    let (units, fall) = (said.length && said.time, if along > 0.0 { "falling" } else { "rising" });
    let lengths = if said.length { "is the unit, or the size of a pixel, the right one?" } else { PIXELS };
    let (field, value, allowed, insisted) = if along.abs() < BELIEVED[0] {
        let fps = along.abs().sqrt().recip();
        let like = if along.abs() < 1e-5 { String::new() } else { format!(" (of about {fps:.0} a second)") };
        let times = match said.time {
            true => "is the unit, or the number of pictures a second, the right one?".into(),
            false => format!("of pictures{like} give `fps`, of milliseconds `time_unit` ms"),
        };
        let allowed = format!("seconds, with coordinates in metres; {times}; {}", outright(said));
        ("t", format!("such that things fall with {speed}"), allowed, units)
    } else if along > 0.0 {
        let allowed = format!("metres and seconds; {lengths}; {}", outright(said));
        ("y", format!("{fall} with {speed}"), allowed, units)
    } else if along > -BELIEVED[1] {
        let allowed = "counted upwards; counted from above, as in pictures, give `y_down`; if it is upwards, `y_down` false";
        ("y", format!("{fall} with {speed}"), allowed.to_string(), said.up)
    } else {
        let allowed = format!("metres, upwards; {lengths}; counted from above, give `y_down` as well");
        ("y", format!("{fall} with {speed}"), allowed, units && said.up)
    };
    Some(Doubt { field, value, allowed, insisted })
}

const PIXELS: &str = "of pixels give `metres_per_pixel`, of millimetres `length_unit` mm (or cm)";

/// How to say of units that they are what they were taken for.
fn outright(said: Said) -> String {
    let missing = [("`length_unit` m", said.length), ("`time_unit` s", said.time)];
    let missing: Vec<&str> = missing.iter().filter(|(_, said)| !said).map(|(option, _)| *option).collect();
    format!("if it is right, say so: {}", missing.join(" and "))
}

/// Largest distance between two points of a track along an axis.
fn extent(trials: &[Trial], axis: usize) -> f64 {
    let of = |trial: &Trial| {
        let track = &trial.observed.bodies[0];
        let values = if axis == 0 { &track.x } else { &track.y };
        let seen = || values.iter().copied().filter(|v| v.is_finite());
        seen().fold(f64::NEG_INFINITY, f64::max) - seen().fold(f64::INFINITY, f64::min)
    };
    trials.iter().map(of).fold(0.0, f64::max)
}

/// Acceleration along gravity, in units of length and time as they were taken; `None` if no piece tells.
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
    // Misfit relative to what the curvature makes of the piece would favour what is curved; the misfit itself does not.
    pieces.sort_by(|a, b| a.1.total_cmp(&b.1));
    pieces.truncate(pieces.len().div_ceil(2));
    let mut found: Vec<f64> = pieces.iter().map(|p| p.0).collect();
    found.sort_by(f64::total_cmp);
    found.get(found.len() / 2).copied()
}

/// Second derivative of the parabola that fits points (t, y) best, and its root-mean-square misfit.
fn parabola(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let n = points.len() as f64;
    let (t0, y0) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let square = points.iter().map(|p| (p.0 - t0).powi(2)).sum::<f64>() / n;
    // Of y against t and t^2, both and y about their means.
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

/// Where a path turns upwards as nothing in the air does.
struct Bounce {
    trial: String,
    /// s
    time: f64,
    /// m, the lowest that was seen, and how much deeper it may have been between two pictures.
    centre: f64,
    missed: f64,
}

/// A trial's first bounce.
fn bounce(trial: &Trial) -> Option<Bounce> {
    let (track, times) = (&trial.observed.bodies[0], &trial.observed.times);
    let g = trial.scene.gravity[1].abs();
    let seen: Vec<usize> = (0..track.len()).filter(|i| track.y[*i].is_finite()).collect();
    let heights: Vec<f64> = seen.iter().map(|i| track.y[*i]).collect();
    let noise = noise(&heights);
    let speed = |a: usize, b: usize| (track.y[b] - track.y[a]) / (times[b] - times[a]);
    seen.windows(7).find_map(|w| {
        let (before, after, time) = (speed(w[0], w[3]), speed(w[3], w[6]), times[w[6]] - times[w[0]]);
        let least = (SHARPLY[0] * g * time).max(SHARPLY[1]).max(CERTAIN * noise / time);
        let down = |a: usize, b: usize| track.y[w[b]] < track.y[w[a]];
        // One point that is off makes no bounce.
        let turns = down(0, 1) && down(1, 2) && down(5, 4) && down(6, 5);
        (turns && after - before > least).then(|| Bounce {
            trial: trial.name.clone(),
            time: times[w[3]],
            centre: w.iter().map(|i| track.y[*i]).fold(f64::INFINITY, f64::min),
            missed: before.abs().max(after.abs()) * time / 6.0,
        })
    })
}

/// Standard deviation of the noise, from third differences, of which smooth motion leaves next to nothing.
fn noise(values: &[f64]) -> f64 {
    let mut thirds: Vec<f64> =
        values.windows(4).map(|v| (v[3] - 3.0 * v[2] + 3.0 * v[1] - v[0]).abs()).collect();
    thirds.sort_by(f64::total_cmp);
    1.4826 * thirds.get(thirds.len() / 2).copied().unwrap_or(0.0) / 20f64.sqrt()
}
