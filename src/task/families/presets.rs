//! Default training and labelling settings of a family's policies, for all interfaces (HTTP, ZeroMQ, command
//! line, experiments). Tasks without a family use [`Learning::STANDARD`].

/// Training settings of a policy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Learning {
    /// Number of updates.
    pub batches: usize,
    /// Examples per update, an even number: half of them solving actions.
    pub batch_size: usize,
    /// Labelled actions for a single training run.
    pub labels: LabelCounts,
    /// Labelled actions for comparisons of policies: more than the updates need, which improves the
    /// ranking of unseen tasks (see docs/calibration.md).
    pub study_labels: LabelCounts,
}

/// Number of actions labelled for each task.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LabelCounts {
    /// Valid actions of each task.
    pub per_task: usize,
    /// A task with fewer solving actions than this gets more labels ...
    pub enough_solving: usize,
    /// ... until it has this many times `per_task`.
    pub stretch: usize,
}

impl Learning {
    /// 1000 batches of 16, as in the paper's bowling experiment. 300 labels contain 20 to 30 solving
    /// actions of a task of which one in 10 solves; rarer ones are sampled up to five times as much.
    pub const STANDARD: Learning = Learning {
        batches: 1000,
        batch_size: 16,
        labels: LabelCounts { per_task: 300, enough_solving: 15, stretch: 5 },
        study_labels: LabelCounts { per_task: 800, enough_solving: 15, stretch: 2 },
    };

    /// The settings for training until saturation: labels are reused often, so there are more of them,
    /// and batches are larger to reduce gradient noise (chosen in docs/calibration.md).
    pub fn saturating(&self) -> Learning {
        let labels = LabelCounts { per_task: self.labels.per_task.max(1000), ..self.labels };
        Learning { batch_size: self.batch_size.max(64), labels, ..*self }
    }
}
