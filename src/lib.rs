//! `iplw`: worlds to act in, latent factors to estimate, policies to transfer.
//!
//! The rooms, each using only those above it (a test holds them to it):
//!
//! | room | what it does |
//! |---|---|
//! | `error` `json` `rng` `progress` `budget` `trajectory` | the words everybody speaks |
//! | `distribution` | Fisher's and Student's, for intervals |
//! | `neural/` | layers of small networks, and how they learn; dfdx |
//! | `task/` | what is asked: scenes, actions, goals; plain data |
//! | `world/` | what physics does: scene + latents + effects -> trajectory; sole home of rapier2d |
//! | `residual` | two trajectories -> how far apart |
//! | `reality/` | where measured trials come from; sole keeper of hidden latents |
//! | `explore/` | which actions to spend on the real world |
//! | `estimate/` | trials -> latents, by the cross-entropy method; what performance asks of them |
//! | `discover/` | measured minus simulated -> what the simulation lacks |
//! | `policy/` | scoring actions |
//! | `plan/` | actions ranked by rollouts under what is believed |
//! | `design/` | which experiment would tell the most about a question |
//! | `picture/` | scenes, films and plots as SVG and PNG |
//! | `experiment` | the main path: explore -> measure -> estimate -> train -> transfer -> report |
//! | `store/` `access/` `job/` | what lasts, who may do what, and work that takes long |
//! | `session/` | Gymnasium's reset and step over a task and a world |
//! | `serve/` | HTTP, ZeroMQ and MCP: thin adapters; sole home of axum and rmcp; knows no physics |
//!
//! Follow one trial from `experiment.rs`: a [`task::Task`] and an action give a placed [`task::Scene`];
//! [`world::simulate`] turns it into a [`trajectory::Trajectory`]; a reality measures the same; the residual
//! between the two drives the estimator; the estimate grounds the simulation a policy is trained in.
//!
//! Deliberately absent: clocks, I/O and globals in the core (everything above `store/`); any way for an
//! estimator to read a hidden world's latents; threads of our own (rayon for physics, tokio for serving), but for one
//! a running job.

// Where it is needed, its file says why; SECURITY.md lists those files.
#![deny(unsafe_code)]

pub mod access;
pub mod budget;
pub mod design;
pub mod discover;
pub mod distribution;
pub mod error;
pub mod estimate;
pub mod experiment;
pub mod explore;
pub mod job;
pub mod json;
pub mod neural;
pub mod picture;
pub mod plan;
pub mod policy;
pub mod progress;
pub mod reality;
pub mod residual;
pub mod rng;
pub mod serve;
pub mod session;
pub mod store;
pub mod task;
pub mod trajectory;
pub mod world;
