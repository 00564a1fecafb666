//! `iplw surface`: which latents a task's performance depends on.

use std::path::{Path, PathBuf};
use std::time::Instant;

use iplw::error::{Error, Result};
use iplw::estimate::Surface;
use iplw::estimate::surface::{Axis, Route};
use iplw::experiment::surface::{SurfaceConfig, surface};
use iplw::picture::surface::{Mark, surface_svg};
use iplw::task::{DEFAULT_FAMILY, Family, family};
use iplw::world::latent::FACTORS;

use super::{output, parse};

/// Jump-start performance over the latents of the simulation, in related environments whose physics is known: at a
/// few design points, with a Gaussian process between them. Its slope says how much each latent matters; `iplw
/// estimate --surface` spends actions accordingly.
#[derive(clap::Args)]
pub struct Args {
    /// A family (`iplw tasks` lists them).
    #[arg(long, default_value = DEFAULT_FAMILY)]
    task: String,
    /// `ideal`: actions that solve in the simulation are tried first, no learning (a minute or so); `dqn`: a policy
    /// is trained at every point (ten seconds or so each).
    #[arg(long, default_value = "ideal")]
    route: String,
    /// Design points.
    #[arg(long, default_value_t = 40)]
    points: usize,
    /// A grid with this many values of each factor instead of design points.
    #[arg(long)]
    grid: Option<usize>,
    /// What is varied.
    #[arg(long, default_value = "friction,restitution", value_delimiter = ',')]
    factors: Vec<String>,
    /// A related environment, `damping=..,density=..,friction=..,restitution=..`; latents not named are the prior's
    /// means. May be repeated; damping 0.7 and 0.6 if not given.
    #[arg(long = "related", value_name = "ENVIRONMENT")]
    related: Vec<String>,
    /// Actions sampled per task (ideal) or labelled per training task (dqn); the family's own if not given.
    #[arg(long)]
    actions: Option<usize>,
    /// A place to mark and to report on, `name:friction=..,restitution=..`; may be repeated.
    #[arg(long = "mark", value_name = "MARK")]
    marks: Vec<String>,
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Where to write the surface.
    #[arg(long, default_value = "surface.json")]
    out: PathBuf,
    /// Where to draw it.
    #[arg(long)]
    svg: Option<PathBuf>,
    /// Draw and report on a surface already found, instead of finding one.
    #[arg(long, conflicts_with_all = ["route", "points", "grid", "related", "actions"])]
    from: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<()> {
    let (found, family, seconds) = match &args.from {
        Some(path) => {
            let found = parsed(path)?;
            let family = family(&found.family)?;
            (found, family, None)
        }
        None => {
            let family = family(&args.task)?;
            let config = config(args, family)?;
            output::file("--out", &args.out)?;
            args.svg.as_deref().map_or(Ok(()), |svg| output::file("--svg", svg))?;
            let bar = output::Bar::new();
            let started = Instant::now();
            let found = surface(family, &config, &bar)?;
            bar.clear();
            output::write_whole(&args.out, found.to_json().as_bytes())?;
            (found, family, Some(started.elapsed().as_secs_f64()))
        }
    };
    let marks = args.marks.iter().map(|m| mark(m, found.base)).collect::<Result<Vec<_>>>()?;
    if let Some(path) = &args.svg {
        output::write_whole(path, surface_svg(&found, &marks)?.as_bytes())?;
    }
    let mut text = table(&found, family, &marks)?;
    if let Some(seconds) = seconds {
        text += &format!("{} points in {seconds:.1} s: {}\n", found.points.len(), args.out.display());
    }
    output::print(&text)
}

/// The surface in a file, which must be the family's.
pub fn read(path: &Path, family: &Family) -> Result<Surface> {
    let found = parsed(path)?;
    if found.family != family.name {
        let field = format!("{}: family", path.display());
        return Err(Error::input(field, format!("{:?}", found.family), format!("{:?}", family.name)));
    }
    Ok(found)
}

fn parsed(path: &Path) -> Result<Surface> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
    Surface::from_json(&text).map_err(|e| e.at(path.display()))
}

fn config(args: &Args, family: &Family) -> Result<SurfaceConfig> {
    let mut config = SurfaceConfig::new(family, Route::from_name(&args.route)?)?;
    let axis = |name: &String| Axis::of_prior(name.trim(), family.prior);
    config.axes = args.factors.iter().map(axis).collect::<Result<_>>()?;
    (config.points, config.grid, config.seed) = (args.points, args.grid, args.seed);
    if let Some(actions) = args.actions {
        (config.actions, config.labels) = (actions, actions);
    }
    if !args.related.is_empty() {
        let related = args.related.iter().map(|r| parse::related(r, config.base));
        config.related = related.collect::<Result<_>>()?;
    }
    config.validate()?;
    Ok(config)
}

/// `name:friction=..,restitution=..`
fn mark(text: &str, base: [f64; 3]) -> Result<Mark> {
    let Some((name, rest)) = text.split_once(':') else {
        return Err(Error::input("--mark", format!("{text:?}"), "name:friction=..,restitution=.."));
    };
    let given = parse::latents(rest)?.values();
    Ok(Mark { name: name.to_string(), latents: std::array::from_fn(|i| given[i].unwrap_or(base[i])) })
}

/// What the surface says, for people.
fn table(found: &Surface, family: &Family, marks: &[Mark]) -> Result<String> {
    let (low, high) = found
        .points
        .iter()
        .fold((1.0f64, 0.0f64), |(low, high), p| (low.min(p.performance), high.max(p.performance)));
    let mut text = format!(
        "{}, route {}: AUCCESS {low:.3} to {high:.3} over {} points, {} tasks, noise {:.3}\n\n",
        found.family,
        found.route.name(),
        found.points.len(),
        found.tasks,
        found.surrogate.noise
    );
    text += "over what the prior holds likely:\nfactor         mean |dP/d factor|   sd at a place   times the prior's deviation\n";
    let felt = found.sensitivities(family.prior)?;
    for s in &felt {
        text += &format!("{:<14} {:>18.3}   {:>13.3}   {:>10.3}\n", s.factor, s.slope, s.sd, s.stake);
    }
    let of = |name: &str| felt.iter().find(|s| s.factor == name);
    if let (Some(friction), Some(restitution)) = (of("friction"), of("restitution")) {
        text += &format!(
            "restitution over friction: {:.2} (per unit), {:.2} (per deviation of the prior)\n",
            restitution.slope / friction.slope,
            restitution.stake / friction.stake
        );
    }
    let predictor = found.predictor()?;
    for mark in marks {
        let (there, slope) = (predictor.at(mark.latents), predictor.gradient(mark.latents));
        text += &format!("\nat {}: AUCCESS {:.3} +- {:.3}", mark.name, there.mean, there.sd);
        for axis in &found.axes {
            let g = slope[axis.index()];
            text += &format!(", dP/d {} {:.3} +- {:.3}", FACTORS[axis.index()].name, g.mean, g.sd);
        }
        text += "\n";
    }
    Ok(text + "\n")
}
