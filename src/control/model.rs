//! A control task's mechanism and expressions.

use rand_distr::{Distribution, StandardNormal};

use crate::error::{Error, Result};
use crate::names::names;
use crate::rng::Stream;
use crate::task::control::{ControlExpressions, ControlTask};
use crate::task::expression::Expression;
use crate::task::joint::Motor;
use crate::world::mechanism::effect::JointState;
use crate::world::mechanism::{
    Commands, JointMotion, JointRollout, JointTerm, Tree, longest_delay, measured_position, rounded_position,
    scene_terms, simulate,
};

/// A task, compiled.
pub struct ControlModel {
    pub task: ControlTask,
    pub tree: Tree,
    /// Effects that the scene declares.
    scene_terms: Vec<JointTerm>,
    expressions: ControlExpressions,
    /// Places of the motors in the tree, in the scene's order, and the ranges of their commands.
    pub motors: Vec<usize>,
    pub ranges: Vec<[f64; 2]>,
    /// Places in the tree of the scene's joints.
    joints: Vec<usize>,
}

/// Which of a task's two rewards.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize, utoipa::ToSchema,
)]
#[serde(rename_all = "snake_case")]
#[schema(as = RewardKindIn)]
pub enum RewardKind {
    #[default]
    Dense,
    Sparse,
}

names!(RewardKind: Dense = "dense", Sparse = "sparse");

/// The state of a mechanism between two steps.
#[derive(Clone)]
pub struct ControlState {
    /// s since the reset
    pub time: f64,
    /// Number of steps since the reset.
    pub steps: u32,
    /// Actual positions and velocities, by joint; with encoders that lag, those of that much earlier.
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
    /// Commands of the last steps, oldest first: time and value by motor.
    commands: Vec<(f64, Vec<f64>)>,
    /// Numbers drawn at the reset.
    pub draws: Vec<f64>,
    /// Effects of this environment.
    pub terms: Vec<JointTerm>,
}

/// Numbers of one step.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlOutcome {
    pub observation: Vec<f64>,
    pub reward: f64,
    pub terminated: bool,
    pub truncated: bool,
    /// The task's condition of success; `None` without one.
    pub success: Option<bool>,
    /// Measured positions and actual velocities by joint.
    pub positions: Vec<f64>,
    pub velocities: Vec<f64>,
}

impl ControlState {
    /// The same state with other physics.
    pub fn with_terms(&self, terms: Vec<JointTerm>) -> ControlState {
        ControlState { terms, ..self.clone() }
    }
}

impl ControlModel {
    /// Compiles a task.
    pub fn new(task: ControlTask) -> Result<ControlModel> {
        task.validate()?;
        let tree = Tree::of(&task.scene).map_err(|e| e.in_field("scene"))?;
        let scene_terms = scene_terms(&task.scene, &tree).map_err(|e| e.in_field("scene"))?;
        let place = |name: &str| tree.joint(name).ok_or_else(|| Error::Failed(format!("no joint {name}")));
        let motors: Vec<&Motor> = task.scene.motors.iter().collect();
        Ok(ControlModel {
            expressions: task.expressions()?,
            motors: motors.iter().map(|m| place(&m.joint)).collect::<Result<_>>()?,
            ranges: motors.iter().map(|m| task.actions[&m.joint]).collect(),
            joints: task.scene.joints.iter().map(|j| place(&j.name)).collect::<Result<_>>()?,
            tree,
            scene_terms,
            task,
        })
    }

    /// Number of steps after which an episode is truncated.
    pub fn max_steps(&self) -> u32 {
        (self.task.time_limit / self.task.interval).round() as u32
    }

    /// The state after a reset at initial positions and velocities by joint of the tree.
    pub fn initial(
        &self,
        position: Vec<f64>,
        velocity: Vec<f64>,
        draws: Vec<f64>,
        terms: Vec<JointTerm>,
    ) -> ControlState {
        ControlState { time: 0.0, steps: 0, position, velocity, commands: Vec::new(), draws, terms }
    }

