//! Many worlds at a time: one action in each, simulated as one batch.
//!
//! All or nothing: whatever can be refused is refused before anything is done, with the entry named. How a batch is
//! put together changes no bit of its results; they are those of single steps.

use std::sync::{Arc, MutexGuard};

use rayon::prelude::*;

use super::action::Action;
use super::catalogue::Posed;
use super::episode::{Drawn, Reset, Seen, Start, Step};
use super::limits::RequestLimits;
use super::observation::{self, Layout};
use super::state::{Phase, lock};
use super::world::World;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::reality::{HiddenWorld, measure_each};
use crate::task::{Placement, Scene, Split, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::{Engine, Latents, Rollout, simulate_mixed};

/// When a world whose episode has ended begins the next one by itself (Gymnasium's `AutoresetMode`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Autoreset {
    /// Never: stepping it is refused.
    #[default]
    Disabled,
    /// At the next step, whose action is ignored.
    NextStep,
    /// In the step that ended it.
    SameStep,
}

/// What a batch brought one world.
#[derive(Clone, Debug, PartialEq)]
pub struct Turned {
    /// What the action brought; `None` where it was ignored for a reset.
    pub step: Option<Step>,
    /// The episode that began, if one did.
    pub start: Option<Start>,
}

/// One action in each world. Errors name `worlds[i]` or `actions[i]`, and then nothing was done. Episodes that begin
/// by themselves are drawn from `split`, or from what the world was last reset to.
pub fn step_many(
    worlds: &[Arc<World>],
    actions: &[Action],
    autoreset: Autoreset,
    split: Option<Split>,
    budget: &dyn Budget,
) -> Result<Vec<Turned>> {
    if actions.len() != worlds.len() {
        let allowed = format!("{}, one for each world", worlds.len());
        return Err(Error::input("actions", actions.len(), allowed));
    }
    different(worlds)?;
    alike(worlds)?;
    let _turns = turns(worlds);
    let mut plans = Vec::with_capacity(worlds.len());
    for (i, (world, action)) in worlds.iter().zip(actions).enumerate() {
        plans.push(plan(world, action, autoreset, split, i)?);
    }
    limits(worlds).bearable(plans.iter().map(Plan::work).fold(0, u64::saturating_add))?;
    let few = plans.len() <= 8;
    let place = |plan: &Plan| budget.look().map(|()| plan.place());
    let placed: Vec<Option<Placement>> = if few {
        plans.iter().map(place).collect::<Result<_>>()?
    } else {
        plans.par_iter().map(place).collect::<Result<_>>()?
    };
    // From here on only the engine or the disk can fail.
    let mut brought = attempt(worlds, &plans, &placed, budget)?.into_iter();
    let mut turned = Vec::with_capacity(worlds.len());
    for ((world, plan), placement) in worlds.iter().zip(plans).zip(placed) {
        turned.push(match (plan, placement) {
            (Plan::Begin(drawn), _) => {
                Turned { step: None, start: Some(world.begin(drawn, &again(world, split))) }
            }
            (Plan::Act { posed, action, latents, .. }, Some(Placement::Invalid(reason))) => {
                let interactions = world.interactions();
                let step = world.stepped(posed, action, latents, Err(reason), interactions);
                Turned { step: Some(step), start: None }
            }
            (Plan::Act { posed, action, latents, then }, _) => {
                let (seen, interactions) =
                    brought.next().ok_or_else(|| Error::Failed("a rollout was lost".into()))?;
                let step = world.stepped(posed, action, latents, Ok(seen), interactions);
                Turned { step: Some(step), start: then.map(|drawn| world.begin(drawn, &again(world, split))) }
            }
        });
    }
    Ok(turned)
}

/// Starts an episode in each world that is given a reset. Errors name the entry, and then nothing was done.
pub fn reset_many(worlds: &[Arc<World>], resets: &[Option<Reset>]) -> Result<Vec<Option<Start>>> {
    different(worlds)?;
    alike(worlds)?;
    let mut drawn = Vec::with_capacity(worlds.len());
    for (i, (world, reset)) in worlds.iter().zip(resets).enumerate() {
        let one = reset.as_ref().map(|r| world.drawn(r)).transpose();
        drawn.push(one.map_err(|e| e.of_entry(&format!("tasks[{i}]")))?);
    }
    let _turns = turns(worlds);
    let begun = worlds.iter().zip(resets).zip(drawn).map(|((world, reset), drawn)| match (reset, drawn) {
        (Some(reset), Some(drawn)) => Some(world.begin(drawn, reset)),
        _ => None,
    });
    Ok(begun.collect())
}

