//! `iplw effects`: the library of physical effects beyond gravity and contact.

use iplw::error::Result;
use iplw::world::effect::{Effect, EffectTarget, ParameterDeclaration, REGISTRY, find, find_alias};
use serde_json::{Value, json};

use super::output;

/// List physical effects, or describe one.
///
/// Lists the effects that scenes take in `effects` and `iplw measure` in --effect: equation, and parameters with units, bounds and neutral
/// values. With a name, describes one effect in full.
#[derive(clap::Args)]
pub struct Args {
    /// Effect to describe [default: list all]
    name: Option<String>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<()> {
    let text = match (&args.name, args.json) {
        (Some(name), true) => format!("{:#}\n", to_json(described(name)?)),
        (None, true) => {
            let all: Vec<Value> = REGISTRY.iter().map(|e| to_json(e)).collect();
            format!("{:#}\n", json!({ "effects": all }))
        }
        (Some(name), false) => description(described(name)?),
        (None, false) => REGISTRY.iter().map(|e| list_entry(e)).collect(),
    };
    output::print(&text)
}

/// The effect with this name or alias.
fn described(name: &str) -> Result<&'static Effect> {
    find_alias(name).map_or_else(|| find(name), Ok)
}

fn to_json(e: &Effect) -> Value {
    json!({
        "name": e.name,
        "acts_on": e.target().name(),
        "equation": e.equation,
        "parameters": e.parameters.iter().map(|p| json!({
            "name": p.name, "unit": p.unit, "bounds": p.bounds, "neutral": p.neutral,
        })).collect::<Vec<_>>(),
    })
}

/// An effect in the list: equation and parameters.
fn list_entry(e: &Effect) -> String {
    let mut text = format!("{} ({}): {}\n", e.name, e.target().name(), e.equation);
    for p in e.parameters {
        let [low, high] = p.bounds;
        text += &format!("    {:<7} {:<6} from {low} to {high}; none at {}\n", p.name, p.unit, p.neutral);
    }
    text
}

/// Full description of an effect: words, law, parameters, signature, and relations to other effects.
fn description(e: &Effect) -> String {
    let also = if e.aliases.is_empty() { String::new() } else { format!(" (also {})", e.aliases.join(", ")) };
    let summary = wrapped(e.summary, "");
    let mut text = format!("{}{also}\n\n{summary}\n\nLaw:\n  {}\n\nParameters:\n", e.name, e.equation);
    e.parameters.iter().for_each(|p| text += &parameter_line(p));
    text += &format!("\nActs on:\n  {}\n", target_in_words(e.target()));
    text += &format!("\nHow to recognise it:\n{}\n", wrapped(e.signature, "  "));
    let notes = notes(e);
    if !notes.is_empty() {
        text += "\nNotes:\n";
        notes.iter().for_each(|note| text += &format!("{}\n", wrapped(note, "  ")));
    }
    let neighbours = neighbours(e);
    if !neighbours.is_empty() {
        text += "\nSimilar effects:\n";
        neighbours.iter().for_each(|n| text += &format!("  {:<24} {}\n", n.name, n.summary));
    }
    text
}

fn parameter_line(p: &ParameterDeclaration) -> String {
    let [low, high] = p.bounds;
    let role = if p.is_amplitude() { "amplitude" } else { "shape" };
    let unit = if p.unit == "1" || p.unit.is_empty() { "(no unit)" } else { p.unit };
    format!(
        "  {:<8} {unit:<10} {role:<10} {low} to {high}; no effect at {}; typical deviation {}\n",
        p.name, p.neutral, p.typical_size
    )
}

fn target_in_words(target: EffectTarget) -> &'static str {
    match target {
        EffectTarget::Motion => "the motion of all bodies",
        EffectTarget::Contact => "contacts",
        EffectTarget::Body => "the masses and moments of inertia of bodies",
        EffectTarget::Region => "the motion of bodies within a region",
        EffectTarget::Sensor => "measurements, not the motion itself",
        EffectTarget::Action => "the placement of bodies by actions",
    }
}

/// Properties that matter for the diagnosis.
fn notes(e: &Effect) -> Vec<String> {
    let mut notes = Vec::new();
    if e.opposes_motion {
        notes.push("It always decelerates.".to_string());
    }
    if !e.between_trial_sd.is_empty() {
        let sd: Vec<String> = e.between_trial_sd.iter().map(f64::to_string).collect();
        notes.push(format!(
            "It may differ between trials, with a standard deviation of about {}.",
            sd.join(", ")
        ));
    }
    if e.reset_by_contact {
        notes.push("It may change at every contact.".to_string());
    }
    if let Some(check) = e.instrument_check {
        notes.push(format!("Check of the instrument: {check}."));
    }
    notes
}

/// Special cases of an effect, effects of which it is a special case, and others of which it shares a special case.
fn neighbours(e: &Effect) -> Vec<&'static Effect> {
    let shares = |other: &Effect| e.special_cases.iter().any(|c| other.has_special_case(c));
    let close = |other: &&&Effect| {
        other.name != e.name && (e.has_special_case(other) || other.has_special_case(e) || shares(other))
    };
    REGISTRY.iter().filter(|o| close(o)).copied().collect()
}

/// Wraps text at 100 characters, each line after `indent`.
fn wrapped(text: &str, indent: &str) -> String {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let line = lines.len() - 1;
        match lines[line].is_empty() {
            true => lines[line] += word,
            false if lines[line].len() + word.len() < 100 => lines[line] += &format!(" {word}"),
            false => lines.push(word.to_string()),
        }
    }
    lines.iter().map(|line| format!("{indent}{line}")).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn describes_every_effect_in_full() {
        for effect in REGISTRY {
            let text = description(effect);
            assert!(
                text.contains(effect.equation) && !effect.summary.is_empty() && !effect.signature.is_empty()
            );
            assert!(effect.parameters.iter().all(|p| text.contains(&format!("  {}", p.name))), "{text}");
        }
    }

    #[test]
    fn wraps_at_100_characters() {
        let text = wrapped(&"word ".repeat(50), "  ");
        assert!(text.lines().all(|line| line.len() <= 102) && text.lines().count() == 3, "{text}");
    }
}
