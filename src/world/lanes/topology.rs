//! Topology: the properties that rollouts of one batch share.

/// The properties that rollouts of one batch have in common: the layout of its data.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Topology {
    /// Corners of each piece of each body; empty for a disc.
    pub bodies: Vec<Vec<usize>>,
    /// Index of the static and number of corners of each piece; 0 corners for a half plane.
    pub statics: Vec<(usize, usize)>,
    /// Numbers of the scene's own bodies and statics; added ones follow.
    pub own: [usize; 2],
    /// Indices in the registry of the effects with a law of motion, and of contact, in order of application.
    pub motion_laws: Vec<usize>,
    pub contact_laws: Vec<usize>,
    /// Whether an effect depends on time.
    pub clocked: bool,
    /// Whether rollouts begin with established contacts.
    pub contacts_established: bool,
    /// Bits of the time step.
    pub time_step: u64,
    pub goal: Option<GoalTopology>,
}

/// The kind of a goal and its objects: bodies, then statics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum GoalTopology {
    Inside { body: usize },
    Contact { objects: [usize; 2] },
    Apart { objects: [usize; 2] },
    Above { body: usize, whole: bool },
}

impl Topology {
    /// Whether a body is a disc.
    pub fn is_disc(&self, body: usize) -> bool {
        self.bodies[body].is_empty()
    }
}
