//! Plausibility checks of units and of the direction of y.
//!
//! A thrown object falls with approximately the acceleration of gravity. With coordinates in pixels or millimetres, or times in frames
//! or milliseconds, the acceleration differs by factors of hundreds, and its sign is reversed if y points down. The
//! acceleration is estimated from the curvatures of parabolas through segments of all tracks: the median of those that
//! determine it best. Segments at rest do not count.
//!
//! An implausible acceleration is an error only where nothing but units explains it: that of most segments is implausible, and
//! nothing supports the body. Otherwise it is a remark. A unit is suggested only if the data are plausible in it.

use super::track_rows::TrialPoints;
use crate::error::{Error, Result};

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
/// Extent above which coordinates may be pixels or millimetres.
const LARGE_EXTENT: f64 = 30.0;
/// Deviation from a straight motion, relative to its extent, of a body in free flight.
const MIN_BEND: f64 = 0.1;
/// Frame rates of cameras, 1/s.
const FRAME_RATES: [f64; 2] = [10.0, 5000.0];

/// Checks the units of trials of one body, which may touch other things if it `has_supports`; `gravity` in m/s^2. An implausible
/// unit is an error, or a remark if it is declared or may have another cause.
pub fn check_units(
    trials: &[TrialPoints],
    gravity: [f64; 2],
    has_supports: bool,
    declared: DeclaredUnits,
) -> Result<Option<String>> {
    let Some(found) = implausible_unit(trials, gravity, has_supports, declared) else { return Ok(None) };
    let ImplausibleUnit { field, value, allowed, is_declared, may_be_physics } = found;
    if is_declared {
        return Ok((!may_be_physics).then(|| format!("{field} is {value}; the declared units are used")));
    }
    if may_be_physics {
        return Ok(Some(format!(
            "{field} is {value}; if that is not what happened, the units are wrong: {allowed}"
        )));
    }
    Err(Error::input(field, value, allowed))
}

/// An implausible unit or direction.
struct ImplausibleUnit {
    field: &'static str,
    value: String,
    /// Allowed values, and the option that declares the unit.
    allowed: String,
    /// Whether the implausible unit is declared explicitly.
    is_declared: bool,
    /// Whether something other than the units explains the motion.
    may_be_physics: bool,
}

fn implausible_unit(
    trials: &[TrialPoints],
    gravity: [f64; 2],
    has_supports: bool,
    declared: DeclaredUnits,
) -> Option<ImplausibleUnit> {
    let g = gravity[0].hypot(gravity[1]);
    let extents = trials.iter().flat_map(|trial| {
        [1, 2].map(|axis| range(trial.points.iter().map(|p| p[axis]).filter(|v| v.is_finite())))
    });
    let extent = extents.fold(0.0, f64::max);
    if extent > MAX_EXTENT_M && !declared.length {
        let value = format!("spread over {extent:.0} m");
        let allowed = format!("metres; {PIXELS}; if they are m, `length_unit` m");
        return Some(ImplausibleUnit {
            field: "x, y",
            value,
            allowed,
            is_declared: false,
            may_be_physics: false,
        });
    }
    if g == 0.0 {
        return None;
    }
    let found = acceleration(trials, gravity)?;
    let along = found.median / g;
    if is_possible(along) {
        return None;
    }
    let is_slow = along.abs() < PLAUSIBLE_FALL[0];
    let size = format!("{:.3e} m/s^2, {:.2e} times gravity", (along * g).abs(), along.abs());
    let units = declared.length && declared.time;
    let hints = Hints { along, extent, declared, whole_times: has_whole_times(trials) };
    let (field, value, allowed, is_declared) = if is_slow {
        ("t", format!("such that things fall with {size}"), hints.slow(), units)
    } else if along > 0.0 {
        ("y", format!("falling with {size}"), hints.fast(), units)
    } else if is_plausible(-along) {
        let allowed = "counted upwards; counted from above, as in pictures, give `y_down`; if it is upwards, `y_down` false";
        ("y", format!("rising with {size}"), allowed.to_string(), declared.up)
    } else {
        (
            "y",
            format!("rising with {size}"),
            hints.fast() + "; counted from above, give `y_down` as well",
            units && declared.up,
        )
    };
    let is_like_median = |q: &f64| {
        let along_too = q / g;
        !is_possible(along_too)
            && (along_too.abs() < PLAUSIBLE_FALL[0]) == is_slow
            && (is_slow || along_too.signum() == along.signum())
    };
    // A body that is held, or falls with a constant speed, has little acceleration.
    let is_held = is_slow && (has_supports || found.bend < MIN_BEND);
    let varies = !found.quartiles.iter().all(is_like_median);
    Some(ImplausibleUnit { field, value, allowed, is_declared, may_be_physics: varies || is_held })
}

