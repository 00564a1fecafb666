//! `iplw tasks import`: import of tasks as families.

use std::fmt::Write as _;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;
use iplw::error::{Error, Result};
use iplw::task::phyre::{self, PhyreScene, PhyreTasks};
use iplw::task::{Scene, custom};
use serde_json::{Value, json};

use super::family_import::{FamilySource, ImportOptions, ImportSummary, import_family};
use crate::cli::output;

#[derive(clap::Subcommand)]
pub enum ImportSource {
    /// Import PHYRE's one-ball tasks: one family for each template, phyre_00000 and so on.
    ///
    /// FILE is a JSON object of tasks by TEMPLATE:TASK (docs/how-to/import_tasks.md explains how to create it from PHYRE's files, and how the
    /// physics differ). A task is certified by one of its own solutions if that also works here when perturbed, otherwise by a sampled
    /// action; tasks without either are left out. The number of working solutions is reported for each template.
    ///
    /// An interrupted import resumes.
    Phyre(PhyreArgs),
    /// Import scenes with goals and action spaces as one family.
    ///
    /// Each line of FILE is an iplw.scene/1, or {"scene": .., "solutions": [[..], ..]} with actions that solve it. All scenes need the same
    /// action space. The family is named after the file.
    Scenes(ScenesArgs),
}

#[derive(clap::Args)]
pub struct PhyreArgs {
    /// JSON file, plain or gzip-compressed.
    file: PathBuf,
    /// Template to import; may be repeated [default: all]
    #[arg(long, value_name = "ID")]
    template: Vec<String>,
    #[command(flatten)]
    options: ImportOptions,
}

#[derive(clap::Args)]
pub struct ScenesArgs {
    /// JSON Lines file, plain or gzip-compressed.
    file: PathBuf,
    /// Name of the family [default: that of the file]
    #[arg(long)]
    name: Option<String>,
    /// One-line description of the family [default: scenes of NAME]
    #[arg(long)]
    about: Option<String>,
    /// Density (kg/m^2), friction, restitution and damping of the real world [default: the scenes']
    #[arg(long, value_name = "D,F,R,K", value_delimiter = ',', num_args = 1)]
    real: Option<Vec<f64>>,
    #[command(flatten)]
    options: ImportOptions,
}

/// Maximal size of a decompressed file, bytes.
const MAX_BYTES: u64 = 64 << 20;

pub fn run(sub: &ImportSource) -> Result<()> {
    match sub {
        ImportSource::Phyre(args) => import_phyre(args),
        ImportSource::Scenes(args) => import_scenes(args),
    }
}

fn import_phyre(args: &PhyreArgs) -> Result<()> {
    let tasks = PhyreTasks::from_json(&text(&args.file)?).map_err(|e| e.in_file(args.file.display()))?;
    let known = tasks.templates();
    if let Some(unknown) = args.template.iter().find(|t| !known.contains(&t.as_str())) {
        let allowed = format!("one of {}", known.join(", "));
        return Err(Error::input("--template", format!("{unknown:?}"), allowed));
    }
    args.options.prepare()?;
    let wanted =
        known.into_iter().filter(|t| args.template.is_empty() || args.template.iter().any(|w| w == t));
    let mut all = Vec::new();
    output::print(&format!("{}\n", ImportSummary::HEADER))?;
    for template in wanted {
        let summary = import_family(&template_plan(&tasks, template)?, &args.options)?;
        output::print(&format!("{summary}\n"))?;
        all.push(summary);
    }
    finish(&all, &args.options.out)
}

fn template_plan(tasks: &PhyreTasks, template: &str) -> Result<FamilySource> {
    let (mut lines, mut rejected) = (String::new(), Vec::new());
    for (_, parsed) in tasks.scenes(template) {
        match parsed {
            Ok(PhyreScene { scene, solutions }) => {
                line(&mut lines, &json!({"scene": scene, "solutions": solutions}))
            }
            Err(error) => rejected.push(error.to_string()),
        }
    }
    let [density, ..] = phyre::PHYSICS;
    Ok(FamilySource {
        name: format!("phyre_{template}"),
        about: format!("PHYRE's template {template}: place a ball so that two bodies touch for 3 s"),
        real: phyre::PHYSICS,
        prior: format!("\n[prior]\ndensity = [{density:?}, {:?}]\n", density / 2.0),
        lines,
        rejected,
    })
}

