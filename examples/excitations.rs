//! Diagnoses of mechanisms from few, short trials: under random steps, and under the commands that `iplw excite` designs.
//!
//!     cargo run --release --example excitations -- [worlds] [first seed] [trials] [duration of each, s]

use iplw::design::{ExcitationConfig, ExcitationGoal, design_excitations};
use iplw::error::Result;
use iplw::inference::mechanism::{diagnose_joints, effect_in_joint};
use iplw::progress::NoProgress;
use iplw::reality::joint_worlds::{Mechanism, RecordingPlan};
use iplw::rng::derive_seed;
use iplw::world::mechanism::{Commands, Tree};

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let worlds: u64 = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(12);
    let first: u64 = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(1);
    let trials: usize = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(3);
    let duration: f64 = arguments.next().and_then(|a| a.parse().ok()).unwrap_or(1.5);
    let plan = RecordingPlan { trials, duration, rate: 100.0, noise: 1e-3 };
    // Right alone, in the set, with random and with designed commands.
    let mut counts = [[0; 2]; 2];
    for seed in first..first + worlds {
        let mechanism = [Mechanism::Pendulum, Mechanism::CartPole][seed as usize % 2];
        let scene = mechanism.scene();
        let tree = Tree::of(&scene)?;
        let choices = mechanism.effects()?;
        let hidden = choices[derive_seed(seed, "hidden effect", 0) as usize % choices.len()];
        let truth = effect_in_joint(hidden.0.name, &tree.names[hidden.1]);
        let config = ExcitationConfig {
            goal: ExcitationGoal::Discriminate,
            trials,
            duration,
            effects: Vec::new(),
            noise: plan.noise,
            max_velocity: Some(30.0),
            positions: Vec::new(),
            commands: Vec::new(),
            seed,
        };
        let design = design_excitations(&scene, &config, &NoProgress)?;
        let designed: Vec<Commands> = design.excitations.iter().map(|e| e.commands(&tree)).collect();
        print!("{seed} {} {truth}:", mechanism.name());
        for (kind, commands) in [("random", None), ("designed", Some(&designed[..]))] {
            let world = mechanism.world_under(Some(hidden), &plan, commands, seed)?;
            let found = diagnose_joints(&world.scene, &world.trials, 2, 0, &NoProgress)?;
            let is_right = |set: &Vec<String>| set.len() == 1 && set[0] == truth;
            let is_named = ["named", "ambiguous"].contains(&found.verdict.name());
            let in_set = is_named && found.rivals.iter().any(is_right);
            let own = &mut counts[usize::from(kind == "designed")];
            own[0] += usize::from(in_set && found.rivals.len() == 1);
            own[1] += usize::from(in_set);
            print!(" {kind} {} {:?};", found.verdict.name(), found.rivals);
        }
        println!();
    }
    let [random, designed] = counts;
    println!(
        "of {worlds}: random steps right alone {}, in the set {}; designed {}, {}",
        random[0], random[1], designed[0], designed[1]
    );
    Ok(())
}
