//! Predicted observations of an action in every sampled world, with actuation noise.

use nalgebra::DMatrix;

use crate::budget::Budget;
use crate::error::Result;
use crate::estimate::ParameterSample;
use crate::rng;
use crate::task::{Placement, Scene, Task, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::{Engine, Rollout, Simulator};

/// Number of observation times: enough to resolve every bounce, few enough for a covariance.
const N_OBSERVATION_TIMES: usize = 24;
/// Perturbations tried for every copy, where most can't be placed.
const MAX_ATTEMPTS_PER_COPY: usize = 8;

/// Positions of every body over time, (coordinates, worlds), m.
#[derive(Clone, Debug)]
pub struct PredictedObservations {
    /// Mean over perturbed copies.
    pub mean: DMatrix<f64>,
    /// By world (coordinates, copies): deviations of the copies from their mean over sqrt(copies - 1).
    pub spread: Vec<DMatrix<f64>>,
    /// A held-out copy, not part of the mean.
    pub held: DMatrix<f64>,
}

/// The placed scenes of an action's perturbed copies.
pub struct PerturbedAction {
    /// The copies; the last one is held out.
    scenes: Vec<Scene>,
}

/// Actuation noise: how copies of an action are perturbed.
pub struct ActuationNoise {
    pub copies: usize,
    /// Maximal perturbation of a component.
    pub perturb: f64,
    pub seed: u64,
}

impl ActuationNoise {
    /// Copies of an action, with the same perturbations for every action; `None` where they can't be placed.
    pub fn perturb(&self, task: &Task, action: &ValidAction) -> Option<PerturbedAction> {
        let mut scenes = Vec::with_capacity(self.copies + 1);
        for k in 0..MAX_ATTEMPTS_PER_COPY * (self.copies + 1) {
            let mut stream = rng::stream(rng::derive_seed(self.seed, "design copy", k as u64), "move");
            if let Placement::Valid(scene) = task.place(&action.perturbed(self.perturb, &mut stream)) {
                scenes.push(*scene);
            }
            if scenes.len() == self.copies + 1 {
                return Some(PerturbedAction { scenes });
            }
        }
        None
    }
}

/// Predicted observations of actions in worlds; copies + 1 rollouts for each action and world.
pub fn predict_observations(
    actions: &[&PerturbedAction],
    worlds: &[&ParameterSample],
    engine: Engine,
    budget: &dyn Budget,
) -> Result<Vec<PredictedObservations>> {
    let rollouts: Vec<Rollout> =
        actions.iter().flat_map(|a| &a.scenes).flat_map(|scene| rollouts_in(scene, worlds)).collect();
    let observations = Simulator::new(engine)
        .budget(budget)
        .map(&rollouts, |i, t| sampled_positions(rollouts[i].scene, &t))?;
    let mut observations = observations.into_iter();
    let mut of = |action: &PerturbedAction| {
        let copies: Vec<Vec<Vec<f64>>> =
            action.scenes.iter().map(|_| observations.by_ref().take(worlds.len()).collect()).collect();
        summarise(&copies)
    };
    Ok(actions.iter().map(|a| of(a)).collect())
}

/// A rollout of the scene in each world.
pub fn rollouts_in<'a>(
    scene: &'a Scene,
    worlds: &'a [&'a ParameterSample],
) -> impl Iterator<Item = Rollout<'a>> {
    worlds.iter().map(move |world| Rollout {
        latents: world.latents,
        effects: world.effects.as_slice(),
        ..Rollout::of(scene)
    })
}

/// Mean, spread and held-out copy of observations by copy and world.
fn summarise(copies: &[Vec<Vec<f64>>]) -> PredictedObservations {
    let (held, inner) = (&copies[copies.len() - 1], &copies[..copies.len() - 1]);
    let (worlds, n, count) = (held.len(), held[0].len(), inner.len() as f64);
    let mean = DMatrix::from_fn(n, worlds, |t, j| inner.iter().map(|c| c[j][t]).sum::<f64>() / count);
    let root = (count - 1.0).sqrt();
    let spread = |j: usize| DMatrix::from_fn(n, inner.len(), |t, k| (inner[k][j][t] - mean[(t, j)]) / root);
    PredictedObservations {
        spread: (0..worlds).map(spread).collect(),
        held: DMatrix::from_fn(n, worlds, |t, j| held[j][t]),
        mean,
    }
}

/// Positions at the observation times, body by body; after the end of a rollout, its last positions.
fn sampled_positions(scene: &Scene, trajectory: &Trajectory) -> Vec<f64> {
    let span = f64::from(scene.steps) * scene.time_step;
    let at = |k: usize| {
        let time = span * (k + 1) as f64 / N_OBSERVATION_TIMES as f64 + 1e-9;
        trajectory.times.partition_point(|t| *t <= time).saturating_sub(1)
    };
    let indices: Vec<usize> = (0..N_OBSERVATION_TIMES).map(at).collect();
    let coordinates = trajectory.bodies.iter().flat_map(|b| [&b.x, &b.y]);
    coordinates.flat_map(|c| indices.iter().map(|i| c.get(*i).copied().unwrap_or(0.0))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::Unlimited;
    use crate::task::family;
    use crate::world::Latents;

    /// Mean and spread are those of the copies simulated one by one.
    #[test]
    fn summarises_copies_by_world() {
        let task = family("basketball").unwrap().tasks().remove(0);
        let actuation = ActuationNoise { copies: 3, perturb: 0.002, seed: 4 };
        let action = (0..).map(|i| task.actions().at(37 * i).unwrap());
        let copied = action.take(1000).find_map(|a| actuation.perturb(&task, &a)).unwrap();
        let world = |friction| ParameterSample {
            latents: Latents::of([1.0, friction, 0.6]),
            ..ParameterSample::default()
        };
        let worlds = [world(0.2), world(0.7)];
        let worlds: Vec<&ParameterSample> = worlds.iter().collect();
        let actions = [&copied];
        let predicted = predict_observations(&actions, &worlds, Engine::Auto, &Unlimited).unwrap().remove(0);
        let one = |copy: usize| {
            let scene = &actions[0].scenes[copy];
            let rollout = Rollout { latents: worlds[1].latents, ..Rollout::of(scene) };
            let observations =
                Simulator::new(Engine::Auto).map(&[rollout], |_, t| sampled_positions(scene, &t));
            observations.unwrap().remove(0)
        };
        let (copies, held) = ([one(0), one(1), one(2)], one(3));
        let n = held.len();
        assert_eq!(n, N_OBSERVATION_TIMES * 2 * actions[0].scenes[0].bodies.len());
        for t in 0..n {
            let mean = copies.iter().map(|c| c[t]).sum::<f64>() / 3.0;
            let variance = copies.iter().map(|c| (c[t] - mean).powi(2)).sum::<f64>() / 2.0;
            assert_eq!((predicted.mean[(t, 1)], predicted.held[(t, 1)]), (mean, held[t]));
            assert!((predicted.spread[1].row(t).norm_squared() - variance).abs() < 1e-12 * (1.0 + variance));
        }
        assert!(copies[0] != copies[1], "copies differ");
    }
}
