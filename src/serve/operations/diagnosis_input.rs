//! Input of a diagnosis: a scene and measured trials, stored with the job.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::json::{from_value, parse};
use crate::progress::{NoProgress, Progress};
use crate::reality::{Trial, read_trials_csv};
use crate::serve::operation::{Operation, Pagination, PathId, READ, get};
use crate::serve::request_context::RequestContext;
use crate::serve::wire::{DiagnosisTrialOut, DiagnosisTrials};
use crate::task::Scene;

/// Operations on the input of a diagnosis.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_diagnosis_trials", "/v1/diagnoses/{id}/trials", "workflow", READ)
            .about(
                "Lists the trials of a diagnosis as they were read (SI units, y up), with the scene they are compared with. \
                 Available\nas soon as the job is queued.",
            )
            .errors(&[(404, ""), (409, "The job is not a diagnosis")])
            .handler(trials),
    ]
}

/// Kind of a diagnosis's job.
pub const KIND: &str = "diagnose";

/// A fully specified diagnosis. Scene and trials are stored as file contents, so that no digit is lost.
#[derive(Serialize, Deserialize)]
pub struct DiagnosisInput {
    pub scene: String,
    pub trials: String,
    pub seed: u64,
}

impl DiagnosisInput {
    /// The scene and the trials, unless `progress` ends it before.
    pub fn read(&self, progress: &dyn Progress) -> Result<(Scene, Vec<Trial>)> {
        progress.report("reading the trials", 0, 1)?;
        let scene: Scene = parse(&self.scene)?;
        let trials = read_trials_csv(&self.trials, &scene, &progress)?;
        Ok((scene, trials))
    }
}

fn trials(app: &RequestContext, (PathId(id), page): (PathId, Pagination)) -> Result<DiagnosisTrials> {
    let row = app.jobs().get(&id)?.row;
    if row.kind != KIND || row.plan.is_null() {
        return Err(Error::Refused { reason: format!("{id} is not a diagnosis with stored trials") });
    }
    let given: DiagnosisInput = from_value(row.plan)?;
    let (scene, trials) = given.read(&NoProgress)?;
    let list = format!("trials of {id}");
    let after: Option<usize> = page.after(&list)?;
    let first = after.map_or(0, |n| n.saturating_add(1));
    let mut found: Vec<_> = trials.into_iter().enumerate().skip(first).take(page.fetch_limit()).collect();
    let next = page.truncate(&list, &mut found, |(number, _)| *number);
    Ok(DiagnosisTrials {
        scene,
        trials: found.into_iter().map(|(_, trial)| DiagnosisTrialOut::from(trial)).collect(),
        next,
    })
}
