//! A hidden world: private latents and effects, measurement noise, counted interactions, optional budget.

use rand_distr::{Distribution, Normal};
use serde::{Deserialize, Serialize};

use super::{Attempt, Reality};
use crate::budget::{Budget, Unlimited};
use crate::error::{Error, Result, check_range};
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{Family, HiddenPhysics, Placement, Scene, Task, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::{Engine, Latents, Rollout, Simulator, effect};

/// Configuration of a hidden world; not available to estimators.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HiddenConfig {
    /// True latent factors; `None` keeps those of the scene.
    #[serde(default)]
    pub latents: Latents,
    /// Effects that the simulation lacks.
    #[serde(default)]
    pub effects: Vec<EffectTerm>,
    /// Physics engine of the hidden world.
    #[serde(default)]
    pub engine: Engine,
    /// Standard deviation of independent normal noise on observed positions after the start, m. With noise, observations
    /// are those of a camera: angles are those of a mark on the rim, with the same noise; velocities and spins after the
    /// start are missing.
    #[serde(default)]
    pub noise: f64,
    /// Maximum number of valid attempts; unlimited if absent.
    #[serde(default)]
    pub budget: Option<u64>,
    /// Seed of the noise.
    #[serde(default)]
    pub seed: u64,
}

/// True parameters of a hidden world, for comparison with estimates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Latent factors.
    pub latents: Latents,
    /// Unmodelled effects.
    pub effects: Vec<EffectTerm>,
}

/// A world whose latents and effects are private and can only be measured.
pub struct HiddenWorld {
    config: HiddenConfig,
    interactions: u64,
}

/// Carries out one placed action in each of many worlds, as one batch. All interaction budgets are checked first; an error
/// contains the index of its world, if it concerns one. Interrupted attempts count as interactions.
pub fn measure_each(
    budget: &dyn Budget,
    worlds: &mut [(&mut HiddenWorld, &Scene)],
) -> std::result::Result<Vec<Trajectory>, (Option<usize>, Error)> {
    for (i, (world, _)) in worlds.iter().enumerate() {
        world.afford(1).map_err(|e| (Some(i), e))?;
    }
    let engines: Vec<Engine> = worlds.iter().map(|(w, _)| w.config.engine).collect();
    let rollouts: Vec<Rollout> = worlds.iter().map(|(w, scene)| w.rollout(scene)).collect();
    let observed = Simulator::per_rollout(&engines).budget(budget).run(&rollouts);
    if !observed.as_ref().is_err_and(|e| !is_stop(e)) {
        worlds.iter_mut().for_each(|(world, _)| world.interactions += 1);
    }
    let mut observed = observed.map_err(|e| (None, e))?;
    for (trajectory, (world, scene)) in observed.iter_mut().zip(worlds) {
        world.observe(trajectory, scene, world.interactions - 1);
    }
    Ok(observed)
}

/// Whether the work was interrupted from outside. The started attempts count, although their results are lost.
fn is_stop(error: &Error) -> bool {
    matches!(error, Error::Cancelled | Error::Deadline { .. })
}

/// Standard real world of a family, the one with seed 0; for the paper's families its latents, with damping 0.8 per second.
pub fn standard(family: &Family) -> HiddenConfig {
    real_world(family, 0)
}

/// The real world of a family with this seed. Worlds differ if the family's file has ranges in place of hidden numbers.
pub fn real_world(family: &Family, seed: u64) -> HiddenConfig {
    world_of(family.real_physics.draw(seed), seed)
}

/// The real world in which a family's tasks are certified: the centre of its ranges.
pub(super) fn certification_world(family: &Family) -> HiddenConfig {
    world_of(family.real_physics.centre(), 0)
}

fn world_of(physics: HiddenPhysics, seed: u64) -> HiddenConfig {
    HiddenConfig {
        latents: Latents::of([physics.density, physics.friction, physics.restitution]),
        effects: vec![effect::damping(physics.damping)],
        engine: Engine::Auto,
        noise: 0.0,
        budget: None,
        seed,
    }
}

impl HiddenWorld {
    /// A new world with no interactions spent. Errors name the field of `config` that is out of range.
    pub fn new(config: HiddenConfig) -> Result<HiddenWorld> {
        config.latents.validate()?;
        check_range("noise", config.noise, 0.0, 1e3)?;
        for (i, term) in config.effects.iter().enumerate() {
            effect::resolve(term, format_args!("effects[{i}]"))?;
        }
        Ok(HiddenWorld { config, interactions: 0 })
    }

    /// The same world with `spent` interactions on its counter, for restoring a stored world.
    pub fn with_spent(mut self, spent: u64) -> HiddenWorld {
        self.interactions = spent;
        self
    }

