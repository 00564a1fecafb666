//! The report of a posterior: what the trials determine, intervals beside the prior, pair plots, and the sampler's diagnostics.

use super::words::{listed, plain_names, set_name};
use crate::inference::posterior::{ParameterSummary, PosteriorDocument, PredictiveBand, SetSummary};
use crate::number::{digits, percent, significant, unit};
use crate::picture::plot::{Heatmap, PANEL_SIZE_PX, Series, XyPlot, heatmaps, panels};
use crate::picture::report::{Block, Section, ShareBar, Tone};
use crate::picture::theme::Meaning;
use crate::picture::{HtmlReport, IntervalRow, intervals_svg};

/// Cells of a pair plot along an axis.
const CELLS_PER_AXIS: usize = 24;
/// Maximum number of pair plots, and number of plots in a row.
const MAX_PAIR_PLOTS: usize = 15;
const PLOTS_PER_ROW: usize = 3;

/// The report.
pub fn report(d: &PosteriorDocument) -> HtmlReport {
    let rows: Vec<IntervalRow> = d.parameters.iter().map(interval_row).collect();
    let intervals = Block::Svg {
        svg: intervals_svg("Posterior intervals", &rows),
        caption: "Thick: the central 50 %; thin: the central 95 %; dot: median. The grey bar is the range of the prior.".into(),
    };
    let mut facts = vec![Block::card("Sampler", vec![convergence(d)])];
    if d.sets.len() > 1 {
        facts.push(Block::card("Sets of effects", vec![Block::Bars(set_bars(d))]));
    }
    let trials = format!(
        "{} of {} trials inform the posterior; the measurement noise is {}.",
        d.trials[0],
        d.trials[1],
        crate::number::length(d.noise_m)
    );
    let lead = [trials].into_iter().chain(d.warnings.iter().cloned()).collect::<Vec<_>>().join("\n\n");
    HtmlReport {
        title: title(d),
        kicker: format!("Posterior by {}, seed {}, iplw {}", d.method(), d.seed, d.version),
        lead,
        opening: vec![Block::Columns { main: true, columns: vec![vec![intervals], facts] }],
        sections: vec![
            Section::folded("Parameters", "means, standard deviations and quantiles", vec![parameters(d)]),
            Section::folded("Predictions", "measured trials against the posterior", predictions(d)),
            Section::folded("Pair plots", "which parameters depend on each other", pair_plots(d)),
            Section::folded(
                "Sets and diagnostics",
                "evidence, effective sample sizes and R-hat",
                vec![sets(d)],
            ),
        ],
    }
}

/// The parameters that the trials determine.
fn title(d: &PosteriorDocument) -> String {
    let names = |identifiable: bool| {
        let own = d.parameters.iter().filter(|p| p.identifiable == identifiable);
        let mut names: Vec<String> = own.map(|p| plain_names(&p.name)).collect();
        names.dedup();
        names
    };
    let (identifiable, open) = (names(true), names(false));
    match (identifiable.is_empty(), open.is_empty()) {
        (true, _) => "These trials tell no more than the prior".into(),
        (false, true) => format!("These trials determine {}", listed(&identifiable)),
        (false, false) => {
            format!("These trials determine {}, and not {}", listed(&identifiable), listed(&open))
        }
    }
}

fn interval_row(p: &ParameterSummary) -> IntervalRow {
    let [q2, _, q25, q50, q75, _, q97] = p.quantiles;
    let ([low, high], [centre, sd]) = (p.prior.bounds(), p.prior.centre_and_sd());
    let scale = [low.max(centre - 3.0 * sd).min(q2), high.min(centre + 3.0 * sd).max(q97)];
    let setting = p.setting.as_ref().map(|s| format!(" of {s}")).unwrap_or_default();
    IntervalRow {
        name: plain_names(&p.name) + &setting,
        text: format!("{} \u{b1} {} {}", digits(p.mean), significant(p.sd, 2), unit(&p.unit))
            .trim_end()
            .into(),
        scale,
        quantiles: [q2, q25, q50, q75, q97],
        truth: None,
    }
}

fn convergence(d: &PosteriorDocument) -> Block {
    let fewest = d.sets.iter().flat_map(|s| &s.quality.effective).copied().fold(f64::INFINITY, f64::min);
    let worst = d.sets.iter().flat_map(|s| &s.quality.r_hat).copied().fold(1.0, f64::max);
    let (judgement, tone) = match d.converged {
        true => ("converged", Tone::Good),
        false => ("not converged: raise the number of samples", Tone::Bad),
    };
    Block::Stat {
        value: format!("{} samples", d.run.len()),
        label: format!("effective sample size at least {fewest:.0}, R-hat at most {worst:.3}"),
        judgement: judgement.into(),
        tone,
    }
}

fn set_bars(d: &PosteriorDocument) -> Vec<ShareBar> {
    let best = d.sets.iter().map(|s| s.weight).fold(0.0, f64::max);
    let bar = |s: &SetSummary| ShareBar {
        name: set_name(&s.effects),
        share: s.weight,
        text: percent(s.weight),
        chosen: s.weight == best,
    };
    d.sets.iter().map(bar).collect()
}

