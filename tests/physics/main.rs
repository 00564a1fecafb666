//! Tasks, worlds and engines. One binary for all of them: each links the whole library.

#[path = "../../fuzz/fuzz_one.rs"]
mod fuzz_one;
#[path = "../../fuzz/json.rs"]
mod json;

mod analytic;
mod branch;
mod contact_rules;
mod effects;
mod fuzz_scene;
mod goals;
mod gpu;
mod lanes;
mod mechanism;
mod polygons;
mod properties;
mod robot_file;
mod settled;
mod shapes;
mod tasks;
mod thread_memory;
