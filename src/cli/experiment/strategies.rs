//! `iplw experiment strategies`: error of each latent against real interactions, for every strategy.

use std::path::Path;

use iplw::error::{Error, Result};
use iplw::experiment::statistics::Claim;
use iplw::experiment::strategies::{
    ErrorRow, StrategiesConfig, StrategyCell, WorldVariant, claims, errors, run_strategy_cell,
};
use iplw::picture::plot::{self, Series};
use iplw::picture::{Block, HtmlReport, Section};
use iplw::task::{Family, family};
use iplw::world::latent::FACTORS;
use serde_json::json;

use super::args::ExperimentArgs;
use super::claims::{claims_table, claims_text, importance};
use super::configuration::configuration;
use crate::cli::cell_store::CellStore;
use crate::cli::output;

pub fn run(args: &ExperimentArgs) -> Result<()> {
    let family = family(&args.task)?;
    let mut config =
        if args.quick { StrategiesConfig::quick(family) } else { StrategiesConfig::paper(family) };
    config.seeds = args.chosen_seeds(&config.seeds);
    config.natures = match args.hidden.as_str() {
        "both" => config.natures,
        "damped" => vec![WorldVariant::Damped],
        "no-drag" => vec![WorldVariant::Matching],
        other => return Err(Error::input("--hidden", format!("{other:?}"), "damped, no-drag or both")),
    };
    config.validate()?;
    let all = config.cells();
    let cells = CellStore::new(&args.out, all.len())?;
    let importance = importance(family, config.needs_importance())?;
    let mut found: Vec<StrategyCell> = Vec::with_capacity(all.len());
    let mut seconds = Vec::with_capacity(all.len());
    for (arm, nature, seed) in all {
        let key = format!("{}, {}, seed {seed}", arm.name, nature.title());
        let depends = json!({ "family": family.name, "arm": arm, "nature": nature, "seed": seed });
        let (done, took) = cells.get_or_compute(&key, &depends, |progress| {
            run_strategy_cell(family, arm, nature, seed, importance.clone(), progress)
        })?;
        found.push(done);
        seconds.push(took);
    }
    cells.finish();
    let rows = errors(family, &found);
    let claims = claims(family, &config, &found);
    write_all(&args.out, family, &config, &found, &rows, &claims, &seconds)?;
    output::print(&text_table(family, &config, &rows, &claims))?;
    output::print(&format!("\nreport: {}\n", args.out.join("report.html").display()))
}

/// The last round of every arm.
fn last<'a>(rows: &'a [ErrorRow], arm: &str, nature: WorldVariant, factor: &str) -> Option<&'a ErrorRow> {
    rows.iter().rfind(|r| r.arm == arm && r.nature == nature && r.factor == factor)
}

fn reported_factors() -> [&'static str; 2] {
    [FACTORS[1].name, FACTORS[2].name]
}

fn with_error(row: &ErrorRow) -> String {
    match row.standard_error {
        Some(e) => format!("{:.4} +- {e:.4}", row.error),
        None => format!("{:.4}", row.error),
    }
}

fn text_table(family: &Family, config: &StrategiesConfig, rows: &[ErrorRow], claims: &[Claim]) -> String {
    let mut text = format!(
        "\n{}: final error of the latents, mean over {} seeds +- standard error, and bias\n",
        family.name,
        config.seeds.len()
    );
    for nature in &config.natures {
        text += &format!("\nhidden world: {}\n", nature.title());
        text += "arm                                            interactions   friction           (bias)    restitution        (bias)\n";
        for arm in &config.arms {
            let [Some(friction), Some(restitution)] =
                reported_factors().map(|f| last(rows, &arm.name, *nature, f))
            else {
                continue;
            };
            text += &format!(
                "{:<46} {:>12.0}   {:<18} {:>+7.3}   {:<18} {:>+7.3}\n",
                arm.name,
                friction.interactions,
                with_error(friction),
                friction.bias,
                with_error(restitution),
                restitution.bias
            );
        }
    }
    text + &claims_text(claims)
}

