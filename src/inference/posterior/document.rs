//! The posterior document, `iplw.posterior/2`.

use serde::{Deserialize, Serialize};

use super::{
    DiscrepancyField, FieldDraws, ModelPosterior, Posterior, PosteriorConfig, PredictiveBand, Sampler,
};
use crate::estimate::discrepancy_forces::{DiscrepancyForces, MAX_WRITTEN_TERMS};
use crate::estimate::parameter_samples::POSTERIOR_FORMAT;
use crate::estimate::sampler::{Marginal, SamplingDiagnostics, log_sum_exp};
use crate::inference::field::FieldInputs;
use crate::rng;
use crate::task::scene::EffectTerm;
use rand::seq::SliceRandom;
use std::collections::BTreeMap;

/// A posterior with its configuration and diagnostics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PosteriorDocument {
    pub format: String,
    pub version: String,
    pub config: PosteriorConfig,
    pub seed: u64,
    /// Whether the draws of every set with relevant weight converged (R-hat and effective sample size).
    pub converged: bool,
    pub warnings: Vec<String>,
    /// Number of informative trials, and of all trials.
    pub trials: [usize; 2],
    /// Standard deviation of the noise of an observed coordinate, m.
    pub noise_m: f64,
    pub parameters: Vec<ParameterSummary>,
    pub sets: Vec<SetSummary>,
    /// Effects of every draw in addition to its columns.
    pub effects: Vec<EffectTerm>,
    /// Draws by parameter name; `null` if a draw's set lacks the effect. Sets are represented in proportion to
    /// their weights.
    pub columns: BTreeMap<String, Vec<Option<f64>>>,
    /// Index of the set of every draw.
    pub set: Vec<usize>,
    pub run: Vec<usize>,
    pub log_likelihood: Vec<f64>,
    /// Predictions of some trials under the draws of the most probable set.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub predictive: Vec<PredictiveBand>,
    /// Discrepancy forces of some draws.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub discrepancy: Vec<SetFieldDraws>,
}

/// A kind of discrepancy force, and its values in the draws that have it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetFieldDraws {
    /// Index of the draws' set.
    pub set: usize,
    pub over: FieldInputs,
    #[serde(flatten)]
    pub forces: DiscrepancyForces,
}

/// Marginal posterior of a parameter over all draws that have it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterSummary {
    pub name: String,
    pub unit: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub setting: Option<String>,
    pub prior: Marginal,
    pub mean: f64,
    pub sd: f64,
    /// Mean of each independent run; `null` for a run without a draw.
    #[serde(default)]
    pub runs: Vec<Option<f64>>,
    /// 2.5, 5, 25, 50, 75, 95, 97.5 %.
    pub quantiles: [f64; 7],
    /// Posterior interquartile range over the prior's: near 1 the trials carry no information.
    pub left: f64,
    pub identifiable: bool,
}

/// A set of effects with its weight and diagnostics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetSummary {
    pub effects: Vec<String>,
    /// Posterior probability of the set, by its log evidence.
    pub weight: f64,
    /// Log evidence by Laplace's method, relative to the best set: what sets are weighed by, nats.
    #[serde(default)]
    pub laplace_log_evidence: f64,
    /// Log marginal likelihood, and its standard error over independent runs; `null` for MCMC.
    pub log_evidence: Option<[f64; 2]>,
    /// Log marginal likelihood with the standard deviations of effects' priors halved and doubled, by
    /// reweighting.
    pub log_evidence_priors: Option<[f64; 2]>,
    /// Posterior probability of each discrepancy field, no field first; excluded fields are omitted.
    pub discrepancy: Vec<FieldProbability>,
    pub quality: SamplingDiagnostics,
    pub evaluations: u64,
    pub windows: usize,
    pub parts: usize,
    /// Parameters of the fit, in order.
    pub fit: Vec<f64>,
}

/// A discrepancy field and its probability.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldProbability {
    #[serde(flatten)]
    pub field: DiscrepancyField,
    pub probability: f64,
}

/// Minimum weight of a set whose diagnostics matter.
const MIN_SET_WEIGHT: f64 = 0.01;
/// Probability of a discrepancy above which a warning is issued.
const DISCREPANCY_WARNING_PROBABILITY: f64 = 0.95;
/// Maximum posterior-to-prior width ratio of an identifiable parameter.
const MAX_IDENTIFIABLE_PRIOR_SHARE: f64 = 0.9;
const QUANTILES: [f64; 7] = [0.025, 0.05, 0.25, 0.5, 0.75, 0.95, 0.975];

