//! Labelled examples: which random actions solve which tasks in simulation.
//!
//! Source: Semage et al., pretraining in simulation; PHYRE's DQN is also trained on random actions.
//! Differences from the source: only valid discrete actions are labelled (an action that cannot be placed is not an attempt), and
//! tasks with few solving actions receive additional actions, up to a bound.

use rand::RngExt;
use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::estimate::{ParameterSample, ParameterSamples};
use crate::progress::Progress;
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{LabelCounts, Placement, Scene, Task, ValidAction};
use crate::world::{Engine, Latents, Rollout, Simulator, effect};

/// Tasks and labelled actions on them.
#[derive(Clone, Debug, Default)]
pub struct Dataset {
    pub tasks: Vec<Task>,
    pub rows: Vec<Example>,
}

/// Source of labelled examples for training.
pub trait LabelledData: Sync {
    /// Tasks of the examples.
    fn tasks(&self) -> &[Task];

    /// Errors if the data are invalid.
    fn validate(&self) -> Result<()>;

    /// (solving, failing) row indices of each task.
    fn pools(&self) -> Vec<[Vec<usize>; 2]>;

    /// Task index and action of a row.
    fn row(&self, row: usize) -> (usize, &ValidAction);
}

/// One action with its outcome.
#[derive(Clone, Debug, PartialEq)]
pub struct Example {
    /// Index into the dataset's tasks.
    pub task: usize,
    pub action: ValidAction,
    /// Whether the action solves the task.
    pub solved: bool,
}

/// Physics in which training actions are labelled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum TrainingPhysics {
    /// A single world: an estimate, or the true parameters for an oracle.
    Fixed { latents: Latents, effects: Vec<EffectTerm> },
    /// Domain randomisation: every rollout samples its latents uniformly from these intervals `[low, high]`.
    Randomised { density: [f64; 2], friction: [f64; 2], restitution: [f64; 2], effects: Vec<EffectTerm> },
    /// Posterior draws: every rollout uses one of these equally weighted parameter samples, so the policy learns the posterior
    /// probability that an action solves its task.
    #[serde(rename = "believed")]
    Posterior { draws: Vec<ParameterSample> },
}

/// Numbers of labelled actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelConfig {
    /// Minimum number of valid labelled actions per task (fewer only if the task has no more).
    pub per_task: usize,
    /// Number of solving actions below which a task receives additional actions.
    pub enough_solving: usize,
    /// Maximum number of labelled actions per task.
    #[serde(rename = "most_per_task")]
    pub max_per_task: usize,
    pub engine: Engine,
    pub seed: u64,
}

/// Rollouts between two progress reports.
const PROGRESS_CHUNK: usize = 1024;

/// Labels random valid discrete actions of each task by simulation. The result depends on the seed, but not on the number of threads
/// or the order of `tasks`.
pub fn label(
    tasks: &[Task],
    training: &TrainingPhysics,
    config: &LabelConfig,
    progress: &dyn Progress,
) -> Result<Dataset> {
    training.validate()?;
    let mut draws: Vec<ActionSampler> =
        tasks.iter().map(|task| ActionSampler::new(task, config.seed)).collect();
    let mut found: Vec<Vec<(ValidAction, bool)>> = vec![Vec::new(); tasks.len()];
    let mut round = vec![config.per_task; tasks.len()];
    let (mut done, mut total) = (0u64, (config.per_task * tasks.len()) as u64);
    loop {
        let mut jobs: Vec<LabelRollout<'_>> = Vec::new();
        for (t, draw) in draws.iter_mut().enumerate() {
            jobs.extend(draw.next_rollouts(t, round[t], training)?);
        }
        if jobs.is_empty() {
            break;
        }
        for chunk in jobs.chunks(config.engine.batch_size(PROGRESS_CHUNK)) {
            progress.report("label", done, total)?;
            for (job, solved) in chunk.iter().zip(simulate(chunk, config.engine, progress)?) {
                found[job.task].push((job.action.clone(), solved));
            }
            done += chunk.len() as u64;
        }
        for (t, rows) in found.iter().enumerate() {
            let solving = rows.iter().filter(|(_, solved)| *solved).count();
            let short = solving < config.enough_solving && !draws[t].exhausted();
            let more = if short { config.max_per_task.saturating_sub(rows.len()) } else { 0 };
            round[t] = more.min(config.per_task.max(1));
        }
        total = done + round.iter().sum::<usize>() as u64;
    }
    progress.report("label", done, done)?;
    let rows = found.into_iter().enumerate().flat_map(|(task, rows)| {
        rows.into_iter().map(move |(action, solved)| Example { task, action, solved })
    });
    Ok(Dataset { tasks: tasks.to_vec(), rows: rows.collect() })
}

