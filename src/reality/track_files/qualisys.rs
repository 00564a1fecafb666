//! Tables of Qualisys Track Manager (`.tsv`): lines of properties, an optional header, and rows of coordinates in mm.

use super::columns::{ColumnQuantity, LENGTHS, TIMES, TrackColumn, unit_named};
use super::header::lines_of_cells;
use super::table::Table;
use super::track_rows::invalid_value;
use crate::budget::Budget;
use crate::error::Result;

/// Whether a text begins like a table of Qualisys.
pub fn is_qualisys(start: &str) -> bool {
    start.starts_with("NO_OF_FRAMES\t") || start.starts_with("FILE_VERSION\t")
}

/// Columns are named after the markers. Rows without a frame number are counted from the first.
pub fn table(text: &str, budget: &dyn Budget) -> Result<Table> {
    let mut records = lines_of_cells(text, budget)?;
    let is_property = |cells: &[String]| {
        let is_upper = |name: &String| name.chars().all(|c| c.is_ascii_uppercase() || c == '_');
        cells.first().is_some_and(|name| !name.is_empty() && is_upper(name))
    };
    let header = records.iter().position(|(_, cells)| !is_property(cells)).unwrap_or(records.len());
    let property = |name: &str| {
        records[..header].iter().find(|(_, cells)| cells[0] == name).map(|(_, cells)| &cells[1..])
    };
    let rate = property("FREQUENCY").and_then(|cells| cells.first()?.trim().parse::<f64>().ok());
    let Some(rate) = rate.filter(|rate| *rate > 0.0 && rate.is_finite()) else {
        return Err(invalid_value(1, "FREQUENCY", "missing", "a frame rate above 0"));
    };
    let markers: Vec<String> =
        property("MARKER_NAMES").unwrap_or_default().iter().map(|m| m.trim().to_string()).collect();
    let markers: Vec<String> = markers.into_iter().filter(|m| !m.is_empty()).collect();
    if markers.is_empty() {
        return Err(invalid_value(1, "MARKER_NAMES", "missing", "at least one marker"));
    }
    let planar =
        property("DATA_INCLUDED").is_some_and(|cells| cells.first().is_some_and(|c| c.trim() == "2D"));
    let axes = if planar { &AXES[..2] } else { &AXES[..] };
    let mut columns = Vec::new();
    let is_name = |cells: &[String]| !cells[0].trim().is_empty() && cells[0].trim().parse::<f64>().is_err();
    let has_header = records.get(header).is_some_and(|(_, cells)| is_name(cells));
    let has_frames = has_header && records[header].1[0].trim().eq_ignore_ascii_case("frame");
    if has_frames {
        columns.push(TrackColumn::of_quantity("Frame", ColumnQuantity::Frame, None));
        columns.push(TrackColumn::of_quantity("Time", ColumnQuantity::Time, unit_named(&TIMES, "s")));
    }
    for marker in &markers {
        columns.extend(axes.iter().map(|(axis, quantity)| TrackColumn {
            track: Some(marker.clone()),
            ..TrackColumn::of_quantity(&format!("{marker} {axis}"), *quantity, unit_named(&LENGTHS, "mm"))
        }));
    }
    let line = records.get(header).map_or(1, |(line, _)| *line);
    records.drain(..header + usize::from(has_header));
    let first = if has_frames { 2 } else { 0 };
    for (_, cells) in &mut records {
        mark_missing(cells, first, axes.len());
    }
    Ok(Table { frame_rate: Some(rate), ..Table::new(line, columns, records) })
}

const AXES: [(&str, ColumnQuantity); 3] =
    [("X", ColumnQuantity::X), ("Y", ColumnQuantity::Y), ("Z", ColumnQuantity::Z)];

/// A marker that was not detected is written as zeros in all coordinates.
fn mark_missing(cells: &mut [String], first: usize, axes: usize) {
    for marker in cells.get_mut(first..).unwrap_or_default().chunks_mut(axes) {
        if marker.iter().all(|c| c.trim().parse::<f64>() == Ok(0.0)) {
            marker.iter_mut().for_each(String::clear);
        }
    }
}
