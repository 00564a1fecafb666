//! The base model: the scene as it is, with its latents and every window's start fitted.

use super::library;
use super::model::{self, FitEvaluation, FitState, Parameter, ParameterLayout, SegmentData};
use super::stats::median;
use super::survey;
use super::window::{self, Segment, SegmentKind};
use crate::error::Result;
use crate::task::Scene;
use crate::trajectory::Trajectory;
use crate::world::effect::EffectTarget;
use crate::world::latent::FACTORS;

/// Square of a shot's residual, over what noise leaves, beyond which its collisions went another way than simulated.
const DIVERGENCE_THRESHOLD: f64 = 30.0;

/// Ways of guessing a shot's start.
const INITIAL_GUESSES: usize = 3;

/// Where the base model starts: the scene's own latents, as its first body that carries them has them, and guesses of starts.
pub fn initial_fit_state(scene: &Scene, layout: &ParameterLayout, windows: &[Segment]) -> FitState {
    let carrier = scene.bodies.iter().find(|b| scene.carries_latents(&b.name)).unwrap_or(&scene.bodies[0]);
    // A body that gives its mass has the density that this mass stands for.
    let given = carrier.mass.map(|mass| mass / carrier.shape.moments().area);
    let density = carrier.density.or(given).unwrap_or(1.0);
    let values = layout.initial_values(&[density, carrier.friction, carrier.restitution]);
    FitState::new(values, windows.iter().map(|w| w.nuisances.clone()).collect())
}

/// Fits the base model from `start`. Contacts are given as much noise as the usual one shows; shots that go another way
/// than simulated are left out of `data`. `observed`: what was seen, by trial.
pub fn fit_base_model(
    scene: &Scene,
    data: &mut SegmentData,
    observed: &[&Trajectory],
    layout: &ParameterLayout,
    start: FitState,
    seed: u64,
) -> Result<(FitState, FitEvaluation)> {
    let (mut state, mut pass) = first_fit(data, observed, layout, start, seed)?;
    for start in friction_restarts(layout, &state, data.segments) {
        // A contact that grips as simulated says nothing of a friction at which it would slide.
        let (other, at) = model::fit(data, layout, start, 8)?;
        if model::total_square(&at) < model::total_square(&pass) {
            (state, pass) = (other, at);
        }
    }
    let blur = contact_noise_scale(scene, data, layout, &state, &pass)?;
    for (w, window) in data.segments.iter().enumerate() {
        if window.kind == SegmentKind::Contact {
            data.sd[w] *= blur;
        }
    }
    model::fit(data, layout, state, 6)
}

/// A first fit. Shots try several guesses of their starts first; those that stay far off are left out for good.
fn first_fit(
    data: &mut SegmentData,
    observed: &[&Trajectory],
    layout: &ParameterLayout,
    mut state: FitState,
    seed: u64,
) -> Result<(FitState, FitEvaluation)> {
    let shooting = window::any_multi_step(data.segments);
    if shooting {
        state.nuisances = initialise_nuisances(data, observed, layout, &state)?;
    }
    if survey::is_applicable(data, layout) {
        state = survey::global_search(data, layout, &state, seed)?;
    }
    let (state, pass) = model::fit(data, layout, state, 8)?;
    if !shooting {
        return Ok((state, pass));
    }
    drop_diverged(data, &pass);
    model::cache_jacobians(data, layout, &state)?;
    model::fit(data, layout, state, 4)
}

/// Leaves shots out whose collisions went another way than simulated.
pub fn drop_diverged(data: &mut SegmentData, pass: &FitEvaluation) {
    for (w, window) in multi_step_segments(data.segments) {
        let left = (2.0 * window.observations.len() as f64 - window.nuisances.len() as f64).max(1.0);
        if pass.squares[w] > DIVERGENCE_THRESHOLD * left {
            data.sd[w] = f64::INFINITY;
        }
    }
}

fn multi_step_segments(windows: &[Segment]) -> impl Iterator<Item = (usize, &Segment)> {
    windows.iter().enumerate().filter(|(_, w)| w.kind == SegmentKind::MultiStep)
}

