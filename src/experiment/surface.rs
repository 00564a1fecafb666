//! Computation of a performance surface: performance in related environments of policies trained at each of several latents.
//!
//! Source: Semage et al., section on partial grounding: a DQN is trained in simulations with different latents and
//! its jump-start AUCCESS measured in a related environment, one whose physics is known (damping 0.7 and 0.6 where
//! the real world has 0.8); the route [`Route::Dqn`].
//!
//! Differences from the source:
//! - The related environments have the prior means of the latents, since the real world's latents are unknown;
//!   [`SurfaceConfig::related`] accepts any values.
//! - Performance is measured on the validation tasks, so that neither training nor test tasks decide how the real
//!   world is explored.
//! - The method [`EvaluationMethod::Ideal`] omits training, which causes most of the run time and noise: a fixed sample of
//!   actions of every task is simulated once in each related environment and once at the latents. An ideal learner of the simulation
//!   attempts the actions that solve there first, then the others, in random order within both groups. Performance is the
//!   expected AUCCESS of that order (exact, by counting). It is lower than that of a real learner, which prefers solutions with
//!   many solving neighbours.
//! - A task without a sampled action that solves it in a related environment is not informative and is excluded there (ideal
//!   method).

use serde::{Deserialize, Serialize};

use super::hidden_evaluation::evaluate_in_hidden_world;
use super::progress_prefix::PrefixedProgress;
use crate::error::{Error, Result, check_range};
use crate::estimate::gp::GpHyperparameters;
use crate::estimate::surface::{
    EvaluationMethod, FORMAT, PerformanceSurface, RelatedEnvironment, SurfaceAxis, SurfacePoint, grid,
    halton_design,
};
use crate::explore::draw_placeable;
use crate::policy::auccess::{MAX_ATTEMPTS, weighted_mean};
use crate::policy::{
    EvaluateConfig, LabelConfig, Policy, RandomPolicy, TrainConfig, TrainingPhysics, label, train,
};
use crate::progress::Progress;
use crate::reality::HiddenConfig;
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{Family, LabelCounts, Placement, Scene, Split, Task, ValidAction, split};
use crate::world::{Engine, Latents, Rollout, Simulator, effect};

/// Maximum number of actions labelled for a training task, which are in memory together.
pub const MAX_LABELS: u64 = 3_000;

/// Configuration of a surface computation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceConfig {
    pub route: EvaluationMethod,
    /// Varied factors with their ranges; the other factors stay at `base`.
    pub axes: Vec<SurfaceAxis>,
    /// Values of density (kg/m^2), friction and restitution off the axes.
    pub base: [f64; 3],
    /// Number of space-filling design points.
    pub points: usize,
    /// Number of values per axis of a grid, instead of `points`.
    pub grid: Option<usize>,
    /// Environments in which performance is evaluated.
    pub related: Vec<RelatedEnvironment>,
    /// Actions sampled per task (ideal method).
    pub actions: usize,
    /// Actions labelled per training task (DQN method).
    pub labels: usize,
    /// Training configuration; its seed is replaced for each point (DQN method).
    pub train: TrainConfig,
    /// Actions ranked per validation task (DQN method).
    pub candidates: usize,
    pub engine: Engine,
    pub seed: u64,
}

impl SurfaceConfig {
    /// Default: friction and restitution over the range of the family's prior, damping 0.7 and 0.6 in the related environments.
    pub fn new(family: &Family, route: EvaluationMethod) -> Result<SurfaceConfig> {
        let base = family.prior_means();
        let axes = ["friction", "restitution"].map(|f| SurfaceAxis::from_prior(f, family.prior));
        Ok(SurfaceConfig {
            route,
            axes: axes.into_iter().collect::<Result<_>>()?,
            base,
            points: 40,
            grid: None,
            related: [0.7, 0.6]
                .map(|kept| RelatedEnvironment { latents: base, effects: vec![effect::damping(kept)] })
                .to_vec(),
            actions: family.surface_actions,
            labels: family.learning.labels.per_task.min(MAX_LABELS as usize),
            train: TrainConfig::preset(&family.learning),
            candidates: 5000,
            engine: Engine::Auto,
            seed: 0,
        })
    }

    /// Reduced configuration, used if no surface is given: the ideal method at few points. Takes a few seconds for basketball,
    /// half a minute for bowling.
    pub fn quick(family: &Family) -> Result<SurfaceConfig> {
        let config = SurfaceConfig::new(family, EvaluationMethod::Ideal)?;
        Ok(SurfaceConfig { points: 24, actions: config.actions / 2, ..config })
    }

