//! Questions that an experiment can answer.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::names::names;

/// A question about the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Question {
    /// The values of latents and effect parameters.
    Latents,
    /// The set of effects that the world has, among those in the posterior.
    Effects,
    /// Whether planned actions solve their tasks.
    Success,
}

names!(Question: Latents = "latents", Effects = "effects", Success = "success");

impl Question {
    /// The question called `name`.
    pub fn from_name(name: &str) -> Result<Question> {
        let allowed = "latents, effects or success";
        Question::named(name).ok_or_else(|| Error::input("question", format!("{name:?}"), allowed))
    }
}
