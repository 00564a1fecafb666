//! Synthetic data for unit tests.

pub mod segments;
pub mod throws;