    /// Errors name the field that is out of range.
    pub fn validate(&self) -> Result<()> {
        check_range("points", self.points as f64, 3.0, 5000.0)?;
        if let Some(side) = self.grid {
            check_range("grid", side as f64, 2.0, 50.0)?;
        }
        check_range("related", self.related.len() as f64, 1.0, 20.0)?;
        check_range("actions", self.actions as f64, 1.0, 50_000.0)?;
        check_range("labels", self.labels as f64, 1.0, MAX_LABELS as f64)?;
        check_range("candidates", self.candidates as f64, 1.0, 1e6)?;
        for (i, related) in self.related.iter().enumerate() {
            let field = format!("related[{i}]");
            Latents::of(related.latents).validate().map_err(|e| e.in_field(&field))?;
            for (k, term) in related.effects.iter().enumerate() {
                effect::resolve(term, format_args!("{field}.effects[{k}]"))?;
            }
        }
        self.train.validate().map_err(|e| e.in_field("train"))
    }

    fn design(&self) -> Vec<[f64; 3]> {
        match self.grid {
            Some(side) => grid(&self.axes, self.base, side),
            None => halton_design(&self.axes, self.base, self.points, self.seed),
        }
    }
}

/// Computes the surface of [`SurfaceConfig::quick`].
pub fn quick(family: &Family, progress: &dyn Progress) -> Result<PerformanceSurface> {
    surface(family, &SurfaceConfig::quick(family)?, progress)
}

/// Computes the surface of a family.
pub fn surface(
    family: &Family,
    config: &SurfaceConfig,
    progress: &dyn Progress,
) -> Result<PerformanceSurface> {
    config.validate()?;
    let tasks = family.tasks();
    let validation = split(&tasks, Split::Validation);
    let places = config.design();
    let named = PrefixedProgress { inner: progress, name: "performance surface".into() };
    let (points, counted) = match config.route {
        EvaluationMethod::Ideal => ideal_points(&validation, &places, config, &named)?,
        EvaluationMethod::Dqn => {
            (dqn_points(family, &validation, &places, config, progress)?, validation.len())
        }
    };
    PerformanceSurface {
        format: FORMAT.into(),
        program: env!("CARGO_PKG_VERSION").into(),
        family: family.name.into(),
        route: config.route,
        related: config.related.clone(),
        axes: config.axes.clone(),
        base: config.base,
        tasks: counted,
        points,
        surrogate: GpHyperparameters { length_scales: Vec::new(), mean: 0.0, signal: 1.0, noise: 1.0 },
        seed: config.seed,
    }
    .fit()
}

/// Scenes that are placed at a time, which bounds the memory of a computation with many actions.
const SCENES_AT_ONCE: usize = 4096;

/// The scenes of placeable actions.
fn placed(task: &Task, actions: &[ValidAction]) -> Vec<Scene> {
    let scene = |action| match task.place(action) {
        Placement::Valid(scene) => Some(*scene),
        Placement::Invalid(_) => None,
    };
    actions.iter().filter_map(scene).collect()
}

/// Points by the ideal method, and the number of tasks that are informative in at least one environment.
fn ideal_points(
    tasks: &[Task],
    places: &[[f64; 3]],
    config: &SurfaceConfig,
    progress: &dyn Progress,
) -> Result<(Vec<SurfacePoint>, usize)> {
    let mut samples: Vec<Vec<ValidAction>> = Vec::with_capacity(tasks.len());
    for task in tasks {
        let seed = rng::derive_seed(config.seed, &task.id, 0);
        let drawn = draw_placeable(
            std::slice::from_ref(task),
            config.actions,
            &mut rng::stream(seed, "surface actions"),
            progress,
        )?;
        samples.push(drawn.into_iter().map(|(_, action, _)| action).collect());
    }
    let total = (places.len() + config.related.len()) as u64;
    let mut done = 0;
    let mut solving = |latents: [f64; 3], effects: &[EffectTerm]| -> Result<Vec<Vec<bool>>> {
        let mut of_task = Vec::with_capacity(samples.len());
        for (task, actions) in tasks.iter().zip(&samples) {
            progress.report("trying actions", done, total)?;
            let mut solved = Vec::with_capacity(actions.len());
            for part in actions.chunks(SCENES_AT_ONCE) {
                let scenes = placed(task, part);
                let rollouts: Vec<Rollout> = scenes
                    .iter()
                    .map(|scene| Rollout { latents: Latents::of(latents), effects, ..Rollout::of(scene) })
                    .collect();
                solved.extend(Simulator::new(config.engine).budget(&progress).solved(&rollouts)?);
            }
            of_task.push(solved);
        }
        done += 1;
        Ok(of_task)
    };
    let truths: Vec<Vec<Vec<bool>>> =
        config.related.iter().map(|r| solving(r.latents, &r.effects)).collect::<Result<_>>()?;
    let counts = |truth: &[Vec<bool>], t: usize| truth[t].iter().any(|s| *s);
    let counted = (0..tasks.len()).filter(|t| truths.iter().any(|truth| counts(truth, *t))).count();
    if truths.iter().any(|truth| !(0..tasks.len()).any(|t| counts(truth, t))) {
        let allowed = "an environment in which a sampled action of some task solves it (or more actions)";
        return Err(Error::input("related", "nothing solves", allowed));
    }
    let mut points = Vec::with_capacity(places.len());
    for latents in places {
        let simulated = solving(*latents, &[])?;
        let of_truth = |truth: &Vec<Vec<bool>>| {
            let scores: Vec<f64> = (0..tasks.len())
                .filter(|t| counts(truth, *t))
                .map(|t| expected_auccess(&simulated[t], &truth[t]))
                .collect();
            scores.iter().sum::<f64>() / scores.len() as f64
        };
        points.push(SurfacePoint::mean(*latents, truths.iter().map(of_truth).collect()));
    }
    Ok((points, counted))
}