impl PosteriorDocument {
    pub fn new(posterior: &Posterior, config: &PosteriorConfig) -> PosteriorDocument {
        let all = mixture_draws(&posterior.sets, config.seed);
        let (draws, left_out) = thin_to_limit(&posterior.sets, all);
        let mut columns: BTreeMap<String, Vec<Option<f64>>> = BTreeMap::new();
        let mut parameters: Vec<ParameterSummary> = Vec::new();
        for (s, of) in posterior.sets.iter().enumerate() {
            for (k, number) in of.parameters.iter().enumerate() {
                let values = columns.entry(number.column()).or_insert_with(|| vec![None; draws.len()]);
                for (place, (set, draw)) in draws.iter().enumerate() {
                    if *set == s {
                        values[place] = Some(of.draws.points[*draw][k]);
                    }
                }
            }
        }
        let run: Vec<usize> = draws.iter().map(|(s, i)| posterior.sets[*s].draws.run[*i]).collect();
        for number in posterior.sets.iter().flat_map(|of| &of.parameters) {
            let known = parameters.iter().any(|p| p.name == number.name && p.setting == number.setting);
            let column = &columns[&number.column()];
            if !known && column.iter().any(Option::is_some) {
                parameters.push(summarise_parameter(number, column, &run));
            }
        }
        let mut warnings = warnings(posterior, config.sample_discrepancy);
        warnings.extend(left_out);
        let discrepancy = set_field_draws(&posterior.sets, &draws);
        PosteriorDocument {
            format: POSTERIOR_FORMAT.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            config: config.clone(),
            seed: config.seed,
            converged: !posterior
                .sets
                .iter()
                .any(|of| of.weight > MIN_SET_WEIGHT && of.draws.quality.verdict().is_err()),
            warnings,
            trials: posterior.trials,
            noise_m: posterior.noise,
            parameters,
            sets: posterior.sets.iter().map(summarise_set).collect(),
            effects: Vec::new(),
            columns,
            set: draws.iter().map(|d| d.0).collect(),
            run,
            log_likelihood: draws.iter().map(|(s, i)| posterior.sets[*s].draws.log_likelihoods[*i]).collect(),
            discrepancy,
            predictive: posterior.predictive.clone(),
        }
    }
}

/// Discrepancy forces by set and kind, with draws numbered as in the document.
fn set_field_draws(sets: &[ModelPosterior], draws: &[(usize, usize)]) -> Vec<SetFieldDraws> {
    let mut out = Vec::new();
    for (s, of) in sets.iter().enumerate() {
        let places: BTreeMap<usize, usize> =
            draws.iter().enumerate().filter(|(_, d)| d.0 == s).map(|(place, d)| (d.1, place)).collect();
        for FieldDraws { over, forces } in &of.field_draws {
            let own = forces.draws.iter().zip(&forces.amplitudes);
            let (draws, amplitudes): (Vec<usize>, Vec<Vec<f64>>) =
                own.filter_map(|(draw, a)| Some((*places.get(draw)?, a.clone()))).unzip();
            if !draws.is_empty() {
                let forces = DiscrepancyForces { effects: forces.effects.clone(), draws, amplitudes };
                out.push(SetFieldDraws { set: s, over: *over, forces });
            }
        }
    }
    out
}

/// Thins the draws evenly to the maximum size of a document, with a warning if draws were dropped.
fn thin_to_limit(
    sets: &[ModelPosterior],
    draws: Vec<(usize, usize)>,
) -> (Vec<(usize, usize)>, Option<String>) {
    let terms: usize = set_field_draws(sets, &draws).iter().map(|own| own.forces.term_count()).sum();
    if terms <= MAX_WRITTEN_TERMS {
        return (draws, None);
    }
    let (all, kept) = (draws.len(), (draws.len() * MAX_WRITTEN_TERMS / terms).max(1));
    let told = format!(
        "{kept} of {all} draws are kept: a document holds up to {MAX_WRITTEN_TERMS} discrepancy terms"
    );
    ((0..kept).map(|i| draws[i * all / kept]).collect(), Some(told))
}

/// Draws (set, index) of all sets in proportion to their weights; all in order for a single set.
fn mixture_draws(sets: &[ModelPosterior], seed: u64) -> Vec<(usize, usize)> {
    let total = sets.iter().map(|s| s.draws.points.len()).max().unwrap_or(0);
    let mut out = Vec::new();
    let mut owed = 0.0;
    for (s, of) in sets.iter().enumerate() {
        let n = of.draws.points.len();
        owed += of.weight * total as f64;
        let count = ((owed - out.len() as f64).round().max(0.0) as usize).min(n);
        let mut order: Vec<usize> = (0..n).collect();
        if count < n {
            order.shuffle(&mut rng::stream(rng::derive_seed(seed, "mixture", s as u64), "draws"));
            order.truncate(count);
            order.sort_unstable();
        }
        out.extend(order.into_iter().map(|i| (s, i)));
    }
    out
}

