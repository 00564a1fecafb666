//! What launches differ by beside the reported model: accelerations that each has of its own, by more than every launch may.
//!
//! Whether a set holds an effect or not, a spin that varies from throw to throw bends every path another way. Effects declare how
//! far they may differ without meaning anything (`differs`); what launches differ by more is a finding, though it names no
//! cause that they share. Its mean is nothing, or the effect would be in the set.

use super::columns::nuisance_accelerations;
use super::fit::FittedModel;
use super::report::{BetweenTrialVariation, round_to_six_digits};

/// Spread from which it is reported, in what effects declare.
pub const MIN_REPORTED_SD: f64 = 0.5;

/// Largest spreads first, in what their effects declare.
pub fn between_trial_variation(model: &FittedModel) -> Vec<BetweenTrialVariation> {
    let own = nuisance_accelerations().into_iter().zip(&model.components.accelerations);
    let beside = own.filter(|(push, _)| model.effects.iter().all(|e| e.name != push.effect.name));
    let mut out: Vec<(f64, BetweenTrialVariation)> = Vec::new();
    for (push, usual) in beside.filter(|(_, times)| **times > MIN_REPORTED_SD) {
        let moved = |p: &usize| push.values[*p] != push.effect.parameters[*p].neutral;
        let Some(p) = (0..push.values.len()).find(moved) else { continue };
        let parameter = &push.effect.parameters[p];
        let spread = usual * (push.values[p] - parameter.neutral).abs() / push.unit;
        let told = BetweenTrialVariation {
            effect: push.effect.name.into(),
            parameter: parameter.name.into(),
            spread: round_to_six_digits(spread),
            unit: parameter.unit.into(),
        };
        out.push((*usual, told));
    }
    out.sort_by(|a, b| b.0.total_cmp(&a.0));
    out.into_iter().map(|o| o.1).collect()
}

/// The same in words; nothing where launches are alike.
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
    use crate::discover::thrown;
    use crate::world::effect::find;

    /// A lift that varies by twice what every launch may is said, and so is nothing that varies by less, or that the set holds.
    #[test]
    fn what_differs_by_more_than_it_may_is_said() {
        thrown::with_fit(&[0.4; 6], &["linear_drag"], 5, |fitter, f| {
            assert!(between_trial_variation(f).is_empty());
            let at = nuisance_accelerations().iter().position(|p| p.effect.name == "lift").unwrap();
            let usual = find("lift").unwrap().between_trial_sd[0];
            let with = |times: f64, names: &[&str]| {
                let layout = crate::discover::model::ParameterLayout::new(
                    &[],
                    names.iter().map(|n| crate::discover::fixture::term(n)).collect(),
                    1,
                );
                let state = crate::discover::model::FitState::new(
                    layout.initial_values(&[0.0; 3]),
                    f.state.nuisances.clone(),
                );
                let mut fit = fitter.run_gls(layout, state).unwrap().unwrap();
                fit.components.accelerations.fill(0.3);
                fit.components.accelerations[at] = times;
                between_trial_variation(&fit)
            };
            let told = with(2.0, &["linear_drag"]);
            assert_eq!((told.len(), told[0].effect.as_str(), told[0].unit.as_str()), (1, "lift", "1/s"));
            assert!((told[0].spread - 2.0 * usual).abs() < 1e-6);
            assert!(text(&told).contains("lift.s by 0.400 1/s"), "{}", text(&told));
            assert!(with(0.4, &["linear_drag"]).is_empty());
            assert!(with(2.0, &["lift"]).is_empty(), "the set has it, and says its spread itself");
        });
    }
}
