//! Handler of the protocol's requests.

use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use rmcp::handler::server::ServerHandler;
use rmcp::model::{
    CallToolRequestParams, CallToolResponse, CallToolResult, ContentBlock, GetPromptRequestParams,
    GetPromptResponse, Implementation, ListPromptsResult, ListResourcesResult, ListToolsResult,
    PaginatedRequestParams, ReadResourceRequestParams, ReadResourceResponse, ServerCapabilities,
    ServerConfig,
};
use rmcp::service::RequestContext;
use rmcp::{ErrorData, RoleServer};
use serde_json::Value;

use super::agent_session::AgentSession;
use super::resources;
use super::tool::{ToolCall, ToolResult};
use super::tools::TOOLS;
use crate::serve::log::slug;
use crate::serve::problem::Problem;

/// MCP handler for one agent.
pub struct McpHandler {
    session: Arc<AgentSession>,
}

impl McpHandler {
    /// For an agent's session.
    pub fn new(session: Arc<AgentSession>) -> McpHandler {
        McpHandler { session }
    }
}

type McpResult<T> = std::result::Result<T, ErrorData>;

impl ServerHandler for McpHandler {
    fn get_info(&self) -> ServerConfig {
        let can = ServerCapabilities::builder().enable_tools().enable_resources().enable_prompts().build();
        let name =
            Implementation::new("iplw", env!("CARGO_PKG_VERSION")).with_title("iplw: 2D physics worlds");
        ServerConfig::new(can).with_server_info(name).with_instructions(resources::INSTRUCTIONS)
    }

    async fn list_tools(
        &self,
        _: Option<PaginatedRequestParams>,
        _: RequestContext<RoleServer>,
    ) -> McpResult<ListToolsResult> {
        Ok(ListToolsResult::with_all_items(TOOLS.iter().map(|t| t.declaration.clone()).collect()))
    }

    async fn call_tool(
        &self,
        request: CallToolRequestParams,
        context: RequestContext<RoleServer>,
    ) -> McpResult<CallToolResponse> {
        let Some(tool) = TOOLS.iter().find(|t| t.declaration.name == request.name) else {
            let names = TOOLS.iter().map(|t| &*t.declaration.name).collect::<Vec<_>>().join(", ");
            return Err(ErrorData::invalid_params(
                format!("unknown tool {:?}; available: {names}", request.name),
                None,
            ));
        };
        let arguments = Value::Object(request.arguments.unwrap_or_default());
        let answer = (tool.run)(ToolCall::new(self.session.clone(), context), arguments).await;
        Ok(answer.map_or_else(|problem| to_error_result(&problem), to_call_result).into())
    }

    async fn list_resources(
        &self,
        _: Option<PaginatedRequestParams>,
        _: RequestContext<RoleServer>,
    ) -> McpResult<ListResourcesResult> {
        Ok(ListResourcesResult::with_all_items(resources::resources()))
    }

    async fn read_resource(
        &self,
        request: ReadResourceRequestParams,
        context: RequestContext<RoleServer>,
    ) -> McpResult<ReadResourceResponse> {
        let call = ToolCall::new(self.session.clone(), context);
        resources::resource(&call, &request.uri).await.map(ReadResourceResponse::from)
    }

    async fn list_prompts(
        &self,
        _: Option<PaginatedRequestParams>,
        _: RequestContext<RoleServer>,
    ) -> McpResult<ListPromptsResult> {
        Ok(ListPromptsResult::with_all_items(resources::prompts()))
    }

    async fn get_prompt(
        &self,
        request: GetPromptRequestParams,
        _: RequestContext<RoleServer>,
    ) -> McpResult<GetPromptResponse> {
        resources::prompt(&request.name, request.arguments.as_ref()).map(GetPromptResponse::from)
    }
}

/// A summary, the output as JSON text for clients without structured content, and the picture.
fn to_call_result(ToolResult { summary, output, picture }: ToolResult<Value>) -> CallToolResult {
    let mut content = vec![ContentBlock::text(summary), ContentBlock::text(output.to_string())];
    content.extend(picture.map(|png| ContentBlock::image(STANDARD.encode(png), "image/png")));
    let mut result = CallToolResult::success(content);
    result.structured_content = Some(output);
    result
}

/// The problem as in HTTP, with field, value and allowed values, and advice on what to do.
fn to_error_result(problem: &Problem) -> CallToolResult {
    let kind = slug(&problem.kind);
    let mut message = format!("{}: {}", problem.title, problem.detail);
    if let Some(advice) = advice(kind) {
        message = format!("{message}\n{advice}");
    }
    CallToolResult::error(vec![ContentBlock::text(message)])
}

/// Advice for a kind of problem, unless its detail already has it.
fn advice(kind: &str) -> Option<&'static str> {
    Some(match kind {
        "budget-spent" => {
            "Continue without the real world: roll_out is free, and propose_actions still returns the estimates. The limit is \
             set by --real-interactions of `iplw mcp`."
        }
        "forbidden" => "The scope is set by --scope of `iplw mcp`, or by the token.",
        "malformed" | "invalid-value" => "Nothing was done. Change that argument and call again.",
        "not-found" => "list_tasks lists the tasks.",
        "deadline" => {
            "The call was cancelled. Request less at a time, or set `seconds` higher if the tool has it."
        }
        "no-result" => "There is no result for these inputs; try other trials or arguments.",
        "busy" | "capacity" => "Try again in a few seconds.",
        _ => return None,
    })
}
