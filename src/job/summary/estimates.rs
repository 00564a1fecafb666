//! Phrases of results with parameters.

use serde_json::Value;

use super::number::{decimals_of, fixed, plain, with_decimals, with_interval};

/// Most parameters or effects of a phrase.
const MAX_ITEMS: usize = 4;

/// Identifiable latents and fitted effects with 95 % intervals, and whether the simulation can reproduce the trials.
pub fn estimation(result: &Value) -> Option<String> {
    let rows = [&result["latents"], &result["effects"]].into_iter().filter_map(Value::as_array).flatten();
    let estimates = rows.filter(|row| row["identifiable"] == true).filter_map(|row| {
        Some(format!("{} {}", name(row)?, with_interval(row["value"].as_f64()?, interval(row))))
    });
    let fit = match result["fit"]["adequate"].as_bool() {
        Some(true) => "; fit good",
        Some(false) => "; fit bad",
        None => "",
    };
    result["latents"].as_array()?;
    Some(joined(estimates, ", ").unwrap_or_else(|| "no latent identifiable".into()) + fit)
}

/// The effects that the simulation lacks.
pub fn diagnosis(result: &Value) -> Option<String> {
    match result["verdict"].as_str()? {
        "none" => Some("nothing missing".into()),
        "named" => joined(result["effects"].as_array()?.iter().filter_map(effect), "; ")
            .map(|effects| format!("lacks {effects}")),
        "ambiguous" => {
            let rivals = result["rivals"].as_array()?;
            let names = joined(rivals.iter().filter_map(set_of_effects), "; ")?;
            Some(format!("{} candidates: {names}", rivals.len()))
        }
        "unknown" => Some("a discrepancy that no known effect explains".into()),
        "insufficient_data" => Some("too little data to tell".into()),
        _ => None,
    }
}

/// Identifiable parameters with standard deviations, and whether the draws converged.
pub fn posterior(result: &Value) -> Option<String> {
    let rows = result["parameters"].as_array()?.iter().filter(|row| row["identifiable"] == true);
    let estimates = rows.filter_map(|row| {
        let (mean, sd) = (row["mean"].as_f64()?, row["sd"].as_f64()?);
        let setting = row["setting"].as_str().map(|setting| format!(" ({setting})")).unwrap_or_default();
        let digits = decimals_of(sd).unwrap_or(2);
        Some(format!("{}{setting} {} ± {}", name(row)?, fixed(mean, digits), fixed(sd, digits)))
    });
    let text = joined(estimates, ", ").unwrap_or_else(|| "no parameter identifiable".into());
    Some(match result["converged"].as_bool() {
        Some(true) => text + "; converged",
        Some(false) => text + "; not converged",
        None => text,
    })
}

/// `quadratic drag, k = 0.20 1/m`.
fn effect(effect: &Value) -> Option<String> {
    let parameters = effect["parameters"].as_array().into_iter().flatten().filter_map(|row| {
        let value = row["value"].as_f64()?;
        let unit = row["unit"].as_str().filter(|unit| !unit.is_empty() && *unit != "1");
        let setting = row["setting"].as_str().map(|setting| format!(" ({setting})")).unwrap_or_default();
        let unit = unit.map(|unit| format!(" {unit}")).unwrap_or_default();
        let ends = interval(row);
        let text = if ends == [None, None] { plain(value) } else { with_decimals(value, ends) };
        Some(format!("{} = {text}{unit}{setting}", row["name"].as_str()?))
    });
    let name = name(effect)?;
    Some(joined(parameters, ", ").map_or(name.clone(), |parameters| format!("{name}, {parameters}")))
}

/// `wind + linear drag`; a set without effects is `nothing`.
fn set_of_effects(set: &Value) -> Option<String> {
    let names: Vec<String> = set.as_array()?.iter().filter_map(Value::as_str).map(words).collect();
    Some(if names.is_empty() { "nothing".into() } else { names.join(" + ") })
}

fn name(row: &Value) -> Option<String> {
    row["name"].as_str().map(words)
}

/// `quadratic_drag.k` as `quadratic drag k`.
fn words(identifier: &str) -> String {
    identifier.replace(['_', '.'], " ")
}

fn interval(row: &Value) -> [Option<f64>; 2] {
    [0, 1].map(|i| row["ci95"][i].as_f64())
}

