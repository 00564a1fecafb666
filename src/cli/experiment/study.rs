//! `iplw experiment latents | harder | policies | FAMILY`: transfer experiments with their baselines.

use std::path::Path;

use iplw::error::{Error, Result};
use iplw::experiment::estimate_accuracy::{FinalEstimates, accuracy_claims};
use iplw::experiment::statistics::{Claim, Summary};
use iplw::experiment::strategies::Arm;
use iplw::experiment::study::{
    ArmEstimate, MIN_RELEVANT_AUCCESS_DIFFERENCE, Study, StudyCell, StudyRow, estimate_arm, run_study_cell,
};
use iplw::experiment::transfer::Transfer;
use iplw::picture::plot::{self, Series};
use iplw::picture::{Block, HtmlReport, Section, Style, success_map_svg, svg_to_png};
use iplw::policy::{CHUNK, Dqn, Policy, rank};
use iplw::progress::NoProgress;
use iplw::reality::{HiddenConfig, HiddenWorld, Reality};
use iplw::task::action::{ActionQuantity, ActionSpace, Discretisation};
use iplw::task::{Family, Split, Task, ValidAction, family, split};
use serde_json::json;

use super::args::ExperimentArgs;
use super::claims::{claims_table, claims_text, importance};
use super::configuration::configuration;
use super::estimate_table;
use crate::cli::cell_store::CellStore;
use crate::cli::{output, parse};

/// The paper's first experiment.
pub fn latents(args: &ExperimentArgs) -> Result<()> {
    let family = family(&args.task)?;
    run_study(args, family, Study::latents(family), &args.out)
}

/// Comparison of strategies on the family with the experiment's name.
pub fn strategies(args: &ExperimentArgs) -> Result<()> {
    let family = family(&args.name)?;
    let hidden = parse::real(args.real.as_deref().unwrap_or(""), family)?;
    let mut study = Study::strategies(family).in_world(hidden);
    if args.with_drag {
        study = study.with_drag_fitted();
    }
    if let Some(names) = &args.strategies {
        study = study.with_strategies(names).map_err(|e| e.unknown_in("--strategies"))?;
    }
    run_study(args, family, study, &args.out)
}

/// The requested real worlds, each with its own output directory.
pub fn harder(args: &ExperimentArgs) -> Result<()> {
    let family = family(&args.task)?;
    let studies = Study::harder(family);
    let known: Vec<String> = studies.iter().map(|s| s.name.clone()).collect();
    let wanted = args.worlds.as_ref().unwrap_or(&known);
    if let Some(unknown) = wanted.iter().find(|w| !known.contains(w)) {
        return Err(Error::input("--worlds", unknown, known.join(", ")));
    }
    for study in studies.into_iter().filter(|s| wanted.contains(&s.name)) {
        let out = args.out.join(&study.name);
        run_study(args, family, study, &out)?;
    }
    Ok(())
}

/// Policies for posterior samples, compared with point estimates, domain randomisation and the truth.
pub fn policies(args: &ExperimentArgs) -> Result<()> {
    let family = family(&args.task)?;
    run_study(args, family, Study::policies(family), &args.out)
}

