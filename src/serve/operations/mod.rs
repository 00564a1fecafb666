//! The API's operations. Each is declared next to its handler; HTTP routes, the OpenAPI document, ZeroMQ dispatch and job
//! factories derive from this list. See docs/how-to/extend.md for how to add one.

mod adhoc;
pub mod ask_tell;
mod batch;
mod branch;
mod control;
mod design;
mod diagnosis;
mod diagnosis_input;
mod effect;
mod estimation;
mod evaluation;
mod finished_round;
mod history;
mod job;
mod json;
mod learning;
mod likelihood;
mod measurements;
mod plan;
mod policy;
mod policy_store;
mod posterior;
mod render;
mod report;
mod rollouts;
mod rounds;
mod surface;
mod system;
mod task;
mod token;
mod training;
mod trials;
mod world;

use std::sync::{Arc, LazyLock};

use super::operation::Operation;
use super::problem::HandlerResult;
use super::state::CoreState;
use crate::error::Error;
use crate::job::{WorkFactories, WorkFactory};

/// The operations of each file.
const OPERATION_LISTS: [fn() -> Vec<Operation>; 27] = [
    ask_tell::operations,
    batch::operations,
    branch::operations,
    history::operations,
    control::operations,
    design::operations,
    diagnosis::operations,
    effect::operations,
    estimation::operations,
    evaluation::operations,
    diagnosis_input::operations,
    job::operations,
    learning::operations,
    likelihood::operations,
    plan::operations,
    policy::operations,
    posterior::operations,
    render::operations,
    report::operations,
    adhoc::operations,
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
    LazyLock::new(|| OPERATION_LISTS.iter().flat_map(|operations| operations()).collect());

/// The operation with this name, unless it is only available over HTTP.
pub fn operation(name: &str) -> HandlerResult<&'static Operation> {
    let known = || OPERATIONS.iter().filter(|o| !o.http_only);
    known().find(|o| o.name == name).ok_or_else(|| {
        let known = known().map(|o| o.name.to_string()).collect();
        Error::NotFound { kind: "operation", id: name.into(), known }.into()
    })
}

/// Factories that build the work of each kind of job from its stored plan.
pub fn work_factories(base: &Arc<CoreState>) -> WorkFactories {
    let jobs = OPERATIONS.iter().filter_map(|o| o.job);
    jobs.map(|(kind, make)| {
        let base = base.clone();
        let factory: WorkFactory = Box::new(move |plan| make(&base, plan));
        (kind, factory)
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::job::summarized_kinds;

    #[test]
    fn operation_names_and_job_kinds_are_unique() {
        let names: BTreeSet<&str> = OPERATIONS.iter().map(|o| o.name).collect();
        assert_eq!(names.len(), OPERATIONS.len());
        let kinds: Vec<&str> = OPERATIONS.iter().filter_map(|o| o.job).map(|(kind, _)| kind).collect();
        assert_eq!(kinds.iter().collect::<BTreeSet<_>>().len(), kinds.len());
        assert!(kinds.iter().all(|kind| summarized_kinds().any(|known| known == *kind)), "{kinds:?}");
        assert_eq!(kinds.len(), 10, "{kinds:?}");
        assert!(operation("step_worlds").is_ok() && operation("metrics").is_err());
    }
}
