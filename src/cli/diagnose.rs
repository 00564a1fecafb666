//! `iplw diagnose`: what the simulation gets wrong, from measured trials.

use std::path::{Path, PathBuf};

use iplw::discover::report::{Calibrated, Diagnosis, FoundEffect, FoundParameter, HeldOut, Score};
use iplw::discover::{Config, Finding, diagnose};
use iplw::error::Result;

use iplw::picture::report::{Block, Report, Section};
use iplw::progress::Progress;
use iplw::reality::Gathered;
use iplw::task::Scene;

use super::evidence::{Plot, plots};
use super::layout::laid_out;
use super::{along, launches, output, tracks};

/// Compares measured trials with the scene's simulation and says what the simulation lacks: the effect by name with
/// its parameters, several if the data cannot tell them apart, or that nothing in the library explains the misfit.
/// Writes report.json, report.html, extended_scene.json and the plots.
#[derive(clap::Args)]
#[command(after_long_help = tracks::EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    tracks: tracks::Tracks,
    /// Directory for the report.
    #[arg(long)]
    out: PathBuf,
    /// Seed of the bootstrap over launches that tells an effect from chance.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

pub fn run(args: &Args) -> Result<()> {
    let Gathered { scene, trials, .. } = tracks::read(&args.tracks)?;
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
    let json = laid_out(&found.diagnosis)?;
    output::write_whole(&out.join("report.json"), (json + "\n").as_bytes())?;
    output::write_whole(&out.join("extended_scene.json"), (found.extended.to_json() + "\n").as_bytes())?;
    let pictures = Pictures {
        residuals: plots(&found.evidence),
        sizes: launches::sizes(&found.diagnosis),
        predictive: found.diagnosis.predictive.iter().map(launches::predictive).collect(),
        paths: along::paths(&found.diagnosis),
        left: found.diagnosis.field.iter().filter_map(along::left).collect(),
    };
    for (name, _, svg) in pictures.all() {
        output::write_whole(&out.join(format!("{name}.svg")), svg.as_bytes())?;
    }
    let page = page(scene, &found.diagnosis, &pictures).to_html();
    output::write_whole(&out.join("report.html"), page.as_bytes())
}

/// Plots by the sections that they stand in.
struct Pictures {
    residuals: Vec<Plot>,
    sizes: Vec<Plot>,
    predictive: Vec<Plot>,
    paths: Vec<Plot>,
    left: Vec<Plot>,
}

impl Pictures {
    fn all(&self) -> impl Iterator<Item = &Plot> {
        [&self.sizes, &self.predictive, &self.paths, &self.left, &self.residuals].into_iter().flatten()
    }
}

fn drawn(plots: &[Plot]) -> Vec<Block> {
    let block = |(_, caption, svg): &Plot| Block::Svg { svg: svg.clone(), caption: caption.clone() };
    plots.iter().map(block).collect()
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
    let spread = p.spread.map_or(String::new(), |s| format!(", spread by launch {s:.5}"));
    format!("{}{setting} = {:.5} {} ({}{spread})", p.name, p.value, p.unit, interval(&p.ci95))
}

fn interval(ends: &[Option<f64>; 2]) -> String {
    match ends {
        [Some(a), Some(b)] => format!("95 %: {a:.5} to {b:.5}"),
        _ => "no bound from these trials".into(),
    }
}

fn gained(g: &HeldOut) -> String {
    let removed = match g.excess_removed {
        None => "no excess to remove".to_string(),
        Some(e) if e < 1.0 => format!("{:.1} % of the excess gone", 100.0 * e),
        Some(_) => "all of the excess gone".to_string(),
    };
    format!("error {:.5} m -> {:.5} m, floor {:.5} m: {removed}", g.base_rmse, g.extended_rmse, g.floor_rmse)
}

/// The report: what was found first, what else was tried last; sections without anything to say are left out.
fn page(scene: &Scene, d: &Diagnosis, pictures: &Pictures) -> Report {
    let check = d.predictive.iter().map(|p| Block::Text(launches::checked(p)));
    let sections = [
        section("What was found", found(d)),
        section("Effects", table(effects(d), "p is corrected for the search over the library")),
        section("Sets that tie", ties(d)),
        section("Next experiment", next(d)),
        section("Latents", table(latents(d), "")),
        section(
            "Gain",
            table(gains(d), "Starts are fitted for every trial; everything else comes from other trials."),
        ),
        section("Sizes launch by launch", drawn(&pictures.sizes)),
        section("Predictive check", check.chain(drawn(&pictures.predictive)).collect()),
        section("Paths before and after", drawn(&pictures.paths)),
        section("The field of what is left", left(d, pictures)),
        section("Residuals before and after", drawn(&pictures.residuals)),
        section("Rivals", rivals(d)),
    ];
    let name = if scene.name.is_empty() { "a scene".to_string() } else { scene.name.clone() };
    Report {
        title: format!("Diagnosis of {name}"),
        lead: d.reason.clone(),
        sections: sections.into_iter().filter(|s| !s.blocks.is_empty()).collect(),
    }
}

