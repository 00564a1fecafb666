//! Accuracy of an experiment's final estimates, and verdicts on the paper's claims about it.
//!
//! Errors that average several factors are in units of the prior's standard deviation; differences are paired by seed.

use serde::{Deserialize, Serialize};

use super::statistics::{Claim, Summary};
use crate::task::{EstimateClaim, Family};
use crate::world::latent::factor_index;
use crate::world::{Latents, ParameterVector};

/// Final estimates of an arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FinalEstimates {
    /// Name of the arm.
    pub arm: String,
    /// Mean real interactions over seeds.
    pub interactions: f64,
    /// One estimate per seed, in the order of the experiment's seeds.
    pub by_seed: Vec<ParameterVector>,
}

impl FinalEstimates {
    /// Mean over seeds of coordinate `i` of the estimates.
    pub fn mean(&self, i: usize) -> Summary {
        self.summary(|estimate| estimate[i])
    }

    /// Bias of factor `i`: mean over seeds of estimate - truth. `None` if the truth has no such factor.
    pub fn bias(&self, truth: &Latents, i: usize) -> Option<Summary> {
        let truth = truth.values()[i]?;
        Some(self.summary(|estimate| estimate[i] - truth))
    }

    /// Mean over seeds of |estimate - truth| of factor `i`. `None` if the truth has no such factor.
    pub fn error(&self, truth: &Latents, i: usize) -> Option<Summary> {
        let truth = truth.values()[i]?;
        Some(self.summary(|estimate| (estimate[i] - truth).abs()))
    }

    fn summary(&self, of: impl Fn(&ParameterVector) -> f64) -> Summary {
        Summary::of(&self.by_seed.iter().map(of).collect::<Vec<_>>())
    }
}

/// Verdicts on the family's claims about estimates whose arms are among `estimates`.
pub fn accuracy_claims(family: &Family, truth: &Latents, estimates: &[FinalEstimates]) -> Vec<Claim> {
    let of = |arm: &str, claim: &EstimateClaim| -> Option<Vec<f64>> {
        let found = estimates.iter().find(|e| e.arm == arm)?;
        Some(found.by_seed.iter().map(|e| mean_error(family, truth, e, &factors(claim))).collect())
    };
    let verdict = |claim: &EstimateClaim| {
        accuracy_claim(claim.text.into(), &of(claim.better, claim)?, &of(claim.worse, claim)?)
    };
    family.claims.estimates.iter().filter_map(verdict).collect()
}

/// Indices of a claim's factors.
pub(super) fn factors(claim: &EstimateClaim) -> Vec<usize> {
    claim.factors.iter().filter_map(|f| factor_index(f).ok()).collect()
}

/// Mean over `factors` of |estimate - truth|, in units of the prior's standard deviation.
pub(super) fn mean_error(
    family: &Family,
    truth: &Latents,
    estimate: &ParameterVector,
    factors: &[usize],
) -> f64 {
    let error =
        |i: &usize| (estimate[*i] - truth.values()[*i].unwrap_or(f64::NAN)).abs() / family.prior[*i].1;
    factors.iter().map(error).sum::<f64>() / factors.len() as f64
}

/// Verdict on whether the errors `better` are smaller than `worse`, both by seed; `None` if one of them is missing.
pub(super) fn accuracy_claim(text: String, better: &[f64], worse: &[f64]) -> Option<Claim> {
    if better.is_empty() || better.len() != worse.len() {
        return None;
    }
    let difference: Vec<f64> = worse.iter().zip(better).map(|(w, b)| w - b).collect();
    let found = Summary::of(&difference);
    Some(Claim {
        text,
        figure: format!(
            "error {:.4} against {:.4} of the prior's deviation; difference {} (95 % +- {:.4})",
            Summary::of(better).mean,
            Summary::of(worse).mean,
            found.show(4),
            found.half_width.unwrap_or(f64::INFINITY)
        ),
        verdict: found.above_zero(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::statistics::ClaimVerdict;
    use crate::task::family;

    #[test]
    fn verdicts_follow_from_paired_errors() {
        let family = family("basketball").unwrap();
        let truth = Latents::of([0.25, 0.2, 0.7]);
        let arm = |name: &str, restitutions: [f64; 3]| FinalEstimates {
            arm: name.into(),
            interactions: 500.0,
            by_seed: restitutions.iter().map(|r| vec![0.25, 0.2, *r, 0.0]).collect(),
        };
        let found = [arm("collisions", [0.7, 0.71, 0.69]), arm("rolling", [0.4, 0.41, 0.39])];
        let claims = accuracy_claims(family, &truth, &found);
        // The claim about `mixed` is left out: there is no such arm.
        assert_eq!(claims.len(), 1);
        assert_eq!(claims[0].verdict, ClaimVerdict::Reproduced);
        assert!((found[1].bias(&truth, 2).unwrap().mean + 0.3).abs() < 1e-12);
        assert!((found[0].error(&truth, 2).unwrap().mean - 0.02 / 3.0).abs() < 1e-12);
    }
}