    /// The state that an agent knows: numbers measured after a number of steps, by joint of the scene, and its last actions, oldest
    /// first.
    pub fn known_state(
        &self,
        steps: u32,
        [positions, velocities]: [&[f64]; 2],
        actions: &[Vec<f64>],
        draws: Vec<f64>,
    ) -> Result<ControlState> {
        let count = self.joints.len();
        for (field, numbers) in [("position", positions), ("velocity", velocities)] {
            if numbers.len() != count || numbers.iter().any(|x| !x.is_finite()) {
                let allowed = format!("{count} finite numbers, one per joint");
                return Err(Error::input(field, format!("{} numbers", numbers.len()), allowed));
            }
        }
        let (mut position, mut velocity) = (vec![0.0; count], vec![0.0; count]);
        for (i, j) in self.joints.iter().enumerate() {
            (position[*j], velocity[*j]) = (positions[i], velocities[i]);
        }
        let past = actions.iter().rev().zip(1..=steps).map(|(own, k)| (self.time(steps - k), own.clone()));
        let mut commands: Vec<(f64, Vec<f64>)> = past.collect();
        commands.reverse();
        let time = self.time(steps);
        Ok(ControlState { time, steps, position, velocity, commands, draws, terms: Vec::new() })
    }

    /// Motions of states under sequences of actions, one per state: observed at every step. Actions by step and motor, in range.
    pub fn advance(&self, states: &[&ControlState], actions: &[Vec<Vec<f64>>]) -> Vec<JointMotion> {
        let commands: Vec<Commands> =
            states.iter().zip(actions).map(|(state, own)| self.commands(state, own)).collect();
        let times: Vec<Vec<f64>> = states
            .iter()
            .zip(actions)
            .map(|(s, own)| (1..=own.len()).map(|k| self.time(s.steps + k as u32)).collect())
            .collect();
        let rollouts: Vec<JointRollout> = states
            .iter()
            .enumerate()
            .map(|(i, state)| JointRollout {
                tree: &self.tree,
                terms: self.terms(state).cloned().collect(),
                position: state.position.clone(),
                velocity: state.velocity.clone(),
                start: state.time,
                commands: &commands[i],
                times: &times[i],
                field: None,
            })
            .collect();
        simulate(&rollouts)
    }

    /// Effects of the scene and of a state's own physics.
    fn terms<'a>(&'a self, state: &'a ControlState) -> impl Iterator<Item = &'a JointTerm> {
        self.scene_terms.iter().chain(&state.terms)
    }

    /// The command of each motor before the first action: 0, or the nearest value in its range.
    pub fn idle(&self) -> Vec<f64> {
        self.ranges.iter().map(|[low, high]| 0f64.clamp(*low, *high)).collect()
    }

    /// Time after a number of steps, s.
    fn time(&self, steps: u32) -> f64 {
        f64::from(steps) * self.task.interval
    }

    /// Past and coming commands, idle before the first one.
    fn commands(&self, state: &ControlState, actions: &[Vec<f64>]) -> Commands {
        let idle = (-1e9, self.idle());
        let coming = actions.iter().enumerate().map(|(k, own)| (self.time(state.steps + k as u32), own));
        let past = std::iter::once(&idle).chain(&state.commands).map(|(t, own)| (*t, own));
        let all: Vec<(f64, &Vec<f64>)> = past.chain(coming).collect();
        let mut values = vec![Vec::new(); self.tree.links.len()];
        for (m, joint) in self.motors.iter().enumerate() {
            values[*joint] = all.iter().map(|(_, own)| own[m]).collect();
        }
        Commands::new(all.iter().map(|(t, _)| *t).collect(), values)
    }

    /// Moves a state to the end of a motion under these actions.
    pub fn moved(&self, state: &mut ControlState, actions: &[Vec<f64>], motion: &JointMotion) {
        for own in actions {
            state.commands.push((state.time, own.clone()));
            state.steps += 1;
            state.time = self.time(state.steps);
        }
        (state.position, state.velocity) = motion.end.clone();
        let oldest = state.time - longest_delay(self.terms(state));
        let needed = state.commands.partition_point(|(t, _)| *t < oldest).saturating_sub(1);
        state.commands.drain(..needed);
    }

    /// Positions by joint as encoders measure those of a state at rest.
    pub fn measured(&self, state: &ControlState) -> Vec<f64> {
        let of = |j: usize| {
            let (position, velocity) = (state.position[j], state.velocity[j]);
            let own = JointState { position, velocity, drive: 0.0, max_torque: 0.0 };
            measured_position(self.terms(state), j, own)
        };
        (0..state.position.len()).map(of).collect()
    }

