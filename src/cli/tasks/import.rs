//! `iplw tasks import`: tasks that others wrote as families.

use std::fmt::Write as _;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;
use iplw::error::{Error, Result};
use iplw::task::phyre::{self, Said, Tasks};
use iplw::task::{Scene, custom};
use serde_json::{Value, json};

use super::taken::{Options, Plan, Taken, take};
use crate::cli::output;

#[derive(clap::Subcommand)]
pub enum Sub {
    /// PHYRE's tasks of one ball: a family for each template, phyre_00000 and so on.
    ///
    /// FILE holds them as one JSON object by task, TEMPLATE:TASK (docs/phyre_import.md: how to make it from PHYRE's own files, and
    /// how the physics differ). The solutions that come with a task are tried first, and certify it if they solve it here, too,
    /// however they are moved a little; how many do is told for each template. A task that none of them and no action of its
    /// sample certifies is left out.
    ///
    /// Stopped, it goes on where it was when it is begun again.
    Phyre(Phyre),
    /// Any scenes with goals and action spaces: a family.
    ///
    /// FILE has a line for each, an iplw.scene/1, or {"scene": .., "solutions": [[..], ..]} with actions that are said to solve
    /// it. All have the same action space. The family is named after the file.
    Scenes(Scenes),
}

#[derive(clap::Args)]
pub struct Phyre {
    /// JSON, plain or compressed by gzip.
    file: PathBuf,
    /// This template only; may be repeated.
    #[arg(long, value_name = "ID")]
    template: Vec<String>,
    #[command(flatten)]
    options: Options,
}

#[derive(clap::Args)]
pub struct Scenes {
    /// JSON lines, plain or compressed by gzip.
    file: PathBuf,
    /// The family's name; the file's if not given.
    #[arg(long)]
    name: Option<String>,
    /// What the family is about, one line.
    #[arg(long)]
    about: Option<String>,
    /// The real world of the family, density,friction,restitution,damping (kg/m^2; share of velocity kept per second), for all that
    /// carries latents. What the scenes say, which then has to be the same for all, if not given.
    #[arg(long, value_name = "D,F,R,K", value_delimiter = ',', num_args = 1)]
    real: Option<Vec<f64>>,
    #[command(flatten)]
    options: Options,
}

/// Most bytes of a file, once it is not compressed any more.
const MOST_BYTES: u64 = 64 << 20;

pub fn run(sub: &Sub) -> Result<()> {
    match sub {
        Sub::Phyre(args) => import_phyre(args),
        Sub::Scenes(args) => import_scenes(args),
    }
}

fn import_phyre(args: &Phyre) -> Result<()> {
    let tasks = Tasks::from_json(&text(&args.file)?).map_err(|e| e.at(args.file.display()))?;
    let known = tasks.templates();
    if let Some(unknown) = args.template.iter().find(|t| !known.contains(&t.as_str())) {
        let allowed = format!("one of {}", known.join(", "));
        return Err(Error::input("--template", format!("{unknown:?}"), allowed));
    }
    args.options.prepare()?;
    let wanted =
        known.into_iter().filter(|t| args.template.is_empty() || args.template.iter().any(|w| w == t));
    let mut all = Vec::new();
    output::print(&format!("{}\n", Taken::HEADER))?;
    for template in wanted {
        let taken = take(&template_plan(&tasks, template)?, &args.options)?;
        output::print(&format!("{taken}\n"))?;
        all.push(taken);
    }
    finish(&all, &args.options.out)
}

fn template_plan(tasks: &Tasks, template: &str) -> Result<Plan> {
    let (mut lines, mut unsaid) = (String::new(), Vec::new());
    for (_, said) in tasks.said(template) {
        match said {
            Ok(Said { scene, solutions }) => {
                line(&mut lines, &json!({"scene": scene, "solutions": solutions}))
            }
            Err(error) => unsaid.push(error.to_string()),
        }
    }
    let [density, ..] = phyre::PHYSICS;
    Ok(Plan {
        name: format!("phyre_{template}"),
        about: format!("PHYRE's template {template}: place a ball so that two bodies touch for 3 s"),
        real: phyre::PHYSICS,
        prior: format!("\n[prior]\ndensity = [{density:?}, {:?}]\n", density / 2.0),
        lines,
        unsaid,
    })
}

