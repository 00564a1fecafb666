//! Servers with tokens.

use std::path::Path;

use iplw::access::{HashedToken, Scope, TokenFile, digest};
use iplw::serve::ServeConfig;

use crate::http::Running;

/// The token of this name.
pub fn token(name: &str) -> String {
    format!("iplw_of-{name}")
}

/// As it is stored.
pub fn stored_token(name: &str, scope: Scope, expires: Option<u64>) -> HashedToken {
    HashedToken { name: name.into(), scope, digest: digest(token(name).as_bytes()), made: 0, expires }
}

/// A server over both transports whose data directory has these tokens.
pub fn start_with(directory: &Path, tokens: Vec<HashedToken>, config: ServeConfig) -> Running {
    TokenFile::of_directory(directory)
        .change(|all| {
            all.extend(tokens);
            Ok(())
        })
        .unwrap();
    let zmq = Some("tcp://127.0.0.1:*".into());
    Running::with(ServeConfig { data_dir: Some(directory.into()), zmq, ..config }).unwrap()
}
