//! Estimates of effects per trial: BLUP, and by the trial alone.
//!
//! The amplitudes of a trial are s = theta + b with b ~ N(0, T^2). The other trials give theta ~ N(m, S),
//! thus s ~ N(m, S + T^2); with information matrix G and score g of the trial itself, the posterior precision
//! is (S + T^2)^-1 + G, and the mean is the best linear unbiased prediction. The trial alone gives G^-1 g.
//! Latents and shapes are fixed at their common values.
//!
//! Sources: Henderson, Biometrics 31 (1975) 423; Pinheiro and Bates, Mixed-Effects Models in S and S-PLUS (2000), ch. 2.
//!
//! Differences from the sources: noise and T are multiplied by the scale of the trial at its most probable
//! value.

use nalgebra::{DMatrix, DVector};

use crate::error::Result;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::group_statistics::{
    self, GlsEstimate, GroupStatistics, VarianceComponents,
};
use crate::inference::mixed_model::groups::Group;
use crate::inference::mixed_model::random_design::nuisance_accelerations;
use crate::inference::model::{ParameterKind, Perturbation};
use crate::inference::report::{TrialEffectEstimate, round_to_six_digits};
use crate::progress::Progress;

/// Estimates by trial of all amplitudes of its setting; empty if they cannot be computed. `settings`: by
/// trial.
pub fn trial_estimates(
    model: &FittedModel,
    groups: &[Group],
    settings: &[usize],
    progress: &dyn Progress,
) -> Result<Vec<Vec<TrialEffectEstimate>>> {
    let amplitude = |k: &usize| {
        matches!(model.layout.parameters[*k].kind, ParameterKind::EffectParameter(..))
            && !model.layout.is_shape(*k)
    };
    let amplitudes: Vec<usize> = (0..model.layout.parameters.len()).filter(amplitude).collect();
    let none = || vec![Vec::new(); settings.len()];
    let alike = without_amplitude_components(model);
    let prior = model.prior.clone();
    let statistics = group_statistics::group_statistics(groups, &alike, progress)?;
    let Some(statistics) = statistics.filter(|_| !amplitudes.is_empty()) else { return Ok(none()) };
    // Latents and shapes have their common values.
    let current = DVector::zeros(model.layout.parameters.len());
    let of = |trial: usize| {
        let own = trial_information(trial, model, groups, &statistics, &current);
        let others =
            group_statistics::gls(model.group_statistics.iter().filter(|t| t.trial != trial), &prior)?;
        let concerns = |k: &usize| model.layout.parameters[*k].setting.is_none_or(|s| s == settings[trial]);
        let chosen: Vec<usize> = amplitudes.iter().copied().filter(concerns).collect();
        let among = own.blup(&chosen, &current, &others)?;
        let alone = own.least_squares(&chosen, &current);
        let size = |(i, k): (usize, &usize)| {
            let ParameterKind::EffectParameter(t, p) = model.layout.parameters[*k].kind else { return None };
            let (effect, value) = (model.layout.terms[t].effect, model.state.values[*k]);
            // Less precise estimates than the prior are not reported.
            let statistics = alone.as_ref().map(|a| a[i]).filter(|a| a[1] < effect.parameters[p].prior_sd);
            Some(TrialEffectEstimate {
                effect: effect.name.into(),
                parameter: effect.parameters[p].name.into(),
                value: round_to_six_digits(value + among[i][0]),
                sd: round_to_six_digits(among[i][1]),
                alone: statistics
                    .map(|[off, sd]| [round_to_six_digits(value + off), round_to_six_digits(sd)]),
            })
        };
        Some(chosen.iter().enumerate().filter_map(size).collect())
    };
    let checked = |trial| progress.check_stop().map(|()| of(trial).unwrap_or_default());
    (0..settings.len()).map(checked).collect()
}

/// Information and score of one trial, without random effects of amplitudes, and the covariance of these
/// between trials.
struct TrialInformation {
    gram: DMatrix<f64>,
    score: DVector<f64>,
    covariance: DMatrix<f64>,
}

/// Sums the groups of a trial, weighted by their scale after `step`.
fn trial_information(
    trial: usize,
    model: &FittedModel,
    groups: &[Group],
    statistics: &[GroupStatistics],
    step: &DVector<f64>,
) -> TrialInformation {
    let q = step.len();
    let mut out = TrialInformation {
        gram: DMatrix::zeros(q, q),
        score: DVector::zeros(q),
        covariance: DMatrix::zeros(q, q),
    };
    for (p, group) in groups.iter().enumerate().filter(|(_, group)| group.trial == trial) {
        let weight = model.group_statistics[p].weight_after(step);
        out.gram += &statistics[p].gram * weight;
        out.score.axpy(weight, &statistics[p].score, 1.0);
        if group.has_random_effects {
            out.covariance = amplitude_covariance(model) / weight;
        }
    }
    out
}

