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
        let whole = to - from;
        match whole > 0.0 {
            true => (self.integral(joint, to) - self.integral(joint, from)) / whole,
            false => self.values[joint][self.index(from)],
        }
    }

    /// Integral of a command from the first time to `time`.
    fn integral(&self, joint: usize, time: f64) -> f64 {
        let at = self.index(time);
        self.integrals[joint][at] + self.values[joint][at] * (time - self.times[at])
    }

    /// Index of the last time that is not after `time`; 0 if there is none.
    fn index(&self, time: f64) -> usize {
        self.times.partition_point(|t| *t <= time).saturating_sub(1)
    }
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
