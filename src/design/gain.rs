//! Expected information gain: the mutual information between the answer to a question and the observations.
//!
//! I = E [log p(y | q) - log p(y)], over sampled worlds and their observations. Where every world is its own answer (latents),
//! p(y | q) is the density in that world; where worlds share answers, it is the mean density over the others with the same answer.

use serde::{Deserialize, Serialize};

use super::likelihood::LikelihoodMatrix;
use crate::estimate::sampler::log_sum_exp;

/// Expected information gain with its standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InformationGain {
    /// Expected information gain, nats; the mean over several questions.
    pub information: f64,
    /// Standard error over worlds, nats; an upper bound for several questions.
    pub standard_error: f64,
    /// Expected probability of the right answer before and after, for questions whose answers are shared by worlds. For several
    /// questions, the mean over those with at least two answers in the posterior.
    pub right: Option<[f64; 2]>,
}

/// Partition of the sampled worlds by their answer to a question.
#[derive(Clone, Debug, PartialEq)]
pub enum AnswerPartition {
    /// Every world is its own answer.
    Distinct,
    /// `of`: index of the answer by world; `weights`: prior probability of each answer.
    Shared { of: Vec<usize>, weights: Vec<f64> },
}

/// Minimal number of worlds with an answer for its density to be estimated.
pub const MIN_WORLDS_PER_ANSWER: usize = 3;

/// Expected information gain about a question; zero where fewer than two answers have enough worlds.
pub fn information_gain(likelihoods: &LikelihoodMatrix, labels: &AnswerPartition) -> InformationGain {
    match labels {
        AnswerPartition::Distinct => {
            let all = |i: usize| log_mean_density_of_others(likelihoods, i, |_| true);
            mean(
                &(0..likelihoods.worlds())
                    .map(|i| (1.0, likelihoods.own_log_density(i) - all(i)))
                    .collect::<Vec<_>>(),
                None,
            )
        }
        AnswerPartition::Shared { of, weights } => shared_answer_gain(likelihoods, of, weights),
    }
}

/// Mean over questions, each given by its partition of the worlds.
pub fn mean_information_gain(likelihoods: &LikelihoodMatrix, labels: &[AnswerPartition]) -> InformationGain {
    let all: Vec<InformationGain> = labels.iter().map(|l| information_gain(likelihoods, l)).collect();
    let mean =
        |of: &dyn Fn(&InformationGain) -> f64| all.iter().map(of).sum::<f64>() / all.len().max(1) as f64;
    let likelihoods: Vec<&InformationGain> = all.iter().filter(|g| g.right.is_some()).collect();
    let right = |k: usize| {
        likelihoods.iter().filter_map(|g| g.right).map(|r| r[k]).sum::<f64>()
            / likelihoods.len().max(1) as f64
    };
    InformationGain {
        information: mean(&|g| g.information),
        standard_error: mean(&|g| g.standard_error),
        right: (!likelihoods.is_empty()).then(|| [right(0), right(1)]),
    }
}

fn shared_answer_gain(likelihoods: &LikelihoodMatrix, of: &[usize], weights: &[f64]) -> InformationGain {
    let counts: Vec<usize> = (0..weights.len()).map(|q| of.iter().filter(|o| **o == q).count()).collect();
    let known: Vec<usize> =
        (0..weights.len()).filter(|q| counts[*q] >= MIN_WORLDS_PER_ANSWER && weights[*q] > 0.0).collect();
    if known.len() < 2 {
        return InformationGain::default();
    }
    let total: f64 = known.iter().map(|q| weights[*q]).sum();
    let weight = |q: usize| weights[q] / total;
    let (mut terms, mut after) = (Vec::new(), Vec::new());
    for (i, own) in of.iter().enumerate().filter(|(_, o)| known.contains(o)) {
        let logs: Vec<f64> = known
            .iter()
            .map(|q| libm::log(weight(*q)) + log_mean_density_of_others(likelihoods, i, |j| of[j] == *q))
            .collect();
        let all = log_sum_exp(logs.iter().copied());
        let right = known.iter().position(|q| q == own).map_or(0.0, |k| logs[k] - all);
        let share = weight(*own) / counts[*own] as f64;
        // log p(y | q) - log p(y) = log p(q | y) - log p(q).
        terms.push((share, right - libm::log(weight(*own))));
        after.push((share, libm::exp(right)));
    }
    let before = known.iter().map(|q| weight(*q) * weight(*q)).sum();
    mean(&terms, Some([before, after.iter().map(|(w, p)| w * p).sum()]))
}

/// Log of the mean density of world `i`'s observations over the other worlds for which `of` holds.
fn log_mean_density_of_others(likelihoods: &LikelihoodMatrix, i: usize, of: impl Fn(usize) -> bool) -> f64 {
    let logs: Vec<f64> = (0..likelihoods.worlds())
        .filter(|j| *j != i && of(*j))
        .map(|j| likelihoods.log_density(i, j))
        .collect();
    log_sum_exp(logs.iter().copied()) - libm::log(logs.len() as f64)
}

