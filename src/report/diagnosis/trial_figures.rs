//! Figures by trial: the overlay of two trials, estimates, and predictive p-values.

use super::document::DiagnosisDocument;
use super::figure::ReportFigure;
use super::trials::ReportedTrials;
use crate::distribution::NORMAL_95;
use crate::inference::report::{
    EffectEstimate, ParameterEstimate, TrialEffectEstimate, TrialEffects, TrialResiduals,
};
use crate::number::unit;
use crate::picture::plot::{PANEL_SIZE_PX, Series, XyPlot, panels};
use crate::picture::theme::Meaning;
use crate::picture::{OverlayPanel, overlay_svg};
use crate::report::words::plain_names;

/// Trajectories of the trials with the median and the largest error.
pub fn overlay(document: &DiagnosisDocument, trials: &ReportedTrials) -> Option<ReportFigure> {
    let panel = |(role, trial): &(&str, &TrialResiduals)| {
        let trajectory = trials.trajectory(trial);
        let extended = if document.is_extended() { trajectory.simulated(1) } else { Vec::new() };
        OverlayPanel {
            title: format!("{role}: {}", trials.name(trial.trial)),
            simulated: trajectory.simulated(0),
            extended,
            measured: trajectory.measured,
        }
    };
    let examples = trials.examples();
    (!examples.is_empty()).then(|| ReportFigure {
        name: "overlay",
        caption: "The trials with the median and the largest error before. The start of each simulation is fitted to the whole trial, so that an \
                  error shows at both ends."
            .into(),
        svg: overlay_svg(&document.extended_scene, &examples.iter().map(panel).collect::<Vec<_>>()),
    })
}

/// One panel of estimates for every amplitude of the reported model.
pub fn estimates(document: &DiagnosisDocument, trials: &ReportedTrials) -> Option<ReportFigure> {
    let d = &document.diagnosis;
    let amplitudes = d.effects.iter().flat_map(|e| {
        let mut names: Vec<&str> = e.parameters.iter().map(|p| p.name.as_str()).collect();
        names.dedup();
        names.into_iter().map(move |name| (e, name))
    });
    let panel = |(effect, name): (&EffectEstimate, &str)| {
        let of = |l: &TrialEffects| {
            l.sizes.iter().find(|s| s.effect == effect.name && s.parameter == name).cloned()
        };
        let estimates: Vec<(&TrialEffects, TrialEffectEstimate)> =
            d.launches.iter().filter_map(|l| Some((l, of(l)?))).collect();
        let first = effect.parameters.iter().find(|p| p.name == name)?;
        (!estimates.is_empty()).then(|| estimate_panel(effect, first, &estimates))
    };
    let plots: Vec<String> = amplitudes.filter_map(panel).collect();
    let names = d.launches.iter().map(|l| trials.name(l.trial)).collect::<Vec<_>>().join(", ");
    (!plots.is_empty()).then(|| ReportFigure {
        name: "estimates",
        caption: format!(
            "Every parameter as each trial alone gives it, with 95 % intervals, and as the model with variation between trials predicts it. \
             The line is the value of all trials, the band one standard deviation between trials. From left to right: {names}."
        ),
        svg: panels("Estimates by trial", &plots, 2),
    })
}

