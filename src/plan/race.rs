//! A race of actions over copies: which are worth trying further, until the best are known for certain.
//!
//! Actions are ordered by successes over all draws, equal ones by their number. Let t be the action that is `exact`-th by
//! what it has for sure. An action whose failures so far leave it behind t whatever its other copies do is never among the
//! best, and is dropped; so the best are those of trying everything, to the last tie. No outcome is assumed to be likely:
//! what is likely only decides who is tried first.

use super::ranked::Count;

/// Most copies of a step: what a clock or a client that leaves waits for at most, a third of a second of bowling.
pub const STEP: usize = 2048;
/// Times that the actions ahead are halved after the first look, before any goes to the end: (actions, their draws by then).
const HALVING: [(usize, usize); 3] = [(512, 6), (128, 14), (48, 30)];

/// Where each action stands.
pub struct Race {
    counts: Vec<Count>,
    /// Copies that are tried in order by an action that goes to the end.
    draws: usize,
    /// So many are to be known for certain.
    exact: usize,
    /// Draws that every action gets.
    look: usize,
    /// How often the field was halved.
    halved: usize,
}

impl Race {
    /// A race of so many actions before its start.
    pub fn new(actions: usize, draws: usize, exact: usize, look: usize) -> Race {
        Race { counts: vec![Count::default(); actions], draws, exact, look: look.min(draws), halved: 0 }
    }

    /// Where each action stands.
    pub fn counts(&self) -> &[Count] {
        &self.counts
    }

    /// The next copies to try, (action, copy), about [`STEP`] at most; none once the best are known.
    pub fn next(&mut self) -> Vec<(usize, usize)> {
        let looked = self.first_look();
        if !looked.is_empty() {
            return looked;
        }
        while let Some((field, draws)) = HALVING.get(self.halved) {
            self.halved += 1;
            let ahead = self.order().into_iter().take(*field);
            let step = self.to(ahead, (*draws).min(self.draws));
            if !step.is_empty() {
                return step;
            }
        }
        self.to_the_end()
    }

    /// Takes in what became of the copies that were next.
    pub fn tell(&mut self, copies: &[(usize, usize)], solved: &[bool]) {
        for ((action, _), solved) in copies.iter().zip(solved) {
            self.counts[*action].add(*solved);
        }
    }

    /// Whether the best are known for certain.
    pub fn is_over(&self) -> bool {
        let [known, all] = self.known();
        known == all
    }

    /// How many actions are decided on, of how many.
    pub fn known(&self) -> [usize; 2] {
        let last = self.last_of_the_best();
        let open = (0..self.counts.len()).filter(|i| self.is_open(*i, last)).count();
        [self.counts.len() - open, self.counts.len()]
    }

