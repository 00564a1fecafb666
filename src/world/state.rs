//! The state of a body.

/// The state of one body.
#[derive(Clone, Copy, Debug)]
pub struct BodyState {
    /// m
    pub position: [f64; 2],
    /// rad, not wrapped
    pub angle: f64,
    /// m/s
    pub velocity: [f64; 2],
    /// rad/s
    pub omega: f64,
}

impl BodyState {
    /// The state of a body that is not in the scene.
    pub const ABSENT: BodyState =
        BodyState { position: [f64::NAN; 2], angle: f64::NAN, velocity: [f64::NAN; 2], omega: f64::NAN };

    /// Whether position or angle differ from `other`'s.
    pub fn pose_differs_from(&self, other: &BodyState) -> bool {
        self.position.map(f64::to_bits) != other.position.map(f64::to_bits)
            || self.angle.to_bits() != other.angle.to_bits()
    }

    /// Whether linear and angular velocity equal `other`'s.
    pub fn has_velocity_of(&self, other: &BodyState) -> bool {
        self.velocity.map(f64::to_bits) == other.velocity.map(f64::to_bits)
            && self.omega.to_bits() == other.omega.to_bits()
    }

    /// Whether the state is finite and plausible; otherwise the rollout has diverged.
    pub fn is_finite(&self) -> bool {
        let all = [self.position[0], self.position[1], self.velocity[0], self.velocity[1], self.omega];
        all.iter().all(|v| v.is_finite() && v.abs() < 1e7)
    }
}
