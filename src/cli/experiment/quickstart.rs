//! `iplw run` and `iplw experiment quickstart`: the whole workflow on several families, with CSV files, plots, tables and reports.

use std::path::Path;
use std::time::Instant;

use iplw::error::{Error, Result};
use iplw::estimate::LatentEstimate;
use iplw::experiment::extension::Extension;
use iplw::experiment::quickstart::{QuickstartArtifacts, QuickstartConfig, QuickstartReport, quickstart};
use iplw::picture::plot::{self, Series};
use iplw::picture::{Block, HtmlReport, Section, Style, filmstrip_svg, trails_svg};
use iplw::reality::{HiddenConfig, HiddenWorld, Reality, Trial, standard, trials_to_csv};
use iplw::store::Store;
use iplw::task::{Family, Split, Task, collection, family, split};
use iplw::world::latent::FACTORS;
use serde_json::json;

use super::args::{ExperimentArgs, RunArgs};
use super::run_archive;
use super::story_table::{conclusions, method_table, table_rows};
use crate::cli::diagnose::write_report;
use crate::cli::output;

/// Collection of families in which knowledge of the latents pays.
const LEVELS: &str = "levels";

/// `iplw run`.
pub fn run(args: &RunArgs) -> Result<()> {
    let count = args.seeds.unwrap_or(if args.quick { 1 } else { 3 });
    iplw::error::check_range("--seeds", count as f64, 1.0, 1000.0)?;
    let seeds = (args.seed..).take(count).collect();
    run_story(&args.task, seeds, args.quick, &args.out)
}

/// `iplw experiment quickstart`: the workflow on one family.
pub fn multi_seed(args: &ExperimentArgs) -> Result<()> {
    run_story(std::slice::from_ref(&args.task), (0..args.seeds.unwrap_or(3)).collect(), args.quick, &args.out)
}

/// Runs the workflow on each family and writes the results.
fn run_story(names: &[String], seeds: Vec<u64>, quick: bool, out: &Path) -> Result<()> {
    let mut families: Vec<&Family> = Vec::new();
    for name in names {
        if families.iter().all(|f| f.name != name) {
            families.push(story_family(name)?);
        }
    }
    output::prepare_directory("--out", out)?;
    // Opened before the computation, so that a store in use is reported early.
    let shelf = Store::open(out)?;
    let bar = output::TerminalProgress::new();
    let started = Instant::now();
    let clock = || started.elapsed().as_secs_f64();
    let mut reports = Vec::new();
    for family in families {
        let (tasks, hidden) = (family.tasks(), standard(family));
        let config = QuickstartConfig::standard(family, seeds.clone(), quick);
        let (report, artifacts) = quickstart(&tasks, &hidden, &config, &clock, &bar)?;
        write_family(&out.join(family.name), &report, &artifacts, &tasks, &hidden)?;
        run_archive::save(&shelf, &report, &artifacts)?;
        reports.push(report);
    }
    bar.clear();
    let text = method_table(&reports) + &conclusions(&reports).join("\n") + "\n";
    output::write_whole(&out.join("table.txt"), text.as_bytes())?;
    output::write_whole(&out.join("report.html"), story_page(&reports).as_bytes())?;
    output::print(&text)?;
    let program = std::env::args().next().unwrap_or_else(|| "iplw".into());
    output::print(&format!(
        "\n{:.0} s; report: {}\nto view the jobs: run {program} serve --tasks {LEVELS} --data-dir {}, then open \
         http://127.0.0.1:8080/#/jobs in a browser\n",
        clock(),
        out.join("report.html").display(),
        out.display()
    ))
}

/// A family by name; those of the levels need not be registered.
fn story_family(name: &str) -> Result<&'static Family> {
    family(name).or_else(|mut unknown| {
        let levels = collection(LEVELS).map(|c| c.families()).transpose()?.unwrap_or_default();
        if let Error::NotFound { known, .. } = &mut unknown {
            known.extend(levels.iter().map(|f| f.name.to_string()));
        }
        let level = levels.into_iter().find(|f| f.name == name).ok_or(unknown)?;
        Ok(&*Box::leak(Box::new(level)))
    })
}

