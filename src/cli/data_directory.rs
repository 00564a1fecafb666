//! `iplw check`, `iplw backup` and `iplw restore`: integrity, backup and restoration of a data directory.

use std::path::{Path, PathBuf};

use iplw::access::TokenFile;
use iplw::error::{Error, Result};
use iplw::store::{CheckReport, DamagedRecord, backup, check, restore, salvage};

use super::output;
use super::serve::environment_variable;

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
    /// Token file of the server [default: that of the data directory; also $IPLW_TOKENS]
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
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
    let tokens = match &args.token_file {
        Some(path) => TokenFile::at(path),
        None => TokenFile::of_directory(&args.directory),
    };
    // The server does not start with an unreadable token file, nor without one if records belong to tokens.
    let how = match tokens.read() {
        Err(e @ Error::Refused { .. }) => return Err(e),
        Err(e) => Some(e.to_string()),
        Ok(None) if lacks_tokens(&checked)? => Some(MISSING_TOKENS.into()),
        Ok(_) => None,
    };
    let record = tokens.path().file_name().unwrap_or_default().display().to_string();
    checked.damaged.extend(how.map(|how| DamagedRecord { record, how }));
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

const MISSING_TOKENS: &str = "the file is missing, although records belong to tokens";

/// Whether records belong to tokens, and the environment has no tokens.
fn lacks_tokens(checked: &CheckReport) -> Result<bool> {
    Ok(checked.has_owners && environment_variable("IPLW_TOKENS")?.is_none())
}

/// Warns of a copy without the tokens that its records belong to.
fn warn_of_missing_tokens(directory: &Path, checked: &CheckReport) -> Result<()> {
    let file = TokenFile::of_directory(directory);
    if !file.path().exists() && lacks_tokens(checked)? {
        let (file, directory) = (file.path().display(), directory.display());
        eprintln!(
            "{file}: {MISSING_TOKENS}; a server starts on it only with --token-file, IPLW_TOKENS, or after `iplw token new NAME \
             --scope admin --data-dir {directory}`"
        );
    }
    Ok(())
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
    warn_of_missing_tokens(&args.to, &checked)?;
    output::print(&format!("{}saved to {}\n", summary(&checked), args.to.display()))
}

/// `iplw restore`.
pub fn run_restore(args: &RestoreArgs) -> Result<()> {
    let checked = restore(&args.backup, &args.to, args.replace)?;
    warn_of_missing_tokens(&args.to, &checked)?;
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
