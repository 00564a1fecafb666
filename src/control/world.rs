//! A vector of environments of one control task, with Gymnasium's rules.
//!
//! An episode ends (`terminated`) by the task's condition, or is `truncated` at its time limit. Seeds give the same bits however
//! many environments there are. Positions are measured with the world's noise; velocities are actual ones.

use std::sync::Arc;

use rand::RngExt;

use super::model::{ControlModel, ControlOutcome, ControlState, RewardKind};
use super::physics::ControlPhysics;
use crate::error::{Error, Result};
use crate::rng::{self, Stream, derive_seed};
use crate::session::{Autoreset, WorldKind};
use crate::world::mechanism::JointMotion;

/// Maximum number of environments of a world.
pub const MAX_ENVIRONMENTS: usize = 4096;

/// Settings of a world.
pub struct ControlWorldConfig {
    pub model: Arc<ControlModel>,
    pub kind: WorldKind,
    /// Effects and noise; of a real world those that differ from run to run are drawn once, of a simulated one at each reset.
    pub physics: ControlPhysics,
    pub count: usize,
    pub reward: RewardKind,
    pub seed: u64,
}

/// Environments of one task.
pub struct ControlWorld {
    pub config: ControlWorldConfig,
    environments: Vec<Environment>,
    pub usage: ControlUsage,
}

/// Interactions with a world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ControlUsage {
    /// Motion of all environments, s.
    pub motion_seconds: f64,
    pub resets: u64,
    pub steps: u64,
}

struct Environment {
    stream: Stream,
    state: Option<ControlState>,
    has_ended: bool,
}

/// The result of a step of one environment.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlStep {
    /// At the end of the step; after a reset in the same step, of the new episode.
    pub outcome: ControlOutcome,
    /// Whether the step reset the environment and ignored the action.
    pub was_reset: bool,
    /// The observation at the end of an episode that the same step replaced by a new one.
    pub final_observation: Option<Vec<f64>>,
}

impl ControlWorld {
    pub fn new(mut config: ControlWorldConfig) -> Result<ControlWorld> {
        if !(1..=MAX_ENVIRONMENTS).contains(&config.count) {
            return Err(Error::input("count", config.count, format!("from 1 to {MAX_ENVIRONMENTS}")));
        }
        if config.kind == WorldKind::Real {
            config.physics = config.physics.draw_once(&mut rng::stream(config.seed, "control reality"));
        }
        let environments = (0..config.count).map(|i| Environment::seeded(config.seed, i)).collect();
        Ok(ControlWorld { config, environments, usage: ControlUsage::default() })
    }

    /// Replaces the effects, from the next reset of each environment on, and the noise at once.
    pub fn set_physics(&mut self, physics: ControlPhysics) -> Result<()> {
        if self.config.kind == WorldKind::Real {
            return Err(Error::Refused { reason: "the physics of a real world cannot be set".into() });
        }
        self.config.physics = physics;
        Ok(())
    }

    /// Starts episodes in all environments, or in those that the mask selects; with a seed their sequences start anew.
    pub fn reset(&mut self, seed: Option<u64>, mask: Option<&[bool]>) -> Result<Vec<Option<ControlOutcome>>> {
        if let Some(mask) = mask.filter(|mask| mask.len() != self.config.count) {
            let allowed = format!("{}, one per environment", self.config.count);
            return Err(Error::input("mask", format!("{} values", mask.len()), allowed));
        }
        let mut out = Vec::with_capacity(self.config.count);
        for i in 0..self.config.count {
            let wanted = mask.is_none_or(|mask| mask[i]);
            if wanted && let Some(seed) = seed {
                self.environments[i] = Environment::seeded(seed, i);
            }
            out.push(wanted.then(|| self.reset_one(i)));
        }
        out.iter().flatten().try_for_each(|outcome| self.config.model.check_finite(outcome))?;
        Ok(out)
    }

