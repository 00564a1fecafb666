//! Policies as they are stored, and those that are always there.

use serde_json::Value;

use crate::error::{Error, Result};
use crate::policy::{Dqn, Policy};
use crate::serve::app::App;
use crate::store::{PolicyRow, Store};

/// The policy that tries actions in random order.
pub const RANDOM: &str = "random";
/// The policy that lives with the client: its order of actions comes with the request.
pub const RANKED: &str = "ranked";
/// The policy that knows nothing.
pub const UNTRAINED: &str = "untrained";
/// Policies that are always there, and what they are.
pub const ALWAYS: [(&str, &str); 3] = [
    (RANDOM, "tries actions in random order; may act and be evaluated"),
    (RANKED, "lives with the client, whose order of actions may be evaluated"),
    (UNTRAINED, "knows nothing; learning on from it is direct learning"),
];

/// The policy as it was when the job began, also if it is replaced meanwhile; `now` are the weights of `id` as they are.
pub fn began_with(store: &Store, job: i64, id: &str, now: Option<Vec<u8>>) -> Result<Dqn> {
    let weights = match (store.artifact(job, WEIGHTS)?, now) {
        (Some(kept), _) => kept,
        (None, Some(now)) => {
            store.put_artifact(job, WEIGHTS, &now)?;
            now
        }
        (None, None) => return Err(unknown(id)),
    };
    Dqn::from_safetensors(&weights)
}

/// The artifact that holds the weights a job began with.
const WEIGHTS: &str = "weights";

/// `policy-3` for `job-3`, or that with a number behind it if a client has stored weights under it. What an
/// interrupted run of the same job stored is its own.
pub fn free_id(store: &Store, job: &str) -> Result<String> {
    let wanted = job.replace("job", "policy");
    let mut id = wanted.clone();
    let mut n = 1;
    while store.policy(&id)?.is_some_and(|p| p.job.as_deref() != Some(job)) {
        n += 1;
        id = format!("{wanted}.{n}");
    }
    Ok(id)
}

/// What was asked of a policy, with its id: kept and shown.
pub fn of_policy(mut asked: Value, id: &str) -> Value {
    if let Some(fields) = asked.as_object_mut() {
        fields.insert("policy".into(), id.into());
    }
    asked
}

/// A stored policy.
pub fn load(app: &App, id: &str) -> Result<Dqn> {
    Dqn::from_safetensors(&app.policies().weights(id)?.ok_or_else(|| without_weights(id))?)
}

/// A policy's row; it says that the weights were uploaded.
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

/// Whether the policy is one of [`ALWAYS`].
pub fn is_always(id: &str) -> bool {
    ALWAYS.iter().any(|p| p.0 == id)
}

/// There are no weights under this id: there is no such policy, or it never has any.
pub fn without_weights(id: &str) -> Error {
    if !is_always(id) {
        return unknown(id);
    }
    let reason = format!(
        "the policy {id} is always there and has no weights; train a policy, or let untrained learn in a world, \
         and use the one that comes of it"
    );
    Error::Refused { reason }
}

/// No policy has this id.
pub fn unknown(id: &str) -> Error {
    Error::NotFound { kind: "policy", id: id.to_string(), known: Vec::new() }
}
