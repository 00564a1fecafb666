//! A world: tasks, physics, and the state of the current episode. Episodes are in `episode`, attempts in `attempt`.

use std::sync::{Arc, Mutex, TryLockError};

use super::catalogue::TaskSet;
use super::config::{Kind, WorldConfig};
use super::limits::{LIGHT, RequestLimits};
use super::observation;
use super::state::{Phase, State, lock, refused};
use super::watch::{Lookout, What};
use crate::error::{Error, Result, within};
use crate::reality::{HiddenConfig, HiddenWorld, standard};
use crate::rng;
use crate::store::Store;
use crate::task::scene::EffectTerm;
use crate::task::{ActionSpace, Task};
use crate::world::{Engine, Latents, Rollout, chosen, effect};

/// A world in which tasks can be attempted.
pub struct World {
    pub(super) tasks: TaskSet,
    pub(super) kind: Kind,
    pub(super) engine: Engine,
    pub(super) sealed: bool,
    pub(super) seed: u64,
    pub(super) budget: Option<u64>,
    /// Of a simulation, or of a real world that is not sealed.
    pub(super) effects: Vec<EffectTerm>,
    /// Numbers in an observation.
    pub(super) features: usize,
    /// Body-time-steps of the longest rollout.
    pub(super) longest: u64,
    pub(super) hidden: Option<Mutex<HiddenWorld>>,
    /// What one request may cost.
    pub(super) limits: RequestLimits,
    /// Where the counter is kept, if anywhere.
    pub(super) account: Option<Account>,
    /// Who is told what happens here.
    pub(super) lookout: Lookout,
    /// Held through a whole reset or step, so that one action ends one episode.
    pub(super) turn: Mutex<()>,
    /// Held only for moments; the last lock taken.
    pub(super) state: Mutex<State>,
}

/// Where a world's counter is kept.
pub(super) struct Account {
    pub store: Arc<Store>,
    pub id: String,
}

/// A world as it may be shown.
pub struct Description {
    pub task: String,
    pub kind: Kind,
    pub engine: Engine,
    pub sealed: bool,
    /// `None` if sealed.
    pub latents: Option<Latents>,
    /// `None` if sealed.
    pub effects: Option<Vec<EffectTerm>>,
    /// Valid attempts so far, by steps, rollouts, films and jobs.
    pub interactions: u64,
    pub budget: Option<u64>,
    pub seed: u64,
    /// Of all tasks of the world.
    pub actions: ActionSpace,
    /// Names of the observation's features.
    pub features: Vec<String>,
    /// Id of the current task.
    pub current: Option<String>,
    pub phase: Phase,
    /// Resets so far.
    pub episodes: u64,
}

impl World {
    /// Makes a world; errors name what in `config` is out of range.
    pub fn new(config: WorldConfig) -> Result<World> {
        World::within(RequestLimits::STANDARD, config)
    }

    /// [`World::new`], held to what one request may cost.
    pub fn within(limits: RequestLimits, config: WorldConfig) -> Result<World> {
        let sealed = config.sealed.unwrap_or(config.kind == Kind::Real);
        for task in config.tasks.tasks.iter() {
            limits.affordable(&task.scene, 1, true)?;
        }
        config.latents.validate()?;
        runs(&config)?;
        let (latents, effects, hidden) = match config.kind {
            Kind::Sim => {
                if config.noise != 0.0 {
                    return Err(Error::input("noise", config.noise, "0 for a simulated world"));
                }
                if let Some(budget) = config.budget {
                    return Err(Error::input(
                        "budget",
                        budget,
                        "null for a simulated world: it costs nothing",
                    ));
                }
                let effects = config.effects.unwrap_or_default();
                for (i, term) in effects.iter().enumerate() {
                    effect::resolve(term, format_args!("effects[{i}]"))?;
                }
                let prior = config.tasks.family.map(|f| Latents::of(f.prior.map(|p| p.0)));
                (config.latents.or(prior.unwrap_or_default()), effects, None)
            }
            Kind::Real => {
                let base = config.tasks.family.map_or_else(bare, standard);
                let hidden = HiddenConfig {
                    latents: config.latents.or(base.latents),
                    effects: config.effects.unwrap_or(base.effects),
                    engine: config.engine,
                    noise: within("noise", config.noise, 0.0, 1e3)?,
                    budget: config.budget,
                    seed: config.seed,
                };
                let shown = (!sealed).then(|| (hidden.latents, hidden.effects.clone()));
                let (latents, effects) = shown.unwrap_or_default();
                (latents, effects, Some(Mutex::new(HiddenWorld::new(hidden)?)))
            }
        };
        let scenes = config.tasks.tasks.iter().map(|t| &t.scene);
        Ok(World {
            features: observation::names(&config.tasks.tasks[0].scene).len(),
            longest: scenes.map(|s| u64::from(s.steps) * s.bodies.len() as u64).max().unwrap_or(0),
            tasks: config.tasks,
            kind: config.kind,
            engine: config.engine,
            sealed,
            seed: config.seed,
            budget: config.budget,
            effects,
            hidden,
            limits,
            account: None,
            lookout: Lookout::default(),
            turn: Mutex::new(()),
            state: Mutex::new(State {
                latents,
                phase: Phase::New,
                task: None,
                split: None,
                episodes: 0,
                interactions: 0,
                resets: rng::stream(config.seed, "reset"),
                last: None,
            }),
        })
    }

