//! The library in forty lines: drop a ball, check physics by eye, then find a hidden world's restitution.
//!
//! `cargo run --release --example ground_and_roll`

use iplw::error::Result;
use iplw::experiment::{EstimateConfig, estimate};
use iplw::progress::NoProgress;
use iplw::reality::{HiddenWorld, standard};
use iplw::task::{Scene, Split, family, split};
use iplw::world::{Engine, Latents, Rollout, Simulator};

fn main() -> Result<()> {
    // A ball dropped from 5 m onto a floor; it should rebound to e^2 h.
    let scene = Scene::from_json(
        r#"{"format": "iplw.scene/1",
            "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.5}, "position": [0, 5.5]}],
            "statics": [{"name": "floor", "shape": {"type": "segment", "from": [-9, 0], "to": [9, 0]}}],
            "steps": 480, "observe_every": 1}"#,
    )?;
    println!("restitution   rebound to, m   e^2 h, m");
    for e in [0.3, 0.6, 0.9] {
        let latents = Latents { restitution: Some(e), ..Latents::default() };
        let rollout = Rollout { latents, ..Rollout::of(&scene) };
        let film = &Simulator::new(Engine::Auto).run(&[rollout])?[0];
        let bounce = film.events.first().map_or(0.0, |c| c.time);
        let apex =
            film.times.iter().zip(&film.bodies[0].y).filter(|(t, _)| **t > bounce).map(|(_, y)| y - 0.5);
        println!("{e:11.1} {:15.3} {:10.3}", apex.fold(0.0, f64::max), e * e * 5.0);
    }

    // A hidden basketball world: 20 measurements identify its restitution (0.7; the simulation lacks the world's drag).
    let family = family("basketball")?;
    let training = split(&family.tasks(), Split::Train);
    let mut world = HiddenWorld::new(standard(family))?;
    let config = EstimateConfig { rounds: 2, actions: 10, ..EstimateConfig::fast(family.prior) };
    let (report, _) = estimate(&training, &mut world, &config, &NoProgress)?;
    println!("\nlatent          found   identifiable");
    for l in &report.latents {
        println!("{:<13} {:>7.3}   {}", l.name, l.value, l.identifiable);
    }
    println!("after {} real interactions and {} simulated ones", report.real_interactions, report.rollouts);
    Ok(())
}
