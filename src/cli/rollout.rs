//! `iplw rollout`: simulates scenes, one JSON document per line in and out.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use iplw::error::{Error, Result};
use iplw::task::Scene;
use iplw::task::scene::JOINT_FORMAT;
use iplw::trajectory::{Contact, Termination, Trajectory};
use iplw::world::{Engine, Rollout, Simulator, select_engine};
use serde::Serialize;

use super::joint_arrays;
use super::joints;
use super::output;
use super::rollout_arrays::{self, ArrayRollouts};

/// Simulate scenes: one scene per line in, one trajectory per line out.
///
/// Simulates scenes. Each line of the input is a scene (`iplw.scene/1`); each line of the output is its trajectory:
/// `{"solved", "steps", "t", "bodies": {name: {"x", "y", "angle"}}, "contacts": {...}}`.
/// All lines are checked before anything is simulated or written. Scenes with joints (`iplw.scene/2`) give
/// `{"t", "joints": {name: {"position", "velocity"}}}`.
///
/// With --scene, many rollouts of one scene as arrays: --in is an archive of NumPy arrays (`numpy.savez`) whose first
/// axis is the rollout: `position` and `velocity` (rollouts, bodies, 2), `angle` and `angular_velocity` (rollouts, bodies),
/// `density`, `friction`, `restitution` and EFFECT.PARAMETER (rollouts), in SI units; what is missing is the scene's.
/// --out is an archive with `t`, `position`, `angle`, `velocity`, `angular_velocity` (rollouts, samples, bodies), NaN after
/// the end of a rollout (its last sample is after `steps` steps), and `solved` (1, 0; -1 without a goal), `end` (0 all steps, 1 goal, 2 diverged, 3 blocked),
/// `steps`, `collisions`, `rolling_steps`. For a scene with joints --in has `position` and `velocity` (rollouts, joints) and
/// `command` (rollouts, commands, motors), each command for an equal part of the duration, and --out `t`, `position` and
/// `velocity` (rollouts, samples, joints), NaN after a motion diverges; joints and motors are in the order of `joints` in --out.
#[derive(clap::Args)]
pub struct Args {
    /// Physics engine: auto, rapier, lanes or gpu.
    #[arg(long, default_value = "auto")]
    engine: String,
    /// Scene file of which --in varies initial states, latents and effects as NumPy arrays.
    #[arg(long, value_name = "FILE", requires_all = ["input", "out"])]
    scene: Option<PathBuf>,
    /// Commands of the motors of scenes with joints (CSV: t, and a column JOINT.command for each motor; a value holds until the next row).
    #[arg(long, value_name = "FILE", conflicts_with = "scene")]
    commands: Option<PathBuf>,
    /// Write outcomes only, without samples; with --scene.
    #[arg(long, requires = "scene")]
    no_samples: bool,
    /// File with one scene per line; - is standard input. With --scene an archive of arrays (.npz).
    #[arg(long = "in", value_name = "FILE", default_value = "-")]
    input: String,
    /// Output file; - is standard output.
    #[arg(long, value_name = "FILE", default_value = "-")]
    out: String,
}

/// Scenes simulated between two writes to standard output.
const SCENES_PER_WRITE: usize = 512;

/// Whether scenes are read from standard input.
pub fn reads_stdin(args: &Args) -> bool {
    args.scene.is_none() && args.input == "-"
}

pub fn run(args: &Args) -> Result<()> {
    let engine = Engine::from_name(&args.engine)?;
    if let Some(scene) = &args.scene {
        return run_arrays(args, engine, scene);
    }
    let (name, text) = read(&args.input)?;
    if text.lines().next().is_some_and(|line| line.contains(JOINT_FORMAT)) {
        return run_joints(args, &name, &text);
    }
    let (mut scenes, mut engines) = (Vec::new(), Vec::new());
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        let place = format!("{name}:{}", i + 1);
        let scene = Scene::from_json(line).map_err(|e| at_line(e, &place))?;
        let rollout = Rollout::of(&scene);
        engines.push(select_engine(engine, &rollout).map_err(|e| at_line(e, &place))?.name());
        scenes.push(scene);
    }
    let file = (args.out != "-").then(|| PathBuf::from(&args.out));
    file.as_deref().map_or(Ok(()), |path| output::prepare_file("--out", path))?;
    let (mut results, size) = (Vec::new(), engine.batch_size(SCENES_PER_WRITE));
    for (chunk, engines) in scenes.chunks(size).zip(engines.chunks(size)) {
        let rollouts: Vec<Rollout> = chunk.iter().map(Rollout::of).collect();
        for (engine, trajectory) in engines.iter().zip(Simulator::new(engine).run(&rollouts)?) {
            let line = serde_json::to_writer(&mut results, &RolloutRecord::of(&trajectory, engine));
            line.map_err(|e| Error::Failed(e.to_string()))?;
            results.push(b'\n');
        }
        if file.is_none() {
            output::print(&String::from_utf8_lossy(&std::mem::take(&mut results)))?;
        }
    }
    file.map_or(Ok(()), |path| output::write_whole(&path, &results))
}

