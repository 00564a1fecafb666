//! The base model: the scene with its latents and all nuisances fitted.

use crate::error::Result;
use crate::inference::global_search;
use crate::inference::model::{self, FitEvaluation, FitState, Parameter, ParameterLayout, SegmentData};
use crate::inference::segment::{self, Segment, SegmentKind};
use crate::inference::selection::candidates;
use crate::inference::statistics::median;
use crate::task::Scene;
use crate::trajectory::Trajectory;
use crate::world::effect::EffectTarget;
use crate::world::latent::FACTORS;

/// Residual square per degree of freedom above which a multi-step segment has diverged.
const DIVERGENCE_THRESHOLD: f64 = 30.0;

/// Number of initial guesses of a multi-step segment.
const INITIAL_GUESSES: usize = 3;

/// Initial state of the base model: the scene's latents, by its first body that carries them, and the initial
/// guesses of nuisances.
pub fn initial_fit_state(scene: &Scene, layout: &ParameterLayout, segments: &[Segment]) -> FitState {
    let carrier = scene.bodies.iter().find(|b| scene.carries_latents(&b.name)).unwrap_or(&scene.bodies[0]);
    // Density that corresponds to a given mass.
    let given = carrier.mass.map(|mass| mass / carrier.shape.moments().area);
    let density = carrier.density.or(given).unwrap_or(1.0);
    let values = layout.initial_values(&[density, carrier.friction, carrier.restitution]);
    FitState::new(values, segments.iter().map(|w| w.nuisances.clone()).collect())
}

/// Fits the base model from `start`; sets the noise of contact segments to the median repeatability, and
/// drops diverged multi-step segments. `observed`: observations by trial.
pub fn fit_base_model(
    scene: &Scene,
    data: &mut SegmentData,
    observed: &[&Trajectory],
    layout: &ParameterLayout,
    start: FitState,
    seed: u64,
) -> Result<(FitState, FitEvaluation)> {
    let (mut state, mut evaluation) = first_fit(data, observed, layout, start, seed)?;
    for start in friction_restarts(layout, &state, data.segments) {
        // Sticking contacts have no gradient in friction: restart from low friction.
        let (other, at) = model::fit(data, layout, start, 8)?;
        if model::total_square(&at) < model::total_square(&evaluation) {
            (state, evaluation) = (other, at);
        }
    }
    let blur = contact_noise_scale(scene, data, layout, &state, &evaluation)?;
    for (w, segment) in data.segments.iter().enumerate() {
        if segment.kind.is_impact() {
            data.sd[w] *= blur;
        }
    }
    model::fit(data, layout, state, 6)
}

/// First fit; multi-step segments are initialised from several guesses, and those that stay far off are
/// dropped.
fn first_fit(
    data: &mut SegmentData,
    observed: &[&Trajectory],
    layout: &ParameterLayout,
    mut state: FitState,
    seed: u64,
) -> Result<(FitState, FitEvaluation)> {
    let shooting = segment::any_multi_step(data.segments);
    if shooting {
        state.nuisances = initialise_nuisances(data, observed, layout, &state)?;
    }
    if global_search::is_applicable(data, layout) {
        state = global_search::global_search(data, layout, &state, seed)?;
    }
    let (state, evaluation) = model::fit(data, layout, state, 8)?;
    if !shooting {
        return Ok((state, evaluation));
    }
    drop_diverged(data, &evaluation);
    model::cache_jacobians(data, layout, &state)?;
    model::fit(data, layout, state, 4)
}

/// Drops multi-step segments that diverged.
pub fn drop_diverged(data: &mut SegmentData, evaluation: &FitEvaluation) {
    for (w, segment) in multi_step_segments(data.segments) {
        let left = (2.0 * segment.observations.len() as f64 - segment.nuisances.len() as f64).max(1.0);
        if evaluation.squares[w] > DIVERGENCE_THRESHOLD * left {
            data.sd[w] = f64::INFINITY;
        }
    }
}

fn multi_step_segments(segments: &[Segment]) -> impl Iterator<Item = (usize, &Segment)> {
    segments.iter().enumerate().filter(|(_, w)| w.kind == SegmentKind::MultiStep)
}

/// Nuisances with the best initial guesses of multi-step segments: the same guess for all bodies, or the best
/// for each body.
pub fn initialise_nuisances(
    data: &SegmentData,
    observed: &[&Trajectory],
    layout: &ParameterLayout,
    state: &FitState,
) -> Result<Vec<Vec<f64>>> {
    let mut best: Vec<f64> = vec![f64::INFINITY; data.segments.len()];
    let mut chosen = state.nuisances.clone();
    // By segment and body: smallest square of the body's track, and the guess.
    let own = |w: &Segment| vec![(f64::INFINITY, 0); w.scene.bodies.len()];
    let mut by_body: Vec<Vec<(f64, usize)>> = data.segments.iter().map(own).collect();
    for round in 0..=INITIAL_GUESSES {
        let mut proposed = state.clone();
        for (w, segment) in multi_step_segments(data.segments) {
            let observed = observed[segment.trial];
            let Some(at) = segment.start_index(observed) else { continue };
            let way = |b: usize| if round < INITIAL_GUESSES { round } else { by_body[w][b].1 };
            let of = |(b, track)| {
                segment::initial_state_guess(track, &observed.times, at, segment.scene.gravity, way(b))
            };
            proposed.nuisances[w] = observed.bodies.iter().enumerate().flat_map(of).collect();
        }
        // Guesses are compared after one step.
        let (proposed, evaluation) = model::fit(data, layout, proposed, 1)?;
        for (w, square) in evaluation.squares.iter().enumerate() {
            if *square < best[w] {
                best[w] = *square;
                chosen[w].clone_from(&proposed.nuisances[w]);
            }
        }
        for (w, segment) in multi_step_segments(data.segments) {
            let left = square_by_body(segment, &evaluation.residuals[w]);
            let nearer = |(known, left): (&mut (f64, usize), f64)| {
                if left < known.0 {
                    *known = (left, round);
                }
            };
            by_body[w].iter_mut().zip(left).filter(|_| round < INITIAL_GUESSES).for_each(nearer);
        }
    }
    Ok(chosen)
}