/// The components without the between-trial variation of the model's amplitudes.
fn without_amplitude_components(model: &FittedModel) -> VarianceComponents {
    let own = |acceleration: &Perturbation| model.effects.iter().any(|e| e.name == acceleration.effect.name);
    let acceleration = nuisance_accelerations()
        .iter()
        .zip(&model.components.accelerations)
        .map(|(p, sd)| if own(p) { 0.0 } else { *sd })
        .collect();
    VarianceComponents { accelerations: acceleration, scale: 0.0, ..model.components.clone() }
}

/// Between-trial covariance of the parameters: declared accelerations and scales of effects.
fn amplitude_covariance(model: &FittedModel) -> DMatrix<f64> {
    let q = model.layout.parameters.len();
    let mut out = DMatrix::zeros(q, q);
    (0..q).for_each(|i| out[(i, i)] = model.acceleration_sd(i).powi(2));
    let strength = model.components.scale.powi(2);
    for sizes in model.layout.amplitude_directions(&model.state.values, model.gravity) {
        for (i, j) in sizes.iter().flat_map(|i| sizes.iter().map(move |j| (i, j))) {
            out[(i.0, j.0)] += strength * i.1 * j.1;
        }
    }
    out
}

impl TrialInformation {
    /// BLUP of `chosen` parameters given the others at `step`: deviation from the model and standard
    /// deviation of each.
    fn blup(&self, chosen: &[usize], step: &DVector<f64>, others: &GlsEstimate) -> Option<Vec<[f64; 2]>> {
        let n = chosen.len();
        let (gram, score) = self.select(chosen, step);
        // Prediction of the chosen parameters by the other trials, given the rest.
        let precision = others.covariance.clone().cholesky()?.inverse();
        let mut off = step - &others.step;
        chosen.iter().for_each(|k| off[*k] = 0.0);
        let moved = &precision * off;
        let within = DMatrix::from_fn(n, n, |i, j| precision[(chosen[i], chosen[j])]).cholesky()?;
        let believed = DVector::from_fn(n, |i, _| others.step[chosen[i]])
            - within.solve(&DVector::from_fn(n, |i, _| moved[chosen[i]]));
        let spread = DMatrix::from_fn(n, n, |i, j| self.covariance[(chosen[i], chosen[j])]);
        let before = within.inverse() + spread;
        let inner = DMatrix::identity(n, n) + &gram * &before;
        let covariance = before * inner.try_inverse()?;
        Some(means_and_sds(&(&believed + &covariance * (score - gram * &believed)), &covariance))
    }

    /// Least-squares estimate from this trial alone.
    fn least_squares(&self, chosen: &[usize], step: &DVector<f64>) -> Option<Vec<[f64; 2]>> {
        let (gram, score) = self.select(chosen, step);
        let factor = gram.cholesky()?;
        let all = means_and_sds(&factor.solve(&score), &factor.inverse());
        all.iter().flatten().all(|v| v.is_finite()).then_some(all)
    }

    /// Information and score of some parameters, the rest at `step`.
    fn select(&self, chosen: &[usize], step: &DVector<f64>) -> (DMatrix<f64>, DVector<f64>) {
        let mut rest = step.clone();
        chosen.iter().for_each(|k| rest[*k] = 0.0);
        let left = &self.score - &self.gram * rest;
        let n = chosen.len();
        let gram = DMatrix::from_fn(n, n, |i, j| self.gram[(chosen[i], chosen[j])]);
        (gram, DVector::from_fn(n, |i, _| left[chosen[i]]))
    }
}

