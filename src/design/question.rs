//! Questions that an experiment can answer.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

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

impl Question {
    /// The question called `name`.
    pub fn from_name(name: &str) -> Result<Question> {
        let all = [Question::Latents, Question::Effects, Question::Success];
        all.into_iter()
            .find(|q| q.name() == name)
            .ok_or_else(|| Error::input("question", format!("{name:?}"), "latents, effects or success"))
    }

    /// The question's name.
    pub fn name(&self) -> &'static str {
        match self {
            Question::Latents => "latents",
            Question::Effects => "effects",
            Question::Success => "success",
        }
    }
}
