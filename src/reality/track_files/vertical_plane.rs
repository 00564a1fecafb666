//! Tracks of three coordinates, projected on the best vertical plane of each trial.
//!
//! Without spin and side wind a thrown body stays in a vertical plane. Its direction is that of the largest horizontal variance of
//! the trial; what leaves the plane is reported.

use super::parse_options::TrackParseOptions;
use super::read::TrackTable;
use super::unit_checks::median_acceleration;
use crate::error::{Error, Result};

/// Ratio of the accelerations along two axes above which the axis of the fall is clear.
const MIN_FALL_RATIO: f64 = 3.0;
/// Deviation from the plane, relative to the extent of the motion, that is worth a warning.
const LARGE_DEVIATION: f64 = 0.03;
/// Horizontal extent, relative to the vertical one, below which a trial has no direction of its own.
const MIN_HORIZONTAL_EXTENT: f64 = 0.02;

const AXES: [&str; 3] = ["x", "y", "z"];

/// Vertical axis: its index, and 1 if it points up or -1 if down.
#[derive(Clone, Copy)]
struct UpAxis {
    index: usize,
    sign: f64,
}

/// Replaces three coordinates by the distance along the trial's plane and the height. Returns a remark, if there was a third
/// coordinate.
pub fn project(tables: &mut [TrackTable], options: &TrackParseOptions) -> Result<Option<String>> {
    let varies = |table: &TrackTable| table.z.iter().any(|z| z.is_finite() && *z != table.z[0]);
    if !tables.iter().any(varies) {
        tables.iter_mut().for_each(|t| t.z.clear());
        return match &options.up {
            Some(up) => Err(Error::input("up", format!("{up:?}"), "files of three coordinates")),
            None => Ok(None),
        };
    }
    if let Some(flat) = tables.iter().find(|t| t.z.is_empty()) {
        let value = format!("missing in {}", flat.file);
        return Err(Error::input("z", value, "three coordinates in all files, or two"));
    }
    if options.y_down.is_some() {
        return Err(Error::input("y_down", "given for three coordinates", "`up`, the axis that points up"));
    }
    let (up, found) = match &options.up {
        Some(up) => (declared(up)?, String::new()),
        None => from_fall(tables)?,
    };
    let (mut squares, mut points, mut extent): (f64, usize, f64) = (0.0, 0, 0.0);
    for table in tables {
        let z = std::mem::take(&mut table.z);
        let mut start = 0;
        for trial in table.rows.chunk_by_mut(|a, b| a.trial == b.trial) {
            let place = |(row, z): (&super::track_rows::TrackRow, &f64)| [row.values[0], row.values[1], *z];
            let places: Vec<[f64; 3]> = trial.iter().zip(&z[start..]).map(place).collect();
            start += trial.len();
            let plane = VerticalPlane::fit(&places, up);
            for (row, place) in trial.iter_mut().zip(&places) {
                [row.values[0], row.values[1]] = [plane.distance_along(place), up.sign * place[up.index]];
            }
            let across = places.iter().map(|p| plane.distance_from(p)).filter(|v| v.is_finite());
            for value in across {
                squares += value * value;
                points += 1;
            }
            extent = extent.max(plane.extent);
        }
    }
    let rms = (squares / points.max(1) as f64).sqrt();
    let sign = if up.sign < 0.0 { "-" } else { "" };
    let mut note = format!(
        "three coordinates: {sign}{} is up{found}; each trial is projected on its best vertical plane, which it leaves by {:.1} mm \
         rms, {:.1} % of its extent",
        AXES[up.index],
        1e3 * rms,
        100.0 * rms / extent
    );
    if rms > LARGE_DEVIATION * extent {
        note += ": forces across the plane, such as those of side spin, are not described";
    }
    Ok(Some(note))
}

fn declared(up: &str) -> Result<UpAxis> {
    let (sign, name) = up.strip_prefix('-').map_or((1.0, up), |name| (-1.0, name));
    let index = AXES.iter().position(|axis| name.eq_ignore_ascii_case(axis));
    let index = index.ok_or_else(|| Error::input("up", format!("{up:?}"), "x, y, z, -x, -y or -z"))?;
    Ok(UpAxis { index, sign })
}

/// The axis along which bodies fall, and a remark on it.
fn from_fall(tables: &[TrackTable]) -> Result<(UpAxis, String)> {
    let falls = [0, 1, 2].map(|axis| {
        let tracks = tables.iter().flat_map(|table| {
            let mut start = 0;
            table.rows.chunk_by(|a, b| a.trial == b.trial).map(move |trial| {
                let z = &table.z[start..start + trial.len()];
                start += trial.len();
                let value = |i: usize| if axis == 2 { z[i] } else { trial[i].values[axis] };
                (0..trial.len()).map(|i| (trial[i].t, value(i))).collect()
            })
        });
        median_acceleration(tracks).map_or(0.0, |a| a.median)
    });
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| falls[*b].abs().total_cmp(&falls[*a].abs()));
    let index = order[0];
    if falls[index].abs() < MIN_FALL_RATIO * falls[order[1]].abs() || falls[index] == 0.0 {
        let rates: Vec<String> = (0..3).map(|i| format!("{} {:.2}", AXES[i], falls[i])).collect();
        let value = format!("not clear from the tracks: accelerations, m/s^2, {}", rates.join(", "));
        return Err(Error::input("up", value, "the axis that points up: x, y, z, -x, -y or -z"));
    }
    let sign = -falls[index].signum();
    Ok((UpAxis { index, sign }, format!(" (the tracks fall along it with {:.2} m/s^2)", falls[index].abs())))
}

