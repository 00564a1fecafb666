//! Costs of experiments: a batch is chosen greedily by information gain per cost.
//!
//! Source: greedy choice by gain per cost: Krause and Guestrin 2005, section 4; Leskovec et al. 2007, section 3.2.
//!
//! Differences from the source: the greedy batch isn't compared with the single most informative experiment, which may be better where
//! one experiment takes nearly all of the budget.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, check_range};

/// Costs of experiments, in the unit of the budget (minutes, say).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Costs {
    /// Cost of every experiment.
    pub trial: f64,
    /// Additional cost of setting a task up, paid once for every task of a batch.
    pub setup: f64,
    /// Maximal cost of a batch; `None` if only its size is limited.
    pub budget: Option<f64>,
}

impl Default for Costs {
    /// The same cost for every experiment.
    fn default() -> Costs {
        Costs { trial: 1.0, setup: 0.0, budget: None }
    }
}

impl Costs {
    /// Errors unless every cost is within its range and the budget pays for at least one experiment.
    pub fn validate(&self) -> Result<()> {
        check_range("costs.trial", self.trial, 1e-9, 1e9)?;
        check_range("costs.setup", self.setup, 0.0, 1e9)?;
        let first_cost = self.trial + self.setup;
        match self.budget {
            Some(maximum) if !(maximum.is_finite() && self.affords(0.0, first_cost)) => {
                let allowed = format!("at least {}, the cost of the first experiment", rounded(first_cost));
                Err(Error::input("costs.budget", maximum, allowed))
            }
            _ => Ok(()),
        }
    }

    /// Whether all experiments cost the same and there is no budget.
    pub fn is_uniform(&self) -> bool {
        self.setup == 0.0 && self.budget.is_none()
    }

    /// Cost of an experiment on a task, given the tasks that are set up already.
    pub fn cost_of(&self, task: usize, set_up: &BTreeSet<usize>) -> f64 {
        self.trial + if set_up.contains(&task) { 0.0 } else { self.setup }
    }

    /// Whether the budget allows `more` on top of `spent`, up to rounding.
    pub fn affords(&self, spent: f64, more: f64) -> bool {
        self.budget.is_none_or(|maximum| spent + more <= maximum * (1.0 + 1e-12))
    }

    /// Sort key of experiments: gain per cost; of equal ones the cheaper is better.
    pub fn priority(adds: f64, cost: f64) -> [f64; 2] {
        [if adds > 0.0 { adds / cost } else { adds * cost }, -cost]
    }
}

/// A cost without the rounding error of sums, for display.
pub fn rounded(cost: f64) -> f64 {
    format!("{cost:.9e}").parse().unwrap_or(cost)
}

/// The candidates to evaluate again, from `order` (best first). Where setting a task up costs something, the best half is followed
/// by other candidates on the same tasks, so that a batch can stay on one task.
pub fn shortlist(
    order: &[usize],
    task_of: impl Fn(usize) -> usize,
    count: usize,
    costs: &Costs,
) -> Vec<usize> {
    let count = count.min(order.len());
    if costs.setup == 0.0 {
        return order[..count].to_vec();
    }
    let (first, rest) = order.split_at(count.div_ceil(2));
    let tasks: BTreeSet<usize> = first.iter().map(|i| task_of(*i)).collect();
    let (same_tasks, other_tasks): (Vec<usize>, Vec<usize>) =
        rest.iter().copied().partition(|i| tasks.contains(&task_of(*i)));
    first.iter().copied().chain(same_tasks).chain(other_tasks).take(count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charges_setup_once_per_task() {
        let costs = Costs { trial: 1.0, setup: 10.0, budget: Some(22.0) };
        let (none, one) = (BTreeSet::new(), BTreeSet::from([3]));
        assert_eq!(
            (costs.cost_of(3, &none), costs.cost_of(3, &one), costs.cost_of(4, &one)),
            (11.0, 1.0, 11.0)
        );
        assert!(costs.affords(11.0, 11.0) && !costs.affords(11.0, 11.1));
        assert!(Costs::default().affords(1e12, 1.0) && Costs::default().is_uniform() && !costs.is_uniform());
        // Of candidates that add nothing the cheaper is better.
        let worth = Costs::priority;
        assert!(worth(-0.1, 1.0) > worth(-0.1, 11.0) && worth(0.5, 1.0) > worth(2.0, 11.0));
        assert!(worth(0.0, 1.0) > worth(0.0, 11.0));
        // 0.3 is not 0.1 + 0.2 in binary, and pays for it all the same.
        let tenths = Costs { trial: 0.1, setup: 0.2, budget: Some(0.3) };
        assert!(tenths.validate().is_ok() && rounded(0.1 + 0.2) == 0.3 && rounded(6.0) == 6.0);
    }

    #[test]
    fn shortlists_candidates_on_the_same_tasks() {
        let order = [0, 1, 2, 3, 4, 5];
        let task_of = |i: usize| [7, 8, 9, 7, 9, 8][i];
        let free = Costs::default();
        assert_eq!(shortlist(&order, task_of, 4, &free), [0, 1, 2, 3]);
        let setup = Costs { setup: 1.0, ..free };
        assert_eq!(shortlist(&order, task_of, 4, &setup), [0, 1, 3, 5]);
        assert_eq!(shortlist(&order, task_of, 100, &setup).len(), 6);
    }

    #[test]
    fn rejects_costs_out_of_range_by_name() {
        let refused = |costs: Costs, name: &str| {
            let error = costs.validate().unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        };
        let usual = Costs::default();
        refused(Costs { trial: 0.0, ..usual }, "costs.trial");
        refused(Costs { setup: f64::NAN, ..usual }, "costs.setup");
        refused(Costs { setup: 5.0, budget: Some(5.5), ..usual }, "costs.budget");
        refused(Costs { budget: Some(f64::INFINITY), ..usual }, "costs.budget");
        assert!(Costs { setup: 5.0, budget: Some(6.0), ..usual }.validate().is_ok());
    }
}
