//! The report of any result: its settings and values as tables.

use serde_json::Value;

use super::words::sentence;
use crate::number::digits;
use crate::picture::{Block, HtmlReport, Section};

/// Maximum number of rows of a table, and maximum length of a text in it.
const MAX_ROWS: usize = 60;
const MAX_TEXT: usize = 200;

/// A report with the values of a result.
pub fn report(kind: &str, summary: Option<&str>, result: &Value) -> HtmlReport {
    let values = Block::KeyValues(rows(result));
    HtmlReport {
        title: summary.map_or_else(|| format!("Result: {kind}"), sentence),
        opening: vec![Block::card("Result", vec![values])],
        ..HtmlReport::default()
    }
}

/// The settings of a request as a folded section.
pub fn settings(config: &Value) -> Section {
    Section::folded("Settings", "the request", vec![Block::KeyValues(rows(config))])
}

/// Names and values of all scalars, those of nested objects under their path.
fn rows(value: &Value) -> Vec<(String, String)> {
    let mut out = Vec::new();
    flatten("", value, &mut out);
    out.truncate(MAX_ROWS);
    out
}

fn flatten(path: &str, value: &Value, out: &mut Vec<(String, String)>) {
    let text = match value {
        Value::Object(fields) => {
            for (name, value) in fields {
                let separator = if path.is_empty() { "" } else { ", " };
                flatten(&format!("{path}{separator}{}", name.replace('_', " ")), value, out);
            }
            return;
        }
        Value::Null => return,
        Value::Number(n) if n.is_f64() => digits(n.as_f64().unwrap_or(f64::NAN)),
        Value::Number(n) => n.to_string(),
        Value::String(text) => text.chars().take(MAX_TEXT).collect(),
        Value::Bool(yes) => (if *yes { "yes" } else { "no" }).into(),
        Value::Array(items) if items.is_empty() => return,
        Value::Array(items) if items.iter().all(|i| i.is_number() || i.is_string()) && items.len() <= 8 => {
            let item = |i: &Value| i.as_f64().map_or_else(|| i.as_str().unwrap_or_default().into(), digits);
            items.iter().map(item).collect::<Vec<_>>().join(", ")
        }
        Value::Array(items) => format!("{} entries", items.len()),
    };
    out.push((path.to_string(), text));
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn nested_values_become_rows() {
        let value = json!({"a_b": {"c": 1, "d": [0.5, 2]}, "e": null, "f": true, "g": [{}, {}], "h": []});
        let found: Vec<String> = rows(&value).into_iter().map(|(k, v)| format!("{k}: {v}")).collect();
        assert_eq!(found, ["a b, c: 1", "a b, d: 0.5, 2", "f: yes", "g: 2 entries"]);
    }
}
