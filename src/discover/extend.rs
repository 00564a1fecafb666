//! The scene with what was found, so that it rolls out.

use super::fit::Shown;
use super::window::{Kind, Window};
use crate::reality::Trial;
use crate::task::Scene;
use crate::task::scene::EffectTerm;

/// The scene with the found effects, the calibrated latents and a start, so that it rolls out. Where settings differ,
/// it is the first trial's setting.
pub fn extend(scene: &Scene, trials: &[Trial], windows: &[Window], kept: &[usize], model: Shown) -> Scene {
    let mut out = scene.clone();
    let first = windows.iter().position(|w| w.kind != Kind::Contact).unwrap_or(0);
    let setting = windows[first].setting;
    let (terms, latents): (Vec<EffectTerm>, _) = model.layout.physics(&model.state.values, setting, 0.0);
    out.effects.extend(terms);
    let carriers: Vec<String> =
        out.bodies.iter().map(|b| b.name.clone()).chain(out.statics.iter().map(|s| s.name.clone())).collect();
    let carries: Vec<bool> = carriers.iter().map(|n| out.carries_latents(n)).collect();
    for (body, _) in out.bodies.iter_mut().zip(&carries).filter(|(_, c)| **c) {
        body.friction = latents.friction.unwrap_or(body.friction);
        body.restitution = latents.restitution.unwrap_or(body.restitution);
        if latents.density.is_some() && body.mass.is_none() {
            body.density = latents.density;
        }
    }
    let bodies = out.bodies.len();
    for (fixed, _) in out.statics.iter_mut().zip(&carries[bodies..]).filter(|(_, c)| **c) {
        fixed.friction = latents.friction.unwrap_or(fixed.friction);
        fixed.restitution = latents.restitution.unwrap_or(fixed.restitution);
    }
    let trial = &trials[kept[windows[first].trial]];
    let window = &windows[first];
    let fitted = (window.kind == Kind::Flight)
        .then(|| (window.scene.bodies[0].name.as_str(), model.state.nuisances[first].as_slice()));
    if out.action.is_none() || window.kind == Kind::Flight {
        place(&mut out, &trial.scene, fitted);
    } else {
        // A task's scene rolls out once an action has placed what it places: here, the first trial's.
        place(&mut out, &trial.scene, None);
    }
    out
}

/// Gives every body of `scene` a start: `from`'s, and for the only body of a window its fitted one.
pub fn place(scene: &mut Scene, from: &Scene, fitted: Option<(&str, &[f64])>) {
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
