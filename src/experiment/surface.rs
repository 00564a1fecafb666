//! Finding a performance surface: what is learned at each of some latents, tried in related environments.
//!
//! Source: Semage et al., section on partial grounding: a DQN is trained in simulations with different latents and
//! its jump-start AUCCESS measured in a related environment, one whose physics is known (damping 0.7 and 0.6 where
//! the real world has 0.8); the route [`Route::Dqn`].
//!
//! Differences from the source:
//! - The related environments have the latents that the family's prior believes in most, since those of the real
//!   world are what is sought; [`SurfaceConfig::related`] takes any.
//! - Performance is measured on the validation tasks, so that neither training nor test tasks decide how the real
//!   world is explored.
//! - The route [`Route::Ideal`] leaves learning out, which is most of the time and of the noise: a fixed sample of
//!   actions of every task is simulated once in each related environment and once at the latents. A learner that had
//!   understood the simulation would try the actions that solve there first, and the others after; within both it
//!   has no reason to prefer any. Performance is the expected AUCCESS of that random order (exactly, by counting).
//!   It falls short of a real learner's, which prefers solutions in the middle of many.
//! - A task of which no sampled action solves in a related environment tells nothing there and is left out (ideal
//!   route).

use serde::{Deserialize, Serialize};

use super::stages::Named;
use super::tryout::try_out;
use crate::error::{Error, Result, within};
use crate::estimate::gp::Hyper;
use crate::estimate::surface::{Axis, FORMAT, Point, Related, Route, Surface, design, grid};
use crate::explore::draw;
use crate::policy::auccess::{ATTEMPTS, weighted};
use crate::policy::{EvaluateConfig, LabelConfig, Policy, Random, TrainConfig, Training, label, train};
use crate::progress::Progress;
use crate::reality::HiddenConfig;
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{Family, Labels, Scene, Split, Task, split};
use crate::world::{Engine, Latents, Rollout, effect, simulate_map};

/// How a surface is found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceConfig {
    pub route: Route,
    /// What is varied, and how far; the rest stays at `base`.
    pub axes: Vec<Axis>,
    /// Density (kg/m^2), friction, restitution.
    pub base: [f64; 3],
    /// Design points, evenly spread.
    pub points: usize,
    /// A grid with this many values an axis instead.
    pub grid: Option<usize>,
    /// Where what was learned is tried.
    pub related: Vec<Related>,
    /// Actions sampled for each task (ideal route).
    pub actions: usize,
    /// Actions labelled for each training task (DQN route).
    pub labels: usize,
    /// How a policy is trained; its seed is replaced for each point (DQN route).
    pub train: TrainConfig,
    /// Actions ranked for each validation task (DQN route).
    pub candidates: usize,
    pub engine: Engine,
    pub seed: u64,
}

impl SurfaceConfig {
    /// Friction and restitution over what the family's prior believes in, damping 0.7 and 0.6 in the related
    /// environments.
    pub fn new(family: &Family, route: Route) -> Result<SurfaceConfig> {
        let base = family.prior.map(|(mean, _)| mean);
        let axes = ["friction", "restitution"].map(|f| Axis::of_prior(f, family.prior));
        Ok(SurfaceConfig {
            route,
            axes: axes.into_iter().collect::<Result<_>>()?,
            base,
            points: 40,
            grid: None,
            related: [0.7, 0.6]
                .map(|kept| Related { latents: base, effects: vec![effect::damping(kept)] })
                .to_vec(),
            actions: family.surface_actions,
            labels: family.learning.labels.per_task,
            train: TrainConfig::preset(&family.learning),
            candidates: 5000,
            engine: Engine::Auto,
            seed: 0,
        })
    }

    /// The one that stands in where none is given: the ideal route at few points. A few seconds for basketball, half a
    /// minute for bowling.
    pub fn quick(family: &Family) -> Result<SurfaceConfig> {
        let config = SurfaceConfig::new(family, Route::Ideal)?;
        Ok(SurfaceConfig { points: 24, actions: config.actions / 2, ..config })
    }

    /// Errors name what is out of range.
    pub fn validate(&self) -> Result<()> {
        within("points", self.points as f64, 3.0, 5000.0)?;
        if let Some(side) = self.grid {
            within("grid", side as f64, 2.0, 50.0)?;
        }
        within("related", self.related.len() as f64, 1.0, 20.0)?;
        within("actions", self.actions as f64, 1.0, 50_000.0)?;
        within("labels", self.labels as f64, 1.0, 50_000.0)?;
        within("candidates", self.candidates as f64, 1.0, 1e6)?;
        for (i, related) in self.related.iter().enumerate() {
            let field = format!("related[{i}]");
            Latents::of(related.latents).validate().map_err(|e| e.under(&field))?;
            for (k, term) in related.effects.iter().enumerate() {
                effect::resolve(term, format_args!("{field}.effects[{k}]"))?;
            }
        }
        self.train.validate().map_err(|e| e.under("train"))
    }

    fn design(&self) -> Vec<[f64; 3]> {
        match self.grid {
            Some(side) => grid(&self.axes, self.base, side),
            None => design(&self.axes, self.base, self.points, self.seed),
        }
    }
}

/// [`SurfaceConfig::quick`]'s surface.
pub fn quick(family: &Family, progress: &dyn Progress) -> Result<Surface> {
    surface(family, &SurfaceConfig::quick(family)?, progress)
}

