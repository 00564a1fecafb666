//! The paper's loop for control: excite the hidden real world, diagnose the recording, plan with the extended model, and compare
//! the return with that of the scene as it is and of domain randomisation.
//!
//! `cargo run --release --example control_transfer -- [task] [seeds] [first seed] [seconds of real motion]`

use std::sync::Arc;

use iplw::control::mppi::{Mppi, MppiConfig};
use iplw::control::{ControlModel, ControlPhysics, ControlWorld, ControlWorldConfig, RewardKind};
use iplw::error::Result;
use iplw::inference::mechanism::{JointDiagnosis, diagnose_joints};
use iplw::progress::NoProgress;
use iplw::reality::JointTrial;
use iplw::rng::{self, Stream};
use iplw::session::{Autoreset, WorldKind};
use iplw::task::control::{ControlReality, control_task};
use iplw::task::scene::EffectTerm;
use iplw::world::mechanism::effect::resolve;
use iplw::world::mechanism::{Commands, JointTerm};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

/// Episodes of each evaluation, and number of possible physics that a planner considers.
const EPISODES: u64 = 4;
const DRAWS: usize = 6;
/// Effects of domain randomisation in joints with a motor, with generic ranges.
const RANDOMISED: &str = r#"[
    {"joint": "JOINT", "name": "viscous_friction", "parameters": {"b": [0.0, 0.05]}},
    {"joint": "JOINT", "name": "coulomb_friction", "parameters": {"torque": [0.0, 0.1]}},
    {"joint": "JOINT", "name": "motor_gain", "parameters": {"s": [0.8, 1.2]}},
    {"joint": "JOINT", "name": "command_delay", "parameters": {"delay": [0.0, 0.06]}},
    {"joint": "JOINT", "name": "payload", "parameters": {"mass": [0.0, 0.1]}}]"#;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let task = arguments.next().unwrap_or_else(|| "pendulum_swing_up".into());
    let mut number = |default: f64| arguments.next().and_then(|a| a.parse().ok()).unwrap_or(default);
    let (seeds, first, seconds) = (number(5.0) as u64, number(501.0) as u64, number(60.0));
    let model = Arc::new(ControlModel::new(control_task(&task)?.clone())?);
    let mut differences: [Vec<f64>; 2] = Default::default();
    for seed in first..first + seeds {
        let trials = excite(&model, seed, seconds)?;
        let found = diagnose_joints(&model.task.scene, &trials, 3, seed, &NoProgress)?;
        let mut stream = rng::stream(seed, "control transfer");
        let plain = mean_return(&model, vec![Vec::new()], seed)?;
        let random = mean_return(&model, randomised(&model, &mut stream)?, seed)?;
        let extended = mean_return(&model, posterior(&model, &found, &mut stream)?, seed)?;
        println!(
            "{task} seed {seed}: {} {:?}; return: scene {plain:.1}, domain randomisation {random:.1}, diagnosed {extended:.1}",
            found.verdict.name(),
            found.effects.iter().map(|e| (&e.name, e.parameters[0].value)).collect::<Vec<_>>(),
        );
        differences[0].push(extended - plain);
        differences[1].push(extended - random);
    }
    for (name, all) in ["the scene", "domain randomisation"].into_iter().zip(&differences) {
        let count = all.len() as f64;
        let mean = all.iter().sum::<f64>() / count;
        let sd = (all.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / (count - 1.0).max(1.0)).sqrt();
        println!(
            "diagnosed minus {name}: {mean:.1}, standard error {:.1}, t {:.1}",
            sd / count.sqrt(),
            mean / (sd / count.sqrt())
        );
    }
    Ok(())
}

fn world(model: &Arc<ControlModel>, seed: u64) -> Result<ControlWorld> {
    let physics = ControlPhysics::new(&model.task.real, &model.tree, "real.")?;
    let (kind, count, reward) = (WorldKind::Real, 1, RewardKind::Dense);
    ControlWorld::new(ControlWorldConfig { model: model.clone(), kind, physics, count, reward, seed })
}

