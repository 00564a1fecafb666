//! Tokens: of each what may be shown, which its hash is not.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::bulk::Bulk;
use crate::access::{Kept, Scope, written};

/// A token to make.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TokenIn {
    /// Whose it is: worlds, jobs and policies made with it belong to this name.
    pub name: String,
    /// `read`, `act` or `admin`.
    pub may: String,
    /// How long it is good: `30d`, `12h`, `15m`, `90s`, or `never`; 90 days if absent.
    pub expires: Option<String>,
}

/// A token as it is known.
#[derive(Serialize, ToSchema)]
pub struct TokenOut {
    pub name: String,
    /// `read`, `act` or `admin`.
    pub may: &'static str,
    /// When it was made; absent where that is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub made: Option<String>,
    /// When it ends; never, if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expires: Option<String>,
    /// Whether it has ended.
    pub expired: bool,
    /// Whether it was given to the server when it was started, and cannot be revoked while it runs.
    pub fixed: bool,
}

/// A token that was made, with what is shown this once.
#[derive(Serialize, ToSchema)]
pub struct TokenMade {
    #[serde(flatten)]
    pub about: TokenOut,
    /// What its bearer presents. Nothing of it is kept but its hash.
    pub token: String,
}

/// A page of tokens.
#[derive(Serialize, ToSchema)]
pub struct Tokens {
    pub tokens: Vec<TokenOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

impl Bulk for TokenMade {}
impl Bulk for Tokens {}

impl TokenOut {
    /// What is shown of a token at a moment, s since 1970.
    pub fn new(kept: &Kept, fixed: bool, now: u64) -> TokenOut {
        TokenOut {
            name: kept.name.clone(),
            may: Scope::name(kept.scope),
            made: (kept.made > 0).then(|| written(kept.made)),
            expires: kept.expires.map(written),
            expired: kept.ended(now),
            fixed,
        }
    }
}
