//! Comparison of strategies: error of each identifiable latent as a function of real interactions.
//!
//! Source: Semage et al., comparison of action selection strategies: 10 rounds of 50 interactions, five seeds.
//! Differences from the source: errors of the latents are compared, not only the performance of policies. Each strategy is
//! run in two hidden worlds, one that the simulation can match and one with drag that it lacks, which shows the bias of
//! estimates due to the missing effect. Additional arms go beyond the paper.
//!
//! The experiment consists of [`StrategyCell`]s, one estimation each, so that the caller can store them and resume.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::estimate_accuracy::{accuracy_claim, factors, mean_error};
use super::statistics::{Claim, ClaimVerdict, Summary};
use super::{EstimateConfig, Memory, ResidualKind, SelectionSummary, Workflow, run};
use crate::error::{Error, Result};
use crate::estimate::{CemConfig, LatentEstimate};
use crate::explore::{Importance, REGISTRY};
use crate::progress::Progress;
use crate::reality::{HiddenConfig, HiddenWorld, standard};
use crate::task::{EstimateClaim, Family, Split, split};
use crate::world::LINEAR_DRAG;
use crate::world::ParameterVector;
use crate::world::latent::FACTORS;

/// Configuration of the comparison.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StrategiesConfig {
    /// Name of the task family.
    pub family: String,
    /// Seeds, one repetition each.
    pub seeds: Vec<u64>,
    pub arms: Vec<Arm>,
    pub natures: Vec<WorldVariant>,
}

/// One arm of the experiment; the seed of its configuration is replaced by each of the experiment's seeds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// Name in tables and files.
    pub name: String,
    pub estimate: EstimateConfig,
}

/// Variant of the hidden world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WorldVariant {
    /// The family's true latents without further effects: the simulation can match it.
    Matching,
    /// With the drag of the paper's real world (damping 0.8 per second), which the simulation lacks.
    Damped,
}

/// Result of one estimation: an arm in one variant of the hidden world with one seed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StrategyCell {
    pub arm: String,
    pub nature: WorldVariant,
    pub seed: u64,
    /// Real interactions after each round.
    pub interactions: Vec<u64>,
    /// Estimate after each round.
    pub estimates: Vec<ParameterVector>,
    /// Final estimates with confidence intervals.
    pub latents: Vec<LatentEstimate>,
    pub choices: Vec<SelectionSummary>,
    pub rollouts: u64,
}

/// Errors of one latent over seeds, after a number of interactions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorRow {
    pub arm: String,
    pub nature: WorldVariant,
    /// Name of the factor.
    pub factor: String,
    /// Mean real interactions over seeds.
    pub interactions: f64,
    /// Mean over seeds of |estimate - truth|.
    pub error: f64,
    /// Its standard error; `None` for a single seed.
    pub standard_error: Option<f64>,
    /// Bias: mean over seeds of estimate - truth.
    pub bias: f64,
    /// Number of seeds.
    pub seeds: usize,
}

/// Factors that the family's trials identify: friction and restitution.
pub const IDENTIFIABLE_FACTORS: [usize; 2] = [1, 2];

