//! Predictive checks: whether trials agree with their predictions from the other trials.
//!
//! Given the other trials the observations of a trial are multivariate Student t: the squared Mahalanobis
//! distance over the number of coordinates has Fisher's F distribution, and its p-value is uniform if the
//! model is right. Groups of one trial with separate scales are combined by Fisher's method.
//!
//! Sources: Gelman, Meng and Stern, Stat. Sinica 6 (1996) 733; probability integral transform (Dawid, J. R. Stat. Soc. A
//! 147 (1984) 278); Fisher, Statistical Methods for Research Workers (1932), 21.1; Kolmogorov's distribution by Stephens,
//! J. R. Stat. Soc. B 32 (1970) 115.
//!
//! Differences from the sources: the trial is held out with its fold; nothing is sampled.

use crate::distribution::f_survival;
use crate::error::Result;
use crate::inference::mixed_model::cross_validation;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::group_statistics::{self, GroupStatistics, SCALE_DOF};
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::model::Linearization;
use crate::inference::report::{PredictiveCheck, TrialPredictiveCheck, round_to_six_digits};
use crate::inference::statistics::median;

/// Tail probability on either side of the 95 % interval.
const TAIL_PROBABILITY: f64 = 0.025;

/// Predictive checks of all trials; `None` if they cannot be computed. `used`: index of each trial.
pub fn predictive_check(
    fitter: &ModelFitter,
    model: &FittedModel,
    linearizations: &[Linearization],
    used: &[usize],
) -> Result<Option<PredictiveCheck>> {
    let groups = fitter.groups_with_discrepancy(&model.layout, &model.state, linearizations)?;
    fitter.data.progress.check_stop()?;
    let Some(groups) = groups else { return Ok(None) };
    let statistics = group_statistics::group_statistics(&groups, &model.components, fitter.data.progress)?;
    Ok(statistics.and_then(|statistics| check_groups(fitter, model, &statistics, used)))
}

/// Predictive checks of the trials of some groups.
fn check_groups(
    fitter: &ModelFitter,
    model: &FittedModel,
    statistics: &[GroupStatistics],
    used: &[usize],
) -> Option<PredictiveCheck> {
    let prior = model.prior.with_discrepancy(statistics.first()?.gram.ncols(), model.discrepancy_scale);
    let mut of: Vec<(Vec<f64>, f64, f64)> = vec![Default::default(); used.len()];
    cross_validation::for_each_held_out(statistics, &prior, &fitter.folds, |statistics, others| {
        let Some((square, _)) = statistics.predictive_distance(others) else { return };
        let (all, squares, count) = &mut of[statistics.trial];
        all.push(f_survival(square / statistics.count, statistics.count, SCALE_DOF));
        (*squares, *count) = (*squares + square, *count + statistics.count);
    })?;
    let launches: Vec<TrialPredictiveCheck> = of
        .iter()
        .zip(used)
        .filter(|((all, ..), _)| !all.is_empty())
        .map(|((all, squares, count), trial)| TrialPredictiveCheck {
            trial: *trial,
            p: round_to_six_digits(fisher_combine(all)),
            squares: round_to_six_digits(*squares),
            count: *count as usize,
        })
        .collect();
    (!launches.is_empty()).then(|| summary(launches))
}

/// Summary over trials.
fn summary(launches: Vec<TrialPredictiveCheck>) -> PredictiveCheck {
    let n = launches.len();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|a, b| launches[*a].p.total_cmp(&launches[*b].p).then(a.cmp(b)));
    let sorted: Vec<f64> = order.iter().map(|i| launches[*i].p).collect();
    let outside = sorted.iter().filter(|p| **p < TAIL_PROBABILITY || **p > 1.0 - TAIL_PROBABILITY).count();
    let ratio = |l: &TrialPredictiveCheck| (l.squares / l.count.max(1) as f64).sqrt();
    let distance = uniform_distance(&sorted);
    let banded = |(k, p): (usize, &f64)| {
        let [low, high] = order_statistic_interval(k + 1, n).map(round_to_six_digits);
        [*p, low, high]
    };
    PredictiveCheck {
        outside_share: round_to_six_digits(outside as f64 / n as f64),
        further_off: order
            .iter()
            .filter(|i| launches[**i].p < TAIL_PROBABILITY)
            .map(|i| launches[*i].trial)
            .collect(),
        usual_ratio: round_to_six_digits(median(&launches.iter().map(ratio).collect::<Vec<_>>())),
        uniform_p: round_to_six_digits(kolmogorov_p(distance, n)),
        sorted: sorted.iter().enumerate().map(banded).collect(),
        launches,
    }
}

/// Fisher's combination of independent p-values.
pub fn fisher_combine(all: &[f64]) -> f64 {
    if all.len() == 1 {
        return all[0];
    }
    // Half of Fisher's statistic is Gamma distributed: a Poisson sum.
    let half = -all.iter().map(|p| p.max(f64::MIN_POSITIVE).ln()).sum::<f64>();
    let mut term = libm::exp(-half);
    let mut sum = term;
    for k in 1..all.len() {
        term *= half / k as f64;
        sum += term;
    }
    sum.min(1.0)
}

/// Kolmogorov-Smirnov distance of sorted values from the uniform distribution.
fn uniform_distance(sorted: &[f64]) -> f64 {
    let n = sorted.len() as f64;
    let off = |(k, p): (usize, &f64)| (p - k as f64 / n).max((k + 1) as f64 / n - p);
    sorted.iter().enumerate().map(off).fold(0.0, f64::max)
}

