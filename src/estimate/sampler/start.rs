//! Where chains begin: about the fit, of a few draws the most likely each.

use super::reference::Reference;
use super::{Target, densities};
use crate::error::{Error, Result};
use crate::rng::Stream;
use crate::world::Sample;

/// Draws of which the most likely is where a chain begins.
const TRIED: usize = 4;
/// How often that is tried for a chain before it is said that nowhere is possible.
const ROUNDS: usize = 16;

/// So many points with their densities, as [`densities`] has them; each of them is possible.
pub fn starts(
    target: &dyn Target,
    reference: &Reference,
    count: usize,
    stream: &mut Stream,
    evaluations: &mut u64,
) -> Result<Vec<(Sample, [f64; 2])>> {
    let mut found: Vec<Option<(Sample, [f64; 2])>> = vec![None; count];
    for _ in 0..ROUNDS {
        let wanting: Vec<usize> = (0..count).filter(|i| found[*i].is_none()).collect();
        if wanting.is_empty() {
            break;
        }
        let tried: Vec<Sample> = (0..TRIED * wanting.len()).map(|_| reference.draw(stream)).collect();
        let density = densities(target, &tried, evaluations)?;
        for (k, i) in wanting.into_iter().enumerate() {
            let own = TRIED * k..TRIED * (k + 1);
            let best = own.max_by(|a, b| density[*a][0].total_cmp(&density[*b][0]));
            found[i] =
                best.filter(|b| density[*b][0] > f64::NEG_INFINITY).map(|b| (tried[b].clone(), density[b]));
        }
    }
    let nowhere = || Error::Failed("no draw from the prior or about the fit is possible at all".into());
    found.into_iter().collect::<Option<_>>().ok_or_else(nowhere)
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;
    use crate::estimate::sampler::Prior;
    use crate::estimate::sampler::tests::Tilted;
    use crate::rng;

    #[test]
    fn chains_begin_where_it_is_possible() {
        let target = Tilted::new();
        // Outside of the bounds, so that many draws are impossible.
        let reference =
            Reference::new(&[2.1, 0.5, 1.0], &(DMatrix::identity(3, 3) * 0.04), 1.0, target.prior());
        let drawn = |seed: u64| {
            let (mut stream, mut asked) = (rng::stream(seed, "starts"), 0);
            let found = starts(&target, &reference, 50, &mut stream, &mut asked).unwrap();
            assert!(asked <= 200 + 4 * 50, "{asked}");
            found
        };
        let found = drawn(3);
        assert_eq!(found.len(), 50);
        for (point, [density, likelihood]) in &found {
            assert!(target.prior().allows(point) && density.is_finite(), "{point:?}");
            assert_eq!(*density, target.prior().log_density(point) + likelihood);
        }
        assert_eq!(found, drawn(3), "a seed decides every bit");
        assert_ne!(found, drawn(4));
    }

    /// A likelihood that nothing is possible under.
    struct Nothing(Prior);

    impl Target for Nothing {
        fn prior(&self) -> &Prior {
            &self.0
        }

        fn log_likelihoods(&self, points: &[Sample]) -> Result<Vec<f64>> {
            Ok(vec![f64::NAN; points.len()])
        }
    }

    #[test]
    fn that_nowhere_is_possible_is_said() {
        let target = Nothing(Tilted::new().prior);
        let reference = Reference::new(&[1.0, 0.5, 1.0], &DMatrix::identity(3, 3), 1.0, target.prior());
        let found = starts(&target, &reference, 3, &mut rng::stream(1, "starts"), &mut 0);
        assert!(found.unwrap_err().to_string().contains("possible"));
    }
}
