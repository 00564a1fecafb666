//! Header of a track file: its position, the separator of its cells, and the lines below it.

use super::columns::{ColumnQuantity, TrackColumn, column};
use super::track_rows::invalid_value;
use crate::budget::{Budget, checked};
use crate::error::Result;

/// Header line with the track names above it.
pub struct TableHeader {
    /// Line number, from 1.
    pub line: usize,
    separator: Separator,
    pub columns: Vec<TrackColumn>,
}

#[derive(Clone, Copy, PartialEq)]
enum Separator {
    Character(char),
    Blanks,
}

/// Maximum number of lines above the header.
const MAX_PREAMBLE_LINES: usize = 50;

/// Finds the header: the first line with a time or frame column and a coordinate.
pub fn head(text: &str) -> Result<TableHeader> {
    let (mut above, mut first): (Vec<String>, Option<&str>) = (Vec::new(), None);
    for (i, raw) in text.lines().enumerate().take(MAX_PREAMBLE_LINES) {
        let line = raw.trim_start_matches('\u{feff}');
        let commented = line.trim_start().starts_with('#');
        let line = if commented { line.trim_start().trim_start_matches('#').trim_start() } else { line };
        if line.trim().is_empty() {
            continue;
        }
        let separator = separator(line);
        let cells = split(line, separator);
        let mut columns: Vec<TrackColumn> = cells.iter().map(|c| column(c)).collect();
        let any = |wanted: &[ColumnQuantity]| {
            columns.iter().any(|c| c.quantity.is_some_and(|q| wanted.contains(&q)))
        };
        if any(&[ColumnQuantity::Time, ColumnQuantity::Frame]) && any(&[ColumnQuantity::X, ColumnQuantity::Y])
        {
            name_tracks(&mut columns, &above);
            return Ok(TableHeader { line: i + 1, separator, columns });
        }
        first = first.or((!commented).then_some(raw));
        let all_numbers =
            cells.iter().all(|c| c.trim().is_empty() || c.trim().replace(',', ".").parse::<f64>().is_ok());
        if all_numbers && !commented {
            break;
        }
        if !commented {
            above = cells;
        }
    }
    let shown: String = first.unwrap_or("empty").trim().chars().take(80).collect();
    let allowed = "a line that names the columns: a time (`t`, `time`, `Time (s)`; or `frame`) and the coordinates (`x` and \
                   `y`, `pos_x`, `X [m]`, `x_px`, `Ball/0/X`)";
    Err(invalid_value(1, "header", &format!("{shown:?}"), allowed))
}

/// Tracker writes the names of several tracks above their columns, each above its first column.
fn name_tracks(columns: &mut [TrackColumn], above: &[String]) {
    let xs = columns.iter().filter(|c| c.quantity == Some(ColumnQuantity::X) && c.track.is_none()).count();
    if xs < 2 {
        return;
    }
    let mut name = None;
    for (i, column) in columns.iter_mut().enumerate() {
        let own = above.get(i).map(|c| c.trim()).filter(|c| !c.is_empty());
        name = own.map(String::from).or(name);
        if matches!(column.quantity, Some(ColumnQuantity::X | ColumnQuantity::Y)) && column.track.is_none() {
            column.track.clone_from(&name);
        }
    }
}

fn separator(line: &str) -> Separator {
    ['\t', ';', ','].into_iter().find(|c| line.contains(*c)).map_or(Separator::Blanks, Separator::Character)
}

fn split(line: &str, separator: Separator) -> Vec<String> {
    match separator {
        Separator::Blanks => line.split_whitespace().map(String::from).collect(),
        Separator::Character(c) => {
            let mut reader = reader(line, c);
            let first = reader.records().next().and_then(|r| r.ok());
            first.map(|r| r.iter().map(String::from).collect()).unwrap_or_default()
        }
    }
}

fn reader(text: &str, separator: char) -> csv::Reader<&[u8]> {
    let mut builder = csv::ReaderBuilder::new();
    builder.has_headers(false).flexible(true).comment(Some(b'#')).delimiter(separator as u8);
    builder.from_reader(text.as_bytes())
}

impl TableHeader {
    /// Lines below the header with their line numbers, split into cells.
    pub fn records(&self, text: &str, budget: &dyn Budget) -> Result<Vec<(usize, Vec<String>)>> {
        let below: usize = text.split_inclusive('\n').take(self.line).map(str::len).sum();
        let below = &text[below..];
        let Separator::Character(separator) = self.separator else {
            let lines = below.lines().enumerate().filter(|(_, l)| !l.trim_start().starts_with('#'));
            let cells = |(i, l)| (self.line + 1 + i, split(l, Separator::Blanks));
            return checked(lines, budget).map(|line| line.map(cells)).collect();
        };
        let mut records = Vec::new();
        for record in checked(reader(below, separator).records(), budget) {
            let record = record?.map_err(|e| {
                let line = e.position().map_or(0, |p| p.line() as usize) + self.line;
                invalid_value(line, "", "", &format!("separated values ({e})"))
            })?;
            let line = record.position().map_or(0, |p| p.line() as usize) + self.line;
            records.push((line, record.iter().map(String::from).collect()));
        }
        Ok(records)
    }
}
