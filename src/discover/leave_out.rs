//! Squares of held-out trials: each group of trials is left out in turn, and the parameters follow in one Newton step from
//! the Gram matrices that a fit left behind. What a gain is told in, not what decides.
//!
//! A quantity that only the trials left out tell (a per-setting parameter whose setting has one trial) is fitted to them
//! even so, and pays for it as Mallows' C_p says: 2 noise variances each.

use nalgebra::{DMatrix, DVector};

use super::model::{NormalEquations, ParameterLayout};
use super::stats::{fix_parameter, solve};

/// Held-out losses by trial and parameter changes by group left out; `groups[i]` is the group of trial i, `frozen`
/// slots stay where they are.
pub fn leave_group_out(
    layout: &ParameterLayout,
    values: &[f64],
    trials: &[NormalEquations],
    settings: &[usize],
    groups: &[usize],
    frozen: &[usize],
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
        // Slots that no other trial tells.
        let own: Vec<usize> =
            (0..q).filter(|k| layout.parameters[*k].setting.is_some_and(own_setting)).collect();
        let (mut a, mut b) = (gram.clone(), score.clone());
        for i in &members {
            a -= &trials[*i].gram;
            b -= &trials[*i].score;
        }
        for (k, slot) in layout.parameters.iter().enumerate() {
            if own.contains(&k) || frozen.contains(&k) || slot.is_at_active_bound(values[k], b[k]) {
                fix_parameter(&mut a, &mut b, k);
            }
            a[(k, k)] += slot.min_information();
        }
        let mut step = solve(&a, &b);
        let left: Vec<&NormalEquations> = members.iter().map(|i| &trials[*i]).collect();
        fit_unshared(&left, &own, &mut step);
        for (k, slot) in layout.parameters.iter().enumerate() {
            step[k] = (values[k] + step[k]).clamp(slot.bounds[0], slot.bounds[1]) - values[k];
        }
        let cost = 2.0 * own.len() as f64 / members.len() as f64;
        for i in &members {
            held[*i] = trials[*i].square_after(&step).max(0.0) + cost;
        }
        moved.push(step);
    }
    (held, moved)
}

/// Fits slots to the trials left out, the others having stepped already.
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
    use crate::discover::fixture::term;
    use crate::discover::model::Term;

    /// Trials that each see one number with unit noise, as the fit's residuals from nothing.
    fn seen(numbers: &[f64], slots: &[usize], q: usize) -> Vec<NormalEquations> {
        let of = |(y, k): (&f64, &usize)| {
            let column = DVector::from_fn(q, |i, _| f64::from(i == *k));
            NormalEquations { gram: &column * column.transpose(), score: &column * *y, square: y * y }
        };
        numbers.iter().zip(slots).map(of).collect()
    }

    fn drag(per_setting: bool, settings: usize) -> ParameterLayout {
        let mut layout =
            ParameterLayout::new(&[], vec![Term { per_setting, ..term("gravity_error") }], settings);
        // So wide that the weak prior says next to nothing.
        layout.parameters.iter_mut().for_each(|s| s.bounds = [-1e3, 1e3]);
        layout
    }

    /// A mean told from n - 1 others: each residual grows by n / (n - 1).
    #[test]
    fn a_mean_is_told_from_the_others() {
        let numbers = [1.0, 2.0, 4.0, 9.0];
        let layout = drag(false, 1);
        let trials = seen(&numbers, &[0; 4], 1);
        let (held, _) = leave_group_out(&layout, &[0.0], &trials, &[0; 4], &[0, 1, 2, 3], &[]);
        for (held, y) in held.iter().zip(numbers) {
            assert!((held - ((y - 4.0) * 4.0 / 3.0f64).powi(2)).abs() < 1e-4, "{held} of {y}");
        }
    }

    /// What only the trial left out tells is fitted to it, and pays for that; what is frozen stays.
    #[test]
    fn what_nobody_else_tells_is_paid_for() {
        let layout = drag(true, 2);
        let trials = seen(&[1.0, 3.0, 7.0], &[0, 0, 1], 2);
        let of =
            |frozen: &[usize]| leave_group_out(&layout, &[0.0; 2], &trials, &[0, 0, 1], &[0, 1, 2], frozen).0;
        let held = of(&[]);
        assert!((held[0] - 4.0).abs() < 1e-4 && (held[1] - 4.0).abs() < 1e-4, "{held:?}");
        assert!((held[2] - 2.0).abs() < 1e-9, "two for one number: {held:?}");
        assert!((of(&[0])[0] - 1.0).abs() < 1e-9);
    }
}
