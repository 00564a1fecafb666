//! What a client can ask for: every operation is declared beside its function, and HTTP's routes, the OpenAPI document,
//! ZeroMQ's dispatch and the recipes of jobs follow from this list. docs/extending.md tells how to add one.

pub mod asked;
mod attempts;
mod batch;
mod branch;
mod closed;
mod course;
mod design;
mod diagnosis;
mod effect;
mod estimation;
mod evaluation;
mod given;
mod job;
mod learning;
mod likelihood;
mod measured;
mod plan;
mod policy;
mod posterior;
mod render;
mod rounds;
mod sketch;
mod stored;
mod surface;
mod system;
mod task;
mod text;
mod token;
mod training;
mod trials;
mod world;

use std::sync::{Arc, LazyLock};

use super::operation::Operation;
use super::problem::Answer;
use super::shared::Base;
use crate::error::Error;
use crate::job::{Recipe, Recipes};

/// A row a file.
const FILES: [fn() -> Vec<Operation>; 25] = [
    asked::operations,
    batch::operations,
    branch::operations,
    course::operations,
    design::operations,
    diagnosis::operations,
    effect::operations,
    estimation::operations,
    evaluation::operations,
    given::operations,
    job::operations,
    learning::operations,
    likelihood::operations,
    plan::operations,
    policy::operations,
    posterior::operations,
    render::operations,
    sketch::operations,
    surface::operations,
    system::operations,
    task::operations,
    token::operations,
    training::operations,
    trials::operations,
    world::operations,
];

/// All operations.
pub static OPERATIONS: LazyLock<Vec<Operation>> =
    LazyLock::new(|| FILES.iter().flat_map(|operations| operations()).collect());

/// The operation with this name, of those that ZeroMQ has.
pub fn operation(name: &str) -> Answer<&'static Operation> {
    let known = || OPERATIONS.iter().filter(|o| !o.only_http);
    known().find(|o| o.name == name).ok_or_else(|| {
        let known = known().map(|o| o.name.to_string()).collect();
        Error::NotFound { kind: "operation", id: name.into(), known }.into()
    })
}

/// How every kind of job is made from its plan.
pub fn recipes(base: &Arc<Base>) -> Recipes {
    let jobs = OPERATIONS.iter().filter_map(|o| o.job);
    jobs.map(|(kind, make)| {
        let base = base.clone();
        let recipe: Recipe = Box::new(move |plan| make(&base, plan));
        (kind, recipe)
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn names_and_kinds_of_jobs_are_given_once() {
        let names: BTreeSet<&str> = OPERATIONS.iter().map(|o| o.name).collect();
        assert_eq!(names.len(), OPERATIONS.len());
        let kinds: Vec<&str> = OPERATIONS.iter().filter_map(|o| o.job).map(|(kind, _)| kind).collect();
        assert_eq!(kinds.iter().collect::<BTreeSet<_>>().len(), kinds.len());
        assert_eq!(kinds.len(), 10, "{kinds:?}");
        assert!(operation("step_worlds").is_ok() && operation("metrics").is_err());
    }
}
