//! `gradient`: as many actions for each latent as the task's performance asks for (partial grounding).
//!
//! Source: Semage et al., algorithm 2: with P the performance surface of a related, known environment, the absolute
//! partial derivatives of P at the current estimate say which share of the N actions is taken from the collisions
//! group, |dP/d restitution|, and which from the rolling group, |dP/d friction|; in each group the actions are
//! ranked on the simulation at the current estimate.
//!
//! Differences from the source:
//! - The magnitudes are averaged over the estimate and the four corners estimate +- spread, the search's own
//!   standard deviations. At the top of the surface the derivatives vanish and their ratio is noise, just when the
//!   estimate may still be a spread away from where it is needed. Once the search has settled the corners fall
//!   together and this is the source's rule.
//! - Derivatives are taken as they are, per unit of a coefficient, not per standard deviation of what is believed:
//!   both coefficients are plain numbers of about one. `informative` is the strategy that weighs what is at stake.
//! - Cases on which the source is silent: the sign plays no part; shares are rounded by largest remainders, a tie
//!   going to collisions; an action that both groups want is taken once and the group whose turn it was takes its
//!   next; where both derivatives vanish the groups share equally, as `mixed` does. A derivative by density has no
//!   group and is left out.
//! - The order within the choice deals the groups out evenly, so that a budget that cuts it short keeps the shares.

use super::{Chosen, Groups, Importance, Situation, Strategy, collisions, mixed, rolling};
use crate::error::{Error, Result};
use crate::world::latent::clamp;

/// The strategy's row in the registry.
pub struct Gradient;

impl Strategy for Gradient {
    fn name(&self) -> &'static str {
        "gradient"
    }

    fn needs_importance(&self) -> bool {
        true
    }

    fn choose(&self, situation: &Situation, n: usize) -> Result<Chosen> {
        let Some(importance) = situation.importance else {
            let allowed = "a strategy that needs no performance surface, or a surface beside it";
            return Err(Error::input("strategy", "\"gradient\"", allowed));
        };
        let [_, friction, restitution] = magnitudes(importance, situation.estimate, situation.spread)?;
        let n = n.min(situation.candidates.len());
        let Some(groups) = quota(n, restitution, friction) else {
            return mixed::Mixed.choose(situation, n);
        };
        let mut orders = [collisions::order(situation.candidates), rolling::order(situation.candidates)]
            .map(|order| order.into_iter());
        let mut taken = vec![false; situation.candidates.len()];
        let mut indices = Vec::with_capacity(n);
        for group in turns([groups.collisions, groups.rolling]) {
            indices.extend(orders[group].find(|i| !std::mem::replace(&mut taken[*i], true)));
        }
        Ok(Chosen { indices, groups: Some(groups), ..Chosen::default() })
    }
}

/// Absolute partial derivatives by density, friction and restitution around `estimate`, averaged over it and the
/// corners one spread of friction and restitution away.
pub(super) fn magnitudes(importance: &dyn Importance, estimate: &[f64], spread: &[f64]) -> Result<[f64; 3]> {
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

/// `n` actions dealt out by two weights; `None` if neither weighs anything.
fn quota(n: usize, collisions: f64, rolling: f64) -> Option<Groups> {
    // Divided by the larger first, so that tiny weights and huge ones neither vanish nor overflow.
    let most = collisions.max(rolling);
    if most <= 0.0 {
        return None;
    }
    let share = (collisions / most) / (collisions / most + rolling / most);
    // With two groups the largest remainder is rounding to the nearest, halves up.
    let first = ((n as f64 * share + 0.5).floor() as usize).min(n);
    Some(Groups { collisions: first, rolling: n - first })
}

/// Whose turn it is: each group as often as its quota says, spread out evenly, the first group first on a tie.
fn turns(quota: [usize; 2]) -> Vec<usize> {
    let n = quota[0] + quota[1];
    let mut given = [0usize; 2];
    (0..n)
        .map(|_| {
            // The group that has come furthest behind: (given + 1/2) / quota, compared without dividing.
            let behind = (2 * given[0] + 1) * quota[1] <= (2 * given[1] + 1) * quota[0];
            let group = usize::from(!behind);
            given[group] += 1;
            group
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Slope, WORLD, chosen_with, some};
    use super::*;

    #[test]
    fn a_single_important_latent_gives_its_group() {
        let candidates = some();
        for n in [0, 1, 7, 10, 100, 200] {
            let with = |slope| chosen_with("gradient", &candidates, n, Some(&Slope(slope)));
            let plain = |name| chosen_with(name, &candidates, n, None);
            assert_eq!(with([0.0, 1.0, 0.0]).indices, plain("rolling").indices);
            assert_eq!(with([0.0, -1e-9, 0.0]).indices, plain("rolling").indices);
            assert_eq!(with([5.0, 0.0, 0.3]).indices, plain("collisions").indices);
            assert_eq!(with([1.0, 0.0, 0.0]).indices, plain("mixed").indices, "no group asked for");
        }
    }

    /// Shares follow the magnitudes, and a cut-off choice keeps them.
    #[test]
    fn shares_follow_the_derivatives() {
        let candidates = some();
        let check = |slope: [f64; 3], n: usize, wanted: usize| {
            let chosen = chosen_with("gradient", &candidates, n, Some(&Slope(slope)));
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
            let first = turns(quota).into_iter().take(cut).filter(|g| *g == 0).count();
            assert_eq!(first, wanted, "{quota:?}");
            assert_eq!(turns(quota).into_iter().filter(|g| *g == 0).count(), quota[0]);
        }
    }

    /// A dome has no slope at its top, but one spread away it has: the steeper side is seen.
    #[test]
    fn the_top_of_a_dome_is_not_flat_all_round() {
        struct Dome;
        impl Importance for Dome {
            fn gradient(&self, l: [f64; 3]) -> [f64; 3] {
                [0.0, -2.0 * (l[1] - 0.5), -18.0 * (l[2] - 0.5)]
            }
        }
        let around = |spread: [f64; 4]| magnitudes(&Dome, &[1.0, 0.5, 0.5, 0.0], &spread).unwrap();
        assert_eq!(around([0.0; 4]), [0.0; 3]);
        let [_, friction, restitution] = around([0.5, 0.2, 0.2, 0.0]);
        assert!((restitution / friction - 9.0).abs() < 1e-9);
    }

    #[test]
    fn a_surface_that_is_missing_or_has_no_slope_is_an_error() {
        let candidates = some();
        let situation = |importance| super::super::tests::seen(&candidates, &WORLD, importance);
        assert!(matches!(Gradient.choose(&situation(None), 5), Err(Error::Input(_))));
        let broken = Slope([0.0, f64::NAN, 1.0]);
        assert!(matches!(Gradient.choose(&situation(Some(&broken)), 5), Err(Error::Failed(_))));
    }
}
