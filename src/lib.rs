pub mod error;
pub mod json;
pub mod progress;
pub mod rng;
pub mod task;
pub mod trajectory;
pub mod world;
