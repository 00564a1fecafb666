//! Explained share: how much of the predictable misfit a set of effects accounts for, and how much of the error on held-out trials.
//!
//! With m0 the squared residuals of the base model, m1 of the set, and m2 of the set with a broad discrepancy
//! field, nuisances projected out, share = (m0 - m1) / (m0 - m2). The plausible shared discrepancy is the same
//! in all three, at its mode under the set: it is no law's error. So are the random effects of each trial (accelerations,
//! errors of impacts), at their conditional modes under the model with the field, so that between-trial variation is
//! not counted as misfit and does not absorb shared misfit; in a trial that they describe worse than none, none are
//! subtracted, since a field and random effects may cancel. m2 is bounded below by the expected
//! square of noise and trial discrepancy. Weights of trials are bounded, and the Bayesian bootstrap over
//! trials gives the uncertainty.
//!
//! Source: coefficient of determination against pure error (Box and Draper 1987, 3.4); bootstrap: Rubin, Ann. Stat. 9 (1981) 130.

use std::collections::HashMap;

use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, Exp1};

use super::settings::SETTINGS;
use crate::error::Result;
use crate::inference::field;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::groups::{Group, SegmentBlock};
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::mixed_model::random_design::RandomEffect;
use crate::inference::statistics::median;
use crate::progress::Progress;
use crate::rng;

/// Multiple of the median squared residual above which the weight of a trial decreases.
const MAX_TRIAL_WEIGHT_RATIO: f64 = 9.0;
/// Bootstrap draws.
const DRAWS: usize = 1000;
/// Minimum excess of the base model over the noise floor, as a share of it, for the share to be defined.
const MIN_EXCESS: f64 = 0.2;

/// Explained share with its bootstrap distribution.
#[derive(Clone, Copy, Debug)]
pub struct ExplainedShare {
    pub share: f64,
    /// 90 % interval: quantiles at 5 % and 95 %.
    pub interval: [f64; 2],
}

impl ExplainedShare {
    /// Whether the required share is not excluded.
    pub fn explains_enough(&self) -> bool {
        self.interval[1] >= SETTINGS.explained_share
    }
}

/// How much of the misfit a model accounts for.
pub struct Explanation {
    /// Share of the excess misfit of each simpler model; `None` where that model's misfit is no larger than the floor.
    pub shares: Vec<Option<ExplainedShare>>,
    /// Share of the excess squared error on held-out trials that the model removes, the smaller one of those with the shared
    /// discrepancy subtracted and counted as error; `None` where the base model leaves no more than the floor.
    pub gain: Option<f64>,
}

/// Compares `model` with simpler models (`fewer`), first the base model.
pub fn explanation(
    fitter: &ModelFitter,
    fewer: &[&FittedModel],
    model: &FittedModel,
    seed: u64,
) -> Result<Explanation> {
    let nothing = Explanation { shares: Vec::new(), gain: None };
    let displacements = discrepancy_mode(fitter, model);
    let Some(groups) = groups_without(fitter, model, displacements.as_deref())? else { return Ok(nothing) };
    let sd = fitter.context().map_or(0.0, |c| c.discrepancy.broad_ratio * c.discrepancy.acceleration);
    let current = |group: &Group| DVector::zeros(group.blocks[0].jacobian.ncols());
    let (modes, broad) = match field::fit_broad(fitter, model, &groups, sd)? {
        Some((groups, step)) => {
            let modes = random_modes(model, &groups, |_| step.clone(), fitter.data.progress)?;
            let left = squares_by_trial(model, &groups, &modes, |_| step.clone());
            (modes, Some(left))
        }
        None => (random_modes(model, &groups, current, fitter.data.progress)?, None),
    };
    let own = squares_by_trial(model, &groups, &modes, current);
    let mut out = nothing;
    for (k, base) in fewer.iter().enumerate() {
        let Some(simpler) = groups_without(fitter, base, displacements.as_deref())? else {
            out.shares.push(None);
            continue;
        };
        let (none, floor) =
            (squares_by_trial(base, &simpler, &modes, current), noise_floor(fitter, base, &simpler));
        out.shares.push(explained_share(&none, &own, broad.as_ref().unwrap_or(&own), &floor, seed));
        if k == 0 {
            let floor = floor.iter().sum();
            let subtracted = held_out_gain((base, &simpler), (model, &groups), &modes, floor);
            let as_error = match displacements {
                Some(_) => gain_of_predictions(fitter, base, model, &modes, floor)?,
                None => None,
            };
            out.gain = subtracted.into_iter().chain(as_error).min_by(f64::total_cmp);
        }
    }
    Ok(out)
}

