//! Options for parsing track files: units, frame rate, axis direction and track.

use super::columns::{ColumnUnit, LENGTHS, TIMES, TrackColumn, unit_named};
use super::track_rows::invalid_value;
use crate::error::{Error, Result, check_range};

/// Options for parsing a track file that lacks this information.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackParseOptions {
    /// Frame rate, 1/s; the time column is then a frame number.
    pub fps: Option<f64>,
    /// Size of a pixel, m; the coordinates are then in pixels.
    pub metres_per_pixel: Option<f64>,
    /// Unit of coordinate columns without one: m, cm, mm, um, km, in, ft.
    pub length_unit: Option<String>,
    /// Unit of time columns without one: s, ms, us, min.
    pub time_unit: Option<String>,
    /// Whether y points down; `None` if unspecified.
    pub y_down: Option<bool>,
    /// Track to read from a file with several.
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
                "in pixels",
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
