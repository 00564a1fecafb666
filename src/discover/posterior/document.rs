//! A posterior as it is written: `iplw.posterior/1`.

use serde::{Deserialize, Serialize};

use super::{Carried, Field, OfSet, Posterior, PosteriorConfig, Sampler};
use crate::discover::field::Over;
use crate::estimate::belief::POSTERIOR_FORMAT;
use crate::estimate::forces::{MOST_CARRIED, UnnamedForces};
use crate::estimate::sampler::{Marginal, Quality, log_sum_exp};
use crate::rng;
use crate::task::scene::EffectTerm;
use rand::seq::SliceRandom;
use std::collections::BTreeMap;

/// What is known, with everything that it was made from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Document {
    pub format: String,
    pub version: String,
    pub config: PosteriorConfig,
    pub seed: u64,
    /// Whether independent runs agree and there are draws enough, in every set that weighs anything; and if not, why not.
    pub converged: bool,
    pub warnings: Vec<String>,
    /// Trials that had anything to say, of those that there were.
    pub trials: [usize; 2],
    /// Noise of an observed coordinate, m.
    pub noise_m: f64,
    pub parameters: Vec<Parameter>,
    pub sets: Vec<Set>,
    /// Effects that every draw has beside its columns.
    pub effects: Vec<EffectTerm>,
    /// Draws by name of the number; `null` where a draw's set has no such effect. Draws of all sets, as many of each as it weighs.
    pub columns: BTreeMap<String, Vec<Option<f64>>>,
    /// Of every draw: index of its set, of its independent run, and its log likelihood.
    pub set: Vec<usize>,
    pub run: Vec<usize>,
    pub log_likelihood: Vec<f64>,
    /// Forces without a name that some draws have beside all that.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unnamed: Vec<OfDraws>,
}

/// A kind of force without a name, and what it is in each draw that has one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OfDraws {
    /// Index of the draws' set, and what the force depends on.
    pub set: usize,
    pub over: Over,
    #[serde(flatten)]
    pub forces: UnnamedForces,
}

/// What is known of a number, over all draws that have it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    pub name: String,
    pub unit: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub setting: Option<String>,
    pub prior: Marginal,
    pub mean: f64,
    pub sd: f64,
    /// Mean of every independent run's draws; none of a run that has no draw of it.
    #[serde(default)]
    pub runs: Vec<Option<f64>>,
    /// 2.5, 5, 25, 50, 75, 95, 97.5 %.
    pub quantiles: [f64; 7],
    /// Share of the prior's standard deviation that is left: near 1, the trials tell nothing.
    pub left: f64,
    pub identifiable: bool,
}

/// A set of effects, how much it weighs and how far its draws can be trusted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Set {
    pub effects: Vec<String>,
    /// Probability among the sets, by how it predicts launches from the others (bootstrapped).
    pub weight: f64,
    /// Log predictive density of all launches, each told from the others.
    pub predictive: f64,
    /// Logarithm of the marginal likelihood, and its standard error over independent runs; none by Markov chains.
    pub log_evidence: Option<[f64; 2]>,
    /// The same with the deviations of effects' priors halved and doubled, by weighing draws anew.
    pub log_evidence_priors: Option<[f64; 2]>,
    /// Probability of each shared field that the model may lack, none first; those that the fit rules out are left out.
    pub discrepancy: Vec<Lacks>,
    pub quality: Quality,
    pub evaluations: u64,
    pub windows: usize,
    pub parts: usize,
    /// Where the fit stood, in the order of its numbers.
    pub fit: Vec<f64>,
}

/// A shared field, and its probability.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lacks {
    #[serde(flatten)]
    pub field: Field,
    pub probability: f64,
}

/// Probability of a set below which its draws' quality is nobody's concern.
const SLIGHT: f64 = 0.01;
/// Probability that something shared is left out beyond which it is said.
const LIKELY: f64 = 0.95;
/// Share of the prior's deviation above which nothing was told.
const UNTOLD: f64 = 0.9;
const QUANTILES: [f64; 7] = [0.025, 0.05, 0.25, 0.5, 0.75, 0.95, 0.975];