/// Finds the surface of a family.
pub fn surface(family: &Family, config: &SurfaceConfig, progress: &dyn Progress) -> Result<Surface> {
    config.validate()?;
    let tasks = family.tasks();
    let validation = split(&tasks, Split::Validation);
    let places = config.design();
    let named = Named { inner: progress, name: "performance surface".into() };
    let (points, counted) = match config.route {
        Route::Ideal => ideal(&validation, &places, config, &named)?,
        Route::Dqn => (learned(family, &validation, &places, config, progress)?, validation.len()),
    };
    Surface {
        format: FORMAT.into(),
        program: env!("CARGO_PKG_VERSION").into(),
        family: family.name.into(),
        route: config.route,
        related: config.related.clone(),
        axes: config.axes.clone(),
        base: config.base,
        tasks: counted,
        points,
        surrogate: Hyper { length_scales: Vec::new(), mean: 0.0, signal: 1.0, noise: 1.0 },
        seed: config.seed,
    }
    .fitted()
}

/// Points by the ideal route, and the number of tasks that counted in any environment.
fn ideal(
    tasks: &[Task],
    places: &[[f64; 3]],
    config: &SurfaceConfig,
    progress: &dyn Progress,
) -> Result<(Vec<Point>, usize)> {
    let mut samples: Vec<Vec<Box<Scene>>> = Vec::with_capacity(tasks.len());
    for task in tasks {
        let seed = rng::derive(config.seed, &task.id, 0);
        let drawn =
            draw(std::slice::from_ref(task), config.actions, &mut rng::stream(seed, "surface actions"))?;
        samples.push(drawn.into_iter().map(|(_, _, scene)| scene).collect());
    }
    let total = (places.len() + config.related.len()) as u64;
    let mut done = 0;
    let mut solving = |latents: [f64; 3], effects: &[EffectTerm]| -> Result<Vec<Vec<bool>>> {
        let mut of_task = Vec::with_capacity(samples.len());
        for scenes in &samples {
            progress.report("trying actions", done, total)?;
            let rollouts: Vec<Rollout> = scenes
                .iter()
                .map(|scene| Rollout { latents: Latents::of(latents), effects, ..Rollout::of(scene) })
                .collect();
            of_task.push(simulate_map(&rollouts, config.engine, |_, t| t.solved())?);
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
        points.push(Point::mean(*latents, truths.iter().map(of_truth).collect()));
    }
    Ok((points, counted))
}

/// AUCCESS expected when the actions that `simulated` marks are tried first, in random order, then the others.
fn expected_auccess(simulated: &[bool], truth: &[bool]) -> f64 {
    let count = |mark: bool, and: bool| {
        simulated.iter().zip(truth).filter(|(s, t)| **s == mark && (**t || !and)).count()
    };
    let groups = [(count(true, false), count(true, true)), (count(false, false), count(false, true))];
    // The chance that every attempt so far failed: draws without replacement.
    let mut failed = 1.0;
    let mut curve = [0.0; ATTEMPTS];
    let mut order = groups.into_iter().flat_map(|(size, hits)| (0..size).map(move |k| (size - k, hits)));
    for solved in &mut curve {
        if let Some((left, hits)) = order.next() {
            failed *= left.saturating_sub(hits) as f64 / left as f64;
        }
        *solved = 1.0 - failed;
    }
    weighted(&curve)
}

/// Points by the DQN route.
fn learned(
    family: &Family,
    validation: &[Task],
    places: &[[f64; 3]],
    config: &SurfaceConfig,
    progress: &dyn Progress,
) -> Result<Vec<Point>> {
    let evaluation = EvaluateConfig { candidates: config.candidates, ..EvaluateConfig::phyre(config.seed) };
    let training = split(&family.tasks(), Split::Train);
    let mut points = Vec::with_capacity(places.len());
    for (n, latents) in places.iter().enumerate() {
        let name = format!("performance surface: point {} of {}", n + 1, places.len());
        let named = Named { inner: progress, name };
        // A seed of its own for each point: chance in learning is then noise, which the surrogate tells from slope.
        let seed = rng::derive(config.seed, "surface", n as u64);
        let labels = Labels { per_task: config.labels, ..family.learning.labels };
        let labels = LabelConfig { engine: config.engine, ..LabelConfig::preset(&labels, seed) };
        let world = Training::Fixed { latents: Latents::of(*latents), effects: Vec::new() };
        let data = label(&training, &world, &labels, &named)?;
        // Where nothing solves in simulation there is nothing to learn, and any order is as good as another.
        let policy: Box<dyn Policy> = if data.solving() == 0 {
            Box::new(Random { seed })
        } else {
            Box::new(train(&data, &TrainConfig { seed, ..config.train.clone() }, &named)?.0)
        };
        let tried = |related: &Related| {
            let world = HiddenConfig {
                latents: Latents::of(related.latents),
                effects: related.effects.clone(),
                engine: config.engine,
                noise: 0.0,
                budget: None,
                seed: 0,
            };
            Ok(try_out(policy.as_ref(), validation, &world, &evaluation, &named)?.auccess)
        };
        points.push(Point::mean(*latents, config.related.iter().map(tried).collect::<Result<_>>()?));
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::auccess::auccess;
    use rand::seq::SliceRandom;

    /// The counted expectation is what many random orders come to.
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
