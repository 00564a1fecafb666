//! How each launch is unlike the others: the mode of everything that differs from launch to launch.
//!
//! A model is linear about where it stands; but a lift that only one launch has bends its path by centimetres in second order,
//! and so do all launches' on the mean, whatever the sign, which looks like something that they share. So every window is made
//! linear about its own launch's mode, and the modes are found anew from there, until they stay.
//!
//! With what the launch leaves r, the columns Z of what differs, its variances T^2 and the rest of the covariance D, the mode
//! is (Z'D^-1 Z + T^-2)^-1 Z'D^-1 r.
//!
//! Source: Lindstrom and Bates, Biometrics 46 (1990) 673.
//!
//! Differences from the source: errors of contacts have no mode, which act in first order alone; the slow misfit has none,
//! being no part of a path.

use nalgebra::{DMatrix, DVector};

use super::columns::{RandomDesign, RandomEffect};
use super::gaussian::VarianceComponents;
use super::launch::Group;
use super::model::{Perturbation, RandomEffects};

/// Modes of `windows` windows, the slots having moved by `step`. `pushes`: those beside the model, in the order of its columns.
pub fn conditional_modes(
    parts: &[Group],
    columns: &RandomDesign,
    pushes: &[Perturbation],
    components: &VarianceComponents,
    step: &DVector<f64>,
    windows: usize,
) -> Vec<RandomEffects> {
    let like_others = || RandomEffects {
        deviations: vec![0.0; columns.parameter_count],
        accelerations: pushes.iter().map(|push| (push.clone(), 0.0)).collect(),
    };
    let mut out: Vec<RandomEffects> = (0..windows).map(|_| like_others()).collect();
    for part in parts.iter().filter(|part| part.has_random_effects) {
        let all = random_terms(part, columns, components);
        let Some(amounts) = solve_modes(part, &all, components.discrepancy, step) else { continue };
        for (what, amount) in all.iter().zip(amounts.iter()) {
            let blocks =
                part.blocks.iter().enumerate().filter(|(b, _)| what.block.is_none_or(|own| own == *b));
            for (column, times) in &what.parameter_effects {
                for mode in blocks.clone().map(|(_, block)| block.segment) {
                    match column.checked_sub(columns.parameter_count) {
                        None => out[mode].deviations[*column] += times * amount,
                        Some(push) => out[mode].accelerations[push].1 += times * amount,
                    }
                }
            }
        }
    }
    out
}

/// Something that differs from launch to launch.
struct RandomTerm {
    /// The block that it is of; none: all of its launch.
    block: Option<usize>,
    /// Its column in that block, or in all.
    column: DesignColumn,
    sd: f64,
    /// Which of the model's columns, slots and then pushes, it moves, and how much of each.
    parameter_effects: Vec<(usize, f64)>,
}

#[derive(Clone, Copy)]
enum DesignColumn {
    Group(usize),
    Segment(usize),
}

fn random_terms(part: &Group, columns: &RandomDesign, components: &VarianceComponents) -> Vec<RandomTerm> {
    let push = |place: usize| {
        let at = columns.accelerations.iter().position(|(own, _)| *own == place);
        at.map(|k| (columns.parameter_count + k, 1.0)).into_iter().collect::<Vec<_>>()
    };
    let mut strengths = columns.amplitude_directions.iter();
    let mut moves = |own: RandomEffect| match own {
        RandomEffect::Acceleration(place) => push(place),
        RandomEffect::Scale => strengths.next().cloned().unwrap_or_default(),
        RandomEffect::ContactReset(k) => vec![columns.contact_resets[k]],
        RandomEffect::ImpactNoise => Vec::new(),
    };
    let mut all: Vec<RandomTerm> = Vec::new();
    for (k, own) in part.blocks.first().map_or(&[][..], |b| &b.z_group_effects).iter().enumerate() {
        all.push(RandomTerm {
            block: None,
            column: DesignColumn::Group(k),
            sd: components.sd_of(*own),
            parameter_effects: moves(*own),
        });
    }
    for (b, block) in part.blocks.iter().enumerate() {
        for (k, own) in block.z_segment_effects.iter().enumerate() {
            let (column, sd) = (DesignColumn::Segment(k), components.sd_of(*own));
            all.push(RandomTerm { block: Some(b), column, sd, parameter_effects: moves(*own) });
        }
    }
    all.retain(|d| d.sd > 0.0);
    all
}

/// How much there is of each; `None` where that cannot be told.
fn solve_modes(part: &Group, all: &[RandomTerm], slow: f64, step: &DVector<f64>) -> Option<DVector<f64>> {
    let n = all.len();
    let mut precision = DMatrix::from_diagonal(&DVector::from_fn(n, |k, _| all[k].sd.powi(-2)));
    let mut score = DVector::zeros(n);
    for (b, block) in part.blocks.iter().enumerate() {
        let root = block.gp_variance.map(|s| (1.0 + slow * slow * s).sqrt().recip());
        let left = (&block.residual - &block.jacobian * step).component_mul(&root);
        let column = |d: &RandomTerm, i: usize| match (d.block.is_none_or(|own| own == b), d.column) {
            (false, _) => 0.0,
            (_, DesignColumn::Group(k)) => block.z_group[(i, k)],
            (_, DesignColumn::Segment(k)) => block.z_segment[(i, k)],
        };
        let z = DMatrix::from_fn(left.len(), n, |i, k| root[i] * column(&all[k], i));
        precision += z.tr_mul(&z);
        score += z.tr_mul(&left);
    }
    Some(precision.cholesky()?.solve(&score))
}

#[cfg(test)]
mod tests {
    use crate::discover::{fixture, thrown};

    /// Every launch is at its own drag: as far from the mean as it was thrown with.
    #[test]
    fn a_mode_is_a_launch_s_own_size() {
        let drags = [0.34, 0.46, 0.37, 0.44, 0.4, 0.42, 0.38, 0.41];
        thrown::with_fit(&drags, &["linear_drag"], 6, |_, f| {
            assert_eq!(f.state.random_effects.len(), 8);
            for (w, drag) in drags.iter().enumerate() {
                let own = f.state.values_in(w)[0];
                assert!((own - drag).abs() < 0.015, "{own} for {drag}");
                assert_eq!(f.state.random_effects[w].accelerations.len(), f.components.accelerations.len());
            }
        });
    }

    /// Weaker gravity looks like a gust without end: the evidence of a fit that has not converged is no better than the fit.
    #[test]
    fn evidence_is_no_better_than_the_fit() {
        let (_, fits, _) = fixture::fitted_models(&[&["wind"], &["gust"], &["position_field"]]);
        for f in fits {
            let here = nalgebra::DVector::zeros(f.layout.parameters.len());
            let fitted: f64 = f.group_statistics.iter().map(|t| t.log_density_after(&here)).sum();
            assert!(f.log_evidence < fitted + 2.0, "{:?}: {} and {fitted}", f.effect_names(), f.log_evidence);
        }
    }
}
