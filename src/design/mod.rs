//! Bayesian experimental design: the experiment with the largest expected information gain about a question, given posterior samples.
//!
//! Every candidate action is simulated in worlds sampled from the posterior. The expected information gain is the mutual information
//! between the answer to the question and the observations, in nats.
//!
//! Sources: Lindley 1956 (expected information as utility of an experiment); Chaloner and Verdinelli 1995, section 2; nested Monte
//! Carlo: Ryan 2003, Rainforth et al. 2018; density of observations from samples by shrunk kernels: West 1993.
//!
//! Differences from the source: the spread between repetitions of an action (actuation noise) counts as noise, in addition to the
//! camera's; it is simulated by perturbed copies of every action, since chaos would look like information otherwise. The outer sample
//! is a held-out copy, and a world is left out of the density of its own observations. Every set of effects in question has the same
//! number of inner samples.
//!
//! Range of validity: n sampled worlds bound the estimate by about log n, so very informative actions can't be ranked among each other
//! under a broad prior. Measure one of them and design again.
//!
//! | file | contents |
//! |---|---|
//! | `config` | configuration |
//! | `costs` | costs of experiments, and the greedy choice by gain per cost |
//! | `question` | questions |
//! | `worlds` | worlds sampled from the posterior |
//! | `predicted_observations` | observations of an action in every world, with actuation noise |
//! | `smooth` | Gaussian-process regression of observations on a world's parameters |
//! | `likelihood` | log densities of one world's observations given another world |
//! | `gain` | expected information gain |
//! | `screening` | evaluation of candidates |
//! | `posterior_sd` | expected posterior standard deviations of parameters |
//! | `search` | the design: candidates, screening, shortlist, batch |
//! | `document` | `iplw.design/1` |
//! | `excitation` | commands of motors that tell effects in joints apart |

mod config;
mod costs;
mod document;
mod excitation;
mod gain;
mod likelihood;
mod posterior_sd;
mod predicted_observations;
mod question;
mod screening;
mod search;
mod smooth;
mod worlds;

pub use config::DesignConfig;
pub use costs::{Costs, rounded as rounded_cost};
pub use document::{DESIGN_FORMAT, DesignDocument, ExperimentRow, document};
pub use excitation::{
    EXCITATION_FORMAT, Excitation, ExcitationConfig, ExcitationDesign, ExcitationGoal, design_excitations,
};
pub use gain::{AnswerPartition, InformationGain, information_gain};
pub use posterior_sd::ExpectedSd;
pub use question::Question;
pub use search::{Design, Experiment, design, screening_worlds, training_and_test_tasks};
