//! The strategies compared: error of each identifiable latent against real interactions spent.
//!
//! Source: Semage et al., their comparison of action selection strategies: 10 rounds of 50 interactions, five
//! seeds. Differences from the source: errors of the latents are compared, not only what a policy makes of them;
//! each strategy is run in two hidden worlds, one that the simulation can match and one with the drag that it
//! lacks, which shows how far estimates are pulled to make up for it; and arms past the paper stand beside it.
//!
//! The work is cut into [`Cell`]s, one estimation each, so that whoever runs it can keep them and go on later.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::statistics::{Claim, Summary, Verdict};
use super::{Choice, EstimateConfig, Memory, ResidualKind, Workflow, run};
use crate::error::{Error, Result};
use crate::estimate::{CemConfig, LatentEstimate};
use crate::explore::{Importance, REGISTRY};
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld, standard};
use crate::task::{Family, Nearer, Split, split};
use crate::world::DRAG;
use crate::world::Sample;
use crate::world::latent::{FACTORS, factor_index};

/// What is run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StrategiesConfig {
    /// Name of the task family.
    pub family: String,
    /// One repetition for each.
    pub seeds: Vec<u64>,
    pub arms: Vec<Arm>,
    pub natures: Vec<Nature>,
}

/// One way to estimate; its seed is replaced by each of the experiment's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// For tables and files.
    pub name: String,
    pub estimate: EstimateConfig,
}

/// The hidden world an arm is run in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Nature {
    /// The family's true latents and nothing else: the simulation can match it.
    Matching,
    /// With the drag of the paper's real world (kept 0.8 of velocity per second), which the simulation lacks.
    Damped,
}

/// One estimation of one arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    pub arm: String,
    pub nature: Nature,
    pub seed: u64,
    /// Real interactions after each round.
    pub interactions: Vec<u64>,
    /// Estimate after each round.
    pub estimates: Vec<Sample>,
    /// With intervals, at the end.
    pub latents: Vec<LatentEstimate>,
    pub choices: Vec<Choice>,
    pub rollouts: u64,
}

/// Errors of one latent over seeds, after some interactions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorRow {
    pub arm: String,
    pub nature: Nature,
    /// Name of the factor.
    pub factor: String,
    /// Mean real interactions over seeds.
    pub interactions: f64,
    /// Mean over seeds of |estimate - truth|.
    pub error: f64,
    /// Its standard error; `None` for a single seed.
    pub standard_error: Option<f64>,
    /// Mean over seeds of estimate - truth: where it is pulled to.
    pub bias: f64,
    /// Number of seeds.
    pub seeds: usize,
}

/// Latents that the family's trials can tell: friction and restitution.
pub const TOLD: [usize; 2] = [1, 2];

impl StrategiesConfig {
    /// As the issue of the paper: every strategy with the paper's preset, 10 rounds of 50; and ours with few.
    pub fn paper(family: &Family) -> StrategiesConfig {
        let paper = |name: &str| Arm {
            name: name.to_string(),
            estimate: EstimateConfig { strategy: name.into(), ..EstimateConfig::paper(family.prior) },
        };
        let mut arms: Vec<Arm> = REGISTRY.iter().map(|s| paper(s.name())).collect();
        if family.claims.all_trials {
            arms.push(Arm {
                name: "mixed, all trials".into(),
                estimate: EstimateConfig { memory: Memory::All, ..EstimateConfig::paper(family.prior) },
            });
        }
        arms.extend(few(family));
        StrategiesConfig {
            family: family.name.into(),
            seeds: vec![50, 100, 150, 500, 1000],
            arms,
            natures: vec![Nature::Damped, Nature::Matching],
        }
    }

    /// A small run of the same shape, for a look.
    pub fn quick(family: &Family) -> StrategiesConfig {
        let mut config = StrategiesConfig::paper(family);
        config.seeds.truncate(2);
        for arm in &mut config.arms {
            let e = &mut arm.estimate;
            (e.rounds, e.actions) = (e.rounds.min(4), e.actions.min(10));
            e.candidates = e.candidates.min(100);
            (e.cem.samples, e.cem.elites) = (e.cem.samples.min(200), e.cem.elites.min(40));
        }
        config
    }

    /// Errors name what is wrong.
    pub fn validate(&self) -> Result<()> {
        if self.seeds.is_empty() || self.arms.is_empty() || self.natures.is_empty() {
            return Err(Error::input("seeds, arms or natures", "empty", "at least one of each"));
        }
        self.arms.iter().try_for_each(|a| a.estimate.validate().map_err(|e| e.under(&a.name)))
    }

    /// All cells to run: (arm, nature, seed).
    pub fn cells(&self) -> Vec<(&Arm, Nature, u64)> {
        let mut all = Vec::new();
        for nature in &self.natures {
            for arm in &self.arms {
                all.extend(self.seeds.iter().map(|seed| (arm, *nature, *seed)));
            }
        }
        all
    }

