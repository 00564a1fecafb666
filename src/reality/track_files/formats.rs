//! Recognises the format of a file.

use super::header::{head, join_decimal_commas, read_unit_rows};
use super::table::Table;
use super::{deeplabcut, kinovea, qualisys, tracker_project, trackmate_xml, xml};
use crate::budget::Budget;
use crate::error::Result;

/// Parses a file; `columns` are the column names of a file without a header line.
pub fn table(text: &str, columns: Option<&str>, budget: &dyn Budget) -> Result<Table> {
    let start = text.trim_start_matches('\u{feff}').trim_start();
    if start.starts_with('<') {
        let document = xml::parse(text)?;
        return match trackmate_xml::table(&document)? {
            Some(table) => Ok(table),
            None => tracker_project::table(&document),
        };
    }
    if qualisys::is_qualisys(start) {
        return qualisys::table(text, budget);
    }
    if deeplabcut::is_deeplabcut(start) {
        return deeplabcut::table(text, budget);
    }
    if kinovea::is_kinovea(start) {
        return Ok(kinovea::table(text));
    }
    let head = head(text, columns)?;
    let records = head.records(text, budget)?;
    let mut table = Table::new(head.line, head.columns, records);
    read_unit_rows(&mut table);
    join_decimal_commas(&mut table);
    Ok(table)
}
