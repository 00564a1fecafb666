//! Initial points of chains: the most likely of a few draws from the reference.

use super::reference::ReferenceDensity;
use super::{Target, log_densities};
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::rng::Stream;
use crate::world::ParameterVector;

/// Draws per initial point.
const DRAWS_PER_POINT: usize = 4;
/// Maximum number of attempts per chain.
const MAX_ROUNDS: usize = 16;

/// `count` points with their [`log_densities`], all finite.
pub fn initial_points(
    target: &dyn Target,
    reference: &ReferenceDensity,
    count: usize,
    stream: &mut Stream,
    evaluations: &mut u64,
    budget: &dyn Budget,
) -> Result<Vec<(ParameterVector, [f64; 2])>> {
    let mut found: Vec<Option<(ParameterVector, [f64; 2])>> = vec![None; count];
    for _ in 0..MAX_ROUNDS {
        let missing: Vec<usize> = (0..count).filter(|i| found[*i].is_none()).collect();
        if missing.is_empty() {
            break;
        }
        let candidates: Vec<ParameterVector> =
            (0..DRAWS_PER_POINT * missing.len()).map(|_| reference.draw(stream)).collect();
        let density = log_densities(target, &candidates, evaluations, budget)?;
        for (k, i) in missing.into_iter().enumerate() {
            let own = DRAWS_PER_POINT * k..DRAWS_PER_POINT * (k + 1);
            let best = own.max_by(|a, b| density[*a][0].total_cmp(&density[*b][0]));
            found[i] = best
                .filter(|b| density[*b][0] > f64::NEG_INFINITY)
                .map(|b| (candidates[b].clone(), density[b]));
        }
    }
    let failure =
        || Error::Failed("no draw from the prior or near the fit has a finite posterior density".into());
    found.into_iter().collect::<Option<_>>().ok_or_else(failure)
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;
    use crate::budget::Unlimited;
    use crate::estimate::sampler::JointPrior;
    use crate::estimate::sampler::tests::TiltedNormal;
    use crate::rng;

    #[test]
    fn initial_points_have_finite_density() {
        let target = TiltedNormal::new();
        // A centre outside the bounds makes many draws impossible.
        let reference =
            ReferenceDensity::new(&[2.1, 0.5, 1.0], &(DMatrix::identity(3, 3) * 0.04), 1.0, target.prior());
        let drawn = |seed: u64| {
            let (mut stream, mut asked) = (rng::stream(seed, "starts"), 0);
            let found = initial_points(&target, &reference, 50, &mut stream, &mut asked, &Unlimited).unwrap();
            assert!(asked <= 200 + 4 * 50, "{asked}");
            found
        };
        let found = drawn(3);
        assert_eq!(found.len(), 50);
        for (point, [density, likelihood]) in &found {
            assert!(target.prior().contains(point) && density.is_finite(), "{point:?}");
            assert_eq!(*density, target.prior().log_density(point) + likelihood);
        }
        assert_eq!(found, drawn(3), "the seed determines every bit");
        assert_ne!(found, drawn(4));
    }

    /// A likelihood that is NaN everywhere.
    struct ImpossibleTarget(JointPrior);

    impl Target for ImpossibleTarget {
        fn prior(&self) -> &JointPrior {
            &self.0
        }

        fn log_likelihoods(&self, points: &[ParameterVector], _: &dyn Budget) -> Result<Vec<f64>> {
            Ok(vec![f64::NAN; points.len()])
        }
    }

    #[test]
    fn fails_if_no_point_has_finite_density() {
        let target = ImpossibleTarget(TiltedNormal::new().prior);
        let reference =
            ReferenceDensity::new(&[1.0, 0.5, 1.0], &DMatrix::identity(3, 3), 1.0, target.prior());
        let found = initial_points(&target, &reference, 3, &mut rng::stream(1, "starts"), &mut 0, &Unlimited);
        assert!(found.unwrap_err().to_string().contains("finite posterior density"));
    }
}
