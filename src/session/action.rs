//! Unvalidated client actions.

use crate::error::{Error, Result};
use crate::task::{ActionSpace, ValidAction};

/// A client's action, not yet validated against an action space.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Components in [0, 1].
    Vector(Vec<f64>),
    /// Index of a discrete action.
    Index(u64),
}

impl Action {
    /// Validates the action in `space`; errors name `field`.
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

/// Error for an action that cannot be placed in the scene.
pub(super) fn unplaceable(action: &Action, reason: &str) -> Error {
    let value = match action {
        Action::Vector(values) => format!("{values:?}"),
        Action::Index(index) => index.to_string(),
    };
    Error::input("action", value, format!("an action that can be placed ({reason})"))
}
