//! Configuration of an estimation.

use serde::{Deserialize, Serialize};

use super::acquisition;
use super::order_constraint::OrderConstraint;
use crate::error::{Error, Result, check_range};
use crate::estimate::CemConfig;
use crate::names::names;
use crate::task::scene::EffectTerm;
use crate::world::effect::{self, ParameterDeclaration};
use crate::world::{EffectParameter, Engine};

/// Configuration of an estimation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EstimateConfig {
    /// Method that selects the actions to measure in the real world: see [`super::acquisition`].
    pub strategy: String,
    /// Maximum number of rounds of exploring, measuring and fitting.
    pub rounds: usize,
    /// Real interactions per round.
    pub actions: usize,
    /// Candidate actions simulated per round.
    pub candidates: usize,
    /// Cross-entropy method.
    pub cem: CemConfig,
    /// Trials that a round is fitted to.
    pub memory: Memory,
    /// Residual between a sample's simulation and the trials.
    #[serde(default)]
    pub residual: ResidualKind,
    /// Order constraints on the latents, known before the first measurement.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub senses: Vec<OrderConstraint>,
    /// Whether each round's estimate is refined by a local search that starts at the cross-entropy method's mean; if not, the
    /// estimate is that mean.
    #[serde(default)]
    pub refine: bool,
    /// Convergence tolerance: stop when no latent changed by more than this share of its prior standard deviation in each of
    /// two rounds; 0 disables the test.
    pub settled: f64,
    /// Whether samples that cannot become elites are dropped early; the result is the same.
    pub racing: bool,
    /// Physics engine of the simulation.
    pub engine: Engine,
    /// Effects of the simulation in addition to those of the scenes, for example those that a diagnosis found.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectTerm>,
    /// Random seed.
    pub seed: u64,
}

/// Trials that a round is fitted to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Memory {
    /// All trials so far.
    #[default]
    All,
    /// Trials of the current round.
    LastRound,
}

/// Residual between a sample's simulation and the trials.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ResidualKind {
    /// Simulates each trial from start to end (paper, equation 2).
    #[default]
    Trajectory,
    /// Multiple shooting: restarts the simulation at observed states, one segment at a time, so that errors from chaotic
    /// collisions do not accumulate. See `estimate::shooting`.
    Shooting,
}

names!(ResidualKind: Trajectory = "trajectory", Shooting = "shooting");
names!(Memory: All = "all", LastRound = "last_round");

impl ResidualKind {
    /// The kind named `name`.
    pub fn from_name(name: &str) -> Result<ResidualKind> {
        let known = ResidualKind::ALL.map(ResidualKind::name);
        ResidualKind::named(name).ok_or_else(|| Error::not_found("residual", name, known))
    }
}

impl EstimateConfig {
    /// The paper's preset: 10 rounds of 50 actions, each followed by one iteration of 1000 samples.
    pub fn paper(prior: [(f64, f64); 3]) -> EstimateConfig {
        EstimateConfig {
            rounds: 10,
            actions: 50,
            candidates: 500,
            cem: CemConfig::paper(prior),
            memory: Memory::LastRound,
            refine: false,
            settled: 0.0,
            ..EstimateConfig::fast(prior)
        }
    }

    /// Preset with a tenth of the interactions, and a search that needs fewer samples.
    pub fn fast(prior: [(f64, f64); 3]) -> EstimateConfig {
        EstimateConfig {
            strategy: "mixed".into(),
            rounds: 5,
            actions: 10,
            candidates: 200,
            cem: CemConfig::fast(prior),
            memory: Memory::All,
            residual: ResidualKind::Trajectory,
            senses: Vec::new(),
            refine: true,
            settled: 0.02,
            racing: true,
            engine: Engine::Auto,
            effects: Vec::new(),
            seed: 0,
        }
    }

    /// Errors if a shape parameter is to be fitted for an effect whose amplitudes are all neutral: it is not identifiable.
    fn fits_what_acts(&self) -> Result<()> {
        let fitted = self.cem.free_parameters();
        for own in &fitted {
            let name = own.effect.name;
            let amplitudes = || own.effect.parameters.iter().enumerate().filter(|(_, p)| p.is_amplitude());
            let given = |p: &ParameterDeclaration| {
                let terms = self.effects.iter().filter(|term| term.name == name);
                terms.filter_map(|term| term.parameters.get(p.name)).any(|v| *v != p.neutral)
            };
            let open = |index| fitted.contains(&EffectParameter { index, ..*own });
            if !amplitudes().any(|(i, p)| open(i) || given(p)) {
                let wanted: Vec<String> = amplitudes().map(|(_, p)| format!("{name}.{}", p.name)).collect();
                let allowed = format!("fit {} as well, or set it in `effects`", wanted.join(" or "));
                return Err(Error::input("fit", own, allowed));
            }
        }
        Ok(())
    }

    /// Errors name the field that is out of range.
    pub fn validate(&self) -> Result<()> {
        acquisition::question(&self.strategy)?;
        check_range("rounds", self.rounds as f64, 1.0, 1000.0)?;
        check_range("actions", self.actions as f64, 1.0, 10_000.0)?;
        check_range("candidates", self.candidates as f64, self.actions as f64, 100_000.0)?;
        check_range("settled", self.settled, 0.0, 1.0)?;
        for (i, term) in self.effects.iter().enumerate() {
            effect::resolve(term, format_args!("effects[{i}]"))?;
        }
        self.cem.validate().map_err(|e| e.in_field("cem"))?;
        self.fits_what_acts()
    }
}