    /// The true parameters, for result tables and oracles only; no estimator accepts them.
    pub fn reveal(&self) -> Truth {
        Truth { latents: self.config.latents, effects: self.config.effects.clone() }
    }

    /// Rollout of `scene` in this world.
    fn rollout<'a>(&'a self, scene: &'a Scene) -> Rollout<'a> {
        Rollout { latents: self.config.latents, effects: &self.config.effects, ..Rollout::of(scene) }
    }

    /// Errors unless the budget covers `asked` more attempts.
    fn afford(&self, asked: u64) -> Result<()> {
        match self.config.budget {
            Some(limit) if self.interactions + asked > limit => {
                Err(Error::Budget { limit, spent: self.interactions, asked })
            }
            _ => Ok(()),
        }
    }

    /// Reproduces, bit for bit, the trajectory of attempt number `interactions` in this placed scene. It is not counted, since it
    /// was already measured. Only for the session that made the attempt: with an arbitrary scene it would be a free measurement.
    pub(crate) fn recall(&self, budget: &dyn Budget, scene: &Scene, interactions: u64) -> Result<Trajectory> {
        if !(1..=self.interactions).contains(&interactions) {
            return Err(Error::Failed(format!("attempt {interactions} does not exist")));
        }
        let mut trajectory = Simulator::new(self.config.engine).budget(budget).one(self.rollout(scene))?;
        self.observe(&mut trajectory, scene, interactions - 1);
        Ok(trajectory)
    }

    /// Adds the measurement noise of interaction number `interaction`; the start is set by the experimenter and known exactly.
    fn observe(&self, trajectory: &mut Trajectory, scene: &Scene, interaction: u64) {
        if self.config.noise == 0.0 {
            return;
        }
        let own = rng::derive_seed(self.config.seed, "observation", interaction);
        let (mut stream, mut turns) = (rng::stream(own, "noise"), rng::stream(own, "angle noise"));
        let normal =
            Normal::new(0.0, self.config.noise).expect("noise is validated to be finite and not negative");
        for track in &mut trajectory.bodies {
            let pieces = scene.body(&track.name).and_then(|b| b.shape.pieces());
            let rim = pieces.map_or(1.0, |p| p.smallest_extent() / 2.0);
            for i in 1..track.len() {
                track.x[i] += normal.sample(&mut stream);
                track.y[i] += normal.sample(&mut stream);
                track.angle[i] += normal.sample(&mut turns) / rim;
                (track.vx[i], track.vy[i], track.omega[i]) = (f64::NAN, f64::NAN, f64::NAN);
            }
        }
    }
}

impl Reality for HiddenWorld {
    fn measure(&mut self, task: &Task, actions: &[ValidAction]) -> Result<Vec<Attempt>> {
        self.measure_within(&Unlimited, task, actions)
    }

    fn interactions(&self) -> u64 {
        self.interactions
    }

    fn budget(&self) -> Option<u64> {
        self.config.budget
    }
}

impl HiddenWorld {
    /// [`Reality::measure`] with a time budget. Interrupted attempts count as interactions.
    pub fn measure_within(
        &mut self,
        budget: &dyn Budget,
        task: &Task,
        actions: &[ValidAction],
    ) -> Result<Vec<Attempt>> {
        let place = |a| budget.check().map(|()| task.place(a));
        let placements: Vec<Placement> = actions.iter().map(place).collect::<Result<_>>()?;
        let rollouts: Vec<Rollout> = placements
            .iter()
            .filter_map(|p| match p {
                Placement::Valid(scene) => Some(self.rollout(scene)),
                Placement::Invalid(_) => None,
            })
            .collect();
        let asked = rollouts.len() as u64;
        self.afford(asked)?;
        let mut observed = match Simulator::new(self.config.engine).budget(budget).map(&rollouts, |_, t| t) {
            Ok(observed) => observed,
            Err(e) => {
                self.interactions += if is_stop(&e) { asked } else { 0 };
                return Err(e);
            }
        };
        for (i, (trajectory, rollout)) in observed.iter_mut().zip(&rollouts).enumerate() {
            self.observe(trajectory, rollout.scene, self.interactions + i as u64);
        }
        self.interactions += asked;
        let mut observed = observed.into_iter();
        Ok(placements
            .into_iter()
            .map(|p| match p {
                Placement::Valid(scene) => Attempt { placement: Ok(scene), trajectory: observed.next() },
                Placement::Invalid(reason) => Attempt { placement: Err(reason), trajectory: None },
            })
            .collect())
    }
}
