//! Conditional modes of the random effects.
//!
//! Random effects act nonlinearly: the lift of one trial bends its trajectory by centimetres in second order,
//! and the mean of such terms over trials looks like a shared effect. Every segment is therefore linearized
//! at the conditional modes of its trial, which are updated until convergence.
//!
//! For the residual r of a trial, random-effect columns Z with variances T^2 and remaining covariance D, the
//! mode is (Z'D^-1 Z + T^-2)^-1 Z'D^-1 r.
//!
//! Source: Lindstrom and Bates, Biometrics 46 (1990) 673.
//!
//! Differences from the source: impact errors and the trial discrepancy have no mode, since they act
//! linearly.

use nalgebra::{DMatrix, DVector};

use crate::inference::mixed_model::group_statistics::VarianceComponents;
use crate::inference::mixed_model::groups::Group;
use crate::inference::mixed_model::random_design::{RandomDesign, RandomEffect};
use crate::inference::model::{Perturbation, RandomEffects};

/// Conditional modes for `segments` segments after a step of the parameters. `accelerations`: random accelerations in
/// the order of their columns.
pub fn conditional_modes(
    groups: &[Group],
    columns: &RandomDesign,
    accelerations: &[Perturbation],
    components: &VarianceComponents,
    step: &DVector<f64>,
    segments: usize,
) -> Vec<RandomEffects> {
    let like_others = || RandomEffects {
        deviations: vec![0.0; columns.parameter_count],
        accelerations: accelerations.iter().map(|acceleration| (acceleration.clone(), 0.0)).collect(),
    };
    let mut out: Vec<RandomEffects> = (0..segments).map(|_| like_others()).collect();
    for group in groups.iter().filter(|group| group.has_random_effects) {
        let all = random_terms(group, columns, components);
        let Some(amounts) = solve_modes(group, &all, components.discrepancy, step) else { continue };
        for (what, amount) in all.iter().zip(amounts.iter()) {
            let blocks =
                group.blocks.iter().enumerate().filter(|(b, _)| what.block.is_none_or(|own| own == *b));
            for (column, times) in &what.parameter_effects {
                for mode in blocks.clone().map(|(_, block)| block.segment) {
                    match column.checked_sub(columns.parameter_count) {
                        None => out[mode].deviations[*column] += times * amount,
                        Some(acceleration) => out[mode].accelerations[acceleration].1 += times * amount,
                    }
                }
            }
        }
    }
    out
}

/// A random effect of a group.
struct RandomTerm {
    /// Its block; all of the group if `None`.
    block: Option<usize>,
    /// Its design column.
    column: DesignColumn,
    sd: f64,
    /// The model's columns (parameters, then accelerations) on which it acts, with coefficients.
    parameter_effects: Vec<(usize, f64)>,
}

#[derive(Clone, Copy)]
enum DesignColumn {
    Group(usize),
    Segment(usize),
}

fn random_terms(group: &Group, columns: &RandomDesign, components: &VarianceComponents) -> Vec<RandomTerm> {
    let acceleration = |place: usize| {
        let at = columns.accelerations.iter().position(|(own, _)| *own == place);
        at.map(|k| (columns.parameter_count + k, 1.0)).into_iter().collect::<Vec<_>>()
    };
    let mut strengths = columns.amplitude_directions.iter();
    let mut moves = |own: RandomEffect| match own {
        RandomEffect::Acceleration(place) => acceleration(place),
        RandomEffect::Scale => strengths.next().cloned().unwrap_or_default(),
        RandomEffect::ContactReset(k) => vec![columns.contact_resets[k]],
        RandomEffect::ImpactNoise => Vec::new(),
    };
    let mut all: Vec<RandomTerm> = Vec::new();
    for (k, own) in group.blocks.first().map_or(&[][..], |b| &b.z_group_effects).iter().enumerate() {
        all.push(RandomTerm {
            block: None,
            column: DesignColumn::Group(k),
            sd: components.sd_of(*own),
            parameter_effects: moves(*own),
        });
    }
    for (b, block) in group.blocks.iter().enumerate() {
        for (k, own) in block.z_segment_effects.iter().enumerate() {
            let (column, sd) = (DesignColumn::Segment(k), components.sd_of(*own));
            all.push(RandomTerm { block: Some(b), column, sd, parameter_effects: moves(*own) });
        }
    }
    all.retain(|d| d.sd > 0.0);
    all
}

/// Conditional modes; `None` if the system is singular.
fn solve_modes(group: &Group, all: &[RandomTerm], slow: f64, step: &DVector<f64>) -> Option<DVector<f64>> {
    let n = all.len();
    let mut precision = DMatrix::from_diagonal(&DVector::from_fn(n, |k, _| all[k].sd.powi(-2)));
    let mut score = DVector::zeros(n);
    for (b, block) in group.blocks.iter().enumerate() {
        let left = block.residual_at(step);
        let column = |d: &RandomTerm, i: usize| match (d.block.is_none_or(|own| own == b), d.column) {
            (false, _) => 0.0,
            (_, DesignColumn::Group(k)) => block.z_group[(i, k)],
            (_, DesignColumn::Segment(k)) => block.z_segment[(i, k)],
        };
        let columns =
            DMatrix::from_fn(left.len(), n + 1, |i, k| if k < n { column(&all[k], i) } else { left[i] });
        let (products, _) = block.products(&columns, slow);
        precision += products.view((0, 0), (n, n));
        score += products.view((0, n), (n, 1)).column(0);
    }
    Some(precision.cholesky()?.solve(&score))
}

#[cfg(test)]
mod tests {
    use crate::inference::testing::{segments, throws};

    /// The modes recover the drag of each trial.
    #[test]
    fn modes_recover_trial_values() {
        let drags = [0.34, 0.46, 0.37, 0.44, 0.4, 0.42, 0.38, 0.41];
        throws::with_fit(&drags, &["linear_drag"], 6, |_, f| {
            assert_eq!(f.state.random_effects.len(), 8);
            for (w, drag) in drags.iter().enumerate() {
                let own = f.state.values_in(w)[0];
                assert!((own - drag).abs() < 0.015, "{own} for {drag}");
                assert_eq!(f.state.random_effects[w].accelerations.len(), f.components.accelerations.len());
            }
        });
    }

    /// A fit that has not converged does not get more evidence than its likelihood allows.
    #[test]
    fn unconverged_fits_gain_no_evidence() {
        let (_, fits, _) = segments::fitted_models(&[&["wind"], &["gust"], &["position_field"]]);
        for f in fits {
            let current = nalgebra::DVector::zeros(f.layout.parameters.len());
            let fitted: f64 = f.group_statistics.iter().map(|t| t.log_density_after(&current)).sum();
            assert!(f.log_evidence < fitted + 2.0, "{:?}: {} and {fitted}", f.effect_names(), f.log_evidence);
        }
    }
}
