//! `/v1/iplw/{id}`: ask and tell

use axum::http::StatusCode;
use axum::response::Response;

use super::extract::{Caller, Pairs, Params, Sent};
use super::{answer, answer_once};
use crate::error::Error;
use crate::serve::app::App;
use crate::serve::operations::asked;
use crate::serve::problem::{Answer, Problem};
use crate::serve::wire::{Proposals, TellIn, TellQuery, Told};

/// What an estimation with `"real": "ask_tell"` wants carried out on the real world.
#[utoipa::path(get, path = "/v1/iplw/{id}/proposals", tag = "workflow", operation_id = "list_proposals",
    params(("id" = String, Path)),
    responses(
        (status = 200, body = Proposals),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "It does not ask"),
    ))]
pub async fn proposals(app: Caller, Params(id): Params<String>) -> Answer<Response> {
    answer(&app, StatusCode::OK, move |app| asked::proposals(app, &id)).await
}

/// Takes what was measured, as JSON or as a trials file (`text/csv`, whose `trial` is the proposal's number; the
/// other fields are then query parameters). Answers add up until every proposal of the round has one, has failed,
/// or the round is closed. The same answer again changes nothing.
#[utoipa::path(post, path = "/v1/iplw/{id}/trials", tag = "workflow", operation_id = "tell_trials",
    params(
        ("id" = String, Path),
        ("failed" = Option<String>, Query, description = "With CSV: numbers of proposals that could not be carried out, `3,4`"),
        ("round" = Option<u64>, Query, description = "With CSV: number of the round that is meant"),
        ("close" = Option<bool>, Query, description = "With CSV: ends the round"),
        ("replace" = Option<bool>, Query, description = "With CSV: answers take the place of different ones"),
        ("Idempotency-Key" = Option<String>, Header, description = "Repeated under the same key, the request has no further effect and is answered the same"),
    ),
    request_body(content((TellIn = "application/json"), (String = "text/csv"))),
    responses(
        (status = 200, body = Told),
        (status = 400, body = Problem, content_type = "application/problem+json"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 409, body = Problem, content_type = "application/problem+json", description = "Answered differently before, or the round is over"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    ))]
pub async fn tell(
    app: Caller,
    Params(id): Params<String>,
    Pairs(pairs): Pairs,
    sent: Sent,
) -> Answer<Response> {
    if sent.kind == "text/csv" {
        let (csv, query) = (sent.text()?.to_string(), TellQuery::from_query(&pairs)?);
        let work = move |app: &App, keep: super::Keep<Told>| asked::tell_csv(app, &id, &csv, &query, keep);
        return answer_once(&app, sent.once, StatusCode::OK, |_| None, work).await;
    }
    if let Some((name, value)) = pairs.first() {
        return Err(
            Error::input(name, format!("{value:?}"), "no parameters: JSON has them in its body").into()
        );
    }
    let (body, _) = sent.json::<TellIn>()?;
    let work = move |app: &App, keep: super::Keep<Told>| asked::tell(app, &id, body, keep);
    answer_once(&app, sent.once, StatusCode::OK, |_| None, work).await
}
