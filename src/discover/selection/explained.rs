//! Share of the predictable misfit that a set of effects explains.
//!
//! With m0 the squared residuals of the base model, m1 of the set and m2 of the set beside a broad discrepancy field, starts
//! projected out, share = (m0 - m1) / (m0 - m2). The random accelerations of each trial are at their conditional modes. m2 is not taken below what noise and slow misfit leave. Trials weigh at most a multiple of the usual
//! one, and the bootstrap over trials gives the share's uncertainty.
//!
//! Source: coefficient of determination against pure error (Box and Draper 1987, 3.4); bootstrap: Rubin, Ann. Stat. 9 (1981) 130.

use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, Exp1};

use super::settings::SETTINGS;
use crate::discover::columns::Own;
use crate::discover::field;
use crate::discover::fit::{Fitted, Fitter};
use crate::discover::launch::Part;
use crate::discover::stats::median;
use crate::error::Result;
use crate::rng;

/// Multiple of the usual trial's squared residual of the base model beyond which a trial counts for no more.
const CLIP: f64 = 9.0;
/// Bootstrap draws.
const DRAWS: usize = 1000;
/// Excess of the base model over the floor, as a share of it, below which there is nothing to explain.
const MIN_EXCESS: f64 = 0.2;

/// Explained share with its bootstrap distribution.
#[derive(Clone, Copy, Debug)]
pub struct Explained {
    pub share: f64,
    /// Quantiles at the confidence of the settings and its complement: 5 % and 95 %.
    pub interval: [f64; 2],
}

/// The share that `model` explains of what each of some models with fewer effects leaves; `None` where one leaves no more than the
/// floor.
pub fn explained(
    fitter: &Fitter,
    fewer: &[&Fitted],
    model: &Fitted,
    seed: u64,
) -> Result<Vec<Option<Explained>>> {
    let Some((_, parts)) = fitter.parts(&model.layout, &model.state, &[])? else { return Ok(Vec::new()) };
    let own = residuals(model, &parts, None);
    let sd = fitter.context.as_ref().map_or(0.0, |c| c.discrepancy.broad * c.discrepancy.acceleration);
    let broad = field::broad(fitter, model, sd)?;
    let broad = broad.map_or_else(|| own.clone(), |(parts, step)| residuals(model, &parts, Some(&step)));
    let of = |base: &&Fitted| {
        let Some((_, parts)) = fitter.parts(&base.layout, &base.state, &[])? else { return Ok(None) };
        let none = residuals(base, &parts, None);
        Ok(share(&none, &own, &broad, &floor(fitter, base, &parts), seed))
    };
    fewer.iter().map(of).collect()
}

/// Explained share from squared residuals by trial: of the model with fewer effects (`none`), of the model (`own`), of the
/// model beside a broad field, and of noise alone (`floor`).
fn share(none: &[f64], own: &[f64], broad: &[f64], floor: &[f64], seed: u64) -> Option<Explained> {
    let weights = trial_weights(none);
    let gone: Vec<f64> = (0..none.len()).map(|i| weights[i] * (none[i] - own[i])).collect();
    let least = |i: usize| own[i].min(broad[i]).max(floor[i].min(none[i]));
    let all: Vec<f64> = (0..none.len()).map(|i| weights[i] * (none[i] - least(i))).collect();
    if none.iter().sum::<f64>() < (1.0 + MIN_EXCESS) * floor.iter().sum::<f64>() {
        return None;
    }
    let share = |weights: &[f64]| {
        let sum = |v: &[f64]| v.iter().zip(weights).map(|(v, w)| v * w).sum::<f64>();
        let all = sum(&all);
        if all > 0.0 { (sum(&gone) / all).clamp(0.0, 1.0) } else { 1.0 }
    };
    let mut stream = rng::stream(seed, "explained share");
    let mut draws: Vec<f64> = (0..DRAWS)
        .map(|_| share(&(0..gone.len()).map(|_| Exp1.sample(&mut stream)).collect::<Vec<f64>>()))
        .collect();
    draws.sort_by(f64::total_cmp);
    let at = |p: f64| draws[(p * (DRAWS - 1) as f64) as usize];
    Some(Explained {
        share: share(&vec![1.0; gone.len()]),
        interval: [at(1.0 - SETTINGS.confidence), at(SETTINGS.confidence)],
    })
}

/// Squared residuals by trial where the model stands, or after a step, with its own random effects at their modes.
fn residuals(model: &Fitted, parts: &[Part], step: Option<&DVector<f64>>) -> Vec<f64> {
    let count = parts.first().map_or(0, |p| p.blocks[0].columns.ncols());
    let here = DVector::zeros(count);
    let mut out = vec![0.0; model.held.len()];
    for part in parts {
        out[part.launch] += with_random_effects(model, part, step.unwrap_or(&here));
    }
    out
}

