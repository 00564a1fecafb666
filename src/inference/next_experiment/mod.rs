//! Next experiment: a throw or an action that discriminates the rivals, or an instrument check if none does.

mod discrimination;
mod planned_flight;

use crate::error::Result;
use crate::inference::config::DiagnosisConfig;
use crate::inference::data::noise::Noise;
use crate::inference::mixed_model::fitted_model::FittedModel;
use crate::inference::next_experiment::discrimination::{Discrimination, REPEATS, best_throw};
use crate::inference::report::{RecommendedExperiment, Verdict};
use crate::inference::segment::{Segment, SegmentKind};
use crate::inference::selection::SharedDiscrepancy;
use crate::task::{Placement, Scene};
use crate::trajectory::Trajectory;
use crate::world::effect::{Effect, REGISTRY};
use crate::world::{Rollout, Simulator};

/// Maximum number of actions that are compared.
const MAX_ACTIONS: usize = 24;
/// Maximum number of rivals that are compared.
const MAX_RIVALS: usize = 6;

/// The next experiment; `None` if there is nothing to discriminate. `rivals`: the models that it should discriminate, most
/// probable first.
pub fn next_experiment(
    scene: &Scene,
    segments: &[Segment],
    rivals: &[&FittedModel],
    verdict: Verdict,
    discrepancy: Option<&SharedDiscrepancy>,
    noise: &Noise,
    config: &DiagnosisConfig,
) -> Result<Option<RecommendedExperiment>> {
    if verdict == Verdict::Unknown {
        return Ok(Some(RecommendedExperiment {
            why: "no set in the library explains what is left".into(),
            action:
                "repeat one launch exactly, at another hour and with the body turned: what stays the same is \
                     physics of the scene, what changes is of the day or the body"
                    .into(),
            separates: Vec::new(),
            scene: None,
        }));
    }
    if rivals.len() < 2 {
        return Ok(None);
    }
    let own = &rivals[..rivals.len().min(MAX_RIVALS)];
    match segments.iter().position(|w| !w.kind.is_impact()) {
        Some(w) if matches!(segments[w].kind, SegmentKind::FromInitialState | SegmentKind::OneStep) => {
            action_experiment(scene, &segments[w], [own[0], own[1]], noise, config)
        }
        _ => Ok(throw_experiment(segments, own, discrepancy, noise, config.seed)),
    }
}

fn label(fit: &FittedModel) -> String {
    match fit.effects.is_empty() {
        true => "no further effect".into(),
        false => fit.effect_names().join(" + "),
    }
}

fn effect_names(fits: &[&FittedModel]) -> Vec<String> {
    let mut names: Vec<String> = fits.iter().flat_map(|f| f.effect_names()).map(|n| n.to_string()).collect();
    names.sort();
    names.dedup();
    names
}

/// A throw, and instrument checks for rivals that no throw discriminates.
fn throw_experiment(
    segments: &[Segment],
    rivals: &[&FittedModel],
    discrepancy: Option<&SharedDiscrepancy>,
    noise: &Noise,
    seed: u64,
) -> Option<RecommendedExperiment> {
    let found = best_throw(segments, rivals, discrepancy, noise, seed);
    let apart = |i: usize, j: usize| {
        found.as_ref().is_some_and(|found| found.pairs.contains(&[i, j]) || found.pairs.contains(&[j, i]))
    };
    let mut twins: Vec<usize> = Vec::new();
    for j in 0..rivals.len() {
        for i in (0..rivals.len()).filter(|i| *i != j && !apart(*i, j)) {
            twins.extend([i, j]);
        }
    }
    // In the registry's order.
    let view = |e: &&&Effect| twins.iter().any(|i| rivals[*i].effect_names().contains(&e.name));
    let checks: Vec<&str> = REGISTRY.iter().filter(view).filter_map(|e| e.instrument_check).collect();
    let sets = rivals.iter().map(|f| label(f)).collect::<Vec<_>>().join(", ");
    let (mut actions, mut why, mut scene) = (Vec::new(), format!("{sets} tie"), None);
    if let Some(Discrimination { throw, pairs, success_rate }) = &found
        && !pairs.is_empty()
    {
        actions.push(format!("{}; {REPEATS:.0} times", throw.description));
        let share = match *success_rate {
            1.0 => "all".into(),
            rate => format!("at least {:.0} %", 100.0 * rate),
        };
        why += &format!(
            "; in {share} of the simulated outcomes this decides between {}",
            if twins.is_empty() { "all of them" } else { "those that a flight can tell apart" },
        );
        scene = Some(throw.segment.scene.clone());
    }
    if !checks.is_empty() {
        actions.push(checks.join("; "));
        why += "; no launch tells an instrument's error from physics that looks the same";
    }
    if actions.is_empty() {
        actions.push("measure more trials, over as wide a range of speeds and places as can be".into());
    }
    Some(RecommendedExperiment {
        why,
        action: actions.join("; and "),
        separates: effect_names(rivals),
        scene,
    })
}

