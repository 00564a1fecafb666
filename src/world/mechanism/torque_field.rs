//! Torque fields: functions of a joint's position, velocity and motor torque, for what no law explains.

/// A torque in one joint as a function of its state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueFunction {
    pub joint: usize,
    pub shape: FieldShape,
}

/// The function's dependence on the state in units of the data's range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FieldShape {
    Constant,
    /// Linear in position (0), velocity (1) or motor torque (2).
    Linear(usize),
    /// Gaussian about a centre in (position, velocity), with these inverse squared widths.
    Bump {
        centre: [f64; 2],
        inverse_square_width: [f64; 2],
    },
}

/// Functions with the range of the data: centres and half extents of position, velocity and motor torque of each joint.
#[derive(Clone, Debug, Default)]
pub struct TorqueField {
    pub functions: Vec<TorqueFunction>,
    /// By joint.
    pub centre: Vec<[f64; 3]>,
    pub half_extent: Vec<[f64; 3]>,
}

impl TorqueField {
    /// Value of a function at a joint's position, velocity and motor torque; all are of the order of one.
    pub fn at(&self, function: usize, state: [f64; 3]) -> f64 {
        let TorqueFunction { joint, shape } = self.functions[function];
        let scaled =
            |k: usize| ((state[k] - self.centre[joint][k]) / self.half_extent[joint][k]).clamp(-1.5, 1.5);
        match shape {
            FieldShape::Constant => 1.0,
            FieldShape::Linear(k) => scaled(k),
            FieldShape::Bump { centre, inverse_square_width } => {
                let off =
                    |k: usize| (scaled(k) - centre[k]) * (scaled(k) - centre[k]) * inverse_square_width[k];
                libm::exp(-0.5 * (off(0) + off(1)))
            }
        }
    }
}
