//! What an action shows in every world, and what a trembling hand makes of it.

use nalgebra::DMatrix;

use crate::budget::Budget;
use crate::error::Result;
use crate::estimate::Believed;
use crate::rng;
use crate::task::{Placement, Scene, Task, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::{Engine, Rollout, simulate_within};

/// Times at which a trial is looked at: enough for every bounce to leave its mark, few enough to weigh against each other.
const TIMES: usize = 24;
/// Moves tried for every copy that is wanted, where most cannot be placed.
const TRIES: usize = 8;

/// Positions of every body over time, (coordinates, worlds), m.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Mean over copies.
    pub mean: DMatrix<f64>,
    /// By world (coordinates, copies): by how much copies differ from the mean, over the root of one less than there are.
    pub spread: Vec<DMatrix<f64>>,
    /// A further copy, which had no say in the mean.
    pub held: DMatrix<f64>,
}

/// An action with copies of it as a trembling hand does it, all placed.
pub struct Copied {
    /// The copies, and the held-out one at the end.
    scenes: Vec<Scene>,
}

/// How actions are copied.
pub struct Hand {
    pub copies: usize,
    /// Most that a component is moved.
    pub perturb: f64,
    pub seed: u64,
}

impl Hand {
    /// Copies of an action, the same moves for every action; `None` where they cannot be placed.
    pub fn copied(&self, task: &Task, action: &ValidAction) -> Option<Copied> {
        let mut scenes = Vec::with_capacity(self.copies + 1);
        for k in 0..TRIES * (self.copies + 1) {
            let mut stream = rng::stream(rng::derive(self.seed, "design copy", k as u64), "move");
            if let Placement::Valid(scene) = task.place(&action.trembled(self.perturb, &mut stream)) {
                scenes.push(*scene);
            }
            if scenes.len() == self.copies + 1 {
                return Some(Copied { scenes });
            }
        }
        None
    }
}

/// What some copied actions show in worlds; each takes copies + 1 rollouts a world.
pub fn shown(
    actions: &[&Copied],
    worlds: &[&Believed],
    engine: Engine,
    budget: &dyn Budget,
) -> Result<Vec<Shown>> {
    let rollouts: Vec<Rollout> =
        actions.iter().flat_map(|a| &a.scenes).flat_map(|scene| in_each(scene, worlds)).collect();
    let seen = simulate_within(budget, &rollouts, engine, |i, t| looked_at(rollouts[i].scene, &t))?;
    let mut seen = seen.into_iter();
    let mut of = |action: &Copied| {
        let copies: Vec<Vec<Vec<f64>>> =
            action.scenes.iter().map(|_| seen.by_ref().take(worlds.len()).collect()).collect();
        together(&copies)
    };
    Ok(actions.iter().map(|a| of(a)).collect())
}

/// A scene rolled out in each of some worlds.
pub fn in_each<'a>(scene: &'a Scene, worlds: &'a [&'a Believed]) -> impl Iterator<Item = Rollout<'a>> {
    worlds.iter().map(move |world| Rollout {
        latents: world.latents,
        effects: world.effects.as_slice(),
        ..Rollout::of(scene)
    })
}

/// By copy and world what was seen, the last copy held out.
fn together(copies: &[Vec<Vec<f64>>]) -> Shown {
    let (held, inner) = (&copies[copies.len() - 1], &copies[..copies.len() - 1]);
    let (worlds, n, count) = (held.len(), held[0].len(), inner.len() as f64);
    let mean = DMatrix::from_fn(n, worlds, |t, j| inner.iter().map(|c| c[j][t]).sum::<f64>() / count);
    let root = (count - 1.0).sqrt();
    let spread = |j: usize| DMatrix::from_fn(n, inner.len(), |t, k| (inner[k][j][t] - mean[(t, j)]) / root);
    Shown {
        spread: (0..worlds).map(spread).collect(),
        held: DMatrix::from_fn(n, worlds, |t, j| held[j][t]),
        mean,
    }
}

/// Positions at some times, body by body; after the end of a rollout, where it ended.
fn looked_at(scene: &Scene, trajectory: &Trajectory) -> Vec<f64> {
    let span = f64::from(scene.steps) * scene.time_step;
    let at = |k: usize| {
        let time = span * (k + 1) as f64 / TIMES as f64 + 1e-9;
        trajectory.times.partition_point(|t| *t <= time).saturating_sub(1)
    };
    let indices: Vec<usize> = (0..TIMES).map(at).collect();
    let coordinates = trajectory.bodies.iter().flat_map(|b| [&b.x, &b.y]);
    coordinates.flat_map(|c| indices.iter().map(|i| c.get(*i).copied().unwrap_or(0.0))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::Endless;
    use crate::task::family;
    use crate::world::Latents;

    /// What is shown is what rollouts show: in a world by itself, the mean and the spread of the copies done one by one.
    #[test]
    fn copies_are_summed_up_by_world() {
        let task = family("basketball").unwrap().tasks().remove(0);
        let hand = Hand { copies: 3, perturb: 0.002, seed: 4 };
        let action = (0..).map(|i| task.actions().at(37 * i).unwrap());
        let copied = action.take(1000).find_map(|a| hand.copied(&task, &a)).unwrap();
        let world = |friction| Believed { latents: Latents::of([1.0, friction, 0.6]), ..Believed::default() };
        let worlds = [world(0.2), world(0.7)];
        let worlds: Vec<&Believed> = worlds.iter().collect();
        let actions = [&copied];
        let found = shown(&actions, &worlds, Engine::Auto, &Endless).unwrap().remove(0);
        let one = |copy: usize| {
            let scene = &actions[0].scenes[copy];
            let rollout = Rollout { latents: worlds[1].latents, ..Rollout::of(scene) };
            let seen = simulate_within(&Endless, &[rollout], Engine::Auto, |_, t| looked_at(scene, &t));
            seen.unwrap().remove(0)
        };
        let (copies, held) = ([one(0), one(1), one(2)], one(3));
        let n = held.len();
        assert_eq!(n, TIMES * 2 * actions[0].scenes[0].bodies.len());
        for t in 0..n {
            let mean = copies.iter().map(|c| c[t]).sum::<f64>() / 3.0;
            let variance = copies.iter().map(|c| (c[t] - mean).powi(2)).sum::<f64>() / 2.0;
            assert_eq!((found.mean[(t, 1)], found.held[(t, 1)]), (mean, held[t]));
            assert!((found.spread[1].row(t).norm_squared() - variance).abs() < 1e-12 * (1.0 + variance));
        }
        assert!(copies[0] != copies[1], "a trembling hand");
    }
}
