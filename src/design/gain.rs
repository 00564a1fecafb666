//! Expected information: the mutual information between the answer to a question and what would be seen.
//!
//! I = E [log p(y | q) - log p(y)], over worlds of the belief and what they show. Where every world is an answer of its own (latents),
//! p(y | q) is the density in that very world; where worlds share answers, it is the mean density over the others with the same answer.

use serde::{Deserialize, Serialize};

use super::told::Told;
use crate::estimate::sampler::log_sum_exp;

/// Expected information, and how well it is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gain {
    /// nats; of several things that are asked, their mean.
    pub information: f64,
    /// Its standard error over worlds, nats; of several, at most that.
    pub standard_error: f64,
    /// Probability of the right answer, expected, before and after; of questions with answers that worlds share. Of several, the mean over
    /// those that have two answers in the belief.
    pub right: Option<[f64; 2]>,
}

/// Which worlds answer a question alike.
#[derive(Clone, Debug, PartialEq)]
pub enum Labels {
    /// Every world is an answer of its own.
    Own,
    /// By world the number of its answer, and how likely every answer is beforehand.
    Shared { of: Vec<usize>, weights: Vec<f64> },
}

/// Fewest worlds with an answer whose density can be said.
pub const FEWEST: usize = 3;

/// Information that `told` is expected to bring about a question; nothing where fewer than two answers have worlds enough.
pub fn gain(told: &Told, labels: &Labels) -> Gain {
    match labels {
        Labels::Own => {
            let all = |i: usize| others(told, i, |_| true);
            mean(&(0..told.worlds()).map(|i| (1.0, told.own(i) - all(i))).collect::<Vec<_>>(), None)
        }
        Labels::Shared { of, weights } => shared(told, of, weights),
    }
}

/// Mean over what is asked, each a way to label worlds.
pub fn over(told: &Told, labels: &[Labels]) -> Gain {
    let all: Vec<Gain> = labels.iter().map(|l| gain(told, l)).collect();
    let mean = |of: &dyn Fn(&Gain) -> f64| all.iter().map(of).sum::<f64>() / all.len().max(1) as f64;
    let told: Vec<&Gain> = all.iter().filter(|g| g.right.is_some()).collect();
    let right =
        |k: usize| told.iter().filter_map(|g| g.right).map(|r| r[k]).sum::<f64>() / told.len().max(1) as f64;
    Gain {
        information: mean(&|g| g.information),
        standard_error: mean(&|g| g.standard_error),
        right: (!told.is_empty()).then(|| [right(0), right(1)]),
    }
}