/// Share of the excess squared error on held-out trials that a model removes, random effects subtracted; models with their groups.
fn held_out_gain(
    (base, simpler): (&FittedModel, &[Group]),
    (model, groups): (&FittedModel, &[Group]),
    modes: &Modes,
    floor: f64,
) -> Option<f64> {
    let squares = |m: &FittedModel, groups: &[Group]| {
        squares_by_trial(m, groups, modes, |group| m.held_out_steps[group.trial].clone())
    };
    removed_share(&squares(base, simpler), &squares(model, groups), floor)
}

/// The same with the shared discrepancy counted as error, since predictions are made without it.
fn gain_of_predictions(
    fitter: &ModelFitter,
    base: &FittedModel,
    model: &FittedModel,
    modes: &Modes,
    floor: f64,
) -> Result<Option<f64>> {
    let [simpler, groups] = [base, model].map(|m| groups_without(fitter, m, None));
    let (Some(simpler), Some(groups)) = (simpler?, groups?) else { return Ok(None) };
    Ok(held_out_gain((base, &simpler), (model, &groups), modes, floor))
}

/// Displacements of observations by the shared discrepancy at its mode under a model, by segment, two rows per observation, m;
/// `None` if the model was fitted without discrepancy.
fn discrepancy_mode(fitter: &ModelFitter, model: &FittedModel) -> Option<Vec<DMatrix<f64>>> {
    let (context, size) = (fitter.context()?, &model.discrepancy_mode);
    let own = |r: &DMatrix<f64>| DMatrix::from_column_slice(r.nrows(), 1, (r * size).as_slice());
    (!size.is_empty()).then(|| context.discrepancy.responses.iter().map(own).collect())
}

/// Groups of a model, displacements of observations subtracted from the residuals.
fn groups_without(
    fitter: &ModelFitter,
    model: &FittedModel,
    displacements: Option<&[DMatrix<f64>]>,
) -> Result<Option<Vec<Group>>> {
    let own = |w: usize| match displacements {
        Some(displacements) => displacements[w].clone(),
        None => DMatrix::zeros(2 * fitter.data.segments[w].observations.len(), 1),
    };
    let Some(mut groups) = fitter.groups_with_columns(&model.layout, &model.state, &own)? else {
        return Ok(None);
    };
    let parameters = model.layout.parameters.len();
    for block in groups.iter_mut().flat_map(|group| &mut group.blocks) {
        block.residual -= block.jacobian.column(parameters);
        block.jacobian = block.jacobian.columns(0, parameters).into_owned();
    }
    Ok(Some(groups))
}

/// Explained share from squared residuals by trial: of the simpler model (`none`), of the model (`own`), of
/// the model with a broad field, and of noise alone (`floor`).
fn explained_share(
    none: &[f64],
    own: &[f64],
    broad: &[f64],
    floor: &[f64],
    seed: u64,
) -> Option<ExplainedShare> {
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
    Some(ExplainedShare {
        share: share(&vec![1.0; gone.len()]),
        interval: [at(1.0 - SETTINGS.confidence), at(SETTINGS.confidence)],
    })
}

/// Share of the excess over the floor that a model removes.
fn removed_share(before: &[f64], after: &[f64], floor: f64) -> Option<f64> {
    let weights = trial_weights(before);
    let sum = |v: &[f64]| v.iter().zip(&weights).map(|(v, w)| v * w).sum::<f64>();
    let (before, after) = (sum(before), sum(after));
    (before > (1.0 + MIN_EXCESS) * floor).then(|| (before - after) / (before - floor))
}

/// Weights of trials by their squared residuals under the base model.
fn trial_weights(base: &[f64]) -> Vec<f64> {
    let most = MAX_TRIAL_WEIGHT_RATIO * median(base);
    base.iter().map(|v| if *v > most { most / v } else { 1.0 }).collect()
}

/// Random effects, in their standard deviations, by segment, whether they act on all of the trial, and column.
type Modes = HashMap<(usize, bool, usize), f64>;

/// Columns of a block's random effects but the scales, for one standard deviation: whether it acts on all segments of the trial,
/// its index among those, and the column.
fn random_columns<'a>(
    model: &'a FittedModel,
    block: &'a SegmentBlock,
) -> impl Iterator<Item = (bool, usize, DVector<f64>)> + 'a {
    let of = |kinds: &'a [RandomEffect], columns: &'a DMatrix<f64>, alike: bool| {
        let each = kinds.iter().zip(columns.column_iter()).enumerate();
        let used = each.filter(|(_, (kind, _))| **kind != RandomEffect::Scale);
        used.map(move |(k, (kind, column))| (alike, k, column * model.components.sd_of(*kind)))
    };
    of(&block.z_group_effects, &block.z_group, true).chain(of(
        &block.z_segment_effects,
        &block.z_segment,
        false,
    ))
}

