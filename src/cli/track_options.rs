//! Options for measured tracks: files, scene, and units.

use std::io::{Error as IoError, ErrorKind};
use std::path::{Path, PathBuf};

use iplw::budget::Unlimited;
use iplw::error::{Error, InvalidInput, Result};
use iplw::reality::{LoadedTrials, Subject, TrackFile, TrackParseOptions, decode, load_tracks};
use iplw::task::Scene;
use iplw::task::ball::{BallScene, STANDARD_GRAVITY_M_S2};

// Measured tracks and their scene.
#[derive(clap::Args)]
pub struct TrackOptions {
    /// Measured trials (CSV: trial,t,body,x,y) or tracks of one body; at least four trials.
    ///
    /// Tracks may come from Tracker, Kinovea or a data frame, with columns such as `t`, `Time (s)` or `frame`, `x`, `X [m]`, `pos_x` or
    /// `pixelx`. Every file without a column `trial` is one trial, named after the file.
    #[arg(long, required = true, value_name = "FILE", num_args = 1..)]
    trials: Vec<PathBuf>,
    /// Scene of the trials (iplw.scene/1); for a single ball, --radius replaces it.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["radius", "mass", "gravity", "floor"])]
    scene: Option<PathBuf>,
    /// Radius of the ball, m.
    #[arg(long, value_name = "M", help_heading = ONE_BALL, allow_negative_numbers = true)]
    radius: Option<f64>,
    /// Ball mass, kg (optional; does not affect the diagnosis).
    #[arg(long, value_name = "KG", help_heading = ONE_BALL, allow_negative_numbers = true)]
    mass: Option<f64>,
    /// Gravity, m/s^2, downwards.
    #[arg(long, value_name = "G", help_heading = ONE_BALL, allow_negative_numbers = true, default_value_t = STANDARD_GRAVITY_M_S2)]
    gravity: f64,
    /// Height of the floor, m, if the ball bounces; restitution and friction are estimated, too [default: none]
    #[arg(long, value_name = "M", help_heading = ONE_BALL, allow_negative_numbers = true)]
    floor: Option<f64>,
    /// Frame rate, 1/s, if times are frame numbers [default: times in seconds]
    #[arg(long, value_name = "N", help_heading = UNITS, allow_negative_numbers = true)]
    fps: Option<f64>,
    /// Size of a pixel, m, if coordinates are in pixels [default: coordinates in metres]
    #[arg(long, value_name = "M", help_heading = UNITS, allow_negative_numbers = true)]
    metres_per_pixel: Option<f64>,
    /// Unit of coordinates without a unit: m, cm, mm, um, km, in, ft [default: m]
    #[arg(long, value_name = "UNIT", help_heading = UNITS)]
    length_unit: Option<String>,
    /// Unit of times without a unit: s, ms, us, min [default: s]
    #[arg(long, value_name = "UNIT", help_heading = UNITS)]
    time_unit: Option<String>,
    /// The y axis points downwards, as in images: row 700 is at -700 pixels.
    #[arg(long, help_heading = UNITS, conflicts_with = "y_up")]
    y_down: bool,
    /// The y axis points upwards, even if bodies seem to fall upwards.
    #[arg(long, help_heading = UNITS)]
    y_up: bool,
    /// Track or body to read from files with several.
    #[arg(long, value_name = "NAME", help_heading = UNITS)]
    track: Option<String>,
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

const ONE_BALL: &str = "A single ball, instead of --scene";
const UNITS: &str = "Units and tracks, if the files don't specify them";

/// Reads the files; notes for the user go to standard error.
pub fn read(args: &TrackOptions) -> Result<LoadedTrials> {
    let gathered = load(args).map_err(|e| as_options(e, args.scene.is_none()))?;
    for note in &gathered.notes {
        eprintln!("note: {}", with_option_names(note));
    }
    Ok(gathered)
}

fn load(args: &TrackOptions) -> Result<LoadedTrials> {
    let files = || {
        let read = |p: &PathBuf| Ok(TrackFile { name: p.display().to_string(), text: text(p)? });
        args.trials.iter().map(read).collect::<Result<Vec<_>>>()
    };
    match (&args.scene, args.radius) {
        (Some(path), _) => {
            let scene = Scene::from_json(&text(path)?).map_err(|e| e.in_file(path.display()))?;
            load_tracks(&files()?, Subject::Scene(&scene), &reading(args), &Unlimited)
        }
        (None, Some(radius)) => {
            let ball = BallScene { radius, mass: args.mass, gravity: args.gravity, floor: args.floor };
            load_tracks(&files()?, Subject::Ball(&ball), &reading(args), &Unlimited)
        }
        (None, None) => {
            let allowed = "a scene file; or, for a single ball, --radius (and --mass, --gravity, --floor)";
            Err(Error::input("--scene", "missing", allowed))
        }
    }
}

fn reading(args: &TrackOptions) -> TrackParseOptions {
    TrackParseOptions {
        fps: args.fps,
        metres_per_pixel: args.metres_per_pixel,
        length_unit: args.length_unit.clone(),
        time_unit: args.time_unit.clone(),
        y_down: (args.y_down || args.y_up).then_some(args.y_down),
        track: args.track.clone(),
    }
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

/// Fields that correspond to options.
const OPTION_FIELDS: [&str; 10] = [
    "fps",
    "metres_per_pixel",
    "length_unit",
    "time_unit",
    "y_down",
    "track",
    "radius",
    "mass",
    "gravity",
    "floor",
];

/// Replaces field names in a text by option names.
fn with_option_names(text: &str) -> String {
    let option = |name: &str| format!("--{}", name.replace('_', "-"));
    let text = text.replace("`y_down` false", "--y-up");
    OPTION_FIELDS.iter().fold(text, |text, name| text.replace(&format!("`{name}`"), &option(name)))
}

/// Replaces the field of an error by the option, unless the error refers to a file.
fn as_options(error: Error, ball: bool) -> Error {
    let Error::Input(input) = error else { return error };
    let own = input.place.is_empty() && OPTION_FIELDS.contains(&input.field.as_str());
    let of_ball = ["radius", "mass", "gravity", "floor"].contains(&input.field.as_str());
    let field = if own && (ball || !of_ball) {
        with_option_names(&format!("`{}`", input.field))
    } else {
        input.field
    };
    Error::Input(InvalidInput {
        field,
        value: with_option_names(&input.value),
        allowed: with_option_names(&input.allowed),
        ..input
    })
}
