//! Tokens, without their hashes.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::binary_arrays::BinaryArrays;
use crate::access::{HashedToken, Scope, format_time};

/// A token to create.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TokenIn {
    /// Owner: worlds, jobs and policies created with the token belong to this name.
    pub name: String,
    /// `read`, `act` or `admin`.
    pub scope: String,
    /// Lifetime: `30d`, `12h`, `15m`, `90s` or `never`. Default: 90 days.
    pub expires: Option<String>,
}

/// A token, without its secret.
#[derive(Serialize, ToSchema)]
pub struct TokenOut {
    pub name: String,
    /// `read`, `act` or `admin`.
    pub scope: &'static str,
    /// Creation time; absent if unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub made: Option<String>,
    /// Expiry time; absent if it never expires.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expires: Option<String>,
    /// Whether it has expired.
    pub expired: bool,
    /// Whether it was passed to the server at start and cannot be revoked while it runs.
    pub fixed: bool,
}

/// A new token with its secret, which is shown only once.
#[derive(Serialize, ToSchema)]
pub struct CreatedToken {
    #[serde(flatten)]
    pub about: TokenOut,
    /// The bearer token. The server stores only its hash.
    pub token: String,
}

/// A page of tokens.
#[derive(Serialize, ToSchema)]
pub struct TokensPage {
    pub tokens: Vec<TokenOut>,
    /// Cursor of the next page, if there is one.
    pub next: Option<String>,
}

impl BinaryArrays for CreatedToken {}
impl BinaryArrays for TokensPage {}

impl TokenOut {
    /// From a stored token at Unix time `now`, s.
    pub fn new(kept: &HashedToken, fixed: bool, now: u64) -> TokenOut {
        TokenOut {
            name: kept.name.clone(),
            scope: Scope::name(kept.scope),
            made: (kept.made > 0).then(|| format_time(kept.made)),
            expires: kept.expires.map(format_time),
            expired: kept.is_expired(now),
            fixed,
        }
    }
}
