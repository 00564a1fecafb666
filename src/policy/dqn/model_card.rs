//! Model card: metadata of a weights file.

use serde::{Deserialize, Serialize};

use super::fit::{MAX_UNITS, TrainConfig};
use crate::error::{Error, Result};
use crate::policy::feature_set::FeatureSet;

/// Metadata of the weights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelCard {
    /// Always [`FORMAT`].
    pub format: String,
    /// Version of the program that trained the weights.
    pub program: String,
    /// Version of the features.
    pub features: String,
    /// Family of the tasks, or a custom task's id. Several families are joined by `+`.
    pub family: String,
    /// Dimensions of the scene and action features.
    pub dimensions: [usize; 2],
    /// Configurations of all trainings, in order.
    pub trained: Vec<TrainConfig>,
}

/// Value of [`Card::format`].
pub const FORMAT: &str = "iplw.policy/1";

impl ModelCard {
    /// Total number of updates.
    pub fn batches(&self) -> usize {
        self.trained.iter().map(|t| t.batches).sum()
    }

    /// Feature set.
    pub(super) fn view(&self) -> FeatureSet {
        FeatureSet::from_version(&self.features).expect("a validated card has a known feature version")
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
        if FeatureSet::from_version(&self.features).is_none() {
            let known =
                [FeatureSet::Family, FeatureSet::Generic].map(|v| format!("{:?}", v.version())).join(" or ");
            return Err(Error::input("features", format!("{:?}", self.features), known));
        }
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