fn write_all(
    out: &Path,
    family: &Family,
    config: &StrategiesConfig,
    cells: &[StrategyCell],
    rows: &[ErrorRow],
    claims: &[Claim],
    seconds: &[f64],
) -> Result<()> {
    let plots: Vec<(String, String)> = config
        .natures
        .iter()
        .flat_map(|nature| reported_factors().map(|factor| (*nature, factor)))
        .map(|(nature, factor)| {
            let name = format!(
                "{factor}_{}.svg",
                if nature == WorldVariant::Matching { "no_drag" } else { "damped" }
            );
            (name, plot_of(config, rows, nature, factor))
        })
        .collect();
    let result = json!({
        "config": config, "cells": cells, "errors": rows, "claims": claims, "seconds": seconds.iter().sum::<f64>(),
        "version": env!("CARGO_PKG_VERSION"),
    });
    let table = text_table(family, config, rows, claims);
    let html = html(family, config, rows, claims, cells, &plots, seconds)?;
    output::write_whole(&out.join("errors.csv"), &errors_csv(rows)?)?;
    output::write_whole(&out.join("estimates.csv"), &estimates_csv(cells)?)?;
    output::write_whole(&out.join("choices.csv"), &choices_csv(cells)?)?;
    for (name, svg) in &plots {
        output::write_whole(&out.join(name), svg.as_bytes())?;
    }
    output::write_whole(&out.join("result.json"), result.to_string().as_bytes())?;
    output::write_whole(&out.join("table.txt"), table.trim_start().as_bytes())?;
    output::write_whole(&out.join("report.html"), html.as_bytes())
}

fn errors_csv(rows: &[ErrorRow]) -> Result<Vec<u8>> {
    let header = "arm,hidden_world,factor,interactions,error,standard_error,bias,seeds";
    let row = |r: &ErrorRow| {
        vec![
            r.arm.clone(),
            r.nature.title().into(),
            r.factor.clone(),
            r.interactions.to_string(),
            r.error.to_string(),
            r.standard_error.map_or(String::new(), |e| e.to_string()),
            r.bias.to_string(),
            r.seeds.to_string(),
        ]
    };
    output::csv(&header.split(',').collect::<Vec<_>>(), rows.iter().map(row))
}

/// The first columns of every row of a cell.
fn cell_columns(c: &StrategyCell) -> Vec<String> {
    vec![c.arm.clone(), c.nature.title().into(), c.seed.to_string()]
}

fn estimates_csv(cells: &[StrategyCell]) -> Result<Vec<u8>> {
    let header = "arm,hidden_world,seed,interactions,density,friction,restitution,drag";
    let rows = cells.iter().flat_map(|c| {
        c.interactions.iter().zip(&c.estimates).map(|(n, estimate)| {
            let mut row = cell_columns(c);
            row.push(n.to_string());
            row.extend(estimate.iter().map(|v| v.to_string()));
            row
        })
    });
    output::csv(&header.split(',').collect::<Vec<_>>(), rows)
}

fn choices_csv(cells: &[StrategyCell]) -> Result<Vec<u8>> {
    let header = "arm,hidden_world,seed,round,actions,tasks,collisions,rolling_steps,candidate_collisions,\
                  candidate_rolling_steps";
    let rows = cells.iter().flat_map(|c| {
        c.choices.iter().enumerate().map(|(round, s)| {
            let counts = [round + 1, s.actions, s.tasks].map(|n| n.to_string());
            let means = [s.collisions, s.rolling_steps, s.candidate_collisions, s.candidate_rolling_steps];
            [cell_columns(c), counts.to_vec(), means.map(|v| v.to_string()).to_vec()].concat()
        })
    });
    output::csv(&header.split(',').collect::<Vec<_>>(), rows)
}

