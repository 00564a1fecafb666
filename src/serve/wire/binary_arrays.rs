//! Common trait of response bodies.

use super::array::Array;

/// A response body that may contain arrays.
pub trait BinaryArrays {
    /// Takes the arrays out, by field name, for clients that accept binary arrays.
    fn take_arrays(&mut self) -> Vec<(&'static str, Array)> {
        Vec::new()
    }
}

impl BinaryArrays for crate::task::Scene {}