fn run_study(args: &ExperimentArgs, family: &Family, mut study: Study, out: &Path) -> Result<()> {
    if args.quick {
        study = study.quick(family);
    }
    study.seeds = args.chosen_seeds(&study.seeds);
    study.trials = args.trials.unwrap_or(study.trials);
    study.transfer.train.batches = args.batches.map_or(study.transfer.train.batches, |b| b as usize);
    if let Some(rounds) = &args.rounds {
        let last = study.rounds.last().copied().unwrap_or(1);
        if let Some(beyond) = rounds.iter().find(|r| !(1..=last).contains(*r)) {
            let allowed = format!("numbers of rounds from 1 to {last}");
            return Err(Error::input("--rounds", beyond, allowed));
        }
        // Rows are compared after the last round.
        study.rounds = rounds.iter().copied().chain([last]).collect();
        study.rounds.sort_unstable();
        study.rounds.dedup();
    }
    study.validate()?;
    let estimates = study.arms.len() * study.seeds.len();
    let policies = study.seeds.len()
        * study.trials as usize
        * (study.schools.len() + study.arms.len() * study.rounds.len() + study.afterwards().count());
    let cells = CellStore::new(out, estimates + policies)?;
    let importance = importance(family, study.needs_importance())?;
    let arms: Vec<(&Arm, u64)> =
        study.arms.iter().flat_map(|arm| study.seeds.iter().map(move |seed| (arm, *seed))).collect();
    let found: Vec<ArmEstimate> = cells.compute_all(
        &arms,
        |(arm, seed)| {
            let depends = json!({
                "family": family.name, "hidden": study.hidden, "arm": arm, "seed": seed,
                "tasks": train_ids(&study.tasks(family, *seed)), "diagnose": study.diagnosed.contains(&arm.name),
                "past_point": study.past_point.contains(&arm.name),
            });
            (format!("estimate, {}, seed {seed}", arm.name), depends)
        },
        |(arm, seed)| estimate_arm(family, &study, arm, *seed, importance.clone(), &NoProgress),
    )?;
    let found: Vec<Vec<ArmEstimate>> = found.chunks(study.seeds.len()).map(<[ArmEstimate]>::to_vec).collect();
    let policies = study.cells(&found);
    let results: Vec<Transfer> = cells.compute_all(
        &policies,
        |cell| {
            let round = cell.round.map_or(String::new(), |r| format!(" after round {r}"));
            let depends = json!({
                "family": family.name, "hidden": study.hidden, "transfer": study.transfer, "cell": cell,
                "tasks": train_ids(&study.tasks(family, cell.seed)),
            });
            (format!("policy, {}{round}, seed {}, trial {}", cell.row, cell.seed, cell.trial), depends)
        },
        |cell| Ok(run_study_cell(family, &study, cell, &NoProgress)?.0),
    )?;
    let seconds = cells.finish();
    let rows = study.rows(&policies, &results);
    let estimates = study.final_estimates(&found);
    let mut claims = study.claims(family, &rows);
    claims.extend(accuracy_claims(family, &study.hidden.latents, &estimates));
    write_all(out, family, &study, &rows, &estimates, &claims, &policies, &results, seconds)?;
    output::print(&text_table(&study, &rows, &estimates, &claims))?;
    output::print(&format!("\n{seconds:.0} s of work; report: {}\n", out.join("report.html").display()))
}

/// Ids of the training tasks.
fn train_ids(tasks: &[Task]) -> Vec<String> {
    split(tasks, Split::Train).into_iter().map(|t| t.id).collect()
}

fn title(row: &StudyRow) -> String {
    row.round.map_or(row.name.clone(), |r| format!("{}, round {r}", row.name))
}

fn interval(s: &Summary) -> String {
    s.half_width.map_or("-".into(), |w| format!("{:.3} to {:.3}", s.mean - w, s.mean + w))
}

fn text_table(study: &Study, rows: &[StudyRow], estimates: &[FinalEstimates], claims: &[Claim]) -> String {
    let mut text = format!(
        "\n{} on {}: AUCCESS on the test tasks of the hidden world, {} estimates x {} trials\n\n",
        study.name,
        study.family,
        study.seeds.len(),
        study.trials
    );
    if !rows.is_empty() {
        text += "policy                                          interactions   jump start        95 % interval    after learning\n";
    }
    for row in rows {
        let learned = match row.curve.last() {
            Some((batches, s)) if *batches > 0 => format!("{:.3} after {batches} batches", s.mean),
            _ => String::new(),
        };
        text += &format!(
            "{:<47} {:>12.0}   {:<17} {:<16} {learned}\n",
            title(row),
            row.interactions,
            row.jump_start.show(3),
            interval(&row.jump_start)
        );
    }
    text + &estimate_table::text(study, estimates) + &claims_text(claims)
}

