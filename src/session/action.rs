//! Unvalidated client actions.

use std::fmt;

use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;

use crate::error::{Error, Result};
use crate::task::{ActionSpace, ValidAction};

/// An action vector (each component from 0 to 1), or the index of a discrete action.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[schema(example = json!([0.5, 0.5, 0.2]))]
#[serde(untagged)]
#[schema(as = ActionIn)]
pub enum Action {
    Vector(Vec<f64>),
    Index(u64),
}

impl Action {
    /// Validates the action in `space`; errors name `field`.
    pub fn resolve(&self, space: &ActionSpace, field: &str) -> Result<ValidAction> {
        let resolved = match self {
            Action::Vector(values) => space.validate(values),
            Action::Index(index) => space.at(usize::try_from(*index).unwrap_or(usize::MAX)),
        };
        resolved.map_err(|e| {
            e.map_input(|input| {
                input.field = format!("{field}{}", input.field.strip_prefix("action").unwrap_or_default());
            })
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

impl<'de> Deserialize<'de> for Action {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        // Not derived: the errors of an untagged enum name neither the position nor the allowed values.
        deserializer.deserialize_any(ActionVisitor)
    }
}

struct ActionVisitor;

impl<'de> Visitor<'de> for ActionVisitor {
    type Value = Action;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("an array of numbers from 0 to 1, or the index of a discrete action")
    }

    fn visit_u64<E>(self, index: u64) -> std::result::Result<Action, E> {
        Ok(Action::Index(index))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> std::result::Result<Action, A::Error> {
        let mut values = Vec::with_capacity(seq.size_hint().unwrap_or(4).min(16));
        while let Some(v) = seq.next_element()? {
            values.push(v);
        }
        Ok(Action::Vector(values))
    }
}
