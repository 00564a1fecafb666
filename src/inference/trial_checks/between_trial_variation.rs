//! Between-trial variation that exceeds the tolerated one: random accelerations in addition to the reported
//! model.
//!
//! A spin that varies from throw to throw bends every trajectory differently, whether or not the set contains
//! lift. Effects declare a tolerated between-trial standard deviation (`between_trial_sd`); larger variation
//! is reported, with a mean of zero.

use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::random_design::nuisance_accelerations;
use crate::inference::report::{BetweenTrialVariation, round_to_six_digits};

/// Standard deviation from which variation is reported, in declared ones.
pub const MIN_REPORTED_SD: f64 = 0.5;

/// Reported variation, largest first in declared standard deviations.
pub fn between_trial_variation(model: &FittedModel) -> Vec<BetweenTrialVariation> {
    let own = nuisance_accelerations().into_iter().zip(&model.components.accelerations);
    let beside =
        own.filter(|(acceleration, _)| model.effects.iter().all(|e| e.name != acceleration.effect.name));
    let mut out: Vec<(f64, BetweenTrialVariation)> = Vec::new();
    for (acceleration, usual) in beside.filter(|(_, times)| **times > MIN_REPORTED_SD) {
        let moved = |p: &usize| acceleration.values[*p] != acceleration.effect.parameters[*p].neutral;
        let Some(p) = (0..acceleration.values.len()).find(moved) else { continue };
        let parameter = &acceleration.effect.parameters[p];
        let spread = usual * (acceleration.values[p] - parameter.neutral).abs() / acceleration.unit;
        let variation = BetweenTrialVariation {
            effect: acceleration.effect.name.into(),
            parameter: parameter.name.into(),
            spread: round_to_six_digits(spread),
            unit: parameter.unit.into(),
        };
        out.push((*usual, variation));
    }
    out.sort_by(|a, b| b.0.total_cmp(&a.0));
    out.into_iter().map(|o| o.1).collect()
}

/// Text for the report; empty without variation.
pub fn text(all: &[BetweenTrialVariation]) -> String {
    let one =
        |u: &BetweenTrialVariation| format!("{}.{} by {:.3} {}", u.effect, u.parameter, u.spread, u.unit);
    match all.is_empty() {
        true => String::new(),
        false => format!(
            "; launches differ beside it (standard deviation about a mean of nothing): {}",
            all.iter().map(one).collect::<Vec<_>>().join(", ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::throws;
    use crate::world::effect::find;

    /// Reports lift that varies by twice the declared standard deviation, but not less, and not for effects
    /// in the set.
    #[test]
    fn excess_variation_is_reported() {
        throws::with_fit(&[0.4; 6], &["linear_drag"], 5, |fitter, f| {
            assert!(between_trial_variation(f).is_empty());
            let at = nuisance_accelerations().iter().position(|p| p.effect.name == "lift").unwrap();
            let usual = find("lift").unwrap().between_trial_sd[0];
            let with = |times: f64, names: &[&str]| {
                let layout = crate::inference::model::ParameterLayout::new(
                    &[],
                    names.iter().map(|n| crate::inference::testing::segments::term(n)).collect(),
                    1,
                );
                let state = crate::inference::model::FitState::new(
                    layout.initial_values(&[0.0; 3]),
                    f.state.nuisances.clone(),
                );
                let mut fit = fitter.run_gls(layout, state).unwrap().unwrap();
                fit.components.accelerations.fill(0.3);
                fit.components.accelerations[at] = times;
                between_trial_variation(&fit)
            };
            let variation = with(2.0, &["linear_drag"]);
            assert_eq!(
                (variation.len(), variation[0].effect.as_str(), variation[0].unit.as_str()),
                (1, "lift", "1/s")
            );
            assert!((variation[0].spread - 2.0 * usual).abs() < 1e-6);
            assert!(text(&variation).contains("lift.s by 0.400 1/s"), "{}", text(&variation));
            assert!(with(0.4, &["linear_drag"]).is_empty());
            assert!(with(2.0, &["lift"]).is_empty(), "the set has it, and says its spread itself");
        });
    }
}
