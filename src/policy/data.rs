//! Labelled actions: which random actions solve which tasks in a simulated world.
//!
//! Source: Semage et al., pretraining in simulation; PHYRE's DQN learns from random actions likewise.
//! Differences from the source: labels come from valid discrete actions only (an action that cannot be placed
//! is never an attempt), and a task with few solving actions is drawn from further, up to a bound.

use rand::RngExt;
use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::estimate::{Belief, Believed};
use crate::progress::Progress;
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{Labels, Placement, Scene, Task, ValidAction};
use crate::world::{Engine, Latents, Rollout, effect, simulate_map};

/// Tasks and labelled actions on them.
#[derive(Clone, Debug, Default)]
pub struct Dataset {
    pub tasks: Vec<Task>,
    pub rows: Vec<Example>,
}

/// Labelled actions that a policy learns from, wherever they are kept.
pub trait Labelled: Sync {
    /// The tasks that they are of.
    fn tasks(&self) -> &[Task];

    /// Errors if they are none.
    fn validate(&self) -> Result<()>;

    /// (solving, failing) row numbers of each task.
    fn pools(&self) -> Vec<[Vec<usize>; 2]>;

    /// Number of its task, and the action, of a row.
    fn row(&self, row: usize) -> (usize, &ValidAction);
}

/// One action's outcome.
#[derive(Clone, Debug, PartialEq)]
pub struct Example {
    /// Index into the dataset's tasks.
    pub task: usize,
    pub action: ValidAction,
    /// Whether it solved the task.
    pub solved: bool,
}

/// The physics that labels come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Training {
    /// One world: an estimate, or the truth for an oracle.
    Fixed { latents: Latents, effects: Vec<EffectTerm> },
    /// Domain randomisation: every rollout draws its latents uniformly from these `[low, high]`.
    Randomised { density: [f64; 2], friction: [f64; 2], restitution: [f64; 2], effects: Vec<EffectTerm> },
    /// What is known: every rollout is in one of these equally likely worlds, the draws of a posterior. An action that solves in
    /// half of them is labelled as solving half the time, so the policy learns how likely it is to work.
    Believed { draws: Vec<Believed> },
}

/// How many actions are labelled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelConfig {
    /// Valid actions labelled for each task, at least (fewer only if it has no more).
    pub per_task: usize,
    /// A task with fewer solving actions than this gets further ones...
    pub enough_solving: usize,
    /// ... until it has this many actions.
    pub most_per_task: usize,
    pub engine: Engine,
    pub seed: u64,
}

/// Rollouts between two reports of progress.
const CHUNK: usize = 1024;