/// The share of the excess squared error on held-out trials that a model removes; `differ`: whether trials differ by random
/// accelerations, which then are at their conditional modes. `None` where the base model leaves no more than the floor.
pub fn held_out_gain(fitter: &Fitter, base: &Fitted, model: &Fitted, differ: bool) -> Result<Option<f64>> {
    let of = |m: &Fitted| fitter.parts(&m.layout, &m.state, &[]);
    let (Some((_, base_parts)), Some((_, parts))) = (of(base)?, of(model)?) else { return Ok(None) };
    let floor = floor(fitter, base, &base_parts).iter().sum::<f64>();
    let (before, after) = (held_out(base, &base_parts, differ), held_out(model, &parts, differ));
    let weights = trial_weights(&before);
    let sum = |v: &[f64]| v.iter().zip(&weights).map(|(v, w)| v * w).sum::<f64>();
    let (before, after) = (sum(&before), sum(&after));
    Ok((before > (1.0 + MIN_EXCESS) * floor).then(|| (before - after) / (before - floor)))
}

/// Weights of trials by what the base model leaves of them.
fn trial_weights(base: &[f64]) -> Vec<f64> {
    let most = CLIP * median(base);
    base.iter().map(|v| if *v > most { most / v } else { 1.0 }).collect()
}

/// Squared residuals by trial, the parameters as the other trials say.
fn held_out(model: &Fitted, parts: &[Part], differ: bool) -> Vec<f64> {
    let mut out = vec![0.0; model.held.len()];
    for part in parts {
        let step = &model.held_out_steps[part.launch];
        out[part.launch] +=
            if differ { with_random_effects(model, part, step) } else { part.square_at(step) };
    }
    out
}

/// Squared residual of a part with its random accelerations at their conditional modes.
fn with_random_effects(model: &Fitted, part: &Part, step: &DVector<f64>) -> f64 {
    let belongs = |own: &&Own| matches!(own, Own::Push(_));
    let alike: Vec<usize> = part.blocks.first().map_or(Vec::new(), |b| places(&b.alike_of, belongs));
    let own: Vec<Vec<usize>> = part.blocks.iter().map(|b| places(&b.kinds, belongs)).collect();
    let n = if part.differs { alike.len() + own.iter().map(Vec::len).sum::<usize>() } else { 0 };
    let (mut precision, mut score) = (DMatrix::identity(n, n), DVector::zeros(n));
    let mut columns: Vec<DMatrix<f64>> = Vec::new();
    let slow = model.components.slow;
    let mut first = alike.len();
    for (block, own) in part.blocks.iter().zip(&own) {
        let mut z = DMatrix::zeros(block.left.len(), n);
        let mut put = |at: usize, column: DVector<f64>| z.set_column(at, &column);
        if n > 0 {
            let scaled = |of: Own, column: DVector<f64>| column * model.components.of(of);
            for (k, c) in alike.iter().enumerate() {
                put(k, scaled(block.alike_of[*c], block.alike.column(*c).into_owned()));
            }
            for (k, c) in own.iter().enumerate() {
                put(first + k, scaled(block.kinds[*c], block.own.column(*c).into_owned()));
            }
            first += own.len();
        }
        let weights = block.slow.map(|s| (1.0 + slow * slow * s).recip());
        let weighed = DMatrix::from_fn(z.nrows(), n, |i, k| weights[i] * z[(i, k)]);
        precision += z.tr_mul(&weighed);
        score += weighed.tr_mul(&block.residual_at(step));
        columns.push(z);
    }
    let mode = precision.cholesky().map_or_else(|| DVector::zeros(n), |f| f.solve(&score));
    let left = part.blocks.iter().zip(&columns).map(|(block, z)| block.residual_at(step) - z * &mode);
    left.map(|left| left.norm_squared()).sum()
}

/// Places of some of the kinds.
fn places(kinds: &[Own], which: impl Fn(&&Own) -> bool) -> Vec<usize> {
    kinds.iter().enumerate().filter(|(_, own)| which(own)).map(|(k, _)| k).collect()
}

/// By trial: what noise and slow misfit leave of the base model, expected.
fn floor(fitter: &Fitter, base: &Fitted, parts: &[Part]) -> Vec<f64> {
    let mut out = vec![0.0; fitter.data.trials];
    let c = &base.components;
    for part in parts {
        for block in &part.blocks {
            let own = block.slow.iter().map(|s| 1.0 + c.slow * c.slow * s).sum::<f64>();
            out[part.launch] += own;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::selection::context;
    use crate::discover::thrown;

    /// The drag that balls were thrown with explains all of what the scene misses; no effect explains nothing.
    #[test]
    fn the_true_effect_explains_everything() {
        thrown::fitted(&[0.4; 8], &[], 11, |fitter, base| {
            thrown::fitted(&[0.4; 8], &["linear_drag"], 11, |_, model| {
                let own = Fitter { context: Some(context(fitter, base, &[]).unwrap()), ..fitter.clone() };
                let share = |m: &Fitted| explained(&own, &[base], m, 3).unwrap()[0].expect("a misfit");
                let (right, none) = (share(model), share(base));
                assert!(right.share > 0.98 && right.interval[0] > 0.95, "{right:?}");
                assert!(none.share < 0.1 && none.interval[1] < 0.2, "{none:?}");
            });
        });
    }
}