fn shared(told: &Told, of: &[usize], weights: &[f64]) -> Gain {
    let counts: Vec<usize> = (0..weights.len()).map(|q| of.iter().filter(|o| **o == q).count()).collect();
    let known: Vec<usize> =
        (0..weights.len()).filter(|q| counts[*q] >= FEWEST && weights[*q] > 0.0).collect();
    if known.len() < 2 {
        return Gain::default();
    }
    let total: f64 = known.iter().map(|q| weights[*q]).sum();
    let weight = |q: usize| weights[q] / total;
    let (mut terms, mut after) = (Vec::new(), Vec::new());
    for (i, own) in of.iter().enumerate().filter(|(_, o)| known.contains(o)) {
        let logs: Vec<f64> =
            known.iter().map(|q| libm::log(weight(*q)) + others(told, i, |j| of[j] == *q)).collect();
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

/// Log of the mean density over other worlds of a kind of what world `i` shows.
fn others(told: &Told, i: usize, of: impl Fn(usize) -> bool) -> f64 {
    let logs: Vec<f64> =
        (0..told.worlds()).filter(|j| *j != i && of(*j)).map(|j| told.component(i, j)).collect();
    log_sum_exp(logs.iter().copied()) - libm::log(logs.len() as f64)
}

/// Weighted mean of terms and its standard error.
fn mean(terms: &[(f64, f64)], right: Option<[f64; 2]>) -> Gain {
    let total: f64 = terms.iter().map(|(w, _)| w).sum();
    let information = terms.iter().map(|(w, t)| w * t).sum::<f64>() / total;
    let spread: f64 = terms.iter().map(|(w, t)| (w * (t - information)).powi(2)).sum();
    Gain { information, standard_error: spread.sqrt() / total, right }
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::super::shown::Shown;
    use super::super::told::{Alike, Seen};
    use super::*;
    use crate::rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Worlds that show `slope` times a number, over coordinates each with a noise of 1; and those numbers.
    fn straight(worlds: usize, slopes: &[f64], seed: u64) -> (Shown, Vec<f64>) {
        let mut stream = rng::stream(seed, "straight");
        let numbers: Vec<f64> = (0..worlds).map(|_| StandardNormal.sample(&mut stream)).collect();
        let mean = DMatrix::from_fn(slopes.len(), worlds, |t, j| slopes[t] * numbers[j]);
        let spread = vec![DMatrix::zeros(slopes.len(), 3); worlds];
        (Shown { held: mean.clone(), mean, spread }, numbers)
    }

    /// What is told of one group of worlds, in noise of unit variance.
    fn told_of(shown: &Shown, numbers: &[f64], seed: u64) -> Told {
        let numbers: Vec<Vec<f64>> = numbers.iter().map(|v| vec![*v]).collect();
        let groups = vec![0; numbers.len()];
        let alike = Alike { groups: &groups, numbers: &numbers };
        Seen::new(shown, alike, 1.0, &mut rng::stream(seed, "noise")).told(alike).unwrap()
    }

    /// A number of unit variance seen through slopes b in noise of unit variance: I = log(1 + b.b) / 2.
    #[test]
    fn a_straight_world_s_information_is_what_it_should_be() {
        for slopes in [vec![0.5, 0.5], vec![2.0, 1.0, 0.0], vec![6.0; 4]] {
            let wanted = 0.5 * (1.0 + slopes.iter().map(|b| b * b).sum::<f64>()).ln();
            let found: Vec<f64> = (0..8)
                .map(|seed| {
                    let (shown, numbers) = straight(200, &slopes, seed);
                    gain(&told_of(&shown, &numbers, seed), &Labels::Own).information
                })
                .collect();
            let mean = found.iter().sum::<f64>() / 8.0;
            assert!(
                (mean - wanted).abs() < 0.1 * wanted + 0.03,
                "{slopes:?}: {mean} for {wanted}, {found:?}"
            );
        }
    }

    /// Two answers that show -d and d in noise of unit variance: the information of a binary channel, by quadrature.
    #[test]
    fn two_answers_are_told_as_far_as_they_are_apart() {
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
            let mean = DMatrix::from_fn(1, 400, |_, j| sign(j));
            let shown = Shown { held: mean.clone(), mean, spread: vec![DMatrix::zeros(1, 3); 400] };
            let alike = Alike { groups: &of, numbers: &vec![vec![]; 400] };
            let told = Seen::new(&shown, alike, 1.0, &mut rng::stream(3, "noise")).told(alike).unwrap();
            let found = gain(&told, &Labels::Shared { of, weights: vec![0.5, 0.5] });
            let error = (found.information - wanted).abs();
            assert!(error < 3.0 * found.standard_error + 0.01, "{d}: {found:?} for {wanted}");
            assert!(found.right.is_some_and(|[before, after]| before == 0.5 && after > 0.49), "{found:?}");
        }
    }

    /// What a trembling hand does to a coordinate hides what a world does to it.
    #[test]
    fn chaos_is_no_information() {
        let (shown, numbers) = straight(100, &[5.0, 5.0], 1);
        let mut stream = rng::stream(2, "tremble");
        let mut tremble = || 100.0 * Distribution::<f64>::sample(&StandardNormal, &mut stream);
        let spread = (0..100).map(|_| DMatrix::from_fn(2, 4, |_, _| tremble() / 2.0)).collect();
        let held = shown.held.map(|v| v + tremble());
        let chaotic = Shown { held, spread, ..shown.clone() };
        let of = |shown: &Shown| gain(&told_of(shown, &numbers, 3), &Labels::Own).information;
        assert!(of(&shown) > 1.5 && of(&chaotic) < 0.2, "{} {}", of(&shown), of(&chaotic));
    }

    /// Sets that are alike are not told apart, however many directions their worlds spread in and however few worlds there are.
    #[test]
    fn answers_that_are_alike_are_not_told_apart() {
        for (sets, each) in [(2, 16), (3, 16), (2, 64)] {
            let worlds = sets * each;
            let mut stream = rng::stream(worlds as u64, "alike");
            let mut wild = || 20.0 * Distribution::<f64>::sample(&StandardNormal, &mut stream);
            let mean = DMatrix::from_fn(16, worlds, |_, _| wild());
            let shown = Shown { held: mean.clone(), mean, spread: vec![DMatrix::zeros(16, 3); worlds] };
            let of: Vec<usize> = (0..worlds).map(|i| i % sets).collect();
            let alike = Alike { groups: &of, numbers: &vec![vec![]; worlds] };
            let told = Seen::new(&shown, alike, 1.0, &mut rng::stream(3, "noise")).told(alike).unwrap();
            let found = gain(&told, &Labels::Shared { of, weights: vec![1.0 / sets as f64; sets] });
            assert!(found.information < 0.1, "{sets} sets of {each}: {found:?}");
            let [before, after] = found.right.unwrap();
            assert!((before - 1.0 / sets as f64).abs() < 1e-12 && after < before + 0.1, "{found:?}");
        }
    }

    /// What follows no number tells nothing of it, in many directions, too.
    #[test]
    fn numbers_that_nothing_follows_are_not_told() {
        for worlds in [32, 128] {
            let mut stream = rng::stream(worlds as u64, "loose");
            let mut wild = || 20.0 * Distribution::<f64>::sample(&StandardNormal, &mut stream);
            let mean = DMatrix::from_fn(16, worlds, |_, _| wild());
            let numbers: Vec<f64> = (0..worlds).map(|_| wild()).collect();
            let shown = Shown { held: mean.clone(), mean, spread: vec![DMatrix::zeros(16, 3); worlds] };
            let found = gain(&told_of(&shown, &numbers, 3), &Labels::Own);
            assert!(found.information < 3.0 * found.standard_error + 0.1, "{worlds}: {found:?}");
        }
    }

    /// The same experiment twice tells as much as one with half the variance of noise; and two of different numbers their sum.
    #[test]
    fn what_two_experiments_tell_is_told_once() {
        let (shown, numbers) = straight(200, &[4.0], 1);
        let numbers: Vec<Vec<f64>> = numbers.iter().map(|v| vec![*v]).collect();
        let alike = Alike { groups: &[0; 200], numbers: &numbers };
        let seen = |k: u64| Seen::new(&shown, alike, 1.0, &mut rng::stream(k, "noise"));
        let of = |seen: &Seen| gain(&seen.told(alike).unwrap(), &Labels::Own).information;
        let (one, two) = (of(&seen(1)), of(&seen(1).and(&seen(2), alike)));
        let wanted = 0.5 * (33f64.ln() - 17f64.ln());
        assert!((two - one - wanted).abs() < 0.15, "{one} and then {two}, {wanted} more");
    }

    /// What worlds show that does not follow their numbers tells nothing of them: a wild function of a number is noise.
    #[test]
    fn what_is_not_smooth_is_no_information() {
        let (shown, numbers) = straight(100, &[5.0, 5.0], 1);
        let wild = DMatrix::from_fn(2, 100, |t, j| 50.0 * (1e4 * numbers[j] + t as f64).sin());
        let wild = Shown { mean: wild.clone(), held: wild, ..shown };
        let found = gain(&told_of(&wild, &numbers, 3), &Labels::Own).information;
        assert!(found < 0.3, "{found}");
    }

    #[test]
    fn an_answer_that_no_other_world_gives_tells_nothing() {
        let (shown, numbers) = straight(20, &[2.0], 1);
        let told = told_of(&shown, &numbers, 3);
        let mut of = vec![0; 20];
        of[3] = 1;
        assert_eq!(gain(&told, &Labels::Shared { of, weights: vec![0.95, 0.05] }), Gain::default());
    }
}