    /// Sets those latent factors that are given; refused by a real or sealed world.
    pub fn set_latents(&self, latents: Latents) -> Result<()> {
        if self.kind == Kind::Real || self.sealed {
            return Err(Error::Sealed {
                reason: "the latents of a real or sealed world cannot be set; \
                         set them in a simulated world and compare"
                    .into(),
            });
        }
        latents.validate()?;
        let mut state = lock(&self.state);
        state.latents = latents.or(state.latents);
        if let Some(account) = &self.account {
            let text = serde_json::to_string(&state.latents).ok();
            account.store.note_world(&account.id, state.interactions, text);
        }
        let (latents, interactions) = (state.latents, state.interactions);
        drop(state);
        self.lookout.tell(interactions, || What::Latents(latents));
        Ok(())
    }

    /// The world as it may be shown.
    pub fn describe(&self) -> Description {
        let state = lock(&self.state);
        let first = &self.tasks.tasks[0];
        Description {
            task: self.tasks.name.clone(),
            kind: self.kind,
            engine: self.engine,
            sealed: self.sealed,
            latents: (!self.sealed).then_some(state.latents),
            effects: (!self.sealed).then(|| self.effects.clone()),
            interactions: state.interactions,
            budget: self.budget,
            seed: self.seed,
            actions: first.actions().clone(),
            features: observation::names(&first.scene),
            current: state.task.map(|t| self.tasks.tasks[t].id.clone()),
            phase: state.phase,
            episodes: state.episodes,
        }
    }

    /// Whether everything but a large batch is done here in a fraction of a millisecond, without waiting for the disk
    /// or for somebody else's turn.
    pub fn is_light(&self) -> bool {
        self.hidden.is_none()
            && self.longest <= LIGHT
            && !matches!(self.turn.try_lock(), Err(TryLockError::WouldBlock))
    }

    /// Simulated or real.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The tasks the world may be reset to.
    pub fn tasks(&self) -> &TaskSet {
        &self.tasks
    }

    /// Numbers in an observation.
    pub fn features(&self) -> usize {
        self.features
    }

    /// Valid attempts so far.
    pub fn interactions(&self) -> u64 {
        lock(&self.state).interactions
    }

    /// Most valid attempts allowed.
    pub fn budget(&self) -> Option<u64> {
        self.budget
    }

    /// Valid attempts still allowed.
    pub fn remaining(&self) -> Option<u64> {
        self.budget.map(|b| b.saturating_sub(self.interactions()))
    }

    pub(super) fn task_or_current(&self, id: Option<&str>) -> Result<(&Task, Latents)> {
        let state = lock(&self.state);
        let index = match id {
            Some(id) => self.tasks.find(id)?,
            None if self.tasks.tasks.len() == 1 => 0,
            None => state
                .task
                .ok_or_else(|| refused("no current task; reset the world first, or name a `task`"))?,
        };
        Ok((&self.tasks.tasks[index], state.latents))
    }
}

/// A real world of a custom scene: the scene's own coefficients and effects.
fn bare() -> HiddenConfig {
    HiddenConfig {
        latents: Latents::default(),
        effects: Vec::new(),
        engine: Engine::Auto,
        noise: 0.0,
        budget: None,
        seed: 0,
    }
}

/// Errors unless the engine takes the world's scenes: better now than at the first step.
fn runs(config: &WorldConfig) -> Result<()> {
    let mut scene = config.tasks.tasks[0].scene.clone();
    for body in &mut scene.bodies {
        // An action decides; any place will do to ask.
        body.position.get_or_insert([0.0, 0.0]);
    }
    let effects = config.effects.as_deref().unwrap_or_default();
    chosen(config.engine, &Rollout { latents: config.latents, effects, ..Rollout::of(&scene) }).map(drop)
}
