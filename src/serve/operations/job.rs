//! Estimations, and jobs of all kinds.

use std::time::Instant;

use serde::Serialize;
use serde_json::Value;

use crate::error::{Error, Result};
use crate::experiment::{EstimateConfig, estimate};
use crate::job::{Deleted, Job, Work};
use crate::progress::Progress;
use crate::reality::{Attempt, HiddenConfig, HiddenWorld, Reality, standard};
use crate::serve::app::App;
use crate::serve::metrics::Metrics;
use crate::serve::wire::{Estimation, JobOut, Jobs, Object, RealIn, effects};
use crate::session::{Kind, SharedReality, TaskSet};
use crate::task::{Split, Task, ValidAction, split};

/// Queues an estimation.
pub fn estimation(app: &App, body: Estimation, config: Value) -> Result<JobOut> {
    let tasks = app.catalogue.named(&body.task)?;
    let family = tasks.family.ok_or_else(|| Error::Failed("a built-in task without a family".into()))?;
    let mut setup = EstimateConfig::fast(family.prior);
    let whole = |field: &str, value: Option<u64>, default: usize| match value {
        None => Ok(default),
        Some(v) => usize::try_from(v).map_err(|_| Error::input(field, v, "a smaller whole number")),
    };
    setup.strategy = body.strategy.unwrap_or(setup.strategy);
    setup.rounds = whole("rounds", body.rounds, setup.rounds)?;
    setup.actions = whole("actions", body.actions, setup.actions)?;
    setup.candidates = setup.candidates.max(setup.actions.saturating_mul(10));
    if let Some(samples) = body.samples {
        if !(4..=100_000).contains(&samples) {
            return Err(Error::input("samples", samples, "a whole number from 4 to 100000"));
        }
        let samples = samples as usize;
        setup.cem.elites = (samples * setup.cem.elites / setup.cem.samples).max(2);
        setup.cem.samples = samples;
    }
    setup.seed = body.seed.unwrap_or(0);
    setup.validate().map_err(named)?;
    let mut reality: Box<dyn Reality> = match (body.world, body.real) {
        (Some(_), Some(_)) => {
            return Err(Error::input("real", "given beside `world`", "one of world and real"));
        }
        (Some(id), None) => {
            let world = app.worlds.get(&id, app.now())?;
            if world.kind() != Kind::Real {
                return Err(Error::input("world", format!("{id:?}"), "a world of kind real"));
            }
            same_family(&tasks, world.tasks(), "world", &id)?;
            Box::new(SharedReality(world))
        }
        (None, real) => {
            let base = standard(family);
            Box::new(HiddenWorld::new(hidden(real.map(|r| r.0).unwrap_or_default(), base, setup.seed)?)?)
        }
    };
    let limit = body.budget.map(|b| reality.interactions().saturating_add(b));
    let training =
        if tasks.tasks.len() > 1 { split(&tasks.tasks, Split::Train) } else { tasks.tasks.to_vec() };
    let metrics = app.metrics.clone();
    let seed = setup.seed;
    let work: Work = Box::new(move |_, progress: &dyn Progress| {
        let started = Instant::now();
        let mut limited = Limited { inner: &mut *reality, limit, metrics: &metrics };
        let (mut report, _) = estimate(&training, &mut limited, &setup, progress)?;
        report.seconds = Some(started.elapsed().as_secs_f64());
        metrics.simulated(report.rollouts);
        json(&report)
    });
    Ok(app.jobs.submit("iplw", &config, seed, work)?.into())
}

/// All jobs.
pub fn list(app: &App) -> Result<Jobs> {
    Ok(Jobs { jobs: app.jobs.list()?.into_iter().map(JobOut::from).collect() })
}

/// One job.
pub fn get(app: &App, id: &str) -> Result<JobOut> {
    Ok(app.jobs.get(id)?.into())
}

/// Cancels a job, or forgets one that has ended (`None`).
pub fn delete(app: &App, id: &str) -> Result<Option<JobOut>> {
    Ok(match app.jobs.delete(id)? {
        Deleted::Cancelled(job) => Some(Job::into(*job)),
        Deleted::Forgotten => None,
    })
}

/// Errors unless both are tasks of one family.
pub fn same_family(tasks: &TaskSet, other: &TaskSet, field: &str, id: &str) -> Result<()> {
    let name = |t: &TaskSet| t.family.map_or_else(|| t.name.clone(), |f| f.name.to_string());
    if name(tasks) == name(other) {
        return Ok(());
    }
    let value = format!("{id:?} of {}", name(other));
    Err(Error::input(field, value, format!("a world of {}", name(tasks))))
}

/// A report as a job's result.
pub fn json<T: Serialize>(report: &T) -> Result<Value> {
    serde_json::to_value(report).map_err(|e| Error::Failed(format!("the result cannot be written: {e}")))
}

fn hidden(real: RealIn, base: HiddenConfig, seed: u64) -> Result<HiddenConfig> {
    let latents = real.latents.map(|Object(l)| l).unwrap_or_default().checked("real.latents.")?;
    let terms = effects(real.damping, real.effects, "real.")?;
    Ok(HiddenConfig {
        latents: latents.or(base.latents),
        effects: terms.unwrap_or(base.effects),
        noise: crate::error::within("real.noise", real.noise.unwrap_or(0.0), 0.0, 1e3)?,
        seed,
        ..base
    })
}

/// The core's errors with the request's names of fields.
fn named(error: Error) -> Error {
    match error {
        Error::NotFound { kind: "strategy", id, known } => {
            Error::input("strategy", format!("{id:?}"), format!("one of {}", known.join(", ")))
        }
        Error::Input(mut input) if input.field == "candidates" => {
            input.field = "actions".into();
            input.allowed = "a whole number from 1 to 10000".into();
            Error::Input(input)
        }
        other => other,
    }
}

/// A reality with a further limit on its interactions, which are counted for the server too.
struct Limited<'a> {
    inner: &'a mut dyn Reality,
    limit: Option<u64>,
    metrics: &'a Metrics,
}

impl Reality for Limited<'_> {
    fn measure(&mut self, task: &Task, actions: &[ValidAction]) -> Result<Vec<Attempt>> {
        let attempts = self.inner.measure(task, actions)?;
        self.metrics.attempted(Kind::Real, attempts.iter().filter(|a| a.trajectory.is_some()).count() as u64);
        Ok(attempts)
    }

    fn interactions(&self) -> u64 {
        self.inner.interactions()
    }

    fn budget(&self) -> Option<u64> {
        [self.inner.budget(), self.limit].into_iter().flatten().min()
    }
}
