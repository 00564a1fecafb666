//! Plots of a diagnosis by trial: parameter estimates and predictive p-values.

use iplw::distribution::NORMAL_95;
use iplw::inference::report::{
    Diagnosis, ParameterEstimate, PredictiveCheck, TrialEffectEstimate, TrialEffects,
};
use iplw::picture::plot::{Series, lines, scatter_with};

use super::residual_plots::PlotFile;

/// One plot of estimates for every amplitude of the reported model.
pub fn estimate_figures(d: &Diagnosis) -> Vec<PlotFile> {
    let amplitudes = d.effects.iter().flat_map(|e| {
        let mut names: Vec<&str> = e.parameters.iter().map(|p| p.name.as_str()).collect();
        names.dedup();
        names.into_iter().map(move |name| (e, name))
    });
    let drawn = amplitudes.filter_map(|(effect, name)| {
        let of = |l: &'_ TrialEffects| {
            l.sizes.iter().find(|s| s.effect == effect.name && s.parameter == name).cloned()
        };
        let estimates: Vec<(&TrialEffects, TrialEffectEstimate)> =
            d.launches.iter().filter_map(|l| Some((l, of(l)?))).collect();
        let parameter = effect.parameters.iter().find(|p| p.name == name)?;
        let pooled = |l: &TrialEffects| {
            effect
                .parameters
                .iter()
                .find(|p| p.name == name && (p.setting.is_none() || p.setting == l.setting))
        };
        (!estimates.is_empty()).then(|| estimate_figure(&effect.name, parameter, &estimates, &pooled))
    });
    drawn.collect()
}

fn estimate_figure<'a>(
    effect: &str,
    parameter: &ParameterEstimate,
    estimates: &[(&TrialEffects, TrialEffectEstimate)],
    pooled: &dyn Fn(&TrialEffects) -> Option<&'a ParameterEstimate>,
) -> PlotFile {
    let name = &parameter.name;
    let around = |value: f64, by: f64| (value - by, value + by);
    let alone = estimates.iter().filter_map(|(l, s)| Some((l.trial as f64, s.alone?)));
    let alone: Vec<(f64, [f64; 2])> = alone.collect();
    let clouds = [
        Series {
            name: "least squares of the trial, 95 %".into(),
            points: alone.iter().map(|(at, [value, _])| (*at, *value)).collect(),
            band: Some(alone.iter().map(|(_, [value, sd])| around(*value, NORMAL_95 * sd)).collect()),
        },
        Series {
            name: "mixed model (BLUP), 95 %".into(),
            points: estimates.iter().map(|(l, s)| (l.trial as f64 + 0.3, s.value)).collect(),
            band: Some(estimates.iter().map(|(_, s)| around(s.value, NORMAL_95 * s.sd)).collect()),
        },
    ];
    let pooled_estimates: Vec<(f64, &ParameterEstimate)> =
        estimates.iter().filter_map(|(l, _)| Some((l.trial as f64, pooled(l)?))).collect();
    let mean = Series {
        name: "mean of all trials, +- one sd between trials".into(),
        points: pooled_estimates.iter().map(|(at, p)| (*at, p.value)).collect(),
        band: Some(pooled_estimates.iter().map(|(_, p)| around(p.value, p.spread.unwrap_or(0.0))).collect()),
    };
    let title = format!("{effect}: {name} by trial");
    let caption = format!(
        "{title}: least-squares estimate of each trial, and best linear unbiased prediction given the variation between trials"
    );
    let unit = if parameter.unit.is_empty() { name.clone() } else { format!("{name}, {}", parameter.unit) };
    let svg = scatter_with(&title, "trial", &unit, &clouds, &[mean]);
    (format!("size_{effect}_{name}"), caption, svg)
}

/// Sorted predictive p-values of the trials, with their expected range.
pub fn predictive_figure(found: &PredictiveCheck) -> PlotFile {
    let n = found.sorted.len() as f64;
    let place = |k: usize| (k + 1) as f64 / (n + 1.0);
    let of = |pick: &dyn Fn(usize, &[f64; 3]) -> f64| -> Vec<(f64, f64)> {
        found.sorted.iter().enumerate().map(|(k, s)| (place(k), pick(k, s))).collect()
    };
    let launches = Series { name: "trials".into(), points: of(&|_, s| s[0]), band: None };
    let uniform = Series {
        name: "expected, 95 %".into(),
        points: of(&|k, _| place(k)),
        band: Some(found.sorted.iter().map(|[_, low, high]| (*low, *high)).collect()),
    };
    let title = "Cross-validated predictive p-values";
    let (x, y) = ("share of trials", "p-value");
    let caption = "p-values of the trials, sorted. Points below the band: outliers. A flat curve: predictions too cautious.";
    let plot = match found.sorted.len() {
        0 | 1 => lines(title, x, y, &[]),
        _ => scatter_with(title, x, y, &[launches], &[uniform]),
    };
    ("predictive".into(), caption.into(), plot)
}

/// The predictive check in words.
pub fn predictive_summary(found: &PredictiveCheck) -> String {
    let n = found.launches.len();
    let outside = (found.outside_share * n as f64).round();
    let further = match &found.further_off[..] {
        [] => "there are no outliers".to_string(),
        some => {
            let trials: Vec<String> = some.iter().map(|t| t.to_string()).collect();
            format!("outliers: {}", trials.join(", "))
        }
    };
    format!(
        "Each trial compared with its prediction from the others: {outside} of {n} are outside the 95 % range, {:.1} are expected; \
         {further}. The median error is {:.2} times the predicted one.",
        0.05 * n as f64,
        found.usual_ratio
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_names_outliers() {
        let found = PredictiveCheck {
            launches: Vec::new(),
            outside_share: 0.0,
            further_off: vec![7, 2],
            usual_ratio: 1.234,
            uniform_p: 0.5,
            sorted: vec![[0.01, 0.0, 0.7], [0.5, 0.1, 0.9]],
        };
        let text = predictive_summary(&found);
        assert!(text.contains("outliers: 7, 2.") && text.contains("1.23 times"), "{text}");
        let (name, _, svg) = predictive_figure(&found);
        assert!(name == "predictive" && svg.contains("<svg"));
        assert!(
            predictive_summary(&PredictiveCheck { further_off: Vec::new(), ..found })
                .contains("there are no outliers")
        );
    }
}