/// Rollouts of scenes with joints, one per line; all lines have joints.
fn run_joints(args: &Args, name: &str, text: &str) -> Result<()> {
    let commands = args.commands.as_ref().map(|path| read(&path.display().to_string())).transpose()?;
    let mut results = Vec::new();
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        let place = format!("{name}:{}", i + 1);
        let record = Scene::from_json(line)
            .and_then(|scene| joints::rollout(&scene, commands.as_ref().map(|(_, text)| text.as_str())))
            .map_err(|e| at_line(e, &place))?;
        serde_json::to_writer(&mut results, &record).map_err(|e| Error::Failed(e.to_string()))?;
        results.push(b'\n');
    }
    match args.out.as_str() {
        "-" => output::print(&String::from_utf8_lossy(&results)),
        out => output::write_whole(Path::new(out), &results),
    }
}

fn run_arrays(args: &Args, engine: Engine, scene: &Path) -> Result<()> {
    for (option, file) in [("--in", &args.input), ("--out", &args.out)] {
        if file == "-" {
            return Err(Error::input(
                option,
                "-",
                "the name of an archive of arrays (.npz), needed with --scene",
            ));
        }
    }
    let (name, text) = read(&scene.display().to_string())?;
    let scene = &Scene::from_json(&text).map_err(|e| e.in_file(&name))?;
    if !scene.joints.is_empty() {
        return joint_arrays::run(scene, !args.no_samples, Path::new(&args.input), Path::new(&args.out));
    }
    let config = ArrayRollouts { scene, engine, samples: !args.no_samples };
    rollout_arrays::run(&config, Path::new(&args.input), Path::new(&args.out))
}

/// The output format of a trajectory; bodies in the order of their names.
#[derive(Serialize)]
struct RolloutRecord<'a> {
    bodies: BTreeMap<&'a str, BodyPoses<'a>>,
    contacts: ContactCounts,
    end: Termination,
    engine: &'a str,
    events: &'a [Contact],
    solved: Option<bool>,
    steps: u32,
    t: &'a [f64],
}

#[derive(Serialize)]
struct BodyPoses<'a> {
    angle: &'a [f64],
    x: &'a [f64],
    y: &'a [f64],
}

#[derive(Serialize)]
struct ContactCounts {
    collisions: u32,
    rolling_steps: u32,
}

impl<'a> RolloutRecord<'a> {
    fn of(seen: &'a Trajectory, engine: &'a str) -> RolloutRecord<'a> {
        let places = seen.bodies.iter().map(|track| {
            let places = BodyPoses { angle: &track.angle, x: &track.x, y: &track.y };
            (track.name.as_str(), places)
        });
        RolloutRecord {
            bodies: places.collect(),
            contacts: ContactCounts { collisions: seen.collisions, rolling_steps: seen.rolling_steps },
            end: seen.outcome.end,
            engine,
            events: &seen.events,
            solved: seen.outcome.solved,
            steps: seen.outcome.steps,
            t: &seen.times,
        }
    }
}

fn read(input: &str) -> Result<(String, String)> {
    let mut bytes = Vec::new();
    let name = if input == "-" { "standard input".to_string() } else { input.to_string() };
    let read = if input == "-" {
        std::io::stdin().lock().read_to_end(&mut bytes).map(drop)
    } else {
        std::fs::read(input).map(|b| bytes = b)
    };
    read.map_err(|e| Error::Io { path: name.clone(), message: e.to_string() })?;
    let text = String::from_utf8(bytes).map_err(|_| Error::input("", "", "UTF-8 text").in_file(&name))?;
    Ok((name, text))
}

/// Replaces the line within the document, which is always 1, by the line within the file.
fn at_line(error: Error, place: &str) -> Error {
    error.map_input(|input| input.place = place.to_string())
}
