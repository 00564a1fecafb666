//! Commands of motors: piecewise constant in time.

/// Commands by joint: a value holds from its time until the next one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Commands {
    /// s, ascending
    times: Vec<f64>,
    /// By joint, one value per time; empty for a joint without commands.
    values: Vec<Vec<f64>>,
    /// By joint: integral of the command from the first time to each time.
    integrals: Vec<Vec<f64>>,
}

impl Commands {
    /// Commands with ascending times; `values`: by joint, one per time, or none.
    pub fn new(times: Vec<f64>, values: Vec<Vec<f64>>) -> Commands {
        let integral = |values: &Vec<f64>| {
            let mut sum = 0.0;
            let mut all = Vec::with_capacity(values.len());
            for (k, _) in values.iter().enumerate() {
                if k > 0 {
                    sum += values[k - 1] * (times[k] - times[k - 1]);
                }
                all.push(sum);
            }
            all
        };
        let integrals = values.iter().map(integral).collect();
        Commands { times, values, integrals }
    }

    /// Whether there are commands for a joint.
    pub fn drives(&self, joint: usize) -> bool {
        self.values.get(joint).is_some_and(|values| !values.is_empty())
    }

    /// Mean command of a joint over an interval of time, s: exact whatever the steps of the simulation. Before the first
    /// time the first value holds.
    pub fn mean(&self, joint: usize, [from, to]: [f64; 2]) -> f64 {
        if !self.drives(joint) {
            return 0.0;
        }
        self.mean_between(joint, [from, to], [self.index(from), self.index(to)])
    }

    /// The same for intervals in ascending order, without a search.
    pub fn next_mean(&self, joint: usize, [from, to]: [f64; 2], cursor: &mut CommandCursor) -> f64 {
        cursor.from = self.index_after(from, cursor.from);
        self.mean_between(joint, [from, to], [cursor.from, self.index_after(to, cursor.from)])
    }

    /// Mean over an interval whose ends are in the pieces `first` and `last`.
    fn mean_between(&self, joint: usize, [from, to]: [f64; 2], [first, last]: [usize; 2]) -> f64 {
        if first == last {
            return self.values[joint][first];
        }
        let integral = |time: f64, at: usize| {
            self.integrals[joint][at] + self.values[joint][at] * (time - self.times[at])
        };
        (integral(to, last) - integral(from, first)) / (to - from)
    }

    /// [`Commands::index`] for a time that is not before piece `at`.
    fn index_after(&self, time: f64, mut at: usize) -> usize {
        while self.times.get(at + 1).is_some_and(|next| *next <= time) {
            at += 1;
        }
        at
    }

    /// Index of the last time that is not after `time`; 0 if there is none.
    fn index(&self, time: f64) -> usize {
        self.times.partition_point(|t| *t <= time).saturating_sub(1)
    }
}

/// Place in commands that are read in ascending order.
#[derive(Clone, Copy, Debug, Default)]
pub struct CommandCursor {
    from: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_exact() {
        let commands = Commands::new(vec![0.0, 1.0, 3.0], vec![vec![2.0, -1.0, 5.0], Vec::new()]);
        let mean = |from: f64, to: f64| commands.mean(0, [from, to]);
        assert_eq!([mean(0.0, 0.5), mean(0.5, 1.5), mean(1.0, 1.0)], [2.0, 0.5, -1.0]);
        assert_eq!([mean(-1.0, 0.0), mean(2.0, 4.0), mean(9.0, 10.0)], [2.0, 2.0, 5.0]);
        assert_eq!((commands.mean(1, [0.0, 1.0]), commands.drives(1)), (0.0, false));
    }
}
