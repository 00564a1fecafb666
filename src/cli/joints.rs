//! Scenes with joints on the command line: rollouts and diagnoses.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result};
use iplw::inference::mechanism::{JointDiagnosis, MAX_EFFECTS, diagnose_joints};
use iplw::progress::Progress;
use iplw::reality::{JointTrial, commands_from_csv, joint_trials_from_csv};
use iplw::report::joint_diagnosis;
use iplw::task::Scene;
use iplw::world::mechanism::{Commands, JointRollout, Tree, scene_terms, simulate};
use serde::Serialize;

use super::compact_json::compact_json;
use super::output;

/// Motion of the joints of a scene.
#[derive(Serialize)]
pub struct JointRecord {
    /// s
    t: Vec<f64>,
    /// Positions (as measured) and velocities by joint: rad and rad/s, or m and m/s.
    joints: BTreeMap<String, JointColumns>,
    engine: &'static str,
}

#[derive(Serialize)]
struct JointColumns {
    position: Vec<f64>,
    velocity: Vec<f64>,
}

/// The rollout of a scene with joints; `commands`: CSV with the commands of its motors.
pub fn rollout(scene: &Scene, commands: Option<&str>) -> Result<JointRecord> {
    let tree = Tree::of(scene)?;
    let commands = commands.map_or(Ok(Commands::default()), |text| commands_from_csv(text, scene))?;
    let times = scene.observation_times();
    let rollout = JointRollout {
        terms: scene_terms(scene, &tree)?,
        position: tree.position.clone(),
        velocity: tree.velocity.clone(),
        tree: &tree,
        start: 0.0,
        commands: &commands,
        times: &times,
        field: None,
    };
    let terms = rollout.terms.clone();
    let mut motion = simulate(&[rollout]).swap_remove(0);
    motion.round_positions(&terms);
    if motion.positions.iter().flatten().any(|q| !q.is_finite()) {
        return Err(Error::Failed("the motion of the joints diverges: use a smaller time_step".into()));
    }
    let joints = tree.names.iter().enumerate().map(|(j, name)| {
        let own =
            JointColumns { position: motion.positions[j].clone(), velocity: motion.velocities[j].clone() };
        (name.clone(), own)
    });
    Ok(JointRecord { joints: joints.collect(), t: times, engine: "mechanism" })
}

/// Diagnoses a scene with joints and writes report.json, report.html, motion.svg and extended_scene.json.
pub fn diagnose(scene: &Scene, files: &[(PathBuf, String)], seed: u64, out: &Path) -> Result<()> {
    let trials = files
        .iter()
        .map(|(path, text)| joint_trials_from_csv(text, scene).map_err(|e| e.in_file(path.display())))
        .collect::<Result<Vec<Vec<JointTrial>>>>()?
        .concat();
    output::prepare_directory("--out", out)?;
    let bar = output::TerminalProgress::new();
    bar.report("segmenting trials", 0, 1)?;
    let found = diagnose_joints(scene, &trials, MAX_EFFECTS, seed, &bar)?;
    bar.clear();
    output::write_whole(&out.join("report.json"), (compact_json(&found)? + "\n").as_bytes())?;
    output::write_whole(
        &out.join("extended_scene.json"),
        (found.extended_scene.to_json() + "\n").as_bytes(),
    )?;
    output::write_whole(&out.join("motion.svg"), joint_diagnosis::figure(&found).as_bytes())?;
    let page = joint_diagnosis::report(&found).to_html();
    output::write_whole(&out.join("report.html"), page.as_bytes())?;
    output::print(&summary(&found, out))
}

/// Text for a terminal.
fn summary(found: &JointDiagnosis, out: &Path) -> String {
    let mut text = format!("verdict: {}\n{}\n", found.verdict.name(), found.reason);
    for effect in &found.effects {
        text += &format!(
            "  {} in {}: {} (probability {:.2})\n",
            effect.name, effect.acts_on, effect.equation, effect.probability
        );
        for p in &effect.parameters {
            let [low, high] = p.ci95;
            text += &format!("    {} = {:.4} {} (95 %: {low:.4} to {high:.4})\n", p.name, p.value, p.unit);
        }
    }
    if let Some(gain) = found.held_out_gain {
        text += &format!("held-out trials: {:.0} % of the excess squared error removed\n", 100.0 * gain);
    }
    text + &format!("{}: report.html, report.json, motion.svg, extended_scene.json\n", out.display())
}