fn import_scenes(args: &ScenesArgs) -> Result<()> {
    let all = text(&args.file)?;
    let stem = || {
        let name = args.file.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        name.split('.').next().unwrap_or_default().to_string()
    };
    let (mut lines, mut first) = (String::new(), None);
    for (i, text) in all.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        let refuse = |e: Error| e.in_file(format!("{}, line {}", args.file.display(), i + 1));
        let value: Value = iplw::json::parse(text).map_err(refuse)?;
        let scene = match value.get("scene") {
            Some(scene) => iplw::json::from_value(scene.clone()).map_err(|e| refuse(e.in_field("scene")))?,
            None => iplw::json::parse::<Scene>(text).map_err(refuse)?,
        };
        let scene = custom(scene).map_err(refuse)?.scene;
        if args.real.is_none() {
            let own = surface_parameters(&scene).map_err(refuse)?;
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
            let allowed =
                "four numbers: density, friction, restitution, share of velocity retained per second";
            return Err(Error::input("--real", format!("{other:?}"), allowed));
        }
        (None, Some([density, friction, restitution])) => [density, friction, restitution, 1.0],
        (None, None) => {
            return Err(Error::input("", "no scene", "a scene a line").in_file(args.file.display()));
        }
    };
    args.options.prepare()?;
    let name = args.name.clone().unwrap_or_else(stem);
    let about = args.about.clone().unwrap_or_else(|| format!("scenes of {name}"));
    let plan = FamilySource { name, about, real, prior: String::new(), lines, rejected: Vec::new() };
    let summary = import_family(&plan, &args.options)?;
    output::print(&format!("{}\n{summary}\n", ImportSummary::HEADER))?;
    finish(&[summary], &args.options.out)
}

/// The common density (kg/m^2), friction and restitution of all bodies and statics that carry latents.
fn surface_parameters(scene: &Scene) -> Result<[f64; 3]> {
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
    // Writing to a String can't fail.
    let _ = writeln!(lines, "{value}");
}

/// Prints a summary of all families; an error if no task was imported.
fn finish(all: &[ImportSummary], out: &Path) -> Result<()> {
    let sum = |of: fn(&ImportSummary) -> usize| all.iter().map(of).sum::<usize>();
    let (tasks, kept) = (sum(|t| t.tasks), sum(|t| t.imported));
    let (solve, solutions) = (sum(|t| t.solve), sum(|t| t.solutions));
    let mut text = String::new();
    for rejected in all.iter().flat_map(|t| &t.rejected) {
        text += &format!("left out, invalid scene: {rejected}\n");
    }
    text += &format!("{kept} of {tasks} tasks imported; {solve} of {solutions} solutions solve here\n");
    if kept == 0 {
        output::print(&text)?;
        return Err(Error::Failed(
            "no task could be certified: no solution or sampled action solves one".into(),
        ));
    }
    output::print(&format!("{text}families: {0} (iplw serve --tasks {0})\n", out.display()))
}

/// Reads a text file, plain or gzip-compressed.
fn text(path: &Path) -> Result<String> {
    let failed = |e| Error::io(path, e);
    let mut file = File::open(path).map_err(failed)?;
    let mut magic = [0; 2];
    let begins = file.read(&mut magic).map_err(failed)?;
    let start = (&magic[..begins]).chain(file);
    let mut bytes = Vec::new();
    let read = if magic == [0x1f, 0x8b] {
        MultiGzDecoder::new(start).take(MAX_BYTES + 1).read_to_end(&mut bytes)
    } else {
        start.take(MAX_BYTES + 1).read_to_end(&mut bytes)
    };
    read.map_err(failed)?;
    if bytes.len() as u64 > MAX_BYTES {
        let allowed = format!("at most {MAX_BYTES} bytes, not compressed");
        return Err(Error::input("", "more", allowed).in_file(path.display()));
    }
    String::from_utf8(bytes)
        .map_err(|_| Error::input("", "no text", "JSON, plain or by gzip").in_file(path.display()))
}
