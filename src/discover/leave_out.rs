//! Squares of held-out trials: each group of trials is left out in turn, and the parameters follow in one Newton step from
//! the Gram matrices that a fit left behind. What a gain is told in, not what decides.
//!
//! A quantity that only the trials left out tell (a per-setting parameter whose setting has one trial) is fitted to them
//! even so, and pays for it as Mallows' C_p says: 2 noise variances each.

use nalgebra::{DMatrix, DVector};

use super::model::{Layout, Sums};
use super::stats::solve;

/// Held-out losses by trial and parameter changes by group left out; `groups[i]` is the group of trial i, `frozen`
/// slots stay where they are.
pub fn leave_out(
    layout: &Layout,
    values: &[f64],
    trials: &[Sums],
    settings: &[usize],
    groups: &[usize],
    frozen: &[usize],
) -> (Vec<f64>, Vec<DVector<f64>>) {
    let q = layout.slots.len();
    let mut held = vec![0.0; trials.len()];
    let mut moved = Vec::new();
    let count = groups.iter().max().map_or(0, |m| m + 1);
    let (mut gram, mut score) = (DMatrix::zeros(q, q), DVector::zeros(q));
    for t in trials {
        gram += &t.gram;
        score += &t.score;
    }
    for group in 0..count {
        let members: Vec<usize> = (0..trials.len()).filter(|i| groups[*i] == group).collect();
        let (mut a, mut b) = (gram.clone(), score.clone());
        for i in &members {
            a -= &trials[*i].gram;
            b -= &trials[*i].score;
        }
        // Slots that no other trial tells.
        let own: Vec<usize> = (0..q)
            .filter(|k| {
                layout.slots[*k]
                    .setting
                    .is_some_and(|s| (0..trials.len()).all(|i| settings[i] != s || groups[i] == group))
            })
            .collect();
        for k in &own {
            a.row_mut(*k).fill(0.0);
            a.column_mut(*k).fill(0.0);
            b[*k] = 0.0;
        }
        // Values at a bound that are pushed outwards stay.
        for k in 0..q {
            let [low, high] = layout.slots[k].bounds;
            if frozen.contains(&k) || (values[k] <= low && b[k] < 0.0) || (values[k] >= high && b[k] > 0.0) {
                a.row_mut(k).fill(0.0);
                a.column_mut(k).fill(0.0);
                b[k] = 0.0;
            }
        }
        for k in 0..q {
            a[(k, k)] += layout.slots[k].ridge();
        }
        let mut step = solve(&a, &b);
        let mut own_cost = 0.0;
        if !own.is_empty() {
            let (mut a_own, mut b_own) = (DMatrix::zeros(own.len(), own.len()), DVector::zeros(own.len()));
            for i in &members {
                let pushed = &trials[*i].score - &trials[*i].gram * &step;
                for (r, k) in own.iter().enumerate() {
                    b_own[r] += pushed[*k];
                    for (c, l) in own.iter().enumerate() {
                        a_own[(r, c)] += trials[*i].gram[(*k, *l)];
                    }
                }
            }
            let own_step = solve(&a_own, &b_own);
            own.iter().zip(own_step.iter()).for_each(|(k, s)| step[*k] = *s);
            own_cost = 2.0 * own.len() as f64;
        }
        for k in 0..q {
            let [low, high] = layout.slots[k].bounds;
            step[k] = (values[k] + step[k]).clamp(low, high) - values[k];
        }
        for i in &members {
            let t = &trials[*i];
            let loss = t.square - 2.0 * t.score.dot(&step) + (step.transpose() * &t.gram * &step)[(0, 0)];
            held[*i] = loss.max(0.0) + own_cost / members.len() as f64;
        }
        moved.push(step);
    }
    (held, moved)
}