/// The page with the common table.
fn story_page(reports: &[QuickstartReport]) -> String {
    let (columns, rows) = table_rows(reports);
    let lines = conclusions(reports).into_iter().map(Block::Text).collect();
    let links =
        reports.iter().map(|r| Block::Text(format!("{0}: {0}/report.html", r.config.family))).collect();
    let note = "Mean AUCCESS on test tasks +- standard error over seeds; PHYRE's score, in which early successes have more weight.";
    let table = Block::Table { columns, rows, note: note.into() };
    let section = |heading: &str, blocks: Vec<Block>| Section::new(heading, blocks);
    HtmlReport {
        title: "From hidden worlds to policies".into(),
        lead: "How well policies and plans do in worlds whose physics is hidden, by what is known of it."
            .into(),
        sections: vec![
            section("Transfer to the hidden worlds", vec![table]),
            section("Learned, and not learned", lines),
            section("Each family in detail", links),
        ],
        ..HtmlReport::default()
    }
    .to_html()
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

fn write_family(
    out: &Path,
    report: &QuickstartReport,
    artifacts: &QuickstartArtifacts,
    tasks: &[Task],
    hidden: &HiddenConfig,
) -> Result<()> {
    output::prepare_directory("--out", out)?;
    let curves = report.rows.iter().flat_map(|row| {
        let share = |(k, s): (usize, &f64)| {
            vec![row.method.title().trim().into(), (k + 1).to_string(), s.to_string()]
        };
        row.curve.iter().enumerate().map(share)
    });
    let auccess = report.rows.iter().flat_map(|row| {
        report.config.seeds.iter().enumerate().map(|(i, seed)| {
            let numbers =
                [seed.to_string(), row.auccess[i].to_string(), row.real_interactions[i].to_string()];
            [vec![row.method.title().trim().to_string()], numbers.to_vec()].concat()
        })
    });
    let curves = output::csv(&["method", "attempts", "share_solved"], curves)?;
    let auccess = output::csv(&["method", "seed", "auccess", "real_interactions"], auccess)?;
    let solved_plot = solved_plot(report);
    let json = serde_json::to_string_pretty(report).map_err(|e| Error::Failed(e.to_string()))?;
    let html = html(report, artifacts, tasks, hidden, &solved_plot)?;
    output::write_whole(&out.join("curves.csv"), &curves)?;
    output::write_whole(&out.join("auccess.csv"), &auccess)?;
    output::write_whole(&out.join("trials.csv"), trials_to_csv(&artifacts.trials).as_bytes())?;
    output::write_whole(&out.join("result.json"), json.as_bytes())?;
    output::write_whole(&out.join("solved.svg"), solved_plot.as_bytes())?;
    if let Some((_, finding)) = &artifacts.diagnosed {
        write_report(&out.join("diagnosis"), finding)?;
    }
    if let Some(weights) = artifacts.policy().to_safetensors() {
        output::write_whole(&out.join("policy.safetensors"), &weights)?;
    }
    output::write_whole(&out.join("report.html"), html.as_bytes())
}

fn solved_plot(report: &QuickstartReport) -> String {
    let series: Vec<Series> = report
        .rows
        .iter()
        .map(|row| Series {
            name: row.method.title().trim().into(),
            points: row.curve.iter().enumerate().map(|(k, s)| ((k + 1) as f64, 100.0 * s)).collect(),
            band: None,
            ..Series::default()
        })
        .collect();
    plot::lines("Test tasks solved in the hidden world", "attempts per task", "tasks solved, %", &series)
}

fn html(
    report: &QuickstartReport,
    artifacts: &QuickstartArtifacts,
    tasks: &[Task],
    hidden: &HiddenConfig,
    solved_plot: &str,
) -> Result<String> {
    let section = |heading: &str, blocks: Vec<Block>| Section::new(heading, blocks);
    let page = HtmlReport {
        title: format!("From a hidden world to a policy: {}", report.config.family),
        lead: conclusions(std::slice::from_ref(report)).join(" "),
        sections: vec![
            section("Transfer to the hidden world", transfer_blocks(report, solved_plot)),
            section("Missing effects", lacking_blocks(report)),
            section("Latent factors", latent_blocks(report)),
            section("Actions of the policy", policy_animations(artifacts, tasks, hidden)?),
            section("Exploration trials", explored_blocks(artifacts)),
            section("Configuration", setup_blocks(report)?),
        ],
        ..HtmlReport::default()
    };
    Ok(page.to_html())
}

fn columns(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| n.to_string()).collect()
}

fn transfer_blocks(report: &QuickstartReport, solved_plot: &str) -> Vec<Block> {
    let rows = report.rows.iter().map(|row| {
        vec![
            row.method.title().trim().to_string(),
            row.summary().show(3),
            format!("{:.0} %", 100.0 * row.curve[0]),
            format!("{:.0} %", 100.0 * row.curve[9]),
            row.real_interactions.iter().map(u64::to_string).collect::<Vec<_>>().join(", "),
        ]
    });
    let names = ["policy", "AUCCESS", "solved at 1", "within 10", "real interactions"];
    let note = "AUCCESS as defined by PHYRE: early successes have more weight. The last row has the true latents and effects.";
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
    let fits =
        report.estimates.iter().filter_map(|e| e.fit.as_ref()).map(|fit| Block::Text(fit.text.clone()));
    let pointer =
        "Full diagnosis of the first seed, if one was needed: diagnosis/report.html next to this page.";
    fits.chain(found).chain([Block::Text(pointer.into())]).collect()
}

fn explored_blocks(artifacts: &QuickstartArtifacts) -> Vec<Block> {
    let picture = |trial: &Trial| Block::Svg {
        svg: trails_svg(&trial.scene, &trial.observed, &Style { width: 360, ..Style::default() }),
        caption: format!("Measured: {}", trial.name),
    };
    artifacts.trials.iter().take(3).map(picture).collect()
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
                ..Series::default()
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
    artifacts: &QuickstartArtifacts,
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
        let order = iplw::policy::rank(artifacts.policy(), task, &candidates, iplw::policy::CHUNK)?;
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
