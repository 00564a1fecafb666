//! `iplw token`: who may do what on a server.

use std::path::PathBuf;

use clap::Subcommand;
use iplw::access::{Kept, Scope, TokenFile, days, digest, fresh, now, written};
use iplw::error::{Error, Result};
use serde_json::json;

use super::output;

/// Tokens, by which a server knows who asks. Of a token its SHA-256 is kept: it is shown once.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Make a token and print it. With neither file nor directory nothing is kept: the row for IPLW_TOKENS is printed
    /// to standard error.
    New {
        /// Whose it is: worlds, jobs and policies made with it belong to this name.
        name: String,
        /// read: see everybody's things. act: make worlds, jobs and policies and act in one's own and in the shared
        /// worlds. admin: the same with everybody's.
        #[arg(long, value_name = "SCOPE")]
        may: String,
        /// How long it is good: 30d, 12h, 15m, 90s, or never.
        #[arg(long, value_name = "SPAN", default_value = "90d")]
        expires: String,
        #[command(flatten)]
        place: Place,
    },
    /// List tokens: name, scope, when made, until when.
    List {
        #[command(flatten)]
        place: Place,
    },
    /// Take a token back; a running server knows within a second or two.
    Revoke {
        /// Whose it is.
        name: String,
        #[command(flatten)]
        place: Place,
    },
}

#[derive(clap::Args)]
struct Place {
    /// The server's data directory, which keeps the tokens of those who may ask it.
    #[arg(long, value_name = "DIR", conflicts_with = "token_file")]
    data_dir: Option<PathBuf>,
    /// A file of tokens by itself, for `iplw serve --token-file`.
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
}

impl Place {
    fn file(&self) -> Option<TokenFile> {
        match (&self.token_file, &self.data_dir) {
            (Some(path), _) => Some(TokenFile::at(path)),
            (None, Some(directory)) => Some(TokenFile::of_directory(directory)),
            (None, None) => None,
        }
    }

    fn needed(&self) -> Result<TokenFile> {
        self.file()
            .ok_or_else(|| Error::input("--data-dir", "missing", "--data-dir DIR or --token-file FILE"))
    }
}

pub fn run(args: &Args) -> Result<()> {
    match &args.command {
        Command::New { name, may, expires, place } => new(name, may, expires, place),
        Command::List { place } => list(place),
        Command::Revoke { name, place } => revoke(name, place),
    }
}

fn new(name: &str, may: &str, expires: &str, place: &Place) -> Result<()> {
    Kept::check_name("name", name)?;
    let scope = Scope::from_name("--may", may)?;
    let (made, token) = (now(), fresh()?);
    let expires = days("--expires", expires)?.map(|span| made + span);
    let kept = Kept { name: name.into(), scope, digest: digest(token.as_bytes()), made, expires };
    match place.file() {
        Some(file) => {
            file.add(&kept)?;
            let until = expires.map_or("for ever".into(), |at| format!("until {}", written(at)));
            eprintln!(
                "{name} may {may} {until}; kept in {}. The token is shown this once:",
                file.path().display()
            );
        }
        None => {
            let mut row = json!({"name": name, "may": may, "sha256": kept.digest.hex()});
            if let Some(at) = expires {
                row["expires"] = written(at).into();
            }
            eprintln!("IPLW_TOKENS='[{row}]'");
        }
    }
    output::print(&format!("{token}\n"))
}

fn list(place: &Place) -> Result<()> {
    let file = place.needed()?;
    let mut text = String::new();
    for kept in file.read()?.unwrap_or_default() {
        let until = kept.expires.map_or("never expires".into(), |at| {
            format!("{} {}", if kept.ended(now()) { "expired" } else { "expires" }, written(at))
        });
        text += &format!("{:<24} {:<6} made {}  {until}\n", kept.name, kept.scope.name(), written(kept.made));
    }
    output::print(&text)
}

fn revoke(name: &str, place: &Place) -> Result<()> {
    place.needed()?.revoke(name)
}
