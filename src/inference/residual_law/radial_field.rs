//! Sparse radial basis approximation of the shared field, as effects that can be simulated.
//!
//! Forward selection: a function is added while its log Bayes factor (two amplitudes under the field's ridge
//! prior, given those selected before) exceeds the logarithm of the number of candidates. The result
//! initialises a fit like that of effects (`residual_law`).
//!
//! Source: relevance by marginal likelihood (Tipping, J. Mach. Learn. Res. 1 (2001) 211; forward selection as Tipping and Faul,
//! AISTATS 2003).
//!
//! Differences from the source: one prior variance for all amplitudes, the most probable one of the full
//! field; functions are never removed.

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

use crate::error::Result;
use crate::inference::field::{FieldSpec, FieldStatistics, field_statistics};
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::model::{ParameterLayout, Term};
use crate::world::effect::Effect;

/// Maximum number of functions: with effects of the set and of the scene at most the 32 that a server accepts
/// per world.
const MAX_BASIS_FUNCTIONS: usize = 24;

/// Terms for a field in addition to a model, with both amplitudes free; empty if no function is selected.
pub fn radial_terms(fitter: &ModelFitter, model: &FittedModel, form: FieldSpec) -> Result<Vec<Term>> {
    let Some(statistics) = field_statistics(fitter, model, form)? else { return Ok(Vec::new()) };
    let joined = forward_selection(&statistics, model.layout.parameters.len(), form.coefficient_sd.powi(-2));
    let term = |(bump, amplitudes): (usize, Vector2<f64>)| {
        let (effect, mut start) = statistics.effects[bump].clone();
        for axis in 0..2 {
            let [low, high] = effect.parameters[axis].bounds;
            start[axis] = amplitudes[axis].clamp(low, high);
        }
        let free = (0..start.len()).map(|p| p < 2).collect();
        Term { effect, per_setting: false, start, free, fd_step: None, bracket: None }
    };
    Ok(joined.into_iter().map(term).collect())
}

