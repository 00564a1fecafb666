//! Options for parsing track files: units, frame rate, axis direction and track.

use serde::Deserialize;
use utoipa::ToSchema;

use super::columns::{ColumnUnit, LENGTHS, TIMES, TrackColumn, unit_named};
use super::track_rows::invalid_value;
use crate::error::{Error, InvalidInput, Result, check_range};

const IN_PIXELS: &str = "in pixels";

/// Whether an error says that the size of a pixel is missing.
pub fn is_pixel_size_missing(error: &InvalidInput) -> bool {
    error.value == IN_PIXELS
}

/// Units, and the track to read, if the files do not state them.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, ToSchema, clap::Args)]
#[serde(deny_unknown_fields)]
#[schema(as = ReadingIn)]
pub struct TrackParseOptions {
    /// Frames per second; times are then frame numbers.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub fps: Option<f64>,
    /// m per pixel; coordinates are then in pixels.
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub metres_per_pixel: Option<f64>,
    /// m, cm, mm, um, km, in, ft.
    #[arg(long, value_name = "UNIT", help = "Unit of coordinates: m, cm, mm, um, km, in, ft [default: m]")]
    pub length_unit: Option<String>,
    /// s, ms, us, min.
    #[arg(long, value_name = "UNIT", help = "Unit of times: s, ms, us, min [default: s]")]
    pub time_unit: Option<String>,
    /// Whether y points down, as in images.
    #[arg(long, num_args = 0, default_missing_value = "true")]
    #[arg(help = "The y axis points downwards, as in images: row 700 is at -700 pixels")]
    pub y_down: Option<bool>,
    /// Names of the columns, if the files have no line of names: t,x,y or frame,x,y.
    #[arg(long, value_name = "NAMES")]
    pub columns: Option<String>,
    /// The axis that points up in files of three coordinates: x, y, z, -x, -y or -z.
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    #[arg(
        help = "Axis that points up, for files of three coordinates: x, y, z, -x, -y, -z [default: against the fall]"
    )]
    pub up: Option<String>,
    /// Whether files that cannot be read are left out, with a note.
    #[arg(long, num_args = 0, default_missing_value = "true")]
    #[arg(help = "Leave out files that cannot be read, with a note")]
    pub skip_bad: Option<bool>,
    /// The track or body to read from files with several.
    #[arg(long, value_name = "NAME")]
    pub track: Option<String>,
}

impl TrackParseOptions {
    /// Whether no option is set.
    pub fn is_silent(&self) -> bool {
        *self == TrackParseOptions::default()
    }

    /// Errors name the field.
    pub fn validate(&self) -> Result<()> {
        self.fps.map_or(Ok(0.0), |v| check_range("fps", v, 1e-3, 1e7))?;
        self.metres_per_pixel.map_or(Ok(0.0), |v| check_range("metres_per_pixel", v, 1e-9, 1e4))?;
        for (field, given, units) in
            [("length_unit", &self.length_unit, &LENGTHS[..]), ("time_unit", &self.time_unit, &TIMES[..])]
        {
            let measured = |u: &ColumnUnit| u.size.is_some();
            if let Some(name) = given
                && unit_named(units, name).filter(measured).is_none()
            {
                let known: Vec<&str> =
                    units.iter().filter(|(u, _)| measured(u)).map(|(u, _)| u.name).collect();
                return Err(Error::input(field, format!("{name:?}"), known.join(", ")));
            }
        }
        for (a, b, both) in [
            (
                "metres_per_pixel",
                "length_unit",
                self.metres_per_pixel.is_some() && self.length_unit.is_some(),
            ),
            ("fps", "time_unit", self.fps.is_some() && self.time_unit.is_some()),
        ] {
            if both {
                return Err(Error::input(a, format!("given together with `{b}`"), "one of the two"));
            }
        }
        Ok(())
    }

    /// Size of a coordinate column's unit, m, and whether the unit is declared.
    pub fn length(&self, line: usize, column: &TrackColumn) -> Result<(f64, bool)> {
        let wanted = self.length_unit.as_deref().and_then(|name| unit_named(&LENGTHS, name));
        match (column.unit, self.metres_per_pixel, wanted) {
            (None, Some(size), _) => Ok((size, true)),
            (None, None, Some(unit)) => Ok((unit.size.unwrap_or(1.0), true)),
            (None, None, None) => Ok((1.0, false)),
            (Some(ColumnUnit { size: None, .. }), Some(size), _) => Ok((size, true)),
            (Some(ColumnUnit { size: None, .. }), None, _) => Err(invalid_value(
                line,
                &column.name,
                IN_PIXELS,
                "with `metres_per_pixel`, the size of one in m",
            )),
            (Some(unit), Some(_), _) => {
                Err(contradiction(line, column, unit, "`metres_per_pixel` is for pixels"))
            }
            (Some(unit), None, Some(other)) if unit != other => {
                Err(contradiction(line, column, unit, &format!("`length_unit` says {}", other.name)))
            }
            (Some(unit), None, _) => Ok((unit.size.unwrap_or(1.0), true)),
        }
    }

    /// Size of a time column's unit, s, and whether the unit is declared.
    pub fn time(&self, line: usize, column: &TrackColumn) -> Result<(f64, bool)> {
        let wanted = self.time_unit.as_deref().and_then(|name| unit_named(&TIMES, name));
        match (column.unit, wanted) {
            (None, None) => Ok((1.0, false)),
            (Some(unit), Some(other)) if unit != other => {
                Err(contradiction(line, column, unit, &format!("`time_unit` says {}", other.name)))
            }
            (Some(unit), _) | (None, Some(unit)) => Ok((unit.size.unwrap_or(1.0), true)),
        }
    }
}

/// Error for a column whose unit contradicts an option.
pub fn contradiction(line: usize, column: &TrackColumn, unit: ColumnUnit, but: &str) -> Error {
    invalid_value(
        line,
        &column.name,
        &format!("in {}", unit.name),
        &format!("the header or the option alone: {but}"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rejects_invalid_options() {
        let reading = TrackParseOptions::default;
        let pixels = || TrackParseOptions { metres_per_pixel: Some(0.01), ..reading() };
        for (said, wanted) in [
            (
                TrackParseOptions { length_unit: Some("yd".into()), ..reading() },
                "`length_unit` is \"yd\"; allowed: m, cm, mm",
            ),
            (TrackParseOptions { length_unit: Some("px".into()), ..reading() }, "`length_unit` is \"px\""),
            (
                TrackParseOptions { time_unit: Some("h".into()), ..reading() },
                "`time_unit` is \"h\"; allowed: s, ms",
            ),
            (TrackParseOptions { fps: Some(0.0), ..reading() }, "`fps` is 0"),
            (TrackParseOptions { metres_per_pixel: Some(-1.0), ..reading() }, "`metres_per_pixel` is -1"),
            (
                TrackParseOptions { length_unit: Some("mm".into()), ..pixels() },
                "`metres_per_pixel` is given together with `length_unit`",
            ),
        ] {
            let error = said.validate().expect_err(wanted).to_string();
            assert!(error.contains(wanted), "{error}");
        }
        TrackParseOptions { length_unit: Some("Millimetres".into()), ..reading() }.validate().unwrap();
    }
}
