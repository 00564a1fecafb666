//! Grounding with a few real interactions: estimates after each checkpoint, for comparing the success of the plans they support.
//!
//! The data-collection methods are those of [`super::acquisition`], with a strategy's candidates simulated at the posterior mean, and
//! `acting`: the best planned attempt at a training task (acting and learning in one loop).
//!
//! A posterior needs at least [`MIN_INTERACTIONS`]. After those, it is sampled again after every interaction if the method uses it to
//! choose the next one. Plans for unseen tasks are then made under the posterior.

use serde::{Deserialize, Serialize};

use super::acquisition::{DESIGN_METHODS, question};
use super::estimators::{Estimator, EstimatorInput, EstimatorOutput, parameters};
use crate::design::{DesignConfig, Question, design, training_and_test_tasks};
use crate::error::{Error, Result, check_range};
use crate::estimate::{ParameterSample, ParameterSamples};
use crate::explore::{self, AcquisitionContext};
use crate::plan::{PlanConfig, plan};
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld, Reality, Trial};
use crate::rng;
use crate::task::{Family, Placement, Task, ValidAction};
use crate::world::{Engine, ParameterSpace};

/// Minimum number of interactions for a posterior.
pub const MIN_INTERACTIONS: usize = 4;

/// Configuration of a grounding run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroundingConfig {
    /// Data-collection method: `probing`, `success`, `acting`, or a strategy.
    pub way: String,
    /// Estimator of the latents.
    #[serde(default)]
    pub estimator: Estimator,
    /// Numbers of real interactions after which an estimate is reported, in increasing order.
    pub checkpoints: Vec<usize>,
    /// Effects whose parameters are estimated in addition to the latents.
    pub set: Vec<String>,
    pub hidden: HiddenConfig,
    /// Number of draws of every posterior.
    pub draws: usize,
    /// Planner configuration of the method `acting`.
    pub plan: PlanConfig,
    pub seed: u64,
}

/// Estimate after some interactions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroundingCheckpoint {
    pub interactions: usize,
    /// Number of interactions that solved their task.
    pub solved: usize,
    /// Name, mean and, if available, standard deviation of every parameter.
    pub numbers: Vec<(String, f64, Option<f64>)>,
    /// Whether the sampler converged.
    pub converged: bool,
    /// Posterior draws.
    pub draws: Vec<ParameterSample>,
}

impl GroundingConfig {
    /// Standard preset: 5 and 20 interactions, 5 mm of measurement noise.
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

    /// Errors name the invalid field.
    pub fn validate(&self) -> Result<()> {
        // No performance surface is available here.
        let known = explore::REGISTRY.iter().filter(|s| !s.needs_importance()).map(|s| s.name());
        let asking = DESIGN_METHODS.iter().map(|(name, _)| *name);
        let ways: Vec<&str> = asking.chain([BEST_PLAN]).chain(known).collect();
        if !ways.contains(&self.way.as_str()) {
            let allowed = format!("one of {}", ways.join(", "));
            return Err(Error::input("way", format!("{:?}", self.way), allowed));
        }
        if !self.estimator.draws() && POSTERIOR_METHODS.contains(&self.way.as_str()) {
            let allowed = format!(
                "another method, or an estimator with posterior draws; {} gives a point estimate",
                self.estimator.name()
            );
            return Err(Error::input("way", format!("{:?}", self.way), allowed));
        }
        if self.checkpoints.is_empty() || !self.checkpoints.is_sorted_by(|a, b| a < b) {
            return Err(Error::input("checkpoints", format!("{:?}", self.checkpoints), "increasing numbers"));
        }
        for (i, checkpoint) in self.checkpoints.iter().enumerate() {
            check_range(&format!("checkpoints[{i}]"), *checkpoint as f64, MIN_INTERACTIONS as f64, 1000.0)?;
        }
        check_range("draws", self.draws as f64, 64.0, 100_000.0)?;
        self.plan.validate().map_err(|e| e.in_field("plan"))
    }
}

/// Name of the method that acts on plans.
const BEST_PLAN: &str = "acting";

/// Methods that use the posterior's spread.
const POSTERIOR_METHODS: [&str; 3] = ["probing", "success", "informative"];

/// Runs a data-collection method on a family's training tasks and reports an estimate at every checkpoint.
pub fn ground(
    family: &Family,
    config: &GroundingConfig,
    progress: &dyn Progress,
) -> Result<Vec<GroundingCheckpoint>> {
    config.validate()?;
    let tasks = family.tasks();
    let (training, asked) = training_and_test_tasks(&tasks);
    if training.is_empty() {
        let allowed = "a family with certified tasks";
        return Err(Error::input("task", format!("{:?}", family.name), allowed));
    }
    let mut spent = GroundingRun { family, config, training, asked, trials: Vec::new(), solved: 0 };
    let mut world = HiddenWorld::new(config.hidden.clone())?;
    let mut belief =
        ParameterSamples::standard_prior(family.prior, std::slice::from_ref(&config.set), config.seed)?;
    let mut found = Vec::new();
    // Random selection does not use the posterior.
    let blind = config.way == "random";
    for checkpoint in &config.checkpoints {
        while spent.trials.len() < *checkpoint {
            let room = checkpoint - spent.trials.len();
            let count = if blind {
                room
            } else if spent.trials.len() < MIN_INTERACTIONS {
                MIN_INTERACTIONS
            } else {
                1
            };
            let chosen = spent.choose(&belief, count.min(room), progress)?;
            if chosen.is_empty() {
                let why = format!("found no placeable action for {}", family.name);
                return Err(Error::Failed(why));
            }
            for (task, action) in chosen {
                spent.measure(&mut world, task, action)?;
            }
            if !blind && (MIN_INTERACTIONS..*checkpoint).contains(&spent.trials.len()) {
                belief = spent.checkpoint(progress)?.1;
            }
        }
        let (known, drawn) = spent.checkpoint(progress)?;
        belief = drawn;
        found.push(known);
    }
    Ok(found)
}

