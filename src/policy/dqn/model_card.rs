//! Model card: metadata of a weights file.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::fit::{MAX_UNITS, TrainConfig};
use crate::error::{Error, Result};
use crate::json;

/// Metadata of the weights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelCard {
    /// Always [`FORMAT`].
    pub format: String,
    /// Version of the program that trained the weights.
    pub program: String,
    /// Family of the tasks, or a custom task's id. Several families are joined by `+`.
    pub family: String,
    /// Dimensions of the scene and action features.
    pub dimensions: [usize; 2],
    /// Configurations of all trainings, in order.
    pub trained: Vec<TrainConfig>,
}

/// Value of [`ModelCard::format`]; raised when the features change.
pub const FORMAT: &str = "iplw.policy/2";

impl ModelCard {
    /// Total number of updates.
    pub fn batches(&self) -> usize {
        self.trained.iter().map(|t| t.batches).sum()
    }

    /// Reads and checks a card.
    pub(super) fn parse(text: &str) -> Result<ModelCard> {
        let value: Value = json::parse(text)?;
        let format = value.get("format").unwrap_or(&Value::Null);
        if format != FORMAT {
            let allowed =
                format!("{FORMAT:?}: a policy of another version has other features; train it again");
            return Err(Error::input("format", format, allowed));
        }
        let card: ModelCard = json::from_value(value)?;
        card.validate()?;
        Ok(card)
    }

    fn validate(&self) -> Result<()> {
        if self.dimensions.iter().any(|d| !(1..=MAX_UNITS).contains(d)) {
            let allowed = format!("two whole numbers from 1 to {MAX_UNITS}");
            return Err(Error::input("dimensions", format!("{:?}", self.dimensions), allowed));
        }
        if self.trained.is_empty() {
            return Err(Error::input("trained", "[]", "the configuration of at least one training"));
        }
        for (i, config) in self.trained.iter().enumerate() {
            config.validate().map_err(|e| e.in_field(&format!("trained[{i}]")))?;
        }
        Ok(())
    }
}