    /// Actions, best first: by their smoothed share, equal ones by number. Among those tried to the end that is by successes;
    /// and no action that was dropped stands before them (it has as many failures, of fewer draws).
    pub fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.counts.len()).collect();
        order.sort_by(|a, b| self.counts[*b].share().total_cmp(&self.counts[*a].share()).then(a.cmp(b)));
        order
    }

    fn first_look(&self) -> Vec<(usize, usize)> {
        // A draw for everybody before the next one, so that an answer before the end has seen all.
        let mut step = Vec::new();
        for draw in 0..self.look {
            let waiting = (0..self.counts.len()).filter(|i| self.counts[*i].tried == draw);
            step.extend(waiting.take(STEP - step.len()).map(|i| (i, draw)));
            if !step.is_empty() {
                break;
            }
        }
        step
    }

    /// Copies that bring `actions` to so many draws.
    fn to(&self, actions: impl Iterator<Item = usize>, draws: usize) -> Vec<(usize, usize)> {
        actions.flat_map(|i| (self.counts[i].tried..draws).map(move |k| (i, k))).collect()
    }

    /// Copies of actions that may still be among the best, those that do best first; of each as many as could be the end of it.
    fn to_the_end(&self) -> Vec<(usize, usize)> {
        let last = self.last_of_the_best();
        let mut step = Vec::new();
        for i in self.order().into_iter().filter(|i| self.is_open(*i, last)) {
            let tried = self.counts[i].tried;
            let most = self.most(i);
            let sure = last.map_or(0, |t| self.counts[t].successes);
            let needed = (most - sure + usize::from(last.is_some_and(|t| i <= t))).max(1);
            let until = self.draws.min(tried + needed);
            step.extend((tried..until).map(|k| (i, k)).take(STEP - step.len()));
            if step.len() == STEP {
                break;
            }
        }
        step
    }

    /// The last of the `exact` best by what they have for sure; `None` if there are fewer actions.
    fn last_of_the_best(&self) -> Option<usize> {
        let mut order: Vec<usize> = (0..self.counts.len()).collect();
        if order.len() < self.exact {
            return None;
        }
        let sure = |i: usize| (std::cmp::Reverse(self.counts[i].successes), i);
        let (_, last, _) = order.select_nth_unstable_by_key(self.exact - 1, |i| sure(*i));
        Some(*last)
    }

    /// Whether an action has copies left, and may be among the best.
    fn is_open(&self, i: usize, last: Option<usize>) -> bool {
        let Some(t) = last else { return self.counts[i].tried < self.draws };
        let (most, sure) = (self.most(i), self.counts[t].successes);
        self.counts[i].tried < self.draws && (most > sure || (most == sure && i <= t))
    }

    /// Most successes that an action can still come to.
    fn most(&self, i: usize) -> usize {
        self.draws - self.counts[i].failures()
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::rng;

    /// Outcomes of (action, copy), with chances of success spread by `power`: the larger, the fewer succeed.
    fn outcomes(actions: usize, draws: usize, power: i32, seed: u64) -> Vec<Vec<bool>> {
        let mut stream = rng::stream(seed, "race test");
        let mut row = || {
            let chance = stream.random::<f64>().powi(power);
            (0..draws).map(|_| stream.random::<f64>() < chance).collect()
        };
        (0..actions).map(|_| row()).collect()
    }

    fn run(outcomes: &[Vec<bool>], exact: usize, look: usize) -> (Race, usize) {
        let mut race = Race::new(outcomes.len(), outcomes[0].len(), exact, look);
        let mut spent = 0;
        loop {
            let step = race.next();
            if step.is_empty() {
                break;
            }
            assert!(step.len() <= STEP.max(512 * 6), "{}", step.len());
            let solved: Vec<bool> = step.iter().map(|(i, k)| outcomes[*i][*k]).collect();
            race.tell(&step, &solved);
            spent += step.len();
        }
        (race, spent)
    }

    /// The best, in order, whatever the chances: all alike, few good ones, none at all, fewer actions than are wanted.
    #[test]
    fn the_best_are_those_of_trying_everything() {
        let cases =
            [(300, 16, 1), (300, 16, 6), (2000, 64, 3), (2000, 64, 40), (7, 16, 2), (1, 5, 1), (40, 1, 1)];
        for (n, (actions, draws, power)) in cases.into_iter().enumerate() {
            for seed in 0..5 {
                let all = outcomes(actions, draws, power, seed + 100 * n as u64);
                let (race, _) = run(&all, 10, 2);
                assert!(race.is_over());
                let total: Vec<usize> = all.iter().map(|row| row.iter().filter(|s| **s).count()).collect();
                let mut wanted: Vec<usize> = (0..actions).collect();
                wanted.sort_by_key(|i| (std::cmp::Reverse(total[*i]), *i));
                let best = wanted.len().min(10);
                assert_eq!(race.order()[..best], wanted[..best], "case {n}, seed {seed}");
                for i in &wanted[..best] {
                    assert_eq!(race.counts()[*i], Count { successes: total[*i], tried: draws });
                }
            }
        }
    }

    #[test]
    fn nothing_is_tried_twice_or_out_of_order() {
        let all = outcomes(500, 20, 2, 9);
        let mut race = Race::new(500, 20, 10, 3);
        let mut next = vec![0; 500];
        loop {
            let step = race.next();
            if step.is_empty() {
                break;
            }
            for (i, k) in &step {
                assert_eq!(next[*i], *k);
                next[*i] += 1;
            }
            let solved: Vec<bool> = step.iter().map(|(i, k)| all[*i][*k]).collect();
            race.tell(&step, &solved);
        }
        assert!(race.counts().iter().all(|c| c.tried >= 3));
    }

    /// Where some actions always solve, the race costs little more than the first look.
    #[test]
    fn sure_actions_end_the_race_early() {
        let mut all = outcomes(10_000, 64, 30, 4);
        for row in all.iter_mut().step_by(300) {
            row.fill(true);
        }
        let (_, spent) = run(&all, 10, 2);
        assert!(spent < 40_000, "{spent} of {}", 10_000 * 64);
    }
}
