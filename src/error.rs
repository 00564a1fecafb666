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
    #[error("no {kind} named `{}`{}", shown(id), hint(known))]
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
        let (field, value, allowed) = (shown(&field.into()), shown(&value), allowed.into());
        Error::Input(Input { place: String::new(), field, value, allowed })
    }

    /// The same error with `parent` taken off its field again.
    pub(crate) fn without(self, parent: &str) -> Self {
        match self {
            Error::Input(mut input) => {
                if let Some(field) = input.field.strip_prefix(&format!("{parent}.")) {
                    input.field = field.to_string();
                }
                Error::Input(input)
            }
            other => other,
        }
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

/// Most of a value or a field's path that an error repeats, bytes.
const MOST_SHOWN: usize = 1000;

/// A value as an error shows it: its beginning, if it is long.
pub(crate) fn shown(value: &(impl fmt::Display + ?Sized)) -> String {
    struct Cut(String);
    impl fmt::Write for Cut {
        /// Ends the writing once there is enough: what was sent may take megabytes to write.
        fn write_str(&mut self, text: &str) -> fmt::Result {
            let room = MOST_SHOWN - self.0.len().min(MOST_SHOWN);
            if text.len() <= room {
                self.0.push_str(text);
                return Ok(());
            }
            let end = (0..=room).rev().find(|i| text.is_char_boundary(*i)).unwrap_or(0);
            self.0.push_str(&text[..end]);
            self.0.push_str(" ..");
            Err(fmt::Error)
        }
    }
    let mut cut = Cut(String::new());
    let _ = fmt::Write::write_fmt(&mut cut, format_args!("{value}"));
    cut.0
}

fn hint(known: &[String]) -> String {
    if known.is_empty() { String::new() } else { format!("; there are: {}", known.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A refused name of 16 MiB came back three times.
    #[test]
    fn long_values_are_cut() {
        let long = Error::input("a".repeat(5000), "ä".repeat(5000), "less");
        let Error::Input(input) = &long else { unreachable!() };
        assert_eq!((input.field.len(), input.value.len()), (1003, 1003));
        assert!(input.value.ends_with("ä .."), "{}", input.value);
        assert_eq!(Error::input("a", 5, "less").to_string(), "`a` is 5; allowed: less");
        let exact = "b".repeat(MOST_SHOWN);
        assert_eq!(shown(&exact), exact);
        let missing = Error::NotFound { kind: "world", id: "w".repeat(9999), known: Vec::new() };
        assert!(missing.to_string().len() < 1100);
    }
}
