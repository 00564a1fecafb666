//! A law for what no effect explains: the residual acceleration as a sparse sum of simple functions.
//!
//! Each function of position, velocity and time is taken along the fitted path, integrated twice, and the window's
//! start projected out; position residuals are regressed on the responses, one function at a time joining while it
//! takes a twentieth of what is left (Schaeffer and McCalla 2017, whose integral form spares differentiating noise).

use nalgebra::{DMatrix, DVector};

use super::judge::Fitted;
use super::noise::Noise;
use super::stats::{inverse, solve};
use super::window::{Kind, Window};

/// A function of time, position and velocity.
type Term = (&'static str, fn(&[f64; 5]) -> f64);

/// t, x, y, vx, vy.
const LIBRARY: [Term; 14] = [
    ("1", |_| 1.0),
    ("x", |s| s[1]),
    ("y", |s| s[2]),
    ("vx", |s| s[3]),
    ("vy", |s| s[4]),
    ("|v| vx", |s| s[3].hypot(s[4]) * s[3]),
    ("|v| vy", |s| s[3].hypot(s[4]) * s[4]),
    ("|v|^2 vx", |s| (s[3] * s[3] + s[4] * s[4]) * s[3]),
    ("|v|^2 vy", |s| (s[3] * s[3] + s[4] * s[4]) * s[4]),
    ("x^2", |s| s[1] * s[1]),
    ("y^2", |s| s[2] * s[2]),
    ("x y", |s| s[1] * s[2]),
    ("sin t", |s| libm::sin(s[0])),
    ("cos t", |s| libm::cos(s[0])),
];

/// Most functions for each axis.
const MOST: usize = 3;
/// Share of what is left that a function must take to join.
const WORTH: f64 = 0.05;

/// The law in words, with the share of the residual it explains; `None` without flights.
pub fn law(windows: &[Window], model: &Fitted, noise: &Noise, _trials: usize) -> Option<String> {
    let flights: Vec<usize> = (0..windows.len()).filter(|w| windows[*w].kind == Kind::Flight).collect();
    if flights.is_empty() {
        return None;
    }
    let mut parts = Vec::new();
    for axis in 0..2 {
        let mut rows: Vec<(DMatrix<f64>, DVector<f64>)> = Vec::new();
        for w in &flights {
            rows.push(responses(&windows[*w], &model.pass.residuals[*w], axis));
        }
        let q = LIBRARY.len();
        let (mut gram, mut score, mut total) = (DMatrix::zeros(q, q), DVector::zeros(q), 0.0);
        for (columns, r) in &rows {
            gram += columns.transpose() * columns;
            score += columns.transpose() * r;
            total += r.norm_squared();
        }
        let floor = rows.iter().map(|(_, r)| r.len() as f64).sum::<f64>() * noise.sd * noise.sd;
        let mut chosen: Vec<usize> = Vec::new();
        let mut left = total;
        while chosen.len() < MOST && left > 1.2 * floor {
            let with = |k: usize| {
                let mut set = chosen.clone();
                set.push(k);
                let a = DMatrix::from_fn(set.len(), set.len(), |i, j| gram[(set[i], set[j])]);
                let b = DVector::from_fn(set.len(), |i, _| score[set[i]]);
                total - b.dot(&(inverse(&a) * &b))
            };
            let best = (0..q).filter(|k| !chosen.contains(k)).min_by(|a, b| with(*a).total_cmp(&with(*b)))?;
            let after = with(best);
            if left - after < WORTH * left {
                break;
            }
            chosen.push(best);
            left = after;
        }
        if chosen.is_empty() {
            continue;
        }
        let a = DMatrix::from_fn(chosen.len(), chosen.len(), |i, j| gram[(chosen[i], chosen[j])]);
        let b = DVector::from_fn(chosen.len(), |i, _| score[chosen[i]]);
        let values = solve(&a, &b);
        let sum = chosen
            .iter()
            .zip(values.iter())
            .map(|(k, v)| format!("{v:+.3} {}", LIBRARY[*k].0))
            .collect::<Vec<_>>()
            .join(" ");
        let share = 100.0 * (total - left) / (total - floor).max(1e-300);
        parts.push(format!("a{} = {sum} (explains {:.0} %)", ["x", "y"][axis], share.clamp(0.0, 100.0)));
    }
    (!parts.is_empty()).then(|| parts.join("; "))
}

/// Doubly integrated functions along a window's path, and its residual, the start projected out of both.
fn responses(window: &Window, residual: &[f64], axis: usize) -> (DMatrix<f64>, DVector<f64>) {
    let n = window.points.len();
    let t: Vec<f64> = window.points.iter().map(|p| p.time).collect();
    // The path itself, less its noise: what was seen minus the residual.
    let at = |i: usize, a: usize| {
        let r = residual[2 * i + a];
        window.points[i].seen[a] - if r.is_finite() { r } else { 0.0 }
    };
    let velocity = |i: usize, a: usize| {
        let (j, k) = (i.saturating_sub(1), (i + 1).min(n - 1));
        (at(k, a) - at(j, a)) / (t[k] - t[j]).max(1e-12)
    };
    let mut columns = DMatrix::zeros(n, LIBRARY.len());
    for (k, (_, f)) in LIBRARY.iter().enumerate() {
        let (mut speed, mut place) = (0.0, 0.0);
        let value = |i: usize| f(&[window.start + t[i], at(i, 0), at(i, 1), velocity(i, 0), velocity(i, 1)]);
        for i in 1..n {
            let dt = t[i] - t[i - 1];
            let a = 0.5 * (value(i - 1) + value(i));
            place += speed * dt + 0.5 * a * dt * dt;
            speed += a * dt;
            columns[(i, k)] = place;
        }
    }
    let kept: Vec<usize> = (0..n).filter(|i| residual[2 * i + axis].is_finite()).collect();
    let mut columns = DMatrix::from_fn(kept.len(), LIBRARY.len(), |i, k| columns[(kept[i], k)]);
    let mut r = DVector::from_fn(kept.len(), |i, _| residual[2 * kept[i] + axis]);
    let start = DMatrix::from_fn(kept.len(), 2, |i, k| if k == 0 { 1.0 } else { t[kept[i]] });
    let project = inverse(&(start.transpose() * &start)) * start.transpose();
    columns -= &start * (&project * &columns);
    r -= &start * (&project * &r);
    (columns, r)
}
