//! The result of a job in a phrase, for lists: `friction 0.52 (0.48 to 0.56); fit good`.
//!
//! A phrase is made of the result alone, so it shows nothing that the result does not. Results of other versions may lack fields:
//! then the phrase is shorter, or there is none.

mod estimates;
mod number;

use serde_json::Value;

use estimates::{diagnosis, estimation, posterior};
use number::{AtMost, fixed};

/// A kind of job, and the phrase for its result.
type Row = (&'static str, fn(&Value) -> Option<String>);

/// Phrases by kind of job.
const SUMMARIES: [Row; 10] = [
    ("design", design),
    ("diagnose", diagnosis),
    ("evaluate", evaluation),
    ("iplw", estimation),
    ("learn", learning),
    ("likelihood", likelihood),
    ("plan", plan),
    ("posterior", posterior),
    ("surface", surface),
    ("train", training),
];

/// Maximum length of a phrase, characters.
const MAX_SUMMARY_CHARS: usize = 200;

/// The result of a job of this kind in a phrase.
pub fn summarize(kind: &str, result: &Value) -> Option<String> {
    let (_, phrase) = SUMMARIES.iter().find(|(name, _)| *name == kind)?;
    phrase(result).map(|text| AtMost(MAX_SUMMARY_CHARS, &text).to_string())
}

/// Kinds of jobs whose results have a phrase, sorted.
pub fn summarized_kinds() -> impl Iterator<Item = &'static str> {
    SUMMARIES.iter().map(|(kind, _)| *kind)
}

fn training(result: &Value) -> Option<String> {
    let rows = result["validation"].as_array().map_or(&[][..], Vec::as_slice);
    // The policy of the result may be an earlier one than the last.
    let of_policy = rows.iter().find(|row| !row["batches"].is_null() && row["batches"] == result["batches"]);
    if let Some(auccess) = of_policy.or(rows.last()).and_then(|row| row["auccess"].as_f64()) {
        return Some(format!("AUCCESS {} on validation", fixed(auccess, 2)));
    }
    let examples = result["examples"].as_u64()?;
    let batches = result["batches"].as_u64().or_else(|| Some(result["loss"].as_array()?.len() as u64))?;
    Some(format!("{batches} batches on {examples} examples"))
}

fn learning(result: &Value) -> Option<String> {
    let (attempts, solving) = (result["interactions"].as_u64()?, result["solving"].as_u64()?);
    Some(format!("{solving} of {attempts} attempts solved their task"))
}

fn evaluation(result: &Value) -> Option<String> {
    let auccess = format!("AUCCESS {}", fixed(result["auccess"].as_f64()?, 2));
    let Some(tasks) = result["tasks"].as_array().filter(|tasks| !tasks.is_empty()) else {
        return Some(auccess);
    };
    let solved = tasks.iter().filter(|task| !task["solved_at"].is_null()).count();
    Some(format!("{auccess}, {solved} of {} tasks solved", tasks.len()))
}

fn plan(result: &Value) -> Option<String> {
    let actions = result["actions"].as_array()?;
    let Some(best) = actions.first() else { return Some("no action can be placed".into()) };
    let probability = best["probability"].as_f64().or(best["share"].as_f64())?;
    Some(format!("best action solves with probability {}", fixed(probability, 2)))
}

fn design(result: &Value) -> Option<String> {
    let gain = |row: &Value| row["information"].as_f64();
    let Some(best) = result["experiments"].as_array()?.iter().filter_map(gain).reduce(f64::max) else {
        return Some("no experiment adds information".into());
    };
    Some(format!("best experiment {} nats", fixed(best, 1)))
}

fn surface(result: &Value) -> Option<String> {
    let rows = result["sensitivities"].as_array()?.iter();
    let stakes = rows.filter_map(|row| Some((row["factor"].as_str()?, row["stake"].as_f64()?)));
    let (factor, stake) = stakes.reduce(|best, row| if row.1 > best.1 { row } else { best })?;
    Some(if stake > 0.0 { format!("{factor} matters most") } else { "no latent matters".into() })
}

fn likelihood(result: &Value) -> Option<String> {
    let count = result["parameters"].as_array()?.len();
    Some(format!("{count} parameter{}, ready to be evaluated", if count == 1 { "" } else { "s" }))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn summarizes_each_kind() {
        let validation = json!([{"batches": 50, "auccess": 0.844}, {"batches": 100, "auccess": 0.7}]);
        let solved = json!([{"solved_at": 1}, {"solved_at": null}, {"solved_at": 100}]);
        let rows = [
            (
                "train",
                json!({"batches": 50, "examples": 9, "validation": validation}),
                "AUCCESS 0.84 on validation",
            ),
            ("train", json!({"validation": validation}), "AUCCESS 0.70 on validation"),
            (
                "train",
                json!({"batches": 50, "examples": 900, "validation": []}),
                "50 batches on 900 examples",
            ),
            ("train", json!({"loss": [0.5, 0.4], "examples": 900}), "2 batches on 900 examples"),
            ("learn", json!({"interactions": 30, "solving": 12}), "12 of 30 attempts solved their task"),
            ("evaluate", json!({"auccess": 0.881, "tasks": solved}), "AUCCESS 0.88, 2 of 3 tasks solved"),
            ("evaluate", json!({"auccess": 1}), "AUCCESS 1.00"),
            (
                "plan",
                json!({"actions": [{"probability": 0.93, "share": 0.9}, {"probability": 0.95}]}),
                "best action solves with probability 0.93",
            ),
            (
                "plan",
                json!({"actions": [{"probability": null, "share": 0.5}]}),
                "best action solves with probability 0.50",
            ),
            ("plan", json!({"actions": []}), "no action can be placed"),
            (
                "design",
                json!({"experiments": [{"information": 1.75}, {"information": 0.2}]}),
                "best experiment 1.8 nats",
            ),
            ("design", json!({"experiments": []}), "no experiment adds information"),
            (
                "surface",
                json!({"sensitivities": [
                    {"factor": "density", "stake": 0.1}, {"factor": "friction", "stake": 0.2}, {"factor": "x"},
                ]}),
                "friction matters most",
            ),
            ("surface", json!({"sensitivities": [{"factor": "density", "stake": 0.0}]}), "no latent matters"),
            ("likelihood", json!({"parameters": [1, 2]}), "2 parameters, ready to be evaluated"),
        ];
        for (kind, result, expected) in rows {
            assert_eq!(summarize(kind, &result).as_deref(), Some(expected), "{kind} {result}");
        }
    }

    #[test]
    fn tolerates_results_of_any_form() {
        let long = json!({"sensitivities": [{"factor": "é".repeat(999), "stake": 1}]});
        assert_eq!(summarize("surface", &long).unwrap().chars().count(), MAX_SUMMARY_CHARS);
        let forms = [json!(null), json!(1), json!("a"), json!([]), json!({}), json!([{"latents": 1}])];
        for kind in summarized_kinds().chain(["knitting"]) {
            for result in &forms {
                assert_eq!(summarize(kind, result), None, "{kind} {result}");
            }
        }
    }
}