#[expect(clippy::too_many_arguments, reason = "all results of a study")]
fn write_all(
    out: &Path,
    family: &Family,
    study: &Study,
    rows: &[StudyRow],
    estimates: &[FinalEstimates],
    claims: &[Claim],
    cells: &[StudyCell],
    results: &[Transfer],
    seconds: f64,
) -> Result<()> {
    let plots = plots(study, rows);
    let pictures = pictures(family, study, cells)?;
    let table = text_table(study, rows, estimates, claims);
    let html = html(study, rows, estimates, claims, &plots, &pictures, seconds)?;
    let result = json!({
        "study": study, "rows": rows, "estimates": estimates, "claims": claims, "seconds": seconds,
        "version": env!("CARGO_PKG_VERSION"),
    });
    output::write_whole(&out.join("summary.csv"), &summary_csv(rows)?)?;
    output::write_whole(&out.join("estimates.csv"), &estimate_table::csv(study, estimates)?)?;
    output::write_whole(&out.join("trials.csv"), &trials_csv(cells, results)?)?;
    for (name, svg) in plots.iter().map(|(n, _, s)| (n, s)).chain(pictures.iter().map(|(n, _, s)| (n, s))) {
        output::write_whole(&out.join(format!("{name}.svg")), svg.as_bytes())?;
        output::write_whole(&out.join(format!("{name}.png")), &svg_to_png(svg, 960)?)?;
    }
    output::write_whole(&out.join("result.json"), result.to_string().as_bytes())?;
    output::write_whole(&out.join("table.txt"), table.trim_start().as_bytes())?;
    output::write_whole(&out.join("report.html"), html.as_bytes())
}

/// A row for each point of each row's curve.
fn summary_csv(rows: &[StudyRow]) -> Result<Vec<u8>> {
    let header = [
        "policy",
        "round",
        "interactions",
        "batches",
        "auccess",
        "standard_error",
        "ci95_half_width",
        "seeds",
    ];
    let number = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
    let points = rows.iter().flat_map(|row| row.curve.iter().map(move |point| (row, point)));
    let line = points.map(|(row, (batches, s))| {
        vec![
            row.name.clone(),
            row.round.map_or(String::new(), |r| r.to_string()),
            row.interactions.to_string(),
            batches.to_string(),
            s.mean.to_string(),
            number(s.standard_error),
            number(s.half_width),
            s.n.to_string(),
        ]
    });
    output::csv(&header, line)
}

/// A row for each evaluation of each policy.
fn trials_csv(cells: &[StudyCell], results: &[Transfer]) -> Result<Vec<u8>> {
    let header = ["policy", "round", "seed", "trial", "interactions", "batches", "real_attempts", "auccess"];
    let points = cells.iter().zip(results).flat_map(|(c, r)| r.points.iter().map(move |point| (c, point)));
    let line = points.map(|(cell, point)| {
        vec![
            cell.row.clone(),
            cell.round.map_or(String::new(), |r| r.to_string()),
            cell.seed.to_string(),
            cell.trial.to_string(),
            cell.interactions.to_string(),
            point.batches.to_string(),
            point.interactions.to_string(),
            point.auccess.to_string(),
        ]
    });
    output::csv(&header, line)
}

/// (file name, caption, SVG)
type StudyFigure = (String, String, String);