/// Conditional modes of the random effects but the scales after a step of the parameters.
fn random_modes(
    model: &FittedModel,
    groups: &[Group],
    step: impl Fn(&Group) -> DVector<f64>,
    progress: &dyn Progress,
) -> Result<Modes> {
    let mut out = Modes::new();
    let slow = model.components.discrepancy;
    for group in groups.iter().filter(|p| p.has_random_effects) {
        progress.check_stop()?;
        // Unknowns: index of the column, and its segment if it is a segment-level effect.
        let mut unknowns: Vec<(usize, Option<usize>)> = Vec::new();
        let mut columns: Vec<(usize, usize, DVector<f64>)> = Vec::new();
        for (b, block) in group.blocks.iter().enumerate() {
            for (alike, k, column) in random_columns(model, block) {
                let unknown = (k, (!alike).then_some(block.segment));
                let at = unknowns.iter().position(|u| *u == unknown).unwrap_or(unknowns.len());
                if at == unknowns.len() {
                    unknowns.push(unknown);
                }
                columns.push((b, at, column));
            }
        }
        let n = unknowns.len();
        let (mut precision, mut score) = (DMatrix::identity(n, n), DVector::zeros(n));
        let step = step(group);
        for (b, block) in group.blocks.iter().enumerate() {
            let own: Vec<&(usize, usize, DVector<f64>)> = columns.iter().filter(|c| c.0 == b).collect();
            let all: Vec<DVector<f64>> =
                own.iter().map(|c| c.2.clone()).chain([block.residual_at(&step)]).collect();
            let (products, _) = block.products(&DMatrix::from_columns(&all), slow);
            for (k, (_, i, _)) in own.iter().enumerate() {
                score[*i] += products[(k, own.len())];
                own.iter().enumerate().for_each(|(l, (_, j, _))| precision[(*i, *j)] += products[(k, l)]);
            }
        }
        let Some(factor) = precision.cholesky() else { continue };
        let solved = factor.solve(&score);
        for (b, at, _) in &columns {
            let (k, own) = unknowns[*at];
            out.insert((group.blocks[*b].segment, own.is_none(), k), solved[*at]);
        }
    }
    Ok(out)
}

/// Squared residuals by trial after a step of the parameters, random effects subtracted unless the trial has less without.
fn squares_by_trial(
    model: &FittedModel,
    groups: &[Group],
    modes: &Modes,
    step: impl Fn(&Group) -> DVector<f64>,
) -> Vec<f64> {
    let mut sums = vec![[0.0; 2]; model.held_out_squares.len()];
    for group in groups {
        let step = step(group);
        for block in &group.blocks {
            let mut left = block.residual_at(&step);
            sums[group.trial][0] += left.norm_squared();
            for (alike, k, column) in random_columns(model, block) {
                let mode = modes.get(&(block.segment, alike, k)).copied().unwrap_or(0.0);
                left.axpy(-mode, &column, 1.0);
            }
            sums[group.trial][1] += left.norm_squared();
        }
    }
    sums.into_iter().map(|[without, with]| without.min(with)).collect()
}

/// Expected squares of noise and trial discrepancy, by trial.
fn noise_floor(fitter: &ModelFitter, base: &FittedModel, groups: &[Group]) -> Vec<f64> {
    let mut out = vec![0.0; fitter.data.trial_count];
    let c = &base.components;
    for group in groups {
        for block in &group.blocks {
            let free = |i: usize| 1.0 - block.nuisances.row(i).norm_squared();
            let variances = block.variances(c.discrepancy);
            out[group.trial] += variances.iter().enumerate().map(|(i, v)| free(i) * v).sum::<f64>();
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::selection::context;
    use crate::inference::testing::throws;

    /// The true drag explains all of the misfit; no effect explains nothing.
    #[test]
    fn the_true_effect_explains_everything() {
        throws::with_fit(&[0.4; 8], &[], 11, |fitter, base| {
            throws::with_fit(&[0.4; 8], &["linear_drag"], 11, |_, model| {
                let own = fitter.clone().with_context(context(fitter, base, &[]).unwrap());
                let share =
                    |m: &FittedModel| explanation(&own, &[base], m, 3).unwrap().shares[0].expect("a misfit");
                let (right, none) = (share(model), share(base));
                assert!(right.share > 0.98 && right.interval[0] > 0.95, "{right:?}");
                assert!(none.share < 0.1 && none.interval[1] < 0.2, "{none:?}");
            });
        });
    }
}
