//! Successive elimination: chooses the next rollouts until the best actions are certain.
//!
//! Actions are ordered by successes over all draws, ties by index. Let t be the action that is `exact`-th by its successes so far. An
//! action that can't reach t even if all of its remaining rollouts succeed is eliminated, so the best actions are those of an exhaustive
//! evaluation, including ties. Estimated success rates only determine the order of evaluation.

use super::ranked::SuccessCount;

/// Maximal rollouts of a step, about a third of a second for bowling: the latency of deadlines and cancellation.
pub const MAX_STEP_ROLLOUTS: usize = 2048;
/// Halving steps after the initial draws: (number of best actions, draws of each after the step).
const HALVING_SCHEDULE: [(usize, usize); 3] = [(512, 6), (128, 14), (48, 30)];

/// State of the elimination.
pub struct SuccessiveElimination {
    counts: Vec<SuccessCount>,
    /// Rollouts of a fully evaluated action.
    draws: usize,
    /// Number of best actions to determine exactly.
    exact: usize,
    /// Initial draws of every action.
    initial_draws: usize,
    /// Halving steps done.
    halvings_done: usize,
}

impl SuccessiveElimination {
    /// The initial state for `actions` actions.
    pub fn new(actions: usize, draws: usize, exact: usize, initial_draws: usize) -> SuccessiveElimination {
        SuccessiveElimination {
            counts: vec![SuccessCount::default(); actions],
            draws,
            exact,
            initial_draws: initial_draws.min(draws),
            halvings_done: 0,
        }
    }

    /// Successes and rollouts of each action.
    pub fn counts(&self) -> &[SuccessCount] {
        &self.counts
    }

    /// The next rollouts, (action, index of the rollout), about [`MAX_STEP_ROLLOUTS`] at most; none once the best are certain.
    pub fn next(&mut self) -> Vec<(usize, usize)> {
        let looked = self.initial_step();
        if !looked.is_empty() {
            return looked;
        }
        while let Some((field, draws)) = HALVING_SCHEDULE.get(self.halvings_done) {
            self.halvings_done += 1;
            let ahead = self.order().into_iter().take(*field);
            let step = self.top_up(ahead, (*draws).min(self.draws));
            if !step.is_empty() {
                return step;
            }
        }
        self.final_step()
    }

    /// Records the outcomes of the rollouts returned by `next`.
    pub fn record(&mut self, copies: &[(usize, usize)], solved: &[bool]) {
        for ((action, _), solved) in copies.iter().zip(solved) {
            self.counts[*action].record(*solved);
        }
    }

    /// Whether the best actions are certain.
    pub fn is_complete(&self) -> bool {
        let [known, all] = self.decided();
        known == all
    }

    /// [actions that are eliminated or fully evaluated, all actions].
    pub fn decided(&self) -> [usize; 2] {
        let last = self.threshold_action();
        let open = (0..self.counts.len()).filter(|i| self.is_open(*i, last)).count();
        [self.counts.len() - open, self.counts.len()]
    }

