//! Lines of jobs' logs that the next flush writes.

/// A line that is not written yet.
pub struct Noted {
    pub job: i64,
    pub at: u64,
    pub level: Level,
    pub text: String,
}

/// How much a line matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    Info,
    Warning,
    Error,
}

impl Level {
    const ALL: [Level; 3] = [Level::Info, Level::Warning, Level::Error];

    /// The name used in the store and on the wire.
    pub fn name(self) -> &'static str {
        match self {
            Level::Info => "info",
            Level::Warning => "warning",
            Level::Error => "error",
        }
    }

    /// The level of that name.
    pub fn named(name: &str) -> Option<Level> {
        Level::ALL.into_iter().find(|l| l.name() == name)
    }
}