fn import_scenes(args: &Scenes) -> Result<()> {
    let all = text(&args.file)?;
    let stem = || {
        let name = args.file.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        name.split('.').next().unwrap_or_default().to_string()
    };
    let (mut lines, mut first) = (String::new(), None);
    for (i, text) in all.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        let refuse = |e: Error| e.at(format!("{}, line {}", args.file.display(), i + 1));
        let value: Value = iplw::json::parse(text).map_err(refuse)?;
        let scene = match value.get("scene") {
            Some(scene) => iplw::json::from_value(scene.clone()).map_err(|e| refuse(e.under("scene")))?,
            None => iplw::json::parse::<Scene>(text).map_err(refuse)?,
        };
        let scene = custom(scene).map_err(refuse)?.scene;
        if args.real.is_none() {
            let own = surfaces(&scene).map_err(refuse)?;
            let [density, friction, restitution] = *first.get_or_insert(own);
            if own != [density, friction, restitution] {
                let value = format!("density, friction and restitution {own:?}");
                let allowed = format!("{:?}, as in scenes before it, or --real", first.unwrap_or(own));
                return Err(refuse(Error::input("bodies", value, allowed)));
            }
        }
        line(&mut lines, &value);
    }
    let real = match (args.real.as_deref(), first) {
        (Some(&[density, friction, restitution, damping]), _) => [density, friction, restitution, damping],
        (Some(other), _) => {
            let allowed = "four numbers: density, friction, restitution, kept share of velocity per second";
            return Err(Error::input("--real", format!("{other:?}"), allowed));
        }
        (None, Some([density, friction, restitution])) => [density, friction, restitution, 1.0],
        (None, None) => return Err(Error::input("", "no scene", "a scene a line").at(args.file.display())),
    };
    args.options.prepare()?;
    let name = args.name.clone().unwrap_or_else(stem);
    let about = args.about.clone().unwrap_or_else(|| format!("scenes of {name}"));
    let plan = Plan { name, about, real, prior: String::new(), lines, unsaid: Vec::new() };
    let taken = take(&plan, &args.options)?;
    output::print(&format!("{}\n{taken}\n", Taken::HEADER))?;
    finish(&[taken], &args.options.out)
}

/// Density (kg/m^2), friction and restitution of what carries latents, which has to be the same for all of it.
fn surfaces(scene: &Scene) -> Result<[f64; 3]> {
    let carries = |name: &str| scene.carries_latents(name);
    let bodies = scene.bodies.iter().filter(|b| carries(&b.name));
    let mut own: Vec<(&str, [f64; 3])> =
        bodies.map(|b| (b.name.as_str(), [b.density.unwrap_or(1.0), b.friction, b.restitution])).collect();
    if let Some(body) = scene.bodies.iter().find(|b| carries(&b.name) && b.mass.is_some()) {
        let allowed = "a density, or --real: a family's bodies share one";
        return Err(Error::input("bodies", format!("{:?} with a mass", body.name), allowed));
    }
    let density = own.first().map_or(1.0, |(_, [density, ..])| *density);
    let statics = scene.statics.iter().filter(|s| carries(&s.name));
    own.extend(statics.map(|s| (s.name.as_str(), [density, s.friction, s.restitution])));
    let Some((_, first)) = own.first() else { return Ok([1.0, 0.5, 0.5]) };
    match own.iter().find(|(_, o)| o != first) {
        None => Ok(*first),
        Some((name, other)) => {
            let value = format!("{name:?} with density, friction and restitution {other:?}");
            let allowed = format!("{first:?} for all that carries latents (`carriers`), or --real");
            Err(Error::input("bodies", value, allowed))
        }
    }
}

fn line(lines: &mut String, value: &Value) {
    // Writing to a text does not fail.
    let _ = writeln!(lines, "{value}");
}

/// Says what is to be said of all, and fails if there is no task.
fn finish(all: &[Taken], out: &Path) -> Result<()> {
    let sum = |of: fn(&Taken) -> usize| all.iter().map(of).sum::<usize>();
    let (tasks, kept) = (sum(|t| t.tasks), sum(|t| t.kept));
    let (solve, solutions) = (sum(|t| t.solve), sum(|t| t.solutions));
    let mut text = String::new();
    for unsaid in all.iter().flat_map(|t| &t.unsaid) {
        text += &format!("left out, no scene here: {unsaid}\n");
    }
    text += &format!("{kept} of {tasks} tasks imported; {solve} of {solutions} solutions solve here\n");
    if kept == 0 {
        output::print(&text)?;
        return Err(Error::Failed("no task could be certified: nothing that was tried solves one".into()));
    }
    output::print(&format!("{text}families: {0} (iplw serve --tasks {0})\n", out.display()))
}

/// A file's text.
fn text(path: &Path) -> Result<String> {
    let failed = |e| Error::io(path, e);
    let mut file = File::open(path).map_err(failed)?;
    let mut magic = [0; 2];
    let begins = file.read(&mut magic).map_err(failed)?;
    let start = (&magic[..begins]).chain(file);
    let mut bytes = Vec::new();
    let read = if magic == [0x1f, 0x8b] {
        MultiGzDecoder::new(start).take(MOST_BYTES + 1).read_to_end(&mut bytes)
    } else {
        start.take(MOST_BYTES + 1).read_to_end(&mut bytes)
    };
    read.map_err(failed)?;
    if bytes.len() as u64 > MOST_BYTES {
        let allowed = format!("at most {MOST_BYTES} bytes, not compressed");
        return Err(Error::input("", "more", allowed).at(path.display()));
    }
    String::from_utf8(bytes)
        .map_err(|_| Error::input("", "no text", "JSON, plain or by gzip").at(path.display()))
}
