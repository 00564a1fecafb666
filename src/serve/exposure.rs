//! Who could reach the server, and what is asked for before they can.
//!
//! On this machine alone (loopback, a socket in the file system) nothing is asked for unless there are tokens. Where others
//! could reach it there must be tokens, and tokens must not cross the network in clear.

use std::net::IpAddr;

use super::config::ServeConfig;
use crate::access::{Keyring, TokenFile, rows};
use crate::error::{Error, Result};

/// The environment variable for tokens, as rows of a token file.
pub const TOKENS: &str = "IPLW_TOKENS";

/// The tokens of a server: of its file, or else of its data directory, and those it was given.
pub fn keyring(config: &ServeConfig) -> Result<Keyring> {
    let file = match (&config.token_file, &config.data_dir) {
        (Some(path), _) => {
            let file = TokenFile::at(path);
            if file.read()?.is_none() {
                let allowed = "a file of tokens: `iplw token new NAME --token-file FILE` makes one";
                return Err(Error::input("--token-file", path.display(), allowed));
            }
            Some(file)
        }
        (None, Some(directory)) => Some(TokenFile::of_directory(directory)),
        (None, None) => None,
    };
    Keyring::new(file, config.tokens.as_deref().map(|text| rows(text, TOKENS)).transpose()?)
}

/// Errors if others could reach the server without a token, or a token could be read on its way.
pub fn allowed(config: &ServeConfig, keyring: &Keyring, http: IpAddr, zmq: Option<IpAddr>) -> Result<()> {
    let reached = [("--http", Some(http)), ("--zmq", zmq)];
    for (option, at) in reached.into_iter().filter_map(|(option, at)| at.map(|at| (option, at))) {
        if at.is_loopback() || config.open_to_network {
            continue;
        }
        if !keyring.asks() {
            let allowed = "an address of this machine alone, such as 127.0.0.1; or tokens (`iplw token new`), so that others \
                 are asked who they are; or --open-to-network, if anybody who can reach it may do anything";
            return Err(Error::input(option, at, allowed));
        }
        let encrypted = option == "--http" && config.tls.is_some();
        if !encrypted && !config.plaintext {
            let allowed = "an address of this machine alone; or TLS (--tls-cert, --tls-key; ZeroMQ has none); or --plaintext, if something in front of it (a proxy, a tunnel) \
                 encrypts: tokens would cross the network in clear";
            return Err(Error::input(option, at, allowed));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::digest;

    fn row(name: &str) -> String {
        format!("[{{\"name\": \"{name}\", \"may\": \"act\", \"sha256\": \"{}\"}}]", digest(b"x").hex())
    }

    #[test]
    fn a_network_needs_tokens_and_tokens_need_cover() {
        let said = |change: fn(&mut ServeConfig), http: &str, zmq: Option<&str>| {
            let mut config = ServeConfig::default();
            change(&mut config);
            let keyring = keyring(&config).unwrap();
            allowed(&config, &keyring, http.parse().unwrap(), zmq.map(|z| z.parse().unwrap()))
                .err()
                .map(|e| e.to_string())
        };
        let tokens = |config: &mut ServeConfig| config.tokens = Some(row("ann"));
        assert_eq!(said(|_| {}, "127.0.0.1", Some("127.0.0.1")), None);
        assert_eq!(said(|_| {}, "::1", None), None);
        assert!(said(|_| {}, "0.0.0.0", None).unwrap().contains("`--http` is 0.0.0.0"));
        assert!(said(|_| {}, "127.0.0.1", Some("0.0.0.0")).unwrap().contains("`--zmq` is 0.0.0.0"));
        assert!(said(tokens, "192.168.0.2", None).unwrap().contains("--plaintext"));
        let covered = |config: &mut ServeConfig| {
            config.tokens = Some(row("ann"));
            config.plaintext = true;
        };
        assert_eq!(said(covered, "192.168.0.2", Some("::")), None);
        assert!(said(|c| c.plaintext = true, "::", None).unwrap().contains("--open-to-network"));
        assert_eq!(said(|c| c.open_to_network = true, "::", None), None);
        let encrypted = |config: &mut ServeConfig| {
            config.tokens = Some(row("ann"));
            config.tls = Some(("cert.pem".into(), "key.pem".into()));
        };
        assert_eq!(said(encrypted, "0.0.0.0", Some("127.0.0.1")), None);
        assert!(said(encrypted, "0.0.0.0", Some("0.0.0.0")).unwrap().contains("`--zmq`"));
    }

    #[test]
    fn a_token_file_that_is_named_must_be_there() {
        let config =
            ServeConfig { token_file: Some("/nowhere/tokens.json".into()), ..ServeConfig::default() };
        assert!(keyring(&config).err().unwrap().to_string().contains("--token-file"));
    }
}