    /// Actions, best first: by smoothed success rate, ties by index. Among fully evaluated actions that is the order of successes, and no
    /// eliminated action precedes the best (it has at least as many failures in fewer rollouts).
    pub fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.counts.len()).collect();
        order.sort_by(|a, b| {
            self.counts[*b].smoothed_share().total_cmp(&self.counts[*a].smoothed_share()).then(a.cmp(b))
        });
        order
    }

    fn initial_step(&self) -> Vec<(usize, usize)> {
        // Draw by draw for all actions, so that an early result covers every action.
        let mut step = Vec::new();
        for draw in 0..self.initial_draws {
            let waiting = (0..self.counts.len()).filter(|i| self.counts[*i].rollouts == draw);
            step.extend(waiting.take(MAX_STEP_ROLLOUTS - step.len()).map(|i| (i, draw)));
            if !step.is_empty() {
                break;
            }
        }
        step
    }

    /// Rollouts that bring each of `actions` to `draws` rollouts.
    fn top_up(&self, actions: impl Iterator<Item = usize>, draws: usize) -> Vec<(usize, usize)> {
        actions.flat_map(|i| (self.counts[i].rollouts..draws).map(move |k| (i, k))).collect()
    }

    /// Rollouts of actions that may still be among the best, in their order; for each, as many as could eliminate it.
    fn final_step(&self) -> Vec<(usize, usize)> {
        let last = self.threshold_action();
        let mut step = Vec::new();
        for i in self.order().into_iter().filter(|i| self.is_open(*i, last)) {
            let tried = self.counts[i].rollouts;
            let most = self.max_successes(i);
            let sure = last.map_or(0, |t| self.counts[t].successes);
            let needed = (most - sure + usize::from(last.is_some_and(|t| i <= t))).max(1);
            let until = self.draws.min(tried + needed);
            step.extend((tried..until).map(|k| (i, k)).take(MAX_STEP_ROLLOUTS - step.len()));
            if step.len() == MAX_STEP_ROLLOUTS {
                break;
            }
        }
        step
    }

    /// The `exact`-th best action by successes so far; `None` if there are fewer actions.
    fn threshold_action(&self) -> Option<usize> {
        let mut order: Vec<usize> = (0..self.counts.len()).collect();
        if order.len() < self.exact {
            return None;
        }
        let sure = |i: usize| (std::cmp::Reverse(self.counts[i].successes), i);
        let (_, last, _) = order.select_nth_unstable_by_key(self.exact - 1, |i| sure(*i));
        Some(*last)
    }

    /// Whether an action has rollouts left and may be among the best.
    fn is_open(&self, i: usize, last: Option<usize>) -> bool {
        let Some(t) = last else { return self.counts[i].rollouts < self.draws };
        let (most, sure) = (self.max_successes(i), self.counts[t].successes);
        self.counts[i].rollouts < self.draws && (most > sure || (most == sure && i <= t))
    }

    /// Upper bound of an action's successes.
    fn max_successes(&self, i: usize) -> usize {
        self.draws - self.counts[i].failures()
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::rng;

    /// Outcomes of (action, rollout); the larger `power`, the fewer succeed.
    fn outcomes(actions: usize, draws: usize, power: i32, seed: u64) -> Vec<Vec<bool>> {
        let mut stream = rng::stream(seed, "race test");
        let mut row = || {
            let chance = stream.random::<f64>().powi(power);
            (0..draws).map(|_| stream.random::<f64>() < chance).collect()
        };
        (0..actions).map(|_| row()).collect()
    }

    fn run_to_the_end(
        outcomes: &[Vec<bool>],
        exact: usize,
        initial_draws: usize,
    ) -> (SuccessiveElimination, usize) {
        let mut race = SuccessiveElimination::new(outcomes.len(), outcomes[0].len(), exact, initial_draws);
        let (mut spent, mut next) = (0, vec![0; outcomes.len()]);
        loop {
            let step = race.next();
            if step.is_empty() {
                break;
            }
            for (i, k) in &step {
                assert_eq!(next[*i], *k, "each rollout once and in order");
                next[*i] += 1;
            }
            assert!(step.len() <= MAX_STEP_ROLLOUTS.max(512 * 6), "{}", step.len());
            let solved: Vec<bool> = step.iter().map(|(i, k)| outcomes[*i][*k]).collect();
            race.record(&step, &solved);
            spent += step.len();
        }
        (race, spent)
    }

    /// For all kinds of success rates: similar, few good ones, none at all, fewer actions than requested.
    #[test]
    fn matches_exhaustive_evaluation() {
        let cases =
            [(300, 16, 1), (300, 16, 6), (2000, 64, 3), (2000, 64, 40), (7, 16, 2), (1, 5, 1), (40, 1, 1)];
        for (n, (actions, draws, power)) in cases.into_iter().enumerate() {
            for seed in 0..5 {
                let all = outcomes(actions, draws, power, seed + 100 * n as u64);
                let (race, _) = run_to_the_end(&all, 10, 2);
                assert!(race.is_complete());
                let total: Vec<usize> = all.iter().map(|row| row.iter().filter(|s| **s).count()).collect();
                let mut wanted: Vec<usize> = (0..actions).collect();
                wanted.sort_by_key(|i| (std::cmp::Reverse(total[*i]), *i));
                let best = wanted.len().min(10);
                assert_eq!(race.order()[..best], wanted[..best], "case {n}, seed {seed}");
                for i in &wanted[..best] {
                    assert_eq!(race.counts()[*i], SuccessCount { successes: total[*i], rollouts: draws });
                }
            }
        }
    }

    #[test]
    fn every_action_gets_its_initial_draws() {
        let (race, _) = run_to_the_end(&outcomes(500, 20, 2, 9), 10, 3);
        assert!(race.counts().iter().all(|c| c.rollouts >= 3));
    }

    /// Where some actions always succeed, elimination costs little more than the initial draws.
    #[test]
    fn certain_actions_end_elimination_early() {
        let mut all = outcomes(10_000, 64, 30, 4);
        for row in all.iter_mut().step_by(300) {
            row.fill(true);
        }
        let (_, spent) = run_to_the_end(&all, 10, 2);
        assert!(spent < 40_000, "{spent} of {}", 10_000 * 64);
    }
}
