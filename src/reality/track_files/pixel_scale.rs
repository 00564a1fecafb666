//! Size of a pixel and direction of y, for files of a ball in pixels that state neither.
//!
//! The size follows from the radius, if the tracking program measured it in pixels. It also follows from the fall, but then nothing
//! can be learnt about gravity: that size is only suggested. Rows of pictures count downwards, so that things seem to rise.

use super::columns::{ColumnQuantity, column_in_pixels};
use super::formats::table;
use super::parse_options::{TrackParseOptions, is_pixel_size_missing};
use super::read::TrackTable;
use super::selection::parse;
use super::track_rows::TrialPoints;
use super::unit_checks::{is_plausible, median_acceleration};
use crate::budget::Budget;
use crate::error::{Error, Result};

/// Size of a pixel, m, with a remark on how it was found: from the radii of a ball of this `radius`, m, in pixels. `None` without such a
/// column in every file.
pub fn pixel_size<'a>(
    files: impl Iterator<Item = &'a str>,
    radius: f64,
    reading: &TrackParseOptions,
    budget: &dyn Budget,
) -> Result<Option<(f64, String)>> {
    let mut radii = Vec::new();
    for text in files {
        let own = radii_in_pixels(text, reading, budget)?;
        if own.is_empty() {
            return Ok(None);
        }
        radii.extend(own);
    }
    radii.sort_by(f64::total_cmp);
    let Some(typical) = radii.get(radii.len() / 2).filter(|r| **r > 0.0) else { return Ok(None) };
    let size = radius / typical;
    let remark = format!(
        "a pixel is {size:.4e} m, since the ball's radius is {typical:.2} pixels (median of all pictures); `metres_per_pixel` sets another size"
    );
    Ok(Some((size, remark)))
}

/// Radii of a ball in a file, pixels; empty without a column of these.
fn radii_in_pixels(text: &str, reading: &TrackParseOptions, budget: &dyn Budget) -> Result<Vec<f64>> {
    let table = table(text, reading.columns.as_deref(), budget)?;
    let of =
        |quantity| table.columns.iter().position(|c| c.quantity == Some(quantity) && column_in_pixels(c));
    let (column, share) = match (of(ColumnQuantity::Radius), of(ColumnQuantity::Diameter)) {
        (Some(column), _) => (column, 1.0),
        (None, Some(column)) => (column, 0.5),
        (None, None) => return Ok(Vec::new()),
    };
    let value = |cells: &[String]| parse(cells.get(column)?, &mut None).ok().filter(|v| v.is_finite());
    Ok(table.records.iter().filter_map(|(_, cells)| value(cells)).map(|v| share * v).collect())
}

/// The error of a missing size with the size for which tracks in pixels fall with gravity; others as they are.
pub fn with_suggestion(error: Error, in_pixels: Option<&[TrialPoints]>, gravity: f64) -> Error {
    let fall = in_pixels.and_then(downward_acceleration).filter(|a| *a != 0.0 && gravity > 0.0);
    match (error, fall) {
        (Error::Input(mut input), Some(fall)) if is_pixel_size_missing(&input) => {
            input.allowed += &format!(
                "; with {:.3e} they fall with the gravity of {gravity} m/s^2, which then cannot be tested; or a column named radius, in pixels",
                gravity / fall.abs()
            );
            Error::Input(input)
        }
        (error, _) => error,
    }
}

/// Turns tracks in pictures upwards if things would rise in them otherwise; the remark on it.
pub fn turn_upwards(tables: &mut [TrackTable], gravity: f64) -> Option<String> {
    let points: Vec<TrialPoints> = tables.iter().flat_map(|t| TrialPoints::by_trial(&t.rows)).collect();
    let fall = downward_acceleration(&points).filter(|_| gravity > 0.0)? / gravity;
    if !is_plausible(-fall) {
        return None;
    }
    tables.iter_mut().flat_map(|t| &mut t.rows).for_each(|row| row.values[1] = -row.values[1]);
    Some(format!(
        "y counts downwards, as rows of pictures do: otherwise things would rise with {:.2} times gravity; `y_down` false keeps it",
        -fall
    ))
}

/// Acceleration against y in the unit of the points; `None` if no part of a track identifies it.
fn downward_acceleration(points: &[TrialPoints]) -> Option<f64> {
    let down = |p: &[f64; 3]| (p[0], -p[2]);
    median_acceleration(points.iter().map(|trial| trial.points.iter().map(down).collect())).map(|a| a.median)
}
