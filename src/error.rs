//! The crate's one error type. Each variant carries the data that its reader needs to act on it.
//!
//! Status codes and exit codes are chosen elsewhere (`serve/http.rs`, `main.rs`). An action that cannot be
//! placed is an outcome, not an error.

use std::fmt;

/// Every error of this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// An invalid value in a user's input.
    #[error("{0}")]
    Input(InvalidInput),
    /// The named item does not exist.
    #[error("no {kind} named `{}`{}", abbreviate(id), hint(known))]
    NotFound { kind: &'static str, id: String, known: Vec<String> },
    /// The request is valid but refused.
    #[error("{reason}")]
    Refused { reason: String },
    /// A real or sealed world does not disclose its physics.
    #[error("{reason}")]
    Sealed { reason: String },
    /// A request exceeds the limit on work or data per request.
    #[error("{what}: {asked} requested, at most {limit} per request; {advice}")]
    TooLarge { what: &'static str, asked: u64, limit: u64, advice: &'static str },
    /// The request exceeds the real world's budget of interactions.
    #[error("budget of {limit} real interactions: {spent} used, {asked} requested; request at most {}", limit.saturating_sub(*spent))]
    Budget { limit: u64, spent: u64, asked: u64 },
    /// A capacity is exhausted.
    #[error("{what}: at most {limit}; {advice}")]
    Capacity { what: &'static str, limit: usize, advice: &'static str },
    /// The caller lacks the permission.
    #[error("{reason}")]
    Denied { reason: String },
    /// The work was cancelled by its owner.
    #[error("cancelled")]
    Cancelled,
    /// The time limit of the work was exceeded.
    #[error("not finished within the time limit of {seconds} s; request less work at a time")]
    Deadline { seconds: f64 },
    /// The server stopped before the work was done.
    #[error("{reason}")]
    Interrupted { reason: String },
    /// A computation has no result (non-finite loss, no placeable action, ...).
    #[error("{0}")]
    Failed(String),
    /// Reading or writing failed.
    #[error("{path}: {message}")]
    Io { path: String, message: String },
    /// Stored data is corrupted.
    #[error(
        "{what}: damaged on disk ({how}); run `iplw check DIR` to see which data are intact and how to recover"
    )]
    Damaged { what: String, how: String },
    /// An invalid entry makes the whole batch fail.
    #[error("`{field}`: {error}")]
    Entry { field: String, error: Box<Error> },
}

/// An invalid value: its place, the value and the allowed values.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InvalidInput {
    /// File and line (`trials.csv:12`), or empty.
    pub place: String,
    /// Path of the field in the user's input: `bodies[2].shape.radius`.
    pub field: String,
    /// The value as given, or empty.
    pub value: String,
    /// The allowed values as a phrase: `a number in (0, 100]`.
    pub allowed: String,
}

impl fmt::Display for InvalidInput {
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
    /// An invalid value of a field.
    pub fn input(field: impl Into<String>, value: impl fmt::Display, allowed: impl Into<String>) -> Self {
        let (field, value, allowed) = (abbreviate(&field.into()), abbreviate(&value), allowed.into());
        Error::Input(InvalidInput { place: String::new(), field, value, allowed })
    }

    /// A missing item, with the names of the existing ones.
    pub fn not_found<K: fmt::Display>(
        kind: &'static str,
        id: impl Into<String>,
        known: impl IntoIterator<Item = K>,
    ) -> Self {
        Error::NotFound { kind, id: id.into(), known: known.into_iter().map(|k| k.to_string()).collect() }
    }

    /// The same error; an unknown name is an invalid value of `field`.
    pub fn unknown_in(self, field: &str) -> Self {
        match self {
            Error::NotFound { id, known, .. } => {
                Error::input(field, format!("{id:?}"), format!("one of {}", known.join(", ")))
            }
            other => other,
        }
    }

    /// The same error; an invalid value is changed.
    pub fn map_input(mut self, change: impl FnOnce(&mut InvalidInput)) -> Self {
        if let Error::Input(input) = &mut self {
            change(input);
        }
        self
    }

    /// The same error without the prefix `parent` of its field.
    pub(crate) fn strip_field(self, parent: &str) -> Self {
        self.map_input(|input| {
            if let Some(field) = input.field.strip_prefix(&format!("{parent}.")) {
                input.field = field.to_string();
            }
        })
    }

