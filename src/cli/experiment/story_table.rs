//! The table of `iplw run` over families, and what it shows, in sentences.

use iplw::experiment::extension::Extension;
use iplw::experiment::quickstart::{Method, QuickstartReport};
use iplw::experiment::statistics::Summary;

/// Columns of the table, and its rows: one for each method, one cell for each family.
pub fn table_rows(reports: &[QuickstartReport]) -> (Vec<String>, Vec<Vec<String>>) {
    let families = reports.iter().map(|r| r.config.family.clone());
    let columns = ["policy from".to_string()].into_iter().chain(families).chain(["real interactions".into()]);
    let row = |(k, method): (usize, &Method)| {
        let cells = reports.iter().map(|r| r.rows[k].summary().show(3));
        let spent = reports.iter().map(|r| {
            let spent = &r.rows[k].real_interactions;
            format!("{:.0}", spent.iter().sum::<u64>() as f64 / spent.len().max(1) as f64)
        });
        let spent = spent.collect::<Vec<_>>().join(", ");
        [method.title().to_string()].into_iter().chain(cells).chain([spent]).collect()
    };
    (columns.collect(), Method::ALL.iter().enumerate().map(row).collect())
}

/// The table as text.
pub fn method_table(reports: &[QuickstartReport]) -> String {
    let (columns, rows) = table_rows(reports);
    let seeds = reports.first().map_or(0, |r| r.config.seeds.len());
    let plural = if seeds == 1 { "" } else { "s, +- standard error" };
    let mut text = format!("AUCCESS on test tasks of hidden worlds, {seeds} seed{plural}:\n\n");
    for row in std::iter::once(&columns).chain(&rows) {
        let cells = row[1..].iter().map(|cell| format!("{cell:<17}")).collect::<String>();
        text += &format!("{:<36}{}\n", row[0], cells.trim_end());
    }
    text + "\n"
}

/// A paragraph for each family: what was learned, what was not, and whether it pays.
pub fn conclusions(reports: &[QuickstartReport]) -> Vec<String> {
    reports.iter().map(conclusion).collect()
}

fn conclusion(report: &QuickstartReport) -> String {
    let family = &report.config.family;
    let bad = report.estimates.iter().filter(|e| e.has_bad_fit()).count();
    let seeds = report.estimates.len();
    format!(
        "{family}: {}; {}. The simulation without further effects was rejected in {bad} of {seeds} seeds{}. {}",
        latents(report, true),
        latents(report, false),
        effects(&report.diagnoses),
        gains(report)
    )
}

/// Names of the latents that all seeds, or not all seeds, identified.
fn latents(report: &QuickstartReport, identified: bool) -> String {
    let count = report.estimates.first().map_or(0, |e| e.latents.len());
    let all = |i: usize| report.estimates.iter().all(|e| e.latents[i].identifiable);
    let names: Vec<String> = (0..count)
        .filter(|i| all(*i) == identified)
        .map(|i| {
            let value = report.diagnoses.first().and_then(|d| d.latents.values()[i]);
            let name = &report.estimates[0].latents[i].name;
            let truth = report.truth.latents.values()[i];
            match (value, truth) {
                (Some(v), Some(t)) if identified => format!("{name} {v:.3} (true {t:.3})"),
                _ => name.clone(),
            }
        })
        .collect();
    match (identified, names.is_empty()) {
        (true, true) => "no latent learned".into(),
        (true, false) => format!("learned {}", names.join(", ")),
        (false, true) => "nothing left unidentified".into(),
        (false, false) => format!("not identifiable {}", names.join(", ")),
    }
}

/// Effects that the diagnoses added.
fn effects(diagnoses: &[Extension]) -> String {
    let mut names: Vec<String> = Vec::new();
    for d in diagnoses {
        let set = d.effects.iter().map(|e| e.name.clone()).collect::<Vec<_>>().join(" + ");
        if !set.is_empty() && !names.contains(&set) {
            names.push(set);
        }
    }
    if names.is_empty() {
        "; no effect was added".into()
    } else {
        format!("; the diagnosis added {}", names.join(", or "))
    }
}

/// Gains of the extended simulation and of plans over the baselines, with 95 % intervals over seeds.
fn gains(report: &QuickstartReport) -> String {
    let of = |method: Method| report.rows.iter().find(|r| r.method == method);
    let difference = |a: Method, b: Method| -> Option<Summary> {
        let (a, b) = (of(a)?, of(b)?);
        Some(Summary::of(&a.auccess.iter().zip(&b.auccess).map(|(a, b)| a - b).collect::<Vec<_>>()))
    };
    let ours = [(Method::Extended, "extended"), (Method::Planned, "planned")];
    let baselines =
        [(Method::Uncalibrated, "uncalibrated"), (Method::DomainRandomisation, "domain randomisation")];
    let mut parts = Vec::new();
    for (own, name) in ours {
        for (other, baseline) in baselines {
            let Some(gain) = difference(own, other) else { continue };
            let width = gain.half_width.map_or(String::new(), |w| format!(" +- {w:.3}"));
            parts.push(format!("{name} minus {baseline} {:+.3}{width}", gain.mean));
        }
    }
    let ratio = |own: Method| Some(of(own)?.summary().mean / of(Method::TruePhysics)?.summary().mean);
    let shares: Vec<String> =
        ours.iter().filter_map(|(own, name)| Some(format!("{name} {:.0} %", 100.0 * ratio(*own)?))).collect();
    format!("Gain in AUCCESS (95 %): {}. Of the true physics: {}.", parts.join(", "), shares.join(", "))
}
