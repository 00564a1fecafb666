//! Options that say what measured tracks are of and how their files are to be read.

use std::io::{Error as IoError, ErrorKind};
use std::path::{Path, PathBuf};

use iplw::budget::Endless;
use iplw::error::{Error, Input, Result};
use iplw::reality::{File, Gathered, Of, Reading, decode, gather};
use iplw::task::Scene;
use iplw::task::ball::{Ball, GRAVITY};

/// Measured tracks, and what they are of.
#[derive(clap::Args)]
pub struct Tracks {
    /// Measured trials (CSV: `trial,t,body,x,y`), or tracks of one body as Tracker, Kinovea or a data frame write them:
    /// columns such as `t`, `Time (s)` or `frame`, `x`, `X [m]`, `pos_x` or `pixelx`. May be repeated: several files are
    /// several trials, each named after its file unless a column `trial` names them. At least four trials are needed.
    #[arg(long, required = true, value_name = "FILE", num_args = 1..)]
    trials: Vec<PathBuf>,
    /// The scene (iplw.scene/1) that they are of. Where one ball flies, --radius does instead.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["radius", "mass", "gravity", "floor"])]
    scene: Option<PathBuf>,
    /// Radius of the only ball, m. (--radius, --mass, --gravity and --floor make the scene.)
    #[arg(long, value_name = "M", help_heading = ONE_BALL, allow_negative_numbers = true)]
    radius: Option<f64>,
    /// Its mass, kg. No acceleration that is looked for depends on it; it stands in the extended scene.
    #[arg(long, value_name = "KG", help_heading = ONE_BALL, allow_negative_numbers = true)]
    mass: Option<f64>,
    /// Gravity, m/s^2, downwards.
    #[arg(long, value_name = "G", help_heading = ONE_BALL, allow_negative_numbers = true, default_value_t = GRAVITY)]
    gravity: f64,
    /// Height of the floor's surface, m, if there is one to bounce off: restitution and friction are estimated along.
    #[arg(long, value_name = "M", help_heading = ONE_BALL, allow_negative_numbers = true)]
    floor: Option<f64>,
    /// Pictures a second: times are numbers of pictures (a column `frame`, or a time without a unit).
    #[arg(long, value_name = "N", help_heading = UNITS, allow_negative_numbers = true)]
    fps: Option<f64>,
    /// Size of a pixel, m: coordinates are in pixels. A floor's height then is that in m, too.
    #[arg(long, value_name = "M", help_heading = UNITS, allow_negative_numbers = true)]
    metres_per_pixel: Option<f64>,
    /// Unit of coordinates whose column names none: m, cm, mm, um, km, in, ft.
    #[arg(long, value_name = "UNIT", help_heading = UNITS)]
    length_unit: Option<String>,
    /// Unit of times whose column names none: s, ms, us, min.
    #[arg(long, value_name = "UNIT", help_heading = UNITS)]
    time_unit: Option<String>,
    /// y is counted downwards, as in pictures: a point in row 700 is at -700 times the size of a pixel.
    #[arg(long, help_heading = UNITS, conflicts_with = "y_up")]
    y_down: bool,
    /// y points up, even if things seem to fall upwards.
    #[arg(long, help_heading = UNITS)]
    y_up: bool,
    /// Which track, or body, to read of files that hold several.
    #[arg(long, value_name = "NAME", help_heading = UNITS)]
    track: Option<String>,
}

/// Of reading tracks, for the help.
pub const EXAMPLES: &str = "\
Examples:
  A scene and trials, as `iplw measure` writes them:
    iplw diagnose --scene scene.json --trials trials.csv --out report
  A ping-pong ball filmed in flight, a file of Tracker's for each throw:
    iplw diagnose --trials throw*.txt --radius 0.02 --mass 0.0027 --out report
  The same from pixels, pictures and rows counted from above, bouncing on a table in row 700:
    iplw diagnose --trials throws.csv --radius 0.02 --floor=-1.05 --fps 240 --metres-per-pixel 0.0015 --y-down --out report

Units that cannot be (a ball that falls with a thousand times gravity) are refused, with what to give.";

const ONE_BALL: &str = "Where one ball flies, instead of --scene";
const UNITS: &str = "What the files do not say of themselves";

/// Reads the files; what the user should know goes to standard error.
pub fn read(args: &Tracks) -> Result<Gathered> {
    let gathered = gathered(args).map_err(|e| as_options(e, args.scene.is_none()))?;
    for note in &gathered.notes {
        eprintln!("note: {}", spelt(note));
    }
    Ok(gathered)
}

fn gathered(args: &Tracks) -> Result<Gathered> {
    let files = || {
        let read = |p: &PathBuf| Ok(File { name: p.display().to_string(), text: text(p)? });
        args.trials.iter().map(read).collect::<Result<Vec<_>>>()
    };
    match (&args.scene, args.radius) {
        (Some(path), _) => {
            let scene = Scene::from_json(&text(path)?).map_err(|e| e.at(path.display()))?;
            gather(&files()?, Of::Scene(&scene), &reading(args), &Endless)
        }
        (None, Some(radius)) => {
            let ball = Ball { radius, mass: args.mass, gravity: args.gravity, floor: args.floor };
            gather(&files()?, Of::Ball(&ball), &reading(args), &Endless)
        }
        (None, None) => {
            let allowed = "a scene file; or, where one ball flies, --radius (and --mass, --gravity, --floor)";
            Err(Error::input("--scene", "missing", allowed))
        }
    }
}

fn reading(args: &Tracks) -> Reading {
    Reading {
        fps: args.fps,
        metres_per_pixel: args.metres_per_pixel,
        length_unit: args.length_unit.clone(),
        time_unit: args.time_unit.clone(),
        y_down: (args.y_down || args.y_up).then_some(args.y_down),
        track: args.track.clone(),
    }
}

/// A file that the user named; one that cannot be read is bad input.
fn text(path: &Path) -> Result<String> {
    let unreadable = |e: IoError| Error::input("", e, "a file that can be read").at(path.display());
    if path.is_dir() {
        return Err(unreadable(IoError::new(ErrorKind::IsADirectory, "a directory")));
    }
    let bytes = std::fs::read(path).map_err(unreadable)?;
    decode(bytes).map_err(|e| e.at(path.display()))
}

/// Fields of [`Reading`] and [`Ball`] that are options here.
const FIELDS: [&str; 10] = [
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

/// A text that speaks of fields, with the options that set them.
fn spelt(text: &str) -> String {
    let option = |name: &str| format!("--{}", name.replace('_', "-"));
    let text = text.replace("`y_down` false", "--y-up");
    FIELDS.iter().fold(text, |text, name| text.replace(&format!("`{name}`"), &option(name)))
}

/// An error whose field is an option, where it speaks of no file.
fn as_options(error: Error, ball: bool) -> Error {
    let Error::Input(input) = error else { return error };
    let own = input.place.is_empty() && FIELDS.contains(&input.field.as_str());
    let of_ball = ["radius", "mass", "gravity", "floor"].contains(&input.field.as_str());
    let field = if own && (ball || !of_ball) { spelt(&format!("`{}`", input.field)) } else { input.field };
    Error::Input(Input { field, value: spelt(&input.value), allowed: spelt(&input.allowed), ..input })
}
