//! Sparse regression of the residual acceleration on simple functions, as terms that can be simulated.
//!
//! Each function of position, velocity and time is evaluated along the fitted trajectory, integrated twice,
//! and the segment's initial state projected out; position residuals are regressed on these responses by
//! forward selection (integral form of Schaeffer and McCalla 2017, which avoids differentiating noise). The
//! result initialises a fit like that of effects.

use std::f64::consts::PI;

use nalgebra::{DMatrix, DVector};

use crate::error::Result;
use crate::inference::data::noise::Noise;
use crate::inference::dynamics::KICK_DURATION;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::model::{self, ParameterLayout, SegmentData, Term};
use crate::inference::segment::{Observation, Segment, SegmentKind};
use crate::inference::selection::candidates::data_range;
use crate::inference::statistics::{pseudo_inverse, solve};
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
/// Periods of oscillations, as shares of the trials' duration.
const PERIODS: [f64; 3] = [2.0, 1.0, 0.5];
/// Number of candidate functions along both axes.
pub const FUNCTION_COUNT: usize = 2 * (POWERS.len() + 2 * PERIODS.len());
/// Maximum number of terms per axis.
const MAX_TERMS_PER_AXIS: usize = 3;
/// Minimum relative decrease of the residual square for a function to be selected.
const MIN_RELATIVE_DECREASE: f64 = 0.05;
/// Finite-difference step of an amplitude, as the largest acceleration that it causes, m/s^2.
const ACCELERATION_FD_STEP: f64 = 1e-2;
/// Ratio of residual square to noise above which another function is considered.
const MIN_EXCESS_RATIO: f64 = 1.2;

/// Terms for the residuals of `model` in flight, each with one free amplitude; empty without flights or if no
/// function is selected.
pub fn formula_terms(data: &SegmentData, model: &FittedModel, noise: &Noise) -> Result<Vec<Term>> {
    let segments = data.segments;
    let functions = candidate_functions(data_range(segments).duration);
    let paths = model::segment_states(data, &model.layout, &model.state)?;
    let at_segment = |w: usize| function_accelerations(&segments[w], &paths[w], &functions);
    let flights: Vec<(usize, Vec<Vec<f64>>)> = (0..segments.len())
        .filter(|w| segments[*w].kind == SegmentKind::Flight)
        .map(|w| (w, at_segment(w)))
        .collect();
    let largest = |k: usize| flights.iter().flat_map(|(_, f)| &f[k]).fold(0.0f64, |m, v| m.max(v.abs()));
    let mut terms = Vec::new();
    for axis in 0..2 {
        let (mut gram, mut score) =
            (DMatrix::zeros(functions.len(), functions.len()), DVector::zeros(functions.len()));
        let (mut total, mut count) = (0.0, 0);
        for (w, accelerations) in &flights {
            data.progress.check_stop()?;
            let (columns, r) = responses(&segments[*w], &model.evaluation.residuals[*w], axis, accelerations);
            gram += columns.tr_mul(&columns);
            score += columns.tr_mul(&r);
            total += r.norm_squared();
            // Position and velocity take two degrees of freedom.
            count += r.len().saturating_sub(2);
        }
        let floor = count as f64 * noise.sd * noise.sd;
        for (k, amplitude) in forward_selection(&gram, &score, total, floor) {
            let (effect, mut start) = functions[k].clone();
            let [low, high] = effect.parameters[axis].bounds;
            start[axis] = amplitude.clamp(low, high);
            let free = (0..start.len()).map(|p| p == axis).collect();
            let difference = Some(ACCELERATION_FD_STEP / largest(k).max(1e-9));
            terms.push(Term { effect, per_setting: false, start, free, fd_step: difference, bracket: None });
        }
    }
    Ok(terms)
}

/// Formula of the terms of a layout from `first` on, with fitted amplitudes.
pub fn formula(layout: &ParameterLayout, values: &[f64], first: usize) -> String {
    let mut axes = [String::new(), String::new()];
    for (t, term) in layout.terms.iter().enumerate().skip(first) {
        for parameter in layout.parameters_of_term(t) {
            let axis = usize::from(term.free[1]);
            let value = values[parameter];
            let digits = if value.abs() < 0.01 { format!("{value:+.2e}") } else { format!("{value:+.3}") };
            axes[axis] += &format!(" {digits} {}", function_text(term.effect, &term.start));
        }
    }
    let line = |(name, sum): (&str, &String)| (!sum.is_empty()).then(|| format!("{name} ={sum}"));
    ["ax", "ay"].into_iter().zip(&axes).filter_map(line).collect::<Vec<_>>().join("; ")
}

/// Candidate functions: effects with values for all but the amplitudes.
fn candidate_functions(duration: f64) -> Vec<(&'static Effect, Vec<f64>)> {
    let power = |powers: &[u8; 5]| {
        let values = [0.0; 2].into_iter().chain(powers.iter().map(|p| f64::from(*p)));
        (&monomial::EFFECT, values.collect())
    };
    let swings = PERIODS.iter().flat_map(|share| {
        [0.0, 0.5 * PI].map(|phase| (&gust::EFFECT, vec![0.0, 0.0, share * duration.max(1e-3), phase]))
    });
    POWERS.iter().map(power).chain(swings).collect()
}

