//! Judging a fitted model by trials, never by samples: errors within a trial may depend on each other in any way.
//!
//! Each trial is left out in turn and the parameters follow in one Newton step from the Gram matrices that the fit left
//! behind; that gives at once
//! - the jackknife covariance of the parameters (CR3), for intervals and Wald tests with F(p, G - p);
//! - the held-out loss of every trial: its own nuisances are fitted, everything else comes from the other trials.
//!
//! A quantity that only one trial tells (a per-setting parameter whose setting has one trial) is fitted to that trial
//! even when it is held out, and pays for it as Mallows' C_p says: 2 noise variances each.

use nalgebra::{DMatrix, DVector};

use super::model::{Layout, Pass, Slot, State, Sums, Term, What};
use super::stats::{f_above, inverse, mean_error, solve, t_above, t_quantile};
use crate::world::effect::Effect;

/// A model fitted to all trials, and what leaving out each says.
pub struct Fitted {
    /// The effects, in the layout's order.
    pub set: Vec<&'static Effect>,
    pub layout: Layout,
    pub state: State,
    pub pass: Pass,
    /// Held-out loss by trial, units of the noise.
    pub held: Vec<f64>,
    /// Jackknife covariance.
    pub covariance: DMatrix<f64>,
    /// The same with the parameters that only shape an effect held: under the hypothesis of no effect they mean
    /// nothing, so a test must not pay for not knowing them. It pays for their choice by counting the starts tried.
    given_shapes: DMatrix<f64>,
    /// Corrected p by term, filled in by the search.
    pub p_values: Vec<f64>,
}

impl Fitted {
    /// Judges a fit; `settings[i]` is the setting of trial i.
    pub fn new(layout: Layout, state: State, pass: Pass, settings: &[usize]) -> Fitted {
        let groups: Vec<usize> = (0..pass.trials.len()).collect();
        let left_out = |frozen: &[usize]| {
            let (held, moved) = leave_out(&layout, &state.values, &pass.trials, settings, &groups, frozen);
            (held, jackknife(&moved, layout.slots.len()))
        };
        let (held, covariance) = left_out(&[]);
        let shapes: Vec<usize> = (0..layout.slots.len()).filter(|i| layout.shapes(*i)).collect();
        let given_shapes = if shapes.is_empty() { covariance.clone() } else { left_out(&shapes).1 };
        let set = layout.terms.iter().map(|t| t.effect).collect();
        let p_values = vec![1.0; layout.terms.len()];
        Fitted { set, layout, state, pass, held, covariance, given_shapes, p_values }
    }

