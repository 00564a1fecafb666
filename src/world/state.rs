//! How a body is at a moment.

/// The state of one body.
#[derive(Clone, Copy, Debug)]
pub struct State {
    /// m
    pub position: [f64; 2],
    /// rad, not wrapped
    pub angle: f64,
    /// m/s
    pub velocity: [f64; 2],
    /// rad/s
    pub omega: f64,
}

impl State {
    /// That of a body that is not in the scene.
    pub const NOWHERE: State =
        State { position: [f64::NAN; 2], angle: f64::NAN, velocity: [f64::NAN; 2], omega: f64::NAN };

    /// Whether the body stands elsewhere than in `other`, or turned.
    pub fn moved_from(&self, other: &State) -> bool {
        self.position.map(f64::to_bits) != other.position.map(f64::to_bits)
            || self.angle.to_bits() != other.angle.to_bits()
    }

    /// Whether it is no faster or slower than in `other`, nor turns otherwise.
    pub fn goes_as(&self, other: &State) -> bool {
        self.velocity.map(f64::to_bits) == other.velocity.map(f64::to_bits)
            && self.omega.to_bits() == other.omega.to_bits()
    }

    /// Whether the state is within all reason; a rollout with one that is not has diverged.
    pub fn is_finite(&self) -> bool {
        let all = [self.position[0], self.position[1], self.velocity[0], self.velocity[1], self.omega];
        all.iter().all(|v| v.is_finite() && v.abs() < 1e7)
    }
}
