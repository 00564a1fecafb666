//! The report of an estimation: the latents with intervals, whether the simulation reproduces the trials, and the estimates by round.

use crate::estimate::LatentEstimate;
use crate::experiment::{EstimateReport, StopReason};
use crate::number::{digits, interval, length, p_value, significant};
use crate::picture::plot::{Series, XyPlot, panels};
use crate::picture::report::{Block, Section, Tone};
use crate::picture::theme::Meaning;
use crate::picture::{HtmlReport, IntervalRow, intervals_svg};
use crate::report::words::{listed, plain_names, sentence};
use crate::world::latent::FACTORS;

/// Size of a panel, px.
const PANEL_SIZE_PX: (u32, u32) = (500, 260);
/// Half of the scale of an effect's parameter in half widths of its interval.
const SCALE_HALF_WIDTHS: f64 = 3.0;

/// The report.
pub fn report(d: &EstimateReport) -> HtmlReport {
    let rows: Vec<IntervalRow> = all(d).filter_map(|(i, latent)| interval_row(d, i, latent)).collect();
    let caption = "Dot: the estimate; line: 95 % interval. The grey bar is the range of the prior, or of three intervals.";
    let picture = if rows.is_empty() {
        Vec::new()
    } else {
        vec![Block::Svg { svg: intervals_svg("Estimates", &rows), caption: caption.into() }]
    };
    let facts = vec![
        Block::card("Fit", vec![fit(d)]),
        Block::card("What to do next", vec![Block::List(next_steps(d))]),
    ];
    let opening = Block::pictures_and_facts(picture, facts);
    HtmlReport {
        title: title(d),
        kicker: format!(
            "Estimation by {} actions, seed {}, iplw {}",
            plain_names(&d.strategy),
            d.seed,
            d.version
        ),
        lead: format!(
            "{} real interactions in {} rounds and {} simulated rollouts; {}.",
            d.real_interactions,
            d.estimates.len(),
            d.rollouts,
            ended(d.stopped)
        ),
        opening: vec![opening],
        sections: vec![
            Section::folded("Estimates", "values with 95 % intervals", vec![table(d)]),
            Section::folded("Rounds", "how the estimates converge", rounds(d)),
        ],
    }
}

/// Latents and parameters of effects, with their place in a round's estimate.
fn all(d: &EstimateReport) -> impl Iterator<Item = (usize, &LatentEstimate)> {
    d.latents.iter().chain(&d.effects).enumerate()
}

fn title(d: &EstimateReport) -> String {
    let identifiable = all(d).filter(|(_, l)| l.identifiable);
    let values: Vec<String> =
        identifiable.map(|(_, l)| format!("{} {}", plain_names(&l.name), digits(l.value))).collect();
    match values.is_empty() {
        true => "These trials determine no latent".into(),
        false => sentence(&values.join(", ")).trim_end_matches('.').into(),
    }
}

fn ended(stopped: StopReason) -> &'static str {
    match stopped {
        StopReason::Rounds => "all rounds are complete",
        StopReason::Settled => "it ended because the estimate converged",
        StopReason::Budget => "it ended because the budget of real interactions was spent",
        StopReason::Unfinished => "more rounds are possible",
    }
}

fn interval_row(d: &EstimateReport, index: usize, latent: &LatentEstimate) -> Option<IntervalRow> {
    let [Some(low), Some(high)] = latent.ci95 else { return None };
    let scale = match d.config.cem.prior.get(index) {
        Some((mean, sd)) => [(mean - 2.0 * sd).max(0.0).min(low), (mean + 2.0 * sd).max(high)],
        None => {
            let half = 0.5 * SCALE_HALF_WIDTHS * (high - low).max(1e-9);
            [latent.value - half, latent.value + half]
        }
    };
    let v = latent.value;
    latent.identifiable.then(|| IntervalRow {
        name: plain_names(&latent.name),
        text: format!("{} ({})", digits(v), interval(&latent.ci95, "")),
        scale,
        quantiles: [low, v, v, v, high],
        truth: None,
    })
}

fn fit(d: &EstimateReport) -> Block {
    let Some(fit) = &d.fit else {
        return Block::Text("The fit was not checked.".into());
    };
    let (judgement, tone) = match fit.adequate {
        Some(true) => ("the simulation reproduces the trials", Tone::Good),
        Some(false) => ("the simulation cannot reproduce the trials", Tone::Bad),
        None => ("too few data to tell", Tone::Warn),
    };
    Block::Stat {
        value: fit.error_m.map_or("-".into(), length),
        label: match fit.noise_m {
            Some(noise) => format!(
                "error of the best simulation in the median trial; the measurement noise is {}",
                length(noise)
            ),
            None => "error of the best simulation in the median trial".into(),
        },
        judgement: judgement.into(),
        tone,
    }
}

fn next_steps(d: &EstimateReport) -> Vec<String> {
    let mut steps = Vec::new();
    if let Some(fit) = d.fit.as_ref().filter(|fit| fit.adequate == Some(false)) {
        let p = fit.lack_of_fit_p.map_or(String::new(), |p| format!(" (p {})", p_value(p)));
        steps.push(format!(
            "Diagnose these trials: an effect is missing{p}. Until it is found, the estimates and their intervals ignore it."
        ));
    } else {
        steps.push("Plan or train in the simulation with these values.".into());
    }
    let open: Vec<String> =
        all(d).filter(|(_, l)| !l.identifiable).map(|(_, l)| plain_names(&l.name)).collect();
    if !open.is_empty() {
        steps.push(format!(
            "These trials do not determine {}. If a task needs it, choose actions that inform it.",
            listed(&open)
        ));
    }
    steps
}

fn table(d: &EstimateReport) -> Block {
    let row = |(_, l): (usize, &LatentEstimate)| match l.identifiable {
        true => vec![plain_names(&l.name), digits(l.value), interval(&l.ci95, "")],
        false => vec![plain_names(&l.name), "-".into(), "not identifiable from these trials".into()],
    };
    let misfit: Vec<String> = d.residuals.iter().map(|r| significant(*r, 2)).collect();
    Block::table(
        &["latent", "value", "95 % interval"],
        all(d).map(row).collect(),
        &format!(
            "Squared distance of the best simulation by round, m\u{b2} per trajectory: {}.",
            misfit.join(", ")
        ),
    )
}

/// A panel for each identifiable latent: its estimate after each round.
fn rounds(d: &EstimateReport) -> Vec<Block> {
    let panel = |(i, latent): (usize, &LatentEstimate)| {
        let points = d.estimates.iter().enumerate().filter_map(|(k, e)| Some(((k + 1) as f64, *e.get(i)?)));
        let curve = Series {
            name: latent.name.clone(),
            points: points.collect(),
            meaning: Some(Meaning::Extended),
            ..Series::default()
        };
        let unit = FACTORS.iter().find(|f| f.name == latent.name).map_or("", |f| f.unit);
        let plot = XyPlot {
            title: plain_names(&latent.name),
            x_label: "round".into(),
            y_label: format!("{} {}", plain_names(&latent.name), crate::number::unit(unit)).trim_end().into(),
            curves: vec![curve],
            size: PANEL_SIZE_PX,
            ..XyPlot::default()
        };
        plot.svg()
    };
    let plots: Vec<String> =
        all(d).filter(|(i, l)| l.identifiable && *i < d.latents.len()).map(panel).collect();
    match plots.is_empty() || d.estimates.len() < 2 {
        true => Vec::new(),
        false => vec![Block::Svg { svg: panels("Estimates by round", &plots, 2), caption: String::new() }],
    }
}