fn summarise_parameter(
    number: &super::ParameterPrior,
    column: &[Option<f64>],
    run: &[usize],
) -> ParameterSummary {
    let mut values: Vec<f64> = column.iter().flatten().copied().collect();
    let of_run = |r: usize| {
        let own = column.iter().zip(run).filter(|(_, own)| **own == r).filter_map(|(v, _)| *v);
        let (n, sum) = own.fold((0usize, 0.0), |(n, sum), v| (n + 1, sum + v));
        (n > 0).then(|| sum / n as f64)
    };
    let runs = (0..run.iter().max().map_or(0, |r| r + 1)).map(of_run).collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt();
    values.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let place = share * (values.len() - 1) as f64;
        let (i, part) = (place as usize, place.fract());
        values[i] + part * (values[(i + 1).min(values.len() - 1)] - values[i])
    };
    // Interquartile ranges: bounds may truncate much of the prior.
    let believed = (number.prior.quantile(0.75) - number.prior.quantile(0.25)).max(f64::MIN_POSITIVE);
    let left = (at(0.75) - at(0.25)) / believed;
    ParameterSummary {
        name: number.name.clone(),
        unit: number.unit.into(),
        setting: number.setting.clone(),
        prior: number.prior,
        mean,
        sd,
        runs,
        quantiles: QUANTILES.map(at),
        left,
        identifiable: left < MAX_IDENTIFIABLE_PRIOR_SHARE,
    }
}

fn summarise_set(of: &ModelPosterior) -> SetSummary {
    let draws = &of.draws;
    let n = draws.log_evidence.len() as f64;
    let log_evidence = (n > 0.0).then(|| {
        let mean = log_sum_exp(draws.log_evidence.iter().copied()) - libm::log(n);
        let centre = draws.log_evidence.iter().sum::<f64>() / n;
        let square =
            draws.log_evidence.iter().map(|l| (l - centre).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        [mean, (square / n).sqrt()]
    });
    SetSummary {
        effects: of.set.clone(),
        weight: of.weight,
        laplace_log_evidence: of.log_evidence,
        log_evidence,
        log_evidence_priors: log_evidence
            .map(|[mean, _]| [0.5, 2.0].map(|wider| mean + reweighted_log_evidence(of, wider))),
        discrepancy: of.fields.iter().map(|(f, p)| FieldProbability { field: *f, probability: *p }).collect(),
        quality: draws.quality.clone(),
        evaluations: draws.evaluations,
        windows: of.segments_and_groups.0,
        parts: of.segments_and_groups.1,
        fit: of.fit.clone(),
    }
}

/// Change of the log evidence if the priors of effect parameters are scaled by `wider`.
fn reweighted_log_evidence(of: &ModelPosterior, wider: f64) -> f64 {
    let own: Vec<Marginal> = of.parameters.iter().map(|n| n.prior).collect();
    let changed = |(n, m): (&super::ParameterPrior, &Marginal)| match *m {
        Marginal::Normal { mean, sd, low, high } if n.name.contains('.') => {
            Marginal::Normal { mean, sd: sd * wider, low, high }
        }
        other => other,
    };
    let other: Vec<Marginal> = of.parameters.iter().zip(&own).map(changed).collect();
    let (Ok(own), Ok(other)) =
        (crate::estimate::sampler::JointPrior::new(own), crate::estimate::sampler::JointPrior::new(other))
    else {
        return f64::NAN;
    };
    let logs: Vec<f64> = of.draws.points.iter().map(|p| other.log_density(p) - own.log_density(p)).collect();
    log_sum_exp(logs.iter().copied()) - libm::log(logs.len().max(1) as f64)
}

/// Description of a field's basis.
fn describe_inputs(over: FieldInputs) -> &'static str {
    match over {
        FieldInputs::Powers => "monomials of position, velocity and speed",
        FieldInputs::Velocity => "radial basis functions of velocity",
        FieldInputs::Clock => "radial basis functions of time",
        FieldInputs::All | FieldInputs::Place | FieldInputs::Heading => "radial basis functions of position",
    }
}

