//! What the trials behind an estimate are worth past the point that they are read as: a policy trained over a posterior's draws, and
//! one trained at the point and then tuned on what was measured.
//!
//! Past the source, which trains at the point. Tuning on real attempts is how PHYRE's agents learn at test time (Bakhtin et al. 2019,
//! section 4: DQN-O); here it is done with the attempts that the estimate cost anyhow, before any test task is seen.

use serde::{Deserialize, Serialize};

use super::estimators::{Asked, Estimator};
use super::workflow::Workflow;
use crate::error::{Error, Result};
use crate::estimate::Believed;
use crate::policy::{Dataset, Example};
use crate::progress::Progress;
use crate::task::{Ahead, Task};

/// What an arm's trials give beside the point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PastPoint {
    /// Equally likely worlds, of the posterior of what the arm estimates.
    pub draws: Vec<Believed>,
    /// Whether the draws can be trusted.
    pub converged: bool,
    /// What became of each interaction.
    pub measured: Vec<Measured>,
}

/// One real interaction and whether it solved its task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// Id of the task.
    pub task: String,
    /// (dimension,) components in [0, 1].
    pub action: Vec<f64>,
    pub solved: bool,
}

/// Name of the study of policies that know what is not known.
pub const POLICIES: &str = "policies";

/// Draws of a posterior that labels come from.
const DRAWS: usize = 256;

/// Standard deviation of what is seen, m.
pub(super) const NOISE: f64 = 0.005;

/// Arms of the study of policies.
pub(super) const WITH_DRAG: &str = "drag fitted along";
pub(super) const WITHOUT: &str = "drag left out";

/// What the study of policies checks. Rows are named as [`over_draws`] and [`tuned`] name them.
pub(super) const BY_POLICIES: &[Ahead] = &[
    Ahead {
        text: "drag fitted along: draws beat the point",
        better: "over draws (drag fitted along)",
        worse: WITH_DRAG,
    },
    Ahead {
        text: "drag fitted along: tuned on what was measured beats the point",
        better: "tuned (drag fitted along)",
        worse: WITH_DRAG,
    },
    Ahead {
        text: "drag fitted along: draws beat domain randomisation",
        better: "over draws (drag fitted along)",
        worse: "domain randomisation",
    },
    Ahead {
        text: "drag fitted along: the point beats domain randomisation",
        better: WITH_DRAG,
        worse: "domain randomisation",
    },
    Ahead {
        text: "drag left out: draws beat the point",
        better: "over draws (drag left out)",
        worse: WITHOUT,
    },
    Ahead {
        text: "drag left out: tuned on what was measured beats the point",
        better: "tuned (drag left out)",
        worse: WITHOUT,
    },
    Ahead {
        text: "drag left out: draws beat domain randomisation",
        better: "over draws (drag left out)",
        worse: "domain randomisation",
    },
    Ahead {
        text: "drag left out: the point beats domain randomisation",
        better: WITHOUT,
        worse: "domain randomisation",
    },
];

/// Row of policies over the draws of an arm's posterior.
pub(super) fn over_draws(arm: &str) -> String {
    format!("over draws ({arm})")
}

/// Row of policies at an arm's point, tuned on its trials.
pub(super) fn tuned(arm: &str) -> String {
    format!("tuned ({arm})")
}

impl PastPoint {
    /// Of a workflow that has ended.
    pub(super) fn of(training: &[Task], workflow: &Workflow, progress: &dyn Progress) -> Result<PastPoint> {
        let config = workflow.config();
        let set = config.cem.effects_fitted();
        let base = training.first().ok_or_else(|| Error::input("tasks", "none", "at least one task"))?;
        let (prior, seed) = (config.cem.prior, config.seed);
        let engine = config.engine;
        let asked = Asked { prior, base: &base.scene, set: &set, engine, draws: DRAWS, noise: NOISE, seed };
        let told = asked.told(Estimator::Posterior, workflow.trials(), progress)?;
        let measured = workflow.rounds().iter().flat_map(|round| {
            round.answers.iter().filter_map(|answer| {
                let asked = round.proposals.iter().find(|p| p.number == answer.number)?;
                let (task, action) = (asked.task.clone(), asked.action.clone());
                Some(Measured { task, action, solved: answer.observed.solved() })
            })
        });
        Ok(PastPoint { measured: measured.collect(), draws: told.draws, converged: told.converged })
    }
}

/// Simulated labels with measured ones among them, repeated until they are half of their task's of that kind: a batch is drawn by
/// task and kind, and would else hardly ever hold one.
pub(super) fn mixed(simulated: &Dataset, measured: &[Measured]) -> Result<Dataset> {
    let mut data = simulated.clone();
    for (task, own) in simulated.tasks.iter().enumerate() {
        for solved in [true, false] {
            let kind: Vec<&Measured> =
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
    use crate::policy::{LabelConfig, Training, label};
    use crate::progress::Silent;
    use crate::task::{Labels, Split, family, split};
    use crate::world::Latents;

    #[test]
    fn measured_examples_are_half_of_their_tasks_kind() {
        let family = family("basketball").unwrap();
        let tasks = &split(&family.fold(0), Split::Train)[..2];
        let training = Training::Fixed { latents: Latents::default(), effects: Vec::new() };
        let labels = Labels { per_task: 50, enough_solving: 0, stretch: 1 };
        let simulated = label(tasks, &training, &LabelConfig::preset(&labels, 3), &Silent).unwrap();
        let failing = |data: &Dataset, task| data.rows.iter().filter(|r| r.task == task && !r.solved).count();
        let one = Measured { task: tasks[1].id.clone(), action: vec![0.5; 6], solved: false };
        let dimension = tasks[1].actions().dimension();
        let one = Measured { action: vec![0.5; dimension], ..one };
        let data = mixed(&simulated, std::slice::from_ref(&one)).unwrap();
        assert_eq!(failing(&data, 0), failing(&simulated, 0));
        assert_eq!(failing(&data, 1), 2 * failing(&simulated, 1));
        assert_eq!(data.solving(), simulated.solving());
        let elsewhere = Measured { task: "of no fold".into(), ..one };
        assert_eq!(mixed(&simulated, &[elsewhere]).unwrap().rows.len(), simulated.rows.len());
    }
}
