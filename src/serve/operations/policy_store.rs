//! Stored and built-in policies.

use serde_json::Value;

use crate::error::{Error, Result};
use crate::job::JobContext;
use crate::policy::{Dqn, Policy};
use crate::serve::request_context::RequestContext;
use crate::store::{PolicyRow, Store};
use crate::task::Task;

/// Built-in policy that tries actions in random order.
pub const RANDOM: &str = "random";
/// Built-in policy for rankings sent by the client.
pub const RANKED: &str = "ranked";
/// Built-in policy without training.
pub const UNTRAINED: &str = "untrained";
/// Built-in policies with their descriptions.
pub const BUILT_IN_POLICIES: [(&str, &str); 3] = [
    (RANDOM, "tries actions in random order; can act and be evaluated"),
    (RANKED, "the client's own ranking of actions; can be evaluated"),
    (UNTRAINED, "random initial weights; learning from it is direct learning"),
];

/// The policy as it was when the job started, even if it was replaced since; `now` are its current weights.
pub fn load_for_job(store: &Store, job: i64, id: &str, now: Option<Vec<u8>>) -> Result<Dqn> {
    let weights = match (store.artifact(job, WEIGHTS_ARTIFACT)?, now) {
        (Some(kept), _) => kept,
        (None, Some(now)) => {
            store.put_artifact(job, WEIGHTS_ARTIFACT, &now)?;
            now
        }
        (None, None) => return Err(unknown(id)),
    };
    Dqn::from_safetensors(&weights)
}

/// Name of the job artifact with the initial weights.
const WEIGHTS_ARTIFACT: &str = "weights";

/// `policy-3` for `job-3`, with a suffix if a client has uploaded weights under that name. A restarted job reuses its own.
fn policy_id_for_job(store: &Store, job: &str) -> Result<String> {
    let wanted = job.replace("job", "policy");
    let mut id = wanted.clone();
    let mut n = 1;
    while store.policy(&id)?.is_some_and(|p| p.job.as_deref() != Some(job)) {
        n += 1;
        id = format!("{wanted}.{n}");
    }
    Ok(id)
}

/// Stores the policy that a job trained, and returns its id.
pub fn store_trained(
    store: &Store,
    job: &JobContext,
    dqn: &Dqn,
    training: &str,
    config: &Value,
) -> Result<String> {
    let weights = dqn.weights();
    let id = policy_id_for_job(store, job.id)?;
    let row = PolicyRow {
        training: training.into(),
        config: config.clone(),
        job: Some(job.id.into()),
        owner: job.owner.map(String::from),
        ..row(&id, dqn, weights.len())
    };
    store.put_policy(&row, &weights, None)?;
    Ok(id)
}

/// Adds the policy's id to a request, for storage.
pub fn with_policy_id(mut asked: Value, id: &str) -> Value {
    if let Some(fields) = asked.as_object_mut() {
        fields.insert("policy".into(), id.into());
    }
    asked
}

/// Errors unless the policy can score the actions of `task`, of the world that a request names.
pub fn check_world(dqn: &Dqn, task: &Task, world: &str) -> Result<()> {
    dqn.check_compatible(task).map_err(|e| match e {
        Error::Input(input) => Error::input("world", format!("{world:?}"), input.allowed),
        other => other,
    })
}

/// Loads a stored policy.
pub fn load(app: &RequestContext, id: &str) -> Result<Dqn> {
    Dqn::from_safetensors(&app.policies().weights(id)?.ok_or_else(|| without_weights(id))?)
}

/// A policy's row in the store, with training `uploaded`.
pub fn row(id: &str, dqn: &Dqn, bytes: usize) -> PolicyRow {
    PolicyRow {
        id: id.into(),
        task: dqn.card().family.clone(),
        training: "uploaded".into(),
        about: dqn.describe(),
        config: serde_json::to_value(dqn.card()).unwrap_or_default(),
        job: None,
        version: env!("CARGO_PKG_VERSION").into(),
        bytes: bytes as u64,
        owner: None,
    }
}

/// Whether the policy is one of [`BUILT_IN_POLICIES`].
pub fn is_built_in(id: &str) -> bool {
    BUILT_IN_POLICIES.iter().any(|p| p.0 == id)
}

/// Error for an id without weights: an unknown or built-in policy.
pub fn without_weights(id: &str) -> Error {
    if !is_built_in(id) {
        return unknown(id);
    }
    let reason = format!(
        "the policy {id} is built in and has no weights; train a policy, or let untrained learn in a world, and use the \
         resulting policy"
    );
    Error::Refused { reason }
}

/// Error for an unknown policy.
pub fn unknown(id: &str) -> Error {
    Error::NotFound { kind: "policy", id: id.to_string(), known: Vec::new() }
}