    /// The same error with the file (and line) as its place.
    pub fn in_file(self, file: impl fmt::Display) -> Self {
        self.map_input(|input| {
            input.place =
                if input.place.is_empty() { file.to_string() } else { format!("{file}:{}", input.place) };
        })
    }

    /// The same error with its field's path prefixed: `radius` in `bodies[2]` becomes `bodies[2].radius`.
    pub fn in_field(self, parent: &str) -> Self {
        self.map_input(|input| {
            input.field = match input.field.as_str() {
                "" => parent.to_string(),
                field => format!("{parent}.{field}"),
            };
        })
    }

    /// The same error with the field `name`.
    pub fn with_field(self, name: &str) -> Self {
        self.map_input(|input| input.field = name.into())
    }

    /// The same error for an entry of a batch; an invalid value, which names its field, stays unchanged.
    pub fn for_entry(self, field: &str) -> Self {
        match self {
            Error::Input(_) => self,
            error => Error::Entry { field: field.into(), error: Box::new(error) },
        }
    }

    /// The error of reading or writing `path`.
    pub fn io(path: &std::path::Path, error: std::io::Error) -> Self {
        Error::Io { path: path.display().to_string(), message: error.to_string() }
    }
}

/// Shorthand used throughout the crate.
pub type Result<T> = std::result::Result<T, Error>;

/// `Ok(value)` if it is finite and within `[low, high]`, otherwise an error naming `field`.
pub fn check_range(field: &str, value: f64, low: f64, high: f64) -> Result<f64> {
    if value.is_finite() && (low..=high).contains(&value) {
        Ok(value)
    } else {
        Err(Error::input(field, value, format!("a number from {low} to {high}")))
    }
}

/// An error naming `field` unless the value, if any, is within `[low, high]`.
pub fn check_count<T: PartialOrd + fmt::Display + Copy>(
    field: &str,
    value: impl Into<Option<T>>,
    low: T,
    high: T,
) -> Result<()> {
    match value.into() {
        Some(v) if !(low..=high).contains(&v) => {
            Err(Error::input(field, v, format!("a whole number from {low} to {high}")))
        }
        _ => Ok(()),
    }
}

/// Errors unless a document's `format` is the expected one.
pub fn check_format(format: &str, expected: &str) -> Result<()> {
    match format == expected {
        true => Ok(()),
        false => Err(Error::input("format", format!("{format:?}"), format!("{expected:?}"))),
    }
}

/// Maximum length of a value or field path in an error message, bytes.
const MAX_QUOTED_BYTES: usize = 1000;

/// A value as shown in an error message: truncated if it is long.
pub(crate) fn abbreviate(value: &(impl fmt::Display + ?Sized)) -> String {
    struct TruncatingWriter(String);
    impl fmt::Write for TruncatingWriter {
        /// Stops the formatter at the limit: formatting the whole value may take megabytes.
        fn write_str(&mut self, text: &str) -> fmt::Result {
            let room = MAX_QUOTED_BYTES - self.0.len().min(MAX_QUOTED_BYTES);
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
    let mut cut = TruncatingWriter(String::new());
    let _ = fmt::Write::write_fmt(&mut cut, format_args!("{value}"));
    cut.0
}

fn hint(known: &[String]) -> String {
    if known.is_empty() { String::new() } else { format!("; known: {}", known.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Regression: a rejected name of 16 MiB was repeated three times.
    #[test]
    fn truncates_long_values() {
        let long = Error::input("a".repeat(5000), "ä".repeat(5000), "less");
        let Error::Input(input) = &long else { unreachable!() };
        assert_eq!((input.field.len(), input.value.len()), (1003, 1003));
        assert!(input.value.ends_with("ä .."), "{}", input.value);
        assert_eq!(Error::input("a", 5, "less").to_string(), "`a` is 5; allowed: less");
        let exact = "b".repeat(MAX_QUOTED_BYTES);
        assert_eq!(abbreviate(&exact), exact);
        let missing = Error::NotFound { kind: "world", id: "w".repeat(9999), known: Vec::new() };
        assert!(missing.to_string().len() < 1100);
    }
}
