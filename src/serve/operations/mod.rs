//! What a client can ask for, as functions over wire structs: one dispatch for every transport.

pub mod asked;
mod attempts;
pub mod batch;
pub mod diagnosis;
pub mod dispatch;
pub mod estimation;
pub mod evaluation;
pub mod job;
pub mod learning;
pub mod once;
mod page;
pub mod policy;
pub mod render;
pub mod surface;
pub mod system;
pub mod task;
pub mod trials;
pub mod world;

use std::sync::Arc;

use serde::Serialize;
use serde_json::Value;

use super::app::Base;
use crate::error::{Error, Result};
use crate::job::{Recipe, Recipes, Work};
use crate::store::Answered;
pub use page::Page;

/// What is to be kept of an answer together with its effect; nothing, if nobody asked for that.
pub type Keep<'a, T> = &'a dyn Fn(&T) -> Option<Answered>;

/// How every kind of job is made from its plan.
pub fn recipes(base: &Arc<Base>) -> Recipes {
    let recipe = |make: fn(&Arc<Base>, &Value) -> Result<Work>| -> Recipe {
        let base = base.clone();
        Box::new(move |plan| make(&base, plan))
    };
    Recipes::from([
        (diagnosis::KIND, recipe(diagnosis::work)),
        (estimation::KIND, recipe(estimation::work)),
        (surface::KIND, recipe(surface::work)),
        (policy::TRAIN, recipe(policy::training_work)),
        (learning::KIND, recipe(learning::work)),
        (evaluation::KIND, recipe(evaluation::work)),
    ])
}

/// Something of ours as JSON.
fn json<T: Serialize>(value: &T) -> Result<Value> {
    serde_json::to_value(value).map_err(unwritable)
}

/// The same as text, whose numbers keep all their digits.
fn text<T: Serialize>(value: &T) -> Result<String> {
    serde_json::to_string(value).map_err(unwritable)
}

fn unwritable(e: serde_json::Error) -> Error {
    Error::Failed(format!("this cannot be written as JSON: {e}"))
}
