//! `iplw`: simulated 2D worlds, estimation of their latent factors, model discrepancy diagnosis, and policy transfer.
//!
//! The modules; each uses only those above it (a test enforces the layers):
//!
//! | module | purpose |
//! |---|---|
//! | `error` `names` `sync` `json` `rng` `progress` `budget` `trajectory` | types shared by all modules |
//! | `distribution` | Fisher's F and Student's t, for tests and intervals |
//! | `neural/` | dense layers and their training; dfdx |
//! | `task/` | scenes, actions, goals and families of tasks; plain data |
//! | `world/` | simulation: scene + latents + effects -> trajectory; the only module that uses rapier2d |
//! | `residual` | residuals between two trajectories |
//! | `reality/` | measured trials and hidden worlds; the only module that reads hidden latents |
//! | `explore/` | selection of actions to measure in the real world |
//! | `estimate/` | trials -> latents: cross-entropy method, shooting, posterior sampling |
//! | `inference/` | diagnosis of model discrepancy: the effects that the simulation lacks |
//! | `policy/` | scoring of actions |
//! | `plan/` | actions ranked by rollouts over a posterior |
//! | `design/` | optimal experimental design |
//! | `picture/` | scenes, films and plots as SVG and PNG |
//! | `experiment` | the main path: explore -> measure -> estimate -> train -> transfer -> report |
//! | `commands/` | requests shared by the command line, HTTP and MCP |
//! | `store/` `access/` `job/` | storage, permissions, and long-running jobs |
//! | `session/` | Gymnasium's reset and step for a task and a world |
//! | `control/` | the same for control tasks, in many steps, and planning |
//! | `serve/` | HTTP, ZeroMQ and MCP adapters; the only module that uses axum and rmcp; contains no physics |
//!
//! To follow one trial, start at `experiment.rs`: a [`task::Task`] and an action give a placed [`task::Scene`];
//! a [`world::Simulator`] turns it into a [`trajectory::Trajectory`]; a reality measures the same; the residual between
//! the two is the input of the estimator; the estimate grounds the simulation in which a policy is trained.
//!
//! The core (everything above `commands/`) has no clocks and no logging, and two process-wide values: the registry of task
//! families (`task::families`, filled once by `register_families` or on first use) and the fonts of `picture`, loaded on
//! first use. Its only I/O is reading the files and folders whose paths the caller passes: families of tasks, recordings
//! and JSON documents. Estimators have no access to a hidden world's latents. The library starts no threads of its own
//! (rayon for physics, tokio for serving), except one per running job.

// Files with unsafe code give the reason; SECURITY.md lists them.
#![deny(unsafe_code)]

pub mod access;
pub mod budget;
pub mod commands;
pub mod control;
pub mod design;
pub mod distribution;
pub mod error;
pub mod estimate;
pub mod experiment;
pub mod explore;
pub mod inference;
pub mod job;
pub mod json;
mod line_fit;
mod names;
pub mod neural;
pub mod number;
pub mod picture;
pub mod plan;
pub mod policy;
pub mod progress;
pub mod reality;
pub mod report;
pub mod residual;
pub mod rng;
pub mod serve;
pub mod session;
pub mod store;
pub mod sync;
pub mod task;
mod thread_priority;
pub mod trajectory;
pub mod world;
