//! Tables of DeepLabCut: a line for the scorer, one for individuals (if there are several), body parts and coordinates each.

use super::columns::{ColumnQuantity, LENGTHS, TrackColumn, unit_named};
use super::header::lines_of_cells;
use super::table::Table;
use super::track_rows::invalid_value;
use crate::budget::Budget;
use crate::error::Result;

/// Whether a text begins like a table of DeepLabCut.
pub fn is_deeplabcut(start: &str) -> bool {
    start.lines().take(4).any(|l| l.split([',', ';', '\t']).next() == Some("bodyparts"))
}

/// Columns are named after individual and body part; the first is the frame number. Coordinates are in pixels.
pub fn table(text: &str, budget: &dyn Budget) -> Result<Table> {
    let mut records = lines_of_cells(text, budget)?;
    let row =
        |name: &str| records.iter().take(4).position(|(_, cells)| cells.first().is_some_and(|c| c == name));
    let (Some(parts), Some(coordinates)) = (row("bodyparts"), row("coords")) else {
        return Err(invalid_value(
            1,
            "header",
            "without a line `coords`",
            "the lines that DeepLabCut writes",
        ));
    };
    let individuals = row("individuals");
    let cell = |line: usize, i: usize| records[line].1.get(i).map_or("", |c| c.trim());
    let column = |i: usize| {
        if i == 0 {
            return TrackColumn::of_quantity("frame", ColumnQuantity::Frame, None);
        }
        let part = cell(parts, i);
        let individual =
            individuals.map(|line| cell(line, i)).filter(|name| !name.is_empty() && *name != "single");
        let track = individual.map_or(part.to_string(), |name| format!("{name}_{part}"));
        let name = format!("{track}_{}", cell(coordinates, i));
        let pixels = unit_named(&LENGTHS, "px");
        let known = |quantity, unit| TrackColumn {
            track: Some(track.clone()),
            ..TrackColumn::of_quantity(&name, quantity, unit)
        };
        match cell(coordinates, i) {
            "x" => known(ColumnQuantity::X, pixels),
            "y" => known(ColumnQuantity::Y, pixels),
            "likelihood" => known(ColumnQuantity::Likelihood, None),
            _ => TrackColumn::other(&name),
        }
    };
    let columns = (0..records[coordinates].1.len()).map(column).collect();
    let header = records[coordinates].0;
    records.drain(..=coordinates);
    Ok(Table::new(header, columns, records))
}