/// Nuisances with those guesses of shots' starts that come nearest: of all bodies alike, or each body's own best.
pub fn initialise_nuisances(
    data: &SegmentData,
    observed: &[&Trajectory],
    layout: &ParameterLayout,
    state: &FitState,
) -> Result<Vec<Vec<f64>>> {
    let mut best: Vec<f64> = vec![f64::INFINITY; data.segments.len()];
    let mut chosen = state.nuisances.clone();
    // By window and body: the least that a guess left of the body's own track, and which guess.
    let own = |w: &Segment| vec![(f64::INFINITY, 0); w.scene.bodies.len()];
    let mut by_body: Vec<Vec<(f64, usize)>> = data.segments.iter().map(own).collect();
    for round in 0..=INITIAL_GUESSES {
        let mut tried = state.clone();
        for (w, window) in multi_step_segments(data.segments) {
            let observed = observed[window.trial];
            let Some(at) = window.start_index(observed) else { continue };
            let way = |b: usize| if round < INITIAL_GUESSES { round } else { by_body[w][b].1 };
            let of = |(b, track)| {
                window::initial_state_guess(track, &observed.times, at, window.scene.gravity, way(b))
            };
            tried.nuisances[w] = observed.bodies.iter().enumerate().flat_map(of).collect();
        }
        // One step shows how near each guess comes.
        let (tried, pass) = model::fit(data, layout, tried, 1)?;
        for (w, square) in pass.squares.iter().enumerate() {
            if *square < best[w] {
                best[w] = *square;
                chosen[w].clone_from(&tried.nuisances[w]);
            }
        }
        for (w, window) in multi_step_segments(data.segments) {
            let left = square_by_body(window, &pass.residuals[w]);
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

/// Sum of squares that is left of each body's track, m^2.
fn square_by_body(window: &Segment, residuals: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; window.scene.bodies.len()];
    for (point, off) in window.observations.iter().zip(residuals.chunks_exact(2)) {
        out[point.body] += off.iter().map(|r| r * r).sum::<f64>();
    }
    out
}

/// The same state at other frictions, where friction is to be found from contacts of one disc.
fn friction_restarts(layout: &ParameterLayout, state: &FitState, windows: &[Segment]) -> Vec<FitState> {
    let friction = |s: &Parameter| s.latent().is_some_and(|l| FACTORS[l].name == "friction");
    let slot = layout.parameters.iter().position(friction);
    let Some(slot) = slot.filter(|_| windows.iter().any(|w| w.kind == SegmentKind::Contact)) else {
        return Vec::new();
    };
    let at = |friction: f64| {
        let mut other = state.clone();
        other.values[slot] = friction;
        other
    };
    vec![at(0.1), at(0.25)]
}

/// How far contacts repeat, in units of the noise: what the usual bounce leaves when every law of contact helps.
fn contact_noise_scale(
    scene: &Scene,
    data: &SegmentData,
    layout: &ParameterLayout,
    state: &FitState,
    base: &FitEvaluation,
) -> Result<f64> {
    let contact = |w: &Segment| w.kind == SegmentKind::Contact;
    if !data.segments.iter().any(contact) {
        return Ok(1.0);
    }
    let laws = library::candidates(scene, &library::summarise(data.segments)).into_iter();
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
    let usual = |pass: &FitEvaluation| {
        let contacts = (0..data.segments.len()).filter(|w| contact(&data.segments[*w]));
        let left = |w: usize| (2.0 * data.segments[w].observations.len() as f64 - 5.0).max(1.0);
        median(&contacts.map(|w| pass.squares[w] / left(w)).collect::<Vec<_>>())
    };
    Ok(usual(&helped).min(usual(base)).max(1.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{ball, bounces};
    use crate::world::Engine;
    use crate::world::latent::factor_index;

    /// A body that gave its mass was started at a density of 1, from where a survey never came to that of a heavy ball.
    #[test]
    fn at_the_start_every_carrier_weighs_what_its_scene_says() {
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

    /// Bounces of 0.83 are found from where the scene has 0.5, and repeat as well as they were seen.
    #[test]
    fn restitution_is_found_from_bounces() {
        let (windows, settings) = bounces(0.83, 5);
        let scene = Scene { calibrate: vec!["restitution".into()], ..windows[0].scene.clone() };
        let layout = ParameterLayout::new(&[factor_index("restitution").unwrap()], Vec::new(), 1);
        let mut data = SegmentData::new(&windows, &settings, vec![1e-3; windows.len()], Engine::Auto);
        let start = initial_fit_state(&scene, &layout, &windows);
        let (state, pass) = fit_base_model(&scene, &mut data, &[], &layout, start, 0).unwrap();
        assert!((state.values[0] - 0.83).abs() < 1e-4, "{:?}", state.values);
        assert!(pass.residuals.iter().flatten().all(|r| r.abs() < 1e-4));
        assert!(data.sd.iter().all(|sd| *sd == 1e-3), "nothing blurs them");
    }
}
