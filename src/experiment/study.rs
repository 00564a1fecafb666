//! The paper's transfer figures: policies grounded in different ways, compared in one hidden world.
//!
//! Source: Semage et al., experiments on bowling and basketball: estimates from 5 seeds, 3 learning trials each.
//! A [`Study`] is what is compared; it is cut into [`Estimated`] and [`Transfer`] cells, so that whoever runs it
//! can keep them and go on later. Uncertainty counts estimate seeds, not learning trials, as repetitions: trials
//! that share an estimate are not independent.
//!
//! Differences from the source: every estimate seed has a fold of its own (the tasks dealt anew to training and test, as
//! PHYRE does), so that intervals hold for other tasks, too: with a single split, one hard test task of five decides.
//! The first experiment's search draws 200 samples a round, not 1000. Rows past the paper stand beside it (a
//! simulation extended by what a diagnosis finds, or by the drag that it lacks, fitted along; the real world's own ranking).

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::extension::{self, Extension, diagnosed};
use super::past_point::{self, BY_POLICIES, POLICIES, PastPoint};
pub use super::rows::{Row, SMALL_AUCCESS};
use super::rows::{ahead, near_the_oracle};
use super::statistics::{Claim, Summary};
use super::strategies::{Arm, Nature};
use super::transfer::{LearnConfig, School, Transfer, TransferConfig, transfer};
use super::{EstimateConfig, Memory, ResidualKind, Workflow, run};
use crate::error::{Error, Result};
use crate::estimate::CemConfig;
use crate::explore::Importance;
use crate::policy::Training;
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld};
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{Ahead, Family, Split, Task, split};
use crate::world::DRAG;
use crate::world::{Engine, Sample};

/// What is compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// Name of the experiment.
    pub name: String,
    /// Name of the task family.
    pub family: String,
    /// The real world.
    pub hidden: HiddenConfig,
    /// Policies that need no estimate.
    pub schools: Vec<(String, School)>,
    /// Ways to estimate; a policy is trained in the simulation of the estimate after each of `rounds`.
    pub arms: Vec<Arm>,
    /// Rounds after which policies are trained, from 1.
    pub rounds: Vec<usize>,
    /// Names of arms whose trials are diagnosed after the last round; a policy is trained in the simulation extended
    /// by what is found.
    #[serde(default)]
    pub diagnosed: Vec<String>,
    /// Names of arms whose trials are worth more than the point: a policy is trained over the draws of their posterior, and one at the
    /// point after the last round is tuned on what was measured.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub past_point: Vec<String>,
    /// How policies are made and tried.
    pub transfer: TransferConfig,
    /// One estimate for each, and one fold of the tasks.
    pub seeds: Vec<u64>,
    /// Learning trials for each estimate.
    pub trials: u64,
}

/// What an arm knew after each round, for one seed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimated {
    pub estimates: Vec<Sample>,
    /// Real interactions after each round.
    pub interactions: Vec<u64>,
    /// What a diagnosis of all trials found, if the study asks for one.
    #[serde(default)]
    pub extension: Option<Extension>,
    /// Draws and labels, if the study asks for them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub past_point: Option<PastPoint>,
}

/// One policy to be made and tried.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cell {
    /// Row of the table it belongs to.
    pub row: String,
    /// Round of the estimate; `None` for a policy without one.
    pub round: Option<usize>,
    pub school: School,
    pub seed: u64,
    pub trial: u64,
    /// Real interactions the estimate cost.
    pub interactions: u64,
}

impl Study {
    /// The paper's first experiment: latents from 10,000 random real trajectories against the baselines.
    pub fn latents(family: &Family) -> Study {
        let paper = EstimateConfig::paper(family.prior);
        let random = EstimateConfig {
            strategy: "random".into(),
            actions: 1000,
            candidates: 1000,
            memory: Memory::LastRound,
            // A fifth of the paper's samples, for the time it takes; what that costs in accuracy has not been measured.
            cem: CemConfig { samples: 200, elites: 40, ..paper.cem.clone() },
            ..paper
        };
        let arm = |name: &str, estimate: EstimateConfig| Arm { name: name.into(), estimate };
        let mut study = Study::base(LATENTS, family);
        study.arms = vec![
            arm(BY_SEARCH, random.clone()),
            arm("CEM on random trajectories, drag fitted along", with_drag(random)),
        ];
        study.rounds = vec![10];
        study.schools.insert(1, (DIRECT.into(), School::Direct));
        study.transfer.learn = Some(LearnConfig::paper());
        study
    }

