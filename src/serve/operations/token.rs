//! Tokens: who may do what.

use crate::access::{Kept, Scope, days, digest, fresh, now};
use crate::error::Result;
use crate::serve::app::App;
use crate::serve::operation::{ADMIN, Body, Id, Operation, Page, delete, get, post};
use crate::serve::wire::{TokenIn, TokenMade, TokenOut, Tokens};

/// What can be asked about tokens.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_tokens", "/v1/tokens", "system", ADMIN)
            .about("Tokens by name: what they allow and until when, never what is presented.")
            .does(list),
        post("make_token", "/v1/tokens", "system", ADMIN)
            .about(
                "Makes a token, which is shown this once.\n\nIt takes no `Idempotency-Key`: the answer would have \
                 to be kept. Who has lost it revokes the token and makes another.",
            )
            .answers::<TokenMade>(201, "")
            .leads_to(201, "/v1/tokens/{id}", "/name")
            .refuses(&[(409, "The server asks for no tokens, or has no file to keep one in")])
            .does(make),
        delete("revoke_token", "/v1/tokens/{id}", "system", ADMIN)
            .about("Takes a token back, by its name: its bearer is refused from the next request on.")
            .refuses(&[(404, ""), (409, "A token that was given to the server when it was started")])
            .does(revoke),
    ]
}

/// How long a token is good if nobody says.
const USUAL: &str = "90d";

fn list(app: &App, page: Page) -> Result<Tokens> {
    let after: Option<String> = page.after("tokens")?;
    let mut all = app.shared().keyring.all();
    all.sort_by(|a, b| a.0.name.cmp(&b.0.name));
    all.retain(|(kept, _)| after.as_ref().is_none_or(|after| kept.name > *after));
    all.truncate(page.fetch());
    let next = page.cut("tokens", &mut all, |t| t.0.name.clone());
    let now = now();
    Ok(Tokens { tokens: all.iter().map(|(kept, fixed)| TokenOut::new(kept, *fixed, now)).collect(), next })
}

fn make(app: &App, Body(body): Body<TokenIn>) -> Result<(u16, TokenMade)> {
    Kept::check_name("name", &body.name)?;
    let scope = Scope::from_name("may", &body.may)?;
    let (made, token) = (now(), fresh()?);
    let expires = days("expires", body.expires.as_deref().unwrap_or(USUAL))?.map(|span| made + span);
    let kept = Kept { name: body.name, scope, digest: digest(token.as_bytes()), made, expires };
    app.shared().keyring.add(&kept)?;
    Ok((201, TokenMade { about: TokenOut::new(&kept, false, made), token }))
}

fn revoke(app: &App, Id(name): Id) -> Result<()> {
    app.shared().keyring.revoke(&name)
}
