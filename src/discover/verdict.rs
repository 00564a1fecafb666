//! What the scores amount to: nothing, a name, several that tie, or something that no name explains.

use super::decide::{Compared, MOST, SHORT, TIED, compared};
use super::field::{self, Shared};
use super::fit::{Fitted, Fitter};
use super::reason;
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
    let unnamed = field::shared(fitter, &found.base, &found.base, &found.bootstrap)?;
    let asked = |model: &Fitted| {
        let shared = field::shared(fitter, &found.base, model, &found.bootstrap)?;
        let fields = || shared.iter().chain(&unnamed).collect::<Vec<_>>();
        let explained = field::explained(&found.base, model, &fields());
        Ok(shared.map(|s| Shared { explained, ..s }))
    };
    let suffices = |model: &Fitted| reason::suffices(fitter, &found.base, model, &found.bootstrap);
    if base.is_tied() || tied.is_empty() {
        // No name is any better; but there may be something, shared by launches or drawn anew for each.
        let shared = unnamed;
        let left = shared.as_ref().is_some_and(Shared::is_left) || !suffices(&found.base)?;
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
        let enough = suffices(&found.fits[group[0]])?;
        // What launches have no reason to differ by depends on something that they share and the set has not.
        let is_better = unnamed.as_ref().is_some_and(|u| is_better(found, u, group[0]));
        let is_left = is_better || shared.as_ref().is_some_and(Shared::is_left);
        let explained = match &shared {
            _ if !enough => 0.0,
            Some(s) if is_left => s.explained,
            _ => 1.0,
        };
        let is_left = is_left || !enough;
        let plainer = plainer(found, group[0], is_left, &asked, &suffices)?;
        if plainer.is_some() || explained >= MOST {
            // Something without a name may do as well as one of the names.
            let (group, shared) = plainer.unwrap_or_else(|| (with_better(found, &tied, group), shared));
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

/// Whether a field without a name and without any set predicts launches better than a set, for certain.
fn is_better(found: &Found, unnamed: &Shared, set: usize) -> bool {
    !compared(&unnamed.scores, &found.scores[set], &found.bootstrap).is_tied()
}

/// Whether every effect of a set is there: an amplitude whose interval leaves nothing out, by the data alone too (beside a field
/// whose centre is free a wind is only what is believed of winds), or one that is there by its spread.
fn is_something(fit: &Fitted) -> bool {
    let alone = fit.half_widths_without_belief();
    (0..fit.set.len()).all(|t| {
        fit.layout.of_term(t).into_iter().filter(|i| !fit.layout.shapes(*i)).any(|i| {
            let off = (fit.state.values[i] - fit.neutral(i)).abs();
            off > fit.half_width(i).max(alone[i]) || fit.is_there_by_spread(i)
        })
    })
}

/// Plainer sets than `best` that explain nearly as much by themselves, if what they have not is no name: something that nobody
/// named is left by `best` too, or beside such a thing they predict as well. Where something is left, nats say little of a
/// name: half a millimetre that nothing explains is worth hundreds of them.
fn plainer(
    found: &Found,
    best: usize,
    is_left: bool,
    asked: &dyn Fn(&Fitted) -> Result<Option<Shared>>,
    suffices: &dyn Fn(&Fitted) -> Result<bool>,
) -> Result<Option<(Vec<usize>, Option<Shared>)>> {
    // Little more may be left by a plainer name.
    let most = left_of(found, best) + SHORT;
    let own = &found.fits[best];
    let plain = |f: &Fitted| choices(f) < choices(own) && f.set.len() <= own.set.len();
    let mut near = found.ranked(|f| plain(f) && is_something(f));
    near.retain(|i| left_of(found, *i) <= most);
    let mut levels: Vec<usize> = near.iter().map(|i| choices(&found.fits[*i])).collect();
    levels.sort_unstable();
    levels.dedup();
    for level in levels {
        let group: Vec<usize> = near.iter().copied().filter(|i| choices(&found.fits[*i]) == level).collect();
        for first in group.iter().copied() {
            let Some(shared) = asked(&found.fits[first])? else { continue };
            let share = found.choice.charge(&found.fits[first].names()) / shared.scores.len() as f64;
            let beside: Vec<f64> = shared.scores.iter().map(|s| s - share).collect();
            let as_well = || compared(&found.scores[best], &beside, &found.bootstrap).is_tied();
            if shared.explained >= MOST && (is_left || as_well()) && suffices(&found.fits[first])? {
                let tied = |i: &usize| {
                    let own = [first, *i].map(|i| &found.scores[i]);
                    compared(own[0], own[1], &found.bootstrap).is_tied()
                };
                return Ok(Some((simplest(found, group.into_iter().filter(tied).collect()), Some(shared))));
            }
        }
    }
    Ok(None)
}

/// Share of the base model's misfit above the noise that a model leaves of held-out launches.
fn left_of(found: &Found, model: usize) -> f64 {
    let model = &found.fits[model];
    let noise: f64 = model.told.iter().map(|t| t.count).sum();
    let left = |f: &Fitted| f.squares.iter().sum::<f64>() - noise;
    left(model) / left(&found.base).max(1e-12)
}

/// How many choices were made for a model: its effects, and the shapes that they were given.
fn choices(fit: &Fitted) -> usize {
    let shapes = |e: &&Effect| e.parameters.iter().filter(|p| !p.is_amplitude()).count();
    fit.set.len() + fit.set.iter().map(shapes).sum::<usize>()
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
    large.special_cases.iter().any(|h| h.name == small.name || contains(h, small))
}

#[cfg(test)]
mod tests {
    use super::{contains, is_something};
    use crate::discover::thrown;
    use crate::world::effect::find;

    /// What is drawn is there; of two that do the same only the sum is told, whatever is believed of either.
    #[test]
    fn an_effect_that_the_data_do_not_tell_is_not_there() {
        let of = |set: &[&str]| {
            thrown::fitted(&[0.4; 12], set, 6, |_, f| {
                let slot = f.layout.of_term(0)[0];
                (is_something(f), f.half_widths_without_belief()[slot] / f.half_width(slot))
            })
        };
        let [drag, alone, beside] =
            [&["linear_drag"] as &[&str], &["gravity_error"], &["gravity_error", "wind"]].map(of);
        assert!(
            drag.0 && (0.9..1.2).contains(&drag.1) && (0.9..1.2).contains(&alone.1),
            "{drag:?} {alone:?}"
        );
        assert!(!beside.0 && beside.1 > 10.0, "{beside:?}");
    }

    #[test]
    fn an_effect_contains_what_those_it_holds_contain() {
        let of = |large: &str, small: &str| contains(find(large).unwrap(), find(small).unwrap());
        assert!(of("moving_air", "quadratic_drag") && of("moving_air", "wind"));
        assert!(of("moving_air", "gravity_error"), "by way of wind");
        assert!(!of("quadratic_drag", "moving_air") && !of("lift", "wind"));
    }
}
