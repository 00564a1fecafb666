//! Options common to all commands that compute: threads, task families, and stopping with the parent process.

use std::io::Read;

use iplw::error::{Error, Result};

use super::task_sources::{COMMON_OPTIONS, TaskSources};

/// Description of the common options, shown once in the program's own help.
pub const COMMON_OPTIONS_HELP: &str = "\
Common options of commands:
  --threads <N>
          Number of threads. The results are the same to the bit with any number.
          Default: the environment variable RAYON_NUM_THREADS, or all cores.
  --tasks <NAME|DIR>
          Adds task families to the built-in ones (bowling, basketball); may be repeated. NAME is a collection that comes with the
          program: `levels` (need knowledge of a latent) or `phyre` (PHYRE's 25 one-ball templates). DIR is a directory of your own
          families, *.toml files with their certified tasks (see `iplw tasks check`).
          Default: the environment variable IPLW_TASKS, with the separator of PATH.
  --exit-with-stdin
          Stops the command when its standard input closes, so that it ends with the program that started it.

Exit codes: 0 success; 1 failure; 2 invalid input (nothing is written).";

// A command's options followed by the common options.
#[derive(clap::Args)]
pub struct ComputeArgs<A: clap::Args> {
    #[command(flatten)]
    options: A,
    #[command(flatten)]
    threads: ThreadOptions,
    #[command(flatten)]
    families: TaskSources,
    /// Stop when standard input closes.
    #[arg(long, help_heading = COMMON_OPTIONS)]
    exit_with_stdin: bool,
}

impl<A: clap::Args> ComputeArgs<A> {
    /// Applies the common options and runs `command` with its options.
    pub fn run(&self, command: fn(&A) -> Result<()>) -> Result<()> {
        warnings_to_stderr();
        self.threads.install()?;
        self.families.load()?;
        if self.exit_with_stdin {
            // Unlike a server's end, this is a failure: there is no result.
            exit_with_stdin(1);
        }
        command(&self.options)
    }

    /// [`ComputeArgs::run`] for a command that may read standard input; `reads` returns whether it does.
    pub fn run_reading(&self, reads: fn(&A) -> bool, command: fn(&A) -> Result<()>) -> Result<()> {
        if self.exit_with_stdin && reads(&self.options) {
            let allowed = "not given while the command reads standard input; pass a file with --in";
            return Err(Error::input("--exit-with-stdin", "given", allowed));
        }
        self.run(command)
    }
}

/// Prints warnings of the computation on stderr.
fn warnings_to_stderr() {
    let lines = tracing_subscriber::fmt().with_writer(std::io::stderr).with_max_level(tracing::Level::WARN);
    lines.without_time().with_target(false).init();
}

// The number of threads.
#[derive(clap::Args)]
pub struct ThreadOptions {
    /// Number of threads [default: all cores]
    #[arg(long, value_name = "N", help_heading = COMMON_OPTIONS, value_parser = clap::value_parser!(u64).range(1..=1024))]
    threads: Option<u64>,
}

impl ThreadOptions {
    /// Configures rayon's global thread pool.
    pub fn install(&self) -> Result<()> {
        let Some(threads) = self.threads else { return Ok(()) };
        let made = rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build_global();
        made.map_err(|e| Error::Failed(format!("cannot start {threads} threads: {e}")))
    }
}

/// Exits the process with `code` when its standard input closes, which also happens if the process at its other end is killed.
pub fn exit_with_stdin(code: i32) {
    std::thread::spawn(move || {
        // The input itself is discarded.
        let _ = std::io::copy(&mut std::io::stdin().lock().by_ref(), &mut std::io::sink());
        std::process::exit(code);
    });
}
