//! The Adam optimiser (Kingma and Ba 2015) on plain slices: dfdx's own optimiser needs shapes known at
//! compile time.

use dfdx::prelude::{Cpu, Gradients};

use super::{Affine, DenseLayer};

/// Decay rates and epsilon as recommended by the authors.
const ADAM: (f32, f32, f32) = (0.9, 0.999, 1e-8);

/// Optimiser state: first and second moments of each parameter.
pub struct Adam {
    updates: i32,
    moments: Vec<[Vec<[f32; 2]>; 2]>,
}

impl Adam {
    /// The state before the first update.
    pub fn new(layers: &[DenseLayer]) -> Adam {
        let zeros = |l: &DenseLayer| [vec![[0.0; 2]; l.weight.len()], vec![[0.0; 2]; l.bias.len()]];
        Adam { updates: 0, moments: layers.iter().map(zeros).collect() }
    }

    /// One update of every parameter from the gradients with respect to `tensors`.
    pub fn update(
        &mut self,
        layers: &mut [DenseLayer],
        tensors: &[Affine],
        gradients: &Gradients<f32, Cpu>,
        rate: f32,
    ) {
        self.updates += 1;
        for ((layer, (weight, bias)), [m_weight, m_bias]) in
            layers.iter_mut().zip(tensors).zip(&mut self.moments)
        {
            step(&mut layer.weight, &gradients.get(weight).as_vec(), m_weight, self.updates, rate);
            step(&mut layer.bias, &gradients.get(bias).as_vec(), m_bias, self.updates, rate);
        }
    }
}

fn step(values: &mut [f32], gradients: &[f32], moments: &mut [[f32; 2]], updates: i32, rate: f32) {
    let (b1, b2, guard) = ADAM;
    let (correct1, correct2) = (1.0 / (1.0 - b1.powi(updates)), 1.0 / (1.0 - b2.powi(updates)));
    for ((value, g), [first, second]) in values.iter_mut().zip(gradients).zip(moments) {
        *first = b1 * *first + (1.0 - b1) * g;
        *second = b2 * *second + (1.0 - b2) * g * g;
        *value -= rate * (*first * correct1) / ((*second * correct2).sqrt() + guard);
    }
}
