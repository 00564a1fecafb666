//! A law for what no effect explains: the residual acceleration as a sparse sum of simple functions, as terms that any
//! world can simulate.
//!
//! Each function of position, velocity and time is taken along the fitted path, integrated twice, and the window's
//! start projected out; position residuals are regressed on the responses, one function at a time joining while it
//! takes a twentieth of what is left (Schaeffer and McCalla 2017, whose integral form spares differentiating noise).
//! What is found this way is only where a fit starts from: the terms are then fitted and held out as effects are.

use std::f64::consts::PI;

use nalgebra::{DMatrix, DVector};

use super::fit::Fitted;
use super::library::span;
use super::model::{self, Data, Layout, Term};
use super::noise::Noise;
use super::path::INSTANT;
use super::stats::{inverse, solve};
use super::window::{Kind, Point, Window};
use crate::error::Result;
use crate::world::effect::{Effect, EffectKind, MotionState, SimulationContext, gust, monomial};

/// Powers of x, y, vx, vy and |v|.
pub const POWERS: [[u8; 5]; 12] = [
    [0, 0, 0, 0, 0],
    [1, 0, 0, 0, 0],
    [0, 1, 0, 0, 0],
    [0, 0, 1, 0, 0],
    [0, 0, 0, 1, 0],
    [2, 0, 0, 0, 0],
    [0, 2, 0, 0, 0],
    [1, 1, 0, 0, 0],
    [0, 0, 1, 0, 1],
    [0, 0, 0, 1, 1],
    [0, 0, 1, 0, 2],
    [0, 0, 0, 1, 2],
];
/// Periods of what swings with time, as shares of how long trials last.
const PERIODS: [f64; 3] = [2.0, 1.0, 0.5];
/// How many functions there are to choose from, along both axes.
pub const FUNCTIONS: usize = 2 * (POWERS.len() + 2 * PERIODS.len());
/// Most functions for each axis.
const MOST: usize = 3;
/// Share of what is left that a function must take to join.
const WORTH: f64 = 0.05;
/// Acceleration by which an amplitude is moved for a derivative, where its function is largest, m/s^2.
const NUDGE: f64 = 1e-2;
/// How far above the noise floor a residual must be for another function to be looked for.
const ABOVE: f64 = 1.2;

/// Terms for what `model` leaves in flight, the amplitude along one axis free in each; none without flights, or where no
/// function takes enough.
pub fn law(data: &Data, model: &Fitted, noise: &Noise) -> Result<Vec<Term>> {
    let windows = data.windows;
    let functions = functions(span(windows).duration);
    let paths = model::paths(data, &model.layout, &model.state)?;
    let pushes = |w: usize| pushes(&windows[w], &paths[w], &functions);
    let flights: Vec<(usize, Vec<Vec<f64>>)> =
        (0..windows.len()).filter(|w| windows[*w].kind == Kind::Flight).map(|w| (w, pushes(w))).collect();
    let largest = |k: usize| flights.iter().flat_map(|(_, f)| &f[k]).fold(0.0f64, |m, v| m.max(v.abs()));
    let mut terms = Vec::new();
    for axis in 0..2 {
        let (mut gram, mut score) =
            (DMatrix::zeros(functions.len(), functions.len()), DVector::zeros(functions.len()));
        let (mut total, mut count) = (0.0, 0);
        for (w, pushes) in &flights {
            data.progress.check_stop()?;
            let (columns, r) = responses(&windows[*w], &model.pass.residuals[*w], axis, pushes);
            gram += columns.tr_mul(&columns);
            score += columns.tr_mul(&r);
            total += r.norm_squared();
            // The start takes up two of them.
            count += r.len().saturating_sub(2);
        }
        let floor = count as f64 * noise.sd * noise.sd;
        for (k, amplitude) in sparse(&gram, &score, total, floor) {
            let (effect, mut start) = functions[k].clone();
            let [low, high] = effect.parameters[axis].bounds;
            start[axis] = amplitude.clamp(low, high);
            let free = (0..start.len()).map(|p| p == axis).collect();
            let difference = Some(NUDGE / largest(k).max(1e-9));
            terms.push(Term { effect, per_setting: false, start, free, difference });
        }
    }
    Ok(terms)
}

