//! How policies of a family are trained and their actions labelled if nobody says otherwise. Every way in (HTTP,
//! ZeroMQ, command line, experiments) takes them from here; what stands for tasks of no family is
//! [`Learning::STANDARD`].

/// Training of a policy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Learning {
    /// Updates.
    pub batches: usize,
    /// Examples per update, an even number: half of them solving.
    pub batch_size: usize,
    /// Labelled actions of a training on its own.
    pub labels: Labels,
    /// Labelled actions where policies are compared: more than the batches can use rank unseen tasks better (0.61 to
    /// 0.65 AUCCESS on bowling from 250 to 800).
    pub study_labels: Labels,
}

/// How many actions of each task are labelled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Labels {
    /// Valid actions of each task.
    pub per_task: usize,
    /// A task with fewer solving actions than this gets further ones...
    pub enough_solving: usize,
    /// ... until it has this many times `per_task`.
    pub stretch: usize,
}

impl Learning {
    /// 1000 batches of 16, as in the paper's bowling. 300 labels leave 20 to 30 solving actions for a task of which 1
    /// in 10 solves; rarer ones are searched five times as long.
    pub const STANDARD: Learning = Learning {
        batches: 1000,
        batch_size: 16,
        labels: Labels { per_task: 300, enough_solving: 15, stretch: 5 },
        study_labels: Labels { per_task: 800, enough_solving: 15, stretch: 2 },
    };

    /// The same for a training that goes on for as long as it helps: it sees a label often, so it takes more of them, and
    /// batches that are large enough not to shake what was learned. On bowling with the true physics 300 labels a task and batches
    /// of 16 are best after 1000 batches (AUCCESS on validation tasks 0.87, then falling to 0.70); 1000 labels and batches of 64
    /// go on to 0.98 after 7000.
    pub fn saturating(&self) -> Learning {
        let labels = Labels { per_task: self.labels.per_task.max(1000), ..self.labels };
        Learning { batch_size: self.batch_size.max(64), labels, ..*self }
    }
}
