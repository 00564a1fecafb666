//! `iplw diagnose`: the error of a simulation, from measured trials.

use std::path::{Path, PathBuf};

use iplw::commands::DiagnosisRequest;
use iplw::error::Result;
use iplw::inference::report::{
    CalibratedLatent, Diagnosis, EffectEstimate, HeldOutError, ModelScore, ParameterEstimate,
};
use iplw::inference::{DiagnosisConfig, DiagnosisResult, diagnose};

use iplw::picture::report::{Block, HtmlReport, Section};
use iplw::progress::Progress;
use iplw::reality::LoadedTrials;
use iplw::task::Scene;
use iplw::world::effect;

use super::compact_json::compact_json;
use super::residual_plots::{PlotFile, plots};
use super::{output, track_options, trajectory_plots, trial_plots};

/// Find out what a simulation gets wrong, from measured trials.
///
/// Compares measured trials with the simulation of a scene and names the missing effect with its parameters; several effects if the data
/// don't discriminate between them; or none if no effect in the library explains the misfit. Writes report.json, report.html,
/// extended_scene.json and plots.
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
    let LoadedTrials { scene, trials, .. } = track_options::read(&args.tracks)?;
    output::prepare_directory("--out", &args.out)?;
    let bar = output::TerminalProgress::new();
    bar.report("segmenting trials", 0, 1)?;
    let found = diagnose(&scene, &trials, &DiagnosisConfig::standard(args.request.seed.unwrap_or(0)), &bar)?;
    bar.clear();
    write_report(&args.out, &scene, &found)?;
    output::print(&summary(&found.diagnosis, &args.out))
}

/// Writes report.json, report.html, extended_scene.json and the plots.
pub fn write_report(out: &Path, scene: &Scene, found: &DiagnosisResult) -> Result<()> {
    output::prepare_directory("--out", out)?;
    let json = compact_json(&found.diagnosis)?;
    output::write_whole(&out.join("report.json"), (json + "\n").as_bytes())?;
    output::write_whole(&out.join("extended_scene.json"), (found.extended.to_json() + "\n").as_bytes())?;
    let pictures = DiagnosisFigures {
        residuals: plots(&found.evidence),
        sizes: trial_plots::estimate_figures(&found.diagnosis),
        predictive: found.diagnosis.predictive.iter().map(trial_plots::predictive_figure).collect(),
        paths: trajectory_plots::trajectory_figures(&found.diagnosis),
        left: found.diagnosis.field.iter().filter_map(trajectory_plots::residual_field_figure).collect(),
    };
    for (name, _, svg) in pictures.all() {
        output::write_whole(&out.join(format!("{name}.svg")), svg.as_bytes())?;
    }
    let page = page(scene, &found.diagnosis, &pictures).to_html();
    output::write_whole(&out.join("report.html"), page.as_bytes())
}

/// Plots by section of the report.
struct DiagnosisFigures {
    residuals: Vec<PlotFile>,
    sizes: Vec<PlotFile>,
    predictive: Vec<PlotFile>,
    paths: Vec<PlotFile>,
    left: Vec<PlotFile>,
}

impl DiagnosisFigures {
    fn all(&self) -> impl Iterator<Item = &PlotFile> {
        [&self.sizes, &self.predictive, &self.paths, &self.left, &self.residuals].into_iter().flatten()
    }
}

