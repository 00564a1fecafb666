//! `iplw check`, `iplw backup` and `iplw restore`: integrity, backup and restoration of a data directory.

use std::path::{Path, PathBuf};

use iplw::access::TokenFile;
use iplw::error::{Error, Result};
use iplw::store::{CheckReport, DamagedRecord, backup, check, restore, salvage};

use super::output;

/// Check the integrity of a data directory.
///
/// Checks a data directory, even while a server uses it: SQLite's integrity check, the checksum of every row, the SHA-256 of all
/// weights, references, and tokens. Exit code 1 if anything is damaged.
#[derive(clap::Args)]
pub struct CheckArgs {
    /// The data directory.
    directory: PathBuf,
    /// Drop damaged records: intact ones are copied to a new database (stop the server first).
    ///
    /// The old database is kept as iplw.sqlite.damaged. A job is dropped with its measurements if any part of it is damaged.
    #[arg(long)]
    drop: bool,
}

/// Back up a data directory, even while a server uses it.
///
/// Copies a consistent snapshot of a data directory, even while a server uses it: jobs, worlds, policies with their weights, and tokens.
/// The copy is checked as by `iplw check` and is itself a data directory.
#[derive(clap::Args)]
pub struct BackupArgs {
    /// The data directory.
    directory: PathBuf,
    /// The directory to create.
    #[arg(long, value_name = "OUT")]
    to: PathBuf,
}

/// Restore a backup into a data directory.
///
/// Checks a backup and restores it into a data directory. Tokens are restored, too: those revoked since the backup are valid again
/// until revoked anew.
#[derive(clap::Args)]
pub struct RestoreArgs {
    /// The backup.
    backup: PathBuf,
    /// The data directory (stop its server first).
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
    /// Replace an existing data directory.
    #[arg(long)]
    replace: bool,
}

/// `iplw check`.
pub fn run_check(args: &CheckArgs) -> Result<()> {
    if args.drop {
        return salvage_directory(&args.directory);
    }
    let mut checked = check(&args.directory)?;
    // With an unreadable token file the server rejects all requests.
    if let Err(e) = TokenFile::of_directory(&args.directory).read() {
        checked.damaged.push(DamagedRecord { record: "tokens.json".into(), how: e.to_string() });
    }
    output::print(&(summary(&checked) + &list(&checked.damaged)))?;
    if checked.damaged.is_empty() {
        return Ok(());
    }
    let directory = args.directory.display();
    Err(Error::Failed(format!(
        "{directory} is damaged. Restore a backup with `iplw restore BACKUP --to {directory} --replace`. Without a backup, copy the \
         directory, then drop damaged records with `iplw check {directory} --drop` (recreate tokens.json with `iplw token`)"
    )))
}

fn salvage_directory(directory: &Path) -> Result<()> {
    let saved = salvage(directory)?;
    let count = saved.dropped.len();
    let kept = saved.damaged_copy.display();
    output::print(&format!("{}records dropped: {count}; the old database is {kept}\n", list(&saved.dropped)))
}

/// `iplw backup`.
pub fn run_backup(args: &BackupArgs) -> Result<()> {
    let checked = backup(&args.directory, &args.to)?;
    output::print(&format!("{}saved to {}\n", summary(&checked), args.to.display()))
}

/// `iplw restore`.
pub fn run_restore(args: &RestoreArgs) -> Result<()> {
    let checked = restore(&args.backup, &args.to, args.replace)?;
    output::print(&format!("{}restored to {}\n", summary(&checked), args.to.display()))
}

fn summary(checked: &CheckReport) -> String {
    let rows: Vec<String> = checked.rows.iter().map(|(table, n)| format!("{table} {n}")).collect();
    let mut text = format!("schema version {}; rows: {}\n", checked.version, rows.join(", "));
    checked.notes.iter().for_each(|note| text += &format!("note: {note}\n"));
    text
}

fn list(damaged: &[DamagedRecord]) -> String {
    damaged.iter().map(|f| format!("damaged: {}: {}\n", f.record, f.how)).collect()
}
