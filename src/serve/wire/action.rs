//! Actions on the wire: a vector, or the index of a discrete action.

use std::fmt;

use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;

use crate::session::Action;

/// An action vector (each component from 0 to 1), or the index of a discrete action.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[schema(example = json!([0.5, 0.5, 0.2]))]
#[serde(untagged)]
pub enum ActionIn {
    Vector(Vec<f64>),
    Index(u64),
}

impl From<ActionIn> for Action {
    fn from(action: ActionIn) -> Action {
        match action {
            ActionIn::Vector(values) => Action::Vector(values),
            ActionIn::Index(index) => Action::Index(index),
        }
    }
}

impl<'de> Deserialize<'de> for ActionIn {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        // Not derived: the errors of an untagged enum name neither the position nor the allowed values.
        deserializer.deserialize_any(ActionVisitor)
    }
}

struct ActionVisitor;

impl<'de> Visitor<'de> for ActionVisitor {
    type Value = ActionIn;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("an array of numbers from 0 to 1, or the index of a discrete action")
    }

    fn visit_u64<E>(self, index: u64) -> std::result::Result<ActionIn, E> {
        Ok(ActionIn::Index(index))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> std::result::Result<ActionIn, A::Error> {
        let mut values = Vec::with_capacity(seq.size_hint().unwrap_or(4).min(16));
        while let Some(v) = seq.next_element()? {
            values.push(v);
        }
        Ok(ActionIn::Vector(values))
    }
}