/// The action for which the predictions of two rivals differ most.
fn action_experiment(
    scene: &Scene,
    segment: &Segment,
    rivals: [&FittedModel; 2],
    noise: &Noise,
    config: &DiagnosisConfig,
) -> Result<Option<RecommendedExperiment>> {
    let trials = actions(scene, segment);
    let physics = rivals.map(|f| f.layout.effects_and_latents(&f.state.values, 0, 0.0));
    let mut rollouts = Vec::new();
    for (_, scene) in &trials {
        for (effects, latents) in &physics {
            rollouts.push(Rollout { latents: *latents, effects, stop_at_goal: false, ..Rollout::of(scene) });
        }
    }
    let paths = Simulator::new(config.engine).run(&rollouts)?;
    let apart = |i: usize| max_distance(&paths[2 * i], &paths[2 * i + 1]);
    let Some(best) = (0..trials.len()).max_by(|i, j| apart(*i).total_cmp(&apart(*j))) else {
        return Ok(None);
    };
    Ok(Some(RecommendedExperiment {
        why: format!(
            "{} and {} tie; here their predictions part by {:.3} m, {:.0} times the noise",
            label(rivals[0]),
            label(rivals[1]),
            apart(best),
            apart(best) / noise.sd
        ),
        action: trials[best].0.clone(),
        separates: effect_names(&rivals),
        scene: Some(trials[best].1.clone()),
    }))
}

/// Actions of a task, spread over its action space.
fn actions(scene: &Scene, segment: &Segment) -> Vec<(String, Scene)> {
    let Some(space) = &scene.action else {
        return vec![("repeat the trial for twice as long".into(), {
            let mut scene = segment.scene.clone();
            scene.steps *= 2;
            scene
        })];
    };
    let count = space.count();
    let mut out = Vec::new();
    for k in 0..40 * MAX_ACTIONS {
        let Ok(action) = space.at(k * 7919 % count) else { continue };
        if let Placement::Valid(placed) = space.place(&segment.scene, &action) {
            let mut placed = *placed;
            placed.steps = placed.steps.max(scene.steps);
            placed.observe_every = scene.observe_every;
            out.push((format!("action {:?}", action.values()), placed));
        }
        if out.len() == MAX_ACTIONS {
            break;
        }
    }
    out
}

/// Largest distance between two paths, m.
fn max_distance(a: &Trajectory, b: &Trajectory) -> f64 {
    let mut most = 0.0f64;
    for (p, q) in a.bodies.iter().zip(&b.bodies) {
        for i in 0..p.len().min(q.len()) {
            let d = (p.x[i] - q.x[i]).hypot(p.y[i] - q.y[i]);
            most = if d.is_finite() { most.max(d) } else { most };
        }
    }
    most
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::{ball, fitted_models};

    #[test]
    fn next_experiment_is_a_throw_or_an_instrument_check() {
        let (segments, fits, noise) = fitted_models(&[&["gravity_error"], &["position_scale"], &[]]);
        let ask = |rivals: &[usize], verdict| {
            let rivals: Vec<&FittedModel> = rivals.iter().map(|i| &fits[*i]).collect();
            next_experiment(&ball(), &segments, &rivals, verdict, None, &noise, &DiagnosisConfig::standard(0))
                .unwrap()
        };
        let trial = ask(&[0, 2], Verdict::Ambiguous).unwrap();
        let start = &trial.scene.expect("it can be simulated").bodies[0];
        assert!(start.position.is_some() && trial.action.ends_with("6 times"), "{}", trial.action);
        assert_eq!(trial.separates, ["gravity_error"]);
        let linearization = ask(&[0, 1], Verdict::Ambiguous).unwrap();
        let check = crate::world::effect::find("position_scale").unwrap().instrument_check.unwrap();
        assert!(linearization.action.contains(check), "{}", linearization.action);
        // With the verdict `none`, a throw is proposed that shows whether an effect that is still possible acts.
        let trial = ask(&[2, 0], Verdict::None).unwrap();
        assert!(trial.scene.is_some() && trial.why.contains("no further effect"), "{}", trial.why);
        assert!(ask(&[0], Verdict::Named).is_none() && ask(&[], Verdict::None).is_none());
        assert!(ask(&[0], Verdict::Unknown).unwrap().action.starts_with("repeat one launch"));
    }
}
