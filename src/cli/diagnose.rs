//! `iplw diagnose`: what the simulation gets wrong, from measured trials.

use std::path::{Path, PathBuf};

use iplw::discover::report::{Diagnosis, FoundParameter, HeldOut};
use iplw::discover::{Config, Finding, diagnose};
use iplw::error::{Error, Result};
use iplw::picture::report::{Block, Report, Section};
use iplw::progress::Progress;
use iplw::reality::read_trials;
use iplw::task::Scene;

use super::evidence::{Plot, plots};
use super::output;

/// Compares measured trials with the scene's simulation and says what the simulation lacks: the effect by name with
/// its parameters, several if the data cannot tell them apart, or that nothing in the library explains the misfit.
/// Writes report.json, report.html, extended_scene.json and the plots.
#[derive(clap::Args)]
pub struct Args {
    /// The scene (iplw.scene/1).
    #[arg(long)]
    scene: PathBuf,
    /// Measured trials (CSV).
    #[arg(long)]
    trials: PathBuf,
    /// Directory for the report.
    #[arg(long)]
    out: PathBuf,
    /// Seed of the draws of signs that tell an effect from chance.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

pub fn run(args: &Args) -> Result<()> {
    let text = std::fs::read_to_string(&args.scene).map_err(|e| unreadable(&args.scene, &e))?;
    let scene = Scene::from_json(&text).map_err(|e| e.at(args.scene.display()))?;
    if !args.trials.is_file() {
        let e = std::io::Error::new(std::io::ErrorKind::NotFound, "no such file");
        return Err(unreadable(&args.trials, &e));
    }
    let trials = read_trials(&args.trials, &scene)?;
    output::directory("--out", &args.out)?;
    let bar = output::Bar::new();
    bar.report("cutting trials into windows", 0, 1)?;
    let found = diagnose(&scene, &trials, &Config::standard(args.seed), &bar)?;
    bar.clear();
    write_report(&args.out, &scene, &found)?;
    output::print(&summary(&found.diagnosis, &args.out))
}

/// Writes report.json, report.html, extended_scene.json and the plots.
pub fn write_report(out: &Path, scene: &Scene, found: &Finding) -> Result<()> {
    output::directory("--out", out)?;
    let json = serde_json::to_string_pretty(&found.diagnosis).map_err(|e| Error::Failed(e.to_string()))?;
    output::write_whole(&out.join("report.json"), (json + "\n").as_bytes())?;
    output::write_whole(&out.join("extended_scene.json"), (found.extended.to_json() + "\n").as_bytes())?;
    let plots = plots(&found.evidence);
    for (name, _, svg) in &plots {
        output::write_whole(&out.join(format!("{name}.svg")), svg.as_bytes())?;
    }
    let page = page(scene, &found.diagnosis, &plots).to_html();
    output::write_whole(&out.join("report.html"), page.as_bytes())
}

/// A file that the user named and that cannot be read is bad input.
fn unreadable(path: &Path, error: &std::io::Error) -> Error {
    Error::input("", error, "a file that can be read").at(path.display())
}

/// For a terminal.
fn summary(d: &Diagnosis, out: &Path) -> String {
    let mut text = format!("verdict: {}\n{}\n", d.verdict.name(), d.reason);
    for effect in &d.effects {
        text += &format!("  {} (acts on {}), p = {:.1e}\n", effect.name, effect.acts_on, effect.p_value);
        for p in &effect.parameters {
            text += &format!("    {}\n", parameter(p));
        }
    }
    if d.rivals.len() > 1 {
        let sets: Vec<String> = d.rivals.iter().map(|r| r.join(" + ")).collect();
        text += &format!("sets that tie: {}\n", sets.join(" | "));
    }
    for c in &d.calibrated {
        let known = if c.identifiable { interval(&c.ci95) } else { "not told by these trials".into() };
        text += &format!("  {} = {:.4} ({known})\n", c.name, c.value);
    }
    text += &format!(
        "error {:.5} m, noise floor {:.5} m, p of no misfit {:.1e}\n",
        d.residual.base_rmse, d.residual.floor_rmse, d.residual.lack_of_fit_p
    );
    for (what, gain) in
        [("held-out trials", &d.gain.held_out), ("a setting never fitted", &d.gain.extrapolation)]
    {
        if let Some(g) = gain {
            text += &format!("on {what}: {}\n", gained(g));
        }
    }
    if let Some(share) = d.unexplained_share {
        text += &format!("unexplained share of the excess error: {share:.3}\n");
    }
    if let Some(law) = &d.residual_law {
        text += &format!("what is left looks like: {}\n", law.formula);
        text += &format!("  with it, on held-out trials: {}\n", gained(&law.held_out));
        text += if law.offered { "  it is in the extended scene\n" } else { "  it does not help there\n" };
    }
    if let Some(next) = &d.next_experiment {
        text += &format!("next: {} ({})\n", next.action, next.why);
    }
    text + &format!("report: {}\n", out.join("report.html").display())
}

fn parameter(p: &FoundParameter) -> String {
    let setting = p.setting.as_ref().map(|s| format!(" [{s}]")).unwrap_or_default();
    format!("{}{setting} = {:.5} {} ({})", p.name, p.value, p.unit, interval(&p.ci95))
}

fn interval(ends: &[Option<f64>; 2]) -> String {
    match ends {
        [Some(a), Some(b)] => format!("95 %: {a:.5} to {b:.5}"),
        _ => "no bound from these trials".into(),
    }
}

fn gained(g: &HeldOut) -> String {
    let removed = g
        .excess_removed
        .map_or("no excess to remove".into(), |e| format!("{:.1} % of the excess gone", 100.0 * e));
    format!("error {:.5} m -> {:.5} m, floor {:.5} m: {removed}", g.base_rmse, g.extended_rmse, g.floor_rmse)
}

fn page(scene: &Scene, d: &Diagnosis, plots: &[Plot]) -> Report {
    let number = |v: f64| format!("{v:.6}");
    let mut found = vec![Block::KeyValues(vec![
        ("verdict".into(), d.verdict.name().into()),
        ("why".into(), d.reason.clone()),
        ("error of the base model, m".into(), number(d.residual.base_rmse)),
        ("noise floor, m".into(), number(d.residual.floor_rmse)),
        ("p of no misfit".into(), format!("{:.2e}", d.residual.lack_of_fit_p)),
        ("p of white residuals".into(), format!("{:.2e}", d.residual.whiteness_p)),
        ("correlation of the noise".into(), format!("{:.2}", d.residual.noise_correlation)),
        (
            "unexplained share of the excess".into(),
            d.unexplained_share.map_or("nothing to explain".into(), |s| format!("{s:.3}")),
        ),
    ])];
    if let Some(law) = &d.residual_law {
        let text = match law.offered {
            true => "What is left, as an acceleration without a name; it is part of the extended scene:",
            false => "What is left, as an acceleration without a name; on held-out trials it does not help:",
        };
        found.push(Block::Text(text.into()));
        found.push(Block::Code(law.formula.clone()));
    }
    let rows: Vec<Vec<String>> = d
        .effects
        .iter()
        .flat_map(|e| e.parameters.iter().map(move |p| (e, p)))
        .map(|(e, p)| {
            vec![
                e.name.clone(),
                p.name.clone(),
                p.setting.clone().unwrap_or_default(),
                format!("{:.6}", p.value),
                p.unit.clone(),
                interval(&p.ci95),
                format!("{:.1e}", e.p_value),
            ]
        })
        .collect();
    let columns = |names: &[&str]| names.iter().map(|n| n.to_string()).collect::<Vec<_>>();
    let mut sections = vec![Section { heading: "What was found".into(), blocks: found }];
    if !rows.is_empty() {
        let columns = columns(&["effect", "parameter", "setting", "value", "unit", "interval", "p"]);
        let note = "p is corrected for the search over the library".to_string();
        sections
            .push(Section { heading: "Effects".into(), blocks: vec![Block::Table { columns, rows, note }] });
    }
    if d.rivals.len() > 1 {
        let text = d.rivals.iter().map(|r| r.join(" + ")).collect::<Vec<_>>().join("\n\n");
        sections.push(Section { heading: "Sets that tie".into(), blocks: vec![Block::Text(text)] });
    }
    if let Some(next) = &d.next_experiment {
        let text = format!("{}\n\nWhy: {}", next.action, next.why);
        sections.push(Section { heading: "Next experiment".into(), blocks: vec![Block::Text(text)] });
    }
    if !d.calibrated.is_empty() {
        let rows = d
            .calibrated
            .iter()
            .map(|c| {
                let known =
                    if c.identifiable { interval(&c.ci95) } else { "not told by these trials".into() };
                vec![c.name.clone(), format!("{:.5}", c.value), known]
            })
            .collect();
        let columns = columns(&["latent", "value", "interval"]);
        let note = String::new();
        sections
            .push(Section { heading: "Latents".into(), blocks: vec![Block::Table { columns, rows, note }] });
    }
    let law = d.residual_law.as_ref().map(|l| &l.held_out);
    let gains: Vec<Vec<String>> = [
        ("held-out trials", d.gain.held_out.as_ref()),
        ("held-out trials, with the law without a name", law),
        ("a setting never fitted", d.gain.extrapolation.as_ref()),
    ]
    .iter()
    .filter_map(|(what, g)| {
        let g = (*g)?;
        Some(vec![
            what.to_string(),
            g.trials.to_string(),
            number(g.base_rmse),
            number(g.extended_rmse),
            number(g.floor_rmse),
            g.excess_removed.map_or("-".into(), |e| format!("{e:.4}")),
        ])
    })
    .collect();
    if !gains.is_empty() {
        let columns = columns(&["on", "trials", "base, m", "extended, m", "floor, m", "excess removed"]);
        let note = "Starts are fitted for every trial; everything else comes from other trials.".to_string();
        let blocks = vec![Block::Table { columns, rows: gains, note }];
        sections.push(Section { heading: "Gain".into(), blocks });
    }
    let pictures = plots
        .iter()
        .map(|(_, caption, svg)| Block::Svg { svg: svg.clone(), caption: caption.clone() })
        .collect();
    sections.push(Section { heading: "Residuals before and after".into(), blocks: pictures });
    let rows = d
        .considered
        .iter()
        .map(|c| {
            vec![
                c.effects.join(" + "),
                format!("{:.4}", c.held_out),
                format!("{:.1e}", c.p_value),
                if c.accepted { "yes" } else { "no" }.into(),
            ]
        })
        .collect();
    let columns = columns(&["set", "held-out error over noise (mean square)", "p", "accepted"]);
    let table = Block::Table { columns, rows, note: "Best first.".into() };
    let blocks = vec![Block::Details { summary: "every set that was fitted".into(), blocks: vec![table] }];
    sections.push(Section { heading: "What was considered".into(), blocks });
    let name = if scene.name.is_empty() { "a scene".to_string() } else { scene.name.clone() };
    Report { title: format!("Diagnosis of {name}"), lead: d.reason.clone(), sections }
}