/// The first items, and how many more there are; `None` without items.
fn joined(items: impl Iterator<Item = String>, separator: &str) -> Option<String> {
    let all: Vec<String> = items.collect();
    let first = all[..all.len().min(MAX_ITEMS)].join(separator);
    match all.len().saturating_sub(MAX_ITEMS) {
        0 => (!all.is_empty()).then_some(first),
        more => Some(format!("{first}{separator}{more} more")),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn latent(name: &str, value: f64, ends: Value, identifiable: bool) -> Value {
        json!({"name": name, "value": value, "ci95": ends, "identifiable": identifiable})
    }

    #[test]
    fn estimations_name_what_is_identifiable() {
        let latents = json!([
            latent("density", 1.0, json!([null, null]), false),
            latent("friction", 0.52, json!([0.48, 0.56]), true),
            latent("restitution", 0.8, json!([0.79, 0.83]), true),
        ]);
        let drag = json!([latent("linear_drag.c", 0.8, json!([0.7, null]), true)]);
        let of = |fit: Value| estimation(&json!({"latents": latents, "effects": [], "fit": fit})).unwrap();
        let estimates = "friction 0.52 (0.48 to 0.56), restitution 0.80 (0.79 to 0.83)";
        assert_eq!(of(json!({"adequate": true})), format!("{estimates}; fit good"));
        assert_eq!(of(json!({"adequate": false})), format!("{estimates}; fit bad"));
        assert_eq!(of(json!({"adequate": null})), estimates);
        assert_eq!(of(json!(null)), estimates);
        let fitted = estimation(&json!({"latents": [], "effects": drag})).unwrap();
        assert_eq!(fitted, "linear drag c 0.80 (above 0.70)");
        assert_eq!(estimation(&json!({"latents": []})).unwrap(), "no latent identifiable");
    }

    #[test]
    fn diagnoses_follow_the_verdict() {
        let parameter = |name: &str, value: f64, unit: &str, setting: Value| json!({"name": name, "value": value, "ci95": [0.9 * value, 1.1 * value], "unit": unit, "setting": setting});
        let drag = json!({"name": "quadratic_drag", "parameters": [parameter("k", 0.2, "1/m", json!(null))]});
        let wind = json!({"name": "wind", "parameters": [
            parameter("vx", 1.04, "m/s", json!("fan on")), parameter("share", 0.5, "1", json!(null)),
        ]});
        let named = |effects: &[&Value]| diagnosis(&json!({"verdict": "named", "effects": effects}));
        assert_eq!(named(&[&drag]).unwrap(), "lacks quadratic drag, k = 0.20 1/m");
        let both = "lacks quadratic drag, k = 0.20 1/m; wind, vx = 1.04 m/s (fan on), share = 0.50";
        assert_eq!(named(&[&drag, &wind]).unwrap(), both);
        assert_eq!(named(&[&json!({"name": "lag"})]).unwrap(), "lacks lag");
        assert_eq!(named(&[]), None);
        let rivals = json!({"verdict": "ambiguous", "rivals": [["wind", "linear_drag"], []]});
        assert_eq!(diagnosis(&rivals).unwrap(), "2 candidates: wind + linear drag; nothing");
        let many = json!({"verdict": "ambiguous", "rivals": [["a"], ["b"], ["c"], ["d"], ["e"], ["f"]]});
        assert_eq!(diagnosis(&many).unwrap(), "6 candidates: a; b; c; d; 2 more");
        assert_eq!(diagnosis(&json!({"verdict": "none"})).unwrap(), "nothing missing");
        for verdict in ["unknown", "insufficient_data"] {
            assert!(diagnosis(&json!({"verdict": verdict})).is_some());
        }
        assert_eq!(diagnosis(&json!({"verdict": "new"})), None);
    }

    #[test]
    fn posteriors_show_deviations() {
        let row = |name: &str, mean: f64, sd: f64, identifiable: bool| json!({"name": name, "mean": mean, "sd": sd, "identifiable": identifiable});
        let rows = json!([
            row("friction", 0.5212, 0.021, true),
            row("restitution", 0.8, 0.3, false),
            row("wind.vx", -1.26, 0.15, true),
        ]);
        let of = |converged: Value| posterior(&json!({"parameters": rows, "converged": converged})).unwrap();
        assert_eq!(of(json!(true)), "friction 0.52 ± 0.02, wind vx -1.3 ± 0.1; converged");
        assert_eq!(of(json!(false)), "friction 0.52 ± 0.02, wind vx -1.3 ± 0.1; not converged");
        assert_eq!(posterior(&json!({"parameters": []})).unwrap(), "no parameter identifiable");
    }
}