    /// Steps every environment once. Nothing has been done on an error, except one of numbers that are not finite.
    pub fn step(&mut self, actions: &[Vec<f64>], autoreset: Autoreset) -> Result<Vec<ControlStep>> {
        let actions = self.checked(actions, autoreset)?;
        let motions = self.motions(&actions);
        let mut out = Vec::with_capacity(self.config.count);
        for (i, (action, motion)) in actions.iter().zip(motions).enumerate() {
            let Some((state, motion)) = self.environments[i].state.take().zip(motion) else {
                let outcome = self.reset_one(i);
                out.push(ControlStep { outcome, was_reset: true, final_observation: None });
                continue;
            };
            let mut outcome = self.stepped(i, state, action, &motion);
            let has_ended = outcome.terminated || outcome.truncated;
            self.environments[i].has_ended = has_ended;
            let mut final_observation = None;
            if has_ended && autoreset == Autoreset::SameStep {
                let ControlOutcome { observation, positions, velocities, .. } = self.reset_one(i);
                final_observation = Some(std::mem::replace(&mut outcome.observation, observation));
                (outcome.positions, outcome.velocities) = (positions, velocities);
            }
            out.push(ControlStep { outcome, was_reset: false, final_observation });
        }
        out.iter().try_for_each(|step| self.config.model.check_finite(&step.outcome))?;
        Ok(out)
    }

    /// The motion of each environment in a step; `None` where the episode has ended.
    fn motions(&self, actions: &[Vec<f64>]) -> Vec<Option<JointMotion>> {
        let (mut places, mut states, mut taken) = (Vec::new(), Vec::new(), Vec::new());
        for (i, environment) in self.environments.iter().enumerate() {
            if let Some(state) = environment.state.as_ref().filter(|_| !environment.has_ended) {
                places.push(i);
                states.push(state);
                taken.push(vec![actions[i].clone()]);
            }
        }
        let mut out = vec![None; self.config.count];
        for (i, motion) in places.into_iter().zip(self.config.model.advance(&states, &taken)) {
            out[i] = Some(motion);
        }
        out
    }

    /// Outcomes of sequences of actions from the current state of an environment of a simulated world, which does not change.
    pub fn rollouts(
        &self,
        environment: usize,
        sequences: &[Vec<Vec<f64>>],
    ) -> Result<Vec<Vec<ControlOutcome>>> {
        if self.config.kind == WorldKind::Real {
            return Err(Error::Refused { reason: "a real world cannot be rolled out: step it".into() });
        }
        let own = self.environment(environment)?;
        let state = own.state.as_ref().filter(|_| !own.has_ended).ok_or_else(not_reset)?;
        let mut checked = Vec::with_capacity(sequences.len());
        for (i, sequence) in sequences.iter().enumerate() {
            let each = sequence.iter().enumerate();
            let own = each.map(|(k, a)| self.in_range(&format!("actions[{i}][{k}]"), a));
            checked.push(own.collect::<Result<Vec<Vec<f64>>>>()?);
        }
        Ok(self.config.model.rollouts(&vec![state; checked.len()], &checked, self.config.reward))
    }

    /// The state of an environment.
    pub fn state(&self, environment: usize) -> Result<&ControlState> {
        self.environment(environment)?.state.as_ref().ok_or_else(not_reset)
    }

    fn environment(&self, index: usize) -> Result<&Environment> {
        self.environments
            .get(index)
            .ok_or_else(|| Error::input("environment", index, format!("from 0 to {}", self.config.count - 1)))
    }

    /// Actions in range, one per environment; an error if one is none, or if an environment must be reset first.
    fn checked(&self, actions: &[Vec<f64>], autoreset: Autoreset) -> Result<Vec<Vec<f64>>> {
        if actions.len() != self.config.count {
            let allowed = format!("{}, one per environment", self.config.count);
            return Err(Error::input("actions", format!("{} actions", actions.len()), allowed));
        }
        let is_ready =
            |e: &Environment| e.state.is_some() && (!e.has_ended || autoreset == Autoreset::NextStep);
        if !self.environments.iter().all(is_ready) {
            return Err(not_reset());
        }
        actions.iter().enumerate().map(|(i, a)| self.in_range(&format!("actions[{i}]"), a)).collect()
    }

