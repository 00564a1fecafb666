//! What sizes are known by where launches differ otherwise than the model has it: each launch left out in turn.
//!
//! Intervals from the model's own covariance hold where its variance components are the true ones; those are told by a dozen
//! launches or two. How far sizes move when a launch is left out asks nothing of the model. The larger of the two counts.
//!
//! Sources: the jackknife over groups, as CR3 in Bell and McCaffrey, Surv. Methodol. 28 (2002) 169; the larger of the
//! conventional and the robust standard error: Angrist and Pischke, Mostly Harmless Econometrics (2009), section 8.1.
//!
//! Differences from the source: components and scales stay as all launches tell them, and what is believed of sizes counts as it
//! does in the model.

use nalgebra::DVector;

use super::gaussian::{Pooled, Prior, Told};

/// Variances of the slots, by how far leaving each launch out moves them; `pooled`: what all launches say.
pub fn variances(told: &[Told], prior: &Prior, pooled: &Pooled) -> DVector<f64> {
    let q = pooled.step.len();
    let mut all = prior.precision.clone();
    let weights: Vec<f64> = told.iter().map(|t| t.weight(&pooled.step)).collect();
    told.iter().zip(&weights).for_each(|(t, w)| all += &t.gram * *w);
    let mut launches: Vec<usize> = told.iter().map(|t| t.launch).collect();
    launches.sort_unstable();
    launches.dedup();
    let share = 1.0 - (launches.len().max(1) as f64).recip();
    let mut out = (&pooled.covariance * &prior.precision * &pooled.covariance).diagonal();
    for launch in launches {
        let (mut rest, mut asked) = (all.clone(), DVector::<f64>::zeros(q));
        for (t, w) in told.iter().zip(&weights).filter(|(t, _)| t.launch == launch) {
            rest -= &t.gram * *w;
            asked += (&t.score - &t.gram * &pooled.step) * *w;
        }
        // What one launch alone tells has nothing to be held against.
        if let Some(rest) = rest.cholesky() {
            let moved = rest.solve(&asked);
            out += moved.component_mul(&moved) * share;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::gaussian::pooled;
    use nalgebra::DMatrix;

    /// One slot, one number a launch, a scale that is known: the square of the usual standard error of a mean, however far the
    /// model believed the numbers to be apart.
    #[test]
    fn variances_are_those_of_a_mean() {
        let numbers = [3.0, -1.0, 4.0, 1.0, -5.0, 9.0, 2.0, -6.0];
        let n = numbers.len() as f64;
        let mean = numbers.iter().sum::<f64>() / n;
        let wanted = numbers.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n * (n - 1.0));
        let one = DMatrix::from_element(1, 1, 1.0);
        let told: Vec<Told> = numbers
            .iter()
            .enumerate()
            .map(|(launch, x)| Told {
                launch,
                gram: one.clone(),
                score: DVector::from_element(1, *x),
                square: 1e12,
                log_det: 0.0,
                count: 1e12,
                allowed: 0.0,
            })
            .collect();
        let prior = Prior {
            precision: &one * 1e-12,
            off: DVector::zeros(1),
            plausible: vec![0.0],
            reason: vec![0.0],
            by_setting: vec![false],
        };
        let all = pooled(told.iter(), &prior).unwrap();
        let found = variances(&told, &prior, &all)[0];
        assert!((found / wanted - 1.0).abs() < 1e-6, "{found} {wanted}");
        assert!((all.covariance[(0, 0)] * n - 1.0).abs() < 1e-6);
    }
}
