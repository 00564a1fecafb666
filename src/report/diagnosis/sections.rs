//! Folded sections of a diagnosis's report: tables and figures.

use super::document::DiagnosisDocument;
use super::trials::ReportedTrials;
use crate::inference::report::{
    BaseMisfit, CalibratedLatent, Diagnosis, EffectEstimate, HeldOutError, ModelScore, ParameterEstimate,
};
use crate::number::{digits, interval, length, p_value, percent, significant, unit, with_unit};
use crate::picture::report::{Block, Section};
use crate::report::words::{plain_names, sentence, set_name};
use crate::world::effect;

/// Figures of a report by name, as blocks.
type FigureBlocks<'a> = &'a dyn Fn(&str) -> Vec<Block>;

/// All sections, without regard to whether they have blocks.
pub fn all(document: &DiagnosisDocument, trials: &ReportedTrials, figure: FigureBlocks) -> Vec<Section> {
    let d = &document.diagnosis;
    let section = |heading: &str, note: &str, blocks| Section::folded(heading, note, blocks);
    vec![
        section("Reasoning", "how the verdict follows from the data", reasoning(d)),
        section("Effects and parameters", "values with 95 % intervals", effects(d)),
        section("Errors", "before and after, on fitted and other trials", errors(d)),
        section("Residuals", "measured minus simulated, over time", figure("residuals")),
        section("Missing acceleration", "where and how strongly it acts", figure("missing_acceleration")),
        section("Impacts", "impulses against the speed of impact", figure("impacts")),
        section("Estimates by trial", "whether all trials agree", figure("estimates")),
        section(
            "Trials against their predictions",
            "outliers and calibration",
            predictions(d, trials, figure),
        ),
        section("Other explanations", "all sets of effects that were tried", alternatives(d)),
    ]
}

fn reasoning(d: &Diagnosis) -> Vec<Block> {
    let mut blocks = vec![Block::Text(sentence(&plain_names(&d.reason)))];
    let signature = |e: &EffectEstimate| {
        let signature = effect::find(&e.name).ok()?.signature;
        Some(format!("How {} shows: {signature}", plain_names(&e.name)))
    };
    blocks.extend(d.effects.iter().filter_map(signature).map(Block::Text));
    if let Some(law) = &d.residual_law {
        let text = match law.offered {
            true => "Empirical acceleration law for the residual; it is part of the extended scene:",
            false => {
                "Empirical acceleration law for the residual; it does not reduce the error on held-out trials:"
            }
        };
        blocks.extend([Block::Text(text.into()), Block::Code(law.formula.clone())]);
    }
    blocks
}

fn effects(d: &Diagnosis) -> Vec<Block> {
    let all = d.effects.iter().flat_map(|e| e.parameters.iter().map(move |p| (e, p)));
    let row = |(e, p): (&EffectEstimate, &ParameterEstimate)| {
        vec![
            plain_names(&e.name),
            p.name.clone(),
            p.setting.clone().unwrap_or_default(),
            digits(p.value),
            unit(&p.unit),
            interval(&p.ci95, &p.unit),
            p.spread.map_or(String::new(), digits),
            percent(e.probability),
        ]
    };
    let columns = [
        "effect",
        "parameter",
        "setting",
        "value",
        "unit",
        "95 % interval",
        "sd between trials",
        "probability",
    ];
    let note = "The probability is that the effect acts at all, over all sets of effects that were tried.";
    let mut blocks = table(&columns, all.map(row).collect(), note);
    let row = |c: &CalibratedLatent| {
        let range = match c.identifiable {
            true => interval(&c.ci95, ""),
            false => "not identifiable from these trials".into(),
        };
        vec![c.name.clone(), digits(c.value), range]
    };
    blocks.extend(table(&["latent", "value", "95 % interval"], d.calibrated.iter().map(row).collect(), ""));
    let moved = d.surface_offsets.iter().map(|s| vec![s.name.clone(), length(s.offset), length(s.sd)]);
    let note = "Offset of each surface along its normal, from the bounces off it.";
    blocks.extend(table(&["surface", "offset", "standard error"], moved.collect(), note));
    blocks
}

fn errors(d: &Diagnosis) -> Vec<Block> {
    let law = d.residual_law.as_ref().map(|l| &l.held_out);
    let all = [
        ("trials that were not fitted", d.gain.held_out.as_ref()),
        ("the same, with the empirical law", law),
        ("a setting that was not fitted", d.gain.extrapolation.as_ref()),
    ];
    let row = |(on, g): (&str, &HeldOutError)| {
        vec![
            on.to_string(),
            g.trials.to_string(),
            length(g.base_rmse),
            length(g.extended_rmse),
            length(g.floor_rmse),
            g.excess_removed.map_or("-".into(), |e| percent(e.min(1.0))),
        ]
    };
    let rows = all.into_iter().filter_map(|(on, g)| Some(row((on, g?)))).collect();
    let note = "Root mean square errors of positions. Initial states are fitted for every trial; all other parameters come from the other \
                trials. The last column is the share of the error beyond noise that the extension removes.";
    let columns = ["error on", "trials", "before", "after", "noise alone", "removed"];
    let mut blocks = table(&columns, rows, note);
    blocks.extend(d.residual.as_ref().map(|r| Block::KeyValues(misfit(d, r))));
    blocks
}