fn figure_blocks(plots: &[PlotFile]) -> Vec<Block> {
    let block = |(_, caption, svg): &PlotFile| Block::Svg { svg: svg.clone(), caption: caption.clone() };
    plots.iter().map(block).collect()
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

/// The report: findings first, alternatives last; empty sections are left out.
fn page(scene: &Scene, d: &Diagnosis, pictures: &DiagnosisFigures) -> HtmlReport {
    let check = d.predictive.iter().map(|p| Block::Text(trial_plots::predictive_summary(p)));
    let sections = [
        section("Findings", finding_blocks(d)),
        section("Effects", table(effects(d), "p-values are corrected for the search over the library")),
        section("Equally good sets", tied_sets(d)),
        section("Next experiment", next_experiment(d)),
        section("Latents", table(latents(d), "")),
        section(
            "Gain",
            table(
                gains(d),
                "Initial states are fitted for every trial; all other parameters come from the other trials.",
            ),
        ),
        section("Estimates by trial", figure_blocks(&pictures.sizes)),
        section("Predictive check", check.chain(figure_blocks(&pictures.predictive)).collect()),
        section("Trajectories before and after", figure_blocks(&pictures.paths)),
        section("Residual force field", residual_field_blocks(d, pictures)),
        section("Residuals before and after", figure_blocks(&pictures.residuals)),
        section("Alternatives", rivals(d)),
    ];
    let name = if scene.name.is_empty() { "a scene".to_string() } else { scene.name.clone() };
    HtmlReport {
        title: format!("Diagnosis of {name}"),
        lead: d.reason.clone(),
        sections: sections.into_iter().filter(|s| !s.blocks.is_empty()).collect(),
    }
}

fn section(heading: &str, blocks: Vec<Block>) -> Section {
    Section { heading: heading.into(), blocks }
}

/// Number of sets that the report shows uncollapsed.
const MAX_LISTED_SETS: usize = 8;

/// Column names and rows of a table.
type TableRows = (&'static [&'static str], Vec<Vec<String>>);

/// A table, unless it has no rows.
fn table((columns, rows): TableRows, note: &str) -> Vec<Block> {
    if rows.is_empty() {
        return Vec::new();
    }
    let columns = columns.iter().map(|n| n.to_string()).collect();
    vec![Block::Table { columns, rows, note: note.into() }]
}

fn number(v: f64) -> String {
    format!("{v:.6}")
}

fn finding_blocks(d: &Diagnosis) -> Vec<Block> {
    let mut facts: Vec<(String, String)> =
        vec![("verdict".into(), d.verdict.name().into()), ("why".into(), d.reason.clone())];
    if let Some(r) = &d.residual {
        facts.extend([
            ("error of the base model, m".into(), number(r.base_rmse)),
            ("noise floor, m".into(), number(r.floor_rmse)),
            ("probability of this error if the model were right".into(), format!("{:.2e}", r.lack_of_fit_p)),
            ("p-value of the hypothesis of white residuals".into(), format!("{:.2e}", r.whiteness_p)),
            ("correlation of the noise".into(), format!("{:.2}", r.noise_correlation)),
            (
                "unexplained share of the excess error".into(),
                d.unexplained_share.map_or("no excess error".into(), |s| format!("{s:.3}")),
            ),
        ]);
    }
    let mut blocks = vec![Block::KeyValues(facts)];
    if let Some(law) = &d.residual_law {
        let text = match law.offered {
            true => "Empirical acceleration law for the residual; it is part of the extended scene:",
            false => {
                "Empirical acceleration law for the residual; it doesn't reduce the error on held-out trials:"
            }
        };
        blocks.push(Block::Text(text.into()));
        blocks.push(Block::Code(law.formula.clone()));
    }
    blocks
}

/// The residual force field, or a note that none is significant.
fn residual_field_blocks(d: &Diagnosis, pictures: &DiagnosisFigures) -> Vec<Block> {
    let none = "No further common force is visible in the data.";
    match d.field {
        Some(_) if pictures.left.is_empty() => vec![Block::Text(none.into())],
        _ => figure_blocks(&pictures.left),
    }
}