/// State of a grounding run.
struct GroundingRun<'a> {
    family: &'a Family,
    config: &'a GroundingConfig,
    training: Vec<Task>,
    /// Tasks whose success the design should predict.
    asked: Vec<Task>,
    trials: Vec<Trial>,
    solved: usize,
}

impl GroundingRun<'_> {
    /// The next actions, each with the index of its task.
    fn choose(
        &self,
        belief: &ParameterSamples,
        count: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<(usize, ValidAction)>> {
        let seed = rng::derive_seed(self.config.seed, "grounding", self.trials.len() as u64);
        let way = self.config.way.as_str();
        if way == BEST_PLAN {
            return self.plan_attempts(belief, count, progress);
        }
        match question(way)? {
            Some(question) => self.design_batch(question, belief, count, seed, progress),
            None => self.rank_candidates(way, belief, count, seed, progress),
        }
    }

    fn design_batch(
        &self,
        question: Question,
        belief: &ParameterSamples,
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
    fn plan_attempts(
        &self,
        belief: &ParameterSamples,
        count: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<(usize, ValidAction)>> {
        let first = self.trials.len();
        let mut chosen = Vec::with_capacity(count);
        for k in first..first + count {
            // Golden-ratio sequence: spreads the attempts evenly over tasks.
            let task = (k as f64 * 0.618_033_988_75).fract() * self.training.len() as f64;
            let task = task as usize;
            let setup = PlanConfig {
                seed: rng::derive_seed(self.config.seed, "attempt", k as u64),
                ..self.config.plan.clone()
            };
            let found = plan(&self.training[task], belief, &setup, &crate::budget::Unlimited, progress)?;
            chosen.extend(found.ranked.into_iter().next().map(|r| (task, r.action)));
        }
        Ok(chosen)
    }

    /// Selects candidates by a strategy in the simulation at the posterior mean.
    fn rank_candidates(
        &self,
        strategy: &str,
        belief: &ParameterSamples,
        count: usize,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<Vec<(usize, ValidAction)>> {
        let parameters = parameters(&self.config.set)?;
        let coordinates = ParameterSpace::new(&parameters);
        let of = |world: &ParameterSample, i: usize| world.value(&coordinates.name(i)).unwrap_or(0.0);
        let spread = |draws: &[ParameterSample]| -> (Vec<f64>, Vec<f64>) {
            (0..coordinates.len())
                .map(|i| mean_and_sd(&draws.iter().map(|d| of(d, i)).collect::<Vec<_>>()))
                .unzip()
        };
        let (estimate, deviations) = spread(belief.draws());
        let prior = ParameterSamples::standard_prior(
            self.family.prior,
            std::slice::from_ref(&self.config.set),
            self.config.seed,
        )?;
        let (_, before) = spread(prior.draws());
        let world = explore::CandidateSimulation {
            latents: coordinates.latents(&estimate),
            effects: coordinates.effects(&estimate, &[]),
            engine: Engine::Auto,
        };
        let mut stream = rng::stream(seed, "grounding candidates");
        let candidates = explore::simulate_candidates(&self.training, 400, &world, &mut stream, progress)?;
        let situation = AcquisitionContext {
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
        let chosen = explore::strategy(strategy)?.select(&situation, count)?;
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

    /// Estimate from the trials so far.
    fn checkpoint(&self, progress: &dyn Progress) -> Result<(GroundingCheckpoint, ParameterSamples)> {
        let asked = EstimatorInput {
            prior: self.family.prior,
            base: &self.training[0].scene,
            set: &self.config.set,
            engine: Engine::Auto,
            draws: self.config.draws,
            noise: self.config.hidden.noise,
            seed: self.config.seed,
        };
        let EstimatorOutput { numbers, converged, draws } =
            asked.estimate(self.config.estimator, &self.trials, progress)?;
        let belief = ParameterSamples::from_draws(draws)?;
        let known = GroundingCheckpoint {
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
pub(super) fn mean_and_sd(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::NoProgress;
    use crate::reality::standard;
    use crate::task::family;

    fn small(way: &str) -> GroundingConfig {
        let family = family("basketball").unwrap();
        let set = ["linear_drag".to_string()];
        let usual = GroundingConfig::standard(way, standard(family), &set, 3);
        let plan = PlanConfig { actions: 200, draws: 8, rollouts: Some(1000), ..usual.plan };
        GroundingConfig { checkpoints: vec![MIN_INTERACTIONS], draws: 64, plan, ..usual }
    }

    /// Four interactions recover the drag for every method, and the result is deterministic.
    #[test]
    fn four_interactions_recover_drag() {
        let family = family("basketball").unwrap();
        for way in ["random", "acting", "informative"] {
            let found = ground(family, &small(way), &NoProgress).unwrap();
            let [known] = found.as_slice() else { panic!("{found:?}") };
            assert_eq!((known.interactions, known.draws.len()), (MIN_INTERACTIONS, 64), "{way}");
            let (_, mean, sd) = known.numbers.iter().find(|n| n.0 == "linear_drag.c").unwrap();
            let truth = -libm::log(0.8);
            assert!((mean - truth).abs() < 0.02 && sd.unwrap() < 0.02, "{way}: {mean} +- {sd:?}");
        }
        let again = |way| ground(family, &small(way), &NoProgress).unwrap();
        assert_eq!(again("random"), again("random"));
    }

    #[test]
    fn rejects_invalid_configuration() {
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
