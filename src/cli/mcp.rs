//! `iplw mcp`: tools for an AI agent.

use std::path::PathBuf;
use std::sync::Arc;

use iplw::access::Scope;
use iplw::error::{Error, Result};
use iplw::serve::{AccessLog, LogFormat, McpConfig, mcp_blocking};

use super::serve::{environment_variable, init_logging, to_stderr};
use super::task_sources::TaskSources;

/// Serve tools for an AI agent over standard input and output (MCP).
///
/// Serves one agent over standard input and output until the input ends.
#[derive(clap::Args)]
#[command(after_long_help = CONFIGURATION)]
pub struct Args {
    /// Budget of real interactions in each family's real world; with --data-dir, past ones count.
    #[arg(long, value_name = "N", default_value_t = 20)]
    real_interactions: u64,
    /// Scope of the agent: read (list and look) or act (also simulate, measure, estimate, diagnose).
    #[arg(long, value_name = "SCOPE", default_value = "act")]
    scope: String,
    /// Directory for jobs, worlds and spent interactions [default: in memory]
    ///
    /// If it has tokens (`iplw token`), the agent's token is read from the environment variable IPLW_TOKEN and limits its scope.
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
    /// Token file [default: that of the data directory]
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// Log operations and finished jobs to standard error: json or text [default: off]
    #[arg(long, value_name = "FORM")]
    log: Option<String>,
    #[command(flatten)]
    families: TaskSources,
}

/// Configuration of an agent, and an overview of the tools.
const CONFIGURATION: &str = r#"The agent's program starts this command and communicates by MCP, the Model Context Protocol. Usual configuration:

  {
    "mcpServers": {
      "iplw": {
        "command": "iplw",
        "args": ["mcp", "--real-interactions", "20"]
      }
    }
  }

Tools: list_tasks, look, propose_actions, roll_out, measure, estimate, diagnose. Simulation is free. measure and estimate act in real
worlds, whose latents are hidden: every interaction counts, every answer contains the remaining budget, and interactions beyond it are
rejected. Logs go to standard error. See docs/how-to/agents.md, which the agent can read as well."#;

pub fn run(args: &Args) -> Result<()> {
    args.families.load()?;
    let scope = match Scope::from_name("--scope", &args.scope)? {
        Scope::Admin => return Err(Error::input("--scope", "\"admin\"", "read or act")),
        scope => scope,
    };
    let log = match &args.log {
        None => AccessLog::default(),
        Some(form) => AccessLog::new(LogFormat::from_name("--log", form)?, Arc::new(to_stderr)),
    };
    init_logging(args.log.as_deref() == Some("json"));
    mcp_blocking(McpConfig {
        data_dir: args.data_dir.clone(),
        token_file: args.token_file.clone(),
        token: environment_variable("IPLW_TOKEN")?,
        scope,
        real_interactions: args.real_interactions,
        log,
    })
}
