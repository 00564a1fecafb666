//! Writes scenes of a task family with placed actions as JSON lines, with the latents of its real world and the effect
//! `linear_drag`: `cargo run --release --example sampled_scenes -- bowling 30 0.8 > scenes.jsonl`.

use iplw::reality::{HiddenWorld, standard};
use iplw::task::{Placement, Scene, family};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, count, damping] = arguments.as_slice() else {
        eprintln!("usage: sampled_scenes FAMILY COUNT DAMPING");
        std::process::exit(2);
    };
    let count: usize = count.parse().expect("COUNT is a whole number");
    let damping: f64 = damping.parse().expect("DAMPING is the share of velocity left after one second");
    for scene in sampled(name, count) {
        let scene = Scene { damping: (damping < 1.0).then_some(damping), ..scene };
        println!("{}", serde_json::to_string(&scene).expect("scenes are representable as JSON"));
    }
}

/// Scenes of the family, each with a placeable action of a fixed sequence and with its latents set.
fn sampled(name: &str, count: usize) -> Vec<Scene> {
    let family = family(name).expect("the family exists");
    let real = HiddenWorld::new(standard(family)).expect("a family's world can be made").reveal();
    let [density, friction, restitution] = real.latents.values();
    let mut scenes = Vec::new();
    let found: Vec<Scene> = family.candidates(0).collect();
    for (i, scene) in found.iter().cycle().enumerate() {
        let space = scene.action.as_ref().expect("a family's scenes have actions");
        let action = space.at((i * 7919 + 13) % space.count()).expect("the index is in range");
        let Placement::Valid(mut placed) = space.place(scene, &action) else { continue };
        let carriers: Vec<bool> = placed.bodies.iter().map(|b| placed.carries_latents(&b.name)).collect();
        for (body, _) in placed.bodies.iter_mut().zip(carriers).filter(|(_, carries)| *carries) {
            (body.density, body.mass) = (density.or(body.density), None);
            body.friction = friction.unwrap_or(body.friction);
            body.restitution = restitution.unwrap_or(body.restitution);
        }
        let carriers: Vec<bool> = placed.statics.iter().map(|s| placed.carries_latents(&s.name)).collect();
        for (fixed, _) in placed.statics.iter_mut().zip(carriers).filter(|(_, carries)| *carries) {
            fixed.friction = friction.unwrap_or(fixed.friction);
            fixed.restitution = restitution.unwrap_or(fixed.restitution);
        }
        placed.action = None;
        placed.carriers = None;
        placed.stop = Some(false);
        scenes.push(*placed);
        if scenes.len() == count {
            break;
        }
    }
    scenes
}
