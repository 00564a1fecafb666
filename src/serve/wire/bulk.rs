//! Answers, as far as all of them are alike.

use super::array::Array;

/// An answer, which may hold numbers in bulk.
pub trait Bulk {
    /// Takes them out, by the name of their field, for a client that wants them as pieces of memory.
    fn bulk(&mut self) -> Vec<(&'static str, Array)> {
        Vec::new()
    }
}

impl Bulk for crate::task::Scene {}
