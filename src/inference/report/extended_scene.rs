//! The scene extended by the selected effects and fitted latents.

use crate::inference::mixed_model::fitted_model::ModelView;
use crate::inference::segment::{Segment, SegmentKind};
use crate::reality::Trial;
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::Latents;

/// The scene with the selected effects, the estimated latents and an initial state, ready for rollouts. If
/// settings differ, uses the first trial's setting.
pub fn extend_scene(
    scene: &Scene,
    trials: &[Trial],
    segments: &[Segment],
    used: &[usize],
    model: ModelView,
) -> Scene {
    let mut out = scene.clone();
    let first = segments.iter().position(|w| !w.kind.is_impact()).unwrap_or(0);
    let setting = segments[first].setting;
    let (terms, latents): (Vec<EffectTerm>, _) =
        model.layout.effects_and_latents(&model.state.values, setting, 0.0);
    out.effects.extend(terms);
    set_latents(&mut out, &latents);
    let trial = &trials[used[segments[first].trial]];
    let segment = &segments[first];
    let fitted = (segment.kind == SegmentKind::Flight)
        .then(|| (segment.scene.bodies[0].name.as_str(), model.state.nuisances[first].as_slice()));
    // A task's scene needs the bodies that an action places: here, the first trial's.
    set_initial_states(&mut out, &trial.scene, fitted);
    out
}

/// Sets the fitted latents on everything that carries them.
fn set_latents(scene: &mut Scene, latents: &Latents) {
    let bodies: Vec<bool> = scene.bodies.iter().map(|b| scene.carries_latents(&b.name)).collect();
    let statics: Vec<bool> = scene.statics.iter().map(|s| scene.carries_latents(&s.name)).collect();
    for (body, _) in scene.bodies.iter_mut().zip(bodies).filter(|(_, c)| *c) {
        body.friction = latents.friction.unwrap_or(body.friction);
        body.restitution = latents.restitution.unwrap_or(body.restitution);
        if latents.density.is_some() {
            // As in the fitted rollouts, density replaces a given mass.
            (body.mass, body.density) = (None, latents.density);
        }
    }
    for (fixed, _) in scene.statics.iter_mut().zip(statics).filter(|(_, c)| *c) {
        fixed.friction = latents.friction.unwrap_or(fixed.friction);
        fixed.restitution = latents.restitution.unwrap_or(fixed.restitution);
    }
}

/// Sets the initial state of every body: `from`'s, and for a segment's single body the fitted one.
pub fn set_initial_states(scene: &mut Scene, from: &Scene, fitted: Option<(&str, &[f64])>) {
    for body in &mut scene.bodies {
        if let Some(start) = from.body(&body.name) {
            body.position = body.position.or(start.position).or(Some([0.0, 0.0]));
            if body.velocity == [0.0, 0.0] {
                body.velocity = start.velocity;
            }
        }
        if let Some((name, [x, y, vx, vy, ..])) = fitted
            && body.name == name
        {
            (body.position, body.velocity) = (Some([*x, *y]), [*vx, *vy]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::ball;
    use crate::task::scene::Body;

    /// Regression test: a body with a given mass kept it and diverged from the fit.
    #[test]
    fn a_fitted_density_replaces_a_given_mass() {
        let mut scene = Scene::from_json(
            r#"{"format": "iplw.scene/1", "carriers": ["ball", "table"],
                "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.1}, "mass": 2},
                           {"name": "cup", "shape": {"type": "disc", "radius": 0.2}, "mass": 3}],
                "statics": [{"name": "table", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}}]}"#,
        )
        .unwrap();
        set_latents(&mut scene, &Latents { density: Some(7.0), friction: None, restitution: Some(0.6) });
        scene.validate().unwrap();
        assert_eq!((scene.bodies[0].mass, scene.bodies[0].density), (None, Some(7.0)));
        assert_eq!((scene.bodies[1].mass, scene.bodies[1].restitution), (Some(3.0), 0.5), "no carrier");
        assert_eq!((scene.statics[0].friction, scene.statics[0].restitution), (1.0, 0.6));
    }

    /// Initial values in the scene are kept; missing ones come from the trial, or from the fit for the fitted
    /// body.
    #[test]
    fn missing_initial_values_are_set() {
        let scene = |position: Option<[f64; 2]>, velocity: [f64; 2]| {
            let body =
                |name: &str| Body { name: name.into(), position, velocity, ..ball().bodies[0].clone() };
            Scene { bodies: ["a", "b"].map(body).to_vec(), ..Scene::empty() }
        };
        let from = scene(Some([1.0, 2.0]), [3.0, 4.0]);
        let starts = |mut own: Scene, fitted: Option<(&str, &[f64])>| {
            set_initial_states(&mut own, &from, fitted);
            own.bodies.iter().map(|b| (b.position.unwrap(), b.velocity)).collect::<Vec<_>>()
        };
        let (observed, fitted) = (([1.0, 2.0], [3.0, 4.0]), ([5.0, 6.0], [7.0, 8.0]));
        assert_eq!(starts(scene(None, [0.0; 2]), Some(("b", &[5.0, 6.0, 7.0, 8.0]))), [observed, fitted]);
        let own = scene(Some([9.0, 9.0]), [0.0, 1.0]);
        assert_eq!(starts(own, None), [([9.0, 9.0], [0.0, 1.0]); 2]);
    }
}
