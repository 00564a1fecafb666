//! Verdict and remaining error as text.

use crate::inference::data::noise::Noise;
use crate::inference::mixed_model::fitted_model::{FittedModel, held_out_square};
use crate::inference::report::prediction_gain::ErrorScale;
use crate::inference::report::{PredictionGain, ResidualLaw, ResidualSummary, UnusedContacts, Verdict};
use crate::inference::segment::Segment;
use crate::inference::selection::search::SearchResult;
use crate::inference::selection::{Decision, SETTINGS};

/// Ratio of the error to the noise floor up to which a model reaches the noise.
const FLOOR_RATIO: f64 = 1.1;

/// Remaining error of the reported model.
pub fn residual_summary(
    base: &FittedModel,
    model: &FittedModel,
    decision: &Decision,
    noise: &Noise,
    gain: &PredictionGain,
    scale: &ErrorScale,
) -> ResidualSummary {
    let [before, after] = [base, model].map(|f| scale.rmse(f.excess_square()));
    let error = gain.held_out.as_ref().map_or(scale.rmse(held_out_square(base)), |g| g.extended_rmse);
    let floor = scale.rmse(scale.floor);
    let text = residual_text([before, after, noise.sd], error, floor);
    ResidualSummary {
        slow_before_m: before,
        slow_after_m: after,
        noise_m: noise.sd,
        explained_share: decision.explained.map(|e| e.share),
        explained_share_interval: decision.explained.map(|e| e.interval),
        unnamed_force_evidence: decision.field_log_bayes_factor,
        text,
    }
}

/// Text on systematic error before and after relative to the noise, and on the held-out error relative to the
/// noise floor; all in m.
fn residual_text([before, after, noise]: [f64; 3], error: f64, floor: f64) -> String {
    let [before, after, noise] = [before, after, noise].map(|v| format!("{:.2} mm", 1e3 * v));
    let slow = match before == after {
        true => format!("systematic error {before}, measurement noise {noise}"),
        false => {
            format!("systematic error {before} before, {after} after; measurement noise {noise}")
        }
    };
    let held_out = match error <= FLOOR_RATIO * floor {
        true => "on held-out trials the error is no larger than the noise".to_string(),
        false => {
            format!("on held-out trials the error is {:.1} times the noise", error / floor.max(1e-12))
        }
    };
    format!("{slow}; {held_out}")
}

/// Text of the verdict; `launches`: number of trials.
pub fn reason(
    found: &SearchResult,
    decision: &Decision,
    remainder: &ResidualSummary,
    launches: usize,
) -> String {
    let names = |i: usize| found.fits[i].effect_names().join(" + ");
    let left = &remainder.text;
    let percent = |i: usize| 100.0 * decision.superset_probability(found, i);
    let further = match decision.is_field_certain() {
        true => "; a further small force, of no law in the library, is certain",
        false => "",
    };
    match (decision.verdict, decision.selected) {
        (Verdict::Named, Some(c)) => format!(
            "{} explains the data: sets with it have {:.0} % of the probability, and no other is credible; {left}{further}",
            names(c),
            percent(c)
        ),
        (Verdict::Ambiguous, Some(c)) => {
            let drags = |i: &usize| found.fits[*i].effects.iter().any(|e| e.opposes_motion);
            let against = match decision.rivals.iter().all(drags) {
                true => "a force against the velocity, its law not identified: ",
                false => "",
            };
            let count = decision.rivals.len();
            format!(
                "{against}{count} sets are credible; {} comes first (sets with it: {:.0} %); {left}{further}",
                names(c),
                percent(c)
            )
        }
        (Verdict::Unknown, Some(c)) if decision.is_balance => format!(
            "nothing falls in these tracks, and motion at a constant speed does not tell which forces balance ({} is the most probable): if \
             the tracks are seen from above, set gravity to 0; if bodies have their terminal speed from the first observation on, record \
             them from the release on; {left}",
            names(c)
        ),
        (Verdict::Unknown, Some(c)) if decision.is_law_open => format!(
            "{} is the nearest in the library, but its law is open: another effect beside it would have the opposite sign; {left}",
            names(c)
        ),
        (Verdict::Unknown, Some(c)) => {
            format!(
                "no set in the library explains the error that trials share; the best, {}, leaves much of it; {left}",
                names(c)
            )
        }
        (Verdict::Unknown, None) => {
            format!("trials share an error that no set in the library explains; {left}")
        }
        _ => format!(
            "the scene without further effects is credible: its probability among the sets tried is {:.0} % ({launches} trials, \
             {} sets tried){}; {left}",
            100.0 * decision.base_probability,
            found.fits.len(),
            possible_effects(found, decision)
        ),
    }
}

