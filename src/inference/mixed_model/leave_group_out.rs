//! Held-out squares: each group of trials is left out in turn, and the parameters follow by one Newton step
//! from the normal equations. For prediction gains in metres; decisions use the evidence.
//!
//! A parameter that only the held-out trials identify (of a setting with one trial) is fitted to them, with
//! Mallows' C_p penalty of 2 noise variances.

use nalgebra::{DMatrix, DVector};

use crate::inference::model::{NormalEquations, ParameterLayout};
use crate::inference::statistics::{fix_parameter, solve};

/// Held-out losses by trial and parameter changes by group; `groups[i]`: group of trial i; `cached`: fixed
/// parameters.
pub fn leave_group_out(
    layout: &ParameterLayout,
    values: &[f64],
    trials: &[NormalEquations],
    settings: &[usize],
    groups: &[usize],
    cached: &[usize],
) -> (Vec<f64>, Vec<DVector<f64>>) {
    let q = layout.parameters.len();
    let mut held = vec![0.0; trials.len()];
    let mut moved = Vec::new();
    let (mut gram, mut score) = (DMatrix::zeros(q, q), DVector::zeros(q));
    for t in trials {
        gram += &t.gram;
        score += &t.score;
    }
    for group in 0..groups.iter().max().map_or(0, |m| m + 1) {
        let members: Vec<usize> = (0..trials.len()).filter(|i| groups[*i] == group).collect();
        let own_setting = |s: usize| (0..trials.len()).all(|i| settings[i] != s || groups[i] == group);
        // Parameters that no other trial identifies.
        let own: Vec<usize> =
            (0..q).filter(|k| layout.parameters[*k].setting.is_some_and(own_setting)).collect();
        let (mut a, mut b) = (gram.clone(), score.clone());
        for i in &members {
            a -= &trials[*i].gram;
            b -= &trials[*i].score;
        }
        for (k, parameter) in layout.parameters.iter().enumerate() {
            if own.contains(&k) || cached.contains(&k) || parameter.is_at_active_bound(values[k], b[k]) {
                fix_parameter(&mut a, &mut b, k);
            }
            a[(k, k)] += parameter.min_information();
        }
        let mut step = solve(&a, &b);
        let left: Vec<&NormalEquations> = members.iter().map(|i| &trials[*i]).collect();
        fit_unshared(&left, &own, &mut step);
        for (k, parameter) in layout.parameters.iter().enumerate() {
            step[k] = (values[k] + step[k]).clamp(parameter.bounds[0], parameter.bounds[1]) - values[k];
        }
        let cost = 2.0 * own.len() as f64 / members.len() as f64;
        for i in &members {
            held[*i] = trials[*i].square_after(&step).max(0.0) + cost;
        }
        moved.push(step);
    }
    (held, moved)
}

/// Fits the unshared parameters to the held-out trials after the step of the others.
fn fit_unshared(trials: &[&NormalEquations], own: &[usize], step: &mut DVector<f64>) {
    let (mut a, mut b) = (DMatrix::zeros(own.len(), own.len()), DVector::zeros(own.len()));
    for t in trials {
        let pushed = &t.score - &t.gram * &*step;
        for (r, k) in own.iter().enumerate() {
            b[r] += pushed[*k];
            for (c, l) in own.iter().enumerate() {
                a[(r, c)] += t.gram[(*k, *l)];
            }
        }
    }
    own.iter().zip(solve(&a, &b).iter()).for_each(|(k, s)| step[*k] = *s);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::model::Term;
    use crate::inference::testing::segments::term;

    /// Trials that each observe one parameter with unit noise.
    fn normal_equations_of(numbers: &[f64], parameters: &[usize], q: usize) -> Vec<NormalEquations> {
        let of = |(y, k): (&f64, &usize)| {
            let column = DVector::from_fn(q, |i, _| f64::from(i == *k));
            NormalEquations { gram: &column * column.transpose(), score: &column * *y, square: y * y }
        };
        numbers.iter().zip(parameters).map(of).collect()
    }

    fn drag(per_setting: bool, settings: usize) -> ParameterLayout {
        let mut layout =
            ParameterLayout::new(&[], vec![Term { per_setting, ..term("gravity_error") }], settings);
        // Wide bounds, so that the weak prior has no influence.
        layout.parameters.iter_mut().for_each(|s| s.bounds = [-1e3, 1e3]);
        layout
    }

    /// The residual from the mean of n - 1 others is n / (n - 1) times that from the mean.
    #[test]
    fn held_out_residuals_use_the_other_trials() {
        let numbers = [1.0, 2.0, 4.0, 9.0];
        let layout = drag(false, 1);
        let trials = normal_equations_of(&numbers, &[0; 4], 1);
        let (held, _) = leave_group_out(&layout, &[0.0], &trials, &[0; 4], &[0, 1, 2, 3], &[]);
        for (held, y) in held.iter().zip(numbers) {
            assert!((held - ((y - 4.0) * 4.0 / 3.0f64).powi(2)).abs() < 1e-4, "{held} of {y}");
        }
    }

    /// A parameter identified by the held-out trial alone is fitted and penalised; fixed parameters stay.
    #[test]
    fn unshared_parameters_are_penalised() {
        let layout = drag(true, 2);
        let trials = normal_equations_of(&[1.0, 3.0, 7.0], &[0, 0, 1], 2);
        let of =
            |cached: &[usize]| leave_group_out(&layout, &[0.0; 2], &trials, &[0, 0, 1], &[0, 1, 2], cached).0;
        let held = of(&[]);
        assert!((held[0] - 4.0).abs() < 1e-4 && (held[1] - 4.0).abs() < 1e-4, "{held:?}");
        assert!((held[2] - 2.0).abs() < 1e-9, "two for one number: {held:?}");
        assert!((of(&[0])[0] - 1.0).abs() < 1e-9);
    }
}
