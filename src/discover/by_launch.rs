//! The size of every effect in each launch: what the launch says by itself, and what is best said of it knowing the others.
//!
//! A launch's sizes are s = theta + b, b ~ N(0, T^2) drawn anew for every launch. What the other launches say of theta,
//! N(m, S), makes s ~ N(m, S + T^2) before the launch is seen; with what it says itself, Gram matrix G and score g (about
//! where the model stands, no size differing), (S + T^2)^-1 + G is the precision of s and its mean is the best linear
//! unbiased prediction at these components. By itself the launch says G^-1 g. Everything but sizes (latents, shapes) is as all
//! launches have it.
//!
//! Sources: Henderson, Biometrics 31 (1975) 423; Pinheiro and Bates, Mixed-Effects Models in S and S-PLUS (2000), ch. 2.
//!
//! Differences from the sources: a launch has a scale of its own (`score`), by which both its noise and T are larger; it is
//! taken where it is most plausible.

use nalgebra::{DMatrix, DVector};

use super::columns::nuisance_accelerations;
use super::fit::FittedModel;
use super::gaussian::{self, GlsEstimate, GroupStatistics, VarianceComponents};
use super::launch::Group;
use super::model::{ParameterKind, Perturbation};
use super::report::{TrialEffectEstimate, round_to_six_digits};

/// Sizes by launch: of every amplitude that concerns it; empty where launches say nothing. `settings`: of each launch.
pub fn trial_estimates(
    model: &FittedModel,
    parts: &[Group],
    settings: &[usize],
) -> Vec<Vec<TrialEffectEstimate>> {
    let amplitude = |k: &usize| {
        matches!(model.layout.parameters[*k].kind, ParameterKind::EffectParameter(..))
            && !model.layout.is_shape(*k)
    };
    let amplitudes: Vec<usize> = (0..model.layout.parameters.len()).filter(amplitude).collect();
    let none = || vec![Vec::new(); settings.len()];
    let alike = without_amplitude_components(model);
    let prior = model.prior.clone();
    let Some(told) = gaussian::group_statistics(parts, &alike).filter(|_| !amplitudes.is_empty()) else {
        return none();
    };
    // Latents and shapes are what the report says of them.
    let here = DVector::zeros(model.layout.parameters.len());
    let of = |launch: usize| {
        let own = trial_information(launch, model, parts, &told, &here);
        let others = gaussian::gls(model.group_statistics.iter().filter(|t| t.trial != launch), &prior)?;
        let concerns = |k: &usize| model.layout.parameters[*k].setting.is_none_or(|s| s == settings[launch]);
        let chosen: Vec<usize> = amplitudes.iter().copied().filter(concerns).collect();
        let among = own.blup(&chosen, &here, &others)?;
        let alone = own.least_squares(&chosen, &here);
        let size = |(i, k): (usize, &usize)| {
            let ParameterKind::EffectParameter(t, p) = model.layout.parameters[*k].kind else { return None };
            let (effect, value) = (model.layout.terms[t].effect, model.state.values[*k]);
            // What is known less well than before anything was seen is not told.
            let told = alone.as_ref().map(|a| a[i]).filter(|a| a[1] < effect.parameters[p].prior_sd);
            Some(TrialEffectEstimate {
                effect: effect.name.into(),
                parameter: effect.parameters[p].name.into(),
                value: round_to_six_digits(value + among[i][0]),
                sd: round_to_six_digits(among[i][1]),
                alone: told.map(|[off, sd]| [round_to_six_digits(value + off), round_to_six_digits(sd)]),
            })
        };
        Some(chosen.iter().enumerate().filter_map(size).collect())
    };
    (0..settings.len()).map(|launch| of(launch).unwrap_or_default()).collect()
}

/// What a launch says of the slots, about where the model stands, if no size differs from launch to launch; and how far they
/// do (their covariance).
struct TrialInformation {
    gram: DMatrix<f64>,
    score: DVector<f64>,
    covariance: DMatrix<f64>,
}

/// All parts of a launch, each weighing as its scale lets it with the slots `step` away.
fn trial_information(
    launch: usize,
    model: &FittedModel,
    parts: &[Group],
    told: &[GroupStatistics],
    step: &DVector<f64>,
) -> TrialInformation {
    let q = step.len();
    let mut out = TrialInformation {
        gram: DMatrix::zeros(q, q),
        score: DVector::zeros(q),
        covariance: DMatrix::zeros(q, q),
    };
    for (p, part) in parts.iter().enumerate().filter(|(_, part)| part.trial == launch) {
        let weight = model.group_statistics[p].weight_after(step);
        out.gram += &told[p].gram * weight;
        out.score.axpy(weight, &told[p].score, 1.0);
        if part.has_random_effects {
            out.covariance = amplitude_covariance(model) / weight;
        }
    }
    out
}

/// The components without what the model's own amplitudes differ by.
fn without_amplitude_components(model: &FittedModel) -> VarianceComponents {
    let own = |push: &Perturbation| model.effects.iter().any(|e| e.name == push.effect.name);
    let push = nuisance_accelerations()
        .iter()
        .zip(&model.components.accelerations)
        .map(|(p, sd)| if own(p) { 0.0 } else { *sd })
        .collect();
    VarianceComponents { accelerations: push, scale: 0.0, ..model.components.clone() }
}

