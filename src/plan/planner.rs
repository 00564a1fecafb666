//! Plans as a policy that scores actions by their rank.

use std::collections::BTreeMap;

use crate::error::{Error, Result};
use crate::policy::Policy;
use crate::task::{Task, ValidAction};

use super::ranked::Plan;

/// Plans of some tasks. An action that isn't ranked by its task's plan (it can't be placed or isn't a candidate) scores lowest.
pub struct PlanPolicy {
    about: String,
    /// By task: the rank of each action, by the bits of its components.
    places: BTreeMap<String, BTreeMap<Vec<u64>, usize>>,
}

impl PlanPolicy {
    /// A policy from one plan for each task; `about` describes the parameter samples that the plans are based on.
    pub fn new(about: &str, plans: &[Plan]) -> PlanPolicy {
        let order = |plan: &Plan| {
            let places = plan.ranked.iter().enumerate().map(|(place, r)| (bits(&r.action), place));
            (plan.task.clone(), places.collect())
        };
        PlanPolicy { about: about.into(), places: plans.iter().map(order).collect() }
    }
}

impl Policy for PlanPolicy {
    fn score(&self, task: &Task, actions: &[ValidAction]) -> Result<Vec<f32>> {
        let places = self
            .places
            .get(&task.id)
            .ok_or_else(|| Error::not_found("plan of a task", &task.id, self.places.keys()))?;
        // Ranks of up to a million actions are exact in 24 bits.
        let score =
            |a: &ValidAction| places.get(&bits(a)).map_or(f32::NEG_INFINITY, |place| -(*place as f32));
        Ok(actions.iter().map(score).collect())
    }

    fn describe(&self) -> String {
        format!("rollouts under {}, {} tasks", self.about, self.places.len())
    }
}

fn bits(action: &ValidAction) -> Vec<u64> {
    action.values().iter().map(|v| v.to_bits()).collect()
}