fn effects(d: &Diagnosis) -> TableRows {
    let all = d.effects.iter().flat_map(|e| e.parameters.iter().map(move |p| (e, p)));
    let row = |(e, p): (&EffectEstimate, &ParameterEstimate)| {
        vec![
            e.name.clone(),
            p.name.clone(),
            p.setting.clone().unwrap_or_default(),
            number(p.value),
            p.unit.clone(),
            interval(&p.ci95),
            p.spread.map_or(String::new(), |s| format!("{s:.4}")),
            format!("{:.2}", e.probability),
        ]
    };
    (
        &["effect", "parameter", "setting", "value", "unit", "interval", "sd between trials", "probability"],
        all.map(row).collect(),
    )
}

fn tied_sets(d: &Diagnosis) -> Vec<Block> {
    let sets = d.rivals.iter().map(|r| r.join(" + ")).collect::<Vec<_>>().join("\n\n");
    if d.rivals.len() > 1 { vec![Block::Text(sets)] } else { Vec::new() }
}

fn next_experiment(d: &Diagnosis) -> Vec<Block> {
    let text = d.next_experiment.iter().map(|next| format!("{}\n\nWhy: {}", next.action, next.why));
    text.map(Block::Text).collect()
}

fn latents(d: &Diagnosis) -> TableRows {
    let row = |c: &CalibratedLatent| {
        let range =
            if c.identifiable { interval(&c.ci95) } else { "not identifiable from these trials".into() };
        vec![c.name.clone(), format!("{:.5}", c.value), range]
    };
    (&["latent", "value", "interval"], d.calibrated.iter().map(row).collect())
}

fn gains(d: &Diagnosis) -> TableRows {
    let law = d.residual_law.as_ref().map(|l| &l.held_out);
    let all = [
        ("held-out trials", d.gain.held_out.as_ref()),
        ("held-out trials, with the empirical law", law),
        ("a held-out setting", d.gain.extrapolation.as_ref()),
    ];
    let rows = all.into_iter().filter_map(|(what, g)| {
        let g = g?;
        Some(vec![
            what.to_string(),
            g.trials.to_string(),
            number(g.base_rmse),
            number(g.extended_rmse),
            number(g.floor_rmse),
            g.excess_removed.map_or("-".into(), |e| format!("{e:.4}")),
        ])
    });
    (&["on", "trials", "base, m", "extended, m", "floor, m", "excess removed"], rows.collect())
}

/// Parameter estimates of a set's effects, in short.
fn describe_estimates(s: &ModelScore) -> String {
    let one = |(e, p): (&EffectEstimate, &ParameterEstimate)| {
        let setting = p.setting.as_ref().map(|s| format!(" [{s}]")).unwrap_or_default();
        let range = match p.ci95 {
            [Some(low), Some(high)] => format!(" ({low:.4} to {high:.4})"),
            _ => String::new(),
        };
        let name = if s.sizes.len() > 1 { format!("{} {}", e.name, p.name) } else { p.name.clone() };
        format!("{name}{setting} = {:.4}{range} {}", p.value, p.unit).trim_end().to_string()
    };
    let all = s.sizes.iter().flat_map(|e| e.parameters.iter().map(move |p| (e, p)));
    all.map(one).collect::<Vec<_>>().join("; ")
}

/// The fitted sets, best first.
fn rivals(d: &Diagnosis) -> Vec<Block> {
    let row = |s: &ModelScore| {
        let effects = if s.effects.is_empty() { "none".to_string() } else { s.effects.join(" + ") };
        vec![effects, format!("{:.1}", s.score), format!("{:.3}", s.probability), describe_estimates(s)]
    };
    let columns: &[&str] = &["set", "score, nats", "probability", "estimates, if in the credible set"];
    let note = "Log posterior probability relative to the best set, and posterior probability.";
    let best = table((columns, d.scores.iter().take(MAX_LISTED_SETS).map(row).collect()), note);
    let rest = table((columns, d.scores.iter().skip(MAX_LISTED_SETS).map(row).collect()), "");
    match rest.is_empty() {
        true => best,
        false => best
            .into_iter()
            .chain([Block::Details { summary: "all other fitted sets".into(), blocks: rest }])
            .collect(),
    }
}
