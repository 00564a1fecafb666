//! `iplw check`, `iplw backup` and `iplw restore`: whether a data directory is whole, a copy of it, and the way back.

use std::path::{Path, PathBuf};

use iplw::access::TokenFile;
use iplw::error::{Error, Result};
use iplw::store::{Checked, Finding, backup, check, restore, salvage};

use super::output;

/// Looks at every page, row and file of a data directory, also while a server runs on it: SQLite's integrity check, the
/// checksum of every row, the SHA-256 of all weights, what refers to what, and the tokens. Exit code 1 if anything is damaged.
#[derive(clap::Args)]
pub struct CheckArgs {
    /// The data directory.
    directory: PathBuf,
    /// Leave out what is damaged: every record that is whole goes into a new database, the old one stays beside it as
    /// iplw.sqlite.damaged. A job goes with all that was measured for it if any part of it is damaged. No server may be running.
    #[arg(long)]
    drop: bool,
}

/// Copies a data directory as it is at one moment, also while a server runs on it: jobs, worlds, policies with their weights,
/// and tokens. The copy is looked at as by `iplw check` and is itself a data directory.
#[derive(clap::Args)]
pub struct BackupArgs {
    /// The data directory.
    directory: PathBuf,
    /// The directory to make.
    #[arg(long, value_name = "OUT")]
    to: PathBuf,
}

/// Puts a backup into a data directory, after looking at it. Tokens come back as they were when it was made: what was revoked
/// since is good again until it is revoked anew.
#[derive(clap::Args)]
pub struct RestoreArgs {
    /// The backup.
    backup: PathBuf,
    /// The data directory. No server may be running on it.
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
    /// Take the place of what is there, which goes.
    #[arg(long)]
    replace: bool,
}

/// `iplw check`.
pub fn run_check(args: &CheckArgs) -> Result<()> {
    if args.drop {
        return dropped(&args.directory);
    }
    let mut checked = check(&args.directory)?;
    // A file of tokens that cannot be read lets nobody in; whether the disk or a hand did that is in what is said.
    if let Err(e) = TokenFile::of_directory(&args.directory).read() {
        checked.damaged.push(Finding { record: "tokens.json".into(), how: e.to_string() });
    }
    output::print(&(told(&checked) + &list(&checked.damaged)))?;
    if checked.damaged.is_empty() {
        return Ok(());
    }
    let directory = args.directory.display();
    Err(Error::Failed(format!(
        "{directory} is damaged. With a backup: `iplw restore BACKUP --to {directory} --replace`. Without: copy the directory, \
         then `iplw check {directory} --drop` keeps what is whole (tokens.json: write it anew with `iplw token`)"
    )))
}

fn dropped(directory: &Path) -> Result<()> {
    let saved = salvage(directory)?;
    let count = saved.dropped.len();
    let kept = saved.kept.display();
    output::print(&format!("{}left out: {count}; the database as it was is {kept}\n", list(&saved.dropped)))
}

/// `iplw backup`.
pub fn run_backup(args: &BackupArgs) -> Result<()> {
    let checked = backup(&args.directory, &args.to)?;
    output::print(&format!("{}kept in {}\n", told(&checked), args.to.display()))
}

/// `iplw restore`.
pub fn run_restore(args: &RestoreArgs) -> Result<()> {
    let checked = restore(&args.backup, &args.to, args.replace)?;
    output::print(&format!("{}restored to {}\n", told(&checked), args.to.display()))
}

fn told(checked: &Checked) -> String {
    let rows: Vec<String> = checked.rows.iter().map(|(table, n)| format!("{table} {n}")).collect();
    let mut text = format!("tables of version {}; rows: {}\n", checked.version, rows.join(", "));
    checked.notes.iter().for_each(|note| text += &format!("note: {note}\n"));
    text
}

fn list(damaged: &[Finding]) -> String {
    damaged.iter().map(|f| format!("damaged: {}: {}\n", f.record, f.how)).collect()
}
