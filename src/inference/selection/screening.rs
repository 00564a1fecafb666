//! Screening of candidates by score tests: the expected gain of a model by each, from its linearization.
//!
//! Source: score test: Rao, Math. Proc. Camb. Phil. Soc. 44 (1948) 50.

use std::cmp::Ordering;

use nalgebra::{DMatrix, DVector};

use crate::error::Result;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::group_statistics::{self, SCALE_DOF};
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::model::{Perturbation, Term};
use crate::inference::selection::candidates::Candidate;

/// Minimum squared response to a plausible amplitude, in units of the noise, for an effect to be
/// identifiable.
const MIN_SCREENING_INFORMATION: f64 = 1.0;
/// Upper limit of the components in the score test: without the effect they absorb its misfit.
const MAX_SCREENING_SD: f64 = 1.0;

/// Score test of a candidate: expected log density, index of the initial values, and amplitudes.
pub type ScoreTest = (f64, usize, Vec<f64>);

/// Score tests by candidate, best first; empty for effects in the model.
pub fn screen(
    fitter: &ModelFitter,
    library: &[Candidate],
    fit: &FittedModel,
) -> Result<Option<Vec<Vec<ScoreTest>>>> {
    let (columns, perturbations) = candidate_columns(library, fit);
    let Some((_, groups)) = fitter.groups(&fit.layout, &fit.state, &perturbations)? else {
        return Ok(None);
    };
    let q = fit.layout.parameters.len();
    let mut components = fit.components.clone();
    components.discrepancy = components.discrepancy.min(MAX_SCREENING_SD);
    components.accelerations.iter_mut().for_each(|p| *p = p.min(MAX_SCREENING_SD));
    let tests = group_statistics::group_statistics(&groups, &components, fitter.data.progress)?;
    let Some(tests) = tests else { return Ok(None) };
    let (own, current) = (fitter.prior(&fit.layout, &fit.state), DVector::zeros(q + perturbations.len()));
    let before: f64 = tests.iter().map(|t| t.log_density_after(&current)).sum();
    let settings = fitter.data.settings;
    let mut out: Vec<Vec<ScoreTest>> = library.iter().map(|_| Vec::new()).collect();
    for CandidateColumns { candidate: c, start: s, first: from, count } in columns {
        fitter.data.progress.check_stop()?;
        let term = &library[c].starts[s];
        let chosen: Vec<usize> = (0..q).chain(q + from..q + from + count).collect();
        let weak = amplitude_precisions(term);
        let tells = |k: usize| {
            tests.iter().map(|t| t.gram[(q + from + k, q + from + k)]).sum::<f64>()
                > MIN_SCREENING_INFORMATION * weak[k]
        };
        if !(0..count).any(tells) {
            continue;
        }
        let gain = |setting: Option<usize>| {
            let n = chosen.len();
            let (mut gram, mut score) = (DMatrix::zeros(n, n), DVector::zeros(n));
            for t in tests.iter().filter(|t| setting.is_none_or(|s| settings[t.trial] == s)) {
                // Weight of a trial with its scale integrated out.
                let weight = (SCALE_DOF + t.count) / (SCALE_DOF + t.square.max(0.0));
                for (i, a) in chosen.iter().enumerate() {
                    score[i] += weight * t.score[*a];
                    for (j, b) in chosen.iter().enumerate() {
                        gram[(i, j)] += weight * t.gram[(*a, *b)];
                    }
                }
            }
            (0..q).for_each(|i| (0..q).for_each(|j| gram[(i, j)] += own.precision[(i, j)]));
            (q..n).for_each(|k| gram[(k, k)] += weak[k - q]);
            let step = gram.cholesky()?.solve(&score);
            Some((0.5 * score.dot(&step), step.rows(q, count).iter().copied().collect::<Vec<f64>>()))
        };
        let tests: Vec<(f64, Vec<f64>)> = match term.per_setting {
            true => (0..fitter.data.setting_count()).filter_map(|s| gain(Some(s))).collect(),
            false => gain(None).into_iter().collect(),
        };
        if tests.is_empty() {
            continue;
        }
        let sizes = (0..count).map(|k| tests.iter().map(|t| t.1[k]).sum::<f64>() / tests.len() as f64);
        out[c].push((before + tests.iter().map(|t| t.0).sum::<f64>(), s, sizes.collect()));
    }
    add_steps(library, fit, before, &mut out);
    out.iter_mut().for_each(|o| o.sort_by(|a, b| b.0.partial_cmp(&a.0).unwrap_or(Ordering::Equal)));
    Ok(Some(out))
}

/// Columns of the perturbed predictions that belong to one start of a candidate.
struct CandidateColumns {
    candidate: usize,
    start: usize,
    first: usize,
    count: usize,
}

/// Perturbations by every start of the candidates outside the model, and the columns of each.
fn candidate_columns(library: &[Candidate], fit: &FittedModel) -> (Vec<CandidateColumns>, Vec<Perturbation>) {
    let (mut columns, mut perturbations) = (Vec::new(), Vec::new());
    for (candidate, Candidate { effect, starts, .. }) in library.iter().enumerate() {
        if fit.effects.iter().any(|e| e.name == effect.name) {
            continue;
        }
        for (start, term) in starts.iter().enumerate() {
            let own = amplitude_perturbations(term);
            columns.push(CandidateColumns { candidate, start, first: perturbations.len(), count: own.len() });
            perturbations.extend(own);
        }
    }
    (columns, perturbations)
}

/// Adds the scans of stepwise effects, which a linearization does not show, to score tests by candidate.
fn add_steps(library: &[Candidate], fit: &FittedModel, before: f64, tests: &mut [Vec<ScoreTest>]) {
    for (tests, candidate) in tests.iter_mut().zip(library) {
        if let Some((term, gain)) = &candidate.strong_start
            && term.bracket.is_some()
            && !fit.effects.iter().any(|e| e.name == candidate.effect.name)
        {
            *tests = vec![(before + gain, 0, term.start.clone())];
        }
    }
}

/// Perturbations by the amplitudes of a term at its initial values.
fn amplitude_perturbations(term: &Term) -> Vec<Perturbation> {
    let parameters = term.effect.parameters;
    let shapes = |p: usize| !parameters[p].is_amplitude();
    let direction = |p: usize| {
        let own = |k: usize| match k {
            _ if shapes(k) => term.start[k],
            _ if k == p => parameters[k].neutral + parameters[k].fd_step,
            _ => parameters[k].neutral,
        };
        Perturbation {
            effect: term.effect,
            values: (0..parameters.len()).map(own).collect(),
            unit: parameters[p].fd_step,
        }
    };
    (0..parameters.len()).filter(|p| !shapes(*p) && term.free[*p]).map(direction).collect()
}

/// Prior precisions of a term's amplitudes.
fn amplitude_precisions(term: &Term) -> Vec<f64> {
    let parameters = term.effect.parameters.iter().zip(&term.free);
    parameters.filter(|(p, free)| p.is_amplitude() && **free).map(|(p, _)| p.prior_sd.powi(-2)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::term;

    /// A gust is perturbed by its amplitudes along x and y at the initial period and phase.
    #[test]
    fn perturbations_change_one_amplitude() {
        let mut gust = term("gust");
        gust.start[2] = 1.7;
        let all = amplitude_perturbations(&gust);
        assert_eq!(all.len(), 2);
        for (k, perturbation) in all.iter().enumerate() {
            assert!(
                perturbation.values[k] != gust.start[k] && perturbation.values[1 - k] == gust.start[1 - k]
            );
            assert_eq!(perturbation.values[2..], gust.start[2..]);
        }
    }
}
