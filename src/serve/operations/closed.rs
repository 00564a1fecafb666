//! Finished rounds of estimations, as they are kept.

use serde::{Deserialize, Serialize};

use crate::estimate::LatentEstimate;
use crate::experiment::Round;

/// A finished round as it is kept.
#[derive(Serialize, Deserialize)]
pub struct Closed {
    #[serde(flatten)]
    pub round: Round,
    /// What was known after it; empty if nothing was measured, and in rounds of programs that did not keep it.
    #[serde(default)]
    pub known: Vec<LatentEstimate>,
    /// Numbers of the proposals that were measured; absent in rounds of programs that did not keep it.
    #[serde(default)]
    pub answered: Option<Vec<u64>>,
}
