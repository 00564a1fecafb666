//! The source of a family's candidates: sampled and filled into a template, or listed in a file.

use super::candidate_sampler::{CandidateDraws, CandidateSampler};
use super::scene_list::{SCENE_INDEX, SceneList};
use super::template::Template;
use crate::error::{Error, Result};
use crate::task::{Scene, ValidAction, custom};

/// The source of a family's candidates.
#[derive(Debug)]
pub enum CandidateSource {
    /// Sampled numbers, and the scene template that uses them.
    Drawn { recipe: CandidateSampler, template: Template },
    /// Listed scenes.
    Listed(SceneList),
}

impl CandidateSource {
    /// Names of a candidate's parameters, in order.
    pub fn parameters(&self) -> Vec<&str> {
        match self {
            CandidateSource::Drawn { recipe, .. } => {
                recipe.parameters.iter().map(|p| p.name.as_str()).collect()
            }
            CandidateSource::Listed(_) => vec![SCENE_INDEX],
        }
    }

    /// Texts of the requirements, in order.
    pub fn requirements(&self) -> Vec<&str> {
        match self {
            CandidateSource::Drawn { recipe, .. } => {
                recipe.require.iter().map(|(text, _)| text.as_str()).collect()
            }
            CandidateSource::Listed(_) => Vec::new(),
        }
    }

    /// The candidates for a seed; listed candidates do not depend on it.
    pub fn draws(&self, family: &str, seed: u64) -> Result<CandidateDraws> {
        match self {
            CandidateSource::Drawn { recipe, .. } => recipe.draws(family, seed),
            CandidateSource::Listed(listed) => Ok(listed.draws()),
        }
    }

    /// The scene of a candidate, with goal and action space; `name` is its default name.
    pub fn scene(&self, name: &str, draw: &[f64]) -> Result<Scene> {
        match self {
            CandidateSource::Drawn { recipe, template } => {
                let values = recipe.complete(draw).ok_or_else(|| {
                    let allowed = "expressions that have one";
                    Error::input("candidates.values", "without a finite number", allowed)
                })?;
                let scene = template.fill(name, &values)?;
                custom(scene).map(|task| task.scene).map_err(|e| e.in_field("scene"))
            }
            CandidateSource::Listed(listed) => listed.at(draw).map(|given| given.scene.clone()),
        }
    }

    /// Known solutions of a candidate's scene.
    pub fn solutions(&self, draw: &[f64]) -> &[ValidAction] {
        match self {
            CandidateSource::Drawn { .. } => &[],
            CandidateSource::Listed(listed) => listed.at(draw).map_or(&[], |given| &given.solutions),
        }
    }
}
