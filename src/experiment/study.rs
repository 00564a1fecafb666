//! The paper's transfer experiments: policies from different sources, compared in one hidden world.
//!
//! Source: Semage et al., experiments on bowling and basketball: estimates from 5 seeds, 3 learning trials each.
//! A [`Study`] defines the comparison; it consists of [`ArmEstimate`] and [`Transfer`] cells, so that the caller can store them and
//! resume. Repetitions for the standard errors are estimate seeds, not learning trials, since trials that share an estimate are not
//! independent.
//!
//! Differences from the source: every estimate seed has its own fold (a new split of the tasks into training and test, as in PHYRE), so
//! that confidence intervals generalise to other tasks; with a single split, one hard test task of five would dominate. The first
//! experiment's search draws 200 samples per round instead of 1000. Additional rows go beyond the paper: a simulation extended by a
//! diagnosis or by fitted drag, and the real world's own ranking.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::estimate_accuracy::FinalEstimates;
use super::extension::{self, Extension, diagnose_trials};
use super::posterior_training::{self, POLICIES, POLICY_CLAIMS, PosteriorTrainingData};
pub use super::rows::{MIN_RELEVANT_AUCCESS_DIFFERENCE, StudyRow};
use super::rows::{jump_start_claim, oracle_claims};
use super::statistics::{Claim, Summary};
use super::strategies::{Arm, WorldVariant};
use super::transfer::{LearnConfig, PolicySource, Transfer, TransferConfig, transfer};
use super::{EstimateConfig, Memory, ResidualKind, Workflow, run};
use crate::error::{Error, Result};
use crate::estimate::CemConfig;
use crate::explore::Importance;
use crate::policy::TrainingPhysics;
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld};
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::task::{Family, JumpStartClaim, Split, Task, split};
use crate::world::LINEAR_DRAG;
use crate::world::{Engine, Latents, ParameterVector};

/// Definition of a comparison.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// Name of the experiment.
    pub name: String,
    /// Name of the task family.
    pub family: String,
    /// Hidden real world.
    pub hidden: HiddenConfig,
    /// Policy sources that need no estimate.
    pub schools: Vec<(String, PolicySource)>,
    /// Arms of the estimation; a policy is trained in the simulation at the estimate after each of `rounds`.
    pub arms: Vec<Arm>,
    /// Rounds after which policies are trained, counted from 1.
    pub rounds: Vec<usize>,
    /// Names of arms whose trials are diagnosed after the last round; a policy is trained in the simulation extended by the
    /// diagnosis.
    #[serde(default)]
    pub diagnosed: Vec<String>,
    /// Names of arms with training beyond the point estimate: one policy is trained over posterior draws, and the policy at the last
    /// point estimate is fine-tuned on the measured outcomes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub past_point: Vec<String>,
    /// Training and evaluation of policies.
    pub transfer: TransferConfig,
    /// Seeds: one estimate and one fold of the tasks each.
    pub seeds: Vec<u64>,
    /// Learning trials per estimate; 0 for estimates without policies.
    pub trials: u64,
}

/// Estimates of an arm after each round, for one seed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ArmEstimate {
    pub estimates: Vec<ParameterVector>,
    /// Real interactions after each round.
    pub interactions: Vec<u64>,
    /// Extension by a diagnosis of all trials, if the study requests one.
    #[serde(default)]
    pub extension: Option<Extension>,
    /// Posterior draws and measured outcomes, if the study requests them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub past_point: Option<PosteriorTrainingData>,
}

