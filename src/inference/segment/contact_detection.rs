//! Detection of contacts and of rolling from the gaps between observed positions and surfaces.

use nalgebra::{DMatrix, DVector};

use super::definition::{MIN_FLIGHT_OBSERVATIONS, observed_position};
use crate::error::Result;
use crate::inference::data::noise::third_difference_noise;
use crate::inference::data::smoothing::TimedPosition;
use crate::inference::statistics::slope;
use crate::progress::Progress;
use crate::reality::Trial;

/// Rows on each side used to test for support, and the share of gravity below which a body does not fall.
const SUPPORT_ROWS: usize = 6;
const MAX_SUPPORTED_ACCELERATION: f64 = 0.3;
/// Largest apparent slope of a surface caused by a tilted camera.
const MAX_CAMERA_TILT: f64 = 0.02;

/// A contact at a row.
#[derive(Clone, Copy, Debug)]
pub struct ContactEvent {
    /// Away from the surface.
    pub normal: [f64; 2],
    /// Position of the body's centre along the normal at contact, m.
    pub level: f64,
    pub obstacle: Obstacle,
}

/// The object that a body touches, by index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obstacle {
    Static(usize),
    Body(usize),
}

/// Contact at each row: the gap has a low minimum where approach turns into departure, or stays low.
pub fn detect_contacts(
    trial: &Trial,
    body: usize,
    rows: &[TimedPosition],
    progress: &dyn Progress,
) -> Result<Vec<Option<ContactEvent>>> {
    let mut out = vec![None; rows.len()];
    let scene = &trial.scene;
    let Some(shape) = scene.bodies[body].shape.pieces() else { return Ok(out) };
    let corners = scene.bodies[body].shape.corner_count();
    let extent = shape.disc_radius().unwrap_or_else(|| shape.half_size());
    let near = 0.15 * extent;
    let angles: Vec<f64> = rows.iter().map(|(t, _)| observed_angle(trial, body, *t).unwrap_or(0.0)).collect();
    for (f, fixed) in scene.statics.iter().enumerate() {
        let solid = fixed.placed();
        let gap = |p: [f64; 2], angle: f64| solid.signed_distance_to(&shape.placed(p, angle));
        let gaps = checked_gaps(
            rows.iter().zip(&angles),
            corners * fixed.shape.corner_count(),
            progress,
            |((_, p), angle)| gap(*p, *angle),
        )?;
        let h = 1e-3 * extent;
        let normal = |i: usize| {
            let (p, a) = (rows[i].1, angles[i]);
            let n = [
                gap([p[0] + h, p[1]], a) - gap([p[0] - h, p[1]], a),
                gap([p[0], p[1] + h], a) - gap([p[0], p[1] - h], a),
            ];
            let length = n[0].hypot(n[1]);
            if length > 0.0 { [n[0] / length, n[1] / length] } else { [0.0, 1.0] }
        };
        let supported = supported_rows(rows, &gaps, extent, |i| {
            progress.check_stop()?;
            let n = normal(i);
            Ok([n[0], n[1], n[0] * scene.gravity[0] + n[1] * scene.gravity[1]])
        })?;
        let held = supported.iter().zip(&gaps).map(|(held, gap)| if *held { gap.min(0.0) } else { *gap });
        let gaps_held: Vec<f64> = held.collect();
        mark_contacts(&gaps_held, near, |i| {
            let (p, normal) = (rows[i].1, normal(i));
            let level = p[0] * normal[0] + p[1] * normal[1] - gaps[i];
            out[i] = Some(ContactEvent { normal, level, obstacle: Obstacle::Static(f) });
        });
    }
    for (k, other) in trial.observed.bodies.iter().enumerate().filter(|(k, _)| *k != body) {
        let Some(theirs) = scene.bodies[k].shape.pieces() else { continue };
        // The rows' times are among those of the trial, which increase.
        let at = |t: f64| trial.observed.times.partition_point(|s| *s < t);
        let gaps = checked_gaps(rows, corners * scene.bodies[k].shape.corner_count(), progress, |(t, p)| {
            match observed_position(other, at(*t)) {
                Some(q) => {
                    let [own, other] = [body, k].map(|b| observed_angle(trial, b, *t).unwrap_or(0.0));
                    shape.placed(*p, own).signed_distance_to(&theirs.placed(q, other))
                }
                None => f64::INFINITY,
            }
        })?;
        mark_contacts(&gaps, near, |i| {
            out[i] = Some(ContactEvent { normal: [0.0, 1.0], level: 0.0, obstacle: Obstacle::Body(k) })
        });
    }
    Ok(out)
}