/// A law in words: the terms of a layout from `first` on, with their fitted amplitudes.
pub fn formula(layout: &Layout, values: &[f64], first: usize) -> String {
    let mut axes = [String::new(), String::new()];
    for (t, term) in layout.terms.iter().enumerate().skip(first) {
        for slot in layout.of_term(t) {
            let axis = usize::from(term.free[1]);
            let value = values[slot];
            let digits = if value.abs() < 0.01 { format!("{value:+.2e}") } else { format!("{value:+.3}") };
            axes[axis] += &format!(" {digits} {}", text(term.effect, &term.start));
        }
    }
    let line = |(name, sum): (&str, &String)| (!sum.is_empty()).then(|| format!("{name} ={sum}"));
    ["ax", "ay"].into_iter().zip(&axes).filter_map(line).collect::<Vec<_>>().join("; ")
}

/// What functions there are: effects with everything but their amplitudes given.
fn functions(duration: f64) -> Vec<(&'static Effect, Vec<f64>)> {
    let power = |powers: &[u8; 5]| {
        let values = [0.0; 2].into_iter().chain(powers.iter().map(|p| f64::from(*p)));
        (&monomial::EFFECT, values.collect())
    };
    let swings = PERIODS.iter().flat_map(|share| {
        [0.0, 0.5 * PI].map(|phase| (&gust::EFFECT, vec![0.0, 0.0, share * duration.max(1e-3), phase]))
    });
    POWERS.iter().map(power).chain(swings).collect()
}

/// A function without its amplitude.
fn text(effect: &Effect, values: &[f64]) -> String {
    match *values {
        [_, _, period, phase] if effect.name == gust::EFFECT.name => {
            let function = if phase == 0.0 { "sin" } else { "cos" };
            format!("{function}(2 pi t / {period:.3})")
        }
        [_, _, ref powers @ ..] => {
            let factor = |(base, power): (&str, &f64)| match *power as u32 {
                0 => None,
                1 => Some(base.to_string()),
                n => Some(format!("{base}^{n}")),
            };
            let factors: Vec<String> =
                ["x", "y", "vx", "vy", "|v|"].into_iter().zip(powers).filter_map(factor).collect();
            if factors.is_empty() { "m/s^2".into() } else { factors.join(" ") }
        }
        _ => String::new(),
    }
}

/// (function, amplitude) of those that join, best first, from the sums of a regression.
fn sparse(gram: &DMatrix<f64>, score: &DVector<f64>, total: f64, floor: f64) -> Vec<(usize, f64)> {
    let within = |set: &[usize]| {
        let a = DMatrix::from_fn(set.len(), set.len(), |i, j| gram[(set[i], set[j])]);
        (a, DVector::from_fn(set.len(), |i, _| score[set[i]]))
    };
    let mut chosen: Vec<usize> = Vec::new();
    let mut left = total;
    while chosen.len() < MOST && left > ABOVE * floor {
        let with = |k: usize| {
            let (a, b) = within(&[chosen.as_slice(), &[k]].concat());
            total - b.dot(&(inverse(&a) * &b))
        };
        let others = (0..score.len()).filter(|k| !chosen.contains(k)).map(|k| (k, with(k)));
        let Some((best, after)) = others.min_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        if left - after < WORTH * left {
            break;
        }
        chosen.push(best);
        left = after;
    }
    let (a, b) = within(&chosen);
    chosen.into_iter().zip(solve(&a, &b).iter().copied()).collect()
}