/// Description of a layout's terms from `first` on: numbers and largest amplitude by effect.
pub fn describe(layout: &ParameterLayout, values: &[f64], first: usize) -> String {
    let mut kinds: Vec<(&'static Effect, usize, f64)> = Vec::new();
    for t in first..layout.terms.len() {
        let effect = layout.terms[t].effect;
        let size = layout.parameters_of_term(t).iter().fold(0.0, |size: f64, i| size.hypot(values[*i]));
        match kinds.iter_mut().find(|k| k.0.name == effect.name) {
            Some(kind) => (kind.1, kind.2) = (kind.1 + 1, kind.2.max(size)),
            None => kinds.push((effect, 1, size)),
        }
    }
    let all: Vec<String> =
        kinds.iter().map(|(e, count, most)| format!("{count} {} up to {most:.2} m/s^2", e.name)).collect();
    format!("a force field of Gaussian bumps: {}", all.join(", "))
}

/// Forward selection: (function, amplitudes), best first. The first `parameters` columns are the model's;
/// `precision`: of the prior of an amplitude.
fn forward_selection(
    statistics: &FieldStatistics,
    parameters: usize,
    precision: f64,
) -> Vec<(usize, Vector2<f64>)> {
    let charge = (statistics.effects.len() as f64).ln();
    let (mut gram, mut score) = (statistics.gram.clone(), statistics.score.clone());
    let mut chosen: Vec<usize> = Vec::new();
    (0..parameters).for_each(|k| sweep(&mut gram, &mut score, k, 0.0));
    while chosen.len() < MAX_BASIS_FUNCTIONS {
        let gain = |bump: &usize| {
            let at = parameters + 2 * bump;
            let own = gram.fixed_view::<2, 2>(at, at) + Matrix2::from_diagonal_element(precision);
            let Some(factor) = own.cholesky() else { return f64::NEG_INFINITY };
            let score = score.fixed_rows::<2>(at).into_owned();
            0.5 * (score.dot(&factor.solve(&score)) - (own.determinant() / precision.powi(2)).ln())
        };
        let others = (0..statistics.effects.len()).filter(|b| !chosen.contains(b));
        let Some((best, gained)) =
            others.map(|b| (b, gain(&b))).max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
        else {
            break;
        };
        if gained <= charge {
            break;
        }
        chosen.push(best);
        (0..2).for_each(|a| sweep(&mut gram, &mut score, parameters + 2 * best + a, precision));
    }
    joint_amplitudes(statistics, parameters, precision, chosen)
}

/// Sweeps a free coefficient with prior precision out of the normal equations.
fn sweep(gram: &mut DMatrix<f64>, score: &mut DVector<f64>, number: usize, precision: f64) {
    let own = gram[(number, number)] + precision;
    if own <= 0.0 {
        return;
    }
    let (column, pull) = (gram.column(number).into_owned(), score[number]);
    gram.ger(-1.0 / own, &column, &column, 1.0);
    score.axpy(-pull / own, &column, 1.0);
}

/// Joint estimate of the selected amplitudes, with the model's parameters.
fn joint_amplitudes(
    statistics: &FieldStatistics,
    parameters: usize,
    precision: f64,
    chosen: Vec<usize>,
) -> Vec<(usize, Vector2<f64>)> {
    let all: Vec<usize> = (0..parameters)
        .chain(chosen.iter().flat_map(|b| [parameters + 2 * b, parameters + 2 * b + 1]))
        .collect();
    let mut gram = statistics.gram.select_rows(&all).select_columns(&all);
    (parameters..all.len()).for_each(|k| gram[(k, k)] += precision);
    let Some(factor) = gram.cholesky() else { return Vec::new() };
    let step = factor.solve(&statistics.score.select_rows(&all));
    let amplitudes = |(i, bump)| (bump, Vector2::new(step[parameters + 2 * i], step[parameters + 2 * i + 1]));
    chosen.into_iter().enumerate().map(amplitudes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::effect::place_push;

    /// Normal equations of 40 functions with a nuisance column, for data with some amplitudes.
    fn normal_equations(amplitudes: &[(usize, [f64; 2])], noise: f64) -> FieldStatistics {
        let (parameters, count, rows) = (1, 40, 400);
        let wave = |i: usize, k: usize| {
            libm::sin(0.37 * ((i + 3) * (k + 1)) as f64) + if k == 0 { 0.5 } else { 0.0 }
        };
        let columns = DMatrix::from_fn(rows, parameters + 2 * count, wave);
        let mut observed = columns.column(0) * 7.0;
        for (bump, own) in amplitudes {
            (0..2).for_each(|a| observed.axpy(own[a], &columns.column(parameters + 2 * bump + a), 1.0));
        }
        (0..rows).for_each(|i| observed[i] += noise * libm::sin(12.9 * (i * i) as f64) * 1.4);
        let mut gram = columns.tr_mul(&columns) / (noise * noise);
        gram[(0, 0)] += 1e-6;
        FieldStatistics {
            gram,
            score: columns.tr_mul(&observed) / (noise * noise),
            effects: vec![(&place_push::EFFECT, Vec::new()); count],
        }
    }

    /// Selects the true functions with their amplitudes, and none from noise.
    #[test]
    fn true_functions_are_selected() {
        let mut found =
            forward_selection(&normal_equations(&[(5, [1.0, -0.6]), (17, [0.0, 0.8])], 0.3), 1, 1.0);
        found.sort_by_key(|f| f.0);
        assert_eq!(found.iter().map(|f| f.0).collect::<Vec<_>>(), [5, 17], "{found:?}");
        for (own, expected) in found.iter().zip([[1.0, -0.6], [0.0, 0.8]]) {
            assert!(
                (own.1[0] - expected[0]).abs() < 0.05 && (own.1[1] - expected[1]).abs() < 0.05,
                "{found:?}"
            );
        }
        assert_eq!(forward_selection(&normal_equations(&[], 0.3), 1, 1.0), []);
    }
}
