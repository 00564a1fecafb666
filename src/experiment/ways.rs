//! Ways to choose what is spent on the real world, by name: a strategy of `explore`, or an experiment that decides a question.
//!
//! | way | each interaction is |
//! |---|---|
//! | `probing` | the one expected to tell most of latents and effects' parameters (environment probing: Zhou et al. 2019) |
//! | `success` | the one expected to tell most of whether what is planned solves the tasks |
//! | a strategy of `explore` | as that strategy ranks it on the simulation at the estimate |

use crate::design::Question;
use crate::error::{Error, Result};
use crate::explore;

/// Ways that ask a question, and which.
pub const ASKING: [(&str, Question); 2] = [("probing", Question::Latents), ("success", Question::Success)];

/// The question that a way asks; `None` for a strategy of `explore`. Errors unless there is such a way.
pub fn question(name: &str) -> Result<Option<Question>> {
    if let Some((_, question)) = ASKING.into_iter().find(|(own, _)| *own == name) {
        return Ok(Some(question));
    }
    explore::strategy(name).map(|_| None).map_err(|error| match error {
        Error::NotFound { kind, id, mut known } => {
            known.extend(ASKING.map(|(name, _)| name.to_string()));
            Error::NotFound { kind, id, known }
        }
        other => other,
    })
}

/// Whether a way needs a performance surface. Errors unless there is such a way.
pub fn needs_importance(name: &str) -> Result<bool> {
    match question(name)? {
        Some(_) => Ok(false),
        None => Ok(explore::strategy(name)?.needs_importance()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_are_known_by_name() {
        assert_eq!(question("success").unwrap(), Some(Question::Success));
        assert_eq!(question("mixed").unwrap(), None);
        assert!(needs_importance("gradient").unwrap() && !needs_importance("probing").unwrap());
        let error = question("praying").unwrap_err().to_string();
        assert!(error.contains("mixed") && error.contains("success"), "{error}");
    }
}
