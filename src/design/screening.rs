//! Screening of candidates: expected information gain and contact statistics of each.

use rayon::prelude::*;

use super::config::DesignConfig;
use super::gain::{AnswerPartition, InformationGain, mean_information_gain};
use super::likelihood::ComponentScores;
use super::predicted_observations::{PerturbedAction, predict_observations, rollouts_in};
use super::question::Question;
use super::worlds::SampledWorlds;
use crate::error::{Error, Result};
use crate::estimate::ParameterSamples;
use crate::plan::{PlanConfig, plan};
use crate::progress::Progress;
use crate::rng;
use crate::task::{Placement, Task, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::{Rollout, Simulator};

/// Candidates simulated in one batch.
const CANDIDATES_PER_BATCH: usize = 8;
/// For the question of success: maximal number of tasks, and of actions of each task's plan.
const MAX_TASKS_AND_ACTIONS: [usize; 2] = [8, 3];
/// Actions and rollouts of such a plan.
const PLAN_ACTIONS_AND_ROLLOUTS: [usize; 2] = [1500, 12_000];
/// Maximal number of worlds in which contacts are counted.
const MAX_CONTACT_WORLDS: usize = 16;

/// A candidate: index of its task, action, and perturbed copies.
pub type DesignCandidate = (usize, ValidAction, PerturbedAction);

/// State of a design search.
pub struct CandidateScreening<'a> {
    pub config: &'a DesignConfig,
    pub belief: &'a ParameterSamples,
    pub test_tasks: &'a [Task],
    /// Planned actions, each with the index of its task, for the question of success.
    pub planned_actions: Vec<(usize, ValidAction)>,
    pub rollouts: usize,
    pub progress: &'a dyn Progress,
}

impl CandidateScreening<'_> {
    /// Evaluates every candidate; `keep` extracts the result that is needed. `stage` labels the progress and the noise stream.
    pub fn screen<T: Send>(
        &mut self,
        stage: &str,
        candidates: &[DesignCandidate],
        (worlds, labels): (&SampledWorlds, &[AnswerPartition]),
        keep: impl Fn(ComponentScores, InformationGain) -> T + Sync,
    ) -> Result<Vec<T>> {
        let mut results = Vec::with_capacity(candidates.len());
        for (part, chunk) in candidates.chunks(CANDIDATES_PER_BATCH).enumerate() {
            self.progress.report(stage, results.len() as u64, candidates.len() as u64)?;
            let copied: Vec<&PerturbedAction> = chunk.iter().map(|(_, _, c)| c).collect();
            let predictions =
                predict_observations(&copied, &worlds.worlds, self.config.engine, &self.progress)?;
            self.rollouts += chunk.len() * worlds.worlds.len() * (self.config.copies + 1);
            let first = part * CANDIDATES_PER_BATCH;
            let progress = self.progress;
            let own = predictions.into_par_iter().enumerate().map(|(i, shown)| {
                progress.check_stop()?;
                let seed = rng::derive_seed(self.config.seed, stage, (first + i) as u64);
                let mut noise = rng::stream(seed, "design noise");
                let predictions =
                    ComponentScores::new(&shown, worlds.grouping(), self.config.noise, &mut noise);
                let gain = mean_information_gain(&predictions.likelihoods(worlds.grouping())?, labels);
                Ok(keep(predictions, gain))
            });
            results.append(&mut own.collect::<Result<Vec<T>>>()?);
        }
        Ok(results)
    }

    /// Partitions of the worlds, one for each question.
    pub fn partitions(&mut self, worlds: &SampledWorlds) -> Result<Vec<AnswerPartition>> {
        Ok(match self.config.question {
            Question::Latents => vec![AnswerPartition::Distinct],
            Question::Effects => {
                vec![AnswerPartition::Shared { of: worlds.groups.clone(), weights: worlds.weights.clone() }]
            }
            Question::Success => self.success_partitions(worlds)?,
        })
    }

    /// Partitions of the worlds by whether each planned action solves its task.
    fn success_partitions(&mut self, worlds: &SampledWorlds) -> Result<Vec<AnswerPartition>> {
        self.plan()?;
        let mut scenes = Vec::with_capacity(self.planned_actions.len());
        for (task, action) in &self.planned_actions {
            if let Placement::Valid(scene) = self.test_tasks[*task].place(action) {
                scenes.push(*scene);
            }
        }
        let rollouts: Vec<Rollout> =
            scenes.iter().flat_map(|scene| rollouts_in(scene, &worlds.worlds)).collect();
        self.rollouts += rollouts.len();
        let solved = Simulator::new(self.config.engine).budget(&self.progress).solved(&rollouts)?;
        let of = |solved: &[bool]| {
            let share = solved.iter().filter(|s| **s).count() as f64 / solved.len() as f64;
            AnswerPartition::Shared {
                of: solved.iter().map(|s| usize::from(*s)).collect(),
                weights: vec![1.0 - share, share],
            }
        };
        Ok(solved.chunks(worlds.worlds.len()).map(of).collect())
    }

    /// Plans some of the tasks whose success is the question, once.
    fn plan(&mut self) -> Result<()> {
        if !self.planned_actions.is_empty() {
            return Ok(());
        }
        if self.test_tasks.is_empty() {
            let allowed = "latents or effects: there are no tasks to plan for";
            return Err(Error::input("question", "\"success\"", allowed));
        }
        let [most, each] = MAX_TASKS_AND_ACTIONS;
        let count = most.min(self.test_tasks.len());
        let setup = PlanConfig {
            actions: PLAN_ACTIONS_AND_ROLLOUTS[0],
            rollouts: Some(PLAN_ACTIONS_AND_ROLLOUTS[1]),
            exact: each,
            engine: self.config.engine,
            perturb: self.config.perturb,
            ..PlanConfig::standard(self.config.seed)
        };
        for k in 0..count {
            self.progress.report("planning test tasks", k as u64, count as u64)?;
            let task = k * self.test_tasks.len() / count;
            let results = plan(&self.test_tasks[task], self.belief, &setup, &self.progress, self.progress)?;
            self.rollouts += results.rollouts;
            self.planned_actions.extend(results.ranked.into_iter().take(each).map(|r| (task, r.action)));
        }
        Ok(())
    }

    /// Collisions and seconds of rolling of each candidate, means over some worlds.
    pub fn contact_statistics(
        &mut self,
        tasks: &[Task],
        candidates: &[DesignCandidate],
        worlds: &SampledWorlds,
    ) -> Result<Vec<[f64; 2]>> {
        let few = &worlds.worlds[..worlds.worlds.len().min(MAX_CONTACT_WORLDS)];
        let mut scenes = Vec::with_capacity(candidates.len());
        for (task, action, _) in candidates {
            match tasks[*task].place(action) {
                Placement::Valid(scene) => scenes.push(*scene),
                Placement::Invalid(reason) => return Err(Error::Failed(reason)),
            }
        }
        let rollouts: Vec<Rollout> = scenes.iter().flat_map(|scene| rollouts_in(scene, few)).collect();
        self.rollouts += rollouts.len();
        let count = |i: usize, t: Trajectory| {
            [f64::from(t.collisions), f64::from(t.rolling_steps) * rollouts[i].scene.time_step]
        };
        let counts = Simulator::new(self.config.engine).budget(&self.progress).map(&rollouts, count)?;
        let mean = |own: &[[f64; 2]]| {
            let sum = own.iter().fold([0.0; 2], |s, c| [s[0] + c[0], s[1] + c[1]]);
            sum.map(|s| s / own.len() as f64)
        };
        Ok(counts.chunks(few.len()).map(mean).collect())
    }
}