/// P-value of the Kolmogorov-Smirnov distance.
fn kolmogorov_p(distance: f64, n: usize) -> f64 {
    let root = (n as f64).sqrt();
    let at = (root + 0.12 + 0.11 / root) * distance;
    let term = |k: i32| {
        let sign = if k % 2 == 1 { 2.0 } else { -2.0 };
        sign * libm::exp(-2.0 * f64::from(k * k) * at * at)
    };
    // The alternating series converges slowly near 0, where the p-value is 1.
    if at < 0.2 { 1.0 } else { (1..=100).map(term).sum::<f64>().clamp(0.0, 1.0) }
}

/// 95 % interval of an order statistic of `n` uniform values: Beta(place, n + 1 - place).
fn order_statistic_interval(place: usize, n: usize) -> [f64; 2] {
    let (a, b) = (place as f64, (n + 1 - place) as f64);
    [1.0 - TAIL_PROBABILITY, TAIL_PROBABILITY].map(|expected| {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle: f64 = 0.5 * (low + high);
            let above = f_survival(b * middle / (a * (1.0 - middle)), 2.0 * a, 2.0 * b);
            if above > expected { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::mixed_model::group_statistics::{GlsEstimate, VarianceComponents};
    use crate::inference::mixed_model::groups::{Group, SegmentBlock};
    use crate::inference::testing::throws;
    use crate::progress::NoProgress;
    use crate::rng;
    use nalgebra::{DMatrix, DVector};
    use rand_distr::{Distribution, StandardNormal};

    /// P-values of data simulated from the model are uniform; those of trials twice as wide are not.
    #[test]
    fn p_values_of_simulated_trials_are_uniform() {
        let mut stream = rng::stream(7, "predictive check");
        let mut normal = || -> f64 { StandardNormal.sample(&mut stream) };
        let components =
            VarianceComponents { discrepancy: 1.5, impact: 0.01, scale: 0.0, accelerations: vec![0.0; 3] };
        let others =
            GlsEstimate { step: DVector::from_vec(vec![0.7]), covariance: DMatrix::from_element(1, 1, 0.2) };
        let column = DMatrix::from_fn(9, 1, |i, _| libm::sin(1.0 + i as f64));
        let slow = DVector::from_fn(9, |i, _| 1.0 / (1 + i) as f64);
        let mut drawn = |wider: f64| -> Vec<f64> {
            let mut all: Vec<f64> = (0..400)
                .map(|_| {
                    // The scale: inverse Gamma with half the degrees of freedom.
                    let scale = (SCALE_DOF / (0..4).map(|_| normal().powi(2)).sum::<f64>()).sqrt();
                    let own = 0.2f64.sqrt() * normal();
                    let noise = DVector::from_fn(9, |i, _| (1.0 + 1.5 * 1.5 * slow[i]).sqrt() * normal());
                    let left = &column * 0.7 + (&column * own + noise) * (scale * wider);
                    let block = SegmentBlock {
                        segment: 0,
                        residual: left.column(0).into_owned(),
                        gp_variance: slow.clone(),
                        jacobian: column.clone(),
                        z_group: DMatrix::zeros(9, 0),
                        z_group_effects: Vec::new(),
                        z_segment: DMatrix::zeros(9, 0),
                        z_segment_effects: Vec::new(),
                        nuisances: DMatrix::zeros(9, 0),
                        log_det_noise: 0.0,
                    };
                    let group = Group { trial: 0, blocks: vec![block], has_random_effects: true };
                    let statistics = group_statistics::group_statistics(&[group], &components, &NoProgress)
                        .unwrap()
                        .unwrap()
                        .remove(0);
                    f_survival(
                        statistics.predictive_distance(&others).unwrap().0 / statistics.count,
                        statistics.count,
                        SCALE_DOF,
                    )
                })
                .collect();
            all.sort_by(f64::total_cmp);
            all
        };
        let (right, wide) = (drawn(1.0), drawn(2.0));
        assert!(kolmogorov_p(uniform_distance(&right), 400) > 0.05, "{}", uniform_distance(&right));
        assert!(kolmogorov_p(uniform_distance(&wide), 400) < 1e-6, "{}", uniform_distance(&wide));
    }

    #[test]
    fn reference_values_are_reproduced() {
        // Kolmogorov's 5 % quantile; the interval of the median of three; Fisher's combination of two equal
        // values.
        assert!((kolmogorov_p(1.358 / 100.0, 10_000) - 0.05).abs() < 2e-3);
        let [low, high] = order_statistic_interval(2, 3);
        assert!((low - 0.0943).abs() < 1e-3 && (high - 0.9057).abs() < 1e-3, "{low} {high}");
        assert!((fisher_combine(&[0.1, 0.1]) - 0.01 * (1.0 - 2.0 * 0.1f64.ln())).abs() < 1e-12);
        assert_eq!(uniform_distance(&[0.25, 0.75]), 0.25);
    }

    /// A trial with another drag has the smallest p-value.
    #[test]
    fn an_odd_trial_has_the_smallest_p_value() {
        let mut drags = [0.4; 12];
        drags[7] = 1.2;
        throws::with_fit(&drags, &["linear_drag"], 6, |fitter, f| {
            let (linearizations, _) = fitter.groups(&f.layout, &f.state, &[]).unwrap().unwrap();
            let used: Vec<usize> = (100..112).collect();
            let found = predictive_check(fitter, f, &linearizations, &used).unwrap().unwrap();
            let least = found.launches.iter().min_by(|a, b| a.p.total_cmp(&b.p)).unwrap();
            assert_eq!((least.trial, found.launches.len(), found.sorted.len()), (107, 12, 12), "{found:?}");
            assert_eq!(found.sorted[0][0], least.p);
        });
    }
}