/// Squared residual of each body's track, m^2.
fn square_by_body(segment: &Segment, residuals: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; segment.scene.bodies.len()];
    for (point, off) in segment.observations.iter().zip(residuals.chunks_exact(2)) {
        out[point.body] += off.iter().map(|r| r * r).sum::<f64>();
    }
    out
}

/// Restarts at low friction if friction is estimated from contacts.
fn friction_restarts(layout: &ParameterLayout, state: &FitState, segments: &[Segment]) -> Vec<FitState> {
    let friction = |s: &Parameter| s.latent().is_some_and(|l| FACTORS[l].name == "friction");
    let parameter = layout.parameters.iter().position(friction);
    let Some(parameter) = parameter.filter(|_| segments.iter().any(|w| w.kind.is_impact())) else {
        return Vec::new();
    };
    let at = |friction: f64| {
        let mut other = state.clone();
        other.values[parameter] = friction;
        other
    };
    vec![at(0.1), at(0.25)]
}

/// Median residual of contacts in units of the noise, with every contact law fitted: their repeatability.
fn contact_noise_scale(
    scene: &Scene,
    data: &SegmentData,
    layout: &ParameterLayout,
    state: &FitState,
    base: &FitEvaluation,
) -> Result<f64> {
    let contact = |w: &Segment| w.kind.is_impact();
    if !data.segments.iter().any(contact) {
        return Ok(1.0);
    }
    let laws = candidates::candidates(scene, &candidates::summarise(data.segments)).into_iter();
    let terms: Vec<model::Term> = laws
        .filter(|c| c.effect.target() == EffectTarget::Contact)
        .filter_map(|c| c.starts.into_iter().next())
        .collect();
    let latents: Vec<usize> = layout.parameters.iter().filter_map(Parameter::latent).collect();
    let layout = ParameterLayout::new(&latents, terms, data.setting_count());
    let mut values = layout.initial_values(&[0.0; 3]);
    values[..state.values.len()].copy_from_slice(&state.values);
    let start = FitState::new(values, state.nuisances.clone());
    let (_, helped) = model::fit(data, &layout, start, 8)?;
    let usual = |evaluation: &FitEvaluation| {
        let contacts = (0..data.segments.len()).filter(|w| contact(&data.segments[*w]));
        let left = |w: usize| data.segments[w].impact_degrees_of_freedom().max(1.0);
        median(&contacts.map(|w| evaluation.squares[w] / left(w)).collect::<Vec<_>>())
    };
    Ok(usual(&helped).min(usual(base)).max(1.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::{ball, bounces};
    use crate::world::Engine;
    use crate::world::latent::factor_index;

    /// Regression test: the density of a body with a given mass started at 1.
    #[test]
    fn initial_density_gives_the_scenes_mass() {
        let layout = ParameterLayout::new(&[factor_index("density").unwrap()], Vec::new(), 1);
        let weighed = |scene: &Scene| {
            scene.bodies[0].mass_properties(Some(initial_fit_state(scene, &layout, &[]).values[0]))
        };
        let by_mass = ball();
        assert!((weighed(&by_mass).0 - 0.1).abs() < 1e-12, "{:?}", by_mass.bodies[0].mass);
        let mut by_density = ball();
        (by_density.bodies[0].mass, by_density.bodies[0].density) = (None, Some(7.0));
        assert_eq!(weighed(&by_density), by_density.bodies[0].mass_properties(None));
    }

    /// Recovers a restitution of 0.83 from a scene with 0.5; noise-free bounces keep their noise.
    #[test]
    fn restitution_is_estimated_from_bounces() {
        let (segments, settings) = bounces(0.83, 5);
        let scene = Scene { calibrate: vec!["restitution".into()], ..segments[0].scene.clone() };
        let layout = ParameterLayout::new(&[factor_index("restitution").unwrap()], Vec::new(), 1);
        let mut data = SegmentData::new(&segments, &settings, vec![1e-3; segments.len()], Engine::Auto);
        let start = initial_fit_state(&scene, &layout, &segments);
        let (state, evaluation) = fit_base_model(&scene, &mut data, &[], &layout, start, 0).unwrap();
        assert!((state.values[0] - 0.83).abs() < 1e-4, "{:?}", state.values);
        assert!(evaluation.residuals.iter().flatten().all(|r| r.abs() < 1e-4));
        assert!(data.sd.iter().all(|sd| *sd == 1e-3), "nothing blurs them");
    }
}
