//! The network as tensors, and how its weights begin.

use dfdx::prelude::{
    Axes2, Axis, BroadcastTo, Cpu, HasShape, NoneTape, PermuteTo, Tape, Tensor, TensorFromVec, TryMatMul,
};
use rand::RngExt;

use crate::policy::weights::Layer;
use crate::rng;

/// Names and shapes of the layers.
pub(super) fn shapes([scene, action]: [usize; 2], hidden: usize) -> [(&'static str, [usize; 2]); 6] {
    [
        ("scene", [hidden, scene]),
        ("action", [hidden, action]),
        ("film_gamma", [hidden, hidden]),
        ("film_beta", [hidden, hidden]),
        ("hidden", [hidden, hidden]),
        ("score", [1, hidden]),
    ]
}

/// Uniform in +-1 / sqrt(inputs), as PyTorch's `Linear` starts.
pub(super) fn initial(dimensions: [usize; 2], hidden: usize, seed: u64) -> Vec<Layer> {
    let mut rng = rng::stream(seed, "dqn weights");
    let mut layer = |(name, shape): (&'static str, [usize; 2])| {
        let bound = 1.0 / (shape[1] as f32).sqrt();
        let mut draw =
            |n: usize| -> Vec<f32> { (0..n).map(|_| bound * (2.0 * rng.random::<f32>() - 1.0)).collect() };
        Layer { name, shape, weight: draw(shape[0] * shape[1]), bias: draw(shape[0]) }
    };
    shapes(dimensions, hidden).map(&mut layer).into()
}

pub(super) type Matrix<T> = Tensor<(usize, usize), f32, Cpu, T>;
/// Weight and bias of a layer.
pub(super) type Affine = (Matrix<NoneTape>, Tensor<(usize,), f32, Cpu>);

/// The layers as tensors.
pub(super) struct Net {
    pub(super) layers: Vec<Affine>,
}

impl Net {
    pub(super) fn new(layers: &[Layer], device: &Cpu) -> Net {
        let tensors = |l: &Layer| {
            let weight = device.tensor_from_vec(l.weight.clone(), (l.shape[0], l.shape[1]));
            (weight, device.tensor_from_vec(l.bias.clone(), (l.shape[0],)))
        };
        Net { layers: layers.iter().map(tensors).collect() }
    }

    /// (n, 1) scores from scene features, (n, n_scene) and action features (n, n_action).
    pub(super) fn forward<T: Tape<f32, Cpu>>(&self, scene: Matrix<T>, action: Matrix<T>) -> Matrix<T> {
        let [trunk, encode, gamma, beta, hidden, score] = &self.layers[..] else {
            unreachable!("six layers: see `shapes`")
        };
        let seen = affine(scene, trunk).relu();
        let done = affine(action, encode).relu();
        let scale = affine(done.retaped::<T>(), gamma) + 1.0;
        let film = scale * seen + affine(done, beta);
        affine(affine(film.relu(), hidden).relu(), score)
    }
}

fn affine<T: Tape<f32, Cpu>>(x: Matrix<T>, (weight, bias): &Affine) -> Matrix<T> {
    let y = x.matmul(weight.retaped::<T>().permute::<(usize, usize), Axes2<1, 0>>());
    let shape = *y.shape();
    y + bias.retaped::<T>().broadcast_like::<_, Axis<0>>(&shape)
}

/// Rows as a matrix.
pub(super) fn matrix<'a>(
    device: &Cpu,
    rows: impl ExactSizeIterator<Item = &'a Vec<f32>>,
) -> Matrix<NoneTape> {
    let n = rows.len();
    let values: Vec<f32> = rows.flatten().copied().collect();
    let width = values.len() / n.max(1);
    device.tensor_from_vec(values, (n, width))
}
