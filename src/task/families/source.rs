//! Where a family's candidates are from: drawn and filled into a template, or listed in a file.

use super::draw::{Draws, Recipe};
use super::listed::{Listed, NUMBER};
use super::template::Template;
use crate::error::{Error, Result};
use crate::task::{Scene, ValidAction, custom};

/// A family's candidates.
#[derive(Debug)]
pub enum Source {
    /// Numbers that are drawn, and the scene that they go into.
    Drawn { recipe: Recipe, template: Template },
    /// Scenes.
    Listed(Listed),
}

impl Source {
    /// Names of a draw's numbers, in order.
    pub fn parameters(&self) -> Vec<&str> {
        match self {
            Source::Drawn { recipe, .. } => recipe.parameters.iter().map(|p| p.name.as_str()).collect(),
            Source::Listed(_) => vec![NUMBER],
        }
    }

    /// What must hold of a draw, in order.
    pub fn requirements(&self) -> Vec<&str> {
        match self {
            Source::Drawn { recipe, .. } => recipe.require.iter().map(|(text, _)| text.as_str()).collect(),
            Source::Listed(_) => Vec::new(),
        }
    }

    /// The numbers of the candidates for a seed; those that are listed, in their order whatever the seed.
    pub fn draws(&self, family: &str, seed: u64) -> Result<Draws> {
        match self {
            Source::Drawn { recipe, .. } => recipe.draws(family, seed),
            Source::Listed(listed) => Ok(listed.draws()),
        }
    }

    /// The scene of a draw, with goal and action space; `name` is its name if it says none.
    pub fn scene(&self, name: &str, draw: &[f64]) -> Result<Scene> {
        match self {
            Source::Drawn { recipe, template } => {
                let values = recipe.complete(draw).ok_or_else(|| {
                    let allowed = "expressions that have one";
                    Error::input("candidates.values", "without a finite number", allowed)
                })?;
                let scene = template.fill(name, &values)?;
                custom(scene).map(|task| task.scene).map_err(|e| e.under("scene"))
            }
            Source::Listed(listed) => listed.at(draw).map(|given| given.scene.clone()),
        }
    }

    /// Actions that are said to solve a draw's scene.
    pub fn solutions(&self, draw: &[f64]) -> &[ValidAction] {
        match self {
            Source::Drawn { .. } => &[],
            Source::Listed(listed) => listed.at(draw).map_or(&[], |given| &given.solutions),
        }
    }
}
