//! Numbers that a scene may hold, so that no product, square or inverse of them leaves what an f32 holds.

use crate::error::{Result, within};

/// Largest length or coordinate, m.
pub const FAR: f64 = 1e5;
/// Smallest length, m: smaller ones vanish when squared or beside [`FAR`].
pub const NEAR: f64 = 1e-6;
/// Largest speed, m/s (the general engine's cap is 400 m/s).
pub const FAST: f64 = 400.0;
/// Largest spin, rad/s.
pub const FAST_SPIN: f64 = 1e4;
/// Masses, kg: those whose inverses, and those of the moments of inertia, an f32 still holds.
pub const MASSES: [f64; 2] = [1e-12, 1e9];
/// Densities, kg/m^2: the same for the smallest and largest of bodies.
pub const DENSITIES: [f64; 2] = [1e-6, 1e9];
/// Time steps, s.
pub const TIME_STEPS: [f64; 2] = [1e-6, 0.1];

/// Errors unless a length of something is from [`NEAR`] to [`FAR`].
pub fn length(field: &str, value: f64) -> Result<()> {
    within(field, value, NEAR, FAR).map(drop)
}

/// Errors, naming the component, unless both are from `-limit` to `limit`.
pub fn vector(field: &str, v: [f64; 2], limit: f64) -> Result<()> {
    within(&format!("{field}[0]"), v[0], -limit, limit)?;
    within(&format!("{field}[1]"), v[1], -limit, limit)?;
    Ok(())
}