/// Warnings about convergence and model discrepancy.
fn warnings(posterior: &Posterior, follow: bool) -> Vec<String> {
    let mut out = Vec::new();
    for of in posterior.sets.iter().filter(|of| of.weight > MIN_SET_WEIGHT) {
        let name = if of.set.is_empty() { "the base model".to_string() } else { of.set.join(" + ") };
        if let Err(why) = of.draws.quality.verdict() {
            out.push(format!("{name}: {why}"));
        }
        let shared = 1.0 - of.fields.first().map_or(1.0, |f| f.1);
        if shared > DISCREPANCY_WARNING_PROBABILITY {
            let then = match (of.sampled_field, follow) {
                (Some(over), _) => format!("every draw represents it by {}", describe_inputs(over)),
                (None, true) => "no field that predicts the trials better was found".into(),
                (None, false) => "draws contain an estimate of it, which is too small if the discrepancy is strong, and intervals then miss the truth (`iplw posterior --sample-discrepancy` samples it properly)".into(),
            };
            out.push(format!(
                "{name}: the trials share a force that this model lacks (probability {shared:.3}); {then}; `iplw diagnose` searches for its \
                 name"
            ));
        }
    }
    out
}

impl PosteriorDocument {
    /// Readable name of the sampler.
    pub fn method(&self) -> &'static str {
        match self.config.sampler {
            Sampler::Smc(_) => "sequential Monte Carlo",
            Sampler::Mcmc(_) => "Markov chains",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::ParameterSamples;
    use crate::estimate::sampler::PosteriorDraws;

    /// A set of `count` draws, each with `terms` discrepancy effects whose amplitude identifies the draw.
    fn model_posterior(count: usize, weight: f64, terms: usize) -> ModelPosterior {
        let effects = vec![EffectTerm { name: "monomial".into(), parameters: BTreeMap::new() }; terms];
        let amplitudes = (0..count).map(|i| vec![1e-3 * i as f64; 2 * terms]).collect();
        let forces = DiscrepancyForces { effects, draws: (0..count).collect(), amplitudes };
        let carried = FieldDraws { over: FieldInputs::Powers, forces };
        let quality = SamplingDiagnostics { r_hat: vec![1.0], effective: vec![count as f64], accepted: 0.5 };
        ModelPosterior {
            set: Vec::new(),
            parameters: vec![super::super::ParameterPrior {
                name: "friction".into(),
                unit: "1",
                setting: None,
                prior: Marginal::Normal { mean: 1.0, sd: 0.5, low: 0.0, high: 10.0 },
            }],
            fit: vec![0.5],
            draws: PosteriorDraws {
                points: (0..count).map(|i| vec![1e-3 * i as f64]).collect(),
                log_likelihoods: vec![0.0; count],
                run: vec![0; count],
                log_evidence: Vec::new(),
                evaluations: 0,
                quality,
            },
            fields: Vec::new(),
            field_draws: vec![carried],
            sampled_field: None,
            weight,
            log_evidence: 0.0,
            segments_and_groups: (1, 1),
        }
    }

    fn document(sets: Vec<ModelPosterior>) -> PosteriorDocument {
        let posterior = Posterior { sets, trials: [4, 4], noise: 0.005, predictive: Vec::new() };
        PosteriorDocument::new(&posterior, &PosteriorConfig::standard(3))
    }

    /// Every draw keeps its own force, also in a mixture of sets.
    #[test]
    fn draws_keep_their_forces() {
        let found = document(vec![model_posterior(100, 0.3, 2), model_posterior(100, 0.7, 3)]);
        let belief = ParameterSamples::from_value(serde_json::to_value(&found).unwrap()).unwrap();
        assert_eq!((belief.draws().len(), found.discrepancy.len()), (100, 2));
        for (draw, set) in belief.draws().iter().zip(&found.set) {
            assert_eq!(draw.unnamed, 2 + set);
            let friction = draw.latents.friction.unwrap();
            assert!(draw.effects.iter().all(|e| e.parameters["ay"] == friction), "{draw:?}");
        }
    }

    /// A document can be read back: excess draws are thinned with a warning.
    #[test]
    fn document_round_trips_with_thinning() {
        let found = document(vec![model_posterior(4000, 1.0, 100)]);
        assert_eq!(found.set.len(), MAX_WRITTEN_TERMS / 100);
        assert!(found.warnings.iter().any(|w| w.contains("2000 of 4000 draws")), "{:?}", found.warnings);
        let belief = ParameterSamples::from_value(serde_json::to_value(&found).unwrap()).unwrap();
        assert!(belief.draws().iter().all(|d| d.unnamed == 100));
        // The limit applies to the draws of the document, not to all draws of all sets.
        let several = document((0..4).map(|_| model_posterior(1000, 0.25, 100)).collect());
        assert_eq!((several.set.len(), several.warnings.len()), (1000, 0), "{:?}", several.warnings);
    }
}