impl TrainingPhysics {
    /// Domain randomisation over the paper's ranges: mass [0.1, 20], friction [0, 3], restitution [0, 1]. `effects` are added to those of
    /// the scene in every rollout.
    pub fn paper_randomised(effects: Vec<EffectTerm>) -> TrainingPhysics {
        TrainingPhysics::Randomised {
            density: [0.1, 20.0],
            friction: [0.0, 3.0],
            restitution: [0.0, 1.0],
            effects,
        }
    }

    /// Training over posterior samples.
    pub fn from_posterior(belief: &ParameterSamples) -> TrainingPhysics {
        TrainingPhysics::Posterior { draws: belief.draws().to_vec() }
    }

    /// Name of the kind in JSON.
    pub fn name(&self) -> &'static str {
        match self {
            TrainingPhysics::Fixed { .. } => "fixed",
            TrainingPhysics::Randomised { .. } => "randomised",
            TrainingPhysics::Posterior { .. } => "believed",
        }
    }

    /// Up to `count` parameter samples for validation, drawn like those of labels.
    pub fn worlds(&self, count: usize, seed: u64) -> Vec<ParameterSample> {
        let mut rng = rng::stream(seed, "training worlds");
        let drawn =
            |(latents, effects): (Latents, &[EffectTerm])| ParameterSample::new(latents, effects.to_vec());
        match self {
            TrainingPhysics::Fixed { .. } => vec![drawn(self.draw(&mut rng))],
            TrainingPhysics::Randomised { .. } => (0..count).map(|_| drawn(self.draw(&mut rng))).collect(),
            TrainingPhysics::Posterior { draws } => {
                let mut order: Vec<&ParameterSample> = draws.iter().collect();
                let (some, _) = order.partial_shuffle(&mut rng, count);
                some.iter().map(|world| (*world).clone()).collect()
            }
        }
    }

    /// Errors name the field that is out of range.
    pub fn validate(&self) -> Result<()> {
        match self {
            TrainingPhysics::Fixed { latents, effects } => {
                latents.validate().and(effect::validate_terms(effects))
            }
            TrainingPhysics::Posterior { draws } => validate_draws(draws),
            TrainingPhysics::Randomised { density, friction, restitution, effects } => {
                effect::validate_terms(effects)?;
                let ranges = [("density", density), ("friction", friction), ("restitution", restitution)];
                for (name, [low, high]) in ranges {
                    if !(low.is_finite() && high.is_finite() && low <= high) {
                        let value = format!("[{low}, {high}]");
                        return Err(Error::input(name, value, "[low, high] with low not above high"));
                    }
                }
                Latents::of([density[0], friction[0], restitution[0]]).validate()?;
                Latents::of([density[1], friction[1], restitution[1]]).validate()
            }
        }
    }

    /// Parameters of one rollout: latents, and effects added to those of the scene.
    fn draw(&self, rng: &mut rng::Stream) -> (Latents, &[EffectTerm]) {
        match self {
            TrainingPhysics::Fixed { latents, effects } => (*latents, effects),
            TrainingPhysics::Randomised { density, friction, restitution, effects } => {
                let drawn = [density, friction, restitution].map(|[low, high]| {
                    let share: f64 = rng.random();
                    low + share * (high - low)
                });
                (Latents::of(drawn), effects)
            }
            TrainingPhysics::Posterior { draws } => {
                let world = &draws[rng.random_range(0..draws.len())];
                (world.latents, &world.effects)
            }
        }
    }
}

