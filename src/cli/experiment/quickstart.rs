//! `iplw run` and `iplw experiment quickstart`: the whole workflow, with CSV files, plots, tables and a report.

use std::path::Path;
use std::time::Instant;

use iplw::error::{Error, Result};
use iplw::estimate::LatentEstimate;
use iplw::experiment::EstimateConfig;
use iplw::experiment::extension::Extension;
use iplw::experiment::quickstart::{
    Method, QuickstartArtifacts, QuickstartConfig, QuickstartReport, quickstart,
};
use iplw::picture::plot::{self, Series};
use iplw::picture::{Block, HtmlReport, Section, Style, filmstrip_svg, trails_svg};
use iplw::policy::{EvaluateConfig, LabelConfig, TrainConfig};
use iplw::reality::{HiddenConfig, HiddenWorld, Reality, Trial, standard, trials_to_csv};
use iplw::store::Store;
use iplw::task::{LabelCounts, Split, Task, family, split};
use iplw::world::latent::FACTORS;
use serde_json::json;

use super::args::ExperimentArgs;
use super::run_archive;
use crate::cli::diagnose::write_report;
use crate::cli::output;

/// The workflow over several seeds.
pub fn multi_seed(args: &ExperimentArgs) -> Result<()> {
    run_story(&args.task, (0..args.seeds.unwrap_or(3)).collect(), args.quick, &args.out)
}

/// Runs the workflow and writes its results.
pub fn run_story(name: &str, seeds: Vec<u64>, quick: bool, out: &Path) -> Result<()> {
    let family = family(name)?;
    let tasks = family.tasks();
    let hidden = standard(family);
    let full = family.learning.study_labels;
    let labels = if quick { LabelCounts { per_task: 60, ..full } } else { full };
    let config = QuickstartConfig {
        family: name.to_string(),
        seeds,
        estimate: EstimateConfig::fast(family.prior),
        label: LabelConfig::preset(&labels, 0),
        train: TrainConfig::preset(&family.learning),
        evaluate: EvaluateConfig {
            candidates: if quick { 2000 } else { 10_000 },
            ..EvaluateConfig::phyre(0)
        },
    };
    output::prepare_directory("--out", out)?;
    // Opened before the computation, so that a store in use is reported early.
    let shelf = (config.seeds.len() == 1).then(|| Store::open(out)).transpose()?;
    let bar = output::TerminalProgress::new();
    let started = Instant::now();
    let clock = || started.elapsed().as_secs_f64();
    let (report, keepsakes) = quickstart(&tasks, &hidden, &config, &clock, &bar)?;
    bar.clear();
    let table = text_table(&report, split(&tasks, Split::Test).len());
    write_all(out, &report, &keepsakes, &tasks, &hidden, &table)?;
    output::print(&table)?;
    output::print(&format!("\nreport: {}\n", out.join("report.html").display()))?;
    let Some(shelf) = shelf else { return Ok(()) };
    run_archive::save(&shelf, &report, &keepsakes)?;
    let program = std::env::args().next().unwrap_or_else(|| "iplw".into());
    output::print(&format!(
        "to view it: run {program} serve --data-dir {}, then open http://127.0.0.1:8080/#/jobs in a browser\n",
        out.display()
    ))
}