/// Whether a body may fall with an acceleration, relative to gravity, or rise with it.
fn is_possible(along: f64) -> bool {
    is_plausible(along) || (PLAUSIBLE_RISE..=-PLAUSIBLE_FALL[0]).contains(&along)
}

/// Whether a body may fall with an acceleration, relative to gravity.
pub fn is_plausible(along: f64) -> bool {
    (PLAUSIBLE_FALL[0]..=PLAUSIBLE_FALL[1]).contains(&along)
}

const PIXELS: &str = "of pixels give `metres_per_pixel`, of millimetres `length_unit` mm (or cm)";

/// Mistakes in units in which things fall too slowly or too fast.
struct Hints {
    /// Acceleration relative to gravity.
    along: f64,
    /// Extent of the largest trial in the assumed unit.
    extent: f64,
    declared: DeclaredUnits,
    /// Whether all times are whole numbers.
    whole_times: bool,
}

impl Hints {
    /// Times whose unit is too small.
    fn slow(&self) -> String {
        if self.declared.time {
            let question = "is the unit, or the number of pictures a second, the right one?";
            return format!("seconds, with coordinates in metres; {question}; {}", self.declaration());
        }
        let mut hints = Vec::new();
        let rate = self.along.abs().sqrt().recip();
        if self.whole_times && self.extent > LARGE_EXTENT && !self.declared.length {
            hints.push(
                "of pictures give `fps` and, if coordinates are pixels, `metres_per_pixel`".to_string(),
            );
        } else if (FRAME_RATES[0]..=FRAME_RATES[1]).contains(&rate) {
            hints.push(format!("of pictures (of about {rate:.0} a second) give `fps`"));
        }
        if is_plausible(1e6 * self.along.abs()) {
            hints.push("of milliseconds `time_unit` ms".into());
        }
        hints.push(self.declaration());
        format!("seconds, with coordinates in metres; {}", hints.join("; "))
    }

    /// Coordinates whose unit is too small.
    fn fast(&self) -> String {
        let mut hints = Vec::new();
        if self.declared.length {
            hints.push("is the unit, or the size of a pixel, the right one?".to_string());
        } else {
            if self.extent > LARGE_EXTENT {
                hints.push(format!(
                    "of pixels give `metres_per_pixel` (about {:.1e})",
                    self.along.abs().recip()
                ));
            }
            let named = [("mm", 1e-3), ("cm", 1e-2), ("in", 0.0254)];
            let fitting = named.iter().filter(|(_, size)| is_plausible(size * self.along.abs()));
            let fitting: Vec<String> = fitting.map(|(name, _)| format!("`length_unit` {name}")).collect();
            if !fitting.is_empty() {
                hints.push(format!("of another unit give {}", fitting.join(" or ")));
            }
        }
        hints.push(self.declaration());
        format!("metres and seconds; {}", hints.join("; "))
    }

    /// Advice on how to declare the assumed units.
    fn declaration(&self) -> String {
        let missing = [("`length_unit` m", self.declared.length), ("`time_unit` s", self.declared.time)];
        let missing: Vec<&str> =
            missing.iter().filter(|(_, declared)| !declared).map(|(option, _)| *option).collect();
        format!("if it is right, say so: {}", missing.join(" and "))
    }
}