fn plots(study: &Study, rows: &[StudyRow]) -> Vec<StudyFigure> {
    let band = |s: &Summary| {
        let w = s.half_width.unwrap_or(0.0);
        ((s.mean - w).max(0.0), (s.mean + w).min(1.0))
    };
    let mut plots = Vec::new();
    if rows.iter().any(|r| r.curve.len() > 1) {
        let series: Vec<Series> = rows
            .iter()
            .map(|r| Series {
                name: title(r),
                points: r.curve.iter().map(|(b, s)| (*b as f64, s.mean)).collect(),
                band: Some(r.curve.iter().map(|(_, s)| band(s)).collect()),
                ..Series::default()
            })
            .collect();
        let svg = plot::lines(
            "Learning in the real world",
            "batches learned in the real world",
            "AUCCESS on test tasks",
            &series,
        );
        plots.push(("learning".into(), "Means with 95 % intervals over estimates.".into(), svg));
    }
    if study.rounds.len() > 1 && !rows.is_empty() {
        let most = rows.iter().map(|r| r.interactions).fold(0.0, f64::max);
        let flat = rows.iter().filter(|r| r.round.is_none()).map(|r| Series {
            name: r.name.clone(),
            points: vec![(0.0, r.jump_start.mean), (most, r.jump_start.mean)],
            band: None,
            ..Series::default()
        });
        let arms = study.arms.iter().map(|arm| {
            let mine: Vec<&StudyRow> =
                rows.iter().filter(|r| r.name == arm.name && r.round.is_some()).collect();
            Series {
                name: arm.name.clone(),
                points: mine.iter().map(|r| (r.interactions, r.jump_start.mean)).collect(),
                band: Some(mine.iter().map(|r| band(&r.jump_start)).collect()),
                ..Series::default()
            }
        });
        let svg = plot::lines(
            "Jump start by interactions spent on the estimate",
            "real interactions",
            "AUCCESS on test tasks",
            &arms.chain(flat).collect::<Vec<_>>(),
        );
        plots.push(("jump_start".into(), "Means with 95 % intervals over estimates.".into(), svg));
    }
    plots
}

/// The last row's policy on some test tasks: success probabilities over the scene, the chosen action and its trajectory.
fn pictures(family: &Family, study: &Study, cells: &[StudyCell]) -> Result<Vec<StudyFigure>> {
    let Some(cell) =
        cells.iter().filter(|c| c.trial == 0 && c.seed == study.seeds[0]).rfind(|c| c.round.is_some())
    else {
        return Ok(Vec::new());
    };
    let bar = output::TerminalProgress::new();
    let mut alone = study.clone();
    alone.transfer.learn = None;
    let Some(policy) = run_study_cell(family, &alone, cell, &bar)?.1 else { return Ok(Vec::new()) };
    bar.clear();
    let mut world = HiddenWorld::new(HiddenConfig { seed: cell.seed, ..study.hidden.clone() })?;
    let mut pictures = Vec::new();
    for (i, task) in split(&study.tasks(family, cell.seed), Split::Test).iter().take(4).enumerate() {
        if let Some((caption, svg)) = picture(&policy, task, &mut world)? {
            pictures.push((format!("policy_{}", i + 1), format!("{}: {caption}", cell.row), svg));
        }
    }
    Ok(pictures)
}

fn picture(policy: &Dqn, task: &Task, world: &mut HiddenWorld) -> Result<Option<(String, String)>> {
    let space = task.actions();
    let axis = |quantity: ActionQuantity| space.components.iter().position(|c| c.set == quantity);
    let (Some(x), Some(y)) = (axis(ActionQuantity::X), axis(ActionQuantity::Y)) else { return Ok(None) };
    let chance = |score: f32| 1.0 / (1.0 + (-f64::from(score)).exp());
    let mapped = grid_actions(space, [x, y])?;
    let at = |action: &ValidAction, i: usize| space.components[i].value(action.values()[i]);
    let chances: Vec<([f64; 2], f64)> = mapped
        .iter()
        .zip(policy.score(task, &mapped)?)
        .map(|(action, score)| ([at(action, x), at(action, y)], chance(score)))
        .collect();
    let step = space.count().div_ceil(100_000).max(1);
    let actions: Vec<ValidAction> =
        (0..space.count()).step_by(step).map(|i| space.at(i)).collect::<Result<_>>()?;
    for index in rank(policy, task, &actions, CHUNK)? {
        let action = &actions[index..=index];
        let attempt = world.measure(task, action)?.pop();
        let Some((Ok(scene), Some(film))) = attempt.map(|a| (a.placement, a.trajectory)) else { continue };
        let outcome = if film.solved() { "solved" } else { "not solved" };
        let caption = format!(
            "{} {outcome} at the first attempt; predicted probability {:.2}. Map: maximal success probability of the actions at \
             each position, from dark (0) to yellow (1).",
            task.id,
            chance(policy.score(task, action)?[0])
        );
        let style = Style { width: 640, ..Style::default() };
        return Ok(Some((caption, success_map_svg(&chances, &scene, Some(&film), &style))));
    }
    Ok(None)
}