    /// Whether any arm's strategy needs a performance surface.
    pub fn needs_importance(&self) -> bool {
        self.arms.iter().any(Arm::needs_importance)
    }
}

impl Arm {
    /// Whether its strategy needs a performance surface.
    pub fn needs_importance(&self) -> bool {
        super::ways::needs_importance(&self.estimate.strategy).unwrap_or(false)
    }
}

impl Nature {
    /// For tables.
    pub fn title(self) -> &'static str {
        match self {
            Nature::Matching => "no drag",
            Nature::Damped => "damping 0.8",
        }
    }

    /// The hidden world.
    pub fn hidden(self, family: &Family, seed: u64) -> HiddenConfig {
        let standard = standard(family);
        let effects = match self {
            Nature::Matching => Vec::new(),
            Nature::Damped => standard.effects.clone(),
        };
        HiddenConfig { effects, seed, ..standard }
    }
}

/// Arms past the paper: a tenth of the interactions, five a round.
fn few(family: &Family) -> Vec<Arm> {
    let base = EstimateConfig {
        rounds: 10,
        actions: 5,
        candidates: 200,
        settled: 0.0,
        ..EstimateConfig::fast(family.prior)
    };
    let arm = |name: &str, strategy: &str, residual, drag| Arm {
        name: name.to_string(),
        estimate: EstimateConfig {
            strategy: strategy.into(),
            residual,
            cem: CemConfig { drag, ..base.cem.clone() },
            ..base.clone()
        },
    };
    let (whole, shot) = (ResidualKind::Trajectory, ResidualKind::Shooting);
    vec![
        arm("mixed, 5 a round", "mixed", whole, None),
        arm(OURS, "informative", shot, None),
        arm(
            "informative, shooting, drag fitted, 5 a round",
            "informative",
            shot,
            Some(DRAG.parameter().prior()),
        ),
    ]
}

/// Runs one cell. `importance` is what the strategy `gradient` needs.
pub fn cell(
    family: &Family,
    arm: &Arm,
    nature: Nature,
    seed: u64,
    importance: Option<Arc<dyn Importance>>,
    progress: &dyn Progress,
) -> Result<Cell> {
    let training = split(&family.tasks(), Split::Train);
    let config = EstimateConfig { seed, ..arm.estimate.clone() };
    let mut reality = HiddenWorld::new(nature.hidden(family, seed))?;
    let mut workflow = Workflow::new(&training, &config, importance)?;
    run(&mut workflow, &mut reality, progress, &mut |_| Ok(()))?;
    let report = workflow.report(progress)?;
    Ok(Cell {
        arm: arm.name.clone(),
        nature,
        seed,
        interactions: workflow.interactions(),
        estimates: report.estimates,
        latents: report.latents,
        choices: report.choices,
        rollouts: report.rollouts,
    })
}

/// Errors by arm, nature, factor and round, in that order.
pub fn errors(family: &Family, cells: &[Cell]) -> Vec<ErrorRow> {
    let truth = standard(family).latents.values();
    let mut rows = Vec::new();
    for (arm, nature) in groups(cells) {
        let mine: Vec<&Cell> = cells.iter().filter(|c| c.arm == arm && c.nature == nature).collect();
        let rounds = mine.iter().map(|c| c.estimates.len()).min().unwrap_or(0);
        for i in TOLD {
            let Some(truth) = truth[i] else { continue };
            for round in 0..rounds {
                let off: Vec<f64> = mine.iter().map(|c| c.estimates[round][i] - truth).collect();
                let size: Vec<f64> = off.iter().map(|o| o.abs()).collect();
                let error = Summary::of(&size);
                rows.push(ErrorRow {
                    arm: arm.to_string(),
                    nature,
                    factor: FACTORS[i].name.into(),
                    interactions: mine.iter().map(|c| c.interactions[round] as f64).sum::<f64>()
                        / mine.len() as f64,
                    error: error.mean,
                    standard_error: error.standard_error,
                    bias: Summary::of(&off).mean,
                    seeds: mine.len(),
                });
            }
        }
    }
    rows
}

/// What the cells say of the paper's claims about the family's estimates, and of ours. Errors are in units of the
/// prior's standard deviation, averaged over the claim's factors; paired by seed.
pub fn claims(family: &Family, config: &StrategiesConfig, cells: &[Cell]) -> Vec<Claim> {
    let of = |nature: &Nature| {
        let scores = Scores { family, seeds: &config.seeds, cells, nature: *nature };
        let stated: Vec<Claim> = family.claims.estimates.iter().filter_map(|c| scores.nearer(c)).collect();
        stated.into_iter().chain(scores.with_a_tenth())
    };
    config.natures.iter().flat_map(of).collect()
}

/// Errors in one hidden world.
struct Scores<'a> {
    family: &'a Family,
    seeds: &'a [u64],
    cells: &'a [Cell],
    nature: Nature,
}

