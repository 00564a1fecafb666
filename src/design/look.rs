//! Looks at candidates: what each would tell, and what happens in it.

use rayon::prelude::*;

use super::config::DesignConfig;
use super::gain::{Gain, Labels, over};
use super::question::Question;
use super::shown::{Copied, in_each, shown};
use super::told::Seen;
use super::worlds::Worlds;
use crate::budget::Endless;
use crate::error::{Error, Result};
use crate::estimate::Belief;
use crate::plan::{PlanConfig, plan};
use crate::progress::Progress;
use crate::rng;
use crate::task::{Placement, Task, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::{Rollout, simulate_within};

/// Candidates that are simulated together.
const TOGETHER: usize = 8;
/// Tasks whose success is asked about, at most, and the actions of each plan that are.
const ASKED: [usize; 2] = [8, 3];
/// Actions and rollouts of such a plan.
const PLANNED: [usize; 2] = [1500, 12_000];
/// Worlds in which contacts are counted.
const COUNTED: usize = 16;

/// An action that may be done: the number of its task, and its copies.
pub type Candidate = (usize, ValidAction, Copied);

/// A search under way.
pub struct Search<'a> {
    pub config: &'a DesignConfig,
    pub belief: &'a Belief,
    pub asked: &'a [Task],
    /// Of the tasks asked about: the number of the task, and an action that is planned for it.
    pub planned: Vec<(usize, ValidAction)>,
    pub rollouts: usize,
    pub progress: &'a dyn Progress,
}

impl Search<'_> {
    /// What every candidate tells, of which `keep` keeps what is needed.
    pub fn look<T: Send>(
        &mut self,
        stage: &str,
        candidates: &[Candidate],
        (worlds, labels): (&Worlds, &[Labels]),
        keep: impl Fn(Seen, Gain) -> T + Sync,
    ) -> Result<Vec<T>> {
        let mut found = Vec::with_capacity(candidates.len());
        for (part, chunk) in candidates.chunks(TOGETHER).enumerate() {
            self.progress.report(stage, found.len() as u64, candidates.len() as u64)?;
            let copied: Vec<&Copied> = chunk.iter().map(|(_, _, c)| c).collect();
            let seen = shown(&copied, &worlds.worlds, self.config.engine, &Endless)?;
            self.rollouts += chunk.len() * worlds.worlds.len() * (self.config.copies + 1);
            let first = part * TOGETHER;
            let own = seen.into_par_iter().enumerate().map(|(i, shown)| {
                let seed = rng::derive(self.config.seed, stage, (first + i) as u64);
                let mut noise = rng::stream(seed, "design noise");
                let seen = Seen::new(&shown, worlds.alike(), self.config.noise, &mut noise);
                let gain = over(&seen.told(worlds.alike())?, labels);
                Ok(keep(seen, gain))
            });
            found.append(&mut own.collect::<Result<Vec<T>>>()?);
        }
        Ok(found)
    }

    /// Which worlds answer alike: one way for all that is asked.
    pub fn labels(&mut self, worlds: &Worlds) -> Result<Vec<Labels>> {
        Ok(match self.config.question {
            Question::Latents => vec![Labels::Own],
            Question::Effects => {
                vec![Labels::Shared { of: worlds.groups.clone(), weights: worlds.weights.clone() }]
            }
            Question::Success => self.success(worlds)?,
        })
    }

    /// Worlds in which what is planned solves, and those in which it does not.
    fn success(&mut self, worlds: &Worlds) -> Result<Vec<Labels>> {
        self.plan()?;
        let mut scenes = Vec::with_capacity(self.planned.len());
        for (task, action) in &self.planned {
            if let Placement::Valid(scene) = self.asked[*task].place(action) {
                scenes.push(*scene);
            }
        }
        let rollouts: Vec<Rollout> = scenes.iter().flat_map(|scene| in_each(scene, &worlds.worlds)).collect();
        self.rollouts += rollouts.len();
        let solved = simulate_within(&Endless, &rollouts, self.config.engine, |_, t| t.solved())?;
        let of = |solved: &[bool]| {
            let share = solved.iter().filter(|s| **s).count() as f64 / solved.len() as f64;
            Labels::Shared {
                of: solved.iter().map(|s| usize::from(*s)).collect(),
                weights: vec![1.0 - share, share],
            }
        };
        Ok(solved.chunks(worlds.worlds.len()).map(of).collect())
    }

    /// Plans some of the tasks that are asked about, once.
    fn plan(&mut self) -> Result<()> {
        if !self.planned.is_empty() {
            return Ok(());
        }
        if self.asked.is_empty() {
            return Err(Error::input("question", "\"success\"", "tasks whose success is asked about"));
        }
        let [most, each] = ASKED;
        let count = most.min(self.asked.len());
        let setup = PlanConfig {
            actions: PLANNED[0],
            rollouts: Some(PLANNED[1]),
            exact: each,
            engine: self.config.engine,
            perturb: self.config.perturb,
            ..PlanConfig::standard(self.config.seed)
        };
        for k in 0..count {
            self.progress.report("planning what is asked about", k as u64, count as u64)?;
            let task = k * self.asked.len() / count;
            let found = plan(&self.asked[task], self.belief, &setup, &Endless, self.progress)?;
            self.rollouts += found.rollouts;
            self.planned.extend(found.ranked.into_iter().take(each).map(|r| (task, r.action)));
        }
        Ok(())
    }

    /// By candidate, collisions and seconds of rolling, means over some worlds.
    pub fn happens(
        &mut self,
        tasks: &[Task],
        candidates: &[Candidate],
        worlds: &Worlds,
    ) -> Result<Vec<[f64; 2]>> {
        let few = &worlds.worlds[..worlds.worlds.len().min(COUNTED)];
        let mut scenes = Vec::with_capacity(candidates.len());
        for (task, action, _) in candidates {
            match tasks[*task].place(action) {
                Placement::Valid(scene) => scenes.push(*scene),
                Placement::Invalid(reason) => return Err(Error::Failed(reason)),
            }
        }
        let rollouts: Vec<Rollout> = scenes.iter().flat_map(|scene| in_each(scene, few)).collect();
        self.rollouts += rollouts.len();
        let count = |i: usize, t: Trajectory| {
            [f64::from(t.collisions), f64::from(t.rolling_steps) * rollouts[i].scene.time_step]
        };
        let counts = simulate_within(&Endless, &rollouts, self.config.engine, count)?;
        let mean = |own: &[[f64; 2]]| {
            let sum = own.iter().fold([0.0; 2], |s, c| [s[0] + c[0], s[1] + c[1]]);
            sum.map(|s| s / own.len() as f64)
        };
        Ok(counts.chunks(few.len()).map(mean).collect())
    }
}
