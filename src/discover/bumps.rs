//! The field that launches share and nobody named (`field`), as a sum of few bumps that any world can simulate.
//!
//! A bump joins while that makes launches likelier by more than choosing it among all of them costs: the log Bayes factor of
//! its two amplitudes under the field's own ridge prior, given those that joined before, in the same likelihood in which the
//! field is one more rival. (At a charge of one nat twice as many bumps join, and rollouts miss new launches by as much: 0.13 to
//! 0.26 m in place of 0.14 to 0.24 m, of swirls and rings.) What is found this way is only where a fit starts from: the terms are then fitted and held out as
//! effects are (`described`).
//!
//! Source: relevance by marginal likelihood (Tipping, J. Mach. Learn. Res. 1 (2001) 211; forward selection as Tipping and Faul,
//! AISTATS 2003).
//!
//! Differences from the source: one prior variance for all amplitudes, that by which the whole field predicts best; bumps are
//! never taken back.

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

use super::field::{FieldSpec, FieldStatistics, field_statistics};
use super::fit::{FittedModel, ModelFitter};
use super::model::{ParameterLayout, Term};
use crate::error::Result;
use crate::world::effect::Effect;

/// Most bumps: with three effects of a set and a few of the scene's own they are as many as a server takes of one world (32).
const MAX_BASIS_FUNCTIONS: usize = 24;

/// Terms for a field beside a model, both amplitudes free in each; none where no bump is worth its choice.
pub fn radial_terms(fitter: &ModelFitter, model: &FittedModel, form: FieldSpec) -> Result<Vec<Term>> {
    let Some(said) = field_statistics(fitter, model, form)? else { return Ok(Vec::new()) };
    let joined = forward_selection(&said, model.layout.parameters.len(), form.coefficient_sd.powi(-2));
    let term = |(bump, amplitudes): (usize, Vector2<f64>)| {
        let (effect, mut start) = said.effects[bump].clone();
        for axis in 0..2 {
            let [low, high] = effect.parameters[axis].bounds;
            start[axis] = amplitudes[axis].clamp(low, high);
        }
        let free = (0..start.len()).map(|p| p < 2).collect();
        Term { effect, per_setting: false, start, free, fd_step: None }
    };
    Ok(joined.into_iter().map(term).collect())
}

/// Bumps of a layout from its term `first` on, in words: how many of which effect, and how strong.
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

/// (bump, amplitudes) of those that join, best first. The first `slots` are the model's; `precision`: of the prior of an
/// amplitude.
fn forward_selection(said: &FieldStatistics, slots: usize, precision: f64) -> Vec<(usize, Vector2<f64>)> {
    let charge = (said.effects.len() as f64).ln();
    let (mut gram, mut score) = (said.gram.clone(), said.score.clone());
    let mut chosen: Vec<usize> = Vec::new();
    (0..slots).for_each(|k| sweep(&mut gram, &mut score, k, 0.0));
    while chosen.len() < MAX_BASIS_FUNCTIONS {
        let gain = |bump: &usize| {
            let at = slots + 2 * bump;
            let own = gram.fixed_view::<2, 2>(at, at) + Matrix2::from_diagonal_element(precision);
            let Some(factor) = own.cholesky() else { return f64::NEG_INFINITY };
            let score = score.fixed_rows::<2>(at).into_owned();
            0.5 * (score.dot(&factor.solve(&score)) - (own.determinant() / precision.powi(2)).ln())
        };
        let others = (0..said.effects.len()).filter(|b| !chosen.contains(b));
        let Some((best, gained)) =
            others.map(|b| (b, gain(&b))).max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
        else {
            break;
        };
        if gained <= charge {
            break;
        }
        chosen.push(best);
        (0..2).for_each(|a| sweep(&mut gram, &mut score, slots + 2 * best + a, precision));
    }
    joint_amplitudes(said, slots, precision, chosen)
}

/// Takes a number with a prior precision out of normal equations as free: what is left is what the others say beside it.
fn sweep(gram: &mut DMatrix<f64>, score: &mut DVector<f64>, number: usize, precision: f64) {
    let own = gram[(number, number)] + precision;
    if own <= 0.0 {
        return;
    }
    let (column, pull) = (gram.column(number).into_owned(), score[number]);
    gram.ger(-1.0 / own, &column, &column, 1.0);
    score.axpy(-pull / own, &column, 1.0);
}

/// The amplitudes of chosen bumps, all and the model's slots together.
fn joint_amplitudes(
    said: &FieldStatistics,
    slots: usize,
    precision: f64,
    chosen: Vec<usize>,
) -> Vec<(usize, Vector2<f64>)> {
    let all: Vec<usize> =
        (0..slots).chain(chosen.iter().flat_map(|b| [slots + 2 * b, slots + 2 * b + 1])).collect();
    let mut gram = said.gram.select_rows(&all).select_columns(&all);
    (slots..all.len()).for_each(|k| gram[(k, k)] += precision);
    let Some(factor) = gram.cholesky() else { return Vec::new() };
    let step = factor.solve(&said.score.select_rows(&all));
    let amplitudes = |(i, bump)| (bump, Vector2::new(step[slots + 2 * i], step[slots + 2 * i + 1]));
    chosen.into_iter().enumerate().map(amplitudes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::effect::place_push;

    /// What forty bumps, each of two functions that a slot is in the way of, say of amplitudes that some of them have.
    fn told(amplitudes: &[(usize, [f64; 2])], noise: f64) -> FieldStatistics {
        let (slots, count, rows) = (1, 40, 400);
        let wave = |i: usize, k: usize| {
            libm::sin(0.37 * ((i + 3) * (k + 1)) as f64) + if k == 0 { 0.5 } else { 0.0 }
        };
        let columns = DMatrix::from_fn(rows, slots + 2 * count, wave);
        let mut seen = columns.column(0) * 7.0;
        for (bump, own) in amplitudes {
            (0..2).for_each(|a| seen.axpy(own[a], &columns.column(slots + 2 * bump + a), 1.0));
        }
        (0..rows).for_each(|i| seen[i] += noise * libm::sin(12.9 * (i * i) as f64) * 1.4);
        let mut gram = columns.tr_mul(&columns) / (noise * noise);
        gram[(0, 0)] += 1e-6;
        FieldStatistics {
            gram,
            score: columns.tr_mul(&seen) / (noise * noise),
            effects: vec![(&place_push::EFFECT, Vec::new()); count],
        }
    }

    /// Those that are there join with their amplitudes, whatever a slot could take up of them; chance joins nothing.
    #[test]
    fn those_that_are_there_join() {
        let mut found = forward_selection(&told(&[(5, [1.0, -0.6]), (17, [0.0, 0.8])], 0.3), 1, 1.0);
        found.sort_by_key(|f| f.0);
        assert_eq!(found.iter().map(|f| f.0).collect::<Vec<_>>(), [5, 17], "{found:?}");
        for (own, wanted) in found.iter().zip([[1.0, -0.6], [0.0, 0.8]]) {
            assert!((own.1[0] - wanted[0]).abs() < 0.05 && (own.1[1] - wanted[1]).abs() < 0.05, "{found:?}");
        }
        assert_eq!(forward_selection(&told(&[], 0.3), 1, 1.0), []);
    }
}