/// AUCCESS by method, latents with their true values, seconds by stage.
fn text_table(report: &QuickstartReport, test_tasks: usize) -> String {
    let mut text = format!(
        "\n{test_tasks} test tasks of {} in the hidden world ({} seed{}):\n\n",
        report.config.family,
        report.config.seeds.len(),
        if report.config.seeds.len() == 1 { "" } else { "s" },
    );
    text += "policy                      AUCCESS           solved at 1   within 10   real interactions\n";
    for row in &report.rows {
        let (mean, error) = row.mean();
        let auccess = match error {
            Some(e) => format!("{mean:.3} +- {e:.3}"),
            None => format!("{mean:.3}"),
        };
        let spent: u64 =
            row.real_interactions.iter().sum::<u64>() / row.real_interactions.len().max(1) as u64;
        text += &format!(
            "{:<27} {:<16} {:>9.0} %  {:>9.0} %   {spent:>12}\n",
            row.method.title(),
            auccess,
            100.0 * row.curve[0],
            100.0 * row.curve[9],
        );
    }
    text += "\nlatent         estimate        95 % interval       true\n";
    for (i, factor) in FACTORS.iter().enumerate() {
        let truth = report.truth.latents.values()[i].map_or("-".into(), |v| format!("{v:.3}"));
        for estimate in &report.estimates {
            let l = &estimate.latents[i];
            text += &format!("{:<14} {:<15.3} {:<19} {truth}\n", factor.name, l.value, interval(l));
        }
    }
    let effects: Vec<String> =
        report.truth.effects.iter().map(|e| format!("{} {:?}", e.name, e.parameters)).collect();
    text += &format!("hidden effects, not in the simulation: {}\n", effects.join(", "));
    text += "\nfitted again with drag   estimate        95 % interval\n";
    for l in report.extensions.iter().flat_map(|e| e.latents[1..].iter().chain(&e.effects)) {
        text += &format!("{:<24} {:<15.3} {}\n", l.name, l.value, interval(l));
    }
    text += "\ndiagnosis: missing effects\n";
    for d in &report.diagnoses {
        text += &format!("  {}\n", diagnosis_line(d));
    }
    text += "\nstage                          seconds\n";
    for (stage, seconds) in &report.seconds {
        text += &format!("{stage:<30} {seconds:>7.1}\n");
    }
    text
}

/// Maximal number of effects in a line: an empirical law may consist of many.
const MAX_LISTED_EFFECTS: usize = 4;

/// A diagnosis in one line.
fn diagnosis_line(d: &Extension) -> String {
    let mut terms: Vec<String> = d
        .effects
        .iter()
        .take(MAX_LISTED_EFFECTS)
        .map(|e| {
            let parameters: Vec<String> = e.parameters.iter().map(|(k, v)| format!("{k} = {v:.3}")).collect();
            format!("{} ({})", e.name, parameters.join(", "))
        })
        .collect();
    if d.effects.len() > MAX_LISTED_EFFECTS {
        terms.push(format!("{} more", d.effects.len() - MAX_LISTED_EFFECTS));
    }
    let sets: Vec<String> = d.rivals.iter().map(|r| r.join(" + ")).collect();
    let tie =
        if sets.len() > 1 { format!("; equally good sets: {}", sets.join(" | ")) } else { String::new() };
    let gain = d.excess_removed.map_or(String::new(), |e| match e < 1.0 {
        true => format!("; removes {:.0} % of the excess error on held-out trials", 100.0 * e),
        false => "; removes all of the excess error on held-out trials".to_string(),
    });
    match terms.is_empty() {
        true => format!("{}: {}", d.verdict, d.reason),
        false => format!("{}: {}{tie}{gain}", d.verdict, terms.join(" + ")),
    }
}

/// A 95 % interval as text.
fn interval(l: &LatentEstimate) -> String {
    match l.ci95 {
        [Some(low), Some(high)] if l.identifiable => format!("{low:.3} to {high:.3}"),
        _ => "not identifiable".to_string(),
    }
}

fn write_all(
    out: &Path,
    report: &QuickstartReport,
    keepsakes: &QuickstartArtifacts,
    tasks: &[Task],
    hidden: &HiddenConfig,
    table: &str,
) -> Result<()> {
    let curves = report.rows.iter().flat_map(|row| {
        let share =
            |(k, s): (usize, &f64)| vec![row.method.title().into(), (k + 1).to_string(), s.to_string()];
        row.curve.iter().enumerate().map(share)
    });
    let auccess = report.rows.iter().flat_map(|row| {
        report.config.seeds.iter().enumerate().map(|(i, seed)| {
            let numbers =
                [seed.to_string(), row.auccess[i].to_string(), row.real_interactions[i].to_string()];
            [vec![row.method.title().to_string()], numbers.to_vec()].concat()
        })
    });
    let curves = output::csv(&["method", "attempts", "share_solved"], curves)?;
    let auccess = output::csv(&["method", "seed", "auccess", "real_interactions"], auccess)?;
    let solved_plot = solved_plot(report);
    let json = serde_json::to_string_pretty(report).map_err(|e| Error::Failed(e.to_string()))?;
    let html = html(report, keepsakes, tasks, hidden, &solved_plot)?;
    output::write_whole(&out.join("curves.csv"), &curves)?;
    output::write_whole(&out.join("auccess.csv"), &auccess)?;
    output::write_whole(&out.join("trials.csv"), trials_to_csv(&keepsakes.trials).as_bytes())?;
    output::write_whole(&out.join("result.json"), json.as_bytes())?;
    output::write_whole(&out.join("solved.svg"), solved_plot.as_bytes())?;
    output::write_whole(&out.join("table.txt"), table.trim_start().as_bytes())?;
    let (scene, finding) = &keepsakes.diagnosed;
    write_report(&out.join("diagnosis"), scene, finding)?;
    if let Some(weights) = keepsakes.policy().to_safetensors() {
        output::write_whole(&out.join("policy.safetensors"), &weights)?;
    }
    output::write_whole(&out.join("report.html"), html.as_bytes())
}

