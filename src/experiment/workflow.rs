//! The workflow as something to ask and to tell: it proposes actions, takes what was measured, moves the
//! estimate, and proposes again.
//!
//! Source: Semage et al., algorithm 1. [`Workflow`] holds no reality: whoever does, a hidden world in this
//! process or a robot far away, carries the proposals out. Every finished round is a [`Round`], plain data, and
//! [`Workflow::resume`] builds the workflow again from its rounds: proposals and everything after are then the
//! same bits, because all randomness is drawn from the seed and the number of the round.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::choice::Choice;
use super::config::{EstimateConfig, Memory};
use super::deciding::{self, decided};
use super::fit::{Found, fit_round, report_on};
use super::report::{EstimateReport, Stopped};
use super::sense;
use super::stages::Staged;
use super::ways;
use crate::error::{Error, Result};
use crate::estimate::cem::State;
use crate::estimate::{Cem, LatentEstimate};
use crate::explore::{self, Importance, Situation};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng;
use crate::task::{Placement, Task, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::Sample;

/// An estimation under way.
pub struct Workflow {
    tasks: Vec<Task>,
    config: EstimateConfig,
    importance: Option<Arc<dyn Importance>>,
    cem: Cem,
    rounds: Vec<Round>,
    /// All trials so far, in the order in which they were proposed.
    trials: Vec<Trial>,
    /// What is proposed and not yet answered.
    open: Option<Asked>,
    ended: Option<Stopped>,
}

/// An action that is to be carried out on the real world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Proposal {
    /// Counts from 0 over the whole estimation.
    pub number: u64,
    /// Id of the task.
    pub task: String,
    /// (dimension,) components in [0, 1].
    pub action: Vec<f64>,
}

/// What became of a proposal; one that could not be carried out is left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// The proposal's number.
    pub number: u64,
    /// What was observed.
    pub observed: Trajectory,
}

/// A finished round: what was asked, what was measured, where the search stood then.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Round {
    pub proposals: Vec<Proposal>,
    /// In the order of the proposals.
    pub answers: Vec<Answer>,
    pub choice: Choice,
    pub search: State,
    /// The estimate, if it was refined; else it is the search's mean.
    #[serde(default)]
    pub refined: Option<Sample>,
    /// Residual of the best sample, m^2 per trajectory; `None` if nothing was measured.
    pub residual: Option<f64>,
    /// Rollouts simulated.
    pub rollouts: u64,
}

/// A round that is proposed and not yet answered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Asked {
    pub proposals: Vec<Proposal>,
    pub choice: Choice,
    /// Rollouts simulated to choose them.
    pub rollouts: u64,
}

impl Workflow {
    /// A workflow that has not asked for anything yet. `importance` is what the strategy `gradient` needs.
    pub fn new(
        tasks: &[Task],
        config: &EstimateConfig,
        importance: Option<Arc<dyn Importance>>,
    ) -> Result<Workflow> {
        config.validate()?;
        if ways::question(&config.strategy)?.is_some() {
            deciding::check(config)?;
        }
        if tasks.is_empty() {
            return Err(Error::Failed("no task to estimate on".into()));
        }
        if ways::needs_importance(&config.strategy)? && importance.is_none() {
            let allowed = "a strategy that needs no performance surface, or a surface beside it";
            return Err(Error::input("strategy", format!("{:?}", config.strategy), allowed));
        }
        let mut config = config.clone();
        config.cem = sense::apply(&config.senses, config.cem, tasks.iter().map(|t| &t.scene))?;
        Ok(Workflow {
            tasks: tasks.to_vec(),
            config: config.clone(),
            importance,
            cem: Cem::new(config.cem.clone())?,
            rounds: Vec::new(),
            trials: Vec::new(),
            open: None,
            ended: None,
        })
    }

    /// The workflow as it stood after `rounds`.
    pub fn resume(mut self, rounds: Vec<Round>) -> Result<Workflow> {
        for round in rounds {
            let fresh = self.trials_of(&round.proposals, &round.answers)?;
            self.cem = Cem::at(self.config.cem.clone(), &round.search)?;
            self.finish(round, fresh);
        }
        Ok(self)
    }

    /// The workflow with this round proposed: what [`Workflow::asked`] gave where it stood here before.
    pub fn reopen(mut self, asked: Asked) -> Workflow {
        self.open = Some(asked);
        self
    }

    /// The round that is proposed and not yet answered.
    pub fn asked(&self) -> Option<&Asked> {
        self.open.as_ref()
    }

    /// What is to be measured next, at most `room` actions; `None` when the estimation has ended. Asking twice
    /// gives the same.
    pub fn propose(&mut self, room: Option<u64>, progress: &dyn Progress) -> Result<Option<Vec<Proposal>>> {
        if self.ended.is_some() {
            return Ok(None);
        }
        if self.open.is_none() {
            let wanted = (self.config.actions as u64).min(room.unwrap_or(u64::MAX)) as usize;
            if wanted == 0 {
                self.ended = Some(Stopped::Budget);
                return Ok(None);
            }
            let staged = self.staged(progress);
            let asked = self.explore(wanted, &staged)?;
            self.open = Some(asked);
        }
        Ok(self.open.as_ref().map(|o| o.proposals.clone()))
    }

