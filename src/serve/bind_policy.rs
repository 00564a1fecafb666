//! Bind policy: which addresses may be served without tokens or encryption.
//!
//! A server on loopback or on a Unix socket needs no tokens. On any other address tokens are required, and they must not
//! cross the network unencrypted.

use std::net::IpAddr;
use std::path::Path;

use super::config::ServeConfig;
use crate::access::{Keyring, TokenFile, parse_token_rows};
use crate::error::{Error, Result};
use crate::store::{has_owned_records, refuse_foreign_files};

/// Environment variable with tokens, as rows of a token file.
pub const TOKENS_ENV_VAR: &str = "IPLW_TOKENS";

/// Tokens of the server: from the token file or the data directory, and from the configuration. Errors if there are none although
/// records of the data directory belong to tokens: the token file was lost, and everybody would have access.
pub fn keyring(config: &ServeConfig) -> Result<Keyring> {
    let file = match (&config.token_file, &config.data_dir) {
        (Some(path), _) => {
            let file = TokenFile::at(path);
            if file.read()?.is_none() {
                let allowed = "a token file: `iplw token new NAME --token-file FILE` creates one";
                return Err(Error::input("--token-file", path.display(), allowed));
            }
            Some(file)
        }
        (None, Some(directory)) => {
            refuse_foreign_files(directory)?;
            Some(TokenFile::of_directory(directory))
        }
        (None, None) => None,
    };
    let fixed = config.tokens.as_deref().map(|text| parse_token_rows(text, TOKENS_ENV_VAR)).transpose()?;
    let keyring = Keyring::new(file, fixed)?;
    match &config.data_dir {
        Some(directory) if !keyring.requires_token() && has_owned_records(directory)? => {
            Err(missing_tokens(directory))
        }
        _ => Ok(keyring),
    }
}

fn missing_tokens(directory: &Path) -> Error {
    let reason = format!(
        "{0}/tokens.json is missing, although records in {0} belong to tokens: everybody would have access to them. Restore the file \
         from a backup, create a token by `iplw token new NAME --scope admin --data-dir {0}`, or start with --token-file or {TOKENS_ENV_VAR}",
        directory.display()
    );
    Error::Refused { reason }
}

/// Errors if the network could reach the server without a token, or tokens would be sent unencrypted.
pub fn check(config: &ServeConfig, keyring: &Keyring, http: IpAddr, zmq: Option<IpAddr>) -> Result<()> {
    let reached = [("--http", Some(http)), ("--zmq", zmq)];
    for (option, at) in reached.into_iter().filter_map(|(option, at)| at.map(|at| (option, at))) {
        if at.is_loopback() || config.open_to_network {
            continue;
        }
        if !keyring.requires_token() {
            let allowed = "a loopback address such as 127.0.0.1; or tokens (`iplw token new`), so that clients \
                 must authenticate; or --open-to-network, if everybody on the network may do anything";
            return Err(Error::input(option, at, allowed));
        }
        let encrypted = option == "--http" && config.tls.is_some();
        if !encrypted && !config.plaintext {
            let allowed = "a loopback address; or TLS (--tls-cert, --tls-key; not for ZeroMQ); or --plaintext, if a proxy or tunnel in front \
                 encrypts: tokens would cross the network unencrypted";
            return Err(Error::input(option, at, allowed));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::{HashedToken, Scope, digest};

    fn row(name: &str) -> String {
        format!("[{{\"name\": \"{name}\", \"scope\": \"act\", \"sha256\": \"{}\"}}]", digest(b"x").hex())
    }

    #[test]
    fn network_address_requires_tokens_and_encryption() {
        let error_of = |change: fn(&mut ServeConfig), http: &str, zmq: Option<&str>| {
            let mut config = ServeConfig::default();
            change(&mut config);
            let keyring = keyring(&config).unwrap();
            check(&config, &keyring, http.parse().unwrap(), zmq.map(|z| z.parse().unwrap()))
                .err()
                .map(|e| e.to_string())
        };
        let tokens = |config: &mut ServeConfig| config.tokens = Some(row("ann"));
        assert_eq!(error_of(|_| {}, "127.0.0.1", Some("127.0.0.1")), None);
        assert_eq!(error_of(|_| {}, "::1", None), None);
        assert!(error_of(|_| {}, "0.0.0.0", None).unwrap().contains("`--http` is 0.0.0.0"));
        assert!(error_of(|_| {}, "127.0.0.1", Some("0.0.0.0")).unwrap().contains("`--zmq` is 0.0.0.0"));
        assert!(error_of(tokens, "192.168.0.2", None).unwrap().contains("--plaintext"));
        let covered = |config: &mut ServeConfig| {
            config.tokens = Some(row("ann"));
            config.plaintext = true;
        };
        assert_eq!(error_of(covered, "192.168.0.2", Some("::")), None);
        assert!(error_of(|c| c.plaintext = true, "::", None).unwrap().contains("--open-to-network"));
        assert_eq!(error_of(|c| c.open_to_network = true, "::", None), None);
        let encrypted = |config: &mut ServeConfig| {
            config.tokens = Some(row("ann"));
            config.tls = Some(("cert.pem".into(), "key.pem".into()));
        };
        assert_eq!(error_of(encrypted, "0.0.0.0", Some("127.0.0.1")), None);
        assert!(error_of(encrypted, "0.0.0.0", Some("0.0.0.0")).unwrap().contains("`--zmq`"));
    }

    #[test]
    fn lost_token_file_does_not_open_the_server() {
        let place = tempfile::tempdir().unwrap();
        let config = ServeConfig { data_dir: Some(place.path().into()), ..ServeConfig::default() };
        let requires_token = |config: &ServeConfig| keyring(config).map(|k| k.requires_token());
        assert_eq!(requires_token(&config), Ok(false), "without data");
        let add = |id: &str, owner: Option<&str>| {
            crate::store::Store::open(place.path()).unwrap().add_world(id, "{}", owner, None).unwrap();
        };
        add("w1", None);
        assert_eq!(requires_token(&config), Ok(false), "without owners");
        add("w2", Some("ann"));
        let error = keyring(&config).err().unwrap().to_string();
        assert!(error.contains("iplw token new NAME --scope admin --data-dir"), "{error}");
        let elsewhere = ServeConfig { tokens: Some(row("ann")), ..config.clone() };
        assert_eq!(requires_token(&elsewhere), Ok(true));
        let (digest, name) = (digest(b"x"), "root".into());
        let token = HashedToken { name, scope: Scope::Admin, digest, made: 0, expires: None };
        TokenFile::of_directory(place.path()).add(&token).unwrap();
        assert_eq!(requires_token(&config), Ok(true));
    }

    #[test]
    fn rejects_missing_token_file() {
        let config =
            ServeConfig { token_file: Some("/nowhere/tokens.json".into()), ..ServeConfig::default() };
        assert!(keyring(&config).err().unwrap().to_string().contains("--token-file"));
    }
}
