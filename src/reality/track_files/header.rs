//! Header of a track file: its position, the separator of its cells, and the lines below it.

use super::columns::{self, ColumnQuantity, TrackColumn, column};
use super::table::Table;
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

/// Finds the header: the first line with a coordinate and a time, a frame or a second coordinate. A file without one has its
/// columns named by `names`, separated by commas.
pub fn head(text: &str, names: Option<&str>) -> Result<TableHeader> {
    if let Some(names) = names {
        return named_by_user(text, names);
    }
    let (mut above, mut first): (Vec<String>, Option<&str>) = (Vec::new(), None);
    for (i, raw) in text.lines().enumerate().take(MAX_PREAMBLE_LINES) {
        let line = raw.trim_start_matches('\u{feff}');
        let commented = is_comment(line);
        let line =
            if commented { line.trim_start().trim_start_matches(['#', '%']).trim_start() } else { line };
        if line.trim().is_empty() {
            continue;
        }
        let separator = separator(line);
        let cells = split(line, separator);
        let mut columns: Vec<TrackColumn> = cells.iter().map(|c| column(c)).collect();
        if is_header(&columns) {
            name_tracks(&mut columns, &above);
            return Ok(TableHeader { line: i + 1, separator, columns });
        }
        first = first.or((!commented).then_some(raw));
        if !commented && cells.iter().all(|c| is_number(c)) {
            break;
        }
        if !commented {
            above = cells;
        }
    }
    let shown: String = first.unwrap_or("empty").trim().chars().take(80).collect();
    let allowed = "a line that names the columns: a time (`t`, `time`, `Time (s)`; or `frame`) and the coordinates (`x` and \
                   `y`, `pos_x`, `X [m]`, `x_px`, `Ball/0/X`); or give `columns`, such as \"t,x,y\"";
    Err(invalid_value(1, "header", &format!("{shown:?}"), allowed))
}

fn is_comment(line: &str) -> bool {
    line.trim_start().starts_with(['#', '%'])
}

fn is_number(cell: &str) -> bool {
    cell.trim().is_empty() || cell.trim().replace(',', ".").parse::<f64>().is_ok()
}

fn is_header(columns: &[TrackColumn]) -> bool {
    let any =
        |wanted: &[ColumnQuantity]| columns.iter().any(|c| c.quantity.is_some_and(|q| wanted.contains(&q)));
    let coordinates =
        [ColumnQuantity::X, ColumnQuantity::Y, ColumnQuantity::Z].into_iter().filter(|q| any(&[*q])).count();
    let single = any(&[ColumnQuantity::Height, ColumnQuantity::Distance]);
    let has_time = any(&[ColumnQuantity::Time, ColumnQuantity::Frame, ColumnQuantity::Interval]);
    coordinates >= 2 || (coordinates == 1 || single) && has_time
}

/// The header of a file whose lines are all numbers.
fn named_by_user(text: &str, names: &str) -> Result<TableHeader> {
    let columns: Vec<TrackColumn> = names.split(',').map(column).collect();
    if !is_header(&columns) {
        let allowed = "names separated by commas, of a time (`t` or `frame`) and coordinates: \"t,x,y\"";
        return Err(invalid_value(1, "columns", &format!("{names:?}"), allowed));
    }
    let numbers = |line: &&str| {
        !line.trim().is_empty()
            && !is_comment(line)
            && split(line, separator(line)).iter().all(|c| is_number(c))
    };
    let first = text.lines().take(MAX_PREAMBLE_LINES).position(|line| numbers(&line));
    let Some(line) = first else {
        return Err(invalid_value(1, "", "", "a line of numbers, since `columns` names the columns"));
    };
    let separator = separator(text.lines().nth(line).unwrap_or_default());
    Ok(TableHeader { line, separator, columns })
}

/// Maximum number of lines of names or units below the header.
const MAX_UNIT_ROWS: usize = 4;

/// Removes the lines of units or further names below the header, and takes the units. TrackMate writes three such lines.
pub fn read_unit_rows(table: &mut Table) {
    let read: Vec<usize> = (0..table.columns.len())
        .filter(|i| {
            use ColumnQuantity::{Distance, Frame, Height, Interval, Time, X, Y, Z};
            matches!(
                table.columns[*i].quantity,
                Some(Time | Frame | Interval | X | Y | Z | Height | Distance)
            )
        })
        .collect();
    for _ in 0..MAX_UNIT_ROWS {
        let Some((_, cells)) = table.records.first() else { return };
        let filled: Vec<(usize, &str)> = read
            .iter()
            .filter_map(|i| Some((*i, cells.get(*i)?.trim())))
            .filter(|(_, cell)| !cell.is_empty())
            .collect();
        let describes = |cell: &str| columns::unit_of_cell(cell).is_some() || column(cell).quantity.is_some();
        if filled.is_empty() || !filled.iter().all(|(_, cell)| describes(cell)) {
            return;
        }
        let units: Vec<_> = filled.iter().map(|(i, cell)| (*i, columns::unit_of_cell(cell))).collect();
        for (i, unit) in units {
            let column = &mut table.columns[i];
            if let (Some(quantity), None, Some(unit)) = (column.quantity, column.unit, unit)
                && columns::fits(quantity, Some(unit))
            {
                column.unit = Some(unit);
            }
        }
        table.records.remove(0);
    }
}

/// Joins numbers whose decimal commas were taken for separators: every line then has twice as many cells as the header.
pub fn join_decimal_commas(table: &mut Table) {
    let is_digits = |cell: &String| !cell.is_empty() && cell.chars().all(|c| c.is_ascii_digit());
    let count = table.columns.len();
    let is_split =
        |cells: &Vec<String>| cells.len() == 2 * count && cells.iter().skip(1).step_by(2).all(is_digits);
    if table.records.is_empty() || !table.records.iter().all(|(_, cells)| is_split(cells)) {
        return;
    }
    for (_, cells) in &mut table.records {
        *cells = cells.chunks(2).map(|pair| pair.join(",")).collect();
    }
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
        if matches!(column.quantity, Some(ColumnQuantity::X | ColumnQuantity::Y | ColumnQuantity::Z))
            && column.track.is_none()
        {
            column.track.clone_from(&name);
        }
    }
}

/// The separator of a line's cells.
fn separator(line: &str) -> Separator {
    ['\t', ';', ','].into_iter().find(|c| line.contains(*c)).map_or(Separator::Blanks, Separator::Character)
}

fn split(line: &str, separator: Separator) -> Vec<String> {
    match separator {
        Separator::Blanks => line.split_whitespace().map(|cell| cell.trim_matches('"').to_string()).collect(),
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

/// All lines with their numbers, split into cells by the separator of the first.
pub fn lines_of_cells(text: &str, budget: &dyn Budget) -> Result<Vec<(usize, Vec<String>)>> {
    let text = text.trim_start_matches('\u{feff}');
    let separator = separator(text.lines().next().unwrap_or_default());
    TableHeader { line: 0, separator, columns: Vec::new() }.records(text, budget)
}

impl TableHeader {
    /// Lines below the header with their line numbers, split into cells.
    pub fn records(&self, text: &str, budget: &dyn Budget) -> Result<Vec<(usize, Vec<String>)>> {
        let below: usize = text.split_inclusive('\n').take(self.line).map(str::len).sum();
        let below = &text[below..];
        let Separator::Character(separator) = self.separator else {
            let lines = below.lines().enumerate().filter(|(_, l)| !is_comment(l));
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