impl StrategiesConfig {
    /// The paper's experiment: every strategy with the paper's preset, 10 rounds of 50; and the low-budget arms.
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
        arms.extend(low_budget_arms(family));
        StrategiesConfig {
            family: family.name.into(),
            seeds: vec![50, 100, 150, 500, 1000],
            arms,
            natures: vec![WorldVariant::Damped, WorldVariant::Matching],
        }
    }

    /// A reduced configuration for a quick run.
    pub fn quick(family: &Family) -> StrategiesConfig {
        let mut config = StrategiesConfig::paper(family);
        config.seeds.truncate(2);
        for arm in &mut config.arms {
            arm.reduce(4, 10);
        }
        config
    }

    /// Errors name the invalid field.
    pub fn validate(&self) -> Result<()> {
        if self.seeds.is_empty() || self.arms.is_empty() || self.natures.is_empty() {
            return Err(Error::input("seeds, arms or natures", "empty", "at least one of each"));
        }
        self.arms.iter().try_for_each(|a| a.estimate.validate().map_err(|e| e.in_field(&a.name)))
    }

    /// All cells to run: (arm, nature, seed).
    pub fn cells(&self) -> Vec<(&Arm, WorldVariant, u64)> {
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
    /// Reduces the work for a quick run.
    pub(super) fn reduce(&mut self, rounds: usize, actions: usize) {
        let e = &mut self.estimate;
        (e.rounds, e.actions) = (e.rounds.min(rounds), e.actions.min(actions));
        e.candidates = e.candidates.min(100);
        (e.cem.samples, e.cem.elites) = (e.cem.samples.min(200), e.cem.elites.min(40));
    }

    /// Whether the arm's strategy needs a performance surface.
    pub fn needs_importance(&self) -> bool {
        super::acquisition::needs_importance(&self.estimate.strategy).unwrap_or(false)
    }
}

impl WorldVariant {
    /// Title in tables.
    pub fn title(self) -> &'static str {
        match self {
            WorldVariant::Matching => "no drag",
            WorldVariant::Damped => "damping 0.8",
        }
    }

    /// Configuration of the hidden world.
    pub fn hidden(self, family: &Family, seed: u64) -> HiddenConfig {
        let standard = standard(family);
        let effects = match self {
            WorldVariant::Matching => Vec::new(),
            WorldVariant::Damped => standard.effects.clone(),
        };
        HiddenConfig { effects, seed, ..standard }
    }
}

/// Arms beyond the paper: a tenth of the interactions, five per round.
fn low_budget_arms(family: &Family) -> Vec<Arm> {
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
        arm(PROPOSED_ARM, "informative", shot, None),
        arm(
            "informative, shooting, drag fitted, 5 a round",
            "informative",
            shot,
            Some(LINEAR_DRAG.parameter().weak_prior()),
        ),
    ]
}

