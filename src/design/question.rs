//! What is asked, and which draws of a belief answer it alike.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// A question about the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Question {
    /// How large latents and effects' parameters are.
    Latents,
    /// Which of the belief's sets of effects the world has.
    Effects,
    /// Whether what is planned for some tasks solves them.
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

    /// What it is called.
    pub fn name(&self) -> &'static str {
        match self {
            Question::Latents => "latents",
            Question::Effects => "effects",
            Question::Success => "success",
        }
    }
}
