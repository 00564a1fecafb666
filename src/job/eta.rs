//! Estimated remaining time of a job, from its rate so far.

use std::time::Duration;

/// Rate of progress of a job since it was started.
#[derive(Default)]
pub struct EtaEstimator {
    /// Start of the current stage, and the units done then.
    stage: Option<(Duration, u64)>,
    /// Rounds, for a job with rounds of about equal cost.
    rounds: Option<RoundTimes>,
}

struct RoundTimes {
    /// Start time, and the first round of this run.
    first: (Duration, u64),
    /// Time of the last finished round, and the rounds finished.
    last: (Duration, u64),
    total: u64,
}

impl EtaEstimator {
    /// Starts a stage, of which `done` units are done.
    pub fn start_stage(&mut self, now: Duration, done: u64) {
        self.stage = Some((now, done));
    }

    /// `done` of `total` rounds are finished; returns whether a round was added.
    pub fn finish_round(&mut self, now: Duration, done: u64, total: u64) -> bool {
        let news = self.rounds.as_ref().map_or(0, |r| r.last.1) < done;
        let first = self.rounds.as_ref().map_or((now, done), |r| r.first);
        self.rounds = Some(RoundTimes { first, last: (now, done), total });
        news
    }

    /// Estimated seconds left at `done` of `total` units of the stage: for all rounds in a job with rounds, once one is finished; else
    /// for the stage. `None` while unknown.
    pub fn seconds_left(&self, now: Duration, done: u64, total: u64) -> Option<f64> {
        match &self.rounds {
            Some(r) if r.last.1 < r.total => {
                let finished = r.last.1.checked_sub(r.first.1).filter(|n| *n > 0)?;
                let each = (r.last.0 - r.first.0).as_secs_f64() / finished as f64;
                let after = (r.total - r.last.1 - 1) as f64 * each;
                // A round that exceeds the average is assumed to end now.
                Some(after + (each - (now.saturating_sub(r.last.0)).as_secs_f64()).max(0.0))
            }
            _ => {
                let (begun, from) = self.stage?;
                let made = done.checked_sub(from).filter(|n| *n > 0)?;
                let each = now.saturating_sub(begun).as_secs_f64() / made as f64;
                Some(each * total.saturating_sub(done) as f64)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn s(seconds: u64) -> Duration {
        Duration::from_secs(seconds)
    }

    #[test]
    fn extrapolates_stage_rate() {
        let mut eta = EtaEstimator::default();
        assert_eq!(eta.seconds_left(s(0), 0, 10), None);
        eta.start_stage(s(5), 2);
        assert_eq!(eta.seconds_left(s(6), 2, 10), None, "nothing done since");
        assert_eq!(eta.seconds_left(s(13), 6, 10), Some(8.0));
        assert_eq!(eta.seconds_left(s(21), 10, 10), Some(0.0));
    }

    #[test]
    fn extrapolates_rounds_of_this_run() {
        let mut eta = EtaEstimator::default();
        eta.start_stage(s(0), 0);
        eta.finish_round(s(10), 3, 8);
        assert_eq!(eta.seconds_left(s(12), 5, 6), None, "no round finished yet");
        eta.finish_round(s(14), 4, 8);
        assert_eq!(eta.seconds_left(s(14), 0, 1), Some(16.0));
        assert_eq!(eta.seconds_left(s(15), 0, 1), Some(15.0));
        assert_eq!(eta.seconds_left(s(99), 0, 1), Some(12.0));
        eta.finish_round(s(30), 8, 8);
        eta.start_stage(s(30), 0);
        assert_eq!(eta.seconds_left(s(32), 1, 3), Some(4.0), "what comes after the rounds is a stage");
    }
}
