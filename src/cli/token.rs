//! `iplw token`: access tokens of a server.

use std::path::PathBuf;

use clap::Subcommand;
use iplw::access::{HashedToken, Scope, TokenFile, digest, format_time, generate, now, parse_duration};
use iplw::error::{Error, Result};
use serde_json::json;

use super::output;

/// Create, list and revoke access tokens of a server.
///
/// Manages access tokens. Only the SHA-256 of a token is stored: the token itself is printed once.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: TokenCommand,
}

#[derive(Subcommand)]
enum TokenCommand {
    /// Create a token and print it.
    ///
    /// Without --data-dir and --token-file nothing is stored: a value for IPLW_TOKENS is printed to standard error.
    New {
        /// Name of the owner of worlds, jobs and policies created with this token.
        name: String,
        /// read (all resources), act (create resources, act in own and shared worlds) or admin (all resources).
        #[arg(long, value_name = "SCOPE")]
        scope: String,
        /// Lifetime: 30d, 12h, 15m, 90s, or never.
        #[arg(long, value_name = "SPAN", default_value = "90d")]
        expires: String,
        #[command(flatten)]
        location: TokenLocation,
    },
    /// List tokens with scope, creation and expiry.
    List {
        #[command(flatten)]
        location: TokenLocation,
    },
    /// Revoke a token; a running server notices within two seconds.
    Revoke {
        /// Name of the owner.
        name: String,
        #[command(flatten)]
        location: TokenLocation,
    },
}

#[derive(clap::Args)]
struct TokenLocation {
    /// Data directory of the server.
    #[arg(long, value_name = "DIR", conflicts_with = "token_file")]
    data_dir: Option<PathBuf>,
    /// Separate token file, for `iplw serve --token-file`.
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
}

impl TokenLocation {
    fn file(&self) -> Option<TokenFile> {
        match (&self.token_file, &self.data_dir) {
            (Some(path), _) => Some(TokenFile::at(path)),
            (None, Some(directory)) => Some(TokenFile::of_directory(directory)),
            (None, None) => None,
        }
    }

    fn required_file(&self) -> Result<TokenFile> {
        self.file()
            .ok_or_else(|| Error::input("--data-dir", "missing", "--data-dir DIR or --token-file FILE"))
    }
}

pub fn run(args: &Args) -> Result<()> {
    match &args.command {
        TokenCommand::New { name, scope, expires, location } => new(name, scope, expires, location),
        TokenCommand::List { location } => list(location),
        TokenCommand::Revoke { name, location } => revoke(name, location),
    }
}

fn new(name: &str, scope: &str, expires: &str, location: &TokenLocation) -> Result<()> {
    HashedToken::check_name("name", name)?;
    let parsed_scope = Scope::from_name("--scope", scope)?;
    let (made, token) = (now(), generate()?);
    let expires = parse_duration("--expires", expires)?.map(|span| made + span);
    let record = HashedToken {
        name: name.into(),
        scope: parsed_scope,
        digest: digest(token.as_bytes()),
        made,
        expires,
    };
    match location.file() {
        Some(file) => {
            file.add(&record)?;
            let until = expires.map_or("forever".into(), |at| format!("until {}", format_time(at)));
            eprintln!(
                "{name} has scope {scope} {until}; saved to {}. The token is printed only once:",
                file.path().display()
            );
        }
        None => {
            let mut row = json!({"name": name, "scope": scope, "sha256": record.digest.hex()});
            if let Some(at) = expires {
                row["expires"] = format_time(at).into();
            }
            eprintln!("IPLW_TOKENS='[{row}]'");
        }
    }
    output::print(&format!("{token}\n"))
}

fn list(location: &TokenLocation) -> Result<()> {
    let file = location.required_file()?;
    let mut text = String::new();
    for record in file.read()?.unwrap_or_default() {
        let until = record.expires.map_or("never expires".into(), |at| {
            format!("{} {}", if record.is_expired(now()) { "expired" } else { "expires" }, format_time(at))
        });
        text += &format!(
            "{:<24} {:<6} made {}  {until}\n",
            record.name,
            record.scope.name(),
            format_time(record.made)
        );
    }
    output::print(&text)
}

fn revoke(name: &str, location: &TokenLocation) -> Result<()> {
    location.required_file()?.revoke(name)
}
