//! What windows are predicted to show at a state, without derivatives.

use super::data::SegmentData;
use super::engine::{apply_initial_state, positions_at_observations};
use super::layout::ParameterLayout;
use super::state::FitState;
use crate::discover::window::Segment;
use crate::error::Result;
use crate::task::Scene;
use crate::world::{Rollout, Simulator};

/// Positions at every window's points, two numbers each, m; NaN where a path diverged.
pub fn predict(data: &SegmentData, layout: &ParameterLayout, state: &FitState) -> Result<Vec<Vec<f64>>> {
    let simulated: Vec<(usize, &Segment)> =
        data.segments.iter().enumerate().filter(|(_, w)| w.kind.uses_engine()).collect();
    let scenes: Vec<Scene> =
        simulated.iter().map(|(w, window)| apply_initial_state(window, &state.nuisances[*w])).collect();
    let physics = |(_, window): &(usize, &Segment)| {
        layout.effects_and_latents(&state.values, window.setting, window.start)
    };
    let physics: Vec<_> = simulated.iter().map(physics).collect();
    let rollouts: Vec<Rollout> = scenes
        .iter()
        .zip(&physics)
        .zip(&simulated)
        .map(|((scene, physics), (_, window))| window.rollout(scene, physics))
        .collect();
    let by_engine = Simulator::new(data.engine)
        .map(&rollouts, |i, path| positions_at_observations(simulated[i].1, &path))?;
    let mut by_engine = by_engine.into_iter();
    let of = |(w, window): (usize, &Segment)| match window.kind.uses_engine() {
        true => by_engine.next().unwrap_or_default(),
        false => predict_segment(window, layout, &state.of_segment(w)),
    };
    Ok(data.segments.iter().enumerate().map(of).collect())
}

/// The same of a window that is integrated here, at a state of that window alone.
pub fn predict_segment(window: &Segment, layout: &ParameterLayout, state: &FitState) -> Vec<f64> {
    let nuisances = state.nuisances.first().map_or(&[][..], Vec::as_slice);
    layout
        .segment_physics(window, &state.values_in(0), &state.random_effect_terms(0))
        .predict_positions(nuisances, |_, _| ())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{flights, multi_step_segments, one_step_segments, term};
    use crate::discover::model::linearise;
    use crate::world::Engine;

    /// What is shown is what residuals are taken from.
    #[test]
    fn what_is_shown_is_what_residuals_are_of() {
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        for (windows, settings) in [flights([0.4, 0.0], 2), multi_step_segments(), one_step_segments(0.3)] {
            let data = SegmentData::new(&windows, &settings, vec![1e-3; windows.len()], Engine::Lanes);
            let nuisances = windows.iter().map(|w| w.nuisances.clone()).collect();
            let state = FitState::new(vec![0.2, 0.1], nuisances);
            let shown = predict(&data, &layout, &state).unwrap();
            let looks = linearise(&data, &layout, &state, &[]).unwrap();
            for (w, (window, look)) in windows.iter().zip(&looks).enumerate() {
                assert_eq!(shown[w].len(), 2 * window.observations.len());
                if look.nuisance_jacobian.ncols() > 0 {
                    // Starts take up what they can: of the rest, the residual across them is what was seen less what is shown.
                    let off = nalgebra::DVector::from_fn(look.residual.len(), |i, _| {
                        let point = window.observations.get(i / 2);
                        point.map_or(0.0, |p| {
                            (p.position[i % 2] - shown[w][i]) * look.weights[i / 2] * look.irls_scale
                        })
                    });
                    let rest = &look.nuisance_jacobian
                        * crate::discover::stats::pseudo_inverse(
                            &look.nuisance_jacobian.tr_mul(&look.nuisance_jacobian),
                        )
                        * look.nuisance_jacobian.tr_mul(&off);
                    assert!((off - rest - &look.residual).amax() < 1e-6 * (1.0 + look.residual.amax()));
                }
            }
        }
    }
}
