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
        let names: BTreeSet<&str> = TOOLS.iter().map(|t| t.name).collect();
        assert_eq!(names.len(), TOOLS.len());
        for tool in TOOLS.iter() {
            assert!(tool.name.bytes().all(|b| b.is_ascii_lowercase() || b == b'_'), "{}", tool.name);
            assert!(tool.about.len() > 80 && tool.about.len() < 1200, "{}", tool.name);
            assert_eq!(tool.input_schema["additionalProperties"], false, "{}", tool.name);
            for (name, schema) in tool.input_schema["properties"].as_object().unwrap() {
                assert!(
                    schema["description"].as_str().is_some_and(|d| d.len() > 10),
                    "{}: {name}",
                    tool.name
                );
            }
            assert_eq!(tool.output_schema["type"], "object", "{}", tool.name);
            for schema in [&tool.input_schema, &tool.output_schema] {
                let text = serde_json::to_string(schema).unwrap();
                assert!(!text.contains("\"format\":\"") && !text.contains("\\n"), "{}: {text}", tool.name);
            }
        }
    }
}
