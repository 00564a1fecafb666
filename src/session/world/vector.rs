//! Vector environments: steps or resets many worlds as one batch.
//!
//! All or nothing: every input is validated before anything is done, and errors name the entry. Results are bit-identical to
//! those of single steps, whatever the batch contains.

use std::sync::{Arc, MutexGuard};

use rayon::prelude::*;
use serde::Deserialize;
use utoipa::ToSchema;

use super::World;
use super::episode::{EpisodeStart, Reset, StepResult, StepSummary, TaskSource};
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::reality::{HiddenWorld, Reality, measure_each};
use crate::session::action::Action;
use crate::session::catalogue::TaskContext;
use crate::session::limits::{RequestLimits, rollout_work};
use crate::session::observation::ObservationLayout;
use crate::session::state::Phase;
use crate::sync::lock;
use crate::task::{Placement, Scene, Split, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::{Engine, Latents, Rollout, Simulator};

/// Gymnasium's `AutoresetMode`: `disabled` (stepping a finished episode is an error), `next_step` (the next step resets the
/// world and ignores the action) or `same_step` (reset in the step that ended the episode).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
#[schema(as = AutoresetIn)]
pub enum Autoreset {
    #[default]
    Disabled,
    NextStep,
    SameStep,
}

/// The result of a batch step for one world.
#[derive(Clone, Debug, PartialEq)]
pub struct BatchStepResult {
    /// `None` if the action was ignored because the world was reset instead.
    pub step: Option<StepResult>,
    /// The new episode, if the world was reset.
    pub start: Option<EpisodeStart>,
}

/// Attempts one action in each world. An error names `worlds[i]` or `actions[i]`, and nothing has been done. Automatic resets
/// draw from `split`, by default the split of the world's last reset.
pub fn step_many(
    worlds: &[Arc<World>],
    actions: &[Action],
    autoreset: Autoreset,
    split: Option<Split>,
    budget: &dyn Budget,
) -> Result<Vec<BatchStepResult>> {
    if actions.len() != worlds.len() {
        let allowed = format!("{}, one for each world", worlds.len());
        return Err(Error::input("actions", actions.len(), allowed));
    }
    check_distinct(worlds)?;
    check_observation_lengths(worlds)?;
    let _turns = lock_turns(worlds);
    let mut plans = Vec::with_capacity(worlds.len());
    for (i, (world, action)) in worlds.iter().zip(actions).enumerate() {
        plans.push(plan(world, action, autoreset, split, i)?);
    }
    limits(worlds).check_work(plans.iter().map(PlannedStep::work).fold(0, u64::saturating_add))?;
    let few = plans.len() <= 8;
    let place = |plan: &PlannedStep| budget.check().map(|()| plan.place());
    let placed: Vec<Option<Placement>> = if few {
        plans.iter().map(place).collect::<Result<_>>()?
    } else {
        plans.par_iter().map(place).collect::<Result<_>>()?
    };
    // From here on only the engine and the disk can fail.
    let mut outcomes = attempt(worlds, &plans, &placed, budget)?.into_iter();
    let mut results = Vec::with_capacity(worlds.len());
    for ((world, plan), placement) in worlds.iter().zip(plans).zip(placed) {
        results.push(match (plan, placement) {
            (PlannedStep::Begin(task_source), _) => BatchStepResult {
                step: None,
                start: Some(world.begin_episode(task_source, &next_reset(world, split))),
            },
            (PlannedStep::Act { context, action, latents, .. }, Some(Placement::Invalid(reason))) => {
                let interactions = world.interactions();
                let step = world.finish_step(context, action, latents, Err(reason), interactions);
                BatchStepResult { step: Some(step), start: None }
            }
            (PlannedStep::Act { context, action, latents, then }, _) => {
                let (seen, interactions) =
                    outcomes.next().ok_or_else(|| Error::Failed("a rollout was lost".into()))?;
                let step = world.finish_step(context, action, latents, Ok(seen), interactions);
                let start = then
                    .filter(|_| step.terminated)
                    .map(|task_source| world.begin_episode(task_source, &next_reset(world, split)));
                BatchStepResult { step: Some(step), start }
            }
        });
    }
    Ok(results)
}

/// Resets each world that has a `Some` entry. An error names the entry, and nothing has been done.
pub fn reset_many(worlds: &[Arc<World>], resets: &[Option<Reset>]) -> Result<Vec<Option<EpisodeStart>>> {
    check_distinct(worlds)?;
    check_observation_lengths(worlds)?;
    let mut task_source = Vec::with_capacity(worlds.len());
    for (i, (world, reset)) in worlds.iter().zip(resets).enumerate() {
        let one = reset.as_ref().map(|r| world.task_source(r)).transpose();
        task_source.push(one.map_err(|e| e.for_entry(&format!("tasks[{i}]")))?);
    }
    let _turns = lock_turns(worlds);
    let begun = worlds.iter().zip(resets).zip(task_source).map(|((world, reset), task_source)| {
        match (reset, task_source) {
            (Some(reset), Some(task_source)) => Some(world.begin_episode(task_source, reset)),
            _ => None,
        }
    });
    Ok(begun.collect())
}

/// The validated step of one world in a batch.
enum PlannedStep<'a> {
    /// Start an episode; the action is ignored.
    Begin(TaskSource),
    Act {
        context: TaskContext<'a>,
        action: ValidAction,
        latents: Latents,
        /// The next episode, for automatic reset in the same step.
        then: Option<TaskSource>,
    },
}

