//! MCP, the Model Context Protocol, over standard input and output: an agent looks, proposes, rolls out, measures within a
//! budget and diagnoses. The sole home of `rmcp`, which speaks the protocol and negotiates its version.
//!
//! | file | what it does |
//! |---|---|
//! | `tools/` | what an agent can call: each a few of the server's operations, put together; one file a tool |
//! | `tool` | how a tool is declared, what it is given and what it gives |
//! | `desk` | asks for operations as one who is known; the real worlds with their budgets, and the jobs begun |
//! | `here` | the operations, done in this process |
//! | `handler` | the protocol's requests |
//! | `pages` | documentation as resources, and prompts |
//! | `show` | trajectories and scenes as pictures, rows and words |
//!
//! No physics is done here and nothing is checked twice: a tool's arguments go to the operations as they are, and limits,
//! owners, scopes and problems are theirs. Standard output is the protocol's alone.

mod desk;
mod handler;
mod here;
mod pages;
mod show;
mod tool;
mod tools;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use rmcp::ServiceExt;
use rmcp::service::ServerInitializeError;
use rmcp::transport::io::stdio_pipes;

use super::config::ServeConfig;
use super::limits::Limits;
use super::log::Log;
use super::runtime::run_to_end;
use super::signal::stop_signal;
use super::upkeep::Upkeep;
use super::{exposure, upkeep};
use crate::access::Scope;
use crate::error::{Error, Result};
use desk::Desk;
use handler::Handler;
use here::Here;

/// How an agent is served.
pub struct McpConfig {
    /// Where jobs, worlds and what was spent are kept; in memory if absent.
    pub data_dir: Option<PathBuf>,
    /// Tokens of a file instead of the data directory's.
    pub token_file: Option<PathBuf>,
    /// The token that is shown, where one is asked for.
    pub token: Option<String>,
    /// The most that may be done, whatever the token allows.
    pub may: Scope,
    /// Most real interactions in the real world of each family.
    pub real_interactions: u64,
    /// Where a line goes for each operation and each job that ends.
    pub log: Log,
}

/// Serves one agent until standard input ends, or the process is told to stop.
pub fn mcp_blocking(config: McpConfig) -> Result<()> {
    // A read of standard input may be under way for ever.
    run_to_end(serve(config), Duration::from_millis(200))
}

/// How long jobs may take to notice the end: clients of the protocol wait for two seconds before they kill.
const GRACE: Duration = Duration::from_secs(1);

async fn serve(config: McpConfig) -> Result<()> {
    let stop = stop_signal()?;
    let limits = Limits { world_idle_seconds: UNFORGOTTEN, ..Limits::default() };
    let (data_dir, token_file, log) = (config.data_dir, config.token_file, config.log);
    let served = ServeConfig { data_dir, token_file, limits, log, ..ServeConfig::default() };
    let open = move || upkeep::open(&served, exposure::keyring(&served)?, "{}");
    let shared = tokio::task::spawn_blocking(open)
        .await
        .map_err(|e| Error::Failed(format!("the server could not be made: {e}")))??;
    let here = Here::new(shared.clone(), config.token.as_deref(), config.may)?;
    let upkeep = Upkeep::start(&shared);
    let desk = Arc::new(Desk::new(here, config.may, config.real_interactions));
    let done = tokio::select! {
        done = converse(&desk) => done,
        () = stop => Ok(()),
    };
    desk.close().await;
    upkeep.end(GRACE).await;
    done
}

/// A real world keeps what was spent in it as long as the data directory: it does not idle out, s.
const UNFORGOTTEN: f64 = 1e9;

/// Speaks with the agent until it hangs up.
async fn converse(desk: &Arc<Desk>) -> Result<()> {
    let served = match Handler::new(desk.clone()).serve(stdio_pipes()).await {
        Ok(served) => served,
        // Nobody came.
        Err(ServerInitializeError::ConnectionClosed(_)) => return Ok(()),
        Err(e) => {
            let reason = format!("{e}; `iplw mcp` is started by an agent's program, which speaks MCP to it");
            return Err(Error::Failed(reason));
        }
    };
    let ended = served.waiting().await;
    ended.map(drop).map_err(|e| Error::Failed(format!("the conversation broke off: {e}")))
}
