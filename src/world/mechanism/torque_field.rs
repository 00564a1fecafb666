//! Torque fields: functions of a joint's position, velocity and motor torque, for what no law explains.

/// A torque in one joint as a function of its state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueFunction {
    pub joint: usize,
    pub shape: FieldShape,
}

/// The function's dependence on the state. Positions of revolute joints are periodic, with the half extent pi; all other numbers are
/// in units of the data's range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FieldShape {
    Constant,
    /// Linear in position (0), velocity (1) or motor torque (2).
    Linear(usize),
    /// Sine (0) or cosine (1) of the position.
    Harmonic(usize),
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
    pub is_periodic: Vec<bool>,
    pub centre: Vec<[f64; 3]>,
    pub half_extent: Vec<[f64; 3]>,
}

impl TorqueField {
    /// Value of a function at a joint's position, velocity and motor torque; all are of the order of one.
    pub fn at(&self, function: usize, state: [f64; 3]) -> f64 {
        let TorqueFunction { joint, shape } = self.functions[function];
        let ratio = |k: usize| (state[k] - self.centre[joint][k]) / self.half_extent[joint][k];
        let scaled = |k: usize| match k == 0 && self.is_periodic[joint] {
            true => wrapped(ratio(0)),
            false => ratio(k).clamp(-1.5, 1.5),
        };
        match shape {
            FieldShape::Constant => 1.0,
            FieldShape::Linear(k) => scaled(k),
            FieldShape::Harmonic(0) => libm::sin(state[0]),
            FieldShape::Harmonic(_) => libm::cos(state[0]),
            FieldShape::Bump { centre, inverse_square_width } => {
                let mut off = [scaled(0) - centre[0], scaled(1) - centre[1]];
                if self.is_periodic[joint] {
                    off[0] = wrapped(off[0]);
                }
                let square = |k: usize| off[k] * off[k] * inverse_square_width[k];
                libm::exp(-0.5 * (square(0) + square(1)))
            }
        }
    }
}

/// A number modulo 2, from -1 to 1.
fn wrapped(x: f64) -> f64 {
    x - 2.0 * (0.5 * x).round()
}
