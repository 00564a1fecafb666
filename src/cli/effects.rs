//! `iplw effects`: what a world may have beyond gravity and contact.

use iplw::error::Result;
use iplw::world::effect::{Effect, REGISTRY, find};
use serde_json::{Value, json};

use super::output;

/// What scenes take in `effects` and `iplw measure` in `--effect`: each effect's equation, and its parameters
/// with units, bounds and the value at which it vanishes.
#[derive(clap::Args)]
pub struct Args {
    /// One effect; all if absent.
    name: Option<String>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<()> {
    let effects: Vec<&Effect> = match &args.name {
        Some(name) => vec![find(name)?],
        None => REGISTRY.to_vec(),
    };
    if args.json {
        let all: Vec<Value> = effects.iter().map(|e| describe(e)).collect();
        let document = if args.name.is_some() { all[0].clone() } else { json!({"effects": all}) };
        return output::print(&format!("{document:#}\n"));
    }
    let mut text = String::new();
    for e in effects {
        text += &format!("{} ({}): {}\n", e.name, e.acts_on().name(), e.equation);
        for p in e.parameters {
            let [low, high] = p.bounds;
            text += &format!("    {:<7} {:<6} from {low} to {high}; none at {}\n", p.name, p.unit, p.neutral);
        }
    }
    output::print(&text)
}

fn describe(e: &Effect) -> Value {
    json!({
        "name": e.name,
        "acts_on": e.acts_on().name(),
        "equation": e.equation,
        "parameters": e.parameters.iter().map(|p| json!({
            "name": p.name, "unit": p.unit, "bounds": p.bounds, "neutral": p.neutral,
        })).collect::<Vec<_>>(),
    })
}
