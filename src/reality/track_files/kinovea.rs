//! Text files of Kinovea: a line `#T X Y`, and lines of numbers below the name of each track.

use super::columns::{ColumnQuantity, TrackColumn};
use super::table::Table;

/// Whether a text begins like one of Kinovea's.
pub fn is_kinovea(start: &str) -> bool {
    start.starts_with("#Kinovea")
}

/// Tracks are bodies; one without a name has a number.
pub fn table(text: &str) -> Table {
    let columns = vec![
        TrackColumn::of_quantity("body", ColumnQuantity::Body, None),
        TrackColumn::of_quantity("T", ColumnQuantity::Time, None),
        TrackColumn::of_quantity("X", ColumnQuantity::X, None),
        TrackColumn::of_quantity("Y", ColumnQuantity::Y, None),
    ];
    let mut records = Vec::new();
    let (mut name, mut tracks, mut was_blank) = (None, 0, true);
    for (i, line) in text.lines().enumerate() {
        let content = line.trim();
        if let Some(comment) = content.strip_prefix('#') {
            let comment = comment.trim();
            if !comment.is_empty() && !comment.starts_with("Kinovea") && comment != "T X Y" {
                name = Some(comment.to_string());
            }
        } else if !content.is_empty() {
            if was_blank {
                tracks += 1;
            }
            let body = name.clone().unwrap_or_else(|| format!("track {tracks}"));
            let cells = std::iter::once(body).chain(content.split_whitespace().map(String::from));
            records.push((i + 1, cells.collect()));
        }
        was_blank = content.is_empty() || content.starts_with('#');
    }
    Table::new(2, columns, records)
}
