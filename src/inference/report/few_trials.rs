//! Report on fewer trials than tell an effect from chance: the size of each effect alone, with its interval.

use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::report::estimates::{effect_estimates, model_scores};
use crate::inference::report::{EffectEstimate, ModelScore, Verdict};
use crate::inference::selection::search::SearchResult;
use crate::inference::selection::{Decision, SETTINGS};

/// Maximum number of listed effects.
const MAX_LISTED: usize = 5;

/// Scores of all models, with the sizes of the effects that fit alike, and a text on these. `names`: of the settings, `trials`: their number.
pub fn single_effects(
    found: &SearchResult,
    decision: &Decision,
    names: &[String],
    trials: usize,
) -> (Vec<ModelScore>, String) {
    let mut scores = model_scores(found, decision, names);
    let single: Vec<usize> = found.ranked(|fit: &FittedModel| fit.effects.len() == 1);
    let best = single.first().map_or(f64::NEG_INFINITY, |i| found.log_posterior[*i]);
    // Those that the best one does not certainly exclude.
    let least = best - SETTINGS.log_odds_of_certainty();
    let alike = single.into_iter().filter(|i| found.log_posterior[*i] > least).take(MAX_LISTED);
    let mut listed = Vec::new();
    for i in alike {
        let fit = &found.fits[i];
        let sizes = effect_estimates(fit, names, |name| decision.inclusion_probability(found, name));
        listed.extend(sizes.iter().map(size_text));
        let own = scores.iter_mut().find(|s| s.effects.iter().eq(fit.effect_names().iter()));
        own.into_iter().for_each(|score| score.sizes.clone_from(&sizes));
    }
    let scene_fits = decision.verdict == Verdict::None;
    let launches = if trials == 1 { "one trial does" } else { "so few trials do" };
    let text = match (listed.len(), scene_fits) {
        (0, _) => String::new(),
        (1, false) => format!(
            "; alone, this effect fits best, but {launches} not tell it from what is peculiar to a trial (95 % interval): {}",
            listed[0]
        ),
        (_, true) => format!(
            "; the scene without effects fits, and {launches} not exclude any of these effects alone (95 % intervals): {}",
            listed.join("; ")
        ),
        (_, false) => format!(
            "; {launches} not tell effects from each other; each of these alone fits alike (95 % intervals): {}",
            listed.join("; ")
        ),
    };
    (scores, text)
}

/// An effect with its parameters and their intervals.
fn size_text(effect: &EffectEstimate) -> String {
    let parameters = effect.parameters.iter().map(|p| {
        let interval = match p.ci95 {
            [Some(low), Some(high)] => format!("{low:.3} to {high:.3}"),
            _ => "not identifiable".into(),
        };
        let unit = if p.unit == "1" { String::new() } else { format!(" {}", p.unit) };
        format!("{} = {:.3}{unit} ({interval})", p.name, p.value)
    });
    format!("{}: {}", effect.name, parameters.collect::<Vec<_>>().join(", "))
}