    /// Ends the round with what was measured, in any order; the estimate moves. Errors leave everything as it was.
    pub fn tell(&mut self, answers: &[Answer], progress: &dyn Progress) -> Result<&Round> {
        let Some(asked) = self.open.clone() else {
            return Err(Error::Refused { reason: "nothing was proposed that could be answered".into() });
        };
        let mut answers = answers.to_vec();
        answers.sort_by_key(|a| a.number);
        answers.dedup_by_key(|a| a.number);
        let fresh = self.trials_of(&asked.proposals, &answers)?;
        let mut cem = self.cem.clone();
        let all: Vec<Trial> = match self.config.memory {
            Memory::All => self.trials.iter().chain(&fresh).cloned().collect(),
            Memory::LastRound => fresh.clone(),
        };
        let (mut residual, mut refined, mut rollouts) = (None, None, asked.rollouts);
        if !all.is_empty() {
            let staged = self.staged(progress);
            let before = self.rounds.iter().rev().find_map(|r| r.refined.as_ref());
            let fitted = fit_round(&mut cem, before, &all, &self.config, self.rounds.len(), &staged)?;
            (residual, refined, rollouts) =
                (Some(fitted.residual), fitted.refined, rollouts + fitted.rollouts);
        }
        let round = Round {
            proposals: asked.proposals,
            answers,
            choice: asked.choice,
            search: cem.state(),
            refined,
            residual,
            rollouts,
        };
        self.cem = cem;
        self.finish(round, fresh);
        Ok(&self.rounds[self.rounds.len() - 1])
    }

    /// What is known now, with intervals. Errors if nothing was measured.
    pub fn report(&self, progress: &dyn Progress) -> Result<EstimateReport> {
        if self.trials.is_empty() {
            return Err(Error::Refused { reason: "nothing has been measured yet".into() });
        }
        report_on(
            &self.estimate(),
            &self.cem.deviations(),
            &self.trials,
            &self.config,
            self.found(),
            progress,
        )
    }

    /// What is known after the last round, as a report has it, and the rollouts it took to know; nothing as long as
    /// nothing was measured.
    pub fn known(&self, progress: &dyn Progress) -> Result<(Vec<LatentEstimate>, u64)> {
        let round = self.rounds.len().saturating_sub(1);
        if self.trials.is_empty() {
            return Ok((Vec::new(), 0));
        }
        let report = self.report(&Staged { inner: progress, round, rounds: self.config.rounds })?;
        let before: u64 = self.rounds.iter().map(|r| r.rollouts).sum();
        Ok((report.latents.into_iter().chain(report.effects).collect(), report.rollouts - before))
    }

    /// The current estimate.
    pub fn estimate(&self) -> Sample {
        self.rounds.last().map_or_else(|| self.cem.estimate(), |r| self.estimate_at(r))
    }

    /// The estimate after each round.
    pub fn estimates(&self) -> Vec<Sample> {
        self.rounds.iter().map(|r| self.estimate_at(r)).collect()
    }

    /// Real interactions after each round.
    pub fn interactions(&self) -> Vec<u64> {
        let sum = |spent: &mut u64, round: &Round| {
            *spent += round.answers.len() as u64;
            Some(*spent)
        };
        self.rounds.iter().scan(0, sum).collect()
    }

    /// All trials so far.
    pub fn trials(&self) -> &[Trial] {
        &self.trials
    }

    /// The finished rounds.
    pub fn rounds(&self) -> &[Round] {
        &self.rounds
    }

    /// Why it has ended, if it has.
    pub fn ended(&self) -> Option<Stopped> {
        self.ended
    }

    /// The configuration it runs with.
    pub fn config(&self) -> &EstimateConfig {
        &self.config
    }

    /// The scene of a proposal with the action carried out.
    pub fn placed(&self, proposal: &Proposal) -> Result<crate::task::Scene> {
        let task = self.task(&proposal.task)?;
        match task.place(&task.actions().validate(&proposal.action)?) {
            Placement::Valid(scene) => Ok(*scene),
            Placement::Invalid(reason) => Err(Error::input(
                "action",
                format!("{:?}", proposal.action),
                format!("one that can be placed ({reason})"),
            )),
        }
    }

    /// The task called `id`.
    pub fn task(&self, id: &str) -> Result<&Task> {
        self.tasks.iter().find(|t| t.id == id).ok_or_else(|| Error::NotFound {
            kind: "task",
            id: id.to_string(),
            known: self.tasks.iter().map(|t| t.id.clone()).collect(),
        })
    }

    fn finish(&mut self, round: Round, fresh: Vec<Trial>) {
        self.rounds.push(round);
        self.trials.extend(fresh);
        self.open = None;
        if self.has_settled() {
            self.ended = Some(Stopped::Settled);
        } else if self.rounds.len() == self.config.rounds {
            self.ended = Some(Stopped::Rounds);
        }
    }