/// Covariance of the slots' values between trials: what their effect declares, and those of an effect by its strength.
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
    /// `chosen` slots of the launch, the others being known, by best linear prediction: off where the model stands, and standard
    /// deviation of each. The rest of the slots are at `step`.
    fn blup(&self, chosen: &[usize], step: &DVector<f64>, others: &GlsEstimate) -> Option<Vec<[f64; 2]>> {
        let n = chosen.len();
        let (gram, score) = self.select(chosen, step);
        // What the others say of the chosen, the rest being known.
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

    /// By least squares of this launch alone, the same.
    fn least_squares(&self, chosen: &[usize], step: &DVector<f64>) -> Option<Vec<[f64; 2]>> {
        let (gram, score) = self.select(chosen, step);
        let factor = gram.cholesky()?;
        let all = means_and_sds(&factor.solve(&score), &factor.inverse());
        all.iter().flatten().all(|v| v.is_finite()).then_some(all)
    }

    /// What the launch says of some slots, the rest being at `step`.
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
    use crate::discover::thrown;

    /// Three launches of five observations, two sizes of which the first differs by launch: what is said of a launch's own
    /// sizes is the conditional of the Gaussian of everything, written down whole.
    #[test]
    fn a_launchs_sizes_are_the_conditional_of_the_whole_gaussian() {
        let wave = |k: usize| libm::sin(1.7 * k as f64);
        let columns: Vec<DMatrix<f64>> =
            (0..3).map(|j| DMatrix::from_fn(5, 2, |i, k| wave(7 * i + 31 * j + k))).collect();
        let seen: Vec<DVector<f64>> =
            (0..3).map(|j| DVector::from_fn(5, |i, _| 2.0 * wave(100 + i + 9 * j))).collect();
        let (believed, spread) = (DMatrix::from_row_slice(2, 2, &[2.0, 0.3, 0.3, 1.0]), 0.6);
        // theta, b_1, b_2, b_3 stand behind fifteen observations.
        let mut behind = DMatrix::zeros(5, 5);
        behind.view_mut((0, 0), (2, 2)).copy_from(&believed);
        (2..5).for_each(|k| behind[(k, k)] = spread * spread);
        let design = DMatrix::from_fn(15, 5, |i, k| match k {
            0 | 1 => columns[i / 5][(i % 5, k)],
            _ if k - 2 == i / 5 => columns[i / 5][(i % 5, 0)],
            _ => 0.0,
        });
        let all = DVector::from_fn(15, |i, _| seen[i / 5][i % 5]);
        let covariance = &design * &behind * design.transpose() + DMatrix::identity(15, 15);
        let gain = &behind * design.transpose() * covariance.try_inverse().unwrap();
        let (mean, left) = (&gain * &all, &behind - &gain * &design * &behind);
        let first = DMatrix::from_row_slice(2, 5, &[1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        let (mean, left) = (&first * mean, &first * left * first.transpose());
        // The same by what the other two say and what the first does.
        let mut precision = believed.try_inverse().unwrap();
        let mut score = DVector::zeros(2);
        for j in 1..3 {
            let own = columns[j].column(0) * spread;
            let apart = (DMatrix::identity(5, 5) + &own * own.transpose()).try_inverse().unwrap();
            precision += columns[j].tr_mul(&(&apart * &columns[j]));
            score += columns[j].tr_mul(&(&apart * &seen[j]));
        }
        let covariance = precision.try_inverse().unwrap();
        let others = GlsEstimate { step: &covariance * score, covariance };
        let says = TrialInformation {
            gram: columns[0].tr_mul(&columns[0]),
            score: columns[0].tr_mul(&seen[0]),
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
        // The second known to be at some value: the conditional of the conditional.
        let known = says.blup(&[0], &DVector::from_vec(vec![9.0, 0.3]), &others).unwrap();
        let share = left[(0, 1)] / left[(1, 1)];
        close(known[0], mean[0] + share * (0.3 - mean[1]), left[(0, 0)] - share * left[(0, 1)]);
        // By itself: what least squares makes of its own five.
        let alone = says.least_squares(&[0, 1], &none).unwrap();
        let inverse = columns[0].tr_mul(&columns[0]).try_inverse().unwrap();
        let solved = &inverse * columns[0].tr_mul(&seen[0]);
        assert!((0..2).all(|k| (alone[k][0] - solved[k]).abs() < 1e-10));
        assert!((alone[0][1] - inverse[(0, 0)].sqrt()).abs() < 1e-10);
    }

    /// Drags that differ by launch are told apart, each within its own error, and those that do not are one.
    #[test]
    fn drags_that_differ_are_found_launch_by_launch() {
        let drags = [0.2, 0.5, 0.3, 0.6, 0.35, 0.25, 0.45, 0.55];
        thrown::with_fit(&drags, &["linear_drag"], 5, |fitter, f| {
            let (_, parts) = fitter.groups(&f.layout, &f.state, &[]).unwrap().unwrap();
            let found = trial_estimates(f, &parts, &[0; 8]);
            for (one, truth) in found.iter().zip(drags) {
                let (one, [alone, sd]) = (&one[0], one[0].alone.unwrap());
                assert!((one.value - truth).abs() < 4.0 * one.sd && one.sd < 0.05, "{truth}: {one:?}");
                assert!((alone - truth).abs() < 4.0 * sd, "{truth}: {one:?}");
            }
        });
        thrown::with_fit(&[0.4; 8], &[], 5, |fitter, f| {
            let (_, parts) = fitter.groups(&f.layout, &f.state, &[]).unwrap().unwrap();
            assert!(trial_estimates(f, &parts, &[0; 8]).iter().all(Vec::is_empty), "no effect has no size");
        });
    }
}
