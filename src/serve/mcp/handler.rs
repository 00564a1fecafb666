//! The protocol's requests, answered.

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
use rmcp::{ErrorData, RoleServer, model};
use serde_json::Value;

use super::desk::Desk;
use super::pages;
use super::tool::{Call, Shown};
use super::tools::TOOLS;
use crate::serve::log::slug;
use crate::serve::problem::Problem;

/// One agent's conversation.
pub struct Handler {
    desk: Arc<Desk>,
}

impl Handler {
    /// Over its desk.
    pub fn new(desk: Arc<Desk>) -> Handler {
        Handler { desk }
    }
}

type Result<T> = std::result::Result<T, ErrorData>;

impl ServerHandler for Handler {
    fn get_info(&self) -> ServerConfig {
        let can = ServerCapabilities::builder().enable_tools().enable_resources().enable_prompts().build();
        let name =
            Implementation::new("iplw", env!("CARGO_PKG_VERSION")).with_title("iplw: 2D physics worlds");
        ServerConfig::new(can).with_server_info(name).with_instructions(pages::INSTRUCTIONS)
    }

    async fn list_tools(
        &self,
        _: Option<PaginatedRequestParams>,
        _: RequestContext<RoleServer>,
    ) -> Result<ListToolsResult> {
        Ok(ListToolsResult::with_all_items(TOOLS.iter().map(model::Tool::from).collect()))
    }

    async fn call_tool(
        &self,
        request: CallToolRequestParams,
        context: RequestContext<RoleServer>,
    ) -> Result<CallToolResponse> {
        let Some(tool) = TOOLS.iter().find(|t| t.name == request.name) else {
            let names = TOOLS.iter().map(|t| t.name).collect::<Vec<_>>().join(", ");
            return Err(ErrorData::invalid_params(
                format!("no tool {:?}; there are {names}", request.name),
                None,
            ));
        };
        let arguments = Value::Object(request.arguments.unwrap_or_default());
        let answer = (tool.run)(Call::new(self.desk.clone(), context), arguments).await;
        Ok(answer.map_or_else(|problem| refused(&problem), shown).into())
    }

    async fn list_resources(
        &self,
        _: Option<PaginatedRequestParams>,
        _: RequestContext<RoleServer>,
    ) -> Result<ListResourcesResult> {
        Ok(ListResourcesResult::with_all_items(pages::resources()))
    }

    async fn read_resource(
        &self,
        request: ReadResourceRequestParams,
        context: RequestContext<RoleServer>,
    ) -> Result<ReadResourceResponse> {
        let call = Call::new(self.desk.clone(), context);
        pages::resource(&call, &request.uri).await.map(ReadResourceResponse::from)
    }

    async fn list_prompts(
        &self,
        _: Option<PaginatedRequestParams>,
        _: RequestContext<RoleServer>,
    ) -> Result<ListPromptsResult> {
        Ok(ListPromptsResult::with_all_items(pages::prompts()))
    }

    async fn get_prompt(
        &self,
        request: GetPromptRequestParams,
        _: RequestContext<RoleServer>,
    ) -> Result<GetPromptResponse> {
        pages::prompt(&request.name, request.arguments.as_ref()).map(GetPromptResponse::from)
    }
}

/// Words, the whole as JSON for programs that read text alone, and the picture.
fn shown(shown: Shown) -> CallToolResult {
    let mut content = vec![ContentBlock::text(shown.words), ContentBlock::text(shown.value.to_string())];
    content.extend(shown.picture.map(|png| ContentBlock::image(STANDARD.encode(png), "image/png")));
    let mut result = CallToolResult::success(content);
    result.structured_content = Some(shown.value);
    result
}

/// What went wrong and what to do: the problem as HTTP has it, which says field, value and what is allowed.
fn refused(problem: &Problem) -> CallToolResult {
    let kind = slug(&problem.kind);
    let mut said = format!("{}: {}", problem.title, problem.detail);
    if let Some(next) = next(kind) {
        said = format!("{said}\n{next}");
    }
    CallToolResult::error(vec![ContentBlock::text(said)])
}

/// What an agent may do about a kind of problem, where its own words do not say.
fn next(kind: &str) -> Option<&'static str> {
    Some(match kind {
        "budget-spent" => {
            "Go on without the real world: roll_out costs nothing, and propose_actions still tells what is known. Only \
             whoever started `iplw mcp` can allow more, by --real-interactions."
        }
        "forbidden" => "Whoever started `iplw mcp` decides what it may (--may, or the token).",
        "malformed" | "invalid-value" => "Nothing was done. Change that argument and call again.",
        "not-found" => "list_tasks tells which tasks there are.",
        "deadline" => {
            "It was given up. Ask for less at a time, or give it more `seconds` where the tool takes them."
        }
        "no-result" => "The numbers lead to no result: other trials or arguments may.",
        "busy" | "capacity" => "Try again in a few seconds.",
        _ => return None,
    })
}
