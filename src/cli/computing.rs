//! What every command that computes takes beside its own options: its threads, and whom it ends with.

use std::io::Read;

use iplw::error::{Error, Result};

use super::own::OwnFamilies;

/// A command's own options, and those that all have that compute.
#[derive(clap::Args)]
pub struct Computing<A: clap::Args> {
    #[command(flatten)]
    own: A,
    #[command(flatten)]
    threads: Threads,
    #[command(flatten)]
    families: OwnFamilies,
    /// Stop when standard input closes: the command ends with the program that started it.
    #[arg(long)]
    exit_with_stdin: bool,
}

impl<A: clap::Args> Computing<A> {
    /// Runs `command` on its own options.
    pub fn run(&self, command: fn(&A) -> Result<()>) -> Result<()> {
        self.threads.take()?;
        self.families.take()?;
        if self.exit_with_stdin {
            // What was asked for is not there: a failure, other than a server's end.
            exit_with_stdin(1);
        }
        command(&self.own)
    }

    /// The same for a command that may read standard input itself, as `reads` says.
    pub fn run_reading(&self, reads: fn(&A) -> bool, command: fn(&A) -> Result<()>) -> Result<()> {
        if self.exit_with_stdin && reads(&self.own) {
            let allowed = "absent where standard input is what the command reads; name a file with --in";
            return Err(Error::input("--exit-with-stdin", "given", allowed));
        }
        self.run(command)
    }
}

/// How many threads there are.
#[derive(clap::Args)]
pub struct Threads {
    /// Threads to compute with; results are the same to the bit with any number. If not given, RAYON_NUM_THREADS says
    /// it, and else there are as many as cores.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1024))]
    threads: Option<u64>,
}

impl Threads {
    /// Makes rayon's pool, which everything computes in, of that many.
    pub fn take(&self) -> Result<()> {
        let Some(threads) = self.threads else { return Ok(()) };
        let made = rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build_global();
        made.map_err(|e| Error::Failed(format!("no {threads} threads to compute with: {e}")))
    }
}

/// From now on this process ends, with `code`, when its standard input does. The system closes that however the one at
/// its other end goes, SIGKILL included.
pub fn exit_with_stdin(code: i32) {
    std::thread::spawn(move || {
        // Whatever comes is of no interest; the end is.
        let _ = std::io::copy(&mut std::io::stdin().lock().by_ref(), &mut std::io::sink());
        std::process::exit(code);
    });
}
