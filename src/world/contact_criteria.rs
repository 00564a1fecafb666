//! Which touches begin a contact, and which contacts support a body.

/// Steps without contact after which the next touch is a new contact. Fewer count chatter; more merge the
/// last fast bounces of a ball into one.
pub const CONTACT_GAP_STEPS: u32 = 3;
/// Minimum upward component of the normal of a supporting contact: cos 60 degrees.
pub const MIN_SUPPORT_NORMAL_Y: f64 = 0.5;
