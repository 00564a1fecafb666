//! Stored form of an estimation's finished rounds.

use serde::{Deserialize, Serialize};

use crate::estimate::LatentEstimate;
use crate::experiment::Round;

/// A finished round as stored.
#[derive(Serialize, Deserialize)]
pub struct FinishedRound {
    #[serde(flatten)]
    pub round: Round,
    /// Estimates after the round; empty if nothing was measured, and in data of older versions.
    #[serde(default)]
    pub known: Vec<LatentEstimate>,
    /// Numbers of the measured proposals; absent in data of older versions.
    #[serde(default)]
    pub answered: Option<Vec<u64>>,
}