    /// The comparison of strategies by jump start.
    pub fn strategies(family: &Family) -> Study {
        let mut study = Study::base(family.name, family);
        let paper = |name: &str| Arm {
            name: name.into(),
            estimate: EstimateConfig { strategy: name.into(), ..EstimateConfig::paper(family.prior) },
        };
        study.arms = crate::explore::REGISTRY.iter().map(|s| paper(s.name())).collect();
        let few =
            EstimateConfig { rounds: 10, actions: 5, settled: 0.0, ..EstimateConfig::fast(family.prior) };
        let ours = EstimateConfig {
            strategy: "informative".into(),
            residual: ResidualKind::Shooting,
            ..few.clone()
        };
        study.arms.push(Arm { name: "informative, shooting, 5 a round".into(), estimate: ours });
        study.arms.push(Arm { name: "extended by linear drag, 5 a round".into(), estimate: with_drag(few) });
        study.diagnosed = vec!["informative, shooting, 5 a round".into()];
        study.rounds = (1..=10).collect();
        study
    }

    /// Real worlds that lack other things than drag, past the paper: one study each. The extension that is fitted
    /// along knows linear drag alone, so these show what a wrong extension is worth.
    pub fn harder(family: &Family) -> Vec<Study> {
        let term = |name: &str, parameters: &[(&str, f64)]| EffectTerm {
            name: name.into(),
            parameters: parameters.iter().map(|(k, v)| (k.to_string(), *v)).collect(),
        };
        // A strong breeze; a ball that loses half its speed in 25 m; carpet on the middle of the floor.
        let patch = [("x_min", 14.0), ("x_max", 28.0), ("y_min", 0.0), ("y_max", 6.0), ("c", 2.0)];
        let natures = [
            ("wind", vec![term("wind", &[("ax", 1.0), ("ay", 0.0)])], Engine::Auto),
            ("quadratic_drag", vec![term("quadratic_drag", &[("k", 0.028)])], Engine::Auto),
            ("sticky_patch", vec![term("sticky_patch", &patch)], Engine::Auto),
            ("other_engine", Nature::Damped.hidden(family, 0).effects, Engine::Rapier),
        ];
        natures
            .into_iter()
            .map(|(name, effects, engine)| {
                let mut study = Study::base(name, family);
                study.hidden = HiddenConfig { effects: effects.clone(), engine, ..study.hidden };
                for (row, school) in &mut study.schools {
                    if row == TRUE_PHYSICS {
                        let training =
                            Training::Fixed { latents: study.hidden.latents, effects: effects.clone() };
                        *school = School::Simulated { training };
                    }
                }
                let few = EstimateConfig {
                    rounds: 5,
                    actions: 10,
                    settled: 0.0,
                    ..EstimateConfig::fast(family.prior)
                };
                study.arms = vec![
                    Arm { name: "mixed".into(), estimate: few.clone() },
                    Arm { name: "extended by linear drag".into(), estimate: with_drag(few) },
                ];
                study.rounds = vec![5];
                study.diagnosed = vec!["mixed".into()];
                study
            })
            .collect()
    }

    /// A small run of the same shape, for a look.
    pub fn quick(mut self, family: &Family) -> Study {
        let learn = self.transfer.learn.take();
        self.transfer = TransferConfig::quick(family);
        self.transfer.learn = learn.map(|l| LearnConfig { evaluations: 2, ..l });
        self.seeds.truncate(2);
        self.trials = 1;
        for arm in &mut self.arms {
            let e = &mut arm.estimate;
            (e.rounds, e.actions) = (e.rounds.min(3), e.actions.min(20));
            e.candidates = e.candidates.min(100);
            (e.cem.samples, e.cem.elites) = (e.cem.samples.min(200), e.cem.elites.min(40));
        }
        self.rounds.retain(|r| *r == 1 || *r == 3);
        if self.rounds.is_empty() {
            self.rounds = vec![3];
        }
        self
    }

    /// Errors name what is wrong.
    pub fn validate(&self) -> Result<()> {
        if self.seeds.is_empty() || self.trials == 0 {
            return Err(Error::input("seeds or trials", "none", "at least one"));
        }
        self.transfer.validate().map_err(|e| e.under("transfer"))?;
        self.arms.iter().try_for_each(|a| a.estimate.validate().map_err(|e| e.under(&a.name)))
    }

    /// The tasks of a seed: the fold that has the seed's place among the study's.
    pub fn tasks(&self, family: &Family, seed: u64) -> Vec<Task> {
        let fold = self.seeds.iter().position(|s| *s == seed).unwrap_or(0);
        family.fold(fold as u64)
    }

    /// Whether any arm's strategy needs a performance surface.
    pub fn needs_importance(&self) -> bool {
        self.arms.iter().any(Arm::needs_importance)
    }

