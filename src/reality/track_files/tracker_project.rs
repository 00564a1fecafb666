//! Projects of Tracker (`.trk`): the point masses of a video in the project's coordinate system.
//!
//! Source: files of Tracker 5 and 6, and its loaders (`org.opensourcephysics.media.core`). Points are stored in image pixels, y
//! down, under the number of their video frame; the coordinate system has origin (pixels), angle (degrees) and scale (pixels per
//! unit of length) by frame, each valid until the next.
//!
//! Differences from the source: a coordinate system that moves with a track is not followed; frame times of a video container are
//! replaced by the mean frame duration.

use roxmltree::{Document, Node};

use super::columns::{ColumnQuantity, LENGTHS, TIMES, TrackColumn, unit_named};
use super::table::Table;
use super::track_rows::invalid_value;
use super::xml::line;
use crate::error::Result;

/// The point masses of a project, as bodies.
pub fn table(document: &Document) -> Result<Table> {
    let Some(panel) = document.descendants().find(|n| is_object(*n, "TrackerPanel")) else {
        let root = document.root_element().tag_name().name();
        let allowed = "a project of Tracker (.trk), or tracks of TrackMate";
        return Err(invalid_value(1, "", &format!("XML of <{root}>"), allowed));
    };
    let clip = object(panel, "videoclip");
    let number = |node: Option<Node>, name: &str| node.and_then(|n| value(n, name)?.parse::<f64>().ok());
    let duration = number(object(panel, "clipcontrol"), "delta_t").filter(|d| *d > 0.0);
    let Some(duration) = duration else {
        return Err(invalid_value(line(panel), "delta_t", "missing", "the duration of a frame, ms"));
    };
    let first = number(clip, "startframe").unwrap_or(0.0);
    let start = number(clip, "starttime").unwrap_or(0.0);
    let systems = coordinate_systems(panel)?;
    let mut records = Vec::new();
    for mass in panel.descendants().filter(|n| is_object(*n, "PointMass")) {
        let name = value(mass, "name").unwrap_or("mass");
        for (frame, point) in frame_data(mass) {
            let (Some(x), Some(y)) = (number(Some(point), "x"), number(Some(point), "y")) else { continue };
            let t = 1e-3 * (start + (frame as f64 - first) * duration);
            let system = systems.iter().rev().find(|s| s.0 <= frame).unwrap_or(&systems[0]);
            let [x, y] = system.1.world(x, y);
            records.push((line(point), vec![name.to_string(), t.to_string(), x.to_string(), y.to_string()]));
        }
    }
    if records.is_empty() {
        return Err(invalid_value(
            line(panel),
            "PointMass",
            "missing",
            "at least one point mass with points",
        ));
    }
    // A scale of one pixel is that of a project without calibration.
    let calibrated = systems.iter().any(|s| s.1.scale != [1.0; 2]);
    let unit = if calibrated { value(panel, "length_unit").unwrap_or("m") } else { "px" };
    let coordinate =
        |name: &str, quantity| TrackColumn::of_quantity(name, quantity, unit_named(&LENGTHS, unit));
    let columns = vec![
        TrackColumn::of_quantity("body", ColumnQuantity::Body, None),
        TrackColumn::of_quantity("t", ColumnQuantity::Time, unit_named(&TIMES, "s")),
        coordinate("x", ColumnQuantity::X),
        coordinate("y", ColumnQuantity::Y),
    ];
    let mut table = Table::new(1, columns, records);
    if let Some(coordinates) = object(panel, "coords")
        && value(coordinates, "referenceframe").is_some()
    {
        table.notes.push("the coordinate system moves with a track, which is not followed".into());
    }
    Ok(table)
}

/// Position of a world's axes in the image.
struct CoordinateSystem {
    /// Image pixels.
    origin: [f64; 2],
    /// rad, counterclockwise.
    angle: f64,
    /// Image pixels per unit of length.
    scale: [f64; 2],
}

impl CoordinateSystem {
    /// Coordinates, y up, of a point of the image.
    fn world(&self, x: f64, y: f64) -> [f64; 2] {
        let (u, v) = ((x - self.origin[0]) / self.scale[0], (self.origin[1] - y) / self.scale[1]);
        let (sin, cos) = self.angle.sin_cos();
        [u * cos + v * sin, v * cos - u * sin]
    }
}

/// Coordinate systems with the first frames they are valid for, in order.
fn coordinate_systems(panel: Node) -> Result<Vec<(usize, CoordinateSystem)>> {
    let Some(coordinates) = object(panel, "coords") else {
        return Err(invalid_value(line(panel), "coords", "missing", "a coordinate system"));
    };
    let mut systems = Vec::new();
    for (frame, data) in frame_data(coordinates) {
        let number = |name: &str, default: f64| match value(data, name) {
            None => Ok(default),
            Some(text) => text
                .parse::<f64>()
                .ok()
                .filter(|v| v.is_finite())
                .ok_or_else(|| invalid_value(line(data), name, &format!("{text:?}"), "a number")),
        };
        let scale = [number("xscale", 1.0)?, number("yscale", 1.0)?];
        if scale.iter().any(|s| *s <= 0.0) {
            return Err(invalid_value(line(data), "xscale", &format!("{scale:?}"), "scales above 0"));
        }
        let origin = [number("xorigin", 0.0)?, number("yorigin", 0.0)?];
        systems.push((frame, CoordinateSystem { origin, angle: number("angle", 0.0)?.to_radians(), scale }));
    }
    systems.sort_by_key(|s| s.0);
    if systems.is_empty() {
        return Err(invalid_value(line(coordinates), "coords", "empty", "a coordinate system"));
    }
    Ok(systems)
}

/// Whether an element is an object of the Java class `class`, without its package.
fn is_object(node: Node, class: &str) -> bool {
    node.has_tag_name("object")
        && node.attribute("class").is_some_and(|name| name.rsplit('.').next() == Some(class))
}

/// The child property called `name`.
fn property<'a, 'i>(object: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    object.children().find(|n| n.has_tag_name("property") && n.attribute("name") == Some(name))
}

/// The text of a property.
fn value<'a>(object: Node<'a, '_>, name: &str) -> Option<&'a str> {
    property(object, name)?.text().map(str::trim)
}

/// The object that is the value of a property.
fn object<'a, 'i>(parent: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    property(parent, name)?.children().find(|n| n.has_tag_name("object"))
}

/// The objects of the array `framedata` with their frame numbers.
fn frame_data<'a, 'i: 'a>(object: Node<'a, 'i>) -> impl Iterator<Item = (usize, Node<'a, 'i>)> {
    let entries = property(object, "framedata").into_iter().flat_map(|data| data.children());
    entries.filter_map(|entry| {
        let number = entry.attribute("name")?.strip_prefix('[')?.strip_suffix(']')?;
        Some((number.parse().ok()?, entry.children().find(|n| n.has_tag_name("object"))?))
    })
}
