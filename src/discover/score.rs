//! One number for every model: the log predictive density of each launch, told from the others.
//!
//! A launch is Gaussian with the covariance that `launch` describes, given a scale of its own; the scale integrated out, it
//! is a multivariate Student t. Sizes come from the other launches by generalised least squares under weak priors, with
//! their uncertainty integrated out; components (how large the slow misfit is, how far sizes differ) by marginal likelihood.
//! A launch may be spoilt: then it is the base model's, whatever the candidate says.
//!
//! Sources: mixed-effects models (Pinheiro and Bates, Mixed-Effects Models in S and S-PLUS, 2000), predictive densities of
//! held-out groups (Vehtari, Gelman and Gabry, Stat. Comput. 27 (2017) 1413).

use nalgebra::{DMatrix, DVector};

use super::components::{HELD, Likelihood};
use super::gaussian::{Components, Pooled, Prior, Told, all_told, pooled};
use super::launch::Part;
use super::stats::inverse;

/// Probability that a launch is no launch of the model's law.
pub const SPOILT: f64 = 0.05;
/// Fewest and most folds: each leaves out a share of the launches.
const FOLDS: usize = 10;

/// Groups of launches that are held out together: every setting is spread over all of them.
pub fn folds(settings: &[usize]) -> Vec<usize> {
    let count = FOLDS.min(settings.len()).max(1);
    let mut seen = vec![0usize; settings.iter().max().map_or(0, |m| m + 1)];
    let mut first = 0;
    let mut out = Vec::with_capacity(settings.len());
    for setting in settings {
        if seen[*setting] == 0 {
            seen[*setting] = first + 1;
            first += 1;
        }
        out.push((seen[*setting] - 1) % count);
        seen[*setting] += 1;
    }
    out
}

/// Log predictive density of every launch, its slots and components told from other folds.
pub fn held_out(parts: &[Part], prior: &Prior, known: &Components, folds: &[usize]) -> Option<Vec<f64>> {
    let mut out = vec![0.0; folds.len()];
    each_held_out(parts, prior, known, folds, |t, others| out[t.launch] += t.predicted(others))?;
    Some(out)
}

/// Hands over what every part says, with what other folds say of the slots; components are those folds' own.
pub fn each_held_out(
    parts: &[Part],
    prior: &Prior,
    known: &Components,
    folds: &[usize],
    mut of: impl FnMut(&Told, &Pooled),
) -> Option<()> {
    let mut likelihood = Likelihood::new(parts, known);
    // Most folds ask for the same components.
    let mut told: Vec<(Components, Vec<Told>)> = Vec::new();
    for fold in 0..folds.iter().max().map_or(0, |m| m + 1) {
        let own = likelihood.most(prior, HELD, |p| folds[p.launch] != fold);
        let at = match told.iter().position(|t| t.0 == own) {
            Some(at) => at,
            None => {
                let all = all_told(parts, &own)?;
                told.push((own, all));
                told.len() - 1
            }
        };
        let all = &told[at].1;
        let others = pooled(all.iter().filter(|t| folds[t.launch] != fold), prior)?;
        all.iter().filter(|t| folds[t.launch] == fold).for_each(|t| of(t, &others));
    }
    Some(())
}

/// The same of what parts say under components that are given, and what is left of launches that are held out: squares, in units
/// of the noise. A size by setting that only launches held out tell is for squares what those say: of eleven balls dropped once
/// each, none tells how the air holds another.
pub fn held_out_with(
    parts: &[Part],
    told: &[Told],
    prior: &Prior,
    folds: &[usize],
) -> Option<(Vec<f64>, Vec<f64>)> {
    let (mut scores, mut squares) = (vec![0.0; folds.len()], vec![0.0; folds.len()]);
    for fold in 0..folds.iter().max().map_or(0, |m| m + 1) {
        let others = pooled(told.iter().filter(|t| folds[t.launch] != fold), prior)?;
        let step = with_lonely(told, prior, folds, fold, &others.step);
        for (part, t) in parts.iter().zip(told).filter(|(p, _)| folds[p.launch] == fold) {
            scores[t.launch] += t.predicted(&others);
            squares[t.launch] += part.square_at(&step);
        }
    }
    Some((scores, squares))
}

/// The step of the others with those slots by setting of which they say nothing where the fold's own launches ask for them.
fn with_lonely(
    told: &[Told],
    prior: &Prior,
    folds: &[usize],
    fold: usize,
    step: &DVector<f64>,
) -> DVector<f64> {
    let of = |own: bool| told.iter().filter(move |t| (folds[t.launch] == fold) == own);
    let says = |own: bool, k: usize| of(own).map(|t| t.gram[(k, k)]).sum::<f64>() > 0.0;
    let lonely = |k: &usize| prior.by_setting[*k] && says(true, *k) && !says(false, *k);
    let slots: Vec<usize> = (0..step.len()).filter(lonely).collect();
    let mut out = step.clone();
    if slots.is_empty() {
        return out;
    }
    let n = slots.len();
    let gram = DMatrix::from_fn(n, n, |i, j| of(true).map(|t| t.gram[(slots[i], slots[j])]).sum());
    let asked: DVector<f64> =
        of(true).fold(DVector::zeros(step.len()), |sum, t| sum + &t.score - &t.gram * step);
    let moved = inverse(&gram) * DVector::from_fn(n, |i, _| asked[slots[i]]);
    slots.iter().zip(moved.iter()).for_each(|(k, m)| out[*k] += m);
    out
}

/// Scores with launches that may be spoilt: then they are the base model's.
pub fn spared(own: &[f64], base: &[f64]) -> Vec<f64> {
    let mixed = |(own, base): (&f64, &f64)| {
        let (a, b) = ((1.0 - SPOILT).ln() + own, SPOILT.ln() + base);
        let most = a.max(b);
        most + ((a - most).exp() + (b - most).exp()).ln()
    };
    own.iter().zip(base).map(mixed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spoilt_launch_costs_no_more_than_its_chance() {
        assert!((spared(&[-500.0], &[-40.0])[0] - (-40.0 + SPOILT.ln())).abs() < 1e-6);
    }

    /// Two launches, each of a setting of its own: what the one says of its size says nothing of the other's.
    #[test]
    fn a_size_that_only_one_launch_tells_is_its_own() {
        let told = |launch: usize| {
            let mut gram = DMatrix::zeros(2, 2);
            gram[(launch, launch)] = 4.0;
            let score = DVector::from_fn(2, |k, _| if k == launch { 6.0 } else { 0.0 });
            Told { launch, gram, score, square: 9.0, log_det: 0.0, count: 8.0, allowed: 0.0 }
        };
        let none = || vec![0.0; 2];
        let mut prior = Prior {
            precision: DMatrix::identity(2, 2),
            off: DVector::zeros(2),
            plausible: none(),
            reason: none(),
            by_setting: vec![true; 2],
        };
        let both = [told(0), told(1)];
        let zero = DVector::zeros(2);
        assert_eq!(with_lonely(&both, &prior, &[0, 1], 0, &zero).as_slice(), [1.5, 0.0]);
        prior.by_setting = vec![false; 2];
        assert_eq!(with_lonely(&both, &prior, &[0, 1], 0, &zero), zero);
    }

    #[test]
    fn every_setting_is_spread_over_the_folds() {
        let folds = folds(&[0, 0, 0, 1, 1, 1]);
        let of = |s: usize| -> Vec<usize> { folds[3 * s..3 * s + 3].to_vec() };
        for s in 0..2 {
            let mut own = of(s);
            own.dedup();
            assert_eq!(own.len(), 3);
        }
    }
}