/// Errors unless there is at least one draw and all draws are valid.
fn validate_draws(draws: &[ParameterSample]) -> Result<()> {
    if draws.is_empty() {
        return Err(Error::input("draws", "none", "at least one draw"));
    }
    for (i, world) in draws.iter().enumerate() {
        let valid = world.validate();
        valid.map_err(|e| e.in_field(&format!("draws[{i}]")))?;
    }
    Ok(())
}

impl LabelConfig {
    /// Preset of a family.
    pub fn preset(labels: &LabelCounts, seed: u64) -> LabelConfig {
        let LabelCounts { per_task, enough_solving, stretch } = *labels;
        let max_per_task = stretch * per_task;
        LabelConfig { per_task, enough_solving, max_per_task, engine: Engine::Auto, seed }
    }
}

impl Dataset {
    /// Number of solving examples.
    pub fn solving(&self) -> usize {
        self.rows.iter().filter(|r| r.solved).count()
    }
}

impl LabelledData for Dataset {
    fn tasks(&self) -> &[Task] {
        &self.tasks
    }

    /// Errors unless every example refers to an existing task and a valid action.
    fn validate(&self) -> Result<()> {
        for (i, row) in self.rows.iter().enumerate() {
            let Some(task) = self.tasks.get(row.task) else {
                let allowed = format!("an index below {}", self.tasks.len());
                return Err(Error::input(format!("rows[{i}].task"), row.task, allowed));
            };
            task.actions().validate(row.action.values()).map_err(|e| e.in_field(&format!("rows[{i}]")))?;
        }
        Ok(())
    }

    fn pools(&self) -> Vec<[Vec<usize>; 2]> {
        let mut pools = vec![[Vec::new(), Vec::new()]; self.tasks.len()];
        for (i, row) in self.rows.iter().enumerate() {
            pools[row.task][usize::from(!row.solved)].push(i);
        }
        pools
    }

    fn row(&self, row: usize) -> (usize, &ValidAction) {
        (self.rows[row].task, &self.rows[row].action)
    }
}

/// A placed action to simulate.
struct LabelRollout<'a> {
    task: usize,
    action: ValidAction,
    scene: Box<Scene>,
    latents: Latents,
    effects: &'a [EffectTerm],
}

fn simulate(jobs: &[LabelRollout], engine: Engine, progress: &dyn Progress) -> Result<Vec<bool>> {
    let of = |j| {
        let LabelRollout { scene, latents, effects, .. }: &LabelRollout = j;
        Rollout { latents: *latents, effects, ..Rollout::of(scene) }
    };
    let rollouts: Vec<Rollout> = jobs.iter().map(of).collect();
    Simulator::new(engine).budget(&progress).solved(&rollouts)
}

/// A task's discrete actions in random order.
struct ActionSampler<'a> {
    task: &'a Task,
    order: Vec<u32>,
    next: usize,
    worlds: rng::Stream,
}

