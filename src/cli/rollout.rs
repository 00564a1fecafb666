//! `iplw rollout`: scenes in, trajectories out, one JSON document a line.

use std::io::Read;
use std::path::PathBuf;

use iplw::error::{Error, Result};
use iplw::task::Scene;
use iplw::trajectory::Trajectory;
use iplw::world::{Engine, Rollout, chosen, simulate};
use serde_json::{Map, Value, json};

use super::output;

/// Each line of the input is a scene (`iplw.scene/1`); each line of the output is its rollout:
/// `{"solved", "steps", "t", "bodies": {name: {"x", "y", "angle"}}, "contacts": {...}}`.
/// All lines are checked before anything is simulated or written.
#[derive(clap::Args)]
pub struct Args {
    /// Engine that integrates: auto, rapier or lanes.
    #[arg(long, default_value = "auto")]
    engine: String,
    /// File of scenes, one a line; `-` is standard input.
    #[arg(long = "in", value_name = "FILE", default_value = "-")]
    input: String,
    /// Where results go; `-` is standard output.
    #[arg(long, value_name = "FILE", default_value = "-")]
    out: String,
}

/// Scenes simulated between two writes to standard output.
const CHUNK: usize = 512;

/// Whether scenes come from standard input.
pub fn reads_stdin(args: &Args) -> bool {
    args.input == "-"
}

pub fn run(args: &Args) -> Result<()> {
    let engine = Engine::from_name(&args.engine)?;
    let (name, text) = read(&args.input)?;
    let mut scenes = Vec::new();
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        let place = format!("{name}:{}", i + 1);
        let scene = Scene::from_json(line).map_err(|e| at_line(e, &place))?;
        let rollout = Rollout::of(&scene);
        chosen(engine, &rollout).map_err(|e| at_line(e, &place))?;
        scenes.push(scene);
    }
    let file = (args.out != "-").then(|| PathBuf::from(&args.out));
    file.as_deref().map_or(Ok(()), |path| output::file("--out", path))?;
    let mut results = String::new();
    for chunk in scenes.chunks(CHUNK) {
        let rollouts: Vec<Rollout> = chunk.iter().map(Rollout::of).collect();
        for (rollout, trajectory) in rollouts.iter().zip(simulate(&rollouts, engine)?) {
            let mut line = record(&trajectory);
            line["engine"] = json!(chosen(engine, rollout)?.name());
            results.push_str(&line.to_string());
            results.push('\n');
        }
        if file.is_none() {
            output::print(&std::mem::take(&mut results))?;
        }
    }
    file.map_or(Ok(()), |path| output::write_whole(&path, results.as_bytes()))
}

/// A trajectory as the contract has it.
fn record(t: &Trajectory) -> Value {
    let mut bodies = Map::new();
    for track in &t.bodies {
        bodies.insert(track.name.clone(), json!({"x": track.x, "y": track.y, "angle": track.angle}));
    }
    json!({
        "solved": t.outcome.solved,
        "steps": t.outcome.steps,
        "end": t.outcome.end,
        "t": t.times,
        "bodies": bodies,
        "contacts": {"collisions": t.collisions, "rolling_steps": t.rolling_steps},
        "events": t.events,
    })
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
    let text = String::from_utf8(bytes).map_err(|_| Error::input("", "", "UTF-8 text").at(&name))?;
    Ok((name, text))
}

/// The line within the file replaces the line within the document, which is always 1.
fn at_line(error: Error, place: &str) -> Error {
    match error {
        Error::Input(mut input) => {
            input.place = place.to_string();
            Error::Input(input)
        }
        other => other,
    }
}