fn misfit(d: &Diagnosis, r: &BaseMisfit) -> Vec<(String, String)> {
    let pair = |name: &str, value: String| (name.to_string(), value);
    vec![
        pair("error of the fitted simulation", length(r.base_rmse)),
        pair("error that noise alone would leave in it", length(r.floor_rmse)),
        pair("probability of so large an error if the simulation were right", p_value(r.lack_of_fit_p)),
        pair("probability of such regular residuals if they were noise", p_value(r.whiteness_p)),
        pair(
            "correlation of the noise between neighbouring observations",
            significant(r.noise_correlation, 2),
        ),
        pair(
            "share of the error beyond noise without explanation",
            d.unexplained_share.map_or("-".into(), percent),
        ),
    ]
}

fn predictions(d: &Diagnosis, trials: &ReportedTrials, figure: FigureBlocks) -> Vec<Block> {
    let mut blocks = Vec::new();
    if let Some(check) = &d.predictive {
        let n = check.launches.len() as f64;
        let outliers: Vec<String> = check.further_off.iter().map(|t| trials.name(*t)).collect();
        let outliers = match outliers.is_empty() {
            true => "There are no outliers".to_string(),
            false => format!("Outliers: {}", outliers.join(", ")),
        };
        blocks.push(Block::Text(format!(
            "Each trial is compared with its prediction from the others: {:.0} of {n} are outside the 95 % range, {:.1} are expected. \
             {outliers}. The median error is {} times the predicted one.",
            (check.outside_share * n).round(),
            0.05 * n,
            significant(check.usual_ratio, 2)
        )));
    }
    let odd = d.odd_trials.iter().map(|o| {
        format!("{} was left out: probability of a larger deviation {}", trials.name(o.trial), p_value(o.p))
    });
    let unused =
        d.unused_contacts.iter().map(|u| format!("{} contacts were not used: {}", u.count, u.reason));
    let random = d.unlike.iter().map(|u| {
        format!(
            "Trials differ at random in {} {} by {} (standard deviation)",
            plain_names(&u.effect),
            u.parameter,
            with_unit(u.spread, &u.unit)
        )
    });
    let notes: Vec<String> = odd.chain(unused).chain(random).collect();
    if !notes.is_empty() {
        blocks.push(Block::List(notes));
    }
    blocks.extend(figure("predictive_check"));
    blocks
}

/// Number of sets in the table; the rest is folded once more.
const MAX_LISTED_SETS: usize = 8;

fn alternatives(d: &Diagnosis) -> Vec<Block> {
    let row = |s: &ModelScore| {
        vec![set_name(&s.effects), percent(s.probability), significant(s.score, 3), estimates(s)]
    };
    let columns = ["effects", "probability", "log odds, nats", "values, if credible"];
    let note = "Log odds relative to the best set.";
    let mut blocks = table(&columns, d.scores.iter().take(MAX_LISTED_SETS).map(row).collect(), note);
    let rest = table(&columns, d.scores.iter().skip(MAX_LISTED_SETS).map(row).collect(), "");
    if !rest.is_empty() {
        blocks.push(Block::Details { summary: "All other sets that were fitted".into(), blocks: rest });
    }
    if !d.failed.is_empty() {
        let sets: Vec<String> = d.failed.iter().map(|s| set_name(s)).collect();
        blocks.push(Block::Text(format!("The fit failed for {}; they are not ruled out.", sets.join(", "))));
    }
    blocks
}

/// Values of a set's effects, in short.
fn estimates(s: &ModelScore) -> String {
    let one = |(e, p): (&EffectEstimate, &ParameterEstimate)| {
        let setting = p.setting.as_ref().map(|s| format!(" of {s}")).unwrap_or_default();
        let name =
            if s.sizes.len() > 1 { format!("{} {}", plain_names(&e.name), p.name) } else { p.name.clone() };
        format!("{name}{setting} = {}", with_unit(p.value, &p.unit))
    };
    let all = s.sizes.iter().flat_map(|e| e.parameters.iter().map(move |p| (e, p)));
    all.map(one).collect::<Vec<_>>().join("; ")
}

/// A table, unless it has no rows.
fn table(columns: &[&str], rows: Vec<Vec<String>>, note: &str) -> Vec<Block> {
    if rows.is_empty() {
        return Vec::new();
    }
    vec![Block::table(columns, rows, note)]
}
