//! AUCCESS: the area under the success curve, weighted towards few attempts.
//!
//! AUCCESS = sum_k w_k s_k / sum_k w_k with w_k = ln(k + 1) - ln(k), k = 1..100, where s_k is the share of tasks
//! solved within k valid attempts. 1 means every task at the first attempt.
//!
//! Source: Bakhtin et al. 2019, "PHYRE: A New Benchmark for Physical Reasoning", section 3 (evaluation).
//! Differences from the source: none.

/// Maximum number of attempts that count.
pub const MAX_ATTEMPTS: usize = 100;

/// AUCCESS from the first solving attempt of each task (1 = the first; `None` if unsolved). 0 without tasks.
pub fn auccess(solved_at: &[Option<usize>]) -> f64 {
    weighted_mean(&success_curve(solved_at))
}

/// AUCCESS of a success curve: the share of tasks solved within 1, 2, ... attempts, or its expectation.
pub fn weighted_mean(shares: &[f64; MAX_ATTEMPTS]) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for (i, share) in shares.iter().enumerate() {
        let k = (i + 1) as f64;
        let weight = libm::log(k + 1.0) - libm::log(k);
        sum += weight * share;
        weights += weight;
    }
    sum / weights
}

/// Share of tasks solved within 1, 2, ... 100 attempts.
pub fn success_curve(solved_at: &[Option<usize>]) -> [f64; MAX_ATTEMPTS] {
    std::array::from_fn(|i| {
        let solved = solved_at.iter().flatten().filter(|k| **k <= i + 1).count();
        if solved_at.is_empty() { 0.0 } else { solved as f64 / solved_at.len() as f64 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_hand_computed_values() {
        let check = |solved_at: &[Option<usize>], wanted: f64| {
            let found = auccess(solved_at);
            assert!((found - wanted).abs() < 1e-12, "{solved_at:?}: {found}, not {wanted}");
        };
        // The weights telescope: from attempt k on they sum to ln(101 / k).
        let from = |k: f64| (101.0f64 / k).ln() / 101.0f64.ln();
        check(&[], 0.0);
        check(&[None], 0.0);
        check(&[Some(1)], 1.0);
        check(&[Some(2)], from(2.0));
        check(&[Some(100)], from(100.0));
        check(&[Some(101)], 0.0);
        check(&[Some(1), None], 0.5);
        check(&[Some(1), Some(10), None, Some(3)], (1.0 + from(10.0) + from(3.0)) / 4.0);
    }

    #[test]
    fn curve_counts_tasks() {
        let shares = success_curve(&[Some(1), Some(3), None, Some(3)]);
        assert_eq!(shares[..4], [0.25, 0.25, 0.75, 0.75]);
        assert_eq!(shares[99], 0.75);
    }
}