fn section(heading: &str, blocks: Vec<Block>) -> Section {
    Section { heading: heading.into(), blocks }
}

/// Sets that the report shows at once.
const BEST: usize = 8;

/// Names of columns, and rows.
type Rows = (&'static [&'static str], Vec<Vec<String>>);

/// A table, unless it has no rows.
fn table((columns, rows): Rows, note: &str) -> Vec<Block> {
    if rows.is_empty() {
        return Vec::new();
    }
    let columns = columns.iter().map(|n| n.to_string()).collect();
    vec![Block::Table { columns, rows, note: note.into() }]
}

fn number(v: f64) -> String {
    format!("{v:.6}")
}

fn found(d: &Diagnosis) -> Vec<Block> {
    let mut blocks = vec![Block::KeyValues(vec![
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
        blocks.push(Block::Text(text.into()));
        blocks.push(Block::Code(law.formula.clone()));
    }
    blocks
}

/// The field of what is left; that the data tell none, where it was asked.
fn left(d: &Diagnosis, pictures: &Pictures) -> Vec<Block> {
    let none = "Nowhere do the data tell a push that launches share beside the reported model.";
    match d.field {
        Some(_) if pictures.left.is_empty() => vec![Block::Text(none.into())],
        _ => drawn(&pictures.left),
    }
}

fn effects(d: &Diagnosis) -> Rows {
    let all = d.effects.iter().flat_map(|e| e.parameters.iter().map(move |p| (e, p)));
    let row = |(e, p): (&FoundEffect, &FoundParameter)| {
        vec![
            e.name.clone(),
            p.name.clone(),
            p.setting.clone().unwrap_or_default(),
            number(p.value),
            p.unit.clone(),
            interval(&p.ci95),
            p.spread.map_or(String::new(), |s| format!("{s:.4}")),
            format!("{:.1e}", e.p_value),
        ]
    };
    (
        &["effect", "parameter", "setting", "value", "unit", "interval", "spread by launch", "p"],
        all.map(row).collect(),
    )
}

fn ties(d: &Diagnosis) -> Vec<Block> {
    let sets = d.rivals.iter().map(|r| r.join(" + ")).collect::<Vec<_>>().join("\n\n");
    if d.rivals.len() > 1 { vec![Block::Text(sets)] } else { Vec::new() }
}

fn next(d: &Diagnosis) -> Vec<Block> {
    let text = d.next_experiment.iter().map(|next| format!("{}\n\nWhy: {}", next.action, next.why));
    text.map(Block::Text).collect()
}

fn latents(d: &Diagnosis) -> Rows {
    let row = |c: &Calibrated| {
        let known = if c.identifiable { interval(&c.ci95) } else { "not told by these trials".into() };
        vec![c.name.clone(), format!("{:.5}", c.value), known]
    };
    (&["latent", "value", "interval"], d.calibrated.iter().map(row).collect())
}

fn gains(d: &Diagnosis) -> Rows {
    let law = d.residual_law.as_ref().map(|l| &l.held_out);
    let all = [
        ("held-out trials", d.gain.held_out.as_ref()),
        ("held-out trials, with the law without a name", law),
        ("a setting never fitted", d.gain.extrapolation.as_ref()),
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

/// Sizes of a set's effects, in short.
fn sizes(s: &Score) -> String {
    let one = |(e, p): (&FoundEffect, &FoundParameter)| {
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

/// The best of the sets that were fitted.
fn rivals(d: &Diagnosis) -> Vec<Block> {
    let row = |s: &Score| {
        let effects = if s.effects.is_empty() { "none".to_string() } else { s.effects.join(" + ") };
        vec![effects, format!("{:.1}", s.score), format!("{:.3}", s.probability_worse), sizes(s)]
    };
    let columns: &[&str] = &["set", "score, nats", "probability that it is worse", "sizes, where it ties"];
    let note = "Log predictive density of launches told from the others, beside the best set's.";
    let best = table((columns, d.scores.iter().take(BEST).map(row).collect()), note);
    let rest = table((columns, d.scores.iter().skip(BEST).map(row).collect()), "");
    match rest.is_empty() {
        true => best,
        false => best
            .into_iter()
            .chain([Block::Details { summary: "every other set that was fitted".into(), blocks: rest }])
            .collect(),
    }
}
