//! `iplw surface`: dependence of task performance on the latents.

use std::path::{Path, PathBuf};
use std::time::Instant;

use iplw::commands::SurfaceRequest;
use iplw::error::{Error, Result};
use iplw::estimate::PerformanceSurface;
use iplw::experiment::surface::{SurfaceConfig, surface};
use iplw::picture::surface::{Mark, surface_svg};
use iplw::task::{Family, family};
use iplw::world::latent::FACTORS;

use super::{output, parse};

/// Compute how task performance depends on the latents (a performance surface).
///
/// Computes jump-start performance over the latents of the simulation in related environments with known physics: at design points,
/// interpolated by a Gaussian process. Its gradient shows how much each latent matters; `iplw estimate --surface` chooses actions
/// accordingly.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    request: SurfaceRequest,
    /// Values per factor of a grid that replaces the design points [default: no grid]
    #[arg(long)]
    grid: Option<usize>,
    /// Related environment: damping=..,friction=..,..; may be repeated [default: damping 0.7 and 0.6]
    #[arg(long = "related", value_name = "ENVIRONMENT")]
    related: Vec<String>,
    /// Point to mark and report, name:friction=..,restitution=..; may be repeated.
    #[arg(long = "mark", value_name = "MARK")]
    marks: Vec<String>,
    /// Output file.
    #[arg(long, default_value = "surface.json")]
    out: PathBuf,
    /// Output file of a plot [default: none]
    #[arg(long)]
    svg: Option<PathBuf>,
    /// Plot and report an existing surface file instead of computing one.
    #[arg(long, conflicts_with_all = ["route", "points", "grid", "related", "actions"])]
    from: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<()> {
    let (found, family, seconds) = match &args.from {
        Some(path) => {
            let found = parse_surface(path)?;
            let family = family(&found.family)?;
            (found, family, None)
        }
        None => {
            let family = family(&args.request.task)?;
            let config = config(args, family)?;
            output::prepare_file("--out", &args.out)?;
            args.svg.as_deref().map_or(Ok(()), |svg| output::prepare_file("--svg", svg))?;
            let bar = output::TerminalProgress::new();
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

/// Reads the surface of a family from a file.
pub fn read(path: &Path, family: &Family) -> Result<PerformanceSurface> {
    let found = parse_surface(path)?;
    if found.family != family.name {
        let field = format!("{}: family", path.display());
        return Err(Error::input(field, format!("{:?}", found.family), format!("{:?}", family.name)));
    }
    Ok(found)
}

fn parse_surface(path: &Path) -> Result<PerformanceSurface> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, e))?;
    PerformanceSurface::from_json(&text).map_err(|e| e.in_file(path.display()))
}

fn config(args: &Args, family: &Family) -> Result<SurfaceConfig> {
    let mut config = args.request.config(family)?;
    config.grid = args.grid;
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

/// The surface as text.
fn table(found: &PerformanceSurface, family: &Family, marks: &[Mark]) -> Result<String> {
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
    text += "averaged over the prior:\nfactor         mean |dP/d factor|   sd at a point   times the prior's sd\n";
    let felt = found.sensitivities(family.prior)?;
    for s in &felt {
        text += &format!("{:<14} {:>18.3}   {:>13.3}   {:>10.3}\n", s.factor, s.slope, s.sd, s.stake);
    }
    let of = |name: &str| felt.iter().find(|s| s.factor == name);
    if let (Some(friction), Some(restitution)) = (of("friction"), of("restitution")) {
        text += &format!(
            "restitution over friction: {:.2} (per unit), {:.2} (per prior sd)\n",
            restitution.slope / friction.slope,
            restitution.stake / friction.stake
        );
    }
    let predictor = found.predictor()?;
    for mark in marks {
        let (there, slope) = (predictor.predict(mark.latents), predictor.gradient(mark.latents));
        text += &format!("\nat {}: AUCCESS {:.3} +- {:.3}", mark.name, there.mean, there.sd);
        for axis in &found.axes {
            let g = slope[axis.index()];
            text += &format!(", dP/d {} {:.3} +- {:.3}", FACTORS[axis.index()].name, g.mean, g.sd);
        }
        text += "\n";
    }
    Ok(text + "\n")
}
