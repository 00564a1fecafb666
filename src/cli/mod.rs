//! Commands, common options, and output.

mod agents;
mod arrays;
mod cell_store;
mod common_options;
mod compact_json;
mod data_directory;
mod design;
mod diagnose;
mod documentation;
mod effects;
mod estimate;
mod excite;
mod experiment;
mod import;
mod joint_arrays;
mod joints;
mod json_events;
mod mcp;
mod measure;
mod outcomes;
mod output;
mod parse;
mod plan;
mod plan_report;
mod posterior;
mod rollout;
mod rollout_arrays;
mod serve;
mod surface;
mod task_sources;
mod tasks;
mod token;
mod track_options;
mod train;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use iplw::error::Error;

use common_options::{COMMON_OPTIONS_HELP, ComputeArgs};

/// Find out what a 2D physics simulation gets wrong from a few measurements, fix it, and train policies in the result.
///
/// Start with `iplw run`: it explores a hidden world, estimates its latent factors, trains a policy in the calibrated simulation and
/// evaluates it in the hidden world. `iplw serve` provides the same worlds over HTTP.
#[derive(Parser)]
#[command(name = "iplw", version, max_term_width = 110, after_long_help = COMMON_OPTIONS_HELP)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

// The help of a command is the doc comment of its arguments: one short line, then the details.
#[derive(Subcommand)]
enum Command {
    Run(ComputeArgs<experiment::RunArgs>),
    Experiment(ComputeArgs<experiment::ExperimentArgs>),
    Serve(serve::Args),
    Mcp(mcp::Args),
    Token(token::Args),
    Check(data_directory::CheckArgs),
    Backup(data_directory::BackupArgs),
    Restore(data_directory::RestoreArgs),
    Rollout(ComputeArgs<rollout::Args>),
    Import(import::Args),
    Tasks(tasks::Args),
    Effects(effects::Args),
    Measure(ComputeArgs<measure::Args>),
    Estimate(ComputeArgs<estimate::Args>),
    Surface(ComputeArgs<surface::Args>),
    Diagnose(ComputeArgs<diagnose::Args>),
    Posterior(ComputeArgs<posterior::Args>),
    Design(ComputeArgs<design::Args>),
    Excite(ComputeArgs<excite::Args>),
    Train(ComputeArgs<train::TrainArgs>),
    Evaluate(ComputeArgs<train::EvaluateArgs>),
    Plan(ComputeArgs<plan::Args>),
    Outcomes(ComputeArgs<outcomes::Args>),
    Agents(ComputeArgs<agents::Args>),
    /// Print the OpenAPI document.
    Openapi,
    Completions(documentation::CompletionsArgs),
    /// Write manual pages.
    #[command(hide = true)]
    Man(documentation::ManArgs),
}

/// The command-line parser, for completions and manual pages.
fn command() -> clap::Command {
    Cli::command()
}

/// Parses the command line, runs the command, turns errors into exit codes.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error)
            if error.use_stderr()
                && error.kind() != clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand =>
        {
            eprintln!("iplw: {}", one_line(&error.to_string()));
            return ExitCode::from(2);
        }
        // Help and version.
        Err(error) => error.exit(),
    };
    let result = match cli.command {
        Command::Run(args) => args.run(experiment::run),
        Command::Experiment(args) => args.run(experiment::experiment),
        Command::Serve(args) => serve::run(&args),
        Command::Mcp(args) => mcp::run(&args),
        Command::Token(args) => token::run(&args),
        Command::Check(args) => data_directory::run_check(&args),
        Command::Backup(args) => data_directory::run_backup(&args),
        Command::Restore(args) => data_directory::run_restore(&args),
        Command::Openapi => serve::print_openapi(),
        Command::Completions(args) => documentation::print_completions(&args, command()),
        Command::Man(args) => documentation::write_man_pages(&args, command()),
        Command::Rollout(args) => args.run_reading(rollout::reads_stdin, rollout::run),
        Command::Import(args) => import::run(&args),
        Command::Tasks(args) => tasks::run(&args),
        Command::Effects(args) => effects::run(&args),
        Command::Measure(args) => args.run(measure::run),
        Command::Estimate(args) => args.run(estimate::run),
        Command::Surface(args) => args.run(surface::run),
        Command::Diagnose(args) => args.run(diagnose::run),
        Command::Posterior(args) => args.run(posterior::run),
        Command::Design(args) => args.run(design::run),
        Command::Excite(args) => args.run(excite::run),
        Command::Train(args) => args.run(train::train_policy),
        Command::Evaluate(args) => args.run(train::evaluate_policy),
        Command::Plan(args) => args.run(plan::run),
        Command::Outcomes(args) => args.run(outcomes::run),
        Command::Agents(args) => args.run(agents::run),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("iplw: {error}");
            ExitCode::from(exit_code(&error))
        }
    }
}

/// A parser's message on one line, without usage.
fn one_line(message: &str) -> String {
    let summary =
        message.split("\n\nUsage:").next().unwrap_or(message).split("\n\nFor more").next().unwrap_or(message);
    let parts: Vec<&str> = summary.lines().map(str::trim).filter(|l| !l.is_empty()).collect();
    format!("{}; see --help", parts.join(" ").trim_start_matches("error: "))
}

/// 2 for errors in the input, 1 for all others.
fn exit_code(error: &Error) -> u8 {
    match error {
        Error::Input(_)
        | Error::NotFound { .. }
        | Error::Refused { .. }
        | Error::Sealed { .. }
        | Error::TooLarge { .. } => 2,
        Error::Io { .. }
        | Error::Damaged { .. }
        | Error::Budget { .. }
        | Error::Capacity { .. }
        | Error::Interrupted { .. }
        | Error::Denied { .. }
        | Error::Cancelled
        | Error::Deadline { .. }
        | Error::Failed(_) => 1,
        Error::Entry { error, .. } => exit_code(error),
    }
}
