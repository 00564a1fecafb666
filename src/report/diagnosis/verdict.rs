//! The verdict in a sentence, the laws found as formulas, the error beside the noise, and the probabilities.

use super::document::DiagnosisDocument;
use crate::inference::report::{Diagnosis, EffectEstimate, ParameterEstimate, Verdict};
use crate::number::{digits, interval, length, percent, significant, superscripts, unit, with_unit};
use crate::picture::report::{Block, ShareBar, Tone};
use crate::report::words::{plain_names, sentence, set_name};
use crate::world::effect::{self, EffectTarget};

/// m/s^2
const STANDARD_GRAVITY: f64 = 9.80665;
/// Ratio of the error to the noise up to which it counts as down to the noise, and up to which it counts as near to it.
const DOWN_TO_NOISE: f64 = 1.1;
const NEAR_NOISE: f64 = 2.0;
/// Maximum number of effects with a probability bar.
const MAX_BARS: usize = 4;
/// Maximum number of values beside a formula; the table of effects has all.
const MAX_VALUES: usize = 4;

/// The verdict as a sentence.
pub fn title(d: &Diagnosis) -> String {
    match d.verdict {
        Verdict::None => "The simulation explains these trials: nothing is missing".into(),
        Verdict::InsufficientData => "The data do not suffice for a diagnosis".into(),
        Verdict::Unknown => "Something is missing that no law of the library explains".into(),
        Verdict::Ambiguous => {
            let sets = d.rivals.iter().map(|r| set_name(r)).collect::<Vec<_>>().join("; ");
            format!("Something is missing, and these trials do not tell which: {sets}")
        }
        Verdict::Named => {
            let names: Vec<String> = d.effects.iter().map(|e| common_name(&e.name)).collect();
            let count = match names.len() {
                1 => "one thing",
                2 => "two things",
                _ => "several things",
            };
            let is_sensor = |e: &EffectEstimate| {
                effect::find(&e.name).is_ok_and(|known| known.target() == EffectTarget::Sensor)
            };
            let subject = if d.effects.iter().all(is_sensor) { "recording" } else { "simulation" };
            format!("The {subject} gets {count} wrong: {}", names.join(" and "))
        }
    }
}

/// The summaries of the effects; for other verdicts the reason.
pub fn explanation(d: &Diagnosis) -> String {
    let summary = |e: &EffectEstimate| {
        let summary = effect::find(&e.name).ok()?.summary;
        let (_, text) = summary.split_once(": ").unwrap_or(("", summary));
        Some(sentence(text))
    };
    match d.verdict {
        Verdict::Named => d.effects.iter().filter_map(summary).collect::<Vec<_>>().join(" "),
        _ => {
            // The rest of the reason repeats figures that have their own place.
            let figures = d.remainder.as_ref().map_or("", |r| r.text.as_str());
            let (reason, _) = d.reason.split_once(&format!("; {figures}")).unwrap_or((&d.reason, ""));
            sentence(&plain_names(reason))
        }
    }
}

/// The laws of the reported effects with their parameters and their typical size, and the empirical law.
pub fn laws(document: &DiagnosisDocument) -> Vec<Block> {
    let d = &document.diagnosis;
    let law = |e: &EffectEstimate| {
        let equation = effect::find(&e.name).map_or(String::new(), |known| formula(known.equation));
        Block::Law { formula: equation, values: values(e) }
    };
    // For other verdicts the effects are the nearest at best.
    let effects = match d.verdict {
        Verdict::Named | Verdict::Ambiguous => &d.effects[..],
        _ => &[],
    };
    let symbols = (effects.iter().any(|e| e.acts_on == "motion"))
        .then(|| format!("a: acceleration of the body, v: its velocity.{}", typical_size(document)));
    let offered = d.residual_law.as_ref().filter(|l| l.offered);
    let empirical = offered.map(|l| match l.formula.contains('=') {
        true => Block::Law { formula: formula(&l.formula), values: vec!["empirical".into()] },
        false => {
            Block::Caption(sentence(&format!("empirical law: {}", plain_names(&superscripts(&l.formula)))))
        }
    });
    effects.iter().map(law).chain(symbols.map(Block::Caption)).chain(empirical).collect()
}

/// The median acceleration that the extension adds, in words.
fn typical_size(document: &DiagnosisDocument) -> String {
    let mut sizes = document.evidence.pushes.lengths(["found_ax", "found_ay"]);
    sizes.retain(|v| *v > 0.0);
    sizes.sort_by(f64::total_cmp);
    match sizes.get(sizes.len() / 2) {
        Some(median) => format!(
            " In these trials the effect adds {} m/s\u{b2} (median), {} times standard gravity.",
            significant(*median, 2),
            significant(median / STANDARD_GRAVITY, 2)
        ),
        None => String::new(),
    }
}

/// The error of predictions before and after, with the noise and a judgement.
pub fn error(d: &Diagnosis) -> Option<Block> {
    let (value, label, error, noise) = match (&d.gain.held_out, &d.residual) {
        (Some(g), _) if !d.effects.is_empty() && d.verdict != Verdict::None => (
            format!("{} \u{2192} {}", length(g.base_rmse), length(g.extended_rmse)),
            format!(
                "root mean square error of a coordinate before and after, in trials that were left out of the fit ({} in turn); the measurement noise \
                 alone gives {}",
                g.trials,
                length(g.floor_rmse)
            ),
            g.extended_rmse,
            g.floor_rmse,
        ),
        (_, Some(r)) => (
            length(r.base_rmse),
            format!(
                "root mean square error of a simulated coordinate; the measurement noise alone gives {}",
                length(r.floor_rmse)
            ),
            r.base_rmse,
            r.floor_rmse,
        ),
        _ => return None,
    };
    let ratio = error / noise.max(f64::MIN_POSITIVE);
    let (judgement, tone) = match ratio {
        r if r <= DOWN_TO_NOISE => ("down to the measurement noise".to_string(), Tone::Good),
        r if r <= NEAR_NOISE => (format!("{} times the measurement noise", significant(r, 2)), Tone::Warn),
        r => (format!("{} times the measurement noise", significant(r, 2)), Tone::Bad),
    };
    let stat = Block::Stat { value, label, judgement, tone };
    Some(Block::card("Error", vec![stat]))
}

