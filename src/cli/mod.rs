//! Commands, their shared options, and what they print.

mod agents;
mod along;
mod cells;
mod computing;
mod design;
mod diagnose;
mod effects;
mod estimate;
mod evidence;
mod experiment;
mod keep;
mod launches;
mod layout;
mod mcp;
mod measure;
mod outcomes;
mod output;
mod own;
mod parse;
mod plan;
mod planned;
mod posterior;
mod rollout;
mod serve;
mod surface;
mod tasks;
mod token;
mod tracks;
mod train;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use iplw::error::Error;

use computing::Computing;

/// Worlds to act in, latent factors to estimate, policies to transfer.
///
/// Start with `iplw run`: a hidden world, its latents estimated, a policy trained in the grounded simulation
/// and transferred. `iplw serve` puts the same worlds behind HTTP.
#[derive(Parser)]
#[command(name = "iplw", version, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// The story: hidden world, exploration, estimate, policies, transfer, report.
    Run(Computing<experiment::RunArgs>),
    /// Experiments with their baselines, over several seeds.
    Experiment(Computing<experiment::ExperimentArgs>),
    /// Serve worlds over HTTP.
    Serve(serve::Args),
    /// Serve an agent: tools to look, simulate, measure within a budget and diagnose, over standard input and output (MCP).
    Mcp(mcp::Args),
    /// Make, list and revoke the tokens by which a server knows who asks.
    Token(token::Args),
    /// Say whether a data directory is whole, and what of it is not.
    Check(keep::CheckArgs),
    /// Copy a data directory, also while a server runs on it.
    Backup(keep::BackupArgs),
    /// Put a backup into a data directory.
    Restore(keep::RestoreArgs),
    /// Roll scenes out: one scene a line in, one result a line out.
    Rollout(Computing<rollout::Args>),
    /// List tasks, splits and action spaces.
    Tasks(tasks::Args),
    /// List the effects that worlds may have, with their parameters.
    Effects(effects::Args),
    /// Measure trials in a hidden world: writes scene.json and trials.csv.
    Measure(Computing<measure::Args>),
    /// Estimate the latent factors of a hidden real world.
    Estimate(Computing<estimate::Args>),
    /// Find which latents a task's performance depends on, in a related, known environment.
    Surface(Computing<surface::Args>),
    /// Say what a simulation gets wrong, from measured trials.
    ///
    /// Trials are held against the simulation of a scene, or of one ball: the effect that is missing is named with its
    /// parameters; or several are, if the data cannot tell them apart; or it is said that nothing in the library explains
    /// the misfit. Writes report.html, report.json, extended_scene.json (the scene with what was found) and the plots.
    Diagnose(Computing<diagnose::Args>),
    /// Draw what is known of latents and effects from the posterior, given measured trials.
    Posterior(Computing<posterior::Args>),
    /// Say which experiment would tell the most about a question: latents, effects, or whether plans work.
    Design(Computing<design::Args>),
    /// Train a policy in simulation; writes its weights.
    Train(Computing<train::TrainArgs>),
    /// Try a policy in a hidden world.
    Evaluate(Computing<train::EvaluateArgs>),
    /// Rank a task's actions by how likely they solve it under what is believed; of a family, try the orders in a hidden world.
    Plan(Computing<plan::Args>),
    /// Find out what many actions do in every task of a family; writes NumPy arrays.
    Outcomes(Computing<outcomes::Args>),
    /// Compare agents over many families, from such tables: AUCCESS within and across families.
    Agents(Computing<agents::Args>),
    /// Print the OpenAPI document.
    Openapi,
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
        // Help and version, wanted or needed.
        Err(error) => error.exit(),
    };
    let done = match cli.command {
        Command::Run(args) => args.run(experiment::run),
        Command::Experiment(args) => args.run(experiment::experiment),
        Command::Serve(args) => serve::run(&args),
        Command::Mcp(args) => mcp::run(&args),
        Command::Token(args) => token::run(&args),
        Command::Check(args) => keep::run_check(&args),
        Command::Backup(args) => keep::run_backup(&args),
        Command::Restore(args) => keep::run_restore(&args),
        Command::Openapi => serve::print_openapi(),
        Command::Rollout(args) => args.run_reading(rollout::reads_stdin, rollout::run),
        Command::Tasks(args) => tasks::run(&args),
        Command::Effects(args) => effects::run(&args),
        Command::Measure(args) => args.run(measure::run),
        Command::Estimate(args) => args.run(estimate::run),
        Command::Surface(args) => args.run(surface::run),
        Command::Diagnose(args) => args.run(diagnose::run),
        Command::Posterior(args) => args.run(posterior::run),
        Command::Design(args) => args.run(design::run),
        Command::Train(args) => args.run(train::train_policy),
        Command::Evaluate(args) => args.run(train::evaluate_policy),
        Command::Plan(args) => args.run(plan::run),
        Command::Outcomes(args) => args.run(outcomes::run),
        Command::Agents(args) => args.run(agents::run),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("iplw: {error}");
            ExitCode::from(exit_code(&error))
        }
    }
}

/// A parser's message without its usage, which `--help` tells better.
fn one_line(message: &str) -> String {
    let said =
        message.split("\n\nUsage:").next().unwrap_or(message).split("\n\nFor more").next().unwrap_or(message);
    let parts: Vec<&str> = said.lines().map(str::trim).filter(|l| !l.is_empty()).collect();
    format!("{}; see --help", parts.join(" ").trim_start_matches("error: "))
}

/// 2 for what the user can put right in the input, 1 for the rest.
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
