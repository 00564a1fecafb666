//! Bounds on the numbers of a scene: products, squares and inverses within them are representable in f32.

use crate::error::{Result, check_range};

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

/// Errors unless a length is from [`MIN_LENGTH_M`] to [`MAX_LENGTH_M`].
pub fn check_length(field: &str, value: f64) -> Result<()> {
    check_range(field, value, MIN_LENGTH_M, MAX_LENGTH_M).map(drop)
}

/// Errors, naming the component, unless both components are from `-limit` to `limit`.
pub fn check_vector(field: &str, v: [f64; 2], limit: f64) -> Result<()> {
    check_range(&format!("{field}[0]"), v[0], -limit, limit)?;
    check_range(&format!("{field}[1]"), v[1], -limit, limit)?;
    Ok(())
}
