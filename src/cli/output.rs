//! Output of results and progress.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use iplw::error::{Error, Result};
use iplw::progress::Progress;
use serde::Serialize;

/// Files that this process wrote.
static WRITTEN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Writes an output file atomically, and says on stderr if it replaces an older file with other contents.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let replaces = path.is_file() && std::fs::read(path).map_or(true, |old| old != bytes);
    iplw::store::write_whole(path, bytes)?;
    let first = WRITTEN.lock().unwrap_or_else(std::sync::PoisonError::into_inner).insert(path.to_path_buf());
    if replaces && first {
        eprintln!("replaced {}", path.display());
    }
    Ok(())
}

/// Rows with a header as CSV, quoted where necessary.
pub fn csv(header: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> Result<Vec<u8>> {
    let failed = |e: csv::Error| Error::Failed(format!("cannot write the table as CSV: {e}"));
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(header).map_err(failed)?;
    for row in rows {
        writer.write_record(row).map_err(failed)?;
    }
    writer.into_inner().map_err(|e| Error::Failed(e.to_string()))
}

/// Creates the output directory given by `option`, so that errors occur before the computation.
pub fn prepare_directory(option: &str, path: &Path) -> Result<()> {
    std::fs::create_dir_all(path).map_err(|e| match path.ancestors().find(|p| p.is_file()) {
        Some(file) => Error::input(option, file.display(), "a directory or a new name; this is a file"),
        None => Error::io(path, e),
    })
}

/// Checks that an output file can be created, and creates its directory.
pub fn prepare_file(option: &str, path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Error::input(option, path.display(), "the name of a file; this is a directory"));
    }
    parent(path).map_or(Ok(()), |p| prepare_directory(option, p))
}

fn parent(path: &Path) -> Option<&Path> {
    path.parent().filter(|p| !p.as_os_str().is_empty())
}

/// Indented JSON with a newline at the end.
pub fn pretty_json(value: &impl Serialize) -> Result<String> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Error::Failed(e.to_string()))?;
    Ok(text + "\n")
}

/// Writes to standard output; a closed pipe (`| head`) is no error.
pub fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::Io { path: "standard output".into(), message: e.to_string() })
        }
        _ => Ok(()),
    }
}

/// A progress bar on stderr if it is a terminal, otherwise a line per stage.
pub struct TerminalProgress {
    bar: ProgressBar,
    stage: Mutex<String>,
    plain: bool,
}

impl TerminalProgress {
    /// A progress bar that appears with the first report.
    pub fn new() -> TerminalProgress {
        let plain = !std::io::IsTerminal::is_terminal(&std::io::stderr());
        let bar = ProgressBar::with_draw_target(Some(1), ProgressDrawTarget::stderr_with_hz(8));
        let style = ProgressStyle::with_template("  {wide_msg} {bar:24} {percent:>3}% {elapsed} left {eta}")
            .expect("the template is a constant that parses");
        bar.set_style(style);
        bar.enable_steady_tick(Duration::from_millis(250));
        if plain {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        TerminalProgress { bar, stage: Mutex::new(String::new()), plain }
    }

    /// Removes the bar.
    pub fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

impl Progress for TerminalProgress {
    fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
        let mut current = self.stage.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if *current != stage {
            *current = stage.to_string();
            if self.plain {
                eprintln!("  {stage}");
            }
            self.bar.reset();
            self.bar.set_message(stage.to_string());
        }
        self.bar.set_length(total.max(1));
        self.bar.set_position(done);
        Ok(())
    }

    fn note(&self, text: &str) {
        if self.plain {
            eprintln!("    {text}");
        } else {
            self.bar.println(format!("  {text}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotes_and_line_breaks_survive_csv() {
        let cells = ["the \"second\"", "a,b", "one\rtwo\nthree", ""].map(String::from).to_vec();
        let written = csv(&["a", "b", "c", "d"], [cells.clone()]).unwrap();
        let mut reader = csv::Reader::from_reader(written.as_slice());
        let row = reader.records().next().unwrap().unwrap();
        assert_eq!(row.iter().collect::<Vec<_>>(), cells);
    }
}
