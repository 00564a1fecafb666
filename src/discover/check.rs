//! The posterior predictive check: whether launches are as far from what the others predict of them as predictions say.
//!
//! Given the others a launch is a multivariate Student t (`score`): its square over its number of coordinates, under the
//! predictive covariance, is Fisher's F of that number and the scale's degrees of freedom. The probability of a larger one
//! is uniform if the model, its components and its tails are right: small for a launch further off than predicted, near 1
//! for one nearer. Stretches of one launch that have scales of their own are joined by Fisher's method.
//!
//! Sources: Gelman, Meng and Stern, Stat. Sinica 6 (1996) 733; probability integral transform (Dawid, J. R. Stat. Soc. A
//! 147 (1984) 278); Fisher, Statistical Methods for Research Workers (1932), 21.1; Kolmogorov's distribution by Stephens,
//! J. R. Stat. Soc. B 32 (1970) 115.
//!
//! Differences from the sources: the launch is left out with all of its fold, components and all; at no launch is a number
//! drawn.

use super::fit::{Fitted, Fitter};
use super::gaussian::{self, FREEDOM};
use super::launch::Part;
use super::model::Look;
use super::report::{PredictiveCheck, TrialPredictiveCheck, round_to_six_digits};
use super::score;
use super::stats::median;
use crate::distribution::f_survival;
use crate::error::Result;

/// Probability on either side of the range that predictions are held against.
const TAIL: f64 = 0.025;

/// How launches stand to what the others predict of them; `None` where that cannot be told. `kept`: the trial of each.
pub fn predictive(
    fitter: &Fitter,
    model: &Fitted,
    looks: &[Look],
    kept: &[usize],
) -> Result<Option<PredictiveCheck>> {
    let parts = fitter.with_discrepancy(&model.layout, &model.state, looks)?;
    fitter.data.progress.check_stop()?;
    Ok(parts.and_then(|parts| of_parts(fitter, model, &parts, kept)))
}

fn of_parts(fitter: &Fitter, model: &Fitted, parts: &[Part], kept: &[usize]) -> Option<PredictiveCheck> {
    let told = gaussian::all_told(parts, &model.components)?;
    let prior = model.prior.with_discrepancy(told.first()?.gram.ncols(), model.discrepancy_scale);
    let mut of: Vec<(Vec<f64>, f64, f64)> = vec![Default::default(); kept.len()];
    score::each_held_out(&told, &prior, &fitter.folds, |told, others| {
        let Some((square, _)) = told.predictive(others) else { return };
        let (all, squares, count) = &mut of[told.launch];
        all.push(f_survival(square / told.count, told.count, FREEDOM));
        (*squares, *count) = (*squares + square, *count + told.count);
    })?;
    let launches: Vec<TrialPredictiveCheck> = of
        .iter()
        .zip(kept)
        .filter(|((all, ..), _)| !all.is_empty())
        .map(|((all, squares, count), trial)| TrialPredictiveCheck {
            trial: *trial,
            p: round_to_six_digits(joined(all)),
            squares: round_to_six_digits(*squares),
            count: *count as usize,
        })
        .collect();
    (!launches.is_empty()).then(|| summary(launches))
}

/// What the launches together say of the predictions.
fn summary(launches: Vec<TrialPredictiveCheck>) -> PredictiveCheck {
    let n = launches.len();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| launches[*a].p.total_cmp(&launches[*b].p).then(a.cmp(b)));
    let sorted: Vec<f64> = order.iter().map(|i| launches[*i].p).collect();
    let outside = sorted.iter().filter(|p| **p < TAIL || **p > 1.0 - TAIL).count();
    let ratio = |l: &TrialPredictiveCheck| (l.squares / l.count.max(1) as f64).sqrt();
    let distance = distance(&sorted);
    let banded = |(k, p): (usize, &f64)| {
        let [low, high] = range_of_place(k + 1, n).map(round_to_six_digits);
        [*p, low, high]
    };
    PredictiveCheck {
        outside_share: round_to_six_digits(outside as f64 / n as f64),
        further_off: order.iter().filter(|i| launches[**i].p < TAIL).map(|i| launches[*i].trial).collect(),
        usual_ratio: round_to_six_digits(median(&launches.iter().map(ratio).collect::<Vec<_>>())),
        uniform_p: round_to_six_digits(kolmogorov(distance, n)),
        sorted: sorted.iter().enumerate().map(banded).collect(),
        launches,
    }
}

/// One probability for several that are independent and uniform.
pub fn joined(all: &[f64]) -> f64 {
    if all.len() == 1 {
        return all[0];
    }
    // Half of Fisher's sum is Gamma of their number: a Poisson sum.
    let half = -all.iter().map(|p| p.max(f64::MIN_POSITIVE).ln()).sum::<f64>();
    let mut term = libm::exp(-half);
    let mut sum = term;
    for k in 1..all.len() {
        term *= half / k as f64;
        sum += term;
    }
    sum.min(1.0)
}

/// Largest distance of what is sorted from uniform.
fn distance(sorted: &[f64]) -> f64 {
    let n = sorted.len() as f64;
    let off = |(k, p): (usize, &f64)| (p - k as f64 / n).max((k + 1) as f64 / n - p);
    sorted.iter().enumerate().map(off).fold(0.0, f64::max)
}