fn plot_of(config: &StrategiesConfig, rows: &[ErrorRow], nature: WorldVariant, factor: &str) -> String {
    let series: Vec<Series> = config
        .arms
        .iter()
        .map(|arm| {
            let mine: Vec<&ErrorRow> = rows
                .iter()
                .filter(|r| r.arm == arm.name && r.nature == nature && r.factor == factor)
                .collect();
            let band = mine.iter().map(|r| {
                let e = r.standard_error.unwrap_or(0.0);
                ((r.error - e).max(0.0), r.error + e)
            });
            Series {
                name: arm.name.clone(),
                points: mine.iter().map(|r| (r.interactions, r.error)).collect(),
                band: Some(band.collect()),
                ..Series::default()
            }
        })
        .collect();
    let title = format!("Error of {factor}, hidden world: {}", nature.title());
    plot::lines(&title, "real interactions", &format!("|{factor} - truth|"), &series)
}

fn html(
    family: &Family,
    config: &StrategiesConfig,
    rows: &[ErrorRow],
    claims: &[Claim],
    cells: &[StrategyCell],
    plots: &[(String, String)],
    seconds: &[f64],
) -> Result<String> {
    let columns = |names: &[&str]| names.iter().map(|n| n.to_string()).collect::<Vec<_>>();
    let mut sections = vec![Section::new("Claims", vec![claims_table(claims, None)])];
    for nature in &config.natures {
        let table = config.arms.iter().filter_map(|arm| {
            let [Some(friction), Some(restitution)] =
                reported_factors().map(|f| last(rows, &arm.name, *nature, f))
            else {
                return None;
            };
            Some(vec![
                arm.name.clone(),
                format!("{:.0}", friction.interactions),
                with_error(friction),
                format!("{:+.3}", friction.bias),
                with_error(restitution),
                format!("{:+.3}", restitution.bias),
            ])
        });
        let mut blocks = vec![Block::Table {
            columns: columns(&["arm", "interactions", "friction", "bias", "restitution", "bias"]),
            rows: table.collect(),
            note: format!("Mean of |estimate - truth| over {} seeds +- standard error.", config.seeds.len()),
        }];
        let mine = if *nature == WorldVariant::Matching { "no_drag" } else { "damped" };
        blocks.extend(
            plots
                .iter()
                .filter(|(name, _)| name.contains(mine))
                .map(|(_, svg)| Block::Svg { svg: svg.clone(), caption: String::new() }),
        );
        sections.push(Section::new(&format!("Hidden world: {}", nature.title()), blocks));
    }
    sections.push(Section::new("Chosen actions", vec![chosen(config, cells)]));
    sections.push(Section::new(
        "Configuration",
        vec![
            Block::Text(format!(
                "iplw {}; {} estimations, {:.0} s.",
                env!("CARGO_PKG_VERSION"),
                cells.len(),
                seconds.iter().sum::<f64>()
            )),
            configuration(config)?,
        ],
    ));
    let page = HtmlReport {
        title: format!("Exploration strategies: {}", family.name),
        lead: "Error of the latent factors against real interactions, for every exploration strategy.".into(),
        sections,
        ..HtmlReport::default()
    };
    Ok(page.to_html())
}

/// Mean counts of the chosen actions, by arm.
fn chosen(config: &StrategiesConfig, cells: &[StrategyCell]) -> Block {
    let rows = config.arms.iter().map(|arm| {
        let all: Vec<_> = cells.iter().filter(|c| c.arm == arm.name).flat_map(|c| &c.choices).collect();
        let mean = |of: &dyn Fn(&iplw::experiment::SelectionSummary) -> f64| {
            all.iter().map(|c| of(c)).sum::<f64>() / all.len().max(1) as f64
        };
        vec![
            arm.name.clone(),
            format!("{:.2}", mean(&|c| c.collisions)),
            format!("{:.2}", mean(&|c| c.candidate_collisions)),
            format!("{:.0}", mean(&|c| c.rolling_steps)),
            format!("{:.0}", mean(&|c| c.candidate_rolling_steps)),
            format!("{:.1}", mean(&|c| c.tasks as f64)),
        ]
    });
    Block::Table {
        columns: [
            "arm",
            "collisions",
            "of all candidates",
            "rolling steps",
            "of all candidates",
            "tasks per round",
        ]
        .map(String::from)
        .to_vec(),
        rows: rows.collect(),
        note: "Simulated means over rounds and seeds.".into(),
    }
}
