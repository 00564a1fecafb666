//! Where results go, and progress on a terminal.

use std::io::Write;
use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use iplw::error::{Error, Result};
use iplw::progress::Progress;
pub use iplw::store::write_whole;

/// Rows under a header as CSV; cells are quoted where they must be.
pub fn csv(header: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> Result<Vec<u8>> {
    let failed = |e: csv::Error| Error::Failed(format!("a table could not be written as CSV: {e}"));
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(header).map_err(failed)?;
    for row in rows {
        writer.write_record(row).map_err(failed)?;
    }
    writer.into_inner().map_err(|e| Error::Failed(e.to_string()))
}

/// Makes the directory for results that `option` names, so that a place that cannot be written to is refused before the
/// work, not after.
pub fn directory(option: &str, path: &Path) -> Result<()> {
    std::fs::create_dir_all(path).map_err(|e| match path.ancestors().find(|p| p.is_file()) {
        Some(file) => {
            Error::input(option, file.display(), "a directory, or a name not taken yet: that is a file")
        }
        None => Error::io(path, e),
    })
}

/// The same for a single file, which is written when the work is done.
pub fn file(option: &str, path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Error::input(option, path.display(), "the name of a file: that is a directory"));
    }
    parent(path).map_or(Ok(()), |p| directory(option, p))
}

fn parent(path: &Path) -> Option<&Path> {
    path.parent().filter(|p| !p.as_os_str().is_empty())
}

/// Writes to standard output; a reader that went away (`| head`) is no error.
pub fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::Io { path: "standard output".into(), message: e.to_string() })
        }
        _ => Ok(()),
    }
}

/// A bar on stderr when it is a terminal, a line per stage otherwise.
pub struct Bar {
    bar: ProgressBar,
    stage: Mutex<String>,
    plain: bool,
}

impl Bar {
    /// A bar that shows itself once there is something to tell.
    pub fn new() -> Bar {
        let plain = !std::io::IsTerminal::is_terminal(&std::io::stderr());
        let bar = ProgressBar::with_draw_target(Some(1), ProgressDrawTarget::stderr_with_hz(8));
        let style = ProgressStyle::with_template("  {wide_msg} {bar:24} {percent:>3}% {elapsed} left {eta}")
            .expect("the template is a constant that parses");
        bar.set_style(style);
        bar.enable_steady_tick(Duration::from_millis(250));
        if plain {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        Bar { bar, stage: Mutex::new(String::new()), plain }
    }

    /// Takes the bar away.
    pub fn clear(&self) {
        self.bar.finish_and_clear();
    }
}

impl Progress for Bar {
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
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Quotes were once written as they were, and a name with one could not be read back.
    #[test]
    fn cells_with_quotes_and_line_ends_read_back_the_same() {
        let cells = ["the \"second\"", "a,b", "one\rtwo\nthree", ""].map(String::from).to_vec();
        let written = csv(&["a", "b", "c", "d"], [cells.clone()]).unwrap();
        let mut reader = csv::Reader::from_reader(written.as_slice());
        let row = reader.records().next().unwrap().unwrap();
        assert_eq!(row.iter().collect::<Vec<_>>(), cells);
    }
}
