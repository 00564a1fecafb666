//! Cross-validation by folds of trials.

use crate::inference::mixed_model::group_statistics::{GlsEstimate, GroupStatistics, gls};
use crate::inference::selection::FixedEffectsPrior;

/// Maximum number of folds.
const MAX_FOLDS: usize = 10;

/// Fold of every trial; every setting is spread over all folds.
pub fn folds(settings: &[usize]) -> Vec<usize> {
    let count = MAX_FOLDS.min(settings.len()).max(1);
    let mut observed = vec![0usize; settings.iter().max().map_or(0, |m| m + 1)];
    let mut first = 0;
    let mut out = Vec::with_capacity(settings.len());
    for setting in settings {
        if observed[*setting] == 0 {
            observed[*setting] = first + 1;
            first += 1;
        }
        out.push((observed[*setting] - 1) % count);
        observed[*setting] += 1;
    }
    out
}

/// Passes the statistics of every group, with the estimate from the other folds, to `of`; `None` where one cannot be made.
pub fn for_each_held_out(
    statistics: &[GroupStatistics],
    prior: &FixedEffectsPrior,
    folds: &[usize],
    mut of: impl FnMut(&GroupStatistics, &GlsEstimate),
) -> Option<()> {
    for fold in 0..folds.iter().max().map_or(0, |m| m + 1) {
        let others = gls(statistics.iter().filter(|t| folds[t.trial] != fold), prior)?;
        statistics.iter().filter(|t| folds[t.trial] == fold).for_each(|t| of(t, &others));
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_spread_over_the_folds() {
        let folds = folds(&[0, 0, 0, 1, 1, 1]);
        let of = |s: usize| -> Vec<usize> { folds[3 * s..3 * s + 3].to_vec() };
        for s in 0..2 {
            let mut own = of(s);
            own.dedup();
            assert_eq!(own.len(), 3);
        }
    }
}