fn has_whole_times(trials: &[TrialPoints]) -> bool {
    trials.iter().flat_map(|t| &t.points).all(|p| p[0].fract() == 0.0)
}

/// Difference of the largest and the smallest value.
pub fn range(values: impl Iterator<Item = f64> + Clone) -> f64 {
    values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
}

/// Acceleration along gravity in the assumed units; `None` if no segment identifies it.
fn acceleration(trials: &[TrialPoints], gravity: [f64; 2]) -> Option<Acceleration> {
    let g = gravity[0].hypot(gravity[1]);
    // A coordinate that is not observed matters only along gravity.
    let part = |value: f64, axis: usize| if gravity[axis] == 0.0 { 0.0 } else { value * gravity[axis] / g };
    let along = |p: &[f64; 3]| (p[0], part(p[1], 0) + part(p[2], 1));
    median_acceleration(trials.iter().map(|trial| trial.points.iter().map(along).collect()))
}

/// Accelerations of the segments of tracks.
pub struct Acceleration {
    pub median: f64,
    pub quartiles: [f64; 2],
    /// Median deviation of segments from a straight motion, relative to their extent: 0.25 for a fall from rest, 0 for a fall with a
    /// constant speed, whatever the units.
    bend: f64,
}

/// Parts of a track that its segments are: long ones fit best in free flight with noise, short ones between bounces.
const SEGMENTS_PER_TRACK: [usize; 4] = [32, 8, 4, 2];
const MIN_SEGMENT_POINTS: usize = 7;
/// Extent of a segment, relative to the largest one of its track, above which the body moves.
const MOVING: f64 = 0.1;

/// A segment of a track.
struct TrackSegment {
    /// m
    extent: f64,
    /// m/s^2
    acceleration: f64,
    /// Misfit of the parabola over the square of the duration, m/s^2: a measure of the acceleration's standard error.
    error: f64,
    bend: f64,
}

/// Acceleration of tracks (time, position): of the moving segments of each, the half that determines it best. `None` if no
/// segment identifies it.
pub fn median_acceleration(tracks: impl Iterator<Item = Vec<(f64, f64)>>) -> Option<Acceleration> {
    let mut all: Vec<TrackSegment> = Vec::new();
    for mut points in tracks {
        points.retain(|p| p.1.is_finite());
        let mut segments: Vec<TrackSegment> = Vec::new();
        let mut sizes =
            SEGMENTS_PER_TRACK.map(|parts| (points.len() / parts).max(MIN_SEGMENT_POINTS)).to_vec();
        sizes.dedup();
        for n in sizes {
            segments.extend(points.windows(n).step_by(n / 2).filter_map(|points| {
                let (acceleration, misfit) = parabola(points)?;
                let (extent, time) = (range(points.iter().map(|p| p.1)), points[n - 1].0 - points[0].0);
                let bend = acceleration.abs() * time * time / 8.0 / extent;
                Some(TrackSegment { extent, acceleration, error: misfit / (time * time), bend })
            }));
        }
        let largest = segments.iter().map(|s| s.extent).fold(0.0, f64::max);
        segments.retain(|s| s.extent > MOVING * largest);
        segments.sort_by(|a, b| a.error.total_cmp(&b.error));
        segments.truncate(segments.len().div_ceil(2));
        all.extend(segments);
    }
    let sorted = |of: fn(&TrackSegment) -> f64| {
        let mut values: Vec<f64> = all.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let (found, bends) = (sorted(|s| s.acceleration), sorted(|s| s.bend));
    let quantile =
        |share: f64| found.get(((found.len().max(1) - 1) as f64 * share).round() as usize).copied();
    Some(Acceleration {
        median: quantile(0.5)?,
        quartiles: [quantile(0.25)?, quantile(0.75)?],
        bend: bends[bends.len() / 2],
    })
}

/// Second derivative of the least-squares parabola through points (t, y), and its root-mean-square misfit.
pub fn parabola(points: &[(f64, f64)]) -> Option<(f64, f64)> {
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
