//! Ways to spend a few real interactions so that plans work: what each leaves known, and what that is worth.
//!
//! The ways are those of [`super::ways`], a strategy's candidates being simulated at the belief's mean, and `acting`: the best planned
//! attempt at a training task (acting and learning in one loop).
//!
//! After the first [`FIRST`], which no posterior can be drawn of before, what is known is drawn anew after every interaction that a
//! way bases the next one on. Plans are then made for unseen tasks under what is known.

use serde::{Deserialize, Serialize};

use super::estimators::{Asked, Estimator, Told, parameters};
use super::ways::{ASKING, question};
use crate::design::{DesignConfig, Question, design, parts};
use crate::error::{Error, Result, within};
use crate::estimate::belief::PRIOR_DRAWS;
use crate::estimate::{Belief, Believed};
use crate::explore::{self, Situation};
use crate::plan::{PlanConfig, plan};
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld, Reality, Trial};
use crate::rng;
use crate::task::{Family, Placement, Task, ValidAction};
use crate::world::{Coordinates, Engine};

/// Interactions before anything can be drawn of them.
pub const FIRST: usize = 4;

/// What is spent, and how.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroundingConfig {
    /// `probing`, `success`, `acting`, or a strategy.
    pub way: String,
    /// Which estimator reads them.
    #[serde(default)]
    pub estimator: Estimator,
    /// Real interactions after which what is known is handed over; rising.
    pub checkpoints: Vec<usize>,
    /// Effects whose parameters are to be known beside the latents.
    pub set: Vec<String>,
    pub hidden: HiddenConfig,
    /// Draws of every posterior.
    pub draws: usize,
    /// Actions and rollouts of a plan of `acting`.
    pub plan: PlanConfig,
    pub seed: u64,
}

/// What is known after some interactions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Known {
    pub interactions: usize,
    /// Of them, how many solved the task that they were made in.
    pub solved: usize,
    /// Mean of every number, and standard deviation where there is one.
    pub numbers: Vec<(String, f64, Option<f64>)>,
    /// Whether the draws can be trusted.
    pub converged: bool,
    /// The draws.
    pub draws: Vec<Believed>,
}

impl GroundingConfig {
    /// 5 and 20 interactions seen with 5 mm of noise.
    pub fn standard(way: &str, hidden: HiddenConfig, set: &[String], seed: u64) -> GroundingConfig {
        let plan =
            PlanConfig { actions: 2000, rollouts: Some(15_000), exact: 1, ..PlanConfig::standard(seed) };
        GroundingConfig {
            way: way.into(),
            estimator: Estimator::default(),
            checkpoints: vec![5, 20],
            set: set.to_vec(),
            hidden: HiddenConfig { noise: 0.005, seed, ..hidden },
            draws: 512,
            plan,
            seed,
        }
    }

    /// Errors name what cannot be.
    pub fn validate(&self) -> Result<()> {
        // A strategy that needs a performance surface has none here.
        let known = explore::REGISTRY.iter().filter(|s| !s.needs_importance()).map(|s| s.name());
        let asking = ASKING.iter().map(|(name, _)| *name);
        let ways: Vec<&str> = asking.chain([ACTING]).chain(known).collect();
        if !ways.contains(&self.way.as_str()) {
            let allowed = format!("one of {}", ways.join(", "));
            return Err(Error::input("way", format!("{:?}", self.way), allowed));
        }
        if !self.estimator.draws() && BY_DRAWS.contains(&self.way.as_str()) {
            let allowed =
                format!("another way, or an estimator that draws: {} is a point", self.estimator.name());
            return Err(Error::input("way", format!("{:?}", self.way), allowed));
        }
        if self.checkpoints.is_empty() || !self.checkpoints.is_sorted_by(|a, b| a < b) {
            return Err(Error::input("checkpoints", format!("{:?}", self.checkpoints), "rising numbers"));
        }
        for (i, checkpoint) in self.checkpoints.iter().enumerate() {
            within(&format!("checkpoints[{i}]"), *checkpoint as f64, FIRST as f64, 1000.0)?;
        }
        within("draws", self.draws as f64, 64.0, 100_000.0)?;
        self.plan.validate().map_err(|e| e.under("plan"))
    }
}

/// The way that is of plans.
const ACTING: &str = "acting";

/// Ways that go by how sure numbers are.
const BY_DRAWS: [&str; 3] = ["probing", "success", "informative"];

