//! Candidates listed in a JSON Lines file: a scene on each line, or a scene with known solutions.

use serde::Deserialize;
use serde_json::Value;

use super::candidate_sampler::CandidateDraws;
use crate::error::{Error, Result};
use crate::json;
use crate::task::{Scene, ValidAction, custom};

/// The candidates of a family that are listed instead of sampled.
#[derive(Debug)]
pub struct SceneList {
    /// At least one, in the order of the file, all with the same action space.
    scenes: Vec<ListedCandidate>,
}

/// One listed candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct ListedCandidate {
    /// The validated scene, with goal and action space.
    pub scene: Scene,
    /// Solutions that the author of the scene provided.
    pub solutions: Vec<ValidAction>,
}

/// Parameter name of a scene's index.
pub const SCENE_INDEX: &str = "scene";
/// Maximum number of scenes.
const MAX_SCENES: usize = 10_000;
/// Maximum number of solutions per scene.
const MAX_SOLUTIONS: usize = 1000;

/// A line with more than a scene.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CandidateLine {
    scene: Value,
    #[serde(default)]
    solutions: Vec<Vec<f64>>,
}

impl SceneList {
    /// Parses a file; blank lines are skipped. Errors name line, field and value.
    pub fn parse(file: &str, text: &str) -> Result<SceneList> {
        let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let read = |(i, line): (usize, &str)| {
            parse_candidate(line).map(|g| (i, g)).map_err(|e| e.in_file(format!("{file}, line {}", i + 1)))
        };
        let found: Vec<(usize, ListedCandidate)> =
            lines.take(MAX_SCENES + 1).map(read).collect::<Result<_>>()?;
        if !(1..=MAX_SCENES).contains(&found.len()) {
            let value =
                if found.is_empty() { "no scene".into() } else { format!("more than {MAX_SCENES} scenes") };
            return Err(
                Error::input("", value, format!("1 to {MAX_SCENES} scenes, one per line")).in_file(file)
            );
        }
        let first = &found[0].1.scene;
        if let Some((i, _)) = found.iter().find(|(_, g)| g.scene.action != first.action) {
            let value = format!("different from that of line {}", found[0].0 + 1);
            let error = Error::input("action", value, "the same action space in all scenes of a family");
            return Err(error.in_file(format!("{file}, line {}", i + 1)));
        }
        Ok(SceneList { scenes: found.into_iter().map(|(_, given)| given).collect() })
    }

    /// All candidates, in the order of the file.
    pub fn draws(&self) -> CandidateDraws {
        let candidates: Vec<Vec<f64>> = (0..self.scenes.len()).map(|i| vec![i as f64]).collect();
        CandidateDraws { evaluated: candidates.len(), candidates, undefined: 0, unmet: Vec::new() }
    }

    /// The candidate of a draw.
    pub fn at(&self, draw: &[f64]) -> Result<&ListedCandidate> {
        let number = draw.first().copied().unwrap_or(f64::NAN);
        let found = self.scenes.get(number as usize).filter(|_| number >= 0.0);
        found.ok_or_else(|| {
            Error::input(SCENE_INDEX, number, format!("the index of a scene, below {}", self.scenes.len()))
        })
    }
}

fn parse_candidate(line: &str) -> Result<ListedCandidate> {
    let value: Value = json::parse(line)?;
    let whole = value.get("scene").is_some();
    let CandidateLine { scene, solutions } =
        if whole { json::from_value(value)? } else { CandidateLine { scene: value, solutions: Vec::new() } };
    let scene: Scene =
        if whole { json::from_value(scene).map_err(|e| e.in_field("scene"))? } else { json::parse(line)? };
    let scene = custom(scene).map_err(|e| if whole { e.in_field("scene") } else { e })?.scene;
    if solutions.len() > MAX_SOLUTIONS {
        let allowed = format!("at most {MAX_SOLUTIONS} actions");
        return Err(Error::input("solutions", format!("{} actions", solutions.len()), allowed));
    }
    let space = scene.action.as_ref().expect("a task's scene has an action space");
    let read = solutions.iter().enumerate();
    let read = read.map(|(i, a)| space.validate(a).map_err(|e| e.in_field(&format!("solutions[{i}]"))));
    let solutions = read.collect::<Result<_>>()?;
    Ok(ListedCandidate { scene, solutions })
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
        let listed = SceneList::parse("f.jsonl", &text).unwrap();
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
            let error = SceneList::parse("f.jsonl", &format!("{scene}\n{line}")).unwrap_err().to_string();
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
        let error = SceneList::parse("f.jsonl", "\n").unwrap_err().to_string();
        assert!(error.contains("no scene"), "{error}");
    }
}