    /// An action clipped to the range of the motors.
    fn in_range(&self, field: &str, action: &[f64]) -> Result<Vec<f64>> {
        let ranges = &self.config.model.ranges;
        if action.len() != ranges.len() {
            let allowed = format!("{}, one per motor", ranges.len());
            return Err(Error::input(field, format!("{} numbers", action.len()), allowed));
        }
        if let Some(bad) = action.iter().position(|a| !a.is_finite()) {
            return Err(Error::input(format!("{field}[{bad}]"), action[bad], "a finite number"));
        }
        Ok(action.iter().zip(ranges).map(|(a, [low, high])| a.clamp(*low, *high)).collect())
    }

    /// Moves an environment to the end of its step.
    fn stepped(
        &mut self,
        i: usize,
        mut state: ControlState,
        action: &[f64],
        motion: &JointMotion,
    ) -> ControlOutcome {
        let model = self.config.model.clone();
        let environment = &mut self.environments[i];
        let last = |of: &[Vec<f64>]| of.iter().map(|own| own[0]).collect::<Vec<f64>>();
        let (positions, velocities) = (last(&motion.positions), last(&motion.velocities));
        self.usage.steps += 1;
        self.usage.motion_seconds += model.task.interval;
        let is_finite = positions.iter().chain(&velocities).all(|x| x.is_finite());
        if !is_finite {
            // A motion that diverges ends the episode where it was.
            let (q, v, now) = (state.position.clone(), state.velocity.clone(), [state.time]);
            let mut outcome =
                model.outcome([&q, &v], action, [&now, &state.draws], state.steps, self.config.reward);
            (outcome.terminated, outcome.truncated) = (true, false);
            environment.state = Some(state);
            return outcome;
        }
        model.moved(&mut state, &[action.to_vec()], motion);
        let noise = &self.config.physics.noise;
        let positions = model.with_noise(&state, &positions, noise, &mut environment.stream);
        let now = [state.time];
        let numbers = [&now[..], &state.draws];
        let outcome =
            model.outcome([&positions, &velocities], action, numbers, state.steps, self.config.reward);
        environment.state = Some(state);
        outcome
    }

    fn reset_one(&mut self, i: usize) -> ControlOutcome {
        let ControlWorldConfig { model, physics, reward, .. } = &self.config;
        let Environment { stream, state, has_ended } = &mut self.environments[i];
        self.usage.resets += 1;
        let mut uniform = |[low, high]: [f64; 2]| {
            let share: f64 = stream.random();
            low + share * (high - low)
        };
        let (mut position, mut velocity) = (model.tree.position.clone(), model.tree.velocity.clone());
        for (j, name) in model.tree.names.iter().enumerate() {
            if let Some(range) = model.task.initial.get(name) {
                (position[j], velocity[j]) = (uniform(range.position), uniform(range.velocity));
            }
        }
        let draws: Vec<f64> = model.task.draws.values().map(|range| uniform(*range)).collect();
        let terms = physics.draw(stream);
        let fresh = model.initial(position, velocity, draws, terms);
        let measured = model.measured(&fresh);
        let positions = model.with_noise(&fresh, &measured, &physics.noise, stream);
        let numbers: [&[f64]; 2] = [&[0.0], &fresh.draws];
        let outcome = model.outcome([&positions, &fresh.velocity], &model.idle(), numbers, 0, *reward);
        (*state, *has_ended) = (Some(fresh), false);
        outcome
    }
}

