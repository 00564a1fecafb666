//! Who may do what: bearer tokens, kept as SHA-256, and what each of them allows.
//!
//! | file | what it is |
//! |---|---|
//! | `scope` | what a token allows, and whose things its bearer sees |
//! | `token` | a token, what is kept of it, and how it is compared |
//! | `file` | tokens as a file |
//! | `keyring` | the tokens of a running server: who bears one |
//! | `when` | moments, as people read them |

mod file;
mod keyring;
mod scope;
mod token;
mod when;

pub use file::{TokenFile, rows, whole};
pub use keyring::{Keyring, Unknown};
pub use scope::{Scope, Who};
pub use token::{Digest, Kept, digest, fresh};
pub use when::{days, moment, now, written};