/// Spends interactions on a family's training tasks; what is known at every checkpoint.
pub fn ground(family: &Family, config: &GroundingConfig, progress: &dyn Progress) -> Result<Vec<Known>> {
    config.validate()?;
    let tasks = family.tasks();
    let (training, asked) = parts(&tasks);
    if training.is_empty() {
        let allowed = "a family with certified tasks";
        return Err(Error::input("task", format!("{:?}", family.name), allowed));
    }
    let mut spent = Spent { family, config, training, asked, trials: Vec::new(), solved: 0 };
    let mut world = HiddenWorld::new(config.hidden.clone())?;
    let mut belief =
        Belief::of_sets(family.prior, std::slice::from_ref(&config.set), PRIOR_DRAWS, config.seed)?;
    let mut found = Vec::new();
    // What is known matters to a way only if it looks at it.
    let blind = config.way == "random";
    for checkpoint in &config.checkpoints {
        while spent.trials.len() < *checkpoint {
            let room = checkpoint - spent.trials.len();
            let count = if blind {
                room
            } else if spent.trials.len() < FIRST {
                FIRST
            } else {
                1
            };
            let chosen = spent.choose(&belief, count.min(room), progress)?;
            if chosen.is_empty() {
                let why = format!("no action of {} was found that can be placed", family.name);
                return Err(Error::Failed(why));
            }
            for (task, action) in chosen {
                spent.measure(&mut world, task, action)?;
            }
            if !blind && (FIRST..*checkpoint).contains(&spent.trials.len()) {
                belief = spent.known(progress)?.1;
            }
        }
        let (known, drawn) = spent.known(progress)?;
        belief = drawn;
        found.push(known);
    }
    Ok(found)
}

/// A grounding under way.
struct Spent<'a> {
    family: &'a Family,
    config: &'a GroundingConfig,
    training: Vec<Task>,
    /// Tasks whose success is asked about.
    asked: Vec<Task>,
    trials: Vec<Trial>,
    solved: usize,
}

