//! A progress that records the time between two checks.

use std::backtrace::Backtrace;
use std::sync::Mutex;
use std::time::Instant;

use iplw::error::Result;
use iplw::progress::Progress;

/// Number of intervals that are reported.
const REPORTED: usize = 8;

/// Records the longest times between two checks.
pub struct Stopwatch(Mutex<Inner>);

struct Inner {
    last: Instant,
    stage: String,
    /// Time between two checks, s; stage and backtrace of the second. Descending.
    longest: Vec<(f64, String, String)>,
}

impl Stopwatch {
    pub fn new() -> Stopwatch {
        Stopwatch(Mutex::new(Inner { last: Instant::now(), stage: String::new(), longest: Vec::new() }))
    }

    /// The longest intervals, descending.
    pub fn longest(self) -> Vec<(f64, String, String)> {
        self.check(None);
        self.0.into_inner().unwrap().longest
    }

    fn check(&self, stage: Option<&str>) {
        let mut inner = self.0.lock().unwrap();
        let seconds = inner.last.elapsed().as_secs_f64();
        if seconds > 0.02 && inner.longest.get(REPORTED - 1).is_none_or(|l| l.0 < seconds) {
            let trace = Backtrace::force_capture().to_string();
            let trace: Vec<&str> =
                trace.lines().filter(|l| l.contains("iplw::") && !l.contains("test")).take(6).collect();
            let stage = inner.stage.clone();
            inner.longest.push((seconds, stage, trace.join("\n")));
            inner.longest.sort_by(|a, b| b.0.total_cmp(&a.0));
            inner.longest.truncate(REPORTED);
        }
        if let Some(stage) = stage {
            inner.stage = stage.into();
        }
        inner.last = Instant::now();
    }
}

impl Progress for Stopwatch {
    fn report(&self, stage: &str, _done: u64, _total: u64) -> Result<()> {
        self.check(Some(stage));
        Ok(())
    }

    fn check_stop(&self) -> Result<()> {
        self.check(None);
        Ok(())
    }
}