/// The functions along a window's path (x, y, vx, vy by point), each with an amplitude of 1: by function, then by point.
fn pushes(window: &Window, path: &[[f64; 4]], functions: &[(&'static Effect, Vec<f64>)]) -> Vec<Vec<f64>> {
    let around = SimulationContext { time_step: INSTANT, gravity: window.scene.gravity };
    let along = |(effect, values): &(&'static Effect, Vec<f64>)| {
        let EffectKind::Motion(law) = effect.kind else { return vec![0.0; path.len()] };
        let mut values = values.clone();
        values[0] = 1.0;
        let constants = law.constants(&values, &around);
        let push = |(point, &[x, y, vx, vy]): (&Point, &[f64; 4])| {
            let body = MotionState { time: window.start + point.time, x, y, vx, vy, omega: 0.0 };
            (law.kick(&constants, body, INSTANT)[0] - vx) / INSTANT
        };
        window.points.iter().zip(path).map(push).collect()
    };
    functions.iter().map(along).collect()
}

/// Pushes integrated twice along a window, and its residual, the start projected out of both.
fn responses(
    window: &Window,
    residual: &[f64],
    axis: usize,
    pushes: &[Vec<f64>],
) -> (DMatrix<f64>, DVector<f64>) {
    let t: Vec<f64> = window.points.iter().map(|p| p.time).collect();
    let mut columns = DMatrix::zeros(t.len(), pushes.len());
    for (k, pushes) in pushes.iter().enumerate() {
        let (mut speed, mut place) = (0.0, 0.0);
        for i in 1..t.len() {
            let dt = t[i] - t[i - 1];
            let a = 0.5 * (pushes[i - 1] + pushes[i]);
            place += speed * dt + 0.5 * a * dt * dt;
            speed += a * dt;
            columns[(i, k)] = place;
        }
    }
    let kept: Vec<usize> = (0..t.len()).filter(|i| residual[2 * i + axis].is_finite()).collect();
    // A mean of several observations counts as they do.
    let weight = |i: usize| window.points[kept[i]].weight.sqrt();
    let mut columns = DMatrix::from_fn(kept.len(), pushes.len(), |i, k| weight(i) * columns[(kept[i], k)]);
    let mut r = DVector::from_fn(kept.len(), |i, _| weight(i) * residual[2 * kept[i] + axis]);
    let start = DMatrix::from_fn(kept.len(), 2, |i, k| weight(i) * if k == 0 { 1.0 } else { t[kept[i]] });
    let project = inverse(&start.tr_mul(&start)) * start.transpose();
    columns -= &start * (&project * &columns);
    r -= &start * (&project * &r);
    (columns, r)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_read_as_what_they_are() {
        let all = functions(2.0);
        assert_eq!(2 * all.len(), FUNCTIONS);
        let texts: Vec<String> = all.iter().map(|(e, v)| text(e, v)).collect();
        assert_eq!(texts[0], "m/s^2");
        assert_eq!(texts[7], "x y");
        assert_eq!(texts[11], "vy |v|^2");
        assert_eq!(texts[13], "cos(2 pi t / 4.000)");
        let mut unlike = texts.clone();
        unlike.sort_unstable();
        unlike.dedup();
        assert_eq!(unlike.len(), all.len());
    }

    /// Of three columns the two that make the sum up are found with their amplitudes, whatever the third correlates with.
    #[test]
    fn what_takes_little_does_not_join() {
        let rows: Vec<[f64; 3]> =
            (0..50).map(|i| f64::from(i) / 50.0).map(|t| [t, t * t, libm::sin(9.0 * t)]).collect();
        let y: Vec<f64> = rows.iter().map(|r| 2.0 * r[0] - 3.0 * r[2]).collect();
        let gram = DMatrix::from_fn(3, 3, |i, j| rows.iter().map(|r| r[i] * r[j]).sum());
        let score = DVector::from_fn(3, |i, _| rows.iter().zip(&y).map(|(r, y)| r[i] * y).sum());
        let total = y.iter().map(|y| y * y).sum();
        let mut found = sparse(&gram, &score, total, 1e-6);
        found.sort_by_key(|f| f.0);
        assert_eq!(found.iter().map(|f| f.0).collect::<Vec<_>>(), [0, 2], "{found:?}");
        assert!((found[0].1 - 2.0).abs() < 1e-6 && (found[1].1 + 3.0).abs() < 1e-6, "{found:?}");
        assert!(sparse(&gram, &score, total, total).is_empty());
    }
}
