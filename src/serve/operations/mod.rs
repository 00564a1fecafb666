//! What a client can ask for, as functions over wire structs: one dispatch for every transport.

pub mod job;
pub mod policy;
pub mod render;
pub mod task;
pub mod world;