impl Scores<'_> {
    /// Whether an arm's estimates are nearer than another's; `None` where one of them was not run.
    fn nearer(&self, claim: &Nearer) -> Option<Claim> {
        let factors: Vec<usize> = claim.factors.iter().filter_map(|f| factor_index(f).ok()).collect();
        let [better, worse] = [claim.better, claim.worse].map(|arm| self.errors(arm, &factors, None));
        if better.is_empty() || better.len() != worse.len() {
            return None;
        }
        let difference: Vec<f64> = worse.iter().zip(&better).map(|(w, b)| w - b).collect();
        let found = Summary::of(&difference);
        Some(Claim {
            text: format!("{}: {}", self.nature.title(), claim.text),
            figure: format!(
                "error {:.4} against {:.4} of the prior's deviation; difference {} (95 % +- {:.4})",
                Summary::of(&better).mean,
                Summary::of(&worse).mean,
                found.show(4),
                found.half_width.unwrap_or(f64::INFINITY)
            ),
            verdict: found.above_zero(),
        })
    }

    /// Whether our arm reaches the accuracy of the paper's with a tenth of its interactions.
    fn with_a_tenth(&self) -> Option<Claim> {
        let (paper, ours) = (self.errors("mixed", &TOLD, None), self.errors(OURS, &TOLD, None));
        if paper.is_empty() || ours.is_empty() {
            return None;
        }
        let wanted = Summary::of(&paper).mean;
        let rounds =
            self.cells.iter().filter(|c| c.arm == OURS).map(|c| c.estimates.len()).min().unwrap_or(0);
        let reached = (0..rounds).find(|r| Summary::of(&self.errors(OURS, &TOLD, Some(*r))).mean <= wanted);
        let enough = reached.is_some_and(|r| self.spent(OURS, Some(r)) <= 50.0);
        let nature = self.nature.title();
        Some(Claim {
            text: format!("{nature}: past the paper, {OURS} reaches the accuracy of mixed with a tenth"),
            figure: format!(
                "mixed {wanted:.4} after {:.0} interactions; ours {:.4} after {:.0}, there first after {}",
                self.spent("mixed", None),
                Summary::of(&ours).mean,
                self.spent(OURS, None),
                reached.map_or("none".into(), |r| format!("{:.0}", self.spent(OURS, Some(r))))
            ),
            verdict: if enough { Verdict::Reproduced } else { Verdict::NotReproduced },
        })
    }

    /// An arm's error after a round (the last if none is given), averaged over `factors`, for each seed that was run.
    fn errors(&self, arm: &str, factors: &[usize], round: Option<usize>) -> Vec<f64> {
        let of = |seed: &u64| {
            let cell = self.mine(arm).find(|c| c.seed == *seed)?;
            let estimate = round.map_or(cell.estimates.last(), |r| cell.estimates.get(r))?;
            Some(factors.iter().map(|i| off(self.family, estimate, *i)).sum::<f64>() / factors.len() as f64)
        };
        self.seeds.iter().filter_map(of).collect()
    }

    /// An arm's mean real interactions up to a round.
    fn spent(&self, arm: &str, round: Option<usize>) -> f64 {
        let of = |c: &Cell| round.map_or(c.interactions.last(), |r| c.interactions.get(r)).map(|n| *n as f64);
        Summary::of(&self.mine(arm).filter_map(of).collect::<Vec<_>>()).mean
    }

    fn mine(&self, arm: &str) -> impl Iterator<Item = &Cell> {
        self.cells.iter().filter(move |c| c.arm == arm && c.nature == self.nature)
    }
}

/// |estimate - truth| of a factor, in standard deviations of the prior.
fn off(family: &Family, estimate: &Sample, factor: usize) -> f64 {
    let truth = standard(family).latents.values()[factor].unwrap_or(f64::NAN);
    (estimate[factor] - truth).abs() / family.prior[factor].1
}

/// The arm past the paper.
pub const OURS: &str = "informative, shooting, 5 a round";

/// The (arm, nature) pairs there are, in order of appearance.
fn groups(cells: &[Cell]) -> Vec<(&str, Nature)> {
    let mut found: Vec<(&str, Nature)> = Vec::new();
    for cell in cells {
        if !found.contains(&(cell.arm.as_str(), cell.nature)) {
            found.push((&cell.arm, cell.nature));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::families;

    /// A claim about an arm that is not run, or about a factor that there is not, would be left out silently.
    #[test]
    fn a_family_is_judged_by_its_own_claims_and_each_can_be_checked() {
        for family in families() {
            let config = StrategiesConfig::paper(family);
            for claim in family.claims.estimates {
                let arm = |name: &str| config.arms.iter().any(|a| a.name == name);
                assert!(arm(claim.better) && arm(claim.worse), "{}: {}", family.name, claim.text);
                assert!(!claim.factors.is_empty(), "{}: {}", family.name, claim.text);
                assert!(claim.factors.iter().all(|f| factor_index(f).is_ok()), "{}", claim.text);
            }
        }
    }
}