impl Document {
    pub fn new(posterior: &Posterior, config: &PosteriorConfig) -> Document {
        let all = mixed(&posterior.sets, config.seed);
        let (draws, left_out) = readable(&posterior.sets, all);
        let mut columns: BTreeMap<String, Vec<Option<f64>>> = BTreeMap::new();
        let mut parameters: Vec<Parameter> = Vec::new();
        for (s, of) in posterior.sets.iter().enumerate() {
            for (k, number) in of.numbers.iter().enumerate() {
                let values = columns.entry(number.column()).or_insert_with(|| vec![None; draws.len()]);
                for (place, (set, draw)) in draws.iter().enumerate() {
                    if *set == s {
                        values[place] = Some(of.draws.points[*draw][k]);
                    }
                }
            }
        }
        let run: Vec<usize> = draws.iter().map(|(s, i)| posterior.sets[*s].draws.run[*i]).collect();
        for number in posterior.sets.iter().flat_map(|of| &of.numbers) {
            let known = parameters.iter().any(|p| p.name == number.name && p.setting == number.setting);
            let column = &columns[&number.column()];
            if !known && column.iter().any(Option::is_some) {
                parameters.push(parameter(number, column, &run));
            }
        }
        let mut warnings = warnings(posterior, config.follow);
        warnings.extend(left_out);
        let unnamed = unnamed(&posterior.sets, &draws);
        Document {
            format: POSTERIOR_FORMAT.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            config: config.clone(),
            seed: config.seed,
            converged: !posterior
                .sets
                .iter()
                .any(|of| of.weight > SLIGHT && of.draws.quality.verdict().is_err()),
            warnings,
            trials: posterior.trials,
            noise_m: posterior.noise,
            parameters,
            sets: posterior.sets.iter().map(set).collect(),
            effects: Vec::new(),
            columns,
            set: draws.iter().map(|d| d.0).collect(),
            run,
            log_likelihood: draws.iter().map(|(s, i)| posterior.sets[*s].draws.log_likelihoods[*i]).collect(),
            unnamed,
        }
    }
}

/// Forces without a name by set and kind, draws numbered as the document has them.
fn unnamed(sets: &[OfSet], draws: &[(usize, usize)]) -> Vec<OfDraws> {
    let mut out = Vec::new();
    for (s, of) in sets.iter().enumerate() {
        let places: BTreeMap<usize, usize> =
            draws.iter().enumerate().filter(|(_, d)| d.0 == s).map(|(place, d)| (d.1, place)).collect();
        for Carried { over, forces } in &of.carried {
            let own = forces.draws.iter().zip(&forces.amplitudes);
            let (draws, amplitudes): (Vec<usize>, Vec<Vec<f64>>) =
                own.filter_map(|(draw, a)| Some((*places.get(draw)?, a.clone()))).unzip();
            if !draws.is_empty() {
                let forces = UnnamedForces { effects: forces.effects.clone(), draws, amplitudes };
                out.push(OfDraws { set: s, over: *over, forces });
            }
        }
    }
    out
}

/// As many of the draws, evenly, as a document can hold with the forces that they carry; and a word on it where that is not all of them.
fn readable(sets: &[OfSet], draws: Vec<(usize, usize)>) -> (Vec<(usize, usize)>, Option<String>) {
    let terms: usize = unnamed(sets, &draws).iter().map(|own| own.forces.terms()).sum();
    if terms <= MOST_CARRIED {
        return (draws, None);
    }
    let (all, kept) = (draws.len(), (draws.len() * MOST_CARRIED / terms).max(1));
    let told = format!(
        "{kept} of {all} draws are kept: they carry up to {MOST_CARRIED} effects of forces without a name together"
    );
    ((0..kept).map(|i| draws[i * all / kept]).collect(), Some(told))
}