/// Effects that are possible although the empty set is credible, most probable first; empty without any.
fn possible_effects(found: &SearchResult, decision: &Decision) -> String {
    let mut names: Vec<&str> = found.fits.iter().flat_map(|f| f.effects.iter().map(|e| e.name)).collect();
    names.sort_unstable();
    names.dedup();
    let mut all: Vec<(f64, &str)> =
        names.into_iter().map(|n| (decision.inclusion_probability(found, n), n)).collect();
    all.retain(|(probability, _)| *probability > SETTINGS.inclusion);
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    let one = |(probability, name): &(f64, &str)| format!("{name} ({:.0} %)", 100.0 * probability);
    match all.is_empty() {
        true => String::new(),
        false => format!("; possible are {}", all.iter().map(one).collect::<Vec<_>>().join(", ")),
    }
}

/// Size of a recording and its noise, as a partial result.
pub fn recording_text(segments: &[Segment], noise: &Noise, trials: usize) -> String {
    let observations: usize = segments.iter().map(|s| s.observations.len()).sum();
    format!(
        "{trials} trials, {observations} positions in {} segments; measurement noise {:.2} mm",
        segments.len(),
        1e3 * noise.sd
    )
}

/// The most probable set of effects, as a partial result.
pub fn search_text(found: &SearchResult) -> Option<String> {
    let best = found.ranked(|_| true).into_iter().next()?;
    let tried = found.fits.len();
    Some(format!(
        "{} is the most probable of {tried} sets of effects",
        found.fits[best].effect_names().join(" + ")
    ))
}

/// Text on the empirical law; empty if none is offered.
pub fn law_text(law: &ResidualLaw) -> String {
    match (law.offered, law.held_out.excess_removed) {
        (true, Some(share)) => format!(
            "; the empirical law {} in the extended scene leaves {:.0} % of the excess error on held-out trials",
            law.formula,
            100.0 * (1.0 - share).max(0.0)
        ),
        _ => String::new(),
    }
}

/// Contacts that are not used; empty without any.
pub fn unused_contacts_text(unused: &[UnusedContacts]) -> String {
    let one = |u: &UnusedContacts| format!("{} {}", u.count, u.reason);
    let all: Vec<String> = unused.iter().map(one).collect();
    if all.is_empty() { String::new() } else { format!("; not used: {}", all.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::throws;

    /// Reaching the noise is stated only where it is true.
    #[test]
    fn residual_text_compares_with_the_noise() {
        let at = |error: f64| residual_text([0.0089, 0.0032, 0.0016], error, 0.002);
        let slow = "systematic error 8.90 mm before, 3.20 mm after; measurement noise 1.60 mm; ";
        assert_eq!(at(0.0021), format!("{slow}on held-out trials the error is no larger than the noise"));
        assert_eq!(at(0.0026), format!("{slow}on held-out trials the error is 1.3 times the noise"));
    }

    /// Only laws that are offered are described.
    #[test]
    fn offered_laws_are_described() {
        let scale = ErrorScale { noise: 0.002, coordinates: 100.0, floor: 90.0, trials: 5 };
        let law = |offered| ResidualLaw {
            formula: "ax = +1.0 y".into(),
            terms: Vec::new(),
            held_out: scale.gain(490.0, 190.0),
            offered,
        };
        let said = law_text(&law(true));
        assert!(said.contains("law ax = +1.0 y") && said.contains("leaves 25 % of the excess"), "{said}");
        assert_eq!(law_text(&law(false)), "");
    }

    #[test]
    fn residual_summary_is_in_metres() {
        throws::with_fit(&[0.4; 6], &[], 2, |_, base| {
            let scale = ErrorScale { noise: throws::NOISE, coordinates: 360.0, floor: 300.0, trials: 6 };
            let noise = Noise { sd: throws::NOISE, rho: 0.0, degrees_of_freedom: 1e3 };
            let decision = throws::decision(Verdict::None);
            let left = residual_summary(base, base, &decision, &noise, &PredictionGain::default(), &scale);
            assert!(
                left.slow_before_m > 5.0 * throws::NOISE && left.slow_before_m == left.slow_after_m,
                "{left:?}"
            );
            assert_eq!((left.noise_m, left.explained_share), (throws::NOISE, None));
        });
    }
}