impl Environment {
    fn seeded(seed: u64, index: usize) -> Environment {
        let stream = rng::stream(derive_seed(seed, "control environment", index as u64), "episodes");
        Environment { stream, state: None, has_ended: false }
    }
}

fn not_reset() -> Error {
    Error::Refused { reason: "an environment has no episode: reset it first".into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::control::{ControlReality, control_task, control_tasks};

    fn world(task: &str, kind: WorldKind, count: usize) -> ControlWorld {
        let model = ControlModel::new(control_task(task).unwrap().clone()).unwrap();
        let reality = match kind {
            WorldKind::Real => model.task.real.clone(),
            WorldKind::Sim => ControlReality::default(),
        };
        let physics = ControlPhysics::new(&reality, &model.tree, "real.").unwrap();
        let reward = RewardKind::Dense;
        let config = ControlWorldConfig { model: Arc::new(model), kind, physics, count, reward, seed: 5 };
        ControlWorld::new(config).unwrap()
    }

    fn action(world: &ControlWorld, k: usize) -> Vec<f64> {
        world
            .config
            .model
            .ranges
            .iter()
            .map(|[low, high]| if k.is_multiple_of(3) { *low } else { 0.7 * high })
            .collect()
    }

    #[test]
    fn environments_have_the_same_bits_in_any_vector() {
        for task in control_tasks() {
            let mut many = world(&task.name, WorldKind::Real, 9);
            let mut few = world(&task.name, WorldKind::Real, 2);
            let first = many.reset(Some(3), None).unwrap();
            assert_eq!(few.reset(Some(3), None).unwrap(), first[..2]);
            for k in 0..40 {
                let own = action(&many, k);
                let wide = many.step(&vec![own.clone(); 9], Autoreset::NextStep).unwrap();
                assert_eq!(few.step(&vec![own; 2], Autoreset::NextStep).unwrap(), wide[..2], "{}", task.name);
            }
        }
    }

    /// Also where some are reset while others move, and where some have effects that others lack.
    #[test]
    fn environments_that_are_reset_do_not_disturb_others() {
        let (mut many, mut few) =
            (world("cart_pole_balance", WorldKind::Sim, 9), world("cart_pole_balance", WorldKind::Sim, 2));
        let friction = r#"{"effects": [{"joint": "slide", "name": "viscous_friction", "parameters": {"b": [0.5, 2.0]}}]}"#;
        let mut stream = rng::stream(1, "actions");
        let mut resets = 0;
        for own in [&mut many, &mut few] {
            own.reset(Some(4), None).unwrap();
            let physics = serde_json::from_str(friction).unwrap();
            own.set_physics(ControlPhysics::new(&physics, &own.config.model.tree, "").unwrap()).unwrap();
        }
        for _ in 0..200 {
            let actions: Vec<Vec<f64>> = (0..9).map(|_| vec![stream.random_range(-10.0..10.0)]).collect();
            let wide = many.step(&actions, Autoreset::NextStep).unwrap();
            resets += wide.iter().filter(|step| step.was_reset).count();
            assert_eq!(few.step(&actions[..2], Autoreset::NextStep).unwrap(), wide[..2]);
        }
        assert!(resets > 10, "{resets}");
    }

    #[test]
    fn episodes_end_as_gymnasium_says() {
        let mut world = world("cart_pole_balance", WorldKind::Sim, 1);
        assert!(world.step(&[vec![0.0]], Autoreset::Disabled).is_err(), "not reset");
        world.reset(Some(1), None).unwrap();
        let push =
            |world: &mut ControlWorld, autoreset| world.step(&[vec![10.0]], autoreset).unwrap().remove(0);
        let mut steps = 0;
        let end = loop {
            let one = push(&mut world, Autoreset::Disabled);
            steps += 1;
            if one.outcome.terminated {
                break one;
            }
        };
        assert!(steps < 40 && end.outcome.observation[2].abs() > 0.21 && !end.outcome.truncated);
        assert!(world.step(&[vec![0.0]], Autoreset::Disabled).is_err(), "the episode has ended");
        assert!((world.usage.motion_seconds - 0.02 * f64::from(steps)).abs() < 1e-9);
        let reset = push(&mut world, Autoreset::NextStep);
        assert!(reset.was_reset && reset.outcome.observation[2].abs() < 0.06);
        let ended = loop {
            let one = push(&mut world, Autoreset::SameStep);
            if one.outcome.terminated {
                break one;
            }
        };
        assert!(
            ended.final_observation.unwrap()[2].abs() > 0.21 && ended.outcome.observation[2].abs() < 0.06
        );
        assert_eq!(world.usage.resets, 3);
    }

    #[test]
    fn numbers_that_are_not_finite_are_named() {
        let mut task = control_task("pendulum_swing_up").unwrap().clone();
        task.reward.dense = "1 / (time - 0.04)".into();
        let model = Arc::new(ControlModel::new(task).unwrap());
        let physics = ControlPhysics::new(&ControlReality::default(), &model.tree, "").unwrap();
        let (kind, count, reward) = (WorldKind::Sim, 2, RewardKind::Dense);
        let mut world =
            ControlWorld::new(ControlWorldConfig { model, kind, physics, count, reward, seed: 1 }).unwrap();
        world.reset(None, None).unwrap();
        let mut step = || world.step(&[vec![0.0], vec![0.0]], Autoreset::Disabled);
        step().unwrap();
        assert!(step().unwrap_err().to_string().contains("reward"));
    }

    #[test]
    fn an_episode_is_truncated_at_its_time_limit() {
        let mut world = world("pendulum_swing_up", WorldKind::Sim, 1);
        world.reset(None, None).unwrap();
        let ends: Vec<bool> = (0..500)
            .map(|_| world.step(&[vec![0.0]], Autoreset::Disabled).unwrap()[0].outcome.truncated)
            .collect();
        assert_eq!(ends.iter().position(|end| *end), Some(499));
    }

    /// Steps continue a motion exactly: one at a time they are as all in one rollout, with delays and lags as well.
    #[test]
    fn steps_and_rollouts_agree() {
        let mut world = world("pendulum_swing_up", WorldKind::Sim, 1);
        let lagging = r#"{"effects": [
            {"joint": "hinge", "name": "command_delay", "parameters": {"delay": 0.033}},
            {"joint": "hinge", "name": "encoder_lag", "parameters": {"age": 0.017}}]}"#;
        let physics = |world: &ControlWorld| {
            ControlPhysics::new(&serde_json::from_str(lagging).unwrap(), &world.config.model.tree, "")
                .unwrap()
        };
        world.set_physics(physics(&world)).unwrap();
        world.reset(Some(2), None).unwrap();
        let sequence: Vec<Vec<f64>> = (0..60).map(|k| action(&world, k)).collect();
        let at_once = world.rollouts(0, std::slice::from_ref(&sequence)).unwrap().remove(0);
        for (own, expected) in sequence.iter().zip(&at_once) {
            let step = world.step(std::slice::from_ref(own), Autoreset::Disabled).unwrap().remove(0);
            let off = (step.outcome.positions[0] - expected.positions[0]).abs();
            assert!(off < 1e-9, "{off}");
        }
    }

    #[test]
    fn a_real_world_keeps_its_physics() {
        let mut world = world("pendulum_swing_up", WorldKind::Real, 2);
        world.reset(Some(1), None).unwrap();
        let terms = |world: &ControlWorld, i| world.state(i).unwrap().terms[0].values.clone();
        let first = terms(&world, 0);
        assert_eq!(terms(&world, 1), first);
        world.reset(Some(2), None).unwrap();
        assert_eq!(terms(&world, 0), first);
        assert!(world.set_physics(world.config.physics.clone()).is_err());
        assert!(world.rollouts(0, &[vec![vec![0.0]]]).is_err());
    }
}