/// Recordings of random steps of the commands.
fn excite(model: &Arc<ControlModel>, seed: u64, seconds: f64) -> Result<Vec<JointTrial>> {
    let mut world = world(model, seed)?;
    let mut stream = rng::stream(seed, "excitation");
    let mut trials = Vec::new();
    while world.usage.motion_seconds < seconds - 1e-9 {
        let first = world.reset((trials.is_empty()).then_some(seed), None)?.remove(0);
        let Some(first) = first else { break };
        let (mut positions, mut actions) = (vec![first.positions], Vec::new());
        let (mut action, mut until) = (Vec::new(), 0.0);
        for k in 0..(5.0 / model.task.interval).round() as usize {
            let time = k as f64 * model.task.interval;
            if time >= until {
                action = model.ranges.iter().map(|[low, high]| stream.random_range(*low..*high)).collect();
                until = time + stream.random_range(0.1..0.5);
            }
            let step = world.step(std::slice::from_ref(&action), Autoreset::Disabled)?.remove(0);
            actions.push(action.clone());
            positions.push(step.outcome.positions);
            if step.outcome.terminated || step.outcome.truncated {
                break;
            }
        }
        trials.push(trial(model, trials.len(), &positions, &actions));
    }
    Ok(trials)
}

fn trial(model: &ControlModel, id: usize, positions: &[Vec<f64>], actions: &[Vec<f64>]) -> JointTrial {
    let tree = &model.tree;
    let place = |name: &String| model.task.scene.joints.iter().position(|j| j.name == *name).unwrap_or(0);
    let order: Vec<usize> = tree.names.iter().map(place).collect();
    let times: Vec<f64> = (0..positions.len()).map(|k| k as f64 * model.task.interval).collect();
    let mut values = vec![Vec::new(); tree.links.len()];
    for (m, joint) in model.motors.iter().enumerate() {
        values[*joint] = actions.iter().map(|own| own[m]).collect();
    }
    JointTrial {
        id: id.to_string(),
        positions: positions.iter().map(|q| order.iter().map(|i| q[*i]).collect()).collect(),
        commands: Commands::new(times[..actions.len()].to_vec(), values),
        times,
    }
}

/// Draws of domain randomisation.
fn randomised(model: &ControlModel, stream: &mut Stream) -> Result<Vec<Vec<JointTerm>>> {
    let mut effects = Vec::new();
    for motor in &model.task.scene.motors {
        let own: ControlReality =
            serde_json::from_str(&format!("{{\"effects\": {}}}", RANDOMISED.replace("JOINT", &motor.joint)))
                .map_err(|e| iplw::error::Error::Failed(e.to_string()))?;
        effects.extend(own.effects);
    }
    let physics =
        ControlPhysics::new(&ControlReality { effects, ..ControlReality::default() }, &model.tree, "")?;
    Ok((0..DRAWS).map(|_| physics.draw(stream)).collect())
}

/// Draws of the diagnosed effects.
fn posterior(
    model: &ControlModel,
    found: &JointDiagnosis,
    stream: &mut Stream,
) -> Result<Vec<Vec<JointTerm>>> {
    let mut draw = || {
        let terms = found.effects.iter().map(|effect| {
            let parameters: Vec<(&str, f64)> = effect
                .parameters
                .iter()
                .map(|p| {
                    let z: f64 = StandardNormal.sample(&mut *stream);
                    (p.name.as_str(), (p.value + z * p.sd).clamp(p.ci95[0], p.ci95[1]))
                })
                .collect();
            let joint = model.tree.joint(&effect.acts_on).unwrap_or(0);
            resolve(&EffectTerm::new(&effect.name, &parameters), joint, "effects")
        });
        terms.collect::<Result<Vec<JointTerm>>>()
    };
    (0..DRAWS).map(|_| draw()).collect()
}

/// Mean return of episodes in the real world.
fn mean_return(model: &Arc<ControlModel>, physics: Vec<Vec<JointTerm>>, seed: u64) -> Result<f64> {
    let mut world = world(model, seed)?;
    let mut planner = Mppi::new(model, physics, MppiConfig { seed, ..MppiConfig::default() });
    let mut total = 0.0;
    for episode in 0..EPISODES {
        let reset = world.reset(Some(1000 * seed + episode), None)?.remove(0);
        let Some(mut now) = reset else { continue };
        planner.restart();
        let mut actions: Vec<Vec<f64>> = Vec::new();
        loop {
            let draws = world.state(0)?.draws.clone();
            let steps = actions.len() as u32;
            let state = model.known_state(steps, [&now.positions, &now.velocities], &actions, draws)?;
            let action = planner.act(&state);
            let step = world.step(std::slice::from_ref(&action), Autoreset::Disabled)?.remove(0);
            actions.push(action);
            total += step.outcome.reward;
            now = step.outcome;
            if now.terminated || now.truncated {
                break;
            }
        }
    }
    Ok(total / EPISODES as f64)
}
