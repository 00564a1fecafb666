//! Bounds on the numbers of a scene: products, squares and inverses within them are representable in f32.

use crate::error::{Error, Result, check_range};

/// Largest length or coordinate, m.
pub const MAX_LENGTH_M: f64 = 1e5;
/// Smallest length, m: smaller ones underflow when squared, or vanish next to [`MAX_LENGTH_M`].
pub const MIN_LENGTH_M: f64 = 1e-6;
/// Largest speed, m/s (the general engine caps speeds at 400 m/s).
pub const MAX_SPEED_M_S: f64 = 400.0;
/// Largest angular velocity, rad/s.
pub const MAX_SPIN_RAD_S: f64 = 1e4;
/// Range of masses, kg: their inverses and those of the moments of inertia are representable in f32.
pub const MASS_RANGE_KG: [f64; 2] = [1e-12, 1e9];
/// Range of moments of inertia, kg m^2, for the same reason.
pub const INERTIA_RANGE_KG_M2: [f64; 2] = [1e-20, 1e18];
/// Range of densities, kg/m^2, for the same reason.
pub const DENSITY_RANGE_KG_M2: [f64; 2] = [1e-6, 1e9];
/// Range of friction coefficients.
pub const FRICTION_RANGE: [f64; 2] = [0.0, 100.0];
/// Range of restitution coefficients.
pub const RESTITUTION_RANGE: [f64; 2] = [0.0, 1.0];
/// Range of time steps, s.
pub const TIME_STEP_RANGE_S: [f64; 2] = [1e-6, 0.1];

/// Largest number of characters of a name.
pub const MAX_NAME_CHARACTERS: usize = 100;
/// Largest number of characters of a free text.
pub const MAX_TEXT_CHARACTERS: usize = 1000;

/// Errors, naming `field`, unless a name has 1 to [`MAX_NAME_CHARACTERS`] characters.
pub fn check_name_length(field: &str, name: &str) -> Result<()> {
    if !name.is_empty() && is_at_most(name, MAX_NAME_CHARACTERS) {
        return Ok(());
    }
    let allowed = format!("a name of 1 to {MAX_NAME_CHARACTERS} characters");
    Err(Error::input(field, format!("{name:?}"), allowed))
}

/// Errors, naming `field`, unless a text has at most [`MAX_TEXT_CHARACTERS`] characters.
pub fn check_text_length(field: &str, text: &str) -> Result<()> {
    if is_at_most(text, MAX_TEXT_CHARACTERS) {
        return Ok(());
    }
    let allowed = format!("a text of at most {MAX_TEXT_CHARACTERS} characters");
    Err(Error::input(field, format!("{text:?}"), allowed))
}

fn is_at_most(text: &str, characters: usize) -> bool {
    // A character takes one byte or more.
    text.len() <= characters || text.chars().count() <= characters
}

/// Errors unless a length is from [`MIN_LENGTH_M`] to [`MAX_LENGTH_M`].
pub fn check_length(field: &str, value: f64) -> Result<()> {
    check_range(field, value, MIN_LENGTH_M, MAX_LENGTH_M).map(drop)
}

/// Errors, naming the component, unless both components are from `-limit` to `limit`.
pub fn check_vector(field: impl std::fmt::Display, v: [f64; 2], limit: f64) -> Result<()> {
    // The path is written only for an error: a scene has thousands of corners.
    let outside = (0..2).find(|k| !(-limit..=limit).contains(&v[*k]));
    outside.map_or(Ok(()), |k| check_range(&format!("{field}[{k}]"), v[k], -limit, limit).map(drop))
}
