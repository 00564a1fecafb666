//! Policies as resources: listing, weights, acting.

use serde_json::json;

use super::policy_store::{BUILT_IN_POLICIES, RANDOM, is_built_in, load, row, unknown, without_weights};
use crate::budget::Budget;
use crate::error::{Error, Result, check_count};
use crate::policy::{CHUNK, Dqn, Policy, RandomPolicy, rank};
use crate::serve::operation::{
    ACT, JsonBody, MediaBody, Operation, Pagination, PathId, READ, RawBody, delete, get, post, put,
};
use crate::serve::request_context::RequestContext;
use crate::serve::wire::{ActIn, PoliciesPage, ProposedActions, ScoredAction};
use crate::store::PolicyRow;
use crate::task::{Placement, Task, ValidAction};

/// Operations on policies that need no job.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_policies", "/v1/policies", "policies", READ)
            .about("Lists policies, oldest first; replacing the weights counts as a new policy.")
            .links(200, "/v1/policies/{id}", "/policies/0/id")
            .handler(list),
        get("get_policy", "/v1/policies/{id}", "policies", READ).about("Returns a policy.").errors(&[(404, "")]).handler(one),
        delete("delete_policy", "/v1/policies/{id}", "policies", ACT)
            .about("Deletes a policy and its weights.")
            .errors(&[(404, ""), (409, "A built-in policy")])
            .handler(forget),
        get("download_weights", "/v1/policies/{id}/weights", "policies", READ)
            .about("Returns a policy's weights as safetensors.")
            .media_response(200, "", &["application/octet-stream"])
            .errors(&[(404, ""), (409, "A built-in policy, which has no weights")])
            .handler(weights),
        put("upload_weights", "/v1/policies/{id}/weights", "policies", ACT)
            .about("Uploads weights: creates the policy or replaces its weights.")
            .response::<PolicyRow>(200, "Replaced")
            .response::<PolicyRow>(201, "Created")
            .links(201, "/v1/policies/{id}", "/id")
            .errors(&[
                (409, "The name is taken"),
                (413, ""),
                (422, "Not the weights of a policy"),
            ])
            .handler(put_weights),
        post("act", "/v1/policies/{id}/act", "policies", ACT)
            .about(
                "Returns the policy's highest-scoring actions on a task that can be placed.\n\nThe built-in policy `random` has \
                 a fixed random order.",
            )
            .errors(&[(404, "Unknown policy or task"), (409, "The policy `untrained`")])
            .compute_handler(act),
    ]
}

fn list(app: &RequestContext, page: Pagination) -> Result<PoliciesPage> {
    let after: i64 = page.after("policies")?.unwrap_or(0);
    let mut all = app.policies().list(after, page.fetch_limit())?;
    let next = page.truncate("policies", &mut all, |p| p.0);
    Ok(PoliciesPage { policies: all.into_iter().map(|p| p.1).collect(), next })
}

fn one(app: &RequestContext, PathId(id): PathId) -> Result<PolicyRow> {
    if let Some((id, about)) = BUILT_IN_POLICIES.iter().find(|p| p.0 == id) {
        return Ok(PolicyRow {
            id: id.to_string(),
            task: "any".into(),
            training: "none".into(),
            about: about.to_string(),
            config: json!({}),
            job: None,
            version: env!("CARGO_PKG_VERSION").into(),
            bytes: 0,
            owner: None,
        });
    }
    app.policies().get(&id)?.ok_or_else(|| unknown(&id))
}

fn forget(app: &RequestContext, PathId(id): PathId) -> Result<()> {
    if is_built_in(&id) {
        return Err(Error::Refused { reason: format!("the policy {id} is built in and cannot be deleted") });
    }
    if app.policies().remove(&id)? { Ok(()) } else { Err(unknown(&id)) }
}

fn weights(app: &RequestContext, PathId(id): PathId) -> Result<MediaBody> {
    let bytes = app.policies().weights(&id)?.ok_or_else(|| without_weights(&id))?;
    Ok(MediaBody { kind: "application/octet-stream", bytes })
}

fn put_weights(
    app: &RequestContext,
    (PathId(id), RawBody(bytes)): (PathId, RawBody),
) -> Result<(u16, PolicyRow)> {
    let first = id.chars().next().is_some_and(|c| c.is_ascii_alphanumeric());
    if !(first && id.len() <= 64 && id.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c))) {
        let allowed = "1 to 64 letters, digits, `.`, `_` or `-`, the first a letter or digit";
        return Err(Error::input("id", format!("{id:?}"), allowed));
    }
    if is_built_in(&id) {
        let allowed = "another name: this policy is built in and has no weights";
        return Err(Error::input("id", format!("{id:?}"), allowed));
    }
    let dqn = Dqn::from_safetensors(&bytes).map_err(|e| match e {
        e @ Error::Input(_) => e,
        other => Error::input("body", other, "the safetensors weights of a policy"),
    })?;
    if let Ok(tasks) = app.catalogue.family(&dqn.card().family) {
        dqn.check_compatible(&tasks.tasks[0])?;
    }
    let (row, new) = app.policies().put(row(&id, &dqn, bytes.len()), &bytes)?;
    Ok((if new { 201 } else { 200 }, row))
}

/// A policy that checks a deadline before each batch of scores.
struct BudgetedPolicy<'a> {
    policy: &'a dyn Policy,
    budget: &'a dyn Budget,
}

impl Policy for BudgetedPolicy<'_> {
    fn score(&self, task: &Task, actions: &[ValidAction]) -> Result<Vec<f32>> {
        self.budget.check()?;
        self.policy.score(task, actions)
    }

    fn describe(&self) -> String {
        self.policy.describe()
    }
}

/// The highest-scoring actions that can be placed.
fn act(
    app: &RequestContext,
    (PathId(id), JsonBody(body)): (PathId, JsonBody<ActIn>),
) -> Result<ProposedActions> {
    check_count("count", body.count, 1, 10_000)?;
    let count = body.count.unwrap_or(1);
    let task = app.catalogue.task(&body.task)?;
    let policy: Box<dyn Policy> = if id == RANDOM {
        Box::new(RandomPolicy { seed: 0 })
    } else {
        let dqn = load(app, &id)?;
        dqn.check_compatible(&task)?;
        Box::new(dqn)
    };
    let actions: Vec<ValidAction> =
        (0..task.actions().count()).map(|i| task.actions().at(i)).collect::<Result<_>>()?;
    let policy = BudgetedPolicy { policy: policy.as_ref(), budget: app.budget() };
    let mut best = Vec::new();
    for i in rank(&policy, &task, &actions, CHUNK)? {
        app.budget().check()?;
        if matches!(task.place(&actions[i]), Placement::Valid(_)) {
            best.push(i);
        }
        if best.len() == count as usize {
            break;
        }
    }
    let chosen: Vec<ValidAction> = best.iter().map(|i| actions[*i].clone()).collect();
    let scores: Vec<Vec<f32>> =
        chosen.chunks(CHUNK).map(|part| policy.score(&task, part)).collect::<Result<_>>()?;
    let scores = scores.concat();
    let scored = best.into_iter().zip(chosen).zip(scores).map(|((index, action), score)| ScoredAction {
        index,
        action: action.values().to_vec(),
        score,
    });
    Ok(ProposedActions { actions: scored.collect() })
}