    /// The policies to make, given what was estimated: `estimated[arm][seed]`.
    pub fn cells(&self, estimated: &[Vec<Estimated>]) -> Vec<Cell> {
        let mut cells = Vec::new();
        for (s, seed) in self.seeds.iter().enumerate() {
            for trial in 0..self.trials {
                let cell = |row: &str, round, school, interactions| Cell {
                    row: row.into(),
                    round,
                    school,
                    seed: *seed,
                    trial,
                    interactions,
                };
                cells.extend(self.schools.iter().map(|(name, school)| cell(name, None, school.clone(), 0)));
                for (arm, found) in self.arms.iter().zip(estimated) {
                    for round in self.rounds.iter().filter(|r| **r <= found[s].estimates.len()) {
                        let school = grounded(&arm.estimate, &found[s].estimates[round - 1]);
                        cells.push(cell(&arm.name, Some(*round), school, found[s].interactions[round - 1]));
                    }
                    let (last, spent) = (self.rounds.last().copied(), found[s].interactions.last());
                    let spent = spent.copied().unwrap_or(0);
                    let mut after = |row: &str, school| cells.push(cell(row, last, school, spent));
                    if let Some(extension) = &found[s].extension {
                        let school = School::Simulated { training: extension.training() };
                        after(&extended(&arm.name), school);
                    }
                    if let (Some(more), Some(point)) = (&found[s].past_point, found[s].estimates.last()) {
                        let training = Training::Believed { draws: more.draws.clone() };
                        after(&past_point::over_draws(&arm.name), School::Simulated { training });
                        let (training, measured) = (at(&arm.estimate, point), more.measured.clone());
                        after(&past_point::tuned(&arm.name), School::Tuned { training, measured });
                    }
                }
            }
        }
        cells
    }