impl<'a> ActionSampler<'a> {
    fn new(task: &'a Task, seed: u64) -> ActionSampler<'a> {
        let own = rng::derive_seed(seed, &task.id, 0);
        // At most a million actions; validated with the scene.
        let mut order: Vec<u32> = (0..task.actions().count() as u32).collect();
        order.shuffle(&mut rng::stream(own, "label actions"));
        ActionSampler { task, order, next: 0, worlds: rng::stream(own, "label latents") }
    }

    fn exhausted(&self) -> bool {
        self.next >= self.order.len()
    }

    /// The next `count` valid actions.
    fn next_rollouts<'t>(
        &mut self,
        task: usize,
        count: usize,
        training: &'t TrainingPhysics,
    ) -> Result<Vec<LabelRollout<'t>>> {
        let mut jobs = Vec::new();
        while jobs.len() < count && !self.exhausted() {
            let action = self.task.actions().at(self.order[self.next] as usize)?;
            self.next += 1;
            if let Placement::Valid(scene) = self.task.place(&action) {
                let (latents, effects) = training.draw(&mut self.worlds);
                jobs.push(LabelRollout { task, action, scene, latents, effects });
            }
        }
        Ok(jobs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;
    use crate::progress::NoProgress;
    use crate::task::scene::Goal;

    /// Red falls freely and solves the task if its x lies within a column.
    fn column(id: &str, [left, right]: [f64; 2]) -> Task {
        let mut task = toy::task(0.3);
        task.id = id.into();
        task.scene.steps = 5;
        let region = vec![[left, -99.0], [right, -99.0], [right, 99.0], [left, 99.0]];
        task.scene.goal = Some(Goal::Inside { body: "red".into(), region, hold_s: 0.0, stop: None });
        task
    }

    fn config(per_task: usize) -> LabelConfig {
        LabelConfig::preset(&LabelCounts { per_task, enough_solving: 0, stretch: 1 }, 0)
    }

    fn plain() -> TrainingPhysics {
        TrainingPhysics::Fixed { latents: Latents::default(), effects: Vec::new() }
    }

    #[test]
    fn labels_match_simulated_outcomes() {
        let tasks = [column("a", [2.0, 5.0]), column("b", [7.0, 7.5])];
        let data = label(&tasks, &plain(), &config(60), &NoProgress).unwrap();
        data.validate().unwrap();
        assert_eq!(data.rows.len(), 120);
        for row in &data.rows {
            let x = 10.0 * row.action.values()[0];
            let [left, right] = [[2.0, 5.0], [7.0, 7.5]][row.task];
            assert_eq!(row.solved, x > left && x < right, "{x}");
            assert!(matches!(tasks[row.task].place(&row.action), Placement::Valid(_)));
        }
        let mut distinct: Vec<_> = data.rows.iter().map(|r| format!("{} {:?}", r.task, r.action)).collect();
        distinct.sort_unstable();
        distinct.dedup();
        assert_eq!(distinct.len(), 120, "no repeated action");
    }

    #[test]
    fn adds_actions_for_rare_successes_up_to_bound() {
        let tasks = [column("rare", [7.0, 7.2]), column("never", [90.0, 91.0]), column("often", [1.0, 9.0])];
        let config = LabelConfig { enough_solving: 5, max_per_task: 700, ..config(50) };
        let data = label(&tasks, &plain(), &config, &NoProgress).unwrap();
        let count = |t: usize| data.rows.iter().filter(|r| r.task == t).count();
        let solving = |t: usize| data.rows.iter().filter(|r| r.task == t && r.solved).count();
        assert!(solving(0) >= 5 && count(0) > 50 && count(0) < 700, "{} of {}", solving(0), count(0));
        assert_eq!((count(1), count(2)), (700, 50));
    }

    #[test]
    fn labels_are_independent_of_threads_and_task_order() {
        let tasks = [column("a", [2.0, 5.0]), column("b", [4.0, 8.0])];
        let run = |tasks: &[Task], threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                label(tasks, &TrainingPhysics::paper_randomised(Vec::new()), &config(30), &NoProgress)
                    .unwrap()
                    .rows
            })
        };
        let one = run(&tasks, 1);
        assert_eq!(run(&tasks, 3), one);
        let turned = run(&[tasks[1].clone(), tasks[0].clone()], 2);
        let of = |rows: &[Example], t| -> Vec<_> {
            rows.iter().filter(|r| r.task == t).map(|r| (r.action.clone(), r.solved)).collect()
        };
        assert_eq!(of(&turned, 0), of(&one, 1));
    }

    /// Red is dropped and solves the task if it falls below a height within a second, which depends on drag.
    fn falling() -> Task {
        let mut task = toy::task(0.3);
        task.id = "falling".into();
        task.scene.steps = 240;
        let region = vec![[-99.0, -99.0], [99.0, -99.0], [99.0, 4.0], [-99.0, 4.0]];
        task.scene.goal = Some(Goal::Inside { body: "red".into(), region, hold_s: 0.0, stop: None });
        task
    }

    fn dragged(c: f64) -> ParameterSample {
        ParameterSample::new(Latents::default(), vec![effect::linear_drag(c)])
    }

    fn labelled(training: &TrainingPhysics) -> Vec<Example> {
        label(&[falling(), column("a", [2.0, 5.0])], training, &config(150), &NoProgress).unwrap().rows
    }

    #[test]
    fn single_draw_gives_labels_of_point_estimate() {
        let ParameterSample { latents, effects, .. } = dragged(2.0);
        let belief = ParameterSamples::point(latents, effects.clone()).unwrap();
        let point = labelled(&TrainingPhysics::Fixed { latents, effects });
        assert_eq!(labelled(&TrainingPhysics::from_posterior(&belief)), point);
        // The same for many equal draws: the choice of a draw does not change the actions.
        assert_eq!(labelled(&TrainingPhysics::Posterior { draws: vec![dragged(2.0); 9] }), point);
    }

    #[test]
    fn labels_use_all_posterior_draws() {
        let of = |draws: Vec<ParameterSample>| labelled(&TrainingPhysics::Posterior { draws });
        let (fast, slow) = (of(vec![dragged(0.0)]), of(vec![dragged(4.0)]));
        let both = of(vec![dragged(0.0), dragged(4.0)]);
        let mut seen = [0, 0];
        for ((f, s), b) in fast.iter().zip(&slow).zip(&both) {
            assert_eq!((&f.action, &s.action), (&b.action, &b.action));
            assert!(b.solved == f.solved || b.solved == s.solved);
            if f.solved != s.solved {
                seen[usize::from(b.solved == s.solved)] += 1;
            }
        }
        let total = (seen[0] + seen[1]) as f64;
        // Five standard deviations of a fair coin.
        assert!(total > 20.0 && (seen[0] as f64 - total / 2.0).abs() < 2.5 * total.sqrt(), "{seen:?}");
    }

    #[test]
    fn rejects_invalid_draws() {
        let refused = |draws: Vec<ParameterSample>, wanted: &str| {
            let error = TrainingPhysics::Posterior { draws }.validate().unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        };
        refused(Vec::new(), "draws");
        let heavy = ParameterSample::new(Latents { friction: Some(-1.0), ..Latents::default() }, Vec::new());
        refused(vec![dragged(0.0), heavy], "draws[1]");
        refused(vec![dragged(f64::NAN)], "draws[0]");
    }

    #[test]
    fn validation_worlds_match_label_worlds() {
        let count = |training: &TrainingPhysics| training.worlds(4, 1).len();
        assert_eq!((count(&plain()), count(&TrainingPhysics::paper_randomised(Vec::new()))), (1, 4));
        let draws: Vec<ParameterSample> = (0..6).map(|c| dragged(f64::from(c))).collect();
        let some = TrainingPhysics::Posterior { draws: draws.clone() }.worlds(4, 1);
        assert!(some.len() == 4 && some.iter().all(|w| draws.contains(w)));
        assert!((1..4).all(|i| !some[..i].contains(&some[i])), "none twice");
        assert_eq!(TrainingPhysics::Posterior { draws: draws[..2].to_vec() }.worlds(4, 1).len(), 2);
    }

    #[test]
    fn randomised_latents_cover_their_ranges() {
        let mut rng = rng::stream(1, "test");
        let drawn: Vec<[f64; 3]> = (0..500)
            .map(|_| {
                TrainingPhysics::paper_randomised(Vec::new()).draw(&mut rng).0.values().map(|v| v.unwrap())
            })
            .collect();
        for (i, [low, high]) in [[0.1, 20.0], [0.0, 3.0], [0.0, 1.0]].into_iter().enumerate() {
            let mean = drawn.iter().map(|d| d[i]).sum::<f64>() / 500.0;
            assert!(drawn.iter().all(|d| (low..=high).contains(&d[i])));
            // Five standard errors of a uniform draw's mean.
            assert!((mean - (low + high) / 2.0).abs() < 5.0 * (high - low) / 12f64.sqrt() / 500f64.sqrt());
        }
        TrainingPhysics::paper_randomised(Vec::new()).validate().unwrap();
        let upside_down = TrainingPhysics::Randomised {
            density: [2.0, 1.0],
            friction: [0.0, 1.0],
            restitution: [0.0, 1.0],
            effects: Vec::new(),
        };
        assert!(upside_down.validate().unwrap_err().to_string().contains("density"));
    }
}
