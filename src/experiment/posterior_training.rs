//! Training beyond the point estimate: a policy trained over the posterior draws given the trials, and a policy trained at the point
//! estimate and then fine-tuned on the measured outcomes.
//!
//! Beyond the source, which trains at the point estimate. PHYRE's agents learn from real attempts at test time (Bakhtin et al. 2019,
//! section 4: DQN-O); here the attempts are those already used for the estimate, and no test task is used.

use serde::{Deserialize, Serialize};

use super::estimators::{Estimator, EstimatorInput};
use super::workflow::Workflow;
use crate::error::{Error, Result};
use crate::estimate::ParameterSample;
use crate::policy::{Dataset, Example};
use crate::progress::Progress;
use crate::task::{JumpStartClaim, Task};

/// Training data from an arm's trials, in addition to the point estimate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PosteriorTrainingData {
    /// Equally weighted posterior draws of the arm's parameters.
    pub draws: Vec<ParameterSample>,
    /// Whether the sampler converged.
    pub converged: bool,
    /// Outcome of each interaction.
    pub measured: Vec<MeasuredOutcome>,
}

/// One real interaction and whether it solved its task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasuredOutcome {
    /// Id of the task.
    pub task: String,
    /// (dimension,) components in [0, 1].
    pub action: Vec<f64>,
    pub solved: bool,
}

/// Name of the study of policies that account for posterior uncertainty.
pub const POLICIES: &str = "policies";

/// Posterior draws used for labelling.
const DRAWS: usize = 256;

/// Standard deviation of the measurement noise, m.
pub(super) const MEASUREMENT_NOISE_SD_M: f64 = 0.005;

/// Arms of the study of policies.
pub(super) const WITH_DRAG: &str = "drag fitted along";
pub(super) const WITHOUT_DRAG: &str = "drag left out";

/// Claims that the study of policies checks. Row names are those of [`posterior_row_name`] and [`tuned_row_name`].
pub(super) const POLICY_CLAIMS: &[JumpStartClaim] = &[
    JumpStartClaim::new(
        "drag fitted along: draws beat the point",
        "over draws (drag fitted along)",
        WITH_DRAG,
    ),
    JumpStartClaim::new(
        "drag fitted along: tuned on what was measured beats the point",
        "tuned (drag fitted along)",
        WITH_DRAG,
    ),
    JumpStartClaim::new(
        "drag fitted along: draws beat domain randomisation",
        "over draws (drag fitted along)",
        "domain randomisation",
    ),
    JumpStartClaim::new(
        "drag fitted along: the point beats domain randomisation",
        WITH_DRAG,
        "domain randomisation",
    ),
    JumpStartClaim::new("drag left out: draws beat the point", "over draws (drag left out)", WITHOUT_DRAG),
    JumpStartClaim::new(
        "drag left out: tuned on what was measured beats the point",
        "tuned (drag left out)",
        WITHOUT_DRAG,
    ),
    JumpStartClaim::new(
        "drag left out: draws beat domain randomisation",
        "over draws (drag left out)",
        "domain randomisation",
    ),
    JumpStartClaim::new(
        "drag left out: the point beats domain randomisation",
        WITHOUT_DRAG,
        "domain randomisation",
    ),
];

/// Row name of policies trained over an arm's posterior draws.
pub(super) fn posterior_row_name(arm: &str) -> String {
    format!("over draws ({arm})")
}

/// Row name of policies trained at an arm's point estimate and fine-tuned on its trials.
pub(super) fn tuned_row_name(arm: &str) -> String {
    format!("tuned ({arm})")
}

impl PosteriorTrainingData {
    /// Training data of a finished workflow.
    pub(super) fn of(
        training: &[Task],
        workflow: &Workflow,
        progress: &dyn Progress,
    ) -> Result<PosteriorTrainingData> {
        let config = workflow.config();
        let set = config.cem.free_effects();
        let base = training.first().ok_or_else(|| Error::input("tasks", "none", "at least one task"))?;
        let (prior, seed) = (config.cem.prior, config.seed);
        let engine = config.engine;
        let asked = EstimatorInput {
            prior,
            base: &base.scene,
            set: &set,
            engine,
            draws: DRAWS,
            noise: MEASUREMENT_NOISE_SD_M,
            seed,
        };
        let told = asked.estimate(Estimator::Posterior, workflow.trials(), progress)?;
        let measured = workflow.rounds().iter().flat_map(|round| {
            round.answers.iter().filter_map(|answer| {
                let asked = round.proposals.iter().find(|p| p.number == answer.number)?;
                let (task, action) = (asked.task.clone(), asked.action.clone());
                Some(MeasuredOutcome { task, action, solved: answer.observed.solved() })
            })
        });
        Ok(PosteriorTrainingData {
            measured: measured.collect(),
            draws: told.draws,
            converged: told.converged,
        })
    }
}

/// Simulated examples mixed with measured ones. The measured examples of each task and outcome are repeated until they are half of
/// that group, since batches are drawn by task and outcome and would otherwise rarely contain one.
pub(super) fn mix_examples(simulated: &Dataset, measured: &[MeasuredOutcome]) -> Result<Dataset> {
    let mut data = simulated.clone();
    for (task, own) in simulated.tasks.iter().enumerate() {
        for solved in [true, false] {
            let kind: Vec<&MeasuredOutcome> =
                measured.iter().filter(|m| m.task == own.id && m.solved == solved).collect();
            let among = simulated.rows.iter().filter(|r| r.task == task && r.solved == solved).count();
            let rows: Vec<Example> = kind
                .iter()
                .map(|m| Ok(Example { task, action: own.actions().validate(&m.action)?, solved }))
                .collect::<Result<_>>()?;
            let wanted = among.max(rows.len());
            data.rows.extend(rows.iter().cycle().take(wanted).cloned());
        }
    }
    Ok(data)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::{LabelConfig, TrainingPhysics, label};
    use crate::progress::NoProgress;
    use crate::task::{LabelCounts, Split, family, split};
    use crate::world::Latents;

    #[test]
    fn measured_examples_are_half_of_their_tasks_kind() {
        let family = family("basketball").unwrap();
        let tasks = &split(&family.fold(0), Split::Train)[..2];
        let training = TrainingPhysics::Fixed { latents: Latents::default(), effects: Vec::new() };
        let labels = LabelCounts { per_task: 50, enough_solving: 0, stretch: 1 };
        let simulated = label(tasks, &training, &LabelConfig::preset(&labels, 3), &NoProgress).unwrap();
        let failing = |data: &Dataset, task| data.rows.iter().filter(|r| r.task == task && !r.solved).count();
        let one = MeasuredOutcome { task: tasks[1].id.clone(), action: vec![0.5; 6], solved: false };
        let dimension = tasks[1].actions().dimension();
        let one = MeasuredOutcome { action: vec![0.5; dimension], ..one };
        let data = mix_examples(&simulated, std::slice::from_ref(&one)).unwrap();
        assert_eq!(failing(&data, 0), failing(&simulated, 0));
        assert_eq!(failing(&data, 1), 2 * failing(&simulated, 1));
        assert_eq!(data.solving(), simulated.solving());
        let elsewhere = MeasuredOutcome { task: "of no fold".into(), ..one };
        assert_eq!(mix_examples(&simulated, &[elsewhere]).unwrap().rows.len(), simulated.rows.len());
    }
}