/// Formula of a function without amplitude.
fn function_text(effect: &Effect, values: &[f64]) -> String {
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

/// Forward selection: (function, amplitude), best first.
fn forward_selection(gram: &DMatrix<f64>, score: &DVector<f64>, total: f64, floor: f64) -> Vec<(usize, f64)> {
    let within = |set: &[usize]| {
        let a = DMatrix::from_fn(set.len(), set.len(), |i, j| gram[(set[i], set[j])]);
        (a, DVector::from_fn(set.len(), |i, _| score[set[i]]))
    };
    let mut chosen: Vec<usize> = Vec::new();
    let mut left = total;
    while chosen.len() < MAX_TERMS_PER_AXIS && left > MIN_EXCESS_RATIO * floor {
        let with = |k: usize| {
            let (a, b) = within(&[chosen.as_slice(), &[k]].concat());
            total - b.dot(&(pseudo_inverse(&a) * &b))
        };
        let others = (0..score.len()).filter(|k| !chosen.contains(k)).map(|k| (k, with(k)));
        let Some((best, after)) = others.min_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        if left - after < MIN_RELATIVE_DECREASE * left {
            break;
        }
        chosen.push(best);
        left = after;
    }
    let (a, b) = within(&chosen);
    chosen.into_iter().zip(solve(&a, &b).iter().copied()).collect()
}

/// Accelerations of the functions with unit amplitude along a segment's trajectory, by function and
/// observation.
fn function_accelerations(
    segment: &Segment,
    path: &[[f64; 4]],
    functions: &[(&'static Effect, Vec<f64>)],
) -> Vec<Vec<f64>> {
    let around = SimulationContext { time_step: KICK_DURATION, gravity: segment.scene.gravity };
    let along = |(effect, values): &(&'static Effect, Vec<f64>)| {
        let EffectKind::Motion(law) = effect.kind else { return vec![0.0; path.len()] };
        let mut values = values.clone();
        values[0] = 1.0;
        let constants = law.constants(&values, &around);
        let acceleration = |(point, &[x, y, vx, vy]): (&Observation, &[f64; 4])| {
            let body = MotionState { time: segment.start + point.time, x, y, vx, vy, omega: 0.0 };
            (law.kick(&constants, body, KICK_DURATION)[0] - vx) / KICK_DURATION
        };
        segment.observations.iter().zip(path).map(acceleration).collect()
    };
    functions.iter().map(along).collect()
}

/// Position responses to accelerations, and the residual of a segment along an axis, both with the initial
/// state projected out.
fn responses(
    segment: &Segment,
    residual: &[f64],
    axis: usize,
    accelerations: &[Vec<f64>],
) -> (DMatrix<f64>, DVector<f64>) {
    let t: Vec<f64> = segment.observations.iter().map(|p| p.time).collect();
    let mut columns = DMatrix::zeros(t.len(), accelerations.len());
    for (k, accelerations) in accelerations.iter().enumerate() {
        let (mut speed, mut place) = (0.0, 0.0);
        for i in 1..t.len() {
            let dt = t[i] - t[i - 1];
            let a = 0.5 * (accelerations[i - 1] + accelerations[i]);
            place += speed * dt + 0.5 * a * dt * dt;
            speed += a * dt;
            columns[(i, k)] = place;
        }
    }
    let used: Vec<usize> = (0..t.len()).filter(|i| residual[2 * i + axis].is_finite()).collect();
    // A mean of several observations has their total weight.
    let weight = |i: usize| segment.observations[used[i]].weight.sqrt();
    let mut columns =
        DMatrix::from_fn(used.len(), accelerations.len(), |i, k| weight(i) * columns[(used[i], k)]);
    let mut r = DVector::from_fn(used.len(), |i, _| weight(i) * residual[2 * used[i] + axis]);
    let start = DMatrix::from_fn(used.len(), 2, |i, k| weight(i) * if k == 0 { 1.0 } else { t[used[i]] });
    let project = pseudo_inverse(&start.tr_mul(&start)) * start.transpose();
    columns -= &start * (&project * &columns);
    r -= &start * (&project * &r);
    (columns, r)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_have_distinct_formulas() {
        let all = candidate_functions(2.0);
        assert_eq!(2 * all.len(), FUNCTION_COUNT);
        let texts: Vec<String> = all.iter().map(|(e, v)| function_text(e, v)).collect();
        assert_eq!(texts[0], "m/s^2");
        assert_eq!(texts[7], "x y");
        assert_eq!(texts[11], "vy |v|^2");
        assert_eq!(texts[13], "cos(2 pi t / 4.000)");
        let mut unlike = texts.clone();
        unlike.sort_unstable();
        unlike.dedup();
        assert_eq!(unlike.len(), all.len());
    }

    /// Selects the two contributing columns of three, with their amplitudes.
    #[test]
    fn weak_functions_are_not_selected() {
        let rows: Vec<[f64; 3]> =
            (0..50).map(|i| f64::from(i) / 50.0).map(|t| [t, t * t, libm::sin(9.0 * t)]).collect();
        let y: Vec<f64> = rows.iter().map(|r| 2.0 * r[0] - 3.0 * r[2]).collect();
        let gram = DMatrix::from_fn(3, 3, |i, j| rows.iter().map(|r| r[i] * r[j]).sum());
        let score = DVector::from_fn(3, |i, _| rows.iter().zip(&y).map(|(r, y)| r[i] * y).sum());
        let total = y.iter().map(|y| y * y).sum();
        let mut found = forward_selection(&gram, &score, total, 1e-6);
        found.sort_by_key(|f| f.0);
        assert_eq!(found.iter().map(|f| f.0).collect::<Vec<_>>(), [0, 2], "{found:?}");
        assert!((found[0].1 - 2.0).abs() < 1e-6 && (found[1].1 + 3.0).abs() < 1e-6, "{found:?}");
        assert!(forward_selection(&gram, &score, total, total).is_empty());
    }
}