    /// The table, rows in the study's order; `results` belong to `cells` one to one.
    pub fn rows(&self, cells: &[Cell], results: &[Transfer]) -> Vec<Row> {
        let names = self
            .schools
            .iter()
            .map(|(name, _)| (name, None))
            .chain(self.arms.iter().flat_map(|a| self.rounds.iter().map(move |r| (&a.name, Some(*r)))))
            .map(|(name, round)| (name.clone(), round))
            .chain(self.afterwards().map(|name| (name, self.rounds.last().copied())));
        names
            .filter_map(|(name, round)| {
                let mine: Vec<(&Cell, &Transfer)> =
                    cells.iter().zip(results).filter(|(c, _)| c.row == name && c.round == round).collect();
                let (_, first) = mine.first()?;
                let by_seed = |point: usize| -> Vec<f64> {
                    let of = |seed: &u64| {
                        let all: Vec<f64> = mine
                            .iter()
                            .filter(|(c, _)| c.seed == *seed)
                            .map(|(_, t)| t.points[point].auccess)
                            .collect();
                        (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
                    };
                    self.seeds.iter().filter_map(of).collect()
                };
                let points = mine.iter().map(|(_, t)| t.points.len()).min().unwrap_or(0);
                Some(Row {
                    name,
                    round,
                    interactions: mine.iter().map(|(c, _)| c.interactions as f64).sum::<f64>()
                        / mine.len() as f64,
                    jump_start: Summary::of(&by_seed(0)),
                    by_seed: by_seed(0),
                    curve: (0..points).map(|p| (first.points[p].batches, Summary::of(&by_seed(p)))).collect(),
                })
            })
            .collect()
    }

    /// What the rows say of the paper's claims about this study and the family's jump starts, and of ours.
    pub fn claims(&self, family: &Family, rows: &[Row]) -> Vec<Claim> {
        let own: &[Ahead] = match self.name.as_str() {
            LATENTS => BY_LATENTS,
            POLICIES => BY_POLICIES,
            _ => family.claims.jump_starts,
        };
        let stated = BY_ALL.iter().chain(own).filter_map(|claim| ahead(claim, rows));
        stated.chain(near_the_oracle(rows, TRUE_PHYSICS)).collect()
    }

    /// Rows of policies that are made once, after an arm's last round.
    pub fn afterwards(&self) -> impl Iterator<Item = String> {
        let past = self.past_point.iter();
        let two = past.flat_map(|name| [past_point::over_draws(name), past_point::tuned(name)]);
        self.diagnosed.iter().map(|name| extended(name)).chain(two)
    }

    /// Baselines, seeds and trials that every study has.
    pub(super) fn base(name: &str, family: &Family) -> Study {
        let hidden = Nature::Damped.hidden(family, 0);
        let simulated = |training: Training| School::Simulated { training };
        let fixed = |effects| simulated(Training::Fixed { latents: hidden.latents, effects });
        Study {
            name: name.into(),
            family: family.name.into(),
            schools: vec![
                ("chance".into(), School::Chance),
                (RANDOMISED.into(), simulated(Training::paper_randomised(Vec::new()))),
                (TRUE_LATENTS.into(), fixed(Vec::new())),
                (TRUE_PHYSICS.into(), fixed(hidden.effects.clone())),
                ("best possible".into(), School::Itself),
            ],
            hidden,
            arms: Vec::new(),
            rounds: Vec::new(),
            diagnosed: Vec::new(),
            past_point: Vec::new(),
            transfer: TransferConfig::paper(family),
            seeds: vec![50, 100, 150, 500, 1000],
            trials: 3,
        }
    }
}

/// Name of the paper's first experiment.
pub const LATENTS: &str = "latents";
const RANDOMISED: &str = "domain randomisation";
const TRUE_LATENTS: &str = "true latents";
const TRUE_PHYSICS: &str = "true latents and effects";
const BY_SEARCH: &str = "CEM on random trajectories";
const DIRECT: &str = "direct learning";

/// What every study checks: it is about its baselines.
const BY_ALL: &[Ahead] =
    &[Ahead { text: "true latents beat domain randomisation", better: TRUE_LATENTS, worse: RANDOMISED }];
/// What the paper's first experiment is about.
const BY_LATENTS: &[Ahead] = &[
    Ahead { text: "estimated latents beat domain randomisation", better: BY_SEARCH, worse: RANDOMISED },
    Ahead { text: "estimated latents beat direct learning at the start", better: BY_SEARCH, worse: DIRECT },
];

/// Runs one arm's estimation on the training tasks, and the diagnosis of its trials if there is to be one.
pub fn estimated(
    family: &Family,
    study: &Study,
    arm: &Arm,
    seed: u64,
    importance: Option<Arc<dyn Importance>>,
    progress: &dyn Progress,
) -> Result<Estimated> {
    let diagnose = study.diagnosed.contains(&arm.name);
    let training = split(&study.tasks(family, seed), Split::Train);
    let mut world = HiddenWorld::new(HiddenConfig { seed, ..study.hidden.clone() })?;
    let config = EstimateConfig { seed, ..arm.estimate.clone() };
    let mut workflow = Workflow::new(&training, &config, importance)?;
    run(&mut workflow, &mut world, progress, &mut |_| Ok(()))?;
    let estimates = workflow.estimates();
    let last = estimates.last().filter(|_| diagnose);
    let extension = match last {
        Some(estimate) => {
            let (_, finding) = diagnosed(workflow.trials(), &config, progress)?;
            let latents = config.cem.coordinates().latents(estimate);
            Some(extension::extended(&finding, workflow.trials(), &config, latents, progress)?)
        }
        None => None,
    };
    let wanted = study.past_point.contains(&arm.name);
    let past_point = wanted.then(|| PastPoint::of(&training, &workflow, progress)).transpose()?;
    Ok(Estimated { interactions: workflow.interactions(), estimates, extension, past_point })
}

/// Makes and tries one policy.
pub fn tried(
    family: &Family,
    study: &Study,
    cell: &Cell,
    progress: &dyn Progress,
) -> Result<(Transfer, Option<crate::policy::Dqn>)> {
    let seed = rng::derive(cell.seed, "learning trial", cell.trial);
    let tasks = study.tasks(family, cell.seed);
    transfer(&tasks, &cell.school, &study.hidden, &study.transfer, seed, progress)
}

/// Row of policies from an arm's extended simulation.
fn extended(arm: &str) -> String {
    format!("extended by diagnosis ({arm})")
}

/// Training in the simulation at an estimate, with the effects that were fitted along.
fn grounded(config: &EstimateConfig, estimate: &Sample) -> School {
    School::Simulated { training: at(config, estimate) }
}

/// One world: an estimate, with the effects that were fitted along.
fn at(config: &EstimateConfig, estimate: &Sample) -> Training {
    let coordinates = config.cem.coordinates();
    Training::Fixed { latents: coordinates.latents(estimate), effects: coordinates.effects(estimate, &[]) }
}

pub(super) fn with_drag(mut config: EstimateConfig) -> EstimateConfig {
    config.cem.fit_along(DRAG);
    config
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::families;

    /// A claim about a row that a study does not have would be left out silently.
    #[test]
    fn every_claim_about_jump_starts_can_be_checked() {
        for family in families() {
            let check = |study: Study, claims: &[Ahead]| {
                let schools = study.schools.iter().map(|(name, _)| name);
                let arms = study.arms.iter().map(|a| &a.name);
                let rows: Vec<String> = schools.chain(arms).cloned().chain(study.afterwards()).collect();
                for claim in claims.iter().chain(BY_ALL) {
                    let row = |name: &str| rows.iter().any(|r| *r == name);
                    assert!(row(claim.better) && row(claim.worse), "{}: {}", study.name, claim.text);
                }
            };
            check(Study::strategies(family), family.claims.jump_starts);
            check(Study::latents(family), BY_LATENTS);
            check(Study::policies(family), BY_POLICIES);
        }
    }
}