/// Number of pairs of corners visited between two checks of the budget: about a millisecond.
const CORNER_PAIRS_PER_CHECK: usize = 1 << 14;

/// Applies `of`, which visits a number of pairs of corners, to rows; ends if the computation is cancelled.
fn checked_gaps<I: IntoIterator>(
    rows: I,
    corner_pairs: usize,
    progress: &dyn Progress,
    of: impl Fn(I::Item) -> f64,
) -> Result<Vec<f64>> {
    let rows_per_check = (CORNER_PAIRS_PER_CHECK / corner_pairs.max(1)).max(1);
    let one = |(i, row): (usize, I::Item)| {
        if i.is_multiple_of(rows_per_check) {
            progress.check_stop()?;
        }
        Ok(of(row))
    };
    rows.into_iter().enumerate().map(one).collect()
}

/// Angle of a body at the time of an observation, rad; `None` if it was not observed.
pub fn observed_angle(trial: &Trial, body: usize, time: f64) -> Option<f64> {
    let at = trial.observed.times.partition_point(|s| *s < time);
    let angle = trial.observed.bodies[body].angle.get(at).copied();
    angle.filter(|a| a.is_finite())
}

/// Intervals (first row, end, contact) along one straight static in which the height varies no more than the
/// noise.
pub fn rolling_intervals(
    touches: &[Option<ContactEvent>],
    rows: &[TimedPosition],
) -> Vec<(usize, usize, ContactEvent)> {
    let mut out = Vec::new();
    let mut i = 0;
    while i < rows.len() {
        let Some(touch) = touches[i] else {
            i += 1;
            continue;
        };
        let turned = |n: [f64; 2]| (n[0] - touch.normal[0]).hypot(n[1] - touch.normal[1]);
        let same = |t: ContactEvent| {
            matches!(t.obstacle, Obstacle::Static(_))
                && t.obstacle == touch.obstacle
                && turned(t.normal) < 1e-3
        };
        let end = (i..rows.len()).find(|k| !touches[*k].is_some_and(same)).unwrap_or(rows.len());
        // A body slides or hops at the beginning of a landing.
        let from = i + if i > 0 { 2 } else { 0 };
        if end >= from + MIN_FLIGHT_OBSERVATIONS && is_level(&rows[from..end], touch.normal) {
            out.push((from, end, touch));
        }
        i = end.max(i + 1);
    }
    out
}

/// Whether heights along a normal vary no more than the noise, up to a small tilt of the camera.
fn is_level(rows: &[TimedPosition], n: [f64; 2]) -> bool {
    let along: Vec<(f64, f64)> =
        rows.iter().map(|(_, p)| (p[0] * n[1] - p[1] * n[0], p[0] * n[0] + p[1] * n[1])).collect();
    let (ways, heights): (Vec<f64>, Vec<f64>) = along.iter().copied().unzip();
    let noise = third_difference_noise(&[heights, ways]).unwrap_or(0.0);
    let tilt = slope(&along).unwrap_or(0.0).clamp(-MAX_CAMERA_TILT, MAX_CAMERA_TILT);
    let levels = along.iter().map(|(way, height)| height - tilt * way);
    let mean = levels.clone().sum::<f64>() / along.len() as f64;
    let spread = levels.map(|l| (l - mean).powi(2)).sum::<f64>() / along.len() as f64;
    spread.sqrt() < 3.0 * noise + 1e-6
}

/// Rows at which a surface supports the body: it is within a radius of the surface (a tilted camera shifts
/// it) and does not accelerate towards it over neighbouring rows. `normal`: surface normal at a row, and
/// gravity along it.
fn supported_rows(
    rows: &[TimedPosition],
    gaps: &[f64],
    extent: f64,
    normal: impl Fn(usize) -> Result<[f64; 3]>,
) -> Result<Vec<bool>> {
    let n = rows.len();
    (0..n)
        .map(|i| {
            let about = i.saturating_sub(SUPPORT_ROWS)..(i + SUPPORT_ROWS + 1).min(n);
            if gaps[i] > extent || about.len() <= SUPPORT_ROWS || !about.clone().all(|k| gaps[k] <= extent) {
                return Ok(false);
            }
            let [nx, ny, pull] = normal(i)?;
            let heights = about.map(|k| (rows[k].0 - rows[i].0, rows[k].1[0] * nx + rows[k].1[1] * ny));
            Ok(pull < 0.0
                && curvature(&heights.collect::<Vec<_>>())
                    .is_some_and(|a| a.abs() < MAX_SUPPORTED_ACCELERATION * pull.abs()))
        })
        .collect()
}