/// Draws of all sets, as many of each as it weighs: (set, draw). Of a single set all, in their order.
fn mixed(sets: &[OfSet], seed: u64) -> Vec<(usize, usize)> {
    let total = sets.iter().map(|s| s.draws.points.len()).max().unwrap_or(0);
    let mut out = Vec::new();
    let mut owed = 0.0;
    for (s, of) in sets.iter().enumerate() {
        let n = of.draws.points.len();
        owed += of.weight * total as f64;
        let count = ((owed - out.len() as f64).round().max(0.0) as usize).min(n);
        let mut order: Vec<usize> = (0..n).collect();
        if count < n {
            order.shuffle(&mut rng::stream(rng::derive(seed, "mixture", s as u64), "draws"));
            order.truncate(count);
            order.sort_unstable();
        }
        out.extend(order.into_iter().map(|i| (s, i)));
    }
    out
}

fn parameter(number: &super::Known, column: &[Option<f64>], run: &[usize]) -> Parameter {
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
    // Quartiles of the prior in place of its deviation: bounds may cut much of it off.
    let believed = (number.prior.quantile(0.75) - number.prior.quantile(0.25)).max(f64::MIN_POSITIVE);
    let left = (at(0.75) - at(0.25)) / believed;
    Parameter {
        name: number.name.clone(),
        unit: number.unit.into(),
        setting: number.setting.clone(),
        prior: number.prior,
        mean,
        sd,
        runs,
        quantiles: QUANTILES.map(at),
        left,
        identifiable: left < UNTOLD,
    }
}

fn set(of: &OfSet) -> Set {
    let draws = &of.draws;
    let n = draws.log_evidence.len() as f64;
    let log_evidence = (n > 0.0).then(|| {
        let mean = log_sum_exp(draws.log_evidence.iter().copied()) - libm::log(n);
        let centre = draws.log_evidence.iter().sum::<f64>() / n;
        let square =
            draws.log_evidence.iter().map(|l| (l - centre).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        [mean, (square / n).sqrt()]
    });
    Set {
        effects: of.set.clone(),
        weight: of.weight,
        predictive: of.predictive,
        log_evidence,
        log_evidence_priors: log_evidence
            .map(|[mean, _]| [0.5, 2.0].map(|wider| mean + reweighed(of, wider))),
        discrepancy: of.fields.iter().map(|(f, p)| Lacks { field: *f, probability: *p }).collect(),
        quality: draws.quality.clone(),
        evaluations: draws.evaluations,
        windows: of.sizes.0,
        parts: of.sizes.1,
        fit: of.fit.clone(),
    }
}

/// By how much the log evidence changes where the priors of effects' parameters are so much wider.
fn reweighed(of: &OfSet, wider: f64) -> f64 {
    let own: Vec<Marginal> = of.numbers.iter().map(|n| n.prior).collect();
    let changed = |(n, m): (&super::Known, &Marginal)| match *m {
        Marginal::Normal { mean, sd, low, high } if n.name.contains('.') => {
            Marginal::Normal { mean, sd: sd * wider, low, high }
        }
        other => other,
    };
    let other: Vec<Marginal> = of.numbers.iter().zip(&own).map(changed).collect();
    let (Ok(own), Ok(other)) =
        (crate::estimate::sampler::Prior::new(own), crate::estimate::sampler::Prior::new(other))
    else {
        return f64::NAN;
    };
    let logs: Vec<f64> = of.draws.points.iter().map(|p| other.log_density(p) - own.log_density(p)).collect();
    log_sum_exp(logs.iter().copied()) - libm::log(logs.len().max(1) as f64)
}

/// What a field is made of.
fn words(over: Over) -> &'static str {
    match over {
        Over::Powers => "powers of place, velocity and speed",
        Over::Velocity => "bumps over velocity",
        Over::Clock => "bumps over the clock",
        Over::All | Over::Place | Over::Heading => "bumps over place",
    }
}