fn parameters(d: &PosteriorDocument) -> Block {
    let columns = ["parameter", "setting", "mean", "sd", "2.5 %", "median", "97.5 %", "unit", "identifiable"];
    let row = |p: &ParameterSummary| {
        let numbers = [p.mean, p.sd, p.quantiles[0], p.quantiles[3], p.quantiles[6]].map(digits);
        let end = [unit(&p.unit), if p.identifiable { "yes".into() } else { "no: as the prior".into() }];
        [plain_names(&p.name), p.setting.clone().unwrap_or_default()]
            .into_iter()
            .chain(numbers)
            .chain(end)
            .collect()
    };
    Block::table(
        &columns,
        d.parameters.iter().map(row).collect(),
        "A parameter is identifiable if its interval is clearly narrower than the prior's.",
    )
}

/// Measured positions of some trials over their predictive bands, as one picture.
fn predictions(d: &PosteriorDocument) -> Vec<Block> {
    let panel = |band: &PredictiveBand, k: usize| {
        let over =
            |values: &mut dyn Iterator<Item = f64>| band.t.iter().copied().zip(values).collect::<Vec<_>>();
        let prediction = Series {
            name: "prediction, 95 %".into(),
            points: over(&mut band.quantiles[k].iter().map(|q| q[1])),
            band: Some(band.quantiles[k].iter().map(|q| (q[0], q[2])).collect()),
            meaning: Some(Meaning::Extended),
        };
        let measured = Series {
            name: "measured".into(),
            points: over(&mut band.measured.iter().map(|p| p[k])),
            meaning: Some(Meaning::Measured),
            ..Series::default()
        };
        let plot = XyPlot {
            title: format!("{}: {}", band.trial, band.body),
            x_label: "t, s".into(),
            y_label: format!("{}, m", ["x", "y"][k]),
            points: vec![measured],
            curves: vec![prediction],
            size: PANEL_SIZE_PX,
        };
        plot.svg()
    };
    let plots: Vec<String> = d.predictive.iter().flat_map(|band| [panel(band, 0), panel(band, 1)]).collect();
    if plots.is_empty() {
        return Vec::new();
    }
    let caption = "Positions as measured, and the 95 % band of a measurement under the posterior. Dots outside of it mean that the model \
                   lacks something: a diagnosis tells what.";
    vec![Block::Svg { svg: panels("Predictions", &plots, 2), caption: caption.into() }]
}

fn sets(d: &PosteriorDocument) -> Block {
    let columns = [
        "set of effects",
        "probability",
        "log evidence, nats",
        "likelihoods",
        "effective sample size",
        "R-hat",
    ];
    let row = |s: &SetSummary| {
        let fewest = s.quality.effective.iter().copied().fold(f64::INFINITY, f64::min);
        let worst = s.quality.r_hat.iter().copied().fold(1.0, f64::max);
        vec![
            set_name(&s.effects),
            percent(s.weight),
            significant(s.laplace_log_evidence, 4),
            s.evaluations.to_string(),
            format!("{fewest:.0}"),
            format!("{worst:.3}"),
        ]
    };
    Block::table(&columns, d.sets.iter().map(row).collect(), "")
}

/// Two-dimensional histograms of pairs of parameters, as one picture.
fn pair_plots(d: &PosteriorDocument) -> Vec<Block> {
    let columns: Vec<(&String, &Vec<Option<f64>>)> = d.columns.iter().collect();
    let pairs = (0..columns.len()).flat_map(|i| (0..i).map(move |j| (j, i)));
    let maps: Vec<Heatmap> =
        pairs.take(MAX_PAIR_PLOTS).map(|(i, j)| pair_histogram(columns[i], columns[j])).collect();
    let rows: Vec<String> = maps.chunks(PLOTS_PER_ROW).map(|row| heatmaps("", row)).collect();
    if rows.is_empty() {
        return Vec::new();
    }
    let caption = "Joint density of the samples. A tilted ridge means that the trials determine a combination of both better than either.";
    vec![Block::Svg { svg: panels("Pair plots", &rows, 1), caption: caption.into() }]
}

fn pair_histogram(x: (&String, &Vec<Option<f64>>), y: (&String, &Vec<Option<f64>>)) -> Heatmap {
    let both: Vec<[f64; 2]> = x.1.iter().zip(y.1).filter_map(|(x, y)| Some([(*x)?, (*y)?])).collect();
    let ends = |k: usize| {
        let all = || both.iter().map(|p| p[k]);
        let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
        [low, if high > low { high } else { low + 1e-9 }]
    };
    let (ex, ey) = (ends(0), ends(1));
    let cell = |v: f64, [low, high]: [f64; 2]| {
        (((v - low) / (high - low) * CELLS_PER_AXIS as f64) as usize).min(CELLS_PER_AXIS - 1)
    };
    let mut values = vec![vec![0.0; CELLS_PER_AXIS]; CELLS_PER_AXIS];
    both.iter().for_each(|[x, y]| values[cell(*y, ey)][cell(*x, ex)] += 1.0);
    let centres = |[low, high]: [f64; 2]| {
        let share = |i: usize| (i as f64 + 0.5) / CELLS_PER_AXIS as f64;
        (0..CELLS_PER_AXIS).map(|i| low + (high - low) * share(i)).collect::<Vec<f64>>()
    };
    Heatmap {
        x_label: plain_names(x.0),
        y_label: plain_names(y.0),
        x: centres(ex),
        y: centres(ey),
        values,
        value_label: "samples".into(),
        ..Heatmap::default()
    }
}
