//! What must be known to use a file of weights.

use serde::{Deserialize, Serialize};

use super::fit::{MOST_UNITS, TrainConfig};
use crate::error::{Error, Result};
use crate::policy::view::View;

/// What must be known to use the weights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Card {
    /// Always [`FORMAT`].
    pub format: String,
    /// Version of the program that trained it.
    pub program: String,
    /// Version of the features.
    pub features: String,
    /// Family of the tasks; a custom task's id. Of several families all names, joined by `+`.
    pub family: String,
    /// Numbers of scene and of action features.
    pub dimensions: [usize; 2],
    /// Configuration of each training, in order.
    pub trained: Vec<TrainConfig>,
}

/// Value of [`Card::format`].
pub const FORMAT: &str = "iplw.policy/1";

impl Card {
    /// Updates of all trainings.
    pub fn batches(&self) -> usize {
        self.trained.iter().map(|t| t.batches).sum()
    }

    /// How it looks at tasks.
    pub(super) fn view(&self) -> View {
        View::from_version(&self.features).expect("a card's features are known: checked where it is read")
    }

    pub(super) fn validate(&self) -> Result<()> {
        let same = |field: &str, found: &str, wanted: &str| {
            if found == wanted {
                Ok(())
            } else {
                Err(Error::input(field, format!("{found:?}"), format!("{wanted:?}")))
            }
        };
        same("format", &self.format, FORMAT)?;
        if View::from_version(&self.features).is_none() {
            let known = [View::Own, View::Shared].map(|v| format!("{:?}", v.version())).join(" or ");
            return Err(Error::input("features", format!("{:?}", self.features), known));
        }
        if self.dimensions.iter().any(|d| !(1..=MOST_UNITS).contains(d)) {
            let allowed = format!("two whole numbers from 1 to {MOST_UNITS}");
            return Err(Error::input("dimensions", format!("{:?}", self.dimensions), allowed));
        }
        if self.trained.is_empty() {
            return Err(Error::input("trained", "[]", "the configuration of at least one training"));
        }
        for (i, config) in self.trained.iter().enumerate() {
            config.validate().map_err(|e| e.under(&format!("trained[{i}]")))?;
        }
        Ok(())
    }
}
