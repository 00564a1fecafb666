//! How an estimation is run.

use serde::{Deserialize, Serialize};

use super::sense::Sense;
use super::ways;
use crate::error::{Error, Result, within};
use crate::estimate::CemConfig;
use crate::task::scene::EffectTerm;
use crate::world::effect::{self, Parameter};
use crate::world::{EffectParameter, Engine};

/// How an estimation is run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EstimateConfig {
    /// The way to choose what is spent on the real world: see [`super::ways`].
    pub strategy: String,
    /// Most rounds of exploring, measuring and fitting.
    pub rounds: usize,
    /// Real interactions a round.
    pub actions: usize,
    /// Actions simulated a round for the strategy to choose from.
    pub candidates: usize,
    /// The search.
    pub cem: CemConfig,
    /// Which trials a round's fit sees.
    pub memory: Memory,
    /// How far a sample is from the trials.
    #[serde(default)]
    pub residual: ResidualKind,
    /// What is sensed of the latents before anything is measured.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub senses: Vec<Sense>,
    /// Whether each round's estimate is refined by a local search from where the cross-entropy method stands; else
    /// it is that method's mean.
    #[serde(default)]
    pub refine: bool,
    /// Stop when no latent has moved by more than this share of its prior's deviation for two rounds; 0 never.
    pub settled: f64,
    /// Whether samples that cannot matter are dropped early; the result is the same.
    pub racing: bool,
    /// Engine of the simulation.
    pub engine: Engine,
    /// Effects that the simulation has beside the scenes' own: those a diagnosis found, say.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectTerm>,
    /// Seed of everything random.
    pub seed: u64,
}

/// Which trials a round's fit sees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Memory {
    /// All trials so far.
    #[default]
    All,
    /// Those of the round.
    LastRound,
}

/// How far a sample is from the trials.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ResidualKind {
    /// Simulated from the start to the end (paper, equation 2).
    #[default]
    Trajectory,
    /// Simulated anew from where things were seen, a stretch at a time, so that what chance makes of a collision
    /// does not add up: see `estimate::shooting`.
    Shooting,
}

impl ResidualKind {
    /// The name used on the wire and the command line.
    pub fn name(self) -> &'static str {
        match self {
            ResidualKind::Trajectory => "trajectory",
            ResidualKind::Shooting => "shooting",
        }
    }

    /// The kind named `name`.
    pub fn from_name(name: &str) -> Result<ResidualKind> {
        let all = [ResidualKind::Trajectory, ResidualKind::Shooting];
        all.into_iter().find(|k| k.name() == name).ok_or_else(|| Error::NotFound {
            kind: "residual",
            id: name.to_string(),
            known: all.map(|k| k.name().to_string()).to_vec(),
        })
    }
}

impl EstimateConfig {
    /// As in the paper: 10 rounds of 50 actions, each followed by one iteration of 1000 samples.
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

    /// A tenth of the interactions, and a search that needs fewer samples.
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

    /// Errors if a shape is to be fitted of an effect that vanishes: nothing would tell it.
    fn fits_what_acts(&self) -> Result<()> {
        let fitted = self.cem.fitted();
        for own in &fitted {
            let name = own.effect.name;
            let amplitudes = || own.effect.parameters.iter().enumerate().filter(|(_, p)| p.is_amplitude());
            let given = |p: &Parameter| {
                let terms = self.effects.iter().filter(|term| term.name == name);
                terms.filter_map(|term| term.parameters.get(p.name)).any(|v| *v != p.neutral)
            };
            let open = |index| fitted.contains(&EffectParameter { index, ..*own });
            if !amplitudes().any(|(i, p)| open(i) || given(p)) {
                let wanted: Vec<String> = amplitudes().map(|(_, p)| format!("{name}.{}", p.name)).collect();
                let allowed = format!("it beside {}, or an effect that is given them", wanted.join(" or "));
                return Err(Error::input("fit", own, allowed));
            }
        }
        Ok(())
    }

    /// Errors name what is out of range.
    pub fn validate(&self) -> Result<()> {
        ways::question(&self.strategy)?;
        within("rounds", self.rounds as f64, 1.0, 1000.0)?;
        within("actions", self.actions as f64, 1.0, 10_000.0)?;
        within("candidates", self.candidates as f64, self.actions as f64, 100_000.0)?;
        within("settled", self.settled, 0.0, 1.0)?;
        for (i, term) in self.effects.iter().enumerate() {
            effect::resolve(term, format_args!("effects[{i}]"))?;
        }
        self.cem.validate().map_err(|e| e.under("cem"))?;
        self.fits_what_acts()
    }
}
