//! What the scores amount to: nothing, a name, several that tie, or something that no name explains.

use super::decide::{Compared, MOST, TIED, compared};
use super::field::{self, Shared};
use super::fit::{Fitted, Fitter};
use super::report::Verdict;
use super::search::Found;
use crate::error::Result;
use crate::world::effect::Effect;

/// A verdict with what it was taken from.
pub struct Judged {
    pub verdict: Verdict,
    /// Index of the set that is reported first; none if no set is.
    pub champion: Option<usize>,
    /// Indices of all sets that tie, the champion first.
    pub rivals: Vec<usize>,
    /// Whether launches share something that the reported model leaves.
    pub shared: Option<Shared>,
    /// How every fit compares with the best.
    pub compared: Vec<Compared>,
    /// The same of the base model.
    pub base: Compared,
}

/// Judges what a search found.
pub fn judge(fitter: &Fitter, found: &Found) -> Result<Judged> {
    // What leaves its own effects out is no model of them.
    let order = found.ranked(is_something);
    let base_total: f64 = found.base_score.iter().sum();
    let best = order.first().copied().filter(|i| found.total(*i) > base_total);
    let top = best.map_or(&found.base_score, |b| &found.scores[b]);
    let all: Vec<Compared> = found.scores.iter().map(|s| compared(top, s, &found.bootstrap)).collect();
    let base = compared(top, &found.base_score, &found.bootstrap);
    let judged = |verdict, rivals: Vec<usize>, shared| Judged {
        verdict,
        champion: rivals.first().copied(),
        rivals,
        shared,
        compared: all.clone(),
        base,
    };
    let tied: Vec<usize> = order.iter().copied().filter(|i| all[*i].is_tied()).collect();
    let asked = |model: &Fitted| field::shared(fitter, &found.base, model, &found.bootstrap);
    if base.is_tied() || tied.is_empty() {
        // No name is any better; but there may be something, shared by launches or drawn anew for each.
        let shared = asked(&found.base)?;
        let slow = compared(&found.base.score, &found.base.smooth, &found.bootstrap);
        let left = shared.as_ref().is_some_and(Shared::is_left) || !slow.is_tied();
        return Ok(judged(if left { Verdict::Unknown } else { Verdict::None }, Vec::new(), shared));
    }
    // The smallest of those that cannot be told apart; a larger one where the smaller leaves what launches share.
    let mut sizes: Vec<usize> = tied.iter().map(|i| found.fits[*i].set.len()).collect();
    sizes.sort_unstable();
    sizes.dedup();
    let mut least: Option<(f64, Vec<usize>, Option<Shared>)> = None;
    for size in sizes {
        let group =
            simplest(found, tied.iter().copied().filter(|i| found.fits[*i].set.len() == size).collect());
        let shared = asked(&found.fits[group[0]])?;
        let steady =
            compared(&found.fits[group[0]].score, &found.fits[group[0]].steady, &found.bootstrap).is_tied();
        let explained = match shared.as_ref().filter(|s| s.is_left()) {
            // Sizes that differ more than they have reason to depend on something that launches share and the set has not.
            _ if !steady => 0.0,
            Some(s) => s.explained,
            None => 1.0,
        };
        if explained >= MOST {
            // Something without a name may do as well as one of the names.
            let group = with_better(found, &tied, group);
            let smaller = beside_field(found, size, &asked)?;
            let (group, shared) = smaller.unwrap_or((group, shared));
            let verdict = if group.len() == 1 { Verdict::Named } else { Verdict::Ambiguous };
            return Ok(judged(verdict, group, shared));
        }
        if least.as_ref().is_none_or(|l| explained > l.0) {
            least = Some((explained, group, shared));
        }
    }
    let (_, group, shared) = least.unwrap_or_default();
    Ok(judged(Verdict::Unknown, group, shared))
}

/// Whether every effect of a set is there: an amplitude whose interval leaves nothing out, or one that is there by
/// its spread.
fn is_something(fit: &Fitted) -> bool {
    (0..fit.set.len()).all(|t| {
        fit.layout.of_term(t).into_iter().filter(|i| !fit.layout.shapes(*i)).any(|i| {
            let off = (fit.state.values[i] - fit.neutral(i)).abs();
            off > fit.half_width(i) || fit.is_there_by_spread(i)
        })
    })
}

