//! MCP, the Model Context Protocol, over standard input and output. The only module that uses `rmcp`, which implements the
//! protocol and negotiates its version.
//!
//! | file | content |
//! |---|---|
//! | `tools/` | the tools, one per file; each combines a few of the server's operations |
//! | `tool` | declaration of tools, their calls and results |
//! | `agent_session` | an agent's scope, real worlds with budgets, and jobs |
//! | `local_client` | in-process client of the operations |
//! | `handler` | handler of the protocol's requests |
//! | `resources` | documentation as resources, and prompts |
//! | `describe` | trajectories and scenes as pictures, rows and text |
//!
//! Tools pass their arguments to the operations, which validate them and enforce limits, ownership and scopes. Only the
//! protocol writes to standard output.

mod agent_session;
mod describe;
mod handler;
mod local_client;
mod resources;
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
use super::log::AccessLog;
use super::maintenance::Maintenance;
use super::runtime::run_to_completion;
use super::signal::stop_signal;
use super::{bind_policy, maintenance};
use crate::access::Scope;
use crate::error::{Error, Result};
use agent_session::AgentSession;
use handler::McpHandler;
use local_client::LocalClient;

/// Configuration of the MCP server.
pub struct McpConfig {
    /// Directory for jobs, worlds and interaction counters. Default: in memory.
    pub data_dir: Option<PathBuf>,
    /// Token file, instead of the data directory's.
    pub token_file: Option<PathBuf>,
    /// Token to present if authentication is enabled.
    pub token: Option<String>,
    /// Maximum scope; the token can restrict it further.
    pub scope: Scope,
    /// Maximum number of real interactions per family.
    pub real_interactions: u64,
    /// Log of operations and finished jobs.
    pub log: AccessLog,
}

/// Serves one agent until standard input ends or the process receives a stop signal.
pub fn mcp_blocking(config: McpConfig) -> Result<()> {
    // A pending read of standard input never returns, so the runtime is stopped with a time limit.
    run_to_completion(serve(config), Duration::from_millis(200))
}

/// Time for jobs to stop on shutdown; MCP clients kill the server after two seconds.
const GRACE: Duration = Duration::from_secs(1);

async fn serve(config: McpConfig) -> Result<()> {
    let stop = stop_signal()?;
    let limits = Limits { world_idle_seconds: WORLD_IDLE_S, ..Limits::default() };
    let (data_dir, token_file, log) = (config.data_dir, config.token_file, config.log);
    let served = ServeConfig { data_dir, token_file, limits, log, ..ServeConfig::default() };
    let open = move || maintenance::open(&served, bind_policy::keyring(&served)?, "{}");
    let shared = tokio::task::spawn_blocking(open)
        .await
        .map_err(|e| Error::Failed(format!("the server could not be started: {e}")))??;
    let client = LocalClient::new(shared.clone(), config.token.as_deref(), config.scope)?;
    let maintenance = Maintenance::start(&shared);
    let session = Arc::new(AgentSession::new(client, config.scope, config.real_interactions));
    let done = tokio::select! {
        done = converse(&session) => done,
        () = stop => Ok(()),
    };
    session.close().await;
    maintenance.end(GRACE).await;
    done
}

/// Worlds never expire, so that interaction counters last as long as the data directory, s.
const WORLD_IDLE_S: f64 = 1e9;

/// Serves the agent until it disconnects.
async fn converse(session: &Arc<AgentSession>) -> Result<()> {
    let served = match McpHandler::new(session.clone()).serve(stdio_pipes()).await {
        Ok(served) => served,
        // No client connected.
        Err(ServerInitializeError::ConnectionClosed(_)) => return Ok(()),
        Err(e) => {
            let reason = format!("{e}; `iplw mcp` must be started by an MCP client");
            return Err(Error::Failed(reason));
        }
    };
    let ended = served.waiting().await;
    ended.map(drop).map_err(|e| Error::Failed(format!("the connection failed: {e}")))
}