/// What is to be said of draws before they are trusted.
fn warnings(posterior: &Posterior, follow: bool) -> Vec<String> {
    let mut out = Vec::new();
    for of in posterior.sets.iter().filter(|of| of.weight > SLIGHT) {
        let name = if of.set.is_empty() { "the scene as it is".to_string() } else { of.set.join(" + ") };
        if let Err(why) = of.draws.quality.verdict() {
            out.push(format!("{name}: {why}"));
        }
        let shared = 1.0 - of.fields.first().map_or(1.0, |f| f.1);
        if shared > LIKELY {
            let then = match (of.followed, follow) {
                (Some(over), _) => format!("{} stand in for it in every draw", words(over)),
                (None, true) => "nothing could be followed that predicts beginnings better".into(),
                (None, false) => "draws carry what it may be, too little of it where it is strong, and intervals do not hold the truth (with `iplw posterior --follow` they mostly do)".into(),
            };
            out.push(format!(
                "{name}: launches share something that this model lacks (probability {shared:.3}); {then}; `iplw diagnose` looks for its \
                 name"
            ));
        }
    }
    out
}

impl Document {
    /// Names of the sampler, for people.
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
    use crate::estimate::Belief;
    use crate::estimate::sampler::Draws;

    /// A set of `count` draws, each of which carries `terms` effects by its number.
    fn of(count: usize, weight: f64, terms: usize) -> OfSet {
        let effects = vec![EffectTerm { name: "monomial".into(), parameters: BTreeMap::new() }; terms];
        let amplitudes = (0..count).map(|i| vec![1e-3 * i as f64; 2 * terms]).collect();
        let forces = UnnamedForces { effects, draws: (0..count).collect(), amplitudes };
        let carried = Carried { over: Over::Powers, forces };
        let quality = Quality { r_hat: vec![1.0], effective: vec![count as f64], accepted: 0.5 };
        OfSet {
            set: Vec::new(),
            numbers: vec![super::super::Known {
                name: "friction".into(),
                unit: "1",
                setting: None,
                prior: Marginal::Normal { mean: 1.0, sd: 0.5, low: 0.0, high: 10.0 },
            }],
            fit: vec![0.5],
            draws: Draws {
                points: (0..count).map(|i| vec![1e-3 * i as f64]).collect(),
                log_likelihoods: vec![0.0; count],
                run: vec![0; count],
                log_evidence: Vec::new(),
                evaluations: 0,
                quality,
            },
            fields: Vec::new(),
            carried: vec![carried],
            followed: None,
            weight,
            predictive: 0.0,
            sizes: (1, 1),
        }
    }

    fn document(sets: Vec<OfSet>) -> Document {
        let posterior = Posterior { sets, trials: [4, 4], noise: 0.005 };
        Document::new(&posterior, &PosteriorConfig::standard(3))
    }

    /// Every draw has the force that it was drawn with, also where a document holds some draws of several sets.
    #[test]
    fn draws_keep_their_own_forces() {
        let found = document(vec![of(100, 0.3, 2), of(100, 0.7, 3)]);
        let belief = Belief::from_value(serde_json::to_value(&found).unwrap()).unwrap();
        assert_eq!((belief.draws().len(), found.unnamed.len()), (100, 2));
        for (draw, set) in belief.draws().iter().zip(&found.set) {
            assert_eq!(draw.unnamed, 2 + set);
            let friction = draw.latents.friction.unwrap();
            assert!(draw.effects.iter().all(|e| e.parameters["ay"] == friction), "{draw:?}");
        }
    }

    /// What is written can be read: of more than a document holds some draws are kept, and that is said.
    #[test]
    fn what_is_written_can_be_read() {
        let found = document(vec![of(4000, 1.0, 100)]);
        assert_eq!(found.set.len(), MOST_CARRIED / 100);
        assert!(found.warnings.iter().any(|w| w.contains("2000 of 4000 draws")), "{:?}", found.warnings);
        let belief = Belief::from_value(serde_json::to_value(&found).unwrap()).unwrap();
        assert!(belief.draws().iter().all(|d| d.unnamed == 100));
        // What counts is what the document's draws carry, not what all draws of all sets do.
        let several = document((0..4).map(|_| of(1000, 0.25, 100)).collect());
        assert_eq!((several.set.len(), several.warnings.len()), (1000, 0), "{:?}", several.warnings);
    }
}
