//! Dense layers as dfdx tensors: initialisation, forward pass and training.
//!
//! Shapes are known at run time, not at compile time: layers are plain data, and tensors are created for each
//! update.

mod adam;

use dfdx::prelude::{
    AsArray as _, Axes2, Axis, Backward as _, BroadcastTo, Cpu, HasShape, NoneTape, PermuteTo, Tape, Tensor,
    TensorFromVec, Trace as _, TryMatMul, mse_loss,
};
use rand::RngExt;

pub use adam::Adam;

use crate::error::{Error, Result};
use crate::rng::Stream;

/// An affine layer: y = W x + b.
#[derive(Clone, PartialEq)]
pub struct DenseLayer {
    pub name: &'static str,
    /// Numbers of outputs and inputs.
    pub shape: [usize; 2],
    /// (out, in), row-major
    pub weight: Vec<f32>,
    /// (out,)
    pub bias: Vec<f32>,
}

impl DenseLayer {
    /// Uniform in +-1 / sqrt(inputs), the default initialisation of PyTorch's `Linear`.
    pub fn random(name: &'static str, shape: [usize; 2], stream: &mut Stream) -> DenseLayer {
        let bound = 1.0 / (shape[1] as f32).sqrt();
        let mut draw =
            |n: usize| -> Vec<f32> { (0..n).map(|_| bound * (2.0 * stream.random::<f32>() - 1.0)).collect() };
        DenseLayer { name, shape, weight: draw(shape[0] * shape[1]), bias: draw(shape[0]) }
    }

    /// Whether every weight is a finite number.
    pub fn is_finite(&self) -> bool {
        self.weight.iter().chain(&self.bias).all(|v| v.is_finite())
    }
}

/// Name and shape only, without the weights.
impl std::fmt::Debug for DenseLayer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {:?}", self.name, self.shape)
    }
}

/// (n, row width)
pub type Matrix<T> = Tensor<(usize, usize), f32, Cpu, T>;
/// Weight and bias of a layer.
pub type Affine = (Matrix<NoneTape>, Tensor<(usize,), f32, Cpu>);

/// The layers as tensors, in order.
pub fn tensors(layers: &[DenseLayer], device: &Cpu) -> Vec<Affine> {
    let of = |l: &DenseLayer| {
        let weight = device.tensor_from_vec(l.weight.clone(), (l.shape[0], l.shape[1]));
        (weight, device.tensor_from_vec(l.bias.clone(), (l.shape[0],)))
    };
    layers.iter().map(of).collect()
}

/// Applies a layer to rows.
pub fn affine<T: Tape<f32, Cpu>>(x: Matrix<T>, (weight, bias): &Affine) -> Matrix<T> {
    let y = x.matmul(weight.retaped::<T>().permute::<(usize, usize), Axes2<1, 0>>());
    let shape = *y.shape();
    y + bias.retaped::<T>().broadcast_like::<_, Axis<0>>(&shape)
}

/// The rows as a matrix.
pub fn matrix<'a>(device: &Cpu, rows: impl ExactSizeIterator<Item = &'a Vec<f32>>) -> Matrix<NoneTape> {
    let n = rows.len();
    let values: Vec<f32> = rows.flatten().copied().collect();
    let width = values.len() / n.max(1);
    device.tensor_from_vec(values, (n, width))
}

/// A pool of one thread: batches are too small to gain from more, and a single thread fixes the order of
/// summation.
pub fn single_thread_pool() -> Result<rayon::ThreadPool> {
    let built = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    built.map_err(|e| Error::Failed(format!("cannot create a training thread: {e}")))
}

/// Cosine annealing of the learning rate to zero.
pub fn cosine_annealing(begun: f64, batch: usize, batches: usize) -> f64 {
    let share = batch as f64 / batches as f64;
    begun * 0.5 * (1.0 + libm::cos(std::f64::consts::PI * share))
}

/// One training step of a multilayer perceptron with ReLU between layers, on the mean squared error against
/// `answers`; returns the loss before the step.
pub fn regression_step(
    layers: &mut [DenseLayer],
    adam: &mut Adam,
    rows: &[Vec<f32>],
    answers: &[Vec<f32>],
    rate: f64,
) -> f64 {
    let device = Cpu::default();
    let net = tensors(layers, &device);
    let predicted = forward(&net, matrix(&device, rows.iter()).leaky_traced());
    let loss = mse_loss(predicted, matrix(&device, answers.iter()));
    let value = f64::from(loss.array());
    adam.update(layers, &net, &loss.backward(), rate as f32);
    value
}

/// The network's output for a row.
pub fn predict(layers: &[DenseLayer], row: &Vec<f32>) -> Vec<f32> {
    let device = Cpu::default();
    forward(&tensors(layers, &device), matrix(&device, std::iter::once(row))).as_vec()
}

fn forward<T: Tape<f32, Cpu>>(net: &[Affine], x: Matrix<T>) -> Matrix<T> {
    let last = net.len().saturating_sub(1);
    let layer = |x, (i, layer): (usize, &Affine)| {
        let y: Matrix<T> = affine(x, layer);
        if i < last { y.relu() } else { y }
    };
    net.iter().enumerate().fold(x, layer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng;

    #[test]
    fn network_learns_a_difference() {
        let mut stream = rng::stream(3, "neural");
        let mut layers = [("one", [8, 2]), ("two", [1, 8])]
            .map(|(name, shape)| DenseLayer::random(name, shape, &mut stream));
        let rows: Vec<Vec<f32>> = (0..32).map(|_| vec![stream.random(), stream.random()]).collect();
        let answers: Vec<Vec<f32>> = rows.iter().map(|r| vec![r[0] - r[1]]).collect();
        let mut adam = Adam::new(&layers);
        let losses: Vec<f64> = (0..400)
            .map(|k| regression_step(&mut layers, &mut adam, &rows, &answers, cosine_annealing(0.02, k, 400)))
            .collect();
        assert!(losses[399] < 1e-3 && losses[0] > 0.05, "{} {}", losses[0], losses[399]);
        assert!((predict(&layers, &vec![0.75, 0.25])[0] - 0.5).abs() < 0.1);
    }
}
