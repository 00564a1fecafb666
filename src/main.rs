//! The command line: `iplw <command>`; every command is a file in `cli/`.
//!
//! Exit codes: 0 done; 1 failed while working; 2 bad input (one clear line on stderr, nothing written).

#![forbid(unsafe_code)]

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
