//! The report of a diagnosis of joints: the verdict with its laws, measured and simulated positions, and the probabilities of effects.

use crate::inference::mechanism::{
    JointCurve, JointDiagnosis, JointEffectEstimate, JointParameterEstimate, JointSetScore,
};
use crate::inference::report::Verdict;
use crate::number::{percent, significant};
use crate::picture::HtmlReport;
use crate::picture::plot::{Series, XyPlot, panels};
use crate::picture::report::{Block, Section, ShareBar};
use crate::picture::theme::Meaning;
use crate::task::joint::{Joint, JointKind};

/// Number of sets of effects in the table.
const MAX_SETS: usize = 12;
/// Size of a plot, px.
const PLOT_SIZE: (u32, u32) = (640, 260);

/// The report.
pub fn report(d: &JointDiagnosis) -> HtmlReport {
    let laws = d.effects.iter().map(law);
    let facts = vec![
        Block::card("Probability that an effect acts", vec![Block::Bars(bars(d))]),
        Block::card("Held-out trials", vec![Block::Text(gain(d))]),
    ];
    let caption = format!(
        "Trial {}, in which the simulation is worst: it starts anew in every segment, from the state that fits best.",
        d.curves.trial
    );
    let picture = vec![Block::MotionLegend, Block::Svg { svg: figure(d), caption }];
    HtmlReport {
        title: title(d),
        kicker: format!(
            "Diagnosis of {}, {} trials in {} segments, seed {}, iplw {}",
            d.extended_scene.name, d.trials, d.segments, d.seed, d.version
        ),
        lead: d.reason.clone(),
        opening: laws.chain([Block::pictures_and_facts(picture, facts)]).collect(),
        sections: vec![
            Section::folded("Sets of effects", "log posterior of each", vec![sets(d)]),
            Section::folded("Noise", "standard deviation of measured positions", vec![noise(d)]),
        ],
    }
}

/// Measured and simulated positions of each joint, and what the simulations leave.
pub fn figure(d: &JointDiagnosis) -> String {
    let t = &d.curves.t;
    let series = |name: &str, values: Vec<f64>, meaning: Meaning| Series {
        name: name.into(),
        points: t.iter().copied().zip(values).collect(),
        band: None,
        meaning: Some(meaning),
    };
    let plot = |title: String, y_label: &str, points: Vec<Series>, curves: Vec<Series>| {
        let (x_label, y_label) = ("t (s)".to_string(), y_label.to_string());
        XyPlot { title, x_label, y_label, points, curves, size: PLOT_SIZE }.svg()
    };
    let plots: Vec<String> = d
        .curves
        .joints
        .iter()
        .flat_map(|own| {
            let less = |values: &[f64]| own.measured.iter().zip(values).map(|(m, v)| m - v).collect();
            let measured = series("measured", own.measured.clone(), Meaning::Measured);
            let mut positions = vec![series("simulation", own.simulated.clone(), Meaning::Simulated)];
            let mut residuals = vec![series("simulation", less(&own.simulated), Meaning::Simulated)];
            if let Some(extended) = &own.extended {
                positions.push(series("extended simulation", extended.clone(), Meaning::Extended));
                residuals.push(series("extended simulation", less(extended), Meaning::Extended));
            }
            let title = |of: &str| format!("{}: {of}", own.joint);
            [
                plot(title("position"), unit(d, &own.joint), vec![measured], positions),
                plot(title("measured minus simulated"), unit(d, &own.joint), Vec::new(), residuals),
            ]
        })
        .collect();
    panels("Joint positions", &plots, 1)
}

/// Unit of a joint's positions.
fn unit(d: &JointDiagnosis, joint: &str) -> &'static str {
    let slides = |j: &Joint| j.name == joint && j.kind == JointKind::Prismatic;
    if d.extended_scene.joints.iter().any(slides) { "m" } else { "rad" }
}

fn title(d: &JointDiagnosis) -> String {
    let name = |e: &JointEffectEstimate| format!("{} in {}", e.name.replace('_', " "), e.acts_on);
    let named = || d.effects.iter().map(name).collect::<Vec<_>>().join(" and ");
    match d.verdict {
        Verdict::None => "The simulation agrees with the recording".into(),
        Verdict::Named => format!("The simulation lacks {}", named()),
        Verdict::Ambiguous => format!("{} explanations are equally good", d.rivals.len()),
        Verdict::Unknown | Verdict::InsufficientData => {
            "The simulation lacks something that no effect in the library explains".into()
        }
    }
}

/// The law of an effect with its estimates.
fn law(e: &JointEffectEstimate) -> Block {
    let value = |p: &JointParameterEstimate| {
        let [low, high] = p.ci95.map(|v| significant(v, 3));
        format!("{} = {} {} (95 %: {low} to {high})", p.name, significant(p.value, 3), p.unit)
    };
    Block::Law { formula: e.equation.clone(), values: e.parameters.iter().map(value).collect() }
}

fn bars(d: &JointDiagnosis) -> Vec<ShareBar> {
    let bar = |(name, share): &(String, f64)| ShareBar {
        name: name.replace('_', " "),
        share: *share,
        text: percent(*share),
        chosen: d.rivals.first().is_some_and(|set| set.contains(name)),
    };
    let none = ShareBar {
        name: "nothing is missing".into(),
        share: d.none_probability,
        text: percent(d.none_probability),
        chosen: d.verdict == Verdict::None,
    };
    d.inclusion.iter().map(bar).chain([none]).collect()
}

fn gain(d: &JointDiagnosis) -> String {
    match d.held_out_gain {
        Some(gain) => format!(
            "The effects remove {} of the excess squared error on trials that were held out.",
            percent(gain)
        ),
        None => "Without a misfit beyond the noise there is nothing to remove.".into(),
    }
}

fn sets(d: &JointDiagnosis) -> Block {
    let row = |s: &JointSetScore| {
        let set = if s.effects.is_empty() { "none".into() } else { s.effects.join(" + ") };
        vec![set, significant(s.score, 3), percent(s.probability)]
    };
    Block::Table {
        columns: vec!["effects".into(), "log posterior (nats)".into(), "probability".into()],
        rows: d.scores.iter().take(MAX_SETS).map(row).collect(),
        note: format!("{} sets were fitted.", d.scores.len()),
    }
}

fn noise(d: &JointDiagnosis) -> Block {
    let row = |(own, sd): (&JointCurve, &f64)| {
        (own.joint.clone(), format!("{} {}", significant(*sd, 2), unit(d, &own.joint)))
    };
    Block::KeyValues(d.curves.joints.iter().zip(&d.noise).map(row).collect())
}
