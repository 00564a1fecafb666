//! Data-collection methods by name: a strategy of `explore`, or an optimal design for a question.
//!
//! | method | selected action |
//! |---|---|
//! | `probing` | highest expected information about latents and effect parameters (environment probing: Zhou et al. 2019) |
//! | `success` | highest expected information about whether planned actions solve the tasks |
//! | a strategy of `explore` | best rank by that strategy in the simulation at the estimate |

use crate::design::Question;
use crate::error::{Error, Result};
use crate::explore;

/// Design methods with their questions.
pub const DESIGN_METHODS: [(&str, Question); 2] =
    [("probing", Question::Latents), ("success", Question::Success)];

/// The question of a design method; `None` for a strategy of `explore`. Errors if the method does not exist.
pub fn question(name: &str) -> Result<Option<Question>> {
    if let Some((_, question)) = DESIGN_METHODS.into_iter().find(|(own, _)| *own == name) {
        return Ok(Some(question));
    }
    explore::strategy(name).map(|_| None).map_err(|error| match error {
        Error::NotFound { kind, id, mut known } => {
            known.extend(DESIGN_METHODS.map(|(name, _)| name.to_string()));
            Error::NotFound { kind, id, known }
        }
        other => other,
    })
}

/// Whether a method needs a performance surface. Errors if the method does not exist.
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
    fn finds_methods_by_name() {
        assert_eq!(question("success").unwrap(), Some(Question::Success));
        assert_eq!(question("mixed").unwrap(), None);
        assert!(needs_importance("gradient").unwrap() && !needs_importance("probing").unwrap());
        let error = question("praying").unwrap_err().to_string();
        assert!(error.contains("mixed") && error.contains("success"), "{error}");
    }
}
