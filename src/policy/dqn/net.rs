//! The network and its initial weights.

use dfdx::prelude::{Cpu, Tape};

use crate::neural::{Affine, DenseLayer, Matrix, affine, tensors};
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

/// Layers with initial weights.
pub(super) fn initial(dimensions: [usize; 2], hidden: usize, seed: u64) -> Vec<DenseLayer> {
    let mut stream = rng::stream(seed, "dqn weights");
    shapes(dimensions, hidden).map(|(name, shape)| DenseLayer::random(name, shape, &mut stream)).into()
}

/// The layers as tensors.
pub(super) struct Net {
    pub(super) layers: Vec<Affine>,
}

impl Net {
    pub(super) fn new(layers: &[DenseLayer], device: &Cpu) -> Net {
        Net { layers: tensors(layers, device) }
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