/// Expected AUCCESS if the actions marked by `simulated` are attempted first, in random order, then the others.
fn expected_auccess(simulated: &[bool], truth: &[bool]) -> f64 {
    let count = |mark: bool, and: bool| {
        simulated.iter().zip(truth).filter(|(s, t)| **s == mark && (**t || !and)).count()
    };
    let groups = [(count(true, false), count(true, true)), (count(false, false), count(false, true))];
    // Probability that every attempt so far failed: draws without replacement.
    let mut failed = 1.0;
    let mut curve = [0.0; MAX_ATTEMPTS];
    let mut order = groups.into_iter().flat_map(|(size, hits)| (0..size).map(move |k| (size - k, hits)));
    for solved in &mut curve {
        if let Some((left, hits)) = order.next() {
            failed *= left.saturating_sub(hits) as f64 / left as f64;
        }
        *solved = 1.0 - failed;
    }
    weighted_mean(&curve)
}

/// Points by the DQN method.
fn dqn_points(
    family: &Family,
    validation: &[Task],
    places: &[[f64; 3]],
    config: &SurfaceConfig,
    progress: &dyn Progress,
) -> Result<Vec<SurfacePoint>> {
    let evaluation = EvaluateConfig { candidates: config.candidates, ..EvaluateConfig::phyre(config.seed) };
    let training = split(&family.tasks(), Split::Train);
    let mut points = Vec::with_capacity(places.len());
    for (n, latents) in places.iter().enumerate() {
        let name = format!("performance surface: point {} of {}", n + 1, places.len());
        let named = PrefixedProgress { inner: progress, name };
        // Independent seeds per point, so that the surrogate can treat training randomness as noise.
        let seed = rng::derive_seed(config.seed, "surface", n as u64);
        let labels = LabelCounts { per_task: config.labels, ..family.learning.labels };
        let labels = LabelConfig { engine: config.engine, ..LabelConfig::preset(&labels, seed) };
        let world = TrainingPhysics::Fixed { latents: Latents::of(*latents), effects: Vec::new() };
        let data = label(&training, &world, &labels, &named)?;
        // Without solving actions in simulation there is nothing to learn, and any order is equally good.
        let policy: Box<dyn Policy> = if data.solving() == 0 {
            Box::new(RandomPolicy { seed })
        } else {
            Box::new(train(&data, &TrainConfig { seed, ..config.train.clone() }, &named)?.0)
        };
        let tried = |related: &RelatedEnvironment| {
            let world = HiddenConfig {
                latents: Latents::of(related.latents),
                effects: related.effects.clone(),
                engine: config.engine,
                noise: 0.0,
                budget: None,
                seed: 0,
            };
            Ok(evaluate_in_hidden_world(policy.as_ref(), validation, &world, &evaluation, &named)?.auccess)
        };
        points.push(SurfacePoint::mean(*latents, config.related.iter().map(tried).collect::<Result<_>>()?));
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::auccess::auccess;
    use rand::seq::SliceRandom;

    /// The exact expectation agrees with the mean over many random orders.
    #[test]
    fn expected_auccess_is_the_mean_over_orders() {
        let mut stream = rng::stream(4, "orders");
        let check = |simulated: &[bool], truth: &[bool], stream: &mut rng::Stream| {
            let mut sum = 0.0;
            let repeats = 4000;
            for _ in 0..repeats {
                let mut order: Vec<usize> = (0..truth.len()).collect();
                order.shuffle(stream);
                order.sort_by_key(|i| !simulated[*i]);
                sum += auccess(&[order.iter().position(|i| truth[*i]).map(|k| k + 1)]);
            }
            let (mean, found) = (sum / f64::from(repeats), expected_auccess(simulated, truth));
            assert!((mean - found).abs() < 0.02, "{found}, not {mean}");
        };
        let marks = |n: usize, of: &dyn Fn(usize) -> bool| (0..n).map(of).collect::<Vec<bool>>();
        for n in [5, 60, 300] {
            let truth = marks(n, &|i| i % 5 == 0);
            for simulated in [
                marks(n, &|i| i % 5 == 0),
                marks(n, &|i| i % 3 == 0),
                marks(n, &|i| i % 5 == 1),
                marks(n, &|_| false),
                marks(n, &|_| true),
            ] {
                check(&simulated, &truth, &mut stream);
            }
        }
        assert_eq!(expected_auccess(&[true, false], &[true, false]), 1.0);
        assert_eq!(expected_auccess(&[true, false], &[false, false]), 0.0);
        assert_eq!(expected_auccess(&[], &[]), 0.0);
    }
}
