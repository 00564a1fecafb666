//! Scenes listed in a file beside a family's, a candidate a line: a scene, or a scene with actions that are said to solve it.

use serde::Deserialize;
use serde_json::Value;

use super::draw::Draws;
use crate::error::{Error, Result};
use crate::json;
use crate::task::{Scene, ValidAction, custom};

/// A family's candidates, where they are not drawn.
#[derive(Debug)]
pub struct Listed {
    /// At least one, in the order of the file, all with the same action space.
    scenes: Vec<Given>,
}

/// One of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Given {
    /// The scene, with goal and action space: validated.
    pub scene: Scene,
    /// Actions that whoever wrote it says solve it.
    pub solutions: Vec<ValidAction>,
}

/// What the number of a scene is called where candidates' numbers are.
pub const NUMBER: &str = "scene";
/// Most scenes.
const MOST: usize = 10_000;
/// Most actions of each.
const MOST_SOLUTIONS: usize = 1000;

/// A line that is more than a scene.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    scene: Value,
    #[serde(default)]
    solutions: Vec<Vec<f64>>,
}

impl Listed {
    /// Reads the lines of a file; empty ones are passed over. Errors name line, field and value.
    pub fn parse(file: &str, text: &str) -> Result<Listed> {
        let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let read = |(i, line): (usize, &str)| {
            given(line).map(|g| (i, g)).map_err(|e| e.at(format!("{file}, line {}", i + 1)))
        };
        let found: Vec<(usize, Given)> = lines.take(MOST + 1).map(read).collect::<Result<_>>()?;
        if !(1..=MOST).contains(&found.len()) {
            let value = if found.is_empty() { "no scene".into() } else { format!("more than {MOST} scenes") };
            return Err(Error::input("", value, format!("1 to {MOST} scenes, one a line")).at(file));
        }
        let first = &found[0].1.scene;
        if let Some((i, _)) = found.iter().find(|(_, g)| g.scene.action != first.action) {
            let value = format!("another than that of line {}", found[0].0 + 1);
            let error = Error::input("action", value, "the same action space in all scenes of a family");
            return Err(error.at(format!("{file}, line {}", i + 1)));
        }
        Ok(Listed { scenes: found.into_iter().map(|(_, given)| given).collect() })
    }

    /// All, in the order of the file.
    pub fn draws(&self) -> Draws {
        let candidates: Vec<Vec<f64>> = (0..self.scenes.len()).map(|i| vec![i as f64]).collect();
        Draws { tried: candidates.len(), candidates, undefined: 0, unmet: Vec::new() }
    }

    /// The one of a draw.
    pub fn at(&self, draw: &[f64]) -> Result<&Given> {
        let number = draw.first().copied().unwrap_or(f64::NAN);
        let found = self.scenes.get(number as usize).filter(|_| number >= 0.0);
        found.ok_or_else(|| {
            Error::input(NUMBER, number, format!("a number below {} of a scene", self.scenes.len()))
        })
    }
}

fn given(line: &str) -> Result<Given> {
    let value: Value = json::parse(line)?;
    let whole = value.get("scene").is_some();
    let Line { scene, solutions } =
        if whole { json::from_value(value)? } else { Line { scene: value, solutions: Vec::new() } };
    let scene: Scene =
        if whole { json::from_value(scene).map_err(|e| e.under("scene"))? } else { json::parse(line)? };
    let scene = custom(scene).map_err(|e| if whole { e.under("scene") } else { e })?.scene;
    if solutions.len() > MOST_SOLUTIONS {
        let allowed = format!("at most {MOST_SOLUTIONS} actions");
        return Err(Error::input("solutions", format!("{} actions", solutions.len()), allowed));
    }
    let space = scene.action.as_ref().expect("a task's scene has an action space");
    let read = solutions.iter().enumerate();
    let read = read.map(|(i, a)| space.validate(a).map_err(|e| e.under(&format!("solutions[{i}]"))));
    let solutions = read.collect::<Result<_>>()?;
    Ok(Given { scene, solutions })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = r#"{"format": "iplw.scene/1",
        "bodies": [{"name": "red", "shape": {"type": "disc", "radius": 0.5}}],
        "statics": [{"name": "floor", "shape": {"type": "box", "half_width": 5, "half_height": 0.5}}],
        "goal": {"type": "contact", "bodies": ["red", "floor"]},
        "action": {"components": [{"target": "red", "set": "y", "low": 2, "high": 5}]}}"#;

    #[test]
    fn lines_are_scenes_with_and_without_solutions() {
        let scene = SCENE.replace('\n', " ");
        let text = format!("{scene}\n\n{{\"scene\": {scene}, \"solutions\": [[0.5], [1]]}}\n");
        let listed = Listed::parse("f.jsonl", &text).unwrap();
        assert_eq!(listed.draws().candidates, [[0.0], [1.0]]);
        assert_eq!(listed.at(&[0.0]).unwrap().solutions, []);
        assert_eq!(listed.at(&[1.0]).unwrap().solutions[1].values(), [1.0]);
        assert_eq!(listed.at(&[0.0]).unwrap().scene, listed.at(&[1.0]).unwrap().scene);
        assert!(listed.at(&[2.0]).is_err() && listed.at(&[-1.0]).is_err() && listed.at(&[]).is_err());
    }

    #[test]
    fn errors_name_line_field_and_value() {
        let scene = SCENE.replace('\n', " ");
        let check = |line: String, wanted: &[&str]| {
            let error = Listed::parse("f.jsonl", &format!("{scene}\n{line}")).unwrap_err().to_string();
            assert!(wanted.iter().all(|w| error.contains(w)), "{error}");
        };
        check("{".into(), &["f.jsonl, line 2"]);
        check(scene.replace("0.5}", "-0.5}"), &["line 2", "bodies[0].shape.radius", "-0.5"]);
        check(scene.replace("\"goal\"", "\"gaol\""), &["line 2", "gaol"]);
        check(scene.replace("\"low\": 2", "\"low\": 3"), &["line 2", "`action`", "line 1"]);
        check(
            format!("{{\"scene\": {scene}, \"solutions\": [[0.5], [1.5]]}}"),
            &["solutions[1].action[0]", "1.5"],
        );
        check(format!("{{\"scene\": {scene}, \"solution\": []}}"), &["line 2", "solution"]);
        let error = Listed::parse("f.jsonl", "\n").unwrap_err().to_string();
        assert!(error.contains("no scene"), "{error}");
    }
}