fn estimate_panel(
    effect: &EffectEstimate,
    parameter: &ParameterEstimate,
    estimates: &[(&TrialEffects, TrialEffectEstimate)],
) -> String {
    let around = |value: f64, by: f64| (value - by, value + by);
    let place = |i: usize| (i + 1) as f64;
    let alone: Vec<(f64, [f64; 2])> =
        estimates.iter().enumerate().filter_map(|(i, (_, s))| Some((place(i), s.alone?))).collect();
    let mixed = estimates.iter().enumerate().map(|(i, (_, s))| (place(i) + 0.3, s));
    let points = vec![
        Series {
            name: "this trial alone".into(),
            points: alone.iter().map(|(at, [value, _])| (*at, *value)).collect(),
            band: Some(alone.iter().map(|(_, [value, sd])| around(*value, NORMAL_95 * sd)).collect()),
            meaning: Some(Meaning::Measured),
        },
        Series {
            name: "given all trials".into(),
            points: mixed.clone().map(|(at, s)| (at, s.value)).collect(),
            band: Some(mixed.map(|(_, s)| around(s.value, NORMAL_95 * s.sd)).collect()),
            meaning: Some(Meaning::Extended),
        },
    ];
    let pooled = |l: &TrialEffects| {
        let own = effect.parameters.iter().filter(|p| p.name == parameter.name);
        own.into_iter().find(|p| p.setting.is_none() || p.setting == l.setting)
    };
    let pooled: Vec<(f64, &ParameterEstimate)> =
        estimates.iter().enumerate().filter_map(|(i, (l, _))| Some((place(i), pooled(l)?))).collect();
    let mean = Series {
        name: "all trials".into(),
        points: pooled.iter().map(|(at, p)| (*at, p.value)).collect(),
        band: Some(pooled.iter().map(|(_, p)| around(p.value, p.spread.unwrap_or(0.0))).collect()),
        meaning: Some(Meaning::Extended),
    };
    let of = unit(&parameter.unit);
    let plot = XyPlot {
        title: format!("{}: {}", plain_names(&effect.name), parameter.name),
        x_label: "trial".into(),
        y_label: if of.is_empty() { parameter.name.clone() } else { format!("{}, {of}", parameter.name) },
        points,
        curves: vec![mean],
        size: PANEL_SIZE_PX,
    };
    plot.svg()
}

/// Sorted predictive p-values of the trials with their expected range, and the correlation of residuals.
pub fn predictive_check(document: &DiagnosisDocument) -> Option<ReportFigure> {
    let check = document.diagnosis.predictive.as_ref().filter(|p| p.sorted.len() > 1)?;
    let place = |k: usize| (k + 1) as f64 / (check.sorted.len() as f64 + 1.0);
    let values = check.sorted.iter().enumerate().map(|(k, s)| (place(k), s[0]));
    let expected = Series {
        name: "expected, 95 %".into(),
        points: (0..check.sorted.len()).map(|k| (place(k), place(k))).collect(),
        band: Some(check.sorted.iter().map(|[_, low, high]| (*low, *high)).collect()),
        meaning: Some(Meaning::Extended),
    };
    let p_values = XyPlot {
        title: "Trials against their predictions".into(),
        x_label: "share of trials".into(),
        y_label: "p-value".into(),
        points: vec![Series {
            name: "trials".into(),
            points: values.collect(),
            meaning: Some(Meaning::Measured),
            ..Series::default()
        }],
        curves: vec![expected],
        size: PANEL_SIZE_PX,
    };
    let by_lag = |name: &str, values: &[f64], meaning: Meaning| Series {
        name: name.into(),
        points: values.iter().enumerate().map(|(lag, v)| (lag as f64, *v)).collect(),
        meaning: Some(meaning),
        ..Series::default()
    };
    let [before, after] = &document.evidence.autocorrelation;
    let correlation = XyPlot {
        title: "Correlation of residuals".into(),
        x_label: "distance, observations".into(),
        y_label: "correlation".into(),
        points: Vec::new(),
        curves: vec![
            by_lag("simulation before", before, Meaning::Simulated),
            by_lag("extended simulation", after, Meaning::Extended),
        ],
        size: PANEL_SIZE_PX,
    };
    Some(ReportFigure {
        name: "predictive_check",
        caption: "Left: p-value of each trial given its prediction from the others, sorted. Points below the band are outliers; a flat curve \
                  means that predictions are too cautious. Right: correlation of residuals along a trial; noise has none beyond 0."
            .into(),
        svg: panels("Trials against their predictions", &[p_values.svg(), correlation.svg()], 2),
    })
}