impl PlannedStep<'_> {
    /// Upper bound of the work, body-time-steps.
    fn work(&self) -> u64 {
        match self {
            PlannedStep::Begin(_) => 0,
            PlannedStep::Act { context, .. } => rollout_work(&context.task.scene),
        }
    }

    fn place(&self) -> Option<Placement> {
        match self {
            PlannedStep::Begin(_) => None,
            PlannedStep::Act { context, action, .. } => Some(context.task.place(action)),
        }
    }
}

fn plan<'a>(
    world: &'a World,
    action: &Action,
    autoreset: Autoreset,
    split: Option<Split>,
    i: usize,
) -> Result<PlannedStep<'a>> {
    let of_world = |e: Error| e.for_entry(&format!("worlds[{i}]"));
    let done = lock(&world.state).phase == Phase::Done;
    if done && autoreset == Autoreset::NextStep {
        return Ok(PlannedStep::Begin(world.task_source(&next_reset(world, split)).map_err(of_world)?));
    }
    let (context, latents) = world.ready_task().map_err(of_world)?;
    let action = action.resolve(context.task.actions(), &format!("actions[{i}]"))?;
    let then = match autoreset {
        Autoreset::SameStep => Some(world.task_source(&next_reset(world, split)).map_err(of_world)?),
        Autoreset::Disabled | Autoreset::NextStep => None,
    };
    Ok(PlannedStep::Act { context, action, latents, then })
}

/// Options of an automatic reset: the world's task sequence continues.
fn next_reset(world: &World, split: Option<Split>) -> Reset {
    Reset { seed: None, task: None, split: split.or(lock(&world.state).split) }
}

/// Simulates or measures every valid placement, counts it and persists the counters of real worlds. Returns one result per
/// valid placement, with the world's counter after it.
fn attempt(
    worlds: &[Arc<World>],
    plans: &[PlannedStep],
    placed: &[Option<Placement>],
    budget: &dyn Budget,
) -> Result<Vec<(StepSummary, u64)>> {
    let (mut simulated, mut measured): (Vec<ValidStep>, Vec<ValidStep>) = (Vec::new(), Vec::new());
    let mut slots = 0;
    for (i, (plan, placement)) in plans.iter().zip(placed).enumerate() {
        if let (PlannedStep::Act { context, latents, .. }, Some(Placement::Valid(scene))) = (plan, placement)
        {
            let valid = ValidStep { i, slot: slots, layout: context.layout, latents: *latents, scene };
            slots += 1;
            if worlds[i].hidden.is_some() { &mut measured } else { &mut simulated }.push(valid);
        }
    }
    let mut outcomes: Vec<Option<(StepSummary, u64)>> = (0..slots).map(|_| None).collect();
    let (engines, rollouts): (Vec<Engine>, Vec<Rollout>) = simulated
        .iter()
        .map(|v| {
            let world = &worlds[v.i];
            let rollout = Rollout { latents: v.latents, effects: &world.effects, ..Rollout::of(v.scene) };
            (world.engine, rollout)
        })
        .unzip();
    let watched = |v: &ValidStep| worlds[v.i].events.is_active();
    let seen = |v: &ValidStep, trajectory: &Trajectory| StepSummary::of(v.layout, trajectory, watched(v));
    let simulate = |k: usize, trajectory: Trajectory| seen(&simulated[k], &trajectory);
    let seen = Simulator::per_rollout(&engines).budget(budget).map(&rollouts, simulate)?;
    // An exhausted budget fails here, before anything is counted.
    measure(worlds, &measured, &mut outcomes, budget)?;
    for (v, seen) in simulated.iter().zip(seen) {
        outcomes[v.slot] = Some((seen, worlds[v.i].count_simulated(1)));
    }
    outcomes.into_iter().map(|b| b.ok_or_else(|| Error::Failed("a rollout was lost".into()))).collect()
}