/// The vertical plane of a trial.
struct VerticalPlane {
    horizontal: [usize; 2],
    /// Mean of the horizontal coordinates, m.
    centre: [f64; 2],
    /// Horizontal unit vector in the plane, in the direction of motion.
    direction: [f64; 2],
    /// Largest extent of the trial in the plane, m.
    extent: f64,
}

impl VerticalPlane {
    fn fit(places: &[[f64; 3]], up: UpAxis) -> VerticalPlane {
        let horizontal = match up.index {
            0 => [1, 2],
            1 => [0, 2],
            _ => [0, 1],
        };
        let known: Vec<&[f64; 3]> = places.iter().filter(|p| p.iter().all(|v| v.is_finite())).collect();
        let n = known.len().max(1) as f64;
        let mean = |axis: usize| known.iter().map(|p| p[axis]).sum::<f64>() / n;
        let centre = horizontal.map(mean);
        let moment = |a: usize, b: usize| {
            let of = |p: &&[f64; 3]| (p[horizontal[a]] - centre[a]) * (p[horizontal[b]] - centre[b]);
            known.iter().map(of).sum::<f64>()
        };
        let angle = 0.5 * (2.0 * moment(0, 1)).atan2(moment(0, 0) - moment(1, 1));
        let mut plane =
            VerticalPlane { horizontal, centre, direction: [angle.cos(), angle.sin()], extent: 0.0 };
        let extent = |value: &dyn Fn(&[f64; 3]) -> f64| {
            let values = || known.iter().map(|p| value(p));
            let range = values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min);
            range.max(0.0)
        };
        let vertical = extent(&|p| p[up.index]);
        let along = extent(&|p| plane.distance_along(p));
        if along < MIN_HORIZONTAL_EXTENT * vertical {
            plane.direction = [1.0, 0.0];
        } else if let (Some(first), Some(last)) = (known.first(), known.last())
            && plane.distance_along(last) < plane.distance_along(first)
        {
            plane.direction = plane.direction.map(|v| -v);
        }
        plane.extent = vertical.max(along);
        plane
    }

    /// Distance along the plane, m.
    fn distance_along(&self, place: &[f64; 3]) -> f64 {
        let [a, b] = self.horizontal;
        place[a] * self.direction[0] + place[b] * self.direction[1]
    }

    /// Distance from the plane, m.
    fn distance_from(&self, place: &[f64; 3]) -> f64 {
        let [a, b] = self.horizontal;
        (place[b] - self.centre[1]) * self.direction[0] - (place[a] - self.centre[0]) * self.direction[1]
    }
}

#[cfg(test)]
mod tests {
    use crate::budget::Unlimited;
    use crate::error::Result;
    use crate::reality::{LoadedTrials, Subject, TrackFile, TrackParseOptions, load_tracks};
    use crate::task::ball::BallScene;

    /// Throws in vertical planes of several directions, with the vertical in column `up`.
    fn throws(up: usize, sign: f64, side: f64) -> Vec<TrackFile> {
        let throw = |k: i32| {
            let (azimuth, mut text) = (f64::from(k), String::from("t,x,y,z\n"));
            for i in 0..40 {
                let t = 0.02 * f64::from(i);
                let (along, across) = (3.0 * t, side * t * t);
                let mut place = [
                    along * azimuth.cos() - across * azimuth.sin(),
                    along * azimuth.sin() + across * azimuth.cos(),
                    sign * (2.0 + 2.0 * t - 4.905 * t * t),
                ];
                place.swap(2, up);
                text += &format!("{t},{},{},{}\n", place[0], place[1], place[2]);
            }
            TrackFile { name: format!("throw{k}.csv"), text }
        };
        (0..4).map(throw).collect()
    }

    fn load(files: &[TrackFile], up: Option<&str>) -> Result<LoadedTrials> {
        let ball = BallScene { radius: 0.02, mass: None, gravity: None, floor: None };
        let options = TrackParseOptions { up: up.map(String::from), ..TrackParseOptions::default() };
        load_tracks(files, Subject::Ball(&ball), &options, &Unlimited)
    }

    #[test]
    fn finds_the_vertical_and_projects_each_trial() {
        for (up, sign) in [(2, 1.0), (1, -1.0), (0, 1.0)] {
            let loaded = load(&throws(up, sign, 0.0), None).unwrap();
            assert!(
                loaded.notes.iter().any(|n| n.contains("is up") && n.contains("0.0 mm")),
                "{:?}",
                loaded.notes
            );
            for trial in &loaded.trials {
                let track = &trial.observed.bodies[0];
                for (i, t) in trial.observed.times.iter().enumerate() {
                    let wanted = [3.0 * t, 2.0 + 2.0 * t - 4.905 * t * t];
                    let off = (track.x[i] - track.x[0] - wanted[0]).hypot(track.y[i] - wanted[1]);
                    assert!(off < 1e-9, "{up} {sign}: {off}");
                }
            }
        }
    }

    #[test]
    fn reports_what_leaves_the_plane_and_rejects_contradictions() {
        let loaded = load(&throws(2, 1.0, 2.5), None).unwrap();
        assert!(loaded.notes.iter().any(|n| n.contains("side spin")), "{:?}", loaded.notes);
        assert!(load(&throws(2, 1.0, 0.0), Some("z")).is_ok());
        let error = load(&throws(2, 1.0, 0.0), Some("up")).unwrap_err().to_string();
        assert!(error.contains("`up` is \"up\"; allowed: x, y, z"), "{error}");
        let flat = TrackFile { name: "a.csv".into(), text: "t,x,y\n0,1,2\n0.1,2,2\n0.2,3,1\n".into() };
        let error = load(&[flat], Some("z")).unwrap_err().to_string();
        assert!(error.contains("files of three coordinates"), "{error}");
    }
}