fn solved_plot(report: &QuickstartReport) -> String {
    let series: Vec<Series> = report
        .rows
        .iter()
        .map(|row| Series {
            name: row.method.title().into(),
            points: row.curve.iter().enumerate().map(|(k, s)| ((k + 1) as f64, 100.0 * s)).collect(),
            band: None,
        })
        .collect();
    plot::lines("Test tasks solved in the hidden world", "attempts per task", "tasks solved, %", &series)
}

fn html(
    report: &QuickstartReport,
    keepsakes: &QuickstartArtifacts,
    tasks: &[Task],
    hidden: &HiddenConfig,
    solved_plot: &str,
) -> Result<String> {
    let section = |heading: &str, blocks: Vec<Block>| Section { heading: heading.into(), blocks };
    let page = HtmlReport {
        title: format!("From a hidden world to a policy: {}", report.config.family),
        lead: lead(report),
        sections: vec![
            section("Transfer to the hidden world", transfer_blocks(report, solved_plot)),
            section("Missing effects", lacking_blocks(report)),
            section("Latent factors", latent_blocks(report)),
            section("Actions of the policy", policy_animations(keepsakes, tasks, hidden)?),
            section("Exploration trials", explored_blocks(keepsakes)),
            section("Configuration", setup_blocks(report)?),
        ],
    };
    Ok(page.to_html())
}

fn columns(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| n.to_string()).collect()
}

/// Summary in a sentence.
fn lead(report: &QuickstartReport) -> String {
    let of = |m: Method| report.rows.iter().find(|r| r.method == m).map_or(f64::NAN, |r| r.mean().0);
    let spent =
        report.estimates.iter().map(|e| e.real_interactions).sum::<u64>() / report.estimates.len() as u64;
    format!(
        "A policy trained in a simulation grounded by {spent} measurements of a hidden world reaches AUCCESS {:.3} \
         on tasks it has never seen, and {:.3} where the simulation is extended by what a diagnosis of the same \
         measurements found; {:.3} with \
         domain randomisation, {:.3} with the true latents, {:.3} by chance.",
        of(Method::Iplw),
        of(Method::IplwDiagnosed),
        of(Method::DomainRandomisation),
        of(Method::TrueLatents),
        of(Method::Random),
    )
}

fn transfer_blocks(report: &QuickstartReport, solved_plot: &str) -> Vec<Block> {
    let rows = report.rows.iter().map(|row| {
        let (mean, error) = row.mean();
        vec![
            row.method.title().to_string(),
            format!("{mean:.3}"),
            error.map_or("-".into(), |e| format!("{e:.3}")),
            format!("{:.0} %", 100.0 * row.curve[0]),
            format!("{:.0} %", 100.0 * row.curve[9]),
            row.real_interactions.iter().map(u64::to_string).collect::<Vec<_>>().join(", "),
        ]
    });
    let names = ["policy", "AUCCESS", "standard error", "solved at 1", "within 10", "real interactions"];
    let note = "AUCCESS as defined by PHYRE: early successes have more weight. \"True latents\" excludes the hidden effect, like \
                the paper's oracle; the last row includes it.";
    vec![
        Block::Table { columns: columns(&names), rows: rows.collect(), note: note.into() },
        Block::Svg {
            svg: solved_plot.into(),
            caption: "Share of test tasks solved by number of attempts.".into(),
        },
    ]
}

