//! Constants of scenes that effects use as well.

/// m/s^2, standard gravity to three digits.
pub const STANDARD_GRAVITY_M_S2: f64 = 9.81;
/// Upper bound of the speed below which contacts do not rebound, m/s.
pub const MAX_RESTITUTION_THRESHOLD_M_S: f64 = 100.0;