/// Draws random valid discrete actions of each task and simulates them. The result depends on the seed and
/// neither on the number of threads nor on the order of the tasks in `tasks`.
pub fn label(
    tasks: &[Task],
    training: &Training,
    config: &LabelConfig,
    progress: &dyn Progress,
) -> Result<Dataset> {
    training.validate()?;
    let mut draws: Vec<Draw> = tasks.iter().map(|task| Draw::new(task, config.seed)).collect();
    let mut found: Vec<Vec<(ValidAction, bool)>> = vec![Vec::new(); tasks.len()];
    let mut round = vec![config.per_task; tasks.len()];
    let (mut done, mut total) = (0u64, (config.per_task * tasks.len()) as u64);
    loop {
        let mut jobs: Vec<Job<'_>> = Vec::new();
        for (t, draw) in draws.iter_mut().enumerate() {
            jobs.extend(draw.take(t, round[t], training)?);
        }
        if jobs.is_empty() {
            break;
        }
        for chunk in jobs.chunks(CHUNK) {
            progress.report("label", done, total)?;
            for (job, solved) in chunk.iter().zip(simulate(chunk, config.engine)?) {
                found[job.task].push((job.action.clone(), solved));
            }
            done += chunk.len() as u64;
        }
        for (t, rows) in found.iter().enumerate() {
            let solving = rows.iter().filter(|(_, solved)| *solved).count();
            let short = solving < config.enough_solving && !draws[t].exhausted();
            let more = if short { config.most_per_task.saturating_sub(rows.len()) } else { 0 };
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

impl Training {
    /// Domain randomisation over the paper's ranges: mass [0.1, 20], friction [0, 3], restitution [0, 1].
    /// `effects` beyond a scene's own are the same in every rollout.
    pub fn paper_randomised(effects: Vec<EffectTerm>) -> Training {
        Training::Randomised { density: [0.1, 20.0], friction: [0.0, 3.0], restitution: [0.0, 1.0], effects }
    }

    /// In the worlds of a belief.
    pub fn believed(belief: &Belief) -> Training {
        Training::Believed { draws: belief.draws().to_vec() }
    }

    /// Its kind, as it stands in JSON.
    pub fn name(&self) -> &'static str {
        match self {
            Training::Fixed { .. } => "fixed",
            Training::Randomised { .. } => "randomised",
            Training::Believed { .. } => "believed",
        }
    }

    /// `count` worlds that labels may come from, for looking at what was learned; fewer where there are no more.
    pub fn worlds(&self, count: usize, seed: u64) -> Vec<Believed> {
        let mut rng = rng::stream(seed, "training worlds");
        let drawn = |(latents, effects): (Latents, &[EffectTerm])| Believed::new(latents, effects.to_vec());
        match self {
            Training::Fixed { .. } => vec![drawn(self.draw(&mut rng))],
            Training::Randomised { .. } => (0..count).map(|_| drawn(self.draw(&mut rng))).collect(),
            Training::Believed { draws } => {
                let mut order: Vec<&Believed> = draws.iter().collect();
                let (some, _) = order.partial_shuffle(&mut rng, count);
                some.iter().map(|world| (*world).clone()).collect()
            }
        }
    }

    /// Errors unless all values are allowed.
    pub fn validate(&self) -> Result<()> {
        match self {
            Training::Fixed { latents, effects } => latents.validate().and(effect::check(effects)),
            Training::Believed { draws } => validate_draws(draws),
            Training::Randomised { density, friction, restitution, effects } => {
                effect::check(effects)?;
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

    /// The world of one rollout: latents, and effects beyond a scene's own.
    fn draw(&self, rng: &mut rng::Stream) -> (Latents, &[EffectTerm]) {
        match self {
            Training::Fixed { latents, effects } => (*latents, effects),
            Training::Randomised { density, friction, restitution, effects } => {
                let drawn = [density, friction, restitution].map(|[low, high]| {
                    let share: f64 = rng.random();
                    low + share * (high - low)
                });
                (Latents::of(drawn), effects)
            }
            Training::Believed { draws } => {
                let world = &draws[rng.random_range(0..draws.len())];
                (world.latents, &world.effects)
            }
        }
    }
}

/// Errors unless there is a draw, and every one is a world.
fn validate_draws(draws: &[Believed]) -> Result<()> {
    if draws.is_empty() {
        return Err(Error::input("draws", "none", "at least one world"));
    }
    for (i, world) in draws.iter().enumerate() {
        let valid = world.validate();
        valid.map_err(|e| e.under(&format!("draws[{i}]")))?;
    }
    Ok(())
}

impl LabelConfig {
    /// A family's preset.
    pub fn preset(labels: &Labels, seed: u64) -> LabelConfig {
        let Labels { per_task, enough_solving, stretch } = *labels;
        let most_per_task = stretch * per_task;
        LabelConfig { per_task, enough_solving, most_per_task, engine: Engine::Auto, seed }
    }
}

impl Dataset {
    /// Number of solving examples.
    pub fn solving(&self) -> usize {
        self.rows.iter().filter(|r| r.solved).count()
    }
}

impl Labelled for Dataset {
    fn tasks(&self) -> &[Task] {
        &self.tasks
    }

    /// Errors unless every example's task exists.
    fn validate(&self) -> Result<()> {
        for (i, row) in self.rows.iter().enumerate() {
            let Some(task) = self.tasks.get(row.task) else {
                let allowed = format!("an index below {}", self.tasks.len());
                return Err(Error::input(format!("rows[{i}].task"), row.task, allowed));
            };
            task.actions().validate(row.action.values()).map_err(|e| e.under(&format!("rows[{i}]")))?;
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

/// A placed action to be simulated.
struct Job<'a> {
    task: usize,
    action: ValidAction,
    scene: Box<Scene>,
    latents: Latents,
    effects: &'a [EffectTerm],
}

fn simulate(jobs: &[Job], engine: Engine) -> Result<Vec<bool>> {
    let of = |j| {
        let Job { scene, latents, effects, .. }: &Job = j;
        Rollout { latents: *latents, effects, ..Rollout::of(scene) }
    };
    let rollouts: Vec<Rollout> = jobs.iter().map(of).collect();
    simulate_map(&rollouts, engine, |_, trajectory| trajectory.solved())
}

/// A task's discrete actions in random order.
struct Draw<'a> {
    task: &'a Task,
    order: Vec<u32>,
    next: usize,
    worlds: rng::Stream,
}

impl<'a> Draw<'a> {
    fn new(task: &'a Task, seed: u64) -> Draw<'a> {
        let own = rng::derive(seed, &task.id, 0);
        // At most a million: checked with the scene.
        let mut order: Vec<u32> = (0..task.actions().count() as u32).collect();
        order.shuffle(&mut rng::stream(own, "label actions"));
        Draw { task, order, next: 0, worlds: rng::stream(own, "label latents") }
    }

    fn exhausted(&self) -> bool {
        self.next >= self.order.len()
    }

    /// The next `count` valid actions.
    fn take<'t>(&mut self, task: usize, count: usize, training: &'t Training) -> Result<Vec<Job<'t>>> {
        let mut jobs = Vec::new();
        while jobs.len() < count && !self.exhausted() {
            let action = self.task.actions().at(self.order[self.next] as usize)?;
            self.next += 1;
            if let Placement::Valid(scene) = self.task.place(&action) {
                let (latents, effects) = training.draw(&mut self.worlds);
                jobs.push(Job { task, action, scene, latents, effects });
            }
        }
        Ok(jobs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;
    use crate::progress::Silent;
    use crate::task::scene::Goal;

    /// Red falls freely and solves if it does so within a column, which is decided by its x alone.
    fn column(id: &str, [left, right]: [f64; 2]) -> Task {
        let mut task = toy::task(0.3);
        task.id = id.into();
        task.scene.steps = 5;
        let region = vec![[left, -99.0], [right, -99.0], [right, 99.0], [left, 99.0]];
        task.scene.goal = Some(Goal::Inside { body: "red".into(), region, hold_s: 0.0, stop: None });
        task
    }

    fn config(per_task: usize) -> LabelConfig {
        LabelConfig::preset(&Labels { per_task, enough_solving: 0, stretch: 1 }, 0)
    }

    fn plain() -> Training {
        Training::Fixed { latents: Latents::default(), effects: Vec::new() }
    }

    #[test]
    fn labels_are_what_the_world_does() {
        let tasks = [column("a", [2.0, 5.0]), column("b", [7.0, 7.5])];
        let data = label(&tasks, &plain(), &config(60), &Silent).unwrap();
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
        assert_eq!(distinct.len(), 120, "no action twice");
    }

    #[test]
    fn rare_successes_are_searched_longer_up_to_the_bound() {
        let tasks = [column("rare", [7.0, 7.2]), column("never", [90.0, 91.0]), column("often", [1.0, 9.0])];
        let config = LabelConfig { enough_solving: 5, most_per_task: 700, ..config(50) };
        let data = label(&tasks, &plain(), &config, &Silent).unwrap();
        let count = |t: usize| data.rows.iter().filter(|r| r.task == t).count();
        let solving = |t: usize| data.rows.iter().filter(|r| r.task == t && r.solved).count();
        assert!(solving(0) >= 5 && count(0) > 50 && count(0) < 700, "{} of {}", solving(0), count(0));
        assert_eq!((count(1), count(2)), (700, 50));
    }

    #[test]
    fn same_labels_for_any_number_of_threads_and_order_of_tasks() {
        let tasks = [column("a", [2.0, 5.0]), column("b", [4.0, 8.0])];
        let run = |tasks: &[Task], threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                label(tasks, &Training::paper_randomised(Vec::new()), &config(30), &Silent).unwrap().rows
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

    /// Red is dropped and solves if it falls below a height within a second: drag decides.
    fn falling() -> Task {
        let mut task = toy::task(0.3);
        task.id = "falling".into();
        task.scene.steps = 240;
        let region = vec![[-99.0, -99.0], [99.0, -99.0], [99.0, 4.0], [-99.0, 4.0]];
        task.scene.goal = Some(Goal::Inside { body: "red".into(), region, hold_s: 0.0, stop: None });
        task
    }

    fn dragged(c: f64) -> Believed {
        Believed::new(Latents::default(), vec![effect::linear_drag(c)])
    }

    fn labelled(training: &Training) -> Vec<Example> {
        label(&[falling(), column("a", [2.0, 5.0])], training, &config(150), &Silent).unwrap().rows
    }

    #[test]
    fn one_believed_world_gives_the_labels_of_the_point() {
        let Believed { latents, effects, .. } = dragged(2.0);
        let belief = Belief::point(latents, effects.clone()).unwrap();
        let point = labelled(&Training::Fixed { latents, effects });
        assert_eq!(labelled(&Training::believed(&belief)), point);
        // Many draws of it as well: which is taken changes no action.
        assert_eq!(labelled(&Training::Believed { draws: vec![dragged(2.0); 9] }), point);
    }

    #[test]
    fn each_label_is_of_one_of_the_believed_worlds_and_all_have_some() {
        let of = |draws: Vec<Believed>| labelled(&Training::Believed { draws });
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
    fn draws_that_are_no_worlds_are_refused_by_name() {
        let refused = |draws: Vec<Believed>, wanted: &str| {
            let error = Training::Believed { draws }.validate().unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        };
        refused(Vec::new(), "draws");
        let heavy = Believed::new(Latents { friction: Some(-1.0), ..Latents::default() }, Vec::new());
        refused(vec![dragged(0.0), heavy], "draws[1]");
        refused(vec![dragged(f64::NAN)], "draws[0]");
    }

    #[test]
    fn worlds_to_look_in_are_drawn_as_labels_are() {
        let count = |training: &Training| training.worlds(4, 1).len();
        assert_eq!((count(&plain()), count(&Training::paper_randomised(Vec::new()))), (1, 4));
        let draws: Vec<Believed> = (0..6).map(|c| dragged(f64::from(c))).collect();
        let some = Training::Believed { draws: draws.clone() }.worlds(4, 1);
        assert!(some.len() == 4 && some.iter().all(|w| draws.contains(w)));
        assert!((1..4).all(|i| !some[..i].contains(&some[i])), "none twice");
        assert_eq!(Training::Believed { draws: draws[..2].to_vec() }.worlds(4, 1).len(), 2);
    }

    #[test]
    fn randomised_latents_stay_within_and_fill_their_ranges() {
        let mut rng = rng::stream(1, "test");
        let drawn: Vec<[f64; 3]> = (0..500)
            .map(|_| Training::paper_randomised(Vec::new()).draw(&mut rng).0.values().map(|v| v.unwrap()))
            .collect();
        for (i, [low, high]) in [[0.1, 20.0], [0.0, 3.0], [0.0, 1.0]].into_iter().enumerate() {
            let mean = drawn.iter().map(|d| d[i]).sum::<f64>() / 500.0;
            assert!(drawn.iter().all(|d| (low..=high).contains(&d[i])));
            // Five standard errors of a uniform draw's mean.
            assert!((mean - (low + high) / 2.0).abs() < 5.0 * (high - low) / 12f64.sqrt() / 500f64.sqrt());
        }
        Training::paper_randomised(Vec::new()).validate().unwrap();
        let upside_down = Training::Randomised {
            density: [2.0, 1.0],
            friction: [0.0, 1.0],
            restitution: [0.0, 1.0],
            effects: Vec::new(),
        };
        assert!(upside_down.validate().unwrap_err().to_string().contains("density"));
    }
}
