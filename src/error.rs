//! The one error type. Each variant carries what its reader needs to act on it.
//!
//! Status codes and exit codes are decided elsewhere (`serve/http.rs`, `main.rs`); a variant only says
//! what went wrong. An action that cannot be placed is an outcome and never appears here.

use std::fmt;

/// Everything that can go wrong in this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// A value a user gave is not allowed.
    #[error("{0}")]
    Input(Input),
    /// Something was named that does not exist.
    #[error("no {kind} named `{id}`{}", hint(known))]
    NotFound { kind: &'static str, id: String, known: Vec<String> },
    /// The request is understood and will not be carried out.
    #[error("{reason}")]
    Refused { reason: String },
    /// A real or sealed world keeps its physics to itself.
    #[error("{reason}")]
    Sealed { reason: String },
    /// One request asks for more work or data than is given at a time.
    #[error("{what}: {asked} asked for, at most {limit} at a time; {advice}")]
    TooLarge { what: &'static str, asked: u64, limit: u64, advice: &'static str },
    /// The real world's budget of interactions does not cover the request.
    #[error("budget of {limit} real interactions: {spent} spent, {asked} asked for; ask for at most {}", limit.saturating_sub(*spent))]
    Budget { limit: u64, spent: u64, asked: u64 },
    /// No room for more of something.
    #[error("{what}: at most {limit}; {advice}")]
    Capacity { what: &'static str, limit: usize, advice: &'static str },
    /// Whoever asks may not do this.
    #[error("{reason}")]
    Denied { reason: String },
    /// The work was cancelled by its owner.
    #[error("cancelled")]
    Cancelled,
    /// The time that the work was given is over.
    #[error("not done within {seconds} s, the time there is for it; ask for less at a time")]
    Deadline { seconds: f64 },
    /// The server stopped before the work was done.
    #[error("{reason}")]
    Interrupted { reason: String },
    /// A computation could not produce a result (loss not finite, no placeable action, ...).
    #[error("{0}")]
    Failed(String),
    /// Reading or writing failed.
    #[error("{path}: {message}")]
    Io { path: String, message: String },
    /// What was stored is not what was written.
    #[error(
        "{what}: damaged on the disk ({how}); `iplw check DIR` tells what is whole there and how to go on"
    )]
    Damaged { what: String, how: String },
    /// One entry of a batch stands in the way of all of it.
    #[error("`{field}`: {error}")]
    Entry { field: String, error: Box<Error> },
}

/// A refused value: where it stands, what it was, what would be allowed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Input {
    /// File and line (`trials.csv:12`), or empty.
    pub place: String,
    /// Path of the field, as the user wrote it: `bodies[2].shape.radius`.
    pub field: String,
    /// The value as given, or empty.
    pub value: String,
    /// What is allowed, as a phrase: `a number in (0, 100]`.
    pub allowed: String,
}

impl fmt::Display for Input {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.place.is_empty() {
            write!(f, "{}: ", self.place)?;
        }
        if !self.field.is_empty() {
            write!(f, "`{}`", self.field)?;
        }
        if !self.value.is_empty() {
            f.write_str(if self.field.is_empty() { "" } else { " is " })?;
            f.write_str(&self.value)?;
        }
        if !(self.field.is_empty() && self.value.is_empty()) {
            f.write_str("; ")?;
        }
        write!(f, "allowed: {}", self.allowed)
    }
}

impl Error {
    /// A refused value of a field.
    pub fn input(field: impl Into<String>, value: impl fmt::Display, allowed: impl Into<String>) -> Self {
        let (field, value, allowed) = (field.into(), value.to_string(), allowed.into());
        Error::Input(Input { place: String::new(), field, value, allowed })
    }

    /// The same error with the file (and line) it was found in put in front.
    pub fn at(self, file: impl fmt::Display) -> Self {
        match self {
            Error::Input(mut input) => {
                input.place =
                    if input.place.is_empty() { file.to_string() } else { format!("{file}:{}", input.place) };
                Error::Input(input)
            }
            other => other,
        }
    }

    /// The same error with its field's path prefixed: `radius` under `bodies[2]` is `bodies[2].radius`.
    pub fn under(self, parent: &str) -> Self {
        match self {
            Error::Input(mut input) => {
                input.field = match input.field.as_str() {
                    "" => parent.to_string(),
                    field => format!("{parent}.{field}"),
                };
                Error::Input(input)
            }
            other => other,
        }
    }

    /// The same error with its field called `name`.
    pub fn named(self, name: &str) -> Self {
        match self {
            Error::Input(input) => Error::Input(Input { field: name.into(), ..input }),
            other => other,
        }
    }

    /// The same error said of an entry of a batch; one that names the entry's field already stays as it is.
    pub fn of_entry(self, field: &str) -> Self {
        match self {
            Error::Input(_) => self,
            error => Error::Entry { field: field.into(), error: Box::new(error) },
        }
    }

    /// Reading or writing `path` failed.
    pub fn io(path: &std::path::Path, error: std::io::Error) -> Self {
        Error::Io { path: path.display().to_string(), message: error.to_string() }
    }
}

/// Shorthand used throughout the crate.
pub type Result<T> = std::result::Result<T, Error>;

/// `Ok(value)` if it is finite and within `[low, high]`, else an error naming `field`.
pub fn within(field: &str, value: f64, low: f64, high: f64) -> Result<f64> {
    if value.is_finite() && (low..=high).contains(&value) {
        Ok(value)
    } else {
        Err(Error::input(field, value, format!("a number from {low} to {high}")))
    }
}

fn hint(known: &[String]) -> String {
    if known.is_empty() { String::new() } else { format!("; there are: {}", known.join(", ")) }
}
