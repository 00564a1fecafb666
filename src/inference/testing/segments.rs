//! Synthetic segments with known truth, for unit tests.

use crate::inference::data::noise::Noise;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::model::{FitState, ParameterLayout, SegmentData, Term};
use crate::inference::segment::{Segment, SegmentKind, segment_trials};
use crate::progress::NoProgress;
use crate::reality::{Trial, trials_from_csv};
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::effect::find;
use crate::world::{Engine, Rollout, Simulator};

/// A ball of 5 cm above a floor.
pub fn ball() -> Scene {
    Scene::from_json(
        r#"{"format": "iplw.scene/1", "gravity": [0, -9.81], "time_step": 0.005,
            "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.05}, "mass": 0.1}],
            "statics": [{"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}]}"#,
    )
    .unwrap()
}

/// Trials of [`ball`], observed at (t, x, y).
pub fn observed_trials(trials: &[Vec<[f64; 3]>]) -> Vec<Trial> {
    let rows = trials
        .iter()
        .enumerate()
        .flat_map(|(i, rows)| rows.iter().map(move |[t, x, y]| format!("{i},{t},ball,{x},{y}\n")));
    let csv: String = std::iter::once("trial,t,body,x,y\n".to_string()).chain(rows).collect();
    trials_from_csv(&csv, &ball()).unwrap()
}

/// Segments of trials of one setting, and the settings.
fn segments(base: &Scene, trials: &[Trial]) -> (Vec<Segment>, Vec<usize>) {
    let settings = vec![0; trials.len()];
    (segment_trials(base, trials, &settings, 8, &NoProgress).unwrap().segments, settings)
}

/// Throws at 3 m/s sideways and 4 m/s or more upwards in a wind, m/s^2, observed 20 times in 0.76 s without
/// noise: one flight each.
pub fn flights(wind: [f64; 2], count: usize) -> (Vec<Segment>, Vec<usize>) {
    let at = |k: usize, t: f64| {
        let up = 4.0 + 0.2 * k as f64;
        [t, 3.0 * t + 0.5 * wind[0] * t * t, 1.0 + up * t + 0.5 * (wind[1] - 9.81) * t * t]
    };
    let trial = |k: usize| (0..20).map(|i| at(k, 0.04 * f64::from(i))).collect();
    let (segments, settings) =
        segments(&ball(), &observed_trials(&(0..count).map(trial).collect::<Vec<_>>()));
    assert!(segments.len() == count && segments.iter().all(|w| w.kind == SegmentKind::Flight));
    (segments, settings)
}

/// Bounces without friction and with some restitution, observed every 0.02 s without noise; the scene's
/// friction is 0 and the floor's restitution 1.
pub fn bounces(restitution: f64, count: usize) -> (Vec<Segment>, Vec<usize>) {
    let mut base = ball();
    base.bodies[0].friction = 0.0;
    base.statics[0].restitution = 1.0;
    let trial = |k: usize| {
        let height = 0.8 + 0.1 * k as f64;
        let fallen = (2.0 * height / 9.81f64).sqrt();
        let at = |i: u32| {
            let (t, up) = (0.02 * f64::from(i), restitution * 9.81 * fallen);
            let since = t - fallen;
            let y = if since < 0.0 { height - 4.905 * t * t } else { up * since - 4.905 * since * since };
            [t, t, 0.05 + y]
        };
        (0..40).map(at).collect()
    };
    let trials = observed_trials(&(0..count).map(trial).collect::<Vec<_>>());
    segments(&base, &trials.into_iter().map(|t| Trial { scene: base.clone(), ..t }).collect::<Vec<_>>())
}

/// Two balls thrown in a wind along x, m/s^2, fully observed 9 times in 0.8 s, simulated by an engine.
fn two_balls(wind: f64) -> (Scene, Trial) {
    let scene = Scene::from_json(
        r#"{"format": "iplw.scene/1", "gravity": [0, -9.81], "time_step": 0.005, "steps": 160, "observe_every": 20,
            "bodies": [{"name": "a", "shape": {"type": "disc", "radius": 0.05}, "position": [0, 5], "velocity": [3, 1]},
                       {"name": "b", "shape": {"type": "disc", "radius": 0.05}, "position": [9, 5], "velocity": [1, 2]}]}"#,
    )
    .unwrap();
    let term = EffectTerm { name: "wind".into(), parameters: [("ax".to_string(), wind)].into() };
    let rollout = Rollout { effects: &[term], stop_at_goal: false, ..Rollout::of(&scene) };
    let observed = Simulator::new(Engine::Lanes).run(&[rollout]).unwrap().remove(0);
    (scene.clone(), Trial { name: String::new(), setting: None, scene, observed })
}

/// One-step segments of one trial.
pub fn one_step_segments(wind: f64) -> (Vec<Segment>, Vec<usize>) {
    let (scene, trial) = two_balls(wind);
    let (segments, settings) = segments(&scene, &[trial]);
    assert!(segments.len() == 8 && segments.iter().all(|w| w.kind == SegmentKind::OneStep));
    (segments, settings)
}

/// A multi-step segment of a trial without wind.
pub fn multi_step_segments() -> (Vec<Segment>, Vec<usize>) {
    let (scene, mut trial) = two_balls(0.0);
    trial.observed.bodies.iter_mut().for_each(|b| b.omega.fill(f64::NAN));
    let (mut segments, settings) = segments(&scene, &[trial]);
    segments.retain(|w| w.kind == SegmentKind::MultiStep);
    segments.truncate(1);
    assert_eq!(segments.len(), 1);
    (segments, settings)
}

/// A term with all parameters free, at its neutral values.
pub fn term(name: &str) -> Term {
    let effect = find(name).unwrap();
    let start = effect.parameters.iter().map(|p| p.neutral).collect();
    let free = vec![true; effect.parameters.len()];
    Term { effect, per_setting: false, start, free, fd_step: None, bracket: None }
}

/// Flights under weaker gravity, models with some effects fitted to them, and the noise.
pub fn fitted_models(sets: &[&[&str]]) -> (Vec<Segment>, Vec<FittedModel>, Noise) {
    let (segments, settings) = flights([0.0, 0.4], 6);
    let noise = Noise { sd: 1e-3, rho: 0.0, degrees_of_freedom: 1e3 };
    let data = SegmentData::new(&segments, &settings, vec![1e-3; 6], Engine::Auto);
    let fitter = ModelFitter::new(&data, &noise);
    let fit = |names: &&[&str]| {
        let layout = ParameterLayout::new(&[], names.iter().map(|n| term(n)).collect(), 1);
        let nuisances = segments.iter().map(|w| w.nuisances.clone()).collect();
        let start = FitState::new(layout.initial_values(&[0.0; 3]), nuisances);
        fitter.fit(layout, start, 8).unwrap().expect("it can be fitted")
    };
    let fits = sets.iter().map(fit).collect();
    (segments, fits, noise)
}
