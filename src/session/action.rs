//! An action as a client gives it.

use crate::error::{Error, Result};
use crate::task::{ActionSpace, ValidAction};

/// An action as a client gives it.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Components in [0, 1].
    Vector(Vec<f64>),
    /// Number of a discrete action.
    Index(u64),
}

impl Action {
    /// The action in `space`; `field` is what an error calls it.
    pub fn resolve(&self, space: &ActionSpace, field: &str) -> Result<ValidAction> {
        let resolved = match self {
            Action::Vector(values) => space.validate(values),
            Action::Index(index) => space.at(usize::try_from(*index).unwrap_or(usize::MAX)),
        };
        resolved.map_err(|e| match e {
            Error::Input(mut input) => {
                input.field = format!("{field}{}", input.field.strip_prefix("action").unwrap_or_default());
                Error::Input(input)
            }
            other => other,
        })
    }
}

/// The action has no place in the scene.
pub(super) fn unplaceable(action: &Action, reason: &str) -> Error {
    let value = match action {
        Action::Vector(values) => format!("{values:?}"),
        Action::Index(index) => index.to_string(),
    };
    Error::input("action", value, format!("an action that can be placed ({reason})"))
}