/// Probability of a larger distance, if it is uniform.
fn kolmogorov(distance: f64, n: usize) -> f64 {
    let root = (n as f64).sqrt();
    let at = (root + 0.12 + 0.11 / root) * distance;
    let term = |k: i32| {
        let sign = if k % 2 == 1 { 2.0 } else { -2.0 };
        sign * libm::exp(-2.0 * f64::from(k * k) * at * at)
    };
    // The series alternates and does not settle near 0, where it is 1.
    if at < 0.2 { 1.0 } else { (1..=100).map(term).sum::<f64>().clamp(0.0, 1.0) }
}

/// The 95 % range of the `place`th smallest of `n` that are uniform: it is Beta of (place, n + 1 - place).
fn range_of_place(place: usize, n: usize) -> [f64; 2] {
    let (a, b) = (place as f64, (n + 1 - place) as f64);
    [1.0 - TAIL, TAIL].map(|wanted| {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle: f64 = 0.5 * (low + high);
            let above = f_survival(b * middle / (a * (1.0 - middle)), 2.0 * a, 2.0 * b);
            if above > wanted { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::gaussian::{Components, Pooled};
    use crate::discover::launch::{Block, Part};
    use crate::discover::thrown;
    use crate::rng;
    use nalgebra::{DMatrix, DVector};
    use rand_distr::{Distribution, StandardNormal};

    /// Launches drawn as the score has them: a size from what others say, one of its own, slow misfit, noise and a scale.
    /// The probabilities are uniform; and those of launches twice as wide are not.
    #[test]
    fn probabilities_of_what_is_drawn_are_uniform() {
        let mut stream = rng::stream(7, "predictive check");
        let mut normal = || -> f64 { StandardNormal.sample(&mut stream) };
        let components = Components { slow: 1.5, leap: 0.01, strength: 0.0, push: vec![0.0; 3] };
        let others =
            Pooled { step: DVector::from_vec(vec![0.7]), covariance: DMatrix::from_element(1, 1, 0.2) };
        let column = DMatrix::from_fn(9, 1, |i, _| libm::sin(1.0 + i as f64));
        let slow = DVector::from_fn(9, |i, _| 1.0 / (1 + i) as f64);
        let mut drawn = |wider: f64| -> Vec<f64> {
            let mut all: Vec<f64> = (0..400)
                .map(|_| {
                    // The scale: an inverse Gamma of half its degrees of freedom.
                    let scale = (FREEDOM / (0..4).map(|_| normal().powi(2)).sum::<f64>()).sqrt();
                    let own = 0.2f64.sqrt() * normal();
                    let noise = DVector::from_fn(9, |i, _| (1.0 + 1.5 * 1.5 * slow[i]).sqrt() * normal());
                    let left = &column * 0.7 + (&column * own + noise) * (scale * wider);
                    let block = Block {
                        window: 0,
                        left: left.column(0).into_owned(),
                        slow: slow.clone(),
                        columns: column.clone(),
                        alike: DMatrix::zeros(9, 0),
                        alike_of: Vec::new(),
                        own: DMatrix::zeros(9, 0),
                        kinds: Vec::new(),
                        log_white: 0.0,
                    };
                    let part = Part { launch: 0, blocks: vec![block], differs: true };
                    let told = gaussian::all_told(&[part], &components).unwrap().remove(0);
                    f_survival(told.predictive(&others).unwrap().0 / told.count, told.count, FREEDOM)
                })
                .collect();
            all.sort_by(f64::total_cmp);
            all
        };
        let (right, wide) = (drawn(1.0), drawn(2.0));
        assert!(kolmogorov(distance(&right), 400) > 0.05, "{}", distance(&right));
        assert!(kolmogorov(distance(&wide), 400) < 1e-6, "{}", distance(&wide));
    }

    #[test]
    fn tables_are_met() {
        // Kolmogorov's 5 % point; the range of the median of three; Fisher's of two equal ones.
        assert!((kolmogorov(1.358 / 100.0, 10_000) - 0.05).abs() < 2e-3);
        let [low, high] = range_of_place(2, 3);
        assert!((low - 0.0943).abs() < 1e-3 && (high - 0.9057).abs() < 1e-3, "{low} {high}");
        assert!((joined(&[0.1, 0.1]) - 0.01 * (1.0 - 2.0 * 0.1f64.ln())).abs() < 1e-12);
        assert_eq!(distance(&[0.25, 0.75]), 0.25);
    }

    /// One launch with another drag than the rest is further off than predicted.
    #[test]
    fn the_odd_launch_out_is_the_worst() {
        let mut drags = [0.4; 12];
        drags[7] = 1.2;
        thrown::fitted(&drags, &["linear_drag"], 6, |fitter, f| {
            let (looks, _) = fitter.parts(&f.layout, &f.state, &[]).unwrap().unwrap();
            let kept: Vec<usize> = (100..112).collect();
            let found = predictive(fitter, f, &looks, &kept).unwrap().unwrap();
            let least = found.launches.iter().min_by(|a, b| a.p.total_cmp(&b.p)).unwrap();
            assert_eq!((least.trial, found.launches.len(), found.sorted.len()), (107, 12, 12), "{found:?}");
            assert_eq!(found.sorted[0][0], least.p);
        });
    }
}
