//! Tokens as resources.

use crate::access::{HashedToken, Scope, digest, generate, now, parse_duration};
use crate::error::Result;
use crate::serve::operation::{ADMIN, JsonBody, Operation, Pagination, PathId, delete, get, post};
use crate::serve::request_context::RequestContext;
use crate::serve::wire::{CreatedToken, TokenIn, TokenOut, TokensPage};

/// Operations on tokens.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_tokens", "/v1/tokens", "system", ADMIN)
            .about("Lists tokens by name with scope and expiry, without their secrets.")
            .handler(list),
        post("make_token", "/v1/tokens", "system", ADMIN)
            .about(
                "Creates a token. The secret is shown only once.\n\nDoes not accept an `Idempotency-Key`, since the response \
                 would have to be stored. If it is lost, revoke the token and create another.",
            )
            .response::<CreatedToken>(201, "")
            .links(201, "/v1/tokens/{id}", "/name")
            .errors(&[(409, "The server has authentication disabled, or no file to store tokens in")])
            .handler(make),
        delete("revoke_token", "/v1/tokens/{id}", "system", ADMIN)
            .about("Revokes a token by name, effective from the next request.")
            .errors(&[(404, ""), (409, "A token passed to the server at start")])
            .handler(revoke),
    ]
}

/// Default lifetime of a token.
const DEFAULT_LIFETIME: &str = "90d";

fn list(app: &RequestContext, page: Pagination) -> Result<TokensPage> {
    let after: Option<String> = page.after("tokens")?;
    let mut all = app.shared().keyring.all();
    all.sort_by(|a, b| a.0.name.cmp(&b.0.name));
    all.retain(|(kept, _)| after.as_ref().is_none_or(|after| kept.name > *after));
    all.truncate(page.fetch_limit());
    let next = page.truncate("tokens", &mut all, |t| t.0.name.clone());
    let now = now();
    Ok(TokensPage {
        tokens: all.iter().map(|(kept, fixed)| TokenOut::new(kept, *fixed, now)).collect(),
        next,
    })
}

fn make(app: &RequestContext, JsonBody(body): JsonBody<TokenIn>) -> Result<(u16, CreatedToken)> {
    HashedToken::check_name("name", &body.name)?;
    let scope = Scope::from_name("scope", &body.scope)?;
    let (made, token) = (now(), generate()?);
    let expires = parse_duration("expires", body.expires.as_deref().unwrap_or(DEFAULT_LIFETIME))?
        .map(|span| made + span);
    let kept = HashedToken { name: body.name, scope, digest: digest(token.as_bytes()), made, expires };
    app.shared().keyring.add(&kept)?;
    Ok((201, CreatedToken { about: TokenOut::new(&kept, false, made), token }))
}

fn revoke(app: &RequestContext, PathId(name): PathId) -> Result<()> {
    app.shared().keyring.revoke(&name)
}
