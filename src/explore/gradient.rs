//! `gradient`: allocates actions to the latents by the gradient of the task's performance (partial grounding).
//!
//! Source: Semage et al., algorithm 2: with P the performance surface of a related, known environment, the
//! absolute partial derivatives of P at the current estimate determine the shares of the N actions from the
//! collisions group, |dP/d restitution|, and the rolling group, |dP/d friction|. In each group the actions are
//! ranked by simulation at the current estimate.
//!
//! Differences from the source:
//! - The magnitudes are averaged over the estimate and the four corners estimate +- sd of the search. At the
//!   maximum of the surface the derivatives vanish and their ratio is noise, although the estimate may still be
//!   one standard deviation away. Once the search has converged the corners coincide and the rule is the
//!   source's.
//! - Derivatives are per unit of a coefficient, not per prior standard deviation: both coefficients are of
//!   order one. The strategy `informative` weights by what is at stake.
//! - Where the source is silent: the sign is ignored. Shares are rounded by largest remainders, ties in favour
//!   of collisions. An action that both groups rank next is selected once and its group continues with the
//!   following one. If both derivatives vanish the groups share equally, as in `mixed`. A derivative with
//!   respect to density has no group and is ignored.
//! - GroupCounts are interleaved evenly in the selection, so that a budget that truncates it preserves the shares.

use super::{
    AcquisitionContext, ActionSelection, GroupCounts, Importance, Strategy, collisions, mixed, rolling,
};
use crate::error::{Error, Result};
use crate::world::latent::clamp;

/// The strategy's row in the registry.
pub struct GradientStrategy;

impl Strategy for GradientStrategy {
    fn name(&self) -> &'static str {
        "gradient"
    }

    fn needs_importance(&self) -> bool {
        true
    }

    fn select(&self, situation: &AcquisitionContext, n: usize) -> Result<ActionSelection> {
        let Some(importance) = situation.importance else {
            let allowed = "a strategy that needs no performance surface, or also give a surface";
            return Err(Error::input("strategy", "\"gradient\"", allowed));
        };
        let [_, friction, restitution] = mean_abs_gradient(importance, situation.estimate, situation.spread)?;
        let n = n.min(situation.candidates.len());
        let Some(groups) = allocate(n, restitution, friction) else {
            return mixed::MixedStrategy.select(situation, n);
        };
        let mut orders = [collisions::rank(situation.candidates), rolling::rank(situation.candidates)]
            .map(|order| order.into_iter());
        let mut taken = vec![false; situation.candidates.len()];
        let mut indices = Vec::with_capacity(n);
        for group in interleave([groups.collisions, groups.rolling]) {
            indices.extend(orders[group].find(|i| !std::mem::replace(&mut taken[*i], true)));
        }
        Ok(ActionSelection { indices, groups: Some(groups), ..ActionSelection::default() })
    }
}

/// Absolute partial derivatives with respect to density, friction and restitution, averaged over `estimate` and
/// the corners one standard deviation of friction and restitution away.
pub(super) fn mean_abs_gradient(
    importance: &dyn Importance,
    estimate: &[f64],
    spread: &[f64],
) -> Result<[f64; 3]> {
    const CORNERS: [[f64; 2]; 5] = [[0.0, 0.0], [-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]];
    let mut sums = [0.0; 3];
    for [a, b] in CORNERS {
        let at = clamp([estimate[0], estimate[1] + a * spread[1], estimate[2] + b * spread[2]]);
        let gradient = importance.gradient(at);
        if gradient.iter().any(|g| !g.is_finite()) {
            return Err(Error::Failed(format!("the performance surface has no gradient at {at:?}")));
        }
        sums.iter_mut().zip(gradient).for_each(|(sum, g)| *sum += g.abs() / CORNERS.len() as f64);
    }
    Ok(sums)
}

/// Allocates `n` actions by two weights; `None` if both are zero.
fn allocate(n: usize, collisions: f64, rolling: f64) -> Option<GroupCounts> {
    // Scaled by the larger weight, so that tiny or huge weights neither underflow nor overflow.
    let most = collisions.max(rolling);
    if most <= 0.0 {
        return None;
    }
    let share = (collisions / most) / (collisions / most + rolling / most);
    // For two groups, largest remainders are rounding to nearest, halves up.
    let first = ((n as f64 * share + 0.5).floor() as usize).min(n);
    Some(GroupCounts { collisions: first, rolling: n - first })
}

