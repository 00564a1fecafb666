//! Options for measured tracks: files, scene, and units.

use std::io::{Error as IoError, ErrorKind};
use std::path::{Path, PathBuf};

use iplw::budget::Unlimited;
use iplw::commands::{DiagnosisRequest, TrialFiles};
use iplw::error::{Error, InvalidInput, Result};
use iplw::json::JsonObject;
use iplw::reality::{LoadedTrials, TrackFile, TrackParseOptions, decode};
use iplw::task::Scene;
use iplw::task::ball::BallScene;

// Measured tracks and their scene.
#[derive(clap::Args)]
pub struct TrackOptions {
    /// Measured trials (CSV: trial,t,body,x,y) or tracks of one body; at least four trials.
    ///
    /// Tracks may come from Tracker (.txt, .trk), Kinovea, TrackMate (CSV, XML), DeepLabCut, Logger Pro, Capstone, Qualisys (.tsv), ImageJ
    /// or a data frame, with columns such as `t`, `Time (s)` or `frame`, `x`, `X [m]`, `pos_x` or `pixelx`. Every file without a column
    /// `trial` is one trial, named after the file.
    #[arg(long, required = true, value_name = "FILE", num_args = 1..)]
    trials: Vec<PathBuf>,
    /// Scene of the trials (iplw.scene/1, or /2 with joints); for a single ball, --radius replaces it.
    #[arg(long, value_name = "FILE", conflicts_with = "BallScene")]
    scene: Option<PathBuf>,
    #[command(flatten, next_help_heading = "A single ball, instead of --scene")]
    ball: Option<BallScene>,
    #[command(flatten, next_help_heading = "Units and tracks, if the files don't specify them")]
    reading: TrackParseOptions,
    /// The y axis points upwards, even if bodies seem to fall upwards.
    #[arg(long, conflicts_with = "y_down")]
    y_up: bool,
}

/// Examples for the help.
pub const EXAMPLES: &str = "\
Examples:
  A scene and trials, as `iplw measure` writes them:
    iplw diagnose --scene scene.json --trials trials.csv --out report
  A ping-pong ball filmed in flight, with a Tracker file for each throw:
    iplw diagnose --trials throw*.txt --radius 0.02 --mass 0.0027 --out report
  The same in pixels and frames, with rows counted from the top, bouncing on a table in row 700:
    iplw diagnose --trials throws.csv --radius 0.02 --floor=-1.05 --fps 240 --metres-per-pixel 0.0015 --y-down --out report

Implausible units (a ball that falls with a thousand times gravity) are rejected, with a suggestion.";

/// Reads the files; notes for the user go to standard error.
pub fn read(args: &TrackOptions) -> Result<LoadedTrials> {
    let loaded = request(args)?.load(&Unlimited).map_err(as_options::<TrackOptions>)?;
    for note in &loaded.notes {
        eprintln!("note: {}", with_option_names::<TrackOptions>(note));
    }
    Ok(loaded)
}

/// A scene with joints and the texts of its recordings.
pub struct JointFiles {
    pub scene: Scene,
    pub files: Vec<(PathBuf, String)>,
}

/// The scene with the texts of all files, if it has joints.
pub fn read_joints(args: &TrackOptions) -> Result<Option<JointFiles>> {
    let Some(path) = &args.scene else { return Ok(None) };
    let scene = Scene::from_json(&text(path)?).map_err(|e| e.in_file(path.display()))?;
    if scene.joints.is_empty() {
        return Ok(None);
    }
    let files = args.trials.iter().map(|path| Ok((path.clone(), text(path)?)));
    Ok(Some(JointFiles { files: files.collect::<Result<_>>()?, scene }))
}

fn request(args: &TrackOptions) -> Result<DiagnosisRequest> {
    if args.scene.is_none() && args.ball.is_none() {
        let allowed = "a scene file; or, for a single ball, --radius (and --mass, --gravity, --floor)";
        return Err(Error::input("--scene", "missing", allowed));
    }
    let scene = |path: &PathBuf| Scene::from_json(&text(path)?).map_err(|e| e.in_file(path.display()));
    let file = |path: &PathBuf| Ok(TrackFile { name: path.display().to_string(), text: text(path)? });
    let y_down = if args.y_up { Some(false) } else { args.reading.y_down };
    Ok(DiagnosisRequest {
        scene: args.scene.as_ref().map(scene).transpose()?.map(JsonObject),
        ball: args.ball.clone().map(JsonObject),
        trials: Some(TrialFiles(args.trials.iter().map(file).collect::<Result<_>>()?)),
        reading: Some(JsonObject(TrackParseOptions { y_down, ..args.reading.clone() })),
        ..DiagnosisRequest::default()
    })
}

/// Reads a file given by the user; an unreadable one is an input error.
fn text(path: &Path) -> Result<String> {
    let unreadable = |e: IoError| Error::input("", e, "a file that can be read").in_file(path.display());
    if path.is_dir() {
        return Err(unreadable(IoError::new(ErrorKind::IsADirectory, "a directory")));
    }
    let bytes = std::fs::read(path).map_err(unreadable)?;
    decode(bytes).map_err(|e| e.in_file(path.display()))
}

/// Replaces the request's field in an error by the option of `A` that sets it, unless the error refers to a file.
pub fn as_options<A: clap::Args>(error: Error) -> Error {
    let Error::Input(input) = error else { return error };
    let parents = ["trials.", "ball.", "reading."];
    let field = parents.into_iter().find_map(|parent| input.field.strip_prefix(parent));
    let field = field.unwrap_or(&input.field);
    let option = options::<A>().into_iter().find(|(id, _)| field.split('[').next() == Some(id));
    let field = option.filter(|_| input.place.is_empty()).map_or(field.to_string(), |(_, option)| option);
    let (value, allowed) = (with_option_names::<A>(&input.value), with_option_names::<A>(&input.allowed));
    Error::Input(InvalidInput { field, value, allowed, ..input })
}

/// Replaces field names in a text by the options of `A` that set them.
fn with_option_names<A: clap::Args>(text: &str) -> String {
    let text = text.replace("`y_down` false", "--y-up");
    options::<A>().iter().fold(text, |text, (id, option)| text.replace(&format!("`{id}`"), option))
}

/// Fields and the options of `A` that set them.
fn options<A: clap::Args>() -> Vec<(String, String)> {
    let command = A::augment_args(clap::Command::new("iplw"));
    let option = |arg: &clap::Arg| Some((arg.get_id().to_string(), format!("--{}", arg.get_long()?)));
    command.get_arguments().filter_map(option).collect()
}
