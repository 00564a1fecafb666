//! What launches have reason to differ by: a model that needs more than that leaves something that it does not name.
//!
//! Sizes that differ from launch to launch, pushes of each launch's own and misfit that changes slowly along paths take up
//! whatever a model leaves. A little of each is what recordings are; a lot of it is a symptom of a force that the model has not.
//! So models are scored with sizes and pushes that differ no more than they have reason to (`components`); where launches are
//! predicted better if they may differ by more, or if more of them changes slowly, the model does not suffice.

use super::components::Likelihood;
use super::decide::{Bootstrap, TIED, compared};
use super::fit::{Fitted, Fitter};
use super::gaussian::{self, Components};
use super::score;
use crate::error::Result;

/// Slow misfit that is nobody's: in units of the noise, and as a share of what the model explains (squares).
const SLOW: [f64; 2] = [0.5, 0.01];

/// Whether a model predicts launches as well where they differ by no more than they have reason to.
pub fn suffices(fitter: &Fitter, base: &Fitted, model: &Fitted, bootstrap: &Bootstrap) -> Result<bool> {
    let Some((_, parts)) = fitter.parts(&model.layout, &model.set, &model.state, &[])? else {
        return Ok(false);
    };
    let slots = &model.prior;
    let blocks = || parts.iter().flat_map(|p| &p.blocks);
    let explained = (base.squares.iter().sum::<f64>() - model.squares.iter().sum::<f64>()).max(0.0);
    let unit: f64 = blocks().map(|b| b.slow.sum()).sum();
    let slow = SLOW[0].max((SLOW[1] * explained / unit.max(1e-12)).sqrt());
    let within = Components { slow: model.components.slow.min(slow), ..model.components.clone() };
    let free = Likelihood::new(&parts, &model.components).most_freely(slots);
    let of = |c: &Components| {
        let told = gaussian::all_told(&parts, c)?;
        score::held_out_with(&parts, &told, slots, &fitter.folds).map(|s| s.0)
    };
    let (Some(free), Some(within)) = (of(&free), of(&within)) else { return Ok(false) };
    Ok(compared(&free, &within, bootstrap).worse < TIED[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::model::{Layout, State};
    use crate::discover::thrown;

    /// With the drag that all launches have nothing more is needed; without it every launch would need a wind of its own.
    #[test]
    fn a_model_that_lacks_a_drag_needs_more_than_launches_have_reason_to() {
        thrown::fitted(&[0.4; 8], &["linear_drag"], 7, |fitter, model| {
            let start = State::new(Vec::new(), model.state.nuisances.clone());
            let base = fitter.fit(Layout::new(&[], Vec::new(), 1), start, 12).unwrap().unwrap();
            let bootstrap = Bootstrap::new(8, 1);
            assert!(suffices(fitter, &base, model, &bootstrap).unwrap());
            assert!(!suffices(fitter, &base, &base, &bootstrap).unwrap());
        });
    }
}
