//! Scores of trials: expected log Bayes factors of pairs of effects, and expected information about their sizes.

use std::ops::Range;

use nalgebra::DMatrix;
use rand::RngExt;

use super::config::{ExcitationConfig, ExcitationGoal};
use crate::inference::mechanism::{ExcitationInformation, effect_in_joint};
use crate::rng::Stream;
use crate::world::mechanism::Tree;

/// Log Bayes factor from which a recording discriminates between two effects: a thousand to one.
const ENOUGH: f64 = 6.9;
/// Size at which effects are to be discriminated, in plausible standard deviations: six effects in ten are larger.
const SIZE: f64 = 0.5;
/// Number of random designs for comparison.
const RANDOM_DESIGNS: usize = 50;

/// Products of the effects' columns with the shared discrepancy projected out.
fn without_discrepancy(information: &ExcitationInformation, products: &DMatrix<f64>) -> DMatrix<f64> {
    let own = information.columns.last().map_or(0, |range| range.end);
    without(products, 0..own, own..products.nrows())
}

/// The block of `kept` rows and columns after `gone` unknowns of unit standard deviation are projected out.
fn without(products: &DMatrix<f64>, kept: Range<usize>, gone: Range<usize>) -> DMatrix<f64> {
    let (n, m) = (kept.len(), gone.len());
    let view = |rows: &Range<usize>, columns: &Range<usize>| {
        products.view((rows.start, columns.start), (rows.len(), columns.len())).into_owned()
    };
    let across = view(&gone, &kept);
    let inner = view(&gone, &gone) + DMatrix::identity(m, m);
    let along = inner.cholesky().map_or_else(|| DMatrix::zeros(m, n), |factor| factor.solve(&across));
    view(&kept, &kept) - across.tr_mul(&along)
}

/// Expected log Bayes factors of each effect against each rival (`None`: the scene without any effect), nats.
fn bayes_factors(
    information: &ExcitationInformation,
    products: &DMatrix<f64>,
) -> Vec<(usize, Option<usize>, f64)> {
    let own = without_discrepancy(information, products);
    let columns = &information.columns;
    let mut out = Vec::new();
    for (e, kept) in columns.iter().enumerate() {
        let half = |m: DMatrix<f64>| 0.5 * SIZE * SIZE * m.trace() / kept.len() as f64;
        out.push((e, None, half(own.view((kept.start, kept.start), (kept.len(), kept.len())).into_owned())));
        for (f, gone) in columns.iter().enumerate() {
            if f != e {
                out.push((e, Some(f), half(without(&own, kept.clone(), gone.clone()))));
            }
        }
    }
    out
}

/// Score of trials with these products, nats.
pub fn score(information: &ExcitationInformation, products: &DMatrix<f64>, goal: ExcitationGoal) -> f64 {
    match goal {
        ExcitationGoal::Discriminate => {
            let all = bayes_factors(information, products);
            all.iter().map(|(_, _, factor)| factor.min(ENOUGH)).sum::<f64>() / all.len() as f64
        }
        ExcitationGoal::Precision => {
            let own = without_discrepancy(information, products);
            let n = own.nrows();
            let factor = (own + DMatrix::identity(n, n)).cholesky();
            factor.map_or(f64::NEG_INFINITY, |f| f.l().diagonal().iter().map(|d| libm::log(*d)).sum::<f64>())
        }
    }
}

/// Mean and standard deviation of the scores of random trials among `steps`.
pub fn random_scores(
    information: &ExcitationInformation,
    steps: &[usize],
    config: &ExcitationConfig,
    stream: &mut Stream,
) -> Option<[f64; 2]> {
    if steps.is_empty() {
        return None;
    }
    let count = information.products[0].nrows();
    let mut one = || {
        let mut sum = DMatrix::zeros(count, count);
        for _ in 0..config.trials {
            sum += &information.products[steps[stream.random_range(0..steps.len())]];
        }
        score(information, &sum, config.goal)
    };
    let scores: Vec<f64> = (0..RANDOM_DESIGNS).map(|_| one()).collect();
    let mean = scores.iter().sum::<f64>() / scores.len() as f64;
    let square = scores.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (scores.len() - 1) as f64;
    Some([mean, square.sqrt()])
}

/// Pairs that the trials leave below [`ENOUGH`], least first, each once; an effect that does not show is a pair with none alone.
pub fn hard_pairs(
    tree: &Tree,
    information: &ExcitationInformation,
    products: &DMatrix<f64>,
) -> Vec<(String, String, f64)> {
    let name = |e: usize| {
        let term = &information.effects[e];
        effect_in_joint(term.effect.name, &tree.names[term.joint])
    };
    let all = bayes_factors(information, products);
    let hidden: Vec<usize> =
        all.iter().filter(|(_, f, factor)| f.is_none() && *factor < ENOUGH).map(|(e, ..)| *e).collect();
    let is_listed =
        |e: usize, f: Option<usize>| f.is_none_or(|f| f > e && ![e, f].iter().any(|k| hidden.contains(k)));
    let mut out: Vec<(String, String, f64)> = all
        .into_iter()
        .filter(|(e, f, factor)| *factor < ENOUGH && is_listed(*e, *f))
        .map(|(e, f, factor)| (name(e), f.map_or("none".into(), name), factor))
        .collect();
    out.sort_by(|a, b| a.2.total_cmp(&b.2));
    out
}