/// An action that could be placed.
struct ValidStep<'a> {
    /// Index of the world.
    i: usize,
    /// Index among the valid placements.
    slot: usize,
    layout: &'a ObservationLayout,
    latents: Latents,
    scene: &'a Scene,
}

/// The part of [`attempt`] for real worlds.
fn measure(
    worlds: &[Arc<World>],
    valid: &[ValidStep],
    outcomes: &mut [Option<(StepSummary, u64)>],
    budget: &dyn Budget,
) -> Result<()> {
    let mut order: Vec<usize> = (0..valid.len()).collect();
    order.sort_by_key(|k| Arc::as_ptr(&worlds[valid[*k].i]) as usize);
    let mut guards: Vec<(usize, MutexGuard<HiddenWorld>)> = order
        .into_iter()
        .filter_map(|k| worlds[valid[k].i].hidden.as_ref().map(|hidden| (k, lock(hidden))))
        .collect();
    let before: Vec<u64> = guards.iter().map(|(_, hidden)| hidden.interactions()).collect();
    let mut batch: Vec<(&mut HiddenWorld, &Scene)> =
        guards.iter_mut().map(|(k, hidden)| (&mut **hidden, valid[*k].scene)).collect();
    let observed = measure_each(budget, &mut batch);
    // Interrupted measurements count, too.
    let mut to_write = None;
    for ((k, hidden), before) in guards.iter().zip(before) {
        let (world, made) = (&worlds[valid[*k].i], hidden.interactions() - before);
        let interactions = world.count_measured(made);
        if let Some(account) = world.account.as_ref().filter(|_| made > 0) {
            account.store.note_world(&account.id, interactions);
            to_write = Some(&account.store);
        }
    }
    let observed = observed.map_err(|(at, e)| match at {
        Some(at) => e.for_entry(&format!("worlds[{}]", valid[guards[at].0].i)),
        None => e,
    });
    for ((k, _), trajectory) in guards.iter().zip(observed.iter().flatten()) {
        let v = &valid[*k];
        let world = &worlds[v.i];
        let seen = StepSummary::of(v.layout, trajectory, world.events.is_active());
        outcomes[v.slot] = Some((seen, world.interactions()));
    }
    drop(guards);
    // Counters are on disk before any result is returned.
    to_write.map_or(Ok(()), |store| store.flush_worlds())?;
    observed.map(drop)
}

/// Locks every world's turn, in a global order so that overlapping batches cannot deadlock.
fn lock_turns(worlds: &[Arc<World>]) -> Vec<MutexGuard<'_, ()>> {
    let mut order: Vec<&Arc<World>> = worlds.iter().collect();
    order.sort_by_key(|w| Arc::as_ptr(w) as usize);
    order.into_iter().map(|w| lock(&w.turn)).collect()
}

/// Limits of one request; the same for all worlds of a server.
fn limits(worlds: &[Arc<World>]) -> RequestLimits {
    worlds.first().map_or(RequestLimits::STANDARD, |w| w.limits)
}

/// Fails if a world is repeated or there are too many.
fn check_distinct(worlds: &[Arc<World>]) -> Result<()> {
    limits(worlds).check_count("worlds", worlds.len())?;
    let mut order: Vec<(usize, usize)> =
        worlds.iter().enumerate().map(|(i, w)| (Arc::as_ptr(w) as usize, i)).collect();
    order.sort_unstable();
    match order.windows(2).find(|w| w[0].0 == w[1].0) {
        Some(twice) => {
            let allowed = format!("each world once in a batch; it is `worlds[{}]` too", twice[0].1);
            Err(Error::input(format!("worlds[{}]", twice[1].1), "given twice", allowed))
        }
        None => Ok(()),
    }
}

/// Fails if observations differ in length.
fn check_observation_lengths(worlds: &[Arc<World>]) -> Result<()> {
    let Some(first) = worlds.first() else { return Ok(()) };
    match worlds.iter().position(|w| w.features != first.features) {
        Some(i) => {
            let value = format!("a world with {} numbers in an observation", worlds[i].features);
            let allowed = format!("worlds with {}, as `worlds[0]` has", first.features);
            Err(Error::input(format!("worlds[{i}]"), value, allowed))
        }
        None => Ok(()),
    }
}
