//! What experiments cost: which of them are chosen is decided by what they tell for it.
//!
//! Source: information for its cost, one experiment after the other: Krause and Guestrin 2005, section 4; Leskovec et al. 2007,
//! section 3.2.
//!
//! Differences from the source: the single experiment that tells most is not held against the batch, which may come to less where one
//! experiment takes nearly all of the budget.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, within};

/// What experiments cost, in the unit of the budget: minutes, say.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Costs {
    /// Every experiment.
    pub trial: f64,
    /// What it costs more to set a task up: once for every task of a batch.
    pub setup: f64,
    /// Most that a batch may cost; `None` if nothing but its size ends it.
    pub budget: Option<f64>,
}

impl Default for Costs {
    /// Every experiment costs the same.
    fn default() -> Costs {
        Costs { trial: 1.0, setup: 0.0, budget: None }
    }
}

impl Costs {
    /// Errors unless every cost is one, and a budget pays for something.
    pub fn validate(&self) -> Result<()> {
        within("costs.trial", self.trial, 1e-9, 1e9)?;
        within("costs.setup", self.setup, 0.0, 1e9)?;
        let least = self.trial + self.setup;
        match self.budget {
            Some(most) if !(most.is_finite() && self.pays(0.0, least)) => {
                let allowed = format!("at least {}, what the first experiment costs", shown(least));
                Err(Error::input("costs.budget", most, allowed))
            }
            _ => Ok(()),
        }
    }

    /// Whether all experiments cost the same, and nothing ends a batch but its size.
    pub fn alike(&self) -> bool {
        self.setup == 0.0 && self.budget.is_none()
    }

    /// What an experiment on a task costs where some are set up already.
    pub fn of(&self, task: usize, set_up: &BTreeSet<usize>) -> f64 {
        self.trial + if set_up.contains(&task) { 0.0 } else { self.setup }
    }

    /// Whether what has been spent leaves room for more that costs so much; a hair beyond is rounding.
    pub fn pays(&self, spent: f64, more: f64) -> bool {
        self.budget.is_none_or(|most| spent + more <= most * (1.0 + 1e-12))
    }

    /// What orders experiments: what one adds, for its cost; of those that are worth as much the cheaper is the better.
    pub fn worth(adds: f64, cost: f64) -> [f64; 2] {
        [if adds > 0.0 { adds / cost } else { adds * cost }, -cost]
    }
}

/// A cost as it is read; sums of costs are off by what rounds.
pub fn shown(cost: f64) -> f64 {
    format!("{cost:.9e}").parse().unwrap_or(cost)
}

/// Which of the candidates, told most first, are looked at closely: the first; where to set a task up costs something, half as
/// many, then what else there is on their tasks, or a batch could not stay where it is.
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
    let (there, elsewhere): (Vec<usize>, Vec<usize>) =
        rest.iter().copied().partition(|i| tasks.contains(&task_of(*i)));
    first.iter().copied().chain(there).chain(elsewhere).take(count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_task_is_set_up_once() {
        let costs = Costs { trial: 1.0, setup: 10.0, budget: Some(22.0) };
        let (none, one) = (BTreeSet::new(), BTreeSet::from([3]));
        assert_eq!((costs.of(3, &none), costs.of(3, &one), costs.of(4, &one)), (11.0, 1.0, 11.0));
        assert!(costs.pays(11.0, 11.0) && !costs.pays(11.0, 11.1));
        assert!(Costs::default().pays(1e12, 1.0) && Costs::default().alike() && !costs.alike());
        // Of what adds nothing the cheaper is better.
        let worth = Costs::worth;
        assert!(worth(-0.1, 1.0) > worth(-0.1, 11.0) && worth(0.5, 1.0) > worth(2.0, 11.0));
        assert!(worth(0.0, 1.0) > worth(0.0, 11.0));
        // Three tenths are not the sum of one and two, and are enough for it.
        let tenths = Costs { trial: 0.1, setup: 0.2, budget: Some(0.3) };
        assert!(tenths.validate().is_ok() && shown(0.1 + 0.2) == 0.3 && shown(6.0) == 6.0);
    }

    #[test]
    fn what_is_on_the_same_tasks_is_looked_at_closely() {
        let order = [0, 1, 2, 3, 4, 5];
        let task_of = |i: usize| [7, 8, 9, 7, 9, 8][i];
        let free = Costs::default();
        assert_eq!(shortlist(&order, task_of, 4, &free), [0, 1, 2, 3]);
        let setup = Costs { setup: 1.0, ..free };
        assert_eq!(shortlist(&order, task_of, 4, &setup), [0, 1, 3, 5]);
        assert_eq!(shortlist(&order, task_of, 100, &setup).len(), 6);
    }

    #[test]
    fn costs_that_cannot_be_are_refused_by_name() {
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