    /// Names, sorted.
    pub fn names(&self) -> Vec<&'static str> {
        let mut names: Vec<_> = self.set.iter().map(|e| e.name).collect();
        names.sort_unstable();
        names
    }

    /// This model with `more` terms: where they start, and the rest as it was fitted.
    pub fn joined(&self, more: impl IntoIterator<Item = Term>, settings: usize) -> (Layout, State) {
        let latents: Vec<usize> = self.layout.slots.iter().filter_map(Slot::latent).collect();
        let terms = self.layout.terms.iter().cloned().chain(more).collect();
        let layout = Layout::new(&latents, terms, settings);
        let mut values = layout.start(&[0.0; 3]);
        values[..self.state.values.len()].copy_from_slice(&self.state.values);
        (layout, State { values, nuisances: self.state.nuisances.clone() })
    }

    /// Number of effect parameters; one of many settings counts once for comparisons between models.
    pub fn parameters(&self) -> usize {
        self.layout.terms.iter().map(|t| t.free.iter().filter(|f| **f).count()).sum()
    }

    /// p of the hypothesis that a term's amplitudes are all nothing; not corrected for the search.
    pub fn p_value(&self, term: usize, settings: &[usize]) -> f64 {
        let amplitudes: Vec<usize> =
            self.layout.of_term(term).into_iter().filter(|i| !self.layout.shapes(*i)).collect();
        let value = |i: usize| match self.layout.slots[i].what {
            What::Parameter(t, p) => self.state.values[i] - self.layout.terms[t].effect.parameters[p].neutral,
            What::Latent(_) => 0.0,
        };
        if amplitudes.iter().all(|i| value(*i) == 0.0) {
            return 1.0;
        }
        let told_once = |i: &usize| {
            self.layout.slots[*i].setting.is_some_and(|s| settings.iter().filter(|o| **o == s).count() == 1)
        };
        if amplitudes.iter().all(told_once) {
            // One value a trial: do they agree on being something?
            let scores: Vec<f64> = amplitudes
                .iter()
                .map(|i| {
                    let owner = settings.iter().position(|s| Some(*s) == self.layout.slots[*i].setting);
                    let own = owner.map_or(0.0, |t| self.pass.trials[t].gram[(*i, *i)]);
                    (value(*i) * own.sqrt()).clamp(-30.0, 30.0)
                })
                .collect();
            let (mean, error) = mean_error(&scores);
            let t = mean.abs() / error.max(1e-12);
            return 2.0 * t_above(t, scores.len() as f64 - 1.0);
        }
        let p = amplitudes.len();
        let g = self.pass.trials.len() as f64;
        let theta = DVector::from_fn(p, |i, _| value(amplitudes[i]));
        let v = DMatrix::from_fn(p, p, |i, j| self.given_shapes[(amplitudes[i], amplitudes[j])]);
        let wald = (theta.transpose() * inverse(&v) * &theta)[(0, 0)];
        f_above(wald * (g - p as f64) / (p as f64 * (g - 1.0)), p as f64, g - p as f64)
    }

    /// Half the width of a slot's 95 % interval; infinite if the data do not tell the value. The wider of two: by what
    /// leaving out each trial changes, which few and unlike trials make too narrow, and by the noise's own size (`unit`
    /// is the variance of smooth things under it).
    pub fn half_width(&self, slot: usize, settings: &[usize], unit: f64) -> f64 {
        let told_by = match self.layout.slots[slot].setting {
            Some(s) => settings.iter().filter(|o| **o == s).count(),
            None => settings.len(),
        };
        let information: f64 = self.pass.trials.iter().map(|t| t.gram[(slot, slot)]).sum();
        if information <= 0.0 {
            return f64::INFINITY;
        }
        if told_by == 1 {
            // One trial: only the noise's own size can say.
            return 1.96 * (unit / information).sqrt();
        }
        let q = self.layout.slots.len();
        let mut gram = self.pass.trials.iter().fold(DMatrix::zeros(q, q), |sum, t| sum + &t.gram);
        (0..q).for_each(|k| gram[(k, k)] += self.layout.slots[k].ridge());
        let by_noise = 1.96 * (unit * inverse(&gram)[(slot, slot)]).max(0.0).sqrt();
        (t_quantile(0.05, told_by as f64 - 1.0) * self.covariance[(slot, slot)].sqrt()).max(by_noise)
    }
}

/// Covariance from the changes that leaving out each trial makes.
fn jackknife(moved: &[DVector<f64>], q: usize) -> DMatrix<f64> {
    let g = moved.len() as f64;
    let mean = moved.iter().fold(DVector::zeros(q), |a, m| a + m) / g;
    let mut covariance = DMatrix::zeros(q, q);
    for m in moved {
        let d = m - &mean;
        covariance += &d * d.transpose();
    }
    covariance * ((g - 1.0) / g)
}

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

/// Held-out loss of all trials, units of the noise.
pub fn held(fit: &Fitted) -> f64 {
    fit.held.iter().sum()
}

/// How a loss by trial compares with another: mean of `worse - better` and t of it.
pub fn paired(worse: &[f64], better: &[f64]) -> (f64, f64) {
    let gains: Vec<f64> = worse.iter().zip(better).map(|(a, b)| a - b).collect();
    let (mean, error) = mean_error(&gains);
    if mean == 0.0 { (0.0, 0.0) } else { (mean, mean / error.max(1e-300)) }
}

/// Wilcoxon's signed-rank statistic of `worse - better` as a normal deviate; 0 below eight trials. A few wild trials do
/// not sway it as they do a mean.
pub fn ranked(worse: &[f64], better: &[f64]) -> f64 {
    let mut gains: Vec<f64> = worse.iter().zip(better).map(|(a, b)| a - b).filter(|g| *g != 0.0).collect();
    let n = gains.len() as f64;
    if gains.len() < 8 {
        return 0.0;
    }
    gains.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
    let up: f64 = gains.iter().enumerate().filter(|(_, g)| **g > 0.0).map(|(i, _)| i as f64 + 1.0).sum();
    (up - n * (n + 1.0) / 4.0) / (n * (n + 1.0) * (2.0 * n + 1.0) / 24.0).sqrt()
}