/// Means with their standard deviations.
fn means_and_sds(mean: &DVector<f64>, covariance: &DMatrix<f64>) -> Vec<[f64; 2]> {
    (0..mean.len()).map(|i| [mean[i], covariance[(i, i)].max(0.0).sqrt()]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::throws;
    use crate::progress::NoProgress;

    /// BLUP equals conditioning the explicit joint Gaussian of three trials with five observations and two
    /// parameters, of which the first varies between trials.
    #[test]
    fn blup_is_the_conditional_of_the_joint_gaussian() {
        let wave = |k: usize| libm::sin(1.7 * k as f64);
        let columns: Vec<DMatrix<f64>> =
            (0..3).map(|j| DMatrix::from_fn(5, 2, |i, k| wave(7 * i + 31 * j + k))).collect();
        let observed: Vec<DVector<f64>> =
            (0..3).map(|j| DVector::from_fn(5, |i, _| 2.0 * wave(100 + i + 9 * j))).collect();
        let (believed, spread) = (DMatrix::from_row_slice(2, 2, &[2.0, 0.3, 0.3, 1.0]), 0.6);
        // Unknowns theta, b_1, b_2, b_3 of fifteen observations.
        let mut behind = DMatrix::zeros(5, 5);
        behind.view_mut((0, 0), (2, 2)).copy_from(&believed);
        (2..5).for_each(|k| behind[(k, k)] = spread * spread);
        let design = DMatrix::from_fn(15, 5, |i, k| match k {
            0 | 1 => columns[i / 5][(i % 5, k)],
            _ if k - 2 == i / 5 => columns[i / 5][(i % 5, 0)],
            _ => 0.0,
        });
        let all = DVector::from_fn(15, |i, _| observed[i / 5][i % 5]);
        let covariance = &design * &behind * design.transpose() + DMatrix::identity(15, 15);
        let gain = &behind * design.transpose() * covariance.try_inverse().unwrap();
        let (mean, left) = (&gain * &all, &behind - &gain * &design * &behind);
        let first = DMatrix::from_row_slice(2, 5, &[1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        let (mean, left) = (&first * mean, &first * left * first.transpose());
        // The same by the prediction of the other two trials.
        let mut precision = believed.try_inverse().unwrap();
        let mut score = DVector::zeros(2);
        for j in 1..3 {
            let own = columns[j].column(0) * spread;
            let apart = (DMatrix::identity(5, 5) + &own * own.transpose()).try_inverse().unwrap();
            precision += columns[j].tr_mul(&(&apart * &columns[j]));
            score += columns[j].tr_mul(&(&apart * &observed[j]));
        }
        let covariance = precision.try_inverse().unwrap();
        let others = GlsEstimate { step: &covariance * score, covariance };
        let says = TrialInformation {
            gram: columns[0].tr_mul(&columns[0]),
            score: columns[0].tr_mul(&observed[0]),
            covariance: DMatrix::from_diagonal(&DVector::from_vec(vec![spread * spread, 0.0])),
        };
        let close = |found: [f64; 2], mean: f64, variance: f64| {
            assert!(
                (found[0] - mean).abs() < 1e-10 && (found[1] - variance.sqrt()).abs() < 1e-10,
                "{found:?}"
            );
        };
        let none = DVector::zeros(2);
        let own = says.blup(&[0, 1], &none, &others).unwrap();
        (0..2).for_each(|k| close(own[k], mean[k], left[(k, k)]));
        // With the second parameter fixed: conditional of the conditional.
        let known = says.blup(&[0], &DVector::from_vec(vec![9.0, 0.3]), &others).unwrap();
        let share = left[(0, 1)] / left[(1, 1)];
        close(known[0], mean[0] + share * (0.3 - mean[1]), left[(0, 0)] - share * left[(0, 1)]);
        // Least squares of the trial alone.
        let alone = says.least_squares(&[0, 1], &none).unwrap();
        let inverse = columns[0].tr_mul(&columns[0]).try_inverse().unwrap();
        let solved = &inverse * columns[0].tr_mul(&observed[0]);
        assert!((0..2).all(|k| (alone[k][0] - solved[k]).abs() < 1e-10));
        assert!((alone[0][1] - inverse[(0, 0)].sqrt()).abs() < 1e-10);
    }

    /// Recovers drags that vary between trials.
    #[test]
    fn varying_drags_are_estimated_per_trial() {
        let drags = [0.2, 0.5, 0.3, 0.6, 0.35, 0.25, 0.45, 0.55];
        throws::with_fit(&drags, &["linear_drag"], 5, |fitter, f| {
            let (_, groups) = fitter.groups(&f.layout, &f.state, &[]).unwrap().unwrap();
            let found = trial_estimates(f, &groups, &[0; 8], &NoProgress).unwrap();
            for (one, truth) in found.iter().zip(drags) {
                let (one, [alone, sd]) = (&one[0], one[0].alone.unwrap());
                assert!((one.value - truth).abs() < 4.0 * one.sd && one.sd < 0.05, "{truth}: {one:?}");
                assert!((alone - truth).abs() < 4.0 * sd, "{truth}: {one:?}");
            }
        });
        throws::with_fit(&[0.4; 8], &[], 5, |fitter, f| {
            let (_, groups) = fitter.groups(&f.layout, &f.state, &[]).unwrap().unwrap();
            assert!(
                trial_estimates(f, &groups, &[0; 8], &NoProgress).unwrap().iter().all(Vec::is_empty),
                "no effect has no size"
            );
        });
    }
}