/// Order of group indices that spreads each group's quota evenly; ties in favour of the first group.
fn interleave(quota: [usize; 2]) -> Vec<usize> {
    let n = quota[0] + quota[1];
    let mut given = [0usize; 2];
    (0..n)
        .map(|_| {
            // The group furthest behind its share: (count + 1/2) / quota, compared without dividing.
            let behind = (2 * given[0] + 1) * quota[1] <= (2 * given[1] + 1) * quota[0];
            let group = usize::from(!behind);
            given[group] += 1;
            group
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::{ConstantGradient, SIMULATION, select_with, synthetic_candidates};
    use super::*;

    #[test]
    fn single_relevant_latent_selects_its_group() {
        let candidates = synthetic_candidates();
        for n in [0, 1, 7, 10, 100, 200] {
            let with = |slope| select_with("gradient", &candidates, n, Some(&ConstantGradient(slope)));
            let plain = |name| select_with(name, &candidates, n, None);
            assert_eq!(with([0.0, 1.0, 0.0]).indices, plain("rolling").indices);
            assert_eq!(with([0.0, -1e-9, 0.0]).indices, plain("rolling").indices);
            assert_eq!(with([5.0, 0.0, 0.3]).indices, plain("collisions").indices);
            assert_eq!(with([1.0, 0.0, 0.0]).indices, plain("mixed").indices, "no group is relevant");
        }
    }

    /// Shares follow the magnitudes, and a truncated selection preserves them.
    #[test]
    fn shares_are_proportional_to_derivatives() {
        let candidates = synthetic_candidates();
        let check = |slope: [f64; 3], n: usize, wanted: usize| {
            let chosen = select_with("gradient", &candidates, n, Some(&ConstantGradient(slope)));
            let groups = chosen.groups.unwrap();
            assert_eq!((groups.collisions, groups.rolling), (wanted, n - wanted), "{slope:?}");
            assert_eq!(chosen.indices.len(), n);
        };
        check([0.0, 1.0, 1.0], 10, 5);
        check([0.0, 1.0, 1.0], 5, 3);
        check([0.0, -1.0, 4.0], 10, 8);
        check([0.0, 1.0, -4.0], 10, 8);
        check([0.0, 3.0, 1.0], 50, 13);
        check([0.0, 1e-300, 3e-300], 4, 3);
        check([0.0, 1e308, 1e308], 4, 2);
        for (quota, cut, wanted) in [([8, 2], 5, 4), ([2, 8], 5, 1), ([25, 25], 10, 5), ([3, 0], 2, 2)] {
            let first = interleave(quota).into_iter().take(cut).filter(|g| *g == 0).count();
            assert_eq!(first, wanted, "{quota:?}");
            assert_eq!(interleave(quota).into_iter().filter(|g| *g == 0).count(), quota[0]);
        }
    }

    /// A dome is flat at its top but not one standard deviation away.
    #[test]
    fn gradient_is_averaged_around_a_maximum() {
        struct Dome;
        impl Importance for Dome {
            fn gradient(&self, l: [f64; 3]) -> [f64; 3] {
                [0.0, -2.0 * (l[1] - 0.5), -18.0 * (l[2] - 0.5)]
            }
        }
        let around = |spread: [f64; 4]| mean_abs_gradient(&Dome, &[1.0, 0.5, 0.5, 0.0], &spread).unwrap();
        assert_eq!(around([0.0; 4]), [0.0; 3]);
        let [_, friction, restitution] = around([0.5, 0.2, 0.2, 0.0]);
        assert!((restitution / friction - 9.0).abs() < 1e-9);
    }

    #[test]
    fn rejects_missing_or_nan_surface() {
        let candidates = synthetic_candidates();
        let situation = |importance| super::super::tests::context(&candidates, &SIMULATION, importance);
        assert!(matches!(GradientStrategy.select(&situation(None), 5), Err(Error::Input(_))));
        let broken = ConstantGradient([0.0, f64::NAN, 1.0]);
        assert!(matches!(GradientStrategy.select(&situation(Some(&broken)), 5), Err(Error::Failed(_))));
    }
}