    /// The actions this round spends on the real world.
    fn explore(&self, wanted: usize, progress: &dyn Progress) -> Result<Asked> {
        let round = self.rounds.len() as u64;
        let seed = rng::derive(self.config.seed, "explore", round);
        if let Some(question) = ways::question(&self.config.strategy)? {
            let made = decided(&self.tasks, &self.trials, &self.config, question, (wanted, seed), progress)?;
            let choice = made.choice(self.tasks[0].scene.time_step);
            let actions = made.experiments.into_iter().map(|e| (e.task, e.action.values().to_vec()));
            return Ok(Asked { proposals: self.proposed(actions), choice, rollouts: made.rollouts });
        }
        let mut stream = rng::stream(seed, "candidates");
        let (estimate, coordinates) = (self.estimate(), self.config.cem.coordinates());
        let world = explore::World {
            latents: coordinates.latents(&estimate),
            effects: coordinates.effects(&estimate, &self.config.effects),
            engine: self.config.engine,
        };
        let candidates =
            explore::candidates(&self.tasks, self.config.candidates, &world, &mut stream, progress)?;
        let situation = Situation {
            tasks: &self.tasks,
            candidates: &candidates,
            world: &world,
            coordinates: &coordinates,
            estimate: &estimate,
            spread: &self.cem.deviations(),
            prior: &self.config.cem.deviations(),
            trials: &self.trials,
            importance: self.importance.as_deref(),
            progress,
        };
        let chosen = explore::strategy(&self.config.strategy)?.choose(&situation, wanted)?;
        let actions = chosen.indices.iter().map(|i| {
            let own = &candidates[*i];
            (self.tasks[own.task].id.clone(), own.action.values().to_vec())
        });
        Ok(Asked {
            proposals: self.proposed(actions),
            choice: Choice::of(&candidates, &chosen),
            rollouts: candidates.len() as u64 + chosen.rollouts,
        })
    }

    /// Actions, each with the id of its task, as what is proposed next.
    fn proposed(&self, actions: impl Iterator<Item = (String, Vec<f64>)>) -> Vec<Proposal> {
        let first = self.rounds.iter().map(|r| r.proposals.len() as u64).sum::<u64>();
        actions.zip(first..).map(|((task, action), number)| Proposal { number, task, action }).collect()
    }

    /// Answers joined to their proposals; an error names an answer that nothing asked for.
    fn trials_of(&self, proposals: &[Proposal], answers: &[Answer]) -> Result<Vec<Trial>> {
        let trial = |answer: &Answer| {
            let asked = proposals.iter().find(|p| p.number == answer.number).ok_or_else(|| {
                let numbers = proposals.first().zip(proposals.last());
                let allowed = numbers.map_or("none".into(), |(a, b)| format!("{} to {}", a.number, b.number));
                Error::input("number", answer.number, format!("the number of an open proposal: {allowed}"))
            })?;
            Ok(Trial {
                name: format!("{}/{}", asked.task, asked.number),
                setting: None,
                scene: self.placed(asked)?,
                observed: answer.observed.clone(),
            })
        };
        answers.iter().map(trial).collect()
    }

    /// Whether the last two rounds moved neither friction nor restitution noticeably. Density is left out: in
    /// tasks of one composition it cancels, and would wander for ever.
    fn has_settled(&self) -> bool {
        let [.., a, b, c] = &self.rounds[..] else { return false };
        let moved = |from: &Round, to: &Round| {
            let (from, to) = (self.estimate_at(from), self.estimate_at(to));
            (1..3).map(|i| (to[i] - from[i]).abs() / self.config.cem.prior[i].1).fold(0.0, f64::max)
        };
        let settled = self.config.settled;
        settled > 0.0 && moved(a, b) < settled && moved(b, c) < settled
    }

    fn estimate_at(&self, round: &Round) -> Sample {
        let searched = || Cem::at(self.config.cem.clone(), &round.search).map(|cem| cem.estimate());
        round.refined.clone().unwrap_or_else(|| searched().unwrap_or_else(|_| round.search.mean.clone()))
    }

    fn found(&self) -> Found {
        Found {
            residuals: self.rounds.iter().filter_map(|r| r.residual).collect(),
            estimates: self.estimates(),
            choices: self.rounds.iter().map(|r| r.choice.clone()).collect(),
            rollouts: self.rounds.iter().map(|r| r.rollouts).sum(),
            real_interactions: self.trials.len() as u64,
            stopped: self.ended.unwrap_or(Stopped::Unfinished),
        }
    }

    fn staged<'a>(&self, inner: &'a dyn Progress) -> Staged<'a> {
        Staged { inner, round: self.rounds.len(), rounds: self.config.rounds }
    }
}

impl Proposal {
    /// The action, checked against the task it is for.
    pub fn action_on(&self, task: &Task) -> Result<ValidAction> {
        task.actions().validate(&self.action)
    }
}