/// Actions on a regular grid over the components `axes`, with the other components in even steps. (A task's discrete actions may be
/// scattered and leave holes in a map.)
fn grid_actions(space: &ActionSpace, axes: [usize; 2]) -> Result<Vec<ValidAction>> {
    const CELLS_PER_AXIS: usize = 48;
    const MAX_ACTIONS: usize = 150_000;
    let others = space.dimension().saturating_sub(2).max(1);
    let each = (MAX_ACTIONS as f64 / (CELLS_PER_AXIS * CELLS_PER_AXIS) as f64).powf(1.0 / others as f64);
    let steps = (each as usize).clamp(1, 16);
    let counts =
        (0..space.dimension()).map(|i| if axes.contains(&i) { CELLS_PER_AXIS } else { steps }).collect();
    let grid = ActionSpace { discrete: Discretisation::Grid { counts }, ..space.clone() };
    (0..grid.count()).map(|i| grid.at(i)).collect()
}

fn html(
    study: &Study,
    rows: &[StudyRow],
    estimates: &[FinalEstimates],
    claims: &[Claim],
    plots: &[StudyFigure],
    pictures: &[StudyFigure],
    seconds: f64,
) -> Result<String> {
    let columns = |names: &[&str]| names.iter().map(|n| n.to_string()).collect::<Vec<_>>();
    let svg = |(_, caption, svg): &StudyFigure| Block::Svg { svg: svg.clone(), caption: caption.clone() };
    let table = Block::Table {
        columns: columns(&[
            "policy",
            "real interactions",
            "jump start",
            "95 % interval",
            "after further learning",
        ]),
        rows: rows
            .iter()
            .map(|r| {
                let learned = r.curve.last().filter(|(b, _)| *b > 0);
                vec![
                    title(r),
                    format!("{:.0}", r.interactions),
                    r.jump_start.show(3),
                    interval(&r.jump_start),
                    learned.map_or("-".into(), |(b, s)| format!("{} ({b} batches)", s.show(3))),
                ]
            })
            .collect(),
        note: "AUCCESS on the test tasks of the hidden world, mean over estimates +- standard error; \
               the interval is Student's over estimates."
            .into(),
    };
    let mut sections = vec![
        Section::new("Claims", vec![claims_table(claims, Some(MIN_RELEVANT_AUCCESS_DIFFERENCE))]),
        Section::new("Jump start", plots.iter().map(svg).chain([table]).collect()),
        Section::new("Estimates", vec![estimate_table::block(study, estimates)]),
    ];
    if !pictures.is_empty() {
        let blocks = pictures.iter().map(svg).collect();
        sections.push(Section::new("Actions of the learned policy", blocks));
    }
    sections.push(Section::new(
        "Run",
        vec![
            Block::Text(format!("iplw {}; {seconds:.0} s of work.", env!("CARGO_PKG_VERSION"))),
            configuration(study)?,
        ],
    ));
    let page = HtmlReport {
        title: format!("Transfer: {} on {}", study.name, study.family),
        lead: "Performance of policies on unseen tasks of a hidden world, by training environment.".into(),
        sections,
        ..HtmlReport::default()
    };
    Ok(page.to_html())
}
