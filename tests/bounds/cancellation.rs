//! Cancellation of every kind of job: it ends with the error of the check that cancels it, soon after.

use std::sync::atomic::{AtomicU64, Ordering};

use iplw::design::{DesignConfig, Question, design};
use iplw::error::{Error, Result};
use iplw::estimate::ParameterSamples;
use iplw::experiment::surface;
use iplw::inference::posterior::{PosteriorConfig, TrialLikelihood, posterior};
use iplw::inference::{DiagnosisConfig, diagnose};
use iplw::plan::{PlanConfig, plan};
use iplw::progress::Progress;
use iplw::task::family;

use crate::recordings;

/// Cancels at a check and at all later ones.
struct CancelAfter {
    first: u64,
    checks: AtomicU64,
}

impl Progress for CancelAfter {
    fn report(&self, _stage: &str, _done: u64, _total: u64) -> Result<()> {
        self.check_stop()
    }

    fn check_stop(&self) -> Result<()> {
        let before = self.checks.fetch_add(1, Ordering::Relaxed);
        if before >= self.first { Err(Error::Cancelled) } else { Ok(()) }
    }
}

/// Largest number of checks after the one that cancels: parallel work units end at their first one each.
const MAX_LATER_CHECKS: u64 = 2000;

fn assert_cancels(name: &str, work: impl Fn(&dyn Progress) -> Result<()>) {
    for first in [0, 3, 300] {
        let progress = CancelAfter { first, checks: AtomicU64::new(0) };
        assert_eq!(work(&progress), Err(Error::Cancelled), "{name} after {first} checks");
        let later = progress.checks.into_inner() - first;
        assert!(later <= MAX_LATER_CHECKS, "{name}: {later} more checks after {first}");
    }
}

#[test]
fn jobs_end_at_the_check_that_cancels_them() {
    let _alone = crate::memory::alone();
    let (scene, trials) = recordings::throws(12, 40, 1);
    let config = PosteriorConfig { sets: vec![vec!["linear_drag".into()]], ..PosteriorConfig::standard(0) };
    assert_cancels("diagnosis", |p| diagnose(&scene, &trials, &DiagnosisConfig::standard(0), p).map(drop));
    assert_cancels("posterior", |p| posterior(&scene, &trials, &config, p).map(drop));
    assert_cancels("likelihood", |p| TrialLikelihood::new(&scene, &trials, &config, p).map(drop));
    let bowling = family("bowling").unwrap();
    let tasks = &bowling.tasks()[..1];
    let samples = ParameterSamples::standard_prior(bowling.prior, &[Vec::new()], 0).unwrap();
    let setup = PlanConfig::standard(0);
    assert_cancels("plan", |p| plan(&tasks[0], &samples, &setup, &p, p).map(drop));
    let setup = DesignConfig::standard(Question::Latents, 0);
    assert_cancels("design", |p| design(tasks, &[], &samples, &setup, p).map(drop));
    assert_cancels("surface", |p| surface::quick(bowling, p).map(drop));
}