/// Runs one cell. The strategy `gradient` needs `importance`.
pub fn run_strategy_cell(
    family: &Family,
    arm: &Arm,
    nature: WorldVariant,
    seed: u64,
    importance: Option<Arc<dyn Importance>>,
    progress: &dyn Progress,
) -> Result<StrategyCell> {
    let training = split(&family.tasks(), Split::Train);
    let config = EstimateConfig { seed, ..arm.estimate.clone() };
    let mut reality = HiddenWorld::new(nature.hidden(family, seed))?;
    let mut workflow = Workflow::new(&training, &config, importance)?;
    run(&mut workflow, &mut reality, progress, &mut |_| Ok(()))?;
    let report = workflow.report(progress)?;
    Ok(StrategyCell {
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
pub fn errors(family: &Family, cells: &[StrategyCell]) -> Vec<ErrorRow> {
    let truth = standard(family).latents.values();
    let mut rows = Vec::new();
    for (arm, nature) in groups(cells) {
        let mine: Vec<&StrategyCell> = cells.iter().filter(|c| c.arm == arm && c.nature == nature).collect();
        let rounds = mine.iter().map(|c| c.estimates.len()).min().unwrap_or(0);
        for i in IDENTIFIABLE_FACTORS {
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

/// Verdicts on the paper's claims about the family's estimates, and on those of this project. Errors are in units of the
/// prior's standard deviation, averaged over the claim's factors, and paired by seed.
pub fn claims(family: &Family, config: &StrategiesConfig, cells: &[StrategyCell]) -> Vec<Claim> {
    let of = |nature: &WorldVariant| {
        let scores = ArmErrors { family, seeds: &config.seeds, cells, nature: *nature };
        let stated: Vec<Claim> =
            family.claims.estimates.iter().filter_map(|c| scores.accuracy_claim(c)).collect();
        stated.into_iter().chain(scores.sample_efficiency_claim())
    };
    config.natures.iter().flat_map(of).collect()
}

/// Errors of all arms in one variant of the hidden world.
struct ArmErrors<'a> {
    family: &'a Family,
    seeds: &'a [u64],
    cells: &'a [StrategyCell],
    nature: WorldVariant,
}

impl ArmErrors<'_> {
    /// Verdict on whether one arm's estimates are more accurate than another's; `None` if one of them is missing.
    fn accuracy_claim(&self, claim: &EstimateClaim) -> Option<Claim> {
        let factors = factors(claim);
        let text = format!("{}: {}", self.nature.title(), claim.text);
        accuracy_claim(
            text,
            &self.errors(claim.better, &factors, None),
            &self.errors(claim.worse, &factors, None),
        )
    }

    /// Verdict on whether [`PROPOSED_ARM`] reaches the accuracy of the paper's arm with a tenth of its interactions.
    fn sample_efficiency_claim(&self) -> Option<Claim> {
        let (paper, ours) = (
            self.errors("mixed", &IDENTIFIABLE_FACTORS, None),
            self.errors(PROPOSED_ARM, &IDENTIFIABLE_FACTORS, None),
        );
        if paper.is_empty() || ours.is_empty() {
            return None;
        }
        let wanted = Summary::of(&paper).mean;
        let rounds =
            self.cells.iter().filter(|c| c.arm == PROPOSED_ARM).map(|c| c.estimates.len()).min().unwrap_or(0);
        let reached = (0..rounds).find(|r| {
            Summary::of(&self.errors(PROPOSED_ARM, &IDENTIFIABLE_FACTORS, Some(*r))).mean <= wanted
        });
        let enough = reached.is_some_and(|r| self.spent(PROPOSED_ARM, Some(r)) <= 50.0);
        let nature = self.nature.title();
        Some(Claim {
            text: format!(
                "{nature}: past the paper, {PROPOSED_ARM} reaches the accuracy of mixed with a tenth"
            ),
            figure: format!(
                "mixed {wanted:.4} after {:.0} interactions; ours {:.4} after {:.0}, there first after {}",
                self.spent("mixed", None),
                Summary::of(&ours).mean,
                self.spent(PROPOSED_ARM, None),
                reached.map_or("none".into(), |r| format!("{:.0}", self.spent(PROPOSED_ARM, Some(r))))
            ),
            verdict: if enough { ClaimVerdict::Reproduced } else { ClaimVerdict::NotReproduced },
        })
    }

    /// An arm's error after a round (default: the last), averaged over `factors`, for each available seed.
    fn errors(&self, arm: &str, factors: &[usize], round: Option<usize>) -> Vec<f64> {
        let of = |seed: &u64| {
            let cell = self.cells_of(arm).find(|c| c.seed == *seed)?;
            let estimate = round.map_or(cell.estimates.last(), |r| cell.estimates.get(r))?;
            Some(mean_error(self.family, &standard(self.family).latents, estimate, factors))
        };
        self.seeds.iter().filter_map(of).collect()
    }

    /// Mean number of an arm's real interactions up to a round.
    fn spent(&self, arm: &str, round: Option<usize>) -> f64 {
        let of = |c: &StrategyCell| {
            round.map_or(c.interactions.last(), |r| c.interactions.get(r)).map(|n| *n as f64)
        };
        Summary::of(&self.cells_of(arm).filter_map(of).collect::<Vec<_>>()).mean
    }

    fn cells_of(&self, arm: &str) -> impl Iterator<Item = &StrategyCell> {
        self.cells.iter().filter(move |c| c.arm == arm && c.nature == self.nature)
    }
}

/// Name of this project's main arm.
pub const PROPOSED_ARM: &str = "informative, shooting, 5 a round";

/// The (arm, nature) pairs there are, in order of appearance.
fn groups(cells: &[StrategyCell]) -> Vec<(&str, WorldVariant)> {
    let mut found: Vec<(&str, WorldVariant)> = Vec::new();
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
    use crate::world::latent::factor_index;

    /// A claim about a missing arm or factor would be omitted silently.
    #[test]
    fn every_claim_refers_to_existing_arms_and_factors() {
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