fn lacking_blocks(report: &QuickstartReport) -> Vec<Block> {
    let found = report.diagnoses.iter().map(|d| Block::Text(diagnosis_line(d)));
    let pointer = "Full diagnosis of the first seed: diagnosis/report.html next to this page.";
    found.chain([Block::Text(pointer.into())]).collect()
}

fn explored_blocks(keepsakes: &QuickstartArtifacts) -> Vec<Block> {
    let picture = |trial: &Trial| Block::Svg {
        svg: trails_svg(&trial.scene, &trial.observed, &Style { width: 360, ..Style::default() }),
        caption: format!("Measured: {}", trial.name),
    };
    keepsakes.trials.iter().take(3).map(picture).collect()
}

fn setup_blocks(report: &QuickstartReport) -> Result<Vec<Block>> {
    let config = serde_json::to_string_pretty(&json!(report.config));
    Ok(vec![
        Block::Table {
            columns: columns(&["stage", "seconds"]),
            rows: report.seconds.iter().map(|(s, t)| vec![s.clone(), format!("{t:.1}")]).collect(),
            note: format!("iplw {}, seeds {:?}.", report.version, report.config.seeds),
        },
        Block::Code(config.map_err(|e| Error::Failed(e.to_string()))?),
    ])
}

fn latent_blocks(report: &QuickstartReport) -> Vec<Block> {
    let mut rows = Vec::new();
    for (i, factor) in FACTORS.iter().enumerate() {
        for (seed, estimate) in report.config.seeds.iter().zip(&report.estimates) {
            let l = &estimate.latents[i];
            let truth = report.truth.latents.values()[i].map_or("-".into(), |v| format!("{v:.3}"));
            let name = format!("{} ({})", factor.name, factor.unit);
            rows.push(vec![name, seed.to_string(), format!("{:.3}", l.value), interval(l), truth]);
        }
    }
    let hidden: Vec<String> =
        report.truth.effects.iter().map(|e| format!("{} {:?}", e.name, e.parameters)).collect();
    let series: Vec<Series> = (1..3)
        .flat_map(|i| {
            report.config.seeds.iter().zip(&report.estimates).map(move |(seed, e)| Series {
                name: format!("{}, seed {seed}", FACTORS[i].name),
                points: e.estimates.iter().enumerate().map(|(r, v)| ((r + 1) as f64, v[i])).collect(),
                band: None,
            })
        })
        .collect();
    vec![
        Block::Table {
            columns: ["latent", "seed", "estimate", "95 % interval", "true"].map(String::from).to_vec(),
            rows,
            note: format!(
                "True values are used only for this table. The hidden world also has {}, which the simulation lacks: \
                 estimates are biased to compensate for it, and their intervals don't account for this bias.",
                hidden.join(", ")
            ),
        },
        Block::Svg {
            svg: plot::lines(
                "Estimates by round",
                "round of exploring, measuring and fitting",
                "value",
                &series,
            ),
            caption: String::new(),
        },
    ]
}

/// The policy's first valid action on a few test tasks, in the hidden world.
fn policy_animations(
    keepsakes: &QuickstartArtifacts,
    tasks: &[Task],
    hidden: &HiddenConfig,
) -> Result<Vec<Block>> {
    let mut world = HiddenWorld::new(hidden.clone())?;
    let about = "The policy's first action on some test tasks, executed in the hidden world.";
    let mut blocks = vec![Block::Text(about.into())];
    for task in split(tasks, Split::Test).iter().take(3) {
        let candidates = (0..task.actions().count().min(50_000))
            .map(|i| task.actions().at(i))
            .collect::<Result<Vec<_>>>()?;
        let order = iplw::policy::rank(keepsakes.policy(), task, &candidates, iplw::policy::CHUNK)?;
        for index in order {
            let attempt = world.measure(task, &[candidates[index].clone()])?.pop();
            let Some((Ok(scene), Some(film))) = attempt.map(|a| (a.placement, a.trajectory)) else {
                continue;
            };
            let outcome = if film.solved() { "solved" } else { "not solved" };
            blocks.push(Block::Svg {
                svg: filmstrip_svg(&scene, &film, &Style { width: 960, ..Style::default() }),
                caption: format!("{}: {outcome} by action {index} at the first attempt", task.id),
            });
            break;
        }
    }
    Ok(blocks)
}