/// One policy to train and evaluate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StudyCell {
    /// Row of the table.
    pub row: String,
    /// Round of the estimate; `None` for a policy without estimate.
    pub round: Option<usize>,
    pub school: PolicySource,
    pub seed: u64,
    pub trial: u64,
    /// Real interactions used for the estimate.
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
            // A fifth of the paper's samples, to reduce the run time; the effect on accuracy has not been measured.
            cem: CemConfig { samples: 200, elites: 40, ..paper.cem.clone() },
            ..paper
        };
        let arm = |name: &str, estimate: EstimateConfig| Arm { name: name.into(), estimate };
        let mut study = Study::base(LATENTS, family);
        study.arms = vec![
            arm(CEM_ARM, random.clone()),
            arm("CEM on random trajectories, drag fitted along", with_drag(random)),
        ];
        study.rounds = vec![10];
        study.schools.insert(1, (DIRECT.into(), PolicySource::Direct));
        study.transfer.learn = Some(LearnConfig::paper());
        study
    }

    /// Comparison of strategies by jump start.
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

    /// Studies beyond the paper: one for each real world with an effect other than linear drag. Since the fitted extension is linear drag,
    /// they show the performance of a misspecified extension.
    pub fn harder(family: &Family) -> Vec<Study> {
        let term = EffectTerm::new;
        // Strong breeze; drag that halves the speed in 25 m; carpet on the middle of the floor.
        let patch = [("x_min", 14.0), ("x_max", 28.0), ("y_min", 0.0), ("y_max", 6.0), ("c", 2.0)];
        let natures = [
            ("wind", vec![term("wind", &[("ax", 1.0), ("ay", 0.0)])], Engine::Auto),
            ("quadratic_drag", vec![term("quadratic_drag", &[("k", 0.028)])], Engine::Auto),
            ("sticky_patch", vec![term("sticky_patch", &patch)], Engine::Auto),
            ("other_engine", WorldVariant::Damped.hidden(family, 0).effects, Engine::Rapier),
        ];
        natures
            .into_iter()
            .map(|(name, effects, engine)| {
                let study = Study::base(name, family);
                let hidden = HiddenConfig { effects, engine, ..study.hidden.clone() };
                let mut study = study.in_world(hidden);
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

    /// A reduced study for a quick run.
    pub fn quick(mut self, family: &Family) -> Study {
        let learn = self.transfer.learn.take();
        self.transfer = TransferConfig::quick(family);
        self.transfer.learn = learn.map(|l| LearnConfig { evaluations: 2, ..l });
        self.seeds.truncate(2);
        self.trials = 1;
        for arm in &mut self.arms {
            arm.reduce(3, 20);
        }
        self.rounds.retain(|r| *r == 1 || *r == 3);
        if self.rounds.is_empty() {
            self.rounds = vec![3];
        }
        self
    }

    /// Errors name the invalid field.
    pub fn validate(&self) -> Result<()> {
        if self.seeds.is_empty() {
            return Err(Error::input("seeds", "none", "at least one"));
        }
        self.transfer.validate().map_err(|e| e.in_field("transfer"))?;
        self.arms.iter().try_for_each(|a| a.estimate.validate().map_err(|e| e.in_field(&a.name)))
    }

    /// The tasks of a seed: the fold with the seed's index among the study's seeds.
    pub fn tasks(&self, family: &Family, seed: u64) -> Vec<Task> {
        let fold = self.seeds.iter().position(|s| *s == seed).unwrap_or(0);
        family.fold(fold as u64)
    }

    /// Whether any arm's strategy needs a performance surface.
    pub fn needs_importance(&self) -> bool {
        self.arms.iter().any(Arm::needs_importance)
    }

    /// The policies to train, given the estimates `estimated[arm][seed]`.
    pub fn cells(&self, estimated: &[Vec<ArmEstimate>]) -> Vec<StudyCell> {
        let mut cells = Vec::new();
        for (s, seed) in self.seeds.iter().enumerate() {
            for trial in 0..self.trials {
                let cell = |row: &str, round, school, interactions| StudyCell {
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
                        let school = estimate_source(&arm.estimate, &found[s].estimates[round - 1]);
                        cells.push(cell(&arm.name, Some(*round), school, found[s].interactions[round - 1]));
                    }
                    let (last, spent) = (self.rounds.last().copied(), found[s].interactions.last());
                    let spent = spent.copied().unwrap_or(0);
                    let mut after = |row: &str, school| cells.push(cell(row, last, school, spent));
                    if let Some(extension) = &found[s].extension {
                        let school = PolicySource::Simulated { training: extension.training() };
                        after(&extended_row_name(&arm.name), school);
                    }
                    if let (Some(more), Some(point)) = (&found[s].past_point, found[s].estimates.last()) {
                        let training = TrainingPhysics::Posterior { draws: more.draws.clone() };
                        after(
                            &posterior_training::posterior_row_name(&arm.name),
                            PolicySource::Simulated { training },
                        );
                        let (training, measured) = (physics_at(&arm.estimate, point), more.measured.clone());
                        after(
                            &posterior_training::tuned_row_name(&arm.name),
                            PolicySource::Tuned { training, measured },
                        );
                    }
                }
            }
        }
        cells
    }

    /// The table, with rows in the study's order; `results[i]` is the result of `cells[i]`.
    pub fn rows(&self, cells: &[StudyCell], results: &[Transfer]) -> Vec<StudyRow> {
        let names = self
            .schools
            .iter()
            .map(|(name, _)| (name, None))
            .chain(self.arms.iter().flat_map(|a| self.rounds.iter().map(move |r| (&a.name, Some(*r)))))
            .map(|(name, round)| (name.clone(), round))
            .chain(self.afterwards().map(|name| (name, self.rounds.last().copied())));
        names
            .filter_map(|(name, round)| {
                let mine: Vec<(&StudyCell, &Transfer)> =
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
                Some(StudyRow {
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

    /// Estimates of every arm after its last round, given the estimates `estimated[arm][seed]`.
    pub fn final_estimates(&self, estimated: &[Vec<ArmEstimate>]) -> Vec<FinalEstimates> {
        let of = |(arm, found): (&Arm, &Vec<ArmEstimate>)| {
            let spent = found.iter().filter_map(|e| e.interactions.last()).sum::<u64>();
            FinalEstimates {
                arm: arm.name.clone(),
                interactions: spent as f64 / found.len() as f64,
                by_seed: found.iter().filter_map(|e| e.estimates.last().cloned()).collect(),
            }
        };
        self.arms.iter().zip(estimated).map(of).collect()
    }

    /// Verdicts on the paper's claims about this study and the family's jump starts, and on those of this project.
    pub fn claims(&self, family: &Family, rows: &[StudyRow]) -> Vec<Claim> {
        let own: &[JumpStartClaim] = match self.name.as_str() {
            LATENTS => LATENT_CLAIMS,
            POLICIES => POLICY_CLAIMS,
            _ => family.claims.jump_starts,
        };
        let stated = COMMON_CLAIMS.iter().chain(own).filter_map(|claim| jump_start_claim(claim, rows));
        stated.chain(oracle_claims(rows, TRUE_PHYSICS)).collect()
    }

    /// Names of rows for policies trained once, after an arm's last round.
    pub fn afterwards(&self) -> impl Iterator<Item = String> {
        let past = self.past_point.iter();
        let two = past.flat_map(|name| {
            [posterior_training::posterior_row_name(name), posterior_training::tuned_row_name(name)]
        });
        self.diagnosed.iter().map(|name| extended_row_name(name)).chain(two)
    }

    /// Baselines, seeds and trials common to all studies.
    pub(super) fn base(name: &str, family: &Family) -> Study {
        let hidden = WorldVariant::Damped.hidden(family, 0);
        let simulated = |training: TrainingPhysics| PolicySource::Simulated { training };
        let prior = Latents::of(family.prior_means());
        let fixed = |effects| simulated(TrainingPhysics::Fixed { latents: hidden.latents, effects });
        Study {
            name: name.into(),
            family: family.name.into(),
            schools: vec![
                ("chance".into(), PolicySource::Chance),
                (
                    UNCALIBRATED.into(),
                    simulated(TrainingPhysics::Fixed { latents: prior, effects: Vec::new() }),
                ),
                (RANDOMISED.into(), simulated(TrainingPhysics::paper_randomised(Vec::new()))),
                (TRUE_LATENTS.into(), fixed(Vec::new())),
                (TRUE_PHYSICS.into(), fixed(hidden.effects.clone())),
                ("best possible".into(), PolicySource::Itself),
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
const UNCALIBRATED: &str = "uncalibrated simulation";
const RANDOMISED: &str = "domain randomisation";
pub(super) const TRUE_LATENTS: &str = "true latents";
pub(super) const TRUE_PHYSICS: &str = "true latents and effects";
const CEM_ARM: &str = "CEM on random trajectories";
const DIRECT: &str = "direct learning";

/// Claims about the baselines, checked in every study.
const COMMON_CLAIMS: &[JumpStartClaim] =
    &[JumpStartClaim::new("true latents beat domain randomisation", TRUE_LATENTS, RANDOMISED)];
/// Claims of the paper's first experiment.
const LATENT_CLAIMS: &[JumpStartClaim] = &[
    JumpStartClaim::new("estimated latents beat domain randomisation", CEM_ARM, RANDOMISED),
    JumpStartClaim::new("estimated latents beat direct learning at the start", CEM_ARM, DIRECT),
];

/// Runs one arm's estimation on the training tasks and, if requested, the diagnosis of its trials.
pub fn estimate_arm(
    family: &Family,
    study: &Study,
    arm: &Arm,
    seed: u64,
    importance: Option<Arc<dyn Importance>>,
    progress: &dyn Progress,
) -> Result<ArmEstimate> {
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
            let (_, finding) = diagnose_trials(workflow.trials(), &config, progress)?;
            let latents = config.cem.coordinates().latents(estimate);
            Some(extension::extend_simulation(&finding, workflow.trials(), &config, latents, progress)?)
        }
        None => None,
    };
    let wanted = study.past_point.contains(&arm.name);
    let past_point = wanted.then(|| PosteriorTrainingData::of(&training, &workflow, progress)).transpose()?;
    Ok(ArmEstimate { interactions: workflow.interactions(), estimates, extension, past_point })
}

/// Trains and evaluates one policy.
pub fn run_study_cell(
    family: &Family,
    study: &Study,
    cell: &StudyCell,
    progress: &dyn Progress,
) -> Result<(Transfer, Option<crate::policy::Dqn>)> {
    let seed = rng::derive_seed(cell.seed, "learning trial", cell.trial);
    let tasks = study.tasks(family, cell.seed);
    transfer(&tasks, &cell.school, &study.hidden, &study.transfer, seed, progress)
}

/// Row name of policies from an arm's extended simulation.
fn extended_row_name(arm: &str) -> String {
    format!("extended by diagnosis ({arm})")
}

/// Training in the simulation at an estimate, with the fitted effects.
fn estimate_source(config: &EstimateConfig, estimate: &ParameterVector) -> PolicySource {
    PolicySource::Simulated { training: physics_at(config, estimate) }
}

/// Physics at an estimate, with the fitted effects.
fn physics_at(config: &EstimateConfig, estimate: &ParameterVector) -> TrainingPhysics {
    let coordinates = config.cem.coordinates();
    TrainingPhysics::Fixed {
        latents: coordinates.latents(estimate),
        effects: coordinates.effects(estimate, &[]),
    }
}

pub(super) fn with_drag(mut config: EstimateConfig) -> EstimateConfig {
    config.cem.add_free_parameter(LINEAR_DRAG);
    config
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::families;

    /// A claim about a missing row would be omitted silently.
    #[test]
    fn every_jump_start_claim_refers_to_existing_rows() {
        for family in families() {
            let check = |study: Study, claims: &[JumpStartClaim]| {
                let schools = study.schools.iter().map(|(name, _)| name);
                let arms = study.arms.iter().map(|a| &a.name);
                let rows: Vec<String> = schools.chain(arms).cloned().chain(study.afterwards()).collect();
                for claim in claims.iter().chain(COMMON_CLAIMS) {
                    let row = |name: &str| rows.iter().any(|r| *r == name);
                    assert!(row(claim.better) && row(claim.worse), "{}: {}", study.name, claim.text);
                }
            };
            check(Study::strategies(family), family.claims.jump_starts);
            check(Study::latents(family), LATENT_CLAIMS);
            check(Study::policies(family), POLICY_CLAIMS);
        }
    }
}