/// Weighted mean of (weight, value) terms with its standard error.
fn mean(terms: &[(f64, f64)], right: Option<[f64; 2]>) -> InformationGain {
    let total: f64 = terms.iter().map(|(w, _)| w).sum();
    let information = terms.iter().map(|(w, t)| w * t).sum::<f64>() / total;
    let spread: f64 = terms.iter().map(|(w, t)| (w * (t - information)).powi(2)).sum();
    InformationGain { information, standard_error: spread.sqrt() / total, right }
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::super::likelihood::{ComponentScores, Grouping};
    use super::super::predicted_observations::PredictedObservations;
    use super::*;
    use crate::rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Worlds with one normally distributed parameter, observed as `slope` times it in each coordinate; and the parameters.
    fn straight(worlds: usize, slopes: &[f64], seed: u64) -> (PredictedObservations, Vec<f64>) {
        let mut stream = rng::stream(seed, "straight");
        let numbers: Vec<f64> = (0..worlds).map(|_| StandardNormal.sample(&mut stream)).collect();
        (exact(DMatrix::from_fn(slopes.len(), worlds, |t, j| slopes[t] * numbers[j])), numbers)
    }

    /// Observations (coordinates, worlds) without actuation noise.
    fn exact(mean: DMatrix<f64>) -> PredictedObservations {
        let spread = vec![DMatrix::zeros(mean.nrows(), 3); mean.ncols()];
        PredictedObservations { held: mean.clone(), mean, spread }
    }

    /// Likelihoods with noise of unit variance.
    fn unit_noise_likelihoods(
        predicted: &PredictedObservations,
        grouping: Grouping,
        seed: u64,
    ) -> LikelihoodMatrix {
        let mut stream = rng::stream(seed, "noise");
        ComponentScores::new(predicted, grouping, 1.0, &mut stream).likelihoods(grouping).unwrap()
    }

    /// Likelihoods between the worlds of one group, with noise of unit variance.
    fn likelihoods_of(predicted: &PredictedObservations, numbers: &[f64], seed: u64) -> LikelihoodMatrix {
        let numbers: Vec<Vec<f64>> = numbers.iter().map(|v| vec![*v]).collect();
        let groups = vec![0; numbers.len()];
        unit_noise_likelihoods(predicted, Grouping { groups: &groups, numbers: &numbers }, seed)
    }

    /// A parameter of unit variance observed with slopes b in noise of unit variance: I = log(1 + b.b) / 2.
    #[test]
    fn matches_the_linear_gaussian_information() {
        for slopes in [vec![0.5, 0.5], vec![2.0, 1.0, 0.0], vec![6.0; 4]] {
            let wanted = 0.5 * (1.0 + slopes.iter().map(|b| b * b).sum::<f64>()).ln();
            let found: Vec<f64> = (0..8)
                .map(|seed| {
                    let (predicted, numbers) = straight(200, &slopes, seed);
                    information_gain(&likelihoods_of(&predicted, &numbers, seed), &AnswerPartition::Distinct)
                        .information
                })
                .collect();
            let mean = found.iter().sum::<f64>() / 8.0;
            assert!(
                (mean - wanted).abs() < 0.1 * wanted + 0.03,
                "{slopes:?}: {mean} for {wanted}, {found:?}"
            );
        }
    }

    /// Two answers observed as -d and d in noise of unit variance: the information of a binary channel, by quadrature.
    #[test]
    fn matches_the_information_of_a_binary_channel() {
        for d in [0.0, 0.5, 1.5, 4.0] {
            let wanted: f64 = (-8000..8000)
                .map(|k| {
                    let y = f64::from(k) * 1e-3 + d;
                    let density = (-(y - d) * (y - d) / 2.0).exp() / (2.0 * std::f64::consts::PI).sqrt();
                    density * 1e-3 * (2f64.ln() - (1.0 + (-2.0 * d * y).exp()).ln())
                })
                .sum();
            let of: Vec<usize> = (0..400).map(|i| i % 2).collect();
            let sign = |j: usize| if of[j] == 0 { -d } else { d };
            let predicted = exact(DMatrix::from_fn(1, 400, |_, j| sign(j)));
            let grouping = Grouping { groups: &of, numbers: &vec![vec![]; 400] };
            let likelihoods = unit_noise_likelihoods(&predicted, grouping, 3);
            let found =
                information_gain(&likelihoods, &AnswerPartition::Shared { of, weights: vec![0.5, 0.5] });
            let error = (found.information - wanted).abs();
            assert!(error < 3.0 * found.standard_error + 0.01, "{d}: {found:?} for {wanted}");
            assert!(found.right.is_some_and(|[before, after]| before == 0.5 && after > 0.49), "{found:?}");
        }
    }

    /// Large actuation noise hides the differences between worlds.
    #[test]
    fn actuation_noise_removes_information() {
        let (predicted, numbers) = straight(100, &[5.0, 5.0], 1);
        let mut stream = rng::stream(2, "tremble");
        let mut tremble = || 100.0 * Distribution::<f64>::sample(&StandardNormal, &mut stream);
        let spread = (0..100).map(|_| DMatrix::from_fn(2, 4, |_, _| tremble() / 2.0)).collect();
        let held = predicted.held.map(|v| v + tremble());
        let chaotic = PredictedObservations { held, spread, ..predicted.clone() };
        let of = |predicted: &PredictedObservations| {
            information_gain(&likelihoods_of(predicted, &numbers, 3), &AnswerPartition::Distinct).information
        };
        assert!(of(&predicted) > 1.5 && of(&chaotic) < 0.2, "{} {}", of(&predicted), of(&chaotic));
    }

    /// Identical sets can't be discriminated, in however many directions their worlds spread and however few worlds there are.
    #[test]
    fn identical_answers_give_no_information() {
        for (sets, each) in [(2, 16), (3, 16), (2, 64)] {
            let worlds = sets * each;
            let mut stream = rng::stream(worlds as u64, "alike");
            let mut wild = || 20.0 * Distribution::<f64>::sample(&StandardNormal, &mut stream);
            let predicted = exact(DMatrix::from_fn(16, worlds, |_, _| wild()));
            let of: Vec<usize> = (0..worlds).map(|i| i % sets).collect();
            let grouping = Grouping { groups: &of, numbers: &vec![vec![]; worlds] };
            let likelihoods = unit_noise_likelihoods(&predicted, grouping, 3);
            let found = information_gain(
                &likelihoods,
                &AnswerPartition::Shared { of, weights: vec![1.0 / sets as f64; sets] },
            );
            assert!(found.information < 0.1, "{sets} sets of {each}: {found:?}");
            let [before, after] = found.right.unwrap();
            assert!((before - 1.0 / sets as f64).abs() < 1e-12 && after < before + 0.1, "{found:?}");
        }
    }

    /// Observations independent of a parameter carry no information about it, in many directions, too.
    #[test]
    fn unobserved_parameters_give_no_information() {
        for worlds in [32, 128] {
            let mut stream = rng::stream(worlds as u64, "loose");
            let mut wild = || 20.0 * Distribution::<f64>::sample(&StandardNormal, &mut stream);
            let predicted = exact(DMatrix::from_fn(16, worlds, |_, _| wild()));
            let numbers: Vec<f64> = (0..worlds).map(|_| wild()).collect();
            let found =
                information_gain(&likelihoods_of(&predicted, &numbers, 3), &AnswerPartition::Distinct);
            assert!(found.information < 3.0 * found.standard_error + 0.1, "{worlds}: {found:?}");
        }
    }

    /// The same experiment twice is worth as much as one with half the noise variance.
    #[test]
    fn repeated_experiments_share_information() {
        let (predicted, numbers) = straight(200, &[4.0], 1);
        let numbers: Vec<Vec<f64>> = numbers.iter().map(|v| vec![*v]).collect();
        let grouping = Grouping { groups: &[0; 200], numbers: &numbers };
        let seen = |k: u64| ComponentScores::new(&predicted, grouping, 1.0, &mut rng::stream(k, "noise"));
        let of = |seen: &ComponentScores| {
            information_gain(&seen.likelihoods(grouping).unwrap(), &AnswerPartition::Distinct).information
        };
        let (one, two) = (of(&seen(1)), of(&seen(1).combined_with(&seen(2), grouping)));
        let wanted = 0.5 * (33f64.ln() - 17f64.ln());
        assert!((two - one - wanted).abs() < 0.15, "{one} and then {two}, {wanted} more");
    }

    /// A rapidly varying function of a parameter counts as noise.
    #[test]
    fn rough_dependence_gives_no_information() {
        let (predicted, numbers) = straight(100, &[5.0, 5.0], 1);
        let wild = DMatrix::from_fn(2, 100, |t, j| 50.0 * (1e4 * numbers[j] + t as f64).sin());
        let wild = PredictedObservations { mean: wild.clone(), held: wild, ..predicted };
        let found =
            information_gain(&likelihoods_of(&wild, &numbers, 3), &AnswerPartition::Distinct).information;
        assert!(found < 0.3, "{found}");
    }

    #[test]
    fn answers_of_a_single_world_give_no_information() {
        let (predicted, numbers) = straight(20, &[2.0], 1);
        let likelihoods = likelihoods_of(&predicted, &numbers, 3);
        let mut of = vec![0; 20];
        of[3] = 1;
        assert_eq!(
            information_gain(&likelihoods, &AnswerPartition::Shared { of, weights: vec![0.95, 0.05] }),
            InformationGain::default()
        );
    }
}
