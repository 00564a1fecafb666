//! Jobs of all kinds.

use super::Page;
use crate::error::Result;
use crate::job::{Deleted, Job};
use crate::serve::app::App;
use crate::serve::wire::{JobOut, Jobs};

/// A page of all jobs.
pub fn list(app: &App, page: &Page) -> Result<Jobs> {
    let after: i64 = page.after("jobs")?.unwrap_or(0);
    let mut all = app.jobs.list(after, page.fetch())?;
    let next = page.cut("jobs", &mut all, |j| j.row.number);
    Ok(Jobs { jobs: all.into_iter().map(JobOut::from).collect(), next })
}

/// One job.
pub fn get(app: &App, id: &str) -> Result<JobOut> {
    Ok(app.jobs.get(id)?.into())
}

/// Cancels a job, or forgets one that has ended (`None`).
pub fn delete(app: &App, id: &str) -> Result<Option<JobOut>> {
    Ok(match app.jobs.delete(id)? {
        Deleted::Cancelled(job) => Some(Job::into(*job)),
        Deleted::Forgotten => None,
    })
}
