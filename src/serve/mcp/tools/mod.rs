//! Registry of the tools, one file each.

mod diagnose;
mod estimate;
mod list_tasks;
mod look;
mod measure;
mod propose;
mod roll_out;

use std::sync::LazyLock;

use super::tool::Tool;

/// One row per tool, in the order in which agents need them.
const TOOL_FACTORIES: [fn() -> Tool; 7] = [
    list_tasks::tool,
    look::tool,
    propose::tool,
    roll_out::tool,
    measure::tool,
    estimate::tool,
    diagnose::tool,
];

/// All tools.
pub static TOOLS: LazyLock<Vec<Tool>> = LazyLock::new(|| TOOL_FACTORIES.iter().map(|tool| tool()).collect());

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// Tool names are unique and valid, every argument is described, and unknown arguments are rejected.
    #[test]
    fn tools_are_described() {
        let names: BTreeSet<&str> = TOOLS.iter().map(|t| &*t.declaration.name).collect();
        assert_eq!(names.len(), TOOLS.len());
        for tool in TOOLS.iter().map(|t| &t.declaration) {
            assert!(tool.name.bytes().all(|b| b.is_ascii_lowercase() || b == b'_'), "{}", tool.name);
            let about = tool.description.as_deref().unwrap_or_default();
            assert!(about.len() > 80 && about.len() < 1200, "{}", tool.name);
            assert_eq!(tool.input_schema["additionalProperties"], false, "{}", tool.name);
            for (name, schema) in tool.input_schema["properties"].as_object().unwrap() {
                // Of an optional component, the reference is described.
                let described = schema["oneOf"].as_array().into_iter().flatten().chain([schema]);
                let mut texts = described.filter_map(|s| s["description"].as_str());
                assert!(texts.any(|text| text.len() > 10), "{}: {name}", tool.name);
            }
            let output_schema = tool.output_schema.as_ref().unwrap();
            assert_eq!(output_schema["type"], "object", "{}", tool.name);
            for schema in [&tool.input_schema, output_schema] {
                let text = serde_json::to_string(schema).unwrap();
                let foreign = ["\"format\":\"", "\\n", "#/components", "nullable"];
                assert!(!foreign.iter().any(|part| text.contains(part)), "{}: {text}", tool.name);
                for target in text.split("\"#/$defs/").skip(1).filter_map(|rest| rest.split('"').next()) {
                    assert!(schema["$defs"].get(target).is_some(), "{}: {target}", tool.name);
                }
            }
        }
    }
}