/// What a world is to do in a batch.
enum Plan<'a> {
    /// Begin an episode; the action is ignored.
    Begin(Drawn),
    Act {
        posed: Posed<'a>,
        action: ValidAction,
        latents: Latents,
        /// The episode to begin if this one ends.
        then: Option<Drawn>,
    },
}

impl Plan<'_> {
    /// Body-time-steps at most.
    fn work(&self) -> u64 {
        match self {
            Plan::Begin(_) => 0,
            Plan::Act { posed, .. } => {
                u64::from(posed.task.scene.steps) * posed.task.scene.bodies.len() as u64
            }
        }
    }

    fn place(&self) -> Option<Placement> {
        match self {
            Plan::Begin(_) => None,
            Plan::Act { posed, action, .. } => Some(posed.task.place(action)),
        }
    }
}

fn plan<'a>(
    world: &'a World,
    action: &Action,
    autoreset: Autoreset,
    split: Option<Split>,
    i: usize,
) -> Result<Plan<'a>> {
    let of_world = |e: Error| e.of_entry(&format!("worlds[{i}]"));
    let done = lock(&world.state).phase == Phase::Done;
    if done && autoreset == Autoreset::NextStep {
        return Ok(Plan::Begin(world.drawn(&again(world, split)).map_err(of_world)?));
    }
    let (posed, latents) = world.ready().map_err(of_world)?;
    let action = action.resolve(posed.task.actions(), &format!("actions[{i}]"))?;
    let then = match autoreset {
        Autoreset::SameStep => Some(world.drawn(&again(world, split)).map_err(of_world)?),
        Autoreset::Disabled | Autoreset::NextStep => None,
    };
    Ok(Plan::Act { posed, action, latents, then })
}

/// The reset of a world that resets itself: its own stream of tasks goes on.
fn again(world: &World, split: Option<Split>) -> Reset {
    Reset { seed: None, task: None, split: split.or(lock(&world.state).split) }
}

/// Simulates what could be placed, counts it and sees to it that the count of real worlds lasts. One result for each
/// valid placement, with the world's counter after it.
fn attempt(
    worlds: &[Arc<World>],
    plans: &[Plan],
    placed: &[Option<Placement>],
    budget: &dyn Budget,
) -> Result<Vec<(Seen, u64)>> {
    let (mut simulated, mut measured): (Vec<Valid>, Vec<Valid>) = (Vec::new(), Vec::new());
    let mut slots = 0;
    for (i, (plan, placement)) in plans.iter().zip(placed).enumerate() {
        if let (Plan::Act { posed, latents, .. }, Some(Placement::Valid(scene))) = (plan, placement) {
            let valid = Valid { i, slot: slots, layout: posed.layout, latents: *latents, scene };
            slots += 1;
            if worlds[i].hidden.is_some() { &mut measured } else { &mut simulated }.push(valid);
        }
    }
    let mut brought: Vec<Option<(Seen, u64)>> = (0..slots).map(|_| None).collect();
    let rollouts: Vec<(Engine, Rollout)> = simulated
        .iter()
        .map(|v| {
            let world = &worlds[v.i];
            let rollout = Rollout { latents: v.latents, effects: &world.effects, ..Rollout::of(v.scene) };
            (world.engine, rollout)
        })
        .collect();
    let watched = |v: &Valid| worlds[v.i].lookout.is_on();
    let seen = |v: &Valid, trajectory: &Trajectory| Seen::of(v.layout, trajectory, watched(v));
    let simulate = |k: usize, trajectory: Trajectory| seen(&simulated[k], &trajectory);
    let seen = simulate_mixed(budget, &rollouts, simulate)?;
    // A spent budget refuses here, when nothing has been counted yet.
    measure(worlds, &measured, &mut brought, budget)?;
    for (v, seen) in simulated.iter().zip(seen) {
        let world = &worlds[v.i];
        let interactions = {
            let mut state = lock(&world.state);
            state.interactions += 1;
            state.interactions
        };
        if let Some(account) = &world.account {
            account.store.note_world(&account.id, interactions, None);
        }
        brought[v.slot] = Some((seen, interactions));
    }
    brought.into_iter().map(|b| b.ok_or_else(|| Error::Failed("a rollout was lost".into()))).collect()
}

