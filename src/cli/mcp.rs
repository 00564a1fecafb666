//! `iplw mcp`.

use std::path::PathBuf;
use std::sync::Arc;

use iplw::access::Scope;
use iplw::error::{Error, Result};
use iplw::serve::{Log, LogForm, McpConfig, mcp_blocking};

use super::own::OwnFamilies;
use super::serve::{environment, notices, to_stderr};

/// Serves one agent until its input ends.
#[derive(clap::Args)]
#[command(after_long_help = CONFIGURATION)]
pub struct Args {
    /// Most real interactions in the real world of each family. With --data-dir those spent before count as well.
    #[arg(long, value_name = "N", default_value_t = 20)]
    real_interactions: u64,
    /// What the agent may do: read (list and look) or act (simulate, measure, estimate and diagnose as well). With a token
    /// (IPLW_TOKEN), no more than the token allows.
    #[arg(long, value_name = "SCOPE", default_value = "act")]
    may: String,
    /// Directory for jobs, worlds and what was spent; without it all of it lasts as long as the conversation. Where it has tokens
    /// (`iplw token`), the agent's is read from the environment variable IPLW_TOKEN.
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
    /// Tokens of a file instead of the data directory's.
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// Write a line for each operation and each job that ends to standard error: json or text.
    #[arg(long, value_name = "FORM")]
    log: Option<String>,
    #[command(flatten)]
    families: OwnFamilies,
}

/// What people put where their agent looks, and what it gets.
const CONFIGURATION: &str = r#"The agent's program starts it and speaks MCP, the Model Context Protocol, to it. Its configuration usually takes this:

  {
    "mcpServers": {
      "iplw": {
        "command": "iplw",
        "args": ["mcp", "--real-interactions", "20"]
      }
    }
  }

Tools: list_tasks, look, propose_actions, roll_out, measure, estimate, diagnose. Simulation is free. measure and estimate act
in real worlds, whose latents are hidden: each interaction is counted, what is left is told with every answer, and what goes
beyond the budget is refused. Standard output is the protocol's alone; what else there is to say goes to standard error.
docs/agents.md tells more, which the agent can read as well."#;

pub fn run(args: &Args) -> Result<()> {
    args.families.take()?;
    let may = match Scope::from_name("--may", &args.may)? {
        Scope::Admin => return Err(Error::input("--may", "\"admin\"", "read or act")),
        may => may,
    };
    let log = match &args.log {
        None => Log::default(),
        Some(form) => Log::new(LogForm::from_name("--log", form)?, Arc::new(to_stderr)),
    };
    notices();
    mcp_blocking(McpConfig {
        data_dir: args.data_dir.clone(),
        token_file: args.token_file.clone(),
        token: environment("IPLW_TOKEN")?,
        may,
        real_interactions: args.real_interactions,
        log,
    })
}
