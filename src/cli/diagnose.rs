//! `iplw diagnose`: the error of a simulation, from measured trials.

use std::path::{Path, PathBuf};

use iplw::commands::DiagnosisRequest;
use iplw::error::Result;
use iplw::inference::report::{Diagnosis, HeldOutError, ParameterEstimate};
use iplw::inference::{DiagnosisConfig, DiagnosisResult, diagnose};
use iplw::progress::Progress;
use iplw::reality::LoadedTrials;
use iplw::report::diagnosis::{self, DiagnosisDocument};
use iplw::world::effect;

use super::compact_json::compact_json;
use super::{joints, output, track_options};

/// Find out what a simulation gets wrong, from measured trials.
///
/// Compares measured trials with the simulation of a scene and names the missing effect with its parameters; several effects if the data
/// don't discriminate between them; or none if no effect in the library explains the misfit. Writes report.json, report.html,
/// extended_scene.json and figures.
///
/// The scene may have joints and motors (iplw.scene/2): trials are then measured joint positions and commands, as CSV with the columns
/// trial, t, every joint by its name, and JOINT.command for every motor; report.json, report.html, motion.svg and
/// extended_scene.json are written.
#[derive(clap::Args)]
#[command(after_long_help = track_options::EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    tracks: track_options::TrackOptions,
    /// Output directory.
    #[arg(long, help_heading = None::<&str>)]
    out: PathBuf,
    #[command(flatten, next_help_heading = None::<&'static str>)]
    request: DiagnosisRequest,
}

pub fn run(args: &Args) -> Result<()> {
    let seed = args.request.seed.unwrap_or(0);
    if let Some(read) = track_options::read_joints(&args.tracks)? {
        return joints::diagnose(&read.scene, &read.files, seed, &args.out);
    }
    let LoadedTrials { scene, trials, .. } = track_options::read(&args.tracks)?;
    output::prepare_directory("--out", &args.out)?;
    let bar = output::TerminalProgress::new();
    bar.report("segmenting trials", 0, 1)?;
    let found = diagnose(&scene, &trials, &DiagnosisConfig::standard(seed), &bar)?;
    bar.clear();
    write_report(&args.out, &found)?;
    output::print(&summary(&found.diagnosis, &args.out))
}

/// Writes report.json, report.html, extended_scene.json and the figures.
pub fn write_report(out: &Path, found: &DiagnosisResult) -> Result<()> {
    output::prepare_directory("--out", out)?;
    let json = compact_json(&found.diagnosis)?;
    output::write_whole(&out.join("report.json"), (json + "\n").as_bytes())?;
    output::write_whole(&out.join("extended_scene.json"), (found.extended.to_json() + "\n").as_bytes())?;
    let document = DiagnosisDocument::new(found);
    let figures = diagnosis::figures(&document);
    for figure in &figures {
        output::write_whole(&out.join(format!("{}.svg", figure.name)), figure.svg.as_bytes())?;
    }
    let page = diagnosis::report(&document, &figures, env!("CARGO_PKG_VERSION")).to_html();
    output::write_whole(&out.join("report.html"), page.as_bytes())
}

/// Text for a terminal.
fn summary(d: &Diagnosis, out: &Path) -> String {
    let mut text = format!("verdict: {}\n{}\n", d.verdict.name(), d.reason);
    for effect in &d.effects {
        let law = effect::find(&effect.name).map_or(String::new(), |e| format!(": {}", e.equation));
        text += &format!("  {}{law} (probability {:.2})\n", effect.name, effect.probability);
        for p in &effect.parameters {
            text += &format!("    {}\n", parameter(p));
        }
    }
    if d.rivals.len() > 1 {
        let sets: Vec<String> = d.rivals.iter().map(|r| r.join(" + ")).collect();
        text += &format!("equally good sets: {}\n", sets.join(" | "));
    }
    for c in &d.calibrated {
        let range =
            if c.identifiable { interval(&c.ci95) } else { "not identifiable from these trials".into() };
        text += &format!("  {} = {:.4} ({range})\n", c.name, c.value);
    }
    if let Some(r) = &d.residual {
        text += &format!(
            "error {:.5} m, measurement noise {:.5} m; probability of this error if the model were right: {:.1e}\n",
            r.base_rmse, r.floor_rmse, r.lack_of_fit_p
        );
    }
    for (what, gain) in [("held-out trials", &d.gain.held_out), ("a held-out setting", &d.gain.extrapolation)]
    {
        if let Some(g) = gain {
            text += &format!("on {what}: {}\n", describe_gain(g));
        }
    }
    if let Some(share) = d.unexplained_share {
        text += &format!("unexplained share of the excess error: {share:.3}\n");
    }
    if let Some(law) = &d.residual_law {
        text += &format!("empirical law for the residual: {}\n", law.formula);
        text += &format!("  with this law, on held-out trials: {}\n", describe_gain(&law.held_out));
        text += if law.offered {
            "  it is part of the extended scene\n"
        } else {
            "  it doesn't reduce the error there\n"
        };
    }
    if let Some(next) = &d.next_experiment {
        text += &format!("next: {} ({})\n", next.action, next.why);
    }
    text + &format!("report: {}\n", out.join("report.html").display())
}

fn parameter(p: &ParameterEstimate) -> String {
    let setting = p.setting.as_ref().map(|s| format!(" [{s}]")).unwrap_or_default();
    let spread = p.spread.map_or(String::new(), |s| format!(", sd between trials {s:.5}"));
    format!("{}{setting} = {:.5} {} ({}{spread})", p.name, p.value, p.unit, interval(&p.ci95))
}

fn interval(ends: &[Option<f64>; 2]) -> String {
    match ends {
        [Some(a), Some(b)] => format!("95 %: {a:.5} to {b:.5}"),
        _ => "unbounded by these trials".into(),
    }
}

fn describe_gain(g: &HeldOutError) -> String {
    let removed = match g.excess_removed {
        None => "no excess error".to_string(),
        Some(e) if e < 1.0 => format!("{:.1} % of the excess error removed", 100.0 * e),
        Some(_) => "all of the excess error removed".to_string(),
    };
    format!("error {:.5} m -> {:.5} m, floor {:.5} m: {removed}", g.base_rmse, g.extended_rmse, g.floor_rmse)
}
