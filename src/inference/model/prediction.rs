//! Predictions at a state, without derivatives.

use super::engine_linearization::{apply_initial_state, positions_at_observations};
use super::fit_state::FitState;
use super::parameters::ParameterLayout;
use super::segment_data::SegmentData;
use crate::error::Result;
use crate::inference::segment::Segment;
use crate::task::Scene;
use crate::world::{Rollout, Simulator};

/// Positions at every segment's observations, two numbers each, m; NaN if a trajectory diverged.
pub fn predict(data: &SegmentData, layout: &ParameterLayout, state: &FitState) -> Result<Vec<Vec<f64>>> {
    let simulated: Vec<(usize, &Segment)> =
        data.segments.iter().enumerate().filter(|(_, w)| w.kind.uses_engine()).collect();
    let scenes: Vec<Scene> =
        simulated.iter().map(|(w, segment)| apply_initial_state(segment, &state.nuisances[*w])).collect();
    let physics = |(_, segment): &(usize, &Segment)| {
        layout.effects_and_latents(&state.values, segment.setting, segment.start)
    };
    let physics: Vec<_> = simulated.iter().map(physics).collect();
    let rollouts: Vec<Rollout> = scenes
        .iter()
        .zip(&physics)
        .zip(&simulated)
        .map(|((scene, physics), (_, segment))| segment.rollout(scene, physics))
        .collect();
    let by_engine = Simulator::new(data.engine)
        .budget(&data.progress)
        .map(&rollouts, |i, path| positions_at_observations(simulated[i].1, &path))?;
    let mut by_engine = by_engine.into_iter();
    let of = |w: usize, segment: &Segment| match segment.kind.uses_engine() {
        true => by_engine.next().unwrap_or_default(),
        false => predict_segment(segment, layout, &state.of_segment(w)),
    };
    data.each_segment(of)
}

/// The same for a segment of `dynamics`, at a state of that segment alone.
pub fn predict_segment(segment: &Segment, layout: &ParameterLayout, state: &FitState) -> Vec<f64> {
    let nuisances = state.nuisances.first().map_or(&[][..], Vec::as_slice);
    layout
        .segment_physics(segment, &state.values_in(0), &state.random_effect_terms(0))
        .predict_positions(nuisances, |_, _| ())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::model::linearise;
    use crate::inference::testing::segments::{flights, multi_step_segments, one_step_segments, term};
    use crate::world::Engine;

    /// Predictions agree with the residuals of the linearization.
    #[test]
    fn predictions_match_residuals() {
        let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
        for (segments, settings) in [flights([0.4, 0.0], 2), multi_step_segments(), one_step_segments(0.3)] {
            let data = SegmentData::new(&segments, &settings, vec![1e-3; segments.len()], Engine::Lanes);
            let nuisances = segments.iter().map(|w| w.nuisances.clone()).collect();
            let state = FitState::new(vec![0.2, 0.1], nuisances);
            let view = predict(&data, &layout, &state).unwrap();
            let linearizations = linearise(&data, &layout, &state, &[]).unwrap();
            for (w, (segment, linearization)) in segments.iter().zip(&linearizations).enumerate() {
                assert_eq!(view[w].len(), 2 * segment.observations.len());
                if linearization.nuisance_jacobian.ncols() > 0 {
                    // Nuisances are projected out of the residual.
                    let off = nalgebra::DVector::from_fn(linearization.residual.len(), |i, _| {
                        let point = segment.observations.get(i / 2);
                        point.map_or(0.0, |p| {
                            (p.position[i % 2] - view[w][i])
                                * linearization.weights[i / 2]
                                * linearization.irls_scale
                        })
                    });
                    let rest = &linearization.nuisance_jacobian
                        * crate::inference::statistics::pseudo_inverse(
                            &linearization.nuisance_jacobian.tr_mul(&linearization.nuisance_jacobian),
                        )
                        * linearization.nuisance_jacobian.tr_mul(&off);
                    assert!(
                        (off - rest - &linearization.residual).amax()
                            < 1e-6 * (1.0 + linearization.residual.amax())
                    );
                }
            }
        }
    }
}