/// Probabilities of effects, most probable first.
pub fn probabilities(d: &Diagnosis) -> Option<Block> {
    let mut names: Vec<&String> = d.scores.iter().flat_map(|s| &s.effects).collect();
    names.sort_unstable();
    names.dedup();
    let reported = |name: &str| d.effects.iter().find(|e| e.name == name);
    let probability = |name: &str| {
        let sets = d.scores.iter().filter(|s| s.effects.iter().any(|e| e == name));
        reported(name).map_or_else(|| sets.map(|s| s.probability).sum(), |e| e.probability)
    };
    let mut all: Vec<(f64, &String)> = names.into_iter().map(|name| (probability(name), name)).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    all.truncate(MAX_BARS);
    let bar = |(p, name): &(f64, &String)| ShareBar {
        name: plain_names(name),
        share: *p,
        text: percent(*p),
        chosen: reported(name).is_some() && d.verdict != Verdict::None,
    };
    let mut bars: Vec<ShareBar> = all.iter().map(bar).collect();
    let nothing = d.scores.iter().find(|s| s.effects.is_empty()).map(|s| s.probability);
    if let Some(p) = nothing.filter(|_| !d.scores.is_empty()) {
        let chosen = d.verdict == Verdict::None;
        bars.push(ShareBar { name: "nothing missing".into(), share: p, text: percent(p), chosen });
    }
    let count = format!(
        "Effects can act together, so that these add up to more than 100 %. {} sets of effects were compared.",
        d.scores.len()
    );
    let blocks = vec![Block::Bars(bars), Block::Caption(count)];
    (d.scores.len() > 1).then(|| Block::card("Probability that an effect acts", blocks))
}

/// The name of an effect, and in brackets the one that most people know.
fn common_name(name: &str) -> String {
    let alias = effect::find(name).ok().and_then(|e| e.aliases.first().copied());
    match alias {
        Some(alias) => format!("{} ({})", plain_names(name), plain_names(alias)),
        None => plain_names(name),
    }
}

/// A law as readers write it.
fn formula(equation: &str) -> String {
    let numbers = equation.split(' ').map(|word| match word.split_once('e') {
        Some((mantissa, power)) if mantissa.parse::<f64>().is_ok() && power.parse::<i32>().is_ok() => {
            significant(word.parse().unwrap_or(f64::NAN), 3)
        }
        _ => superscripts(word),
    });
    numbers.collect::<Vec<_>>().join(" ").replace('-', "\u{2212}").replace(" pi ", " \u{3c0} ")
}

/// Parameters with intervals.
fn values(e: &EffectEstimate) -> Vec<String> {
    let value = |p: &ParameterEstimate| {
        let setting = p.setting.as_ref().map(|s| format!(" of {s}")).unwrap_or_default();
        let range = match p.ci95 {
            [Some(_), Some(_)] => format!(" (95 %: {})", interval(&p.ci95, &p.unit)),
            _ => String::new(),
        };
        format!("{}{setting} = {}{range}", p.name, with_unit(p.value, &p.unit))
    };
    if e.parameters.len() <= MAX_VALUES {
        return e.parameters.iter().map(value).collect();
    }
    let mut names: Vec<&str> = e.parameters.iter().map(|p| p.name.as_str()).collect();
    names.dedup();
    let range = |name: &str| {
        let own: Vec<&ParameterEstimate> = e.parameters.iter().filter(|p| p.name == name).collect();
        let end = |of: fn(f64, f64) -> f64| own.iter().map(|p| p.value).reduce(of).unwrap_or(f64::NAN);
        let (low, high, of) = (end(f64::min), end(f64::max), unit(&own[0].unit));
        format!("{name} from {} to {} {of} in {} settings", digits(low), digits(high), own.len())
    };
    names.into_iter().map(range).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::diagnosis::document::tests::named;

    #[test]
    fn effects_have_their_common_names_and_formulas() {
        assert_eq!(common_name("linear_drag"), "linear drag (stokes drag)");
        assert_eq!(common_name("unknown"), "unknown");
        assert_eq!(formula("a = -k |v|^2"), "a = \u{2212}k |v|\u{b2}");
        assert_eq!(formula("ax = -7.74e-4 x"), "ax = \u{2212}0.000774 x");
    }

    /// Errors of the recording are not blamed on the simulation.
    #[test]
    fn sensor_effects_are_errors_of_the_recording() {
        let mut d = named().diagnosis;
        d.effects[0].name = "time_scale".into();
        assert_eq!(title(&d), "The recording gets one thing wrong: time scale");
    }

    #[test]
    fn error_is_judged_by_the_noise() {
        let mut d = named().diagnosis;
        let judgement = |d: &Diagnosis| match error(d) {
            Some(Block::Card { blocks, .. }) => match &blocks[0] {
                Block::Stat { judgement, tone, .. } => (judgement.clone(), *tone),
                other => panic!("{other:?}"),
            },
            other => panic!("{other:?}"),
        };
        assert_eq!(judgement(&d), ("down to the measurement noise".into(), Tone::Good));
        d.gain.held_out.as_mut().unwrap().extended_rmse = 0.003;
        assert_eq!(judgement(&d), ("3 times the measurement noise".into(), Tone::Bad));
    }
}
