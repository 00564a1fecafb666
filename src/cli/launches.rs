//! Plots of what a diagnosis says launch by launch: sizes of effects, and whether launches are as the others predict.

use iplw::discover::report::{Diagnosis, FoundParameter, Launch, LaunchSize, Predictive};
use iplw::distribution::NORMAL_95;
use iplw::picture::plot::{Series, lines, scatter_with};

use super::evidence::Plot;

/// A plot for every amplitude of the reported model.
pub fn sizes(d: &Diagnosis) -> Vec<Plot> {
    let amplitudes = d.effects.iter().flat_map(|e| {
        let mut names: Vec<&str> = e.parameters.iter().map(|p| p.name.as_str()).collect();
        names.dedup();
        names.into_iter().map(move |name| (e, name))
    });
    let drawn = amplitudes.filter_map(|(effect, name)| {
        let of =
            |l: &'_ Launch| l.sizes.iter().find(|s| s.effect == effect.name && s.parameter == name).cloned();
        let told: Vec<(&Launch, LaunchSize)> = d.launches.iter().filter_map(|l| Some((l, of(l)?))).collect();
        let parameter = effect.parameters.iter().find(|p| p.name == name)?;
        let pooled = |l: &Launch| {
            effect
                .parameters
                .iter()
                .find(|p| p.name == name && (p.setting.is_none() || p.setting == l.setting))
        };
        (!told.is_empty()).then(|| size(&effect.name, parameter, &told, &pooled))
    });
    drawn.collect()
}

fn size<'a>(
    effect: &str,
    parameter: &FoundParameter,
    told: &[(&Launch, LaunchSize)],
    pooled: &dyn Fn(&Launch) -> Option<&'a FoundParameter>,
) -> Plot {
    let name = &parameter.name;
    let around = |value: f64, by: f64| (value - by, value + by);
    let alone = told.iter().filter_map(|(l, s)| Some((l.trial as f64, s.alone?)));
    let alone: Vec<(f64, [f64; 2])> = alone.collect();
    let clouds = [
        Series {
            name: "the launch alone, 95 %".into(),
            points: alone.iter().map(|(at, [value, _])| (*at, *value)).collect(),
            band: Some(alone.iter().map(|(_, [value, sd])| around(*value, NORMAL_95 * sd)).collect()),
        },
        Series {
            name: "knowing the others, 95 %".into(),
            points: told.iter().map(|(l, s)| (l.trial as f64 + 0.3, s.value)).collect(),
            band: Some(told.iter().map(|(_, s)| around(s.value, NORMAL_95 * s.sd)).collect()),
        },
    ];
    let all: Vec<(f64, &FoundParameter)> =
        told.iter().filter_map(|(l, _)| Some((l.trial as f64, pooled(l)?))).collect();
    let mean = Series {
        name: "all launches, and one spread about it".into(),
        points: all.iter().map(|(at, p)| (*at, p.value)).collect(),
        band: Some(all.iter().map(|(_, p)| around(p.value, p.spread.unwrap_or(0.0))).collect()),
    };
    let title = format!("{effect}: {name} launch by launch");
    let caption = format!(
        "{title}. By itself a launch tells a size by least squares; knowing how sizes are spread among the others, by best linear \
         prediction"
    );
    let unit = if parameter.unit.is_empty() { name.clone() } else { format!("{name}, {}", parameter.unit) };
    let svg = scatter_with(&title, "trial", &unit, &clouds, &[mean]);
    (format!("size_{effect}_{name}"), caption, svg)
}

/// The probabilities of launches in order, beside where they are if predictions are right.
pub fn predictive(found: &Predictive) -> Plot {
    let n = found.sorted.len() as f64;
    let place = |k: usize| (k + 1) as f64 / (n + 1.0);
    let of = |pick: &dyn Fn(usize, &[f64; 3]) -> f64| -> Vec<(f64, f64)> {
        found.sorted.iter().enumerate().map(|(k, s)| (place(k), pick(k, s))).collect()
    };
    let launches = Series { name: "launches".into(), points: of(&|_, s| s[0]), band: None };
    let uniform = Series {
        name: "if predictions are right, 95 %".into(),
        points: of(&|k, _| place(k)),
        band: Some(found.sorted.iter().map(|[_, low, high]| (*low, *high)).collect()),
    };
    let title = "Launches as the others predict them";
    let (x, y) = ("share of launches", "probability of one further off");
    let caption = "Each launch's probability of one further off than it, in order. Below the band: launches further off than \
                   predicted; a flat middle: launches more alike than predictions allow for";
    let plot = match found.sorted.len() {
        0 | 1 => lines(title, x, y, &[]),
        _ => scatter_with(title, x, y, &[launches], &[uniform]),
    };
    ("predictive".into(), caption.into(), plot)
}

/// The check in a sentence or two.
pub fn checked(found: &Predictive) -> String {
    let n = found.launches.len();
    let outside = (found.outside_share * n as f64).round();
    let further = match &found.further_off[..] {
        [] => "none is further off than predicted".to_string(),
        some => {
            let trials: Vec<String> = some.iter().map(|t| t.to_string()).collect();
            format!("further off than predicted: {}", trials.join(", "))
        }
    };
    format!(
        "Each launch beside what the others predict of it: {outside} of {n} are outside the 95 % range, where {:.1} are expected; \
         {further}. The usual launch is {:.2} times as far off as predicted.",
        0.05 * n as f64,
        found.usual_ratio
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_outside_is_counted_and_named() {
        let found = Predictive {
            launches: Vec::new(),
            outside_share: 0.0,
            further_off: vec![7, 2],
            usual_ratio: 1.234,
            uniform_p: 0.5,
            sorted: vec![[0.01, 0.0, 0.7], [0.5, 0.1, 0.9]],
        };
        let text = checked(&found);
        assert!(text.contains("further off than predicted: 7, 2.") && text.contains("1.23 times"), "{text}");
        let (name, _, svg) = predictive(&found);
        assert!(name == "predictive" && svg.contains("<svg"));
        assert!(checked(&Predictive { further_off: Vec::new(), ..found }).contains("none is further off"));
    }
}