impl Spent<'_> {
    /// The next actions, each with the number of its task.
    fn choose(
        &self,
        belief: &Belief,
        count: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<(usize, ValidAction)>> {
        let seed = rng::derive(self.config.seed, "grounding", self.trials.len() as u64);
        let way = self.config.way.as_str();
        if way == ACTING {
            return self.attempts(belief, count, progress);
        }
        match question(way)? {
            Some(question) => self.designed(question, belief, count, seed, progress),
            None => self.ranked(way, belief, count, seed, progress),
        }
    }

    fn designed(
        &self,
        question: Question,
        belief: &Belief,
        count: usize,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<Vec<(usize, ValidAction)>> {
        let usual = DesignConfig::standard(question, seed);
        let config = DesignConfig { batch: count, noise: self.config.hidden.noise.max(1e-6), ..usual };
        let found = design(&self.training, &self.asked, belief, &config, progress)?;
        let number = |id: &str| self.training.iter().position(|t| t.id == id);
        let batch = found.experiments.into_iter().take(found.batch);
        Ok(batch.filter_map(|e| Some((number(&e.task)?, e.action))).collect())
    }

    /// The best planned attempt at each of the next training tasks.
    fn attempts(
        &self,
        belief: &Belief,
        count: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<(usize, ValidAction)>> {
        let first = self.trials.len();
        let mut chosen = Vec::with_capacity(count);
        for k in first..first + count {
            // The golden ratio walks over tasks without coming back soon.
            let task = (k as f64 * 0.618_033_988_75).fract() * self.training.len() as f64;
            let task = task as usize;
            let setup = PlanConfig {
                seed: rng::derive(self.config.seed, "attempt", k as u64),
                ..self.config.plan.clone()
            };
            let found = plan(&self.training[task], belief, &setup, &crate::budget::Endless, progress)?;
            chosen.extend(found.ranked.into_iter().next().map(|r| (task, r.action)));
        }
        Ok(chosen)
    }

    /// As a strategy ranks candidates on the simulation at the belief's mean.
    fn ranked(
        &self,
        strategy: &str,
        belief: &Belief,
        count: usize,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<Vec<(usize, ValidAction)>> {
        let parameters = parameters(&self.config.set)?;
        let coordinates = Coordinates::new(&parameters);
        let of = |world: &Believed, i: usize| world.number(&coordinates.name(i)).unwrap_or(0.0);
        let spread = |draws: &[Believed]| -> (Vec<f64>, Vec<f64>) {
            (0..coordinates.len())
                .map(|i| moments(&draws.iter().map(|d| of(d, i)).collect::<Vec<_>>()))
                .unzip()
        };
        let (estimate, deviations) = spread(belief.draws());
        let prior = Belief::of_sets(
            self.family.prior,
            std::slice::from_ref(&self.config.set),
            PRIOR_DRAWS,
            self.config.seed,
        )?;
        let (_, before) = spread(prior.draws());
        let world = explore::World {
            latents: coordinates.latents(&estimate),
            effects: coordinates.effects(&estimate, &[]),
            engine: Engine::Auto,
        };
        let mut stream = rng::stream(seed, "grounding candidates");
        let candidates = explore::candidates(&self.training, 400, &world, &mut stream, progress)?;
        let situation = Situation {
            tasks: &self.training,
            candidates: &candidates,
            world: &world,
            coordinates: &coordinates,
            estimate: &estimate,
            spread: &deviations,
            prior: &before,
            trials: &self.trials,
            importance: None,
            progress,
        };
        let chosen = explore::strategy(strategy)?.choose(&situation, count)?;
        let of = |i: &usize| (candidates[*i].task, candidates[*i].action.clone());
        Ok(chosen.indices.iter().map(of).collect())
    }

    fn measure(&mut self, world: &mut HiddenWorld, task: usize, action: ValidAction) -> Result<()> {
        let task = &self.training[task];
        if !matches!(task.place(&action), Placement::Valid(_)) {
            return Err(Error::Failed(format!("an action chosen for {} cannot be placed", task.id)));
        }
        for attempt in world.measure(task, &[action])? {
            self.solved += usize::from(attempt.trajectory.as_ref().is_some_and(|t| t.solved()));
            self.trials.extend(attempt.into_trial(format!("{}/{}", task.id, self.trials.len())));
        }
        Ok(())
    }

    /// What the trials so far say.
    fn known(&self, progress: &dyn Progress) -> Result<(Known, Belief)> {
        let asked = Asked {
            prior: self.family.prior,
            base: &self.training[0].scene,
            set: &self.config.set,
            engine: Engine::Auto,
            draws: self.config.draws,
            noise: self.config.hidden.noise,
            seed: self.config.seed,
        };
        let Told { numbers, converged, draws } = asked.told(self.config.estimator, &self.trials, progress)?;
        let belief = Belief::of_draws(draws)?;
        let known = Known {
            interactions: self.trials.len(),
            solved: self.solved,
            numbers,
            converged,
            draws: belief.draws().to_vec(),
        };
        Ok((known, belief))
    }
}

/// Mean and standard deviation.
pub(super) fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use crate::reality::standard;
    use crate::task::family;

    fn small(way: &str) -> GroundingConfig {
        let family = family("basketball").unwrap();
        let set = ["linear_drag".to_string()];
        let usual = GroundingConfig::standard(way, standard(family), &set, 3);
        let plan = PlanConfig { actions: 200, draws: 8, rollouts: Some(1000), ..usual.plan };
        GroundingConfig { checkpoints: vec![FIRST], draws: 64, plan, ..usual }
    }

    /// Whatever way four interactions are spent, the drag that is there is found, and the same is found again.
    #[test]
    fn four_interactions_tell_the_drag() {
        let family = family("basketball").unwrap();
        for way in ["random", "acting", "informative"] {
            let found = ground(family, &small(way), &Silent).unwrap();
            let [known] = found.as_slice() else { panic!("{found:?}") };
            assert_eq!((known.interactions, known.draws.len()), (FIRST, 64), "{way}");
            let (_, mean, sd) = known.numbers.iter().find(|n| n.0 == "linear_drag.c").unwrap();
            let truth = -libm::log(0.8);
            assert!((mean - truth).abs() < 0.02 && sd.unwrap() < 0.02, "{way}: {mean} +- {sd:?}");
        }
        let again = |way| ground(family, &small(way), &Silent).unwrap();
        assert_eq!(again("random"), again("random"));
    }

    #[test]
    fn what_cannot_be_spent_is_refused_by_name() {
        let refused = |config: GroundingConfig, name: &str| {
            let error = config.validate().unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        };
        refused(small("praying"), "praying");
        refused(small("gradient"), "way");
        refused(GroundingConfig { checkpoints: vec![3], ..small("random") }, "checkpoints[0]");
        refused(GroundingConfig { checkpoints: vec![20, 5], ..small("random") }, "checkpoints");
        refused(GroundingConfig { checkpoints: vec![5, 5], ..small("random") }, "checkpoints");
        refused(GroundingConfig { draws: 1, ..small("random") }, "draws");
        refused(GroundingConfig { estimator: Estimator::Iplw, ..small("success") }, "iplw");
        assert!(GroundingConfig { estimator: Estimator::Tunenet, ..small("acting") }.validate().is_ok());
    }
}