    /// Measured positions with noise of these standard deviations, rounded to the resolution of the encoders.
    pub fn with_noise(
        &self,
        state: &ControlState,
        positions: &[f64],
        sd: &[f64],
        stream: &mut Stream,
    ) -> Vec<f64> {
        let own = |(j, (q, sd)): (usize, (&f64, &f64))| {
            let z: f64 = StandardNormal.sample(stream);
            rounded_position(self.terms(state), j, q + sd * z)
        };
        positions.iter().zip(sd).enumerate().map(own).collect()
    }

    /// Numbers at a state: measured positions and velocities by joint of the tree, the last action and the time, s.
    pub fn outcome(
        &self,
        [positions, velocities]: [&[f64]; 2],
        action: &[f64],
        [time, draws]: [&[f64]; 2],
        steps: u32,
        reward: RewardKind,
    ) -> ControlOutcome {
        let mut numbers: Vec<f64> = Vec::with_capacity(3 * self.joints.len() + draws.len() + 8);
        numbers.extend(self.joints.iter().map(|j| positions[*j]));
        numbers.extend(self.joints.iter().map(|j| velocities[*j]));
        let command = |j: &usize| self.motors.iter().position(|m| m == j).map_or(0.0, |m| action[m]);
        numbers.extend(self.joints.iter().map(command));
        numbers.extend(time);
        numbers.extend(draws);
        for value in &self.expressions.values {
            numbers.push(value.value(&numbers));
        }
        let holds = |e: &Expression| e.value(&numbers) != 0.0;
        let own = match reward {
            RewardKind::Dense => &self.expressions.dense,
            RewardKind::Sparse => &self.expressions.sparse,
        };
        let terminated = self.expressions.terminate.as_ref().is_some_and(holds);
        ControlOutcome {
            observation: self.expressions.observations.iter().map(|o| o.value(&numbers)).collect(),
            reward: own.value(&numbers),
            terminated,
            truncated: !terminated && steps >= self.max_steps(),
            success: self.expressions.success.as_ref().map(holds),
            positions: self.joints.iter().map(|j| positions[*j]).collect(),
            velocities: self.joints.iter().map(|j| velocities[*j]).collect(),
        }
    }

    /// An error that names an expression whose value is not finite.
    pub fn check_finite(&self, outcome: &ControlOutcome) -> Result<()> {
        let observed = self.task.observations.iter().zip(&outcome.observation);
        let named = observed.map(|(own, value)| (format!("observation {}", own.name), *value));
        let all = std::iter::once(("reward".to_string(), outcome.reward)).chain(named);
        match all.into_iter().find(|(_, value)| !value.is_finite()) {
            None => Ok(()),
            Some((name, value)) => Err(Error::input(
                name,
                value,
                "an expression of the task that is finite wherever the mechanism goes",
            )),
        }
    }

    /// Outcomes of every step of sequences of actions from one state, each without noise; those after the end of an episode are
    /// left out. A motion that diverges ends its episode with the reward minus infinity.
    pub fn rollouts(
        &self,
        states: &[&ControlState],
        actions: &[Vec<Vec<f64>>],
        reward: RewardKind,
    ) -> Vec<Vec<ControlOutcome>> {
        let motions = self.advance(states, actions);
        let each = motions.iter().zip(states).zip(actions);
        each.map(|((motion, state), own)| {
            let mut out: Vec<ControlOutcome> = Vec::with_capacity(own.len());
            for (k, action) in own.iter().enumerate() {
                let row = |of: &[Vec<f64>]| of.iter().map(|own| own[k]).collect::<Vec<f64>>();
                let (q, v) = (row(&motion.positions), row(&motion.velocities));
                let steps = state.steps + k as u32 + 1;
                let now = [self.time(steps)];
                let mut outcome = self.outcome([&q, &v], action, [&now, &state.draws], steps, reward);
                if !outcome.reward.is_finite() || q.iter().chain(&v).any(|x| !x.is_finite()) {
                    (outcome.reward, outcome.terminated) = (f64::NEG_INFINITY, true);
                }
                let is_end = outcome.terminated || outcome.truncated;
                out.push(outcome);
                if is_end {
                    break;
                }
            }
            out
        })
        .collect()
    }
}
