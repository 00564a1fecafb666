//! Layers of small networks as dfdx tensors, how their weights begin, and how they learn.
//!
//! Shapes are known when a network is made, not when the program is compiled: layers are plain data, tensors are made of them for an
//! update.

mod adam;

use dfdx::prelude::{
    Axes2, Axis, BroadcastTo, Cpu, HasShape, NoneTape, PermuteTo, Tape, Tensor, TensorFromVec, TryMatMul,
};
use rand::RngExt;

pub use adam::Adam;

use crate::rng::Stream;

/// An affine layer: y = W x + b.
#[derive(Clone, PartialEq)]
pub struct Layer {
    pub name: &'static str,
    /// Numbers of outputs and inputs.
    pub shape: [usize; 2],
    /// (out, in), row-major
    pub weight: Vec<f32>,
    /// (out,)
    pub bias: Vec<f32>,
}

impl Layer {
    /// Uniform in +-1 / sqrt(inputs), as PyTorch's `Linear` starts.
    pub fn drawn(name: &'static str, shape: [usize; 2], stream: &mut Stream) -> Layer {
        let bound = 1.0 / (shape[1] as f32).sqrt();
        let mut draw =
            |n: usize| -> Vec<f32> { (0..n).map(|_| bound * (2.0 * stream.random::<f32>() - 1.0)).collect() };
        Layer { name, shape, weight: draw(shape[0] * shape[1]), bias: draw(shape[0]) }
    }

    /// Whether every weight is a finite number.
    pub fn is_finite(&self) -> bool {
        self.weight.iter().chain(&self.bias).all(|v| v.is_finite())
    }
}

/// Name and shape only: nobody reads 100,000 weights.
impl std::fmt::Debug for Layer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {:?}", self.name, self.shape)
    }
}

/// (n, numbers of a row)
pub type Matrix<T> = Tensor<(usize, usize), f32, Cpu, T>;
/// Weight and bias of a layer.
pub type Affine = (Matrix<NoneTape>, Tensor<(usize,), f32, Cpu>);

/// Layers as tensors, in their order.
pub fn tensors(layers: &[Layer], device: &Cpu) -> Vec<Affine> {
    let of = |l: &Layer| {
        let weight = device.tensor_from_vec(l.weight.clone(), (l.shape[0], l.shape[1]));
        (weight, device.tensor_from_vec(l.bias.clone(), (l.shape[0],)))
    };
    layers.iter().map(of).collect()
}

/// What a layer makes of rows.
pub fn affine<T: Tape<f32, Cpu>>(x: Matrix<T>, (weight, bias): &Affine) -> Matrix<T> {
    let y = x.matmul(weight.retaped::<T>().permute::<(usize, usize), Axes2<1, 0>>());
    let shape = *y.shape();
    y + bias.retaped::<T>().broadcast_like::<_, Axis<0>>(&shape)
}

/// Rows as a matrix.
pub fn matrix<'a>(device: &Cpu, rows: impl ExactSizeIterator<Item = &'a Vec<f32>>) -> Matrix<NoneTape> {
    let n = rows.len();
    let values: Vec<f32> = rows.flatten().copied().collect();
    let width = values.len() / n.max(1);
    device.tensor_from_vec(values, (n, width))
}
