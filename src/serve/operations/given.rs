//! What a diagnosis was given: a scene and measured trials, kept with the job.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::json::{from_value, parse};
use crate::reality::{Trial, trials_from_csv};
use crate::serve::app::App;
use crate::serve::operation::{Id, Operation, Page, READ, get};
use crate::serve::wire::{GivenOut, GivenTrials};
use crate::task::Scene;

/// What can be asked of what a diagnosis was given.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_given_trials", "/v1/diagnoses/{id}/trials", "workflow", READ)
            .about(
                "The trials that a diagnosis was given, as they were read (SI, y up), with the scene they are held \
                 against;\nfrom the moment it is queued, whatever becomes of it.",
            )
            .refuses(&[(404, ""), (409, "The job is no diagnosis")])
            .does(trials),
    ]
}

/// The kind of job that a diagnosis is.
pub const KIND: &str = "diagnose";

/// A diagnosis with everything decided; the texts are files' contents, so that no digit is lost.
#[derive(Serialize, Deserialize)]
pub struct Given {
    pub scene: String,
    pub trials: String,
    pub seed: u64,
}

impl Given {
    /// The scene and the trials.
    pub fn read(&self) -> Result<(Scene, Vec<Trial>)> {
        let scene: Scene = parse(&self.scene)?;
        let trials = trials_from_csv(&self.trials, &scene)?;
        Ok((scene, trials))
    }
}

fn trials(app: &App, (Id(id), page): (Id, Page)) -> Result<GivenTrials> {
    let row = app.jobs().get(&id)?.row;
    if row.kind != KIND || row.plan.is_null() {
        return Err(Error::Refused { reason: format!("{id} is no diagnosis that keeps its trials") });
    }
    let given: Given = from_value(row.plan)?;
    let (scene, trials) = given.read()?;
    let list = format!("trials of {id}");
    let after: Option<usize> = page.after(&list)?;
    let first = after.map_or(0, |n| n.saturating_add(1));
    let mut found: Vec<_> = trials.into_iter().enumerate().skip(first).take(page.fetch()).collect();
    let next = page.cut(&list, &mut found, |(number, _)| *number);
    Ok(GivenTrials {
        scene,
        trials: found.into_iter().map(|(_, trial)| GivenOut::from(trial)).collect(),
        next,
    })
}
