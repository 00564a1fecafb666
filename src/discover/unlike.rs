//! What launches differ by beside the reported model: accelerations that each has of its own, by more than every launch may.
//!
//! Whether a set holds an effect or not, a spin that varies from throw to throw bends every path another way. Effects declare how
//! far they may differ without meaning anything (`differs`); what launches differ by more is a finding, though it names no
//! cause that they share. Its mean is nothing, or the effect would be in the set.

use super::columns::pushes;
use super::fit::Fitted;
use super::report::{BetweenTrialVariation, round_to_six_digits};

/// Spread from which it is reported, in what effects declare.
pub const REPORTED: f64 = 0.5;

/// Largest spreads first, in what their effects declare.
pub fn unlike(model: &Fitted) -> Vec<BetweenTrialVariation> {
    let own = pushes().into_iter().zip(&model.components.push);
    let beside = own.filter(|(push, _)| model.set.iter().all(|e| e.name != push.effect.name));
    let mut out: Vec<(f64, BetweenTrialVariation)> = Vec::new();
    for (push, usual) in beside.filter(|(_, times)| **times > REPORTED) {
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
        thrown::fitted(&[0.4; 6], &["linear_drag"], 5, |fitter, f| {
            assert!(unlike(f).is_empty());
            let at = pushes().iter().position(|p| p.effect.name == "lift").unwrap();
            let usual = find("lift").unwrap().between_trial_sd[0];
            let with = |times: f64, names: &[&str]| {
                let layout = crate::discover::model::Layout::new(
                    &[],
                    names.iter().map(|n| crate::discover::fixture::term(n)).collect(),
                    1,
                );
                let state =
                    crate::discover::model::State::new(layout.start(&[0.0; 3]), f.state.nuisances.clone());
                let mut fit = fitter.refined(layout, state).unwrap().unwrap();
                fit.components.push.fill(0.3);
                fit.components.push[at] = times;
                unlike(&fit)
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