/// An action that could be placed.
struct Valid<'a> {
    /// Number of the world.
    i: usize,
    /// Number among all that could be placed.
    slot: usize,
    layout: &'a Layout,
    latents: Latents,
    scene: &'a Scene,
}

/// The part of [`attempt`] that is carried out in real worlds.
fn measure(
    worlds: &[Arc<World>],
    valid: &[Valid],
    brought: &mut [Option<(Seen, u64)>],
    budget: &dyn Budget,
) -> Result<()> {
    let mut order: Vec<usize> = (0..valid.len()).collect();
    order.sort_by_key(|k| Arc::as_ptr(&worlds[valid[*k].i]) as usize);
    let mut guards: Vec<(usize, MutexGuard<HiddenWorld>)> = order
        .into_iter()
        .filter_map(|k| worlds[valid[k].i].hidden.as_ref().map(|hidden| (k, lock(hidden))))
        .collect();
    let mut batch: Vec<(&mut HiddenWorld, &Scene)> =
        guards.iter_mut().map(|(k, hidden)| (&mut **hidden, valid[*k].scene)).collect();
    let observed = measure_each(budget, &mut batch);
    // Also what was stopped in the middle counts.
    let mut to_write = None;
    for (k, hidden) in &guards {
        use crate::reality::Reality;
        let (world, interactions) = (&worlds[valid[*k].i], hidden.interactions());
        let before = std::mem::replace(&mut lock(&world.state).interactions, interactions);
        if let Some(account) = world.account.as_ref().filter(|_| interactions > before) {
            account.store.note_world(&account.id, interactions, None);
            to_write = Some(&account.store);
        }
    }
    let observed = observed.map_err(|(at, e)| match at {
        Some(at) => e.of_entry(&format!("worlds[{}]", valid[guards[at].0].i)),
        None => e,
    });
    for ((k, _), trajectory) in guards.iter().zip(observed.iter().flatten()) {
        let v = &valid[*k];
        let world = &worlds[v.i];
        let seen = Seen::of(v.layout, trajectory, world.lookout.is_on());
        brought[v.slot] = Some((seen, world.interactions()));
    }
    drop(guards);
    // Written together, before a result is given out.
    to_write.map_or(Ok(()), |store| store.flush_worlds())?;
    observed.map(drop)
}

/// Every world's turn, taken in one order everywhere so that batches that share worlds do not wait in a circle.
fn turns(worlds: &[Arc<World>]) -> Vec<MutexGuard<'_, ()>> {
    let mut order: Vec<&Arc<World>> = worlds.iter().collect();
    order.sort_by_key(|w| Arc::as_ptr(w) as usize);
    order.into_iter().map(|w| lock(&w.turn)).collect()
}

/// What one request may cost; all worlds of a server are held to the same.
fn limits(worlds: &[Arc<World>]) -> RequestLimits {
    worlds.first().map_or(RequestLimits::STANDARD, |w| w.limits)
}

/// Errors unless the worlds are different ones, and not too many.
fn different(worlds: &[Arc<World>]) -> Result<()> {
    limits(worlds).countable("worlds", worlds.len())?;
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

/// Errors unless all observations are of one length.
fn alike(worlds: &[Arc<World>]) -> Result<()> {
    let Some(first) = worlds.first() else { return Ok(()) };
    match worlds.iter().position(|w| w.features != first.features) {
        Some(i) => {
            let names = |w: &World| observation::names(&w.tasks.tasks[0].scene).len();
            let value = format!("a world with {} numbers in an observation", names(&worlds[i]));
            let allowed = format!("worlds with {}, as `worlds[0]` has", first.features);
            Err(Error::input(format!("worlds[{i}]"), value, allowed))
        }
        None => Ok(()),
    }
}
