//! Policies: what there is, weights, acting.

use serde_json::json;

use super::stored::{ALWAYS, RANDOM, is_always, load, row, unknown, without_weights};
use crate::error::{Error, Result};
use crate::policy::{CHUNK, Dqn, Policy, Random, rank};
use crate::serve::app::App;
use crate::serve::operation::{ACT, Body, Bytes, Id, Media, Operation, Page, READ, delete, get, post, put};
use crate::serve::wire::{ActIn, Acted, Policies, PolicyOut, Scored};
use crate::task::{Placement, ValidAction};

/// What can be asked of policies at once.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_policies", "/v1/policies", "policies", READ)
            .about("Policies, oldest first; replacing its weights makes a policy young again.")
            .leads_to(200, "/v1/policies/{id}", "/policies/0/id")
            .does(list),
        get("get_policy", "/v1/policies/{id}", "policies", READ).about("One policy.").refuses(&[(404, "")]).does(one),
        delete("delete_policy", "/v1/policies/{id}", "policies", ACT)
            .about("Forgets a policy and its weights.")
            .refuses(&[(404, ""), (409, "A policy that is always there")])
            .does(forget),
        get("download_weights", "/v1/policies/{id}/weights", "policies", READ)
            .about("A policy's weights, as safetensors.")
            .answers_media(200, "", &["application/octet-stream"])
            .refuses(&[(404, ""), (409, "A policy that has none: `random`, `untrained`")])
            .does(weights),
        put("upload_weights", "/v1/policies/{id}/weights", "policies", ACT)
            .about("Stores weights: makes the policy, or replaces its weights.")
            .answers::<PolicyOut>(200, "Replaced")
            .answers::<PolicyOut>(201, "Made")
            .leads_to(201, "/v1/policies/{id}", "/id")
            .refuses(&[
                (409, "A name that is taken"),
                (413, ""),
                (422, "Not the weights of a policy"),
            ])
            .does(put_weights),
        post("act", "/v1/policies/{id}/act", "policies", ACT)
            .about(
                "The actions a policy likes best on a task, of those that can be placed.\n\nThe policy `random`, \
                 always there, likes them in an order drawn once.",
            )
            .refuses(&[(404, "Unknown policy or task"), (409, "`untrained`, which knows nothing yet")])
            .does(act),
    ]
}

fn list(app: &App, page: Page) -> Result<Policies> {
    let after: i64 = page.after("policies")?.unwrap_or(0);
    let mut all = app.policies().list(after, page.fetch())?;
    let next = page.cut("policies", &mut all, |p| p.0);
    Ok(Policies { policies: all.into_iter().map(|p| PolicyOut::from(p.1)).collect(), next })
}

fn one(app: &App, Id(id): Id) -> Result<PolicyOut> {
    if let Some((id, about)) = ALWAYS.iter().find(|p| p.0 == id) {
        return Ok(PolicyOut {
            id: id.to_string(),
            task: "any".into(),
            training: "none".into(),
            about: about.to_string(),
            config: json!({}),
            job: None,
            version: env!("CARGO_PKG_VERSION").into(),
            bytes: 0,
        });
    }
    app.policies().get(&id)?.map(PolicyOut::from).ok_or_else(|| unknown(&id))
}

fn forget(app: &App, Id(id): Id) -> Result<()> {
    if is_always(&id) {
        return Err(Error::Refused {
            reason: format!("the policy {id} is always there and cannot be deleted"),
        });
    }
    if app.policies().remove(&id)? { Ok(()) } else { Err(unknown(&id)) }
}

fn weights(app: &App, Id(id): Id) -> Result<Media> {
    let bytes = app.policies().weights(&id)?.ok_or_else(|| without_weights(&id))?;
    Ok(Media { kind: "application/octet-stream", bytes })
}

fn put_weights(app: &App, (Id(id), Bytes(bytes)): (Id, Bytes)) -> Result<(u16, PolicyOut)> {
    let first = id.chars().next().is_some_and(|c| c.is_ascii_alphanumeric());
    if !(first && id.len() <= 64 && id.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c))) {
        let allowed = "1 to 64 letters, digits, `.`, `_` or `-`, the first a letter or digit";
        return Err(Error::input("id", format!("{id:?}"), allowed));
    }
    if is_always(&id) {
        let allowed = "another name: this policy is always there and has no weights to replace";
        return Err(Error::input("id", format!("{id:?}"), allowed));
    }
    let dqn = Dqn::from_safetensors(&bytes).map_err(|e| match e {
        e @ Error::Input(_) => e,
        other => Error::input("body", other, "the safetensors weights of a policy"),
    })?;
    if let Ok(tasks) = app.catalogue.family(&dqn.card().family) {
        dqn.fits(&tasks.tasks[0])?;
    }
    let (row, new) = app.policies().put(row(&id, &dqn, bytes.len()), &bytes)?;
    Ok((if new { 201 } else { 200 }, row.into()))
}

/// The actions a policy likes best; `random` likes an order that is the same every time.
fn act(app: &App, (Id(id), Body(body)): (Id, Body<ActIn>)) -> Result<Acted> {
    let count = body.count.unwrap_or(1);
    if !(1..=10_000).contains(&count) {
        return Err(Error::input("count", count, "a whole number from 1 to 10000"));
    }
    let task = app.catalogue.task(&body.task)?;
    let policy: Box<dyn Policy> = if id == RANDOM {
        Box::new(Random { seed: 0 })
    } else {
        let dqn = load(app, &id)?;
        dqn.fits(&task)?;
        Box::new(dqn)
    };
    let actions: Vec<ValidAction> =
        (0..task.actions().count()).map(|i| task.actions().at(i)).collect::<Result<_>>()?;
    let order = rank(policy.as_ref(), &task, &actions, CHUNK)?;
    let placeable = |i: &usize| matches!(task.place(&actions[*i]), Placement::Valid(_));
    let best: Vec<usize> = order.into_iter().filter(placeable).take(count as usize).collect();
    let chosen: Vec<ValidAction> = best.iter().map(|i| actions[*i].clone()).collect();
    let scores = policy.score(&task, &chosen)?;
    let scored = best.into_iter().zip(chosen).zip(scores).map(|((index, action), score)| Scored {
        index,
        action: action.values().to_vec(),
        score,
    });
    Ok(Acted { actions: scored.collect() })
}
