//! What a file of tracks does not say of itself, and what its columns say.

use super::columns::{Column, LENGTHS, TIMES, Unit, unit_named};
use super::rows::refuse;
use crate::error::{Error, Result, within};

/// What a file does not say of itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Pictures a second: the clock is the number of the picture.
    pub fps: Option<f64>,
    /// m: the coordinates are in pixels.
    pub metres_per_pixel: Option<f64>,
    /// Of coordinates whose column does not say: m, cm, mm, um, km, in, ft.
    pub length_unit: Option<String>,
    /// Of times whose column does not say: s, ms, us, min.
    pub time_unit: Option<String>,
    /// Whether y points down; none: nobody said.
    pub y_down: Option<bool>,
    /// Which track to read, of a file that holds several.
    pub track: Option<String>,
}

impl Reading {
    /// Whether anything is said at all.
    pub fn is_silent(&self) -> bool {
        *self == Reading::default()
    }

    /// Errors name the field.
    pub fn validate(&self) -> Result<()> {
        self.fps.map_or(Ok(0.0), |v| within("fps", v, 1e-3, 1e7))?;
        self.metres_per_pixel.map_or(Ok(0.0), |v| within("metres_per_pixel", v, 1e-9, 1e4))?;
        for (field, given, units) in
            [("length_unit", &self.length_unit, &LENGTHS[..]), ("time_unit", &self.time_unit, &TIMES[..])]
        {
            let measured = |u: &Unit| u.size.is_some();
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
                return Err(Error::input(a, format!("given beside `{b}`"), "one of the two"));
            }
        }
        Ok(())
    }

    /// m of a unit that a column gives, or none; and whether anybody said it.
    pub fn length(&self, line: usize, column: &Column) -> Result<(f64, bool)> {
        let wanted = self.length_unit.as_deref().and_then(|name| unit_named(&LENGTHS, name));
        match (column.unit, self.metres_per_pixel, wanted) {
            (None, Some(size), _) => Ok((size, true)),
            (None, None, Some(unit)) => Ok((unit.size.unwrap_or(1.0), true)),
            (None, None, None) => Ok((1.0, false)),
            (Some(Unit { size: None, .. }), Some(size), _) => Ok((size, true)),
            (Some(Unit { size: None, .. }), None, _) => {
                Err(refuse(line, &column.name, "in pixels", "with `metres_per_pixel`, the size of one in m"))
            }
            (Some(unit), Some(_), _) => {
                Err(contradiction(line, column, unit, "`metres_per_pixel` is for pixels"))
            }
            (Some(unit), None, Some(other)) if unit != other => {
                Err(contradiction(line, column, unit, &format!("`length_unit` says {}", other.name)))
            }
            (Some(unit), None, _) => Ok((unit.size.unwrap_or(1.0), true)),
        }
    }

    /// The same in s, of a column of times.
    pub fn time(&self, line: usize, column: &Column) -> Result<(f64, bool)> {
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

/// A column's unit that is not the one that was said.
pub fn contradiction(line: usize, column: &Column, unit: Unit, but: &str) -> Error {
    refuse(
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
    fn a_reading_that_cannot_be_is_refused_by_its_field() {
        let reading = Reading::default;
        let pixels = || Reading { metres_per_pixel: Some(0.01), ..reading() };
        for (said, wanted) in [
            (
                Reading { length_unit: Some("yd".into()), ..reading() },
                "`length_unit` is \"yd\"; allowed: m, cm, mm",
            ),
            (Reading { length_unit: Some("px".into()), ..reading() }, "`length_unit` is \"px\""),
            (Reading { time_unit: Some("h".into()), ..reading() }, "`time_unit` is \"h\"; allowed: s, ms"),
            (Reading { fps: Some(0.0), ..reading() }, "`fps` is 0"),
            (Reading { metres_per_pixel: Some(-1.0), ..reading() }, "`metres_per_pixel` is -1"),
            (
                Reading { length_unit: Some("mm".into()), ..pixels() },
                "`metres_per_pixel` is given beside `length_unit`",
            ),
        ] {
            let error = said.validate().expect_err(wanted).to_string();
            assert!(error.contains(wanted), "{error}");
        }
        Reading { length_unit: Some("Millimetres".into()), ..reading() }.validate().unwrap();
    }
}
