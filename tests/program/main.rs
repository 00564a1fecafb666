//! The program as a user runs it, and the shape of its sources.

#[path = "../discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with others, which use the rest")]
mod worlds;

mod agents_cli;
mod cli;
mod design_cli;
mod discover_cli;
mod families;
mod families_cli;
mod foreign_files;
mod gpu_cli;
mod import_cli;
mod joints_cli;
mod kernel;
mod language;
mod layers;
mod plan_cli;
mod sources;
mod tracks_cli;
mod unsafety;
