//! The command-line program `iplw <command>`; every command has its own file in `cli/`.
//!
//! Exit codes: 0 success; 1 failure; 2 invalid input (one line on stderr, nothing written).

#![forbid(unsafe_code)]

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