/// Second derivative of the parabola through points (t, y) by least squares.
fn curvature(points: &[(f64, f64)]) -> Option<f64> {
    let basis = DMatrix::from_fn(points.len(), 3, |i, k| points[i].0.powi(k as i32));
    let y = DVector::from_fn(points.len(), |i, _| points[i].1);
    let beta = basis.svd(true, true).solve(&y, 1e-12).ok()?;
    Some(2.0 * beta[2])
}

/// Calls `touch` for every row at which a series of gaps indicates contact.
fn mark_contacts(gaps: &[f64], near: f64, mut touch: impl FnMut(usize)) {
    let n = gaps.len();
    for i in 0..n {
        if !gaps[i].is_finite() {
            continue;
        }
        let before = gaps[i.saturating_sub(1)];
        let after = gaps[(i + 1).min(n - 1)];
        // Change of the gap between rows: a bounce can be hidden within it.
        let far = gaps[i.saturating_sub(2)].max(before);
        let reach =
            if i >= 2 && far.is_finite() { (far - gaps[i]).max(0.0) } else { (after - gaps[i]).abs() };
        let turns = i > 0 && i + 1 < n && gaps[i] <= before && gaps[i] <= after;
        let low = gaps[i] < near;
        if low || (turns && gaps[i] < near + 0.8 * reach) {
            touch(i);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A minimum of the gap is a contact only if it is within the change of one row.
    #[test]
    fn minima_are_contacts_only_within_reach() {
        let marked = |gaps: &[f64]| {
            let mut out = Vec::new();
            mark_contacts(gaps, 0.01, |i| out.push(i));
            out
        };
        assert_eq!(
            marked(&[0.5, 0.3, 0.1, 0.2, 0.4]),
            [2],
            "it came 0.2 m nearer a step, and has turned 0.1 m off"
        );
        assert_eq!(marked(&[0.5, 0.45, 0.43, 0.45, 0.5]), [0; 0], "it turned where it could not reach");
        assert_eq!(marked(&[0.3, 0.005, 0.005, f64::NAN, 0.3]), [1, 2], "what lies there touches");
    }

    #[test]
    fn curvature_of_a_fall_is_gravity() {
        let fall: Vec<(f64, f64)> =
            [0.0, 0.1, 0.25, 0.3, 0.5].map(|t: f64| (t, 2.0 + 3.0 * t - 4.905 * t * t)).to_vec();
        assert!((curvature(&fall).unwrap() + 9.81).abs() < 1e-9);
    }

    /// Rolling is detected along a slope, but not where the height varies by more than the noise.
    #[test]
    fn rolling_bodies_stay_level() {
        let normal = [-0.6, 0.8];
        let rows = |sag: f64| -> Vec<TimedPosition> {
            let at = |i: i32| {
                let noise = |k: i32| 1e-4 * libm::sin(f64::from(k + i * i));
                let way = 0.05 * f64::from(i) + noise(7);
                let up = noise(0) + sag * way * way;
                (0.02 * f64::from(i), [way * normal[1] + up * normal[0], -way * normal[0] + up * normal[1]])
            };
            (0..30).map(at).collect()
        };
        let touch = ContactEvent { normal, level: 0.0, obstacle: Obstacle::Static(0) };
        let mut touches = vec![Some(touch); 30];
        touches[..4].fill(None);
        let found = |sag| {
            rolling_intervals(&touches, &rows(sag)).into_iter().map(|(a, b, _)| (a, b)).collect::<Vec<_>>()
        };
        assert_eq!(found(0.0), [(6, 30)], "two rows of the landing do not count");
        assert_eq!(found(0.05), [], "it sinks in");
        touches[12] = Some(ContactEvent { normal: [0.0, 1.0], ..touch });
        assert_eq!(rolling_intervals(&touches, &rows(0.0))[0].0, 15, "another slope is another roll");
    }
}