/// Share of the predictable misfit that a name must explain where something without a name predicts as well.
const LEAST: f64 = 0.02;
/// Sets of every size that are asked again with the field beside them.
const ASKED: usize = 3;

/// A set smaller than `size` that explains nearly as much by itself, and beside a field of no name predicts as well as the best
/// of that size: the names that it has not are none. Where something without a name is left, nats say little of a name: half
/// a millimetre that nothing explains is worth hundreds of them.
#[allow(clippy::type_complexity)]
fn beside_field(
    found: &Found,
    size: usize,
    asked: &dyn Fn(&Fitted) -> Result<Option<Shared>>,
) -> Result<Option<(Vec<usize>, Option<Shared>)>> {
    let of_size = |m: usize| found.ranked(|f| f.set.len() == m && is_something(f)).into_iter().take(ASKED);
    let Some(best) = of_size(size).next() else { return Ok(None) };
    let Some(all) = asked(&found.fits[best])? else { return Ok(None) };
    for smaller in 1..size {
        let mut group: Vec<(usize, Shared, Vec<f64>)> = Vec::new();
        for i in of_size(smaller) {
            let Some(shared) = asked(&found.fits[i])? else { continue };
            let share = found.choice.charge(&found.fits[i].names()) / shared.scores.len() as f64;
            let scores: Vec<f64> = shared.scores.iter().map(|s| s - share).collect();
            let worse = compared(&found.scores[best], &scores, &found.bootstrap);
            if shared.explained >= MOST && all.explained - shared.explained <= LEAST && worse.is_tied() {
                group.push((i, shared, scores));
            }
        }
        let total = |s: &[f64]| s.iter().sum::<f64>();
        group.sort_by(|a, b| total(&b.2).total_cmp(&total(&a.2)));
        let Some(first) = group.first().map(|f| f.2.clone()) else { continue };
        group.retain(|g| compared(&first, &g.2, &found.bootstrap).is_tied());
        let sets = simplest(found, group.iter().map(|g| g.0).collect());
        let shared = group.into_iter().find(|g| g.0 == sets[0]).map(|g| g.1);
        return Ok(Some((sets, shared)));
    }
    Ok(None)
}

/// A group, and the larger tied sets that predict better by more than what ties, though not for certain, and hold none of
/// it: which it is, nobody can tell.
fn with_better(found: &Found, tied: &[usize], mut group: Vec<usize>) -> Vec<usize> {
    let (size, least) = (found.fits[group[0]].set.len(), found.total(group[0]) + TIED[0]);
    let better = |i: &usize| found.fits[*i].set.len() > size && found.total(*i) > least;
    let mut more: Vec<usize> = tied.iter().copied().filter(better).collect();
    more.sort_by_key(|i| found.fits[*i].set.len());
    for i in more {
        if !group.iter().any(|j| holds(found, i, *j)) {
            group.push(i);
        }
    }
    group
}

/// Whether a set is another, or more than it, for some of its values.
fn holds(found: &Found, large: usize, small: usize) -> bool {
    let (large, small) = (&found.fits[large], &found.fits[small]);
    large.parameters() > small.parameters()
        && small.set.iter().all(|s| large.set.iter().any(|l| l.name == s.name || contains(l, s)))
}

/// Those of some sets that hold no other of them as a special case, in their order.
fn simplest(found: &Found, group: Vec<usize>) -> Vec<usize> {
    let kept = |i: &usize| !group.iter().any(|j| j != i && holds(found, *i, *j));
    group.iter().copied().filter(kept).collect()
}

/// Whether an effect is another for some of its values, or by way of one that is.
fn contains(large: &Effect, small: &Effect) -> bool {
    large.holds.iter().any(|h| h.name == small.name || contains(h, small))
}

#[cfg(test)]
mod tests {
    use super::contains;
    use crate::world::effect::find;

    #[test]
    fn an_effect_contains_what_those_it_holds_contain() {
        let of = |large: &str, small: &str| contains(find(large).unwrap(), find(small).unwrap());
        assert!(of("moving_air", "quadratic_drag") && of("moving_air", "wind"));
        assert!(of("moving_air", "gravity_error"), "by way of wind");
        assert!(!of("quadratic_drag", "moving_air") && !of("lift", "wind"));
    }
}
