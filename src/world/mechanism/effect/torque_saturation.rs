//! Saturation: the motor's torque ends below its stated limit.

use super::{
    Applicability, DriveLaw, JointEffect, JointLaw, JointParameter, JointState, MAX_PARAMETERS, factor,
};

/// The effect's row in the registry.
pub static EFFECT: JointEffect = JointEffect {
    name: "torque_saturation",
    summary: "Saturation: the motor cannot give the torque that its data sheet states.",
    signature: "Small commands act as stated, large ones too little.",
    equation: "|tau_motor| <= s max_torque",
    parameters: &[JointParameter { starts: &[-0.2, -0.5, -0.7], ..factor([0.02, 1.0], 0.4) }],
    law: JointLaw::Drive(&TorqueSaturation),
    applies_to: Applicability::Driven,
};

struct TorqueSaturation;

impl DriveLaw for TorqueSaturation {
    fn drive(&self, values: &[f64; MAX_PARAMETERS], joint: JointState) -> f64 {
        let most = values[0] * joint.max_torque;
        joint.drive.clamp(-most, most)
    }
}
