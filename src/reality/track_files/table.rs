//! A file as a table of named columns: the common form of all formats of tracking programs.

use super::columns::{ColumnQuantity, TrackColumn};

/// Named columns and their cells.
#[derive(Debug)]
pub struct Table {
    /// Line of the column names, from 1.
    pub header_line: usize,
    pub columns: Vec<TrackColumn>,
    /// Line number, from 1, and cells of each row.
    pub records: Vec<(usize, Vec<String>)>,
    /// Frames per second, if the file states it.
    pub frame_rate: Option<f64>,
    /// Remarks for the user.
    pub notes: Vec<String>,
}

impl Table {
    pub fn new(header_line: usize, columns: Vec<TrackColumn>, records: Vec<(usize, Vec<String>)>) -> Table {
        Table { header_line, columns, records, frame_rate: None, notes: Vec::new() }
    }

    /// Tables of the runs, if the columns are of several runs; otherwise the table itself. Runs without times of their own share those of no
    /// run.
    pub fn by_run(self) -> Vec<(Option<String>, Table)> {
        let mut runs: Vec<&String> = Vec::new();
        for run in self.columns.iter().filter_map(|c| c.run.as_ref()) {
            if !runs.contains(&run) {
                runs.push(run);
            }
        }
        if runs.len() < 2 {
            return vec![(None, self)];
        }
        let table = |run: &String| {
            let is_own = |c: &TrackColumn| c.run.as_ref() == Some(run);
            let has_clock = self.columns.iter().any(|c| is_own(c) && is_clock(c));
            let is_used = |c: &TrackColumn| is_own(c) || !has_clock && c.run.is_none() && is_clock(c);
            let own: Vec<usize> = (0..self.columns.len()).filter(|i| is_used(&self.columns[*i])).collect();
            let cells = |row: &Vec<String>| -> Vec<String> {
                own.iter().map(|i| row.get(*i).cloned().unwrap_or_default()).collect()
            };
            let records = self.records.iter().map(|(line, row)| (*line, cells(row)));
            let records = records.filter(|(_, row)| row.iter().any(|c| !c.trim().is_empty())).collect();
            let columns = own.iter().map(|i| self.columns[*i].clone()).collect();
            (Some(run.clone()), Table::new(self.header_line, columns, records))
        };
        runs.into_iter().map(table).collect()
    }
}

fn is_clock(column: &TrackColumn) -> bool {
    use ColumnQuantity::{Frame, Interval, Time};
    matches!(column.quantity, Some(Time | Frame | Interval))
}
