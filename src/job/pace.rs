//! How long a job will still take, from how fast it went.

use std::time::Duration;

/// The pace of a job since it was begun.
#[derive(Default)]
pub struct Pace {
    /// When the stage began, at how many units done.
    stage: Option<(Duration, u64)>,
    /// Rounds, for a job that goes in rounds of about the same cost.
    rounds: Option<Rounds>,
}

struct Rounds {
    /// The first that this run worked on, and when it began.
    first: (Duration, u64),
    /// Those finished, and when the last of them was.
    last: (Duration, u64),
    total: u64,
}

impl Pace {
    /// A stage begins, at `done` units of it.
    pub fn begin(&mut self, now: Duration, done: u64) {
        self.stage = Some((now, done));
    }

    /// `done` of `total` rounds are finished; whether that is news.
    pub fn round(&mut self, now: Duration, done: u64, total: u64) -> bool {
        let news = self.rounds.as_ref().map_or(0, |r| r.last.1) < done;
        let first = self.rounds.as_ref().map_or((now, done), |r| r.first);
        self.rounds = Some(Rounds { first, last: (now, done), total });
        news
    }

    /// Seconds left at `done` of `total` units of the stage: of all rounds for a job that goes in rounds, known
    /// once one is finished; else of the stage. `None` while not known.
    pub fn left(&self, now: Duration, done: u64, total: u64) -> Option<f64> {
        match &self.rounds {
            Some(r) if r.last.1 < r.total => {
                let finished = r.last.1.checked_sub(r.first.1).filter(|n| *n > 0)?;
                let each = (r.last.0 - r.first.0).as_secs_f64() / finished as f64;
                let after = (r.total - r.last.1 - 1) as f64 * each;
                // A round that takes longer than those before it ends any moment.
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
    fn a_stage_goes_on_at_its_rate() {
        let mut pace = Pace::default();
        assert_eq!(pace.left(s(0), 0, 10), None);
        pace.begin(s(5), 2);
        assert_eq!(pace.left(s(6), 2, 10), None, "nothing done since");
        assert_eq!(pace.left(s(13), 6, 10), Some(8.0));
        assert_eq!(pace.left(s(21), 10, 10), Some(0.0));
    }

    #[test]
    fn rounds_are_taken_to_last_alike_and_those_of_an_earlier_run_do_not_count() {
        let mut pace = Pace::default();
        pace.begin(s(0), 0);
        pace.round(s(10), 3, 8);
        assert_eq!(pace.left(s(12), 5, 6), None, "no round finished yet");
        pace.round(s(14), 4, 8);
        assert_eq!(pace.left(s(14), 0, 1), Some(16.0));
        assert_eq!(pace.left(s(15), 0, 1), Some(15.0));
        assert_eq!(pace.left(s(99), 0, 1), Some(12.0));
        pace.round(s(30), 8, 8);
        pace.begin(s(30), 0);
        assert_eq!(pace.left(s(32), 1, 3), Some(4.0), "what comes after the rounds is a stage");
    }
}
