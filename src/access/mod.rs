//! Authentication and authorisation: bearer tokens, stored as SHA-256, and their scopes.
//!
//! | module | contents |
//! |---|---|
//! | `scope` | scopes, and the principal of a request |
//! | `token` | tokens, their digests and their comparison |
//! | `file` | token files |
//! | `keyring` | the tokens of a running server |
//! | `expiry` | timestamps and durations as text |

mod expiry;
mod file;
mod keyring;
mod scope;
mod token;

pub use expiry::{format_time, now, parse_duration, parse_time};
pub use file::{TokenFile, parse_token_file, parse_token_rows};
pub use keyring::{AuthError, Keyring};
pub use scope::{Principal, Scope};
pub use token::{Digest, HashedToken, digest, generate};
