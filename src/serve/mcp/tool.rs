//! Declaration of tools, their calls and results.

use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rmcp::handler::server::tool::{schema_for_input, schema_for_output};
use rmcp::model::{JsonObject, ProgressNotificationParam};
use rmcp::schemars::JsonSchema;
use rmcp::service::RequestContext;
use rmcp::{RoleServer, model};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::agent_session::AgentSession;
use crate::error::Error;
use crate::json::from_value;
use crate::serve::problem::{HandlerResult, Problem};

/// A tool that an agent can call.
pub struct Tool {
    pub name: &'static str,
    pub title: &'static str,
    /// Description for the agent.
    pub about: &'static str,
    pub effect: SideEffect,
    /// JSON Schema of its arguments.
    pub input_schema: Arc<JsonObject>,
    pub output_schema: Arc<JsonObject>,
    pub run: ToolFn,
}

/// Side effect of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SideEffect {
    /// None.
    ReadOnly,
    /// Creates records and jobs; repeated calls reuse them.
    Records,
    /// Uses real interactions, which are counted.
    SpendsInteractions,
}

type ToolFn = Box<
    dyn Fn(ToolCall, Value) -> Pin<Box<dyn Future<Output = HandlerResult<ToolContent>> + Send>> + Send + Sync,
>;

/// Serialised result of a tool.
pub struct ToolContent {
    /// Summary in a sentence or two.
    pub summary: String,
    /// The complete output.
    pub value: Value,
    /// PNG.
    pub picture: Option<Vec<u8>>,
}

/// Declares a tool by its function; the types of its argument and output give the schemas.
pub fn tool<I, O, F>(
    name: &'static str,
    title: &'static str,
    effect: SideEffect,
    about: &'static str,
    run: fn(ToolCall, I) -> F,
) -> Tool
where
    I: DeserializeOwned + JsonSchema + Send + 'static,
    O: Serialize + JsonSchema + 'static,
    F: Future<Output = HandlerResult<ToolResult<O>>> + Send + 'static,
{
    let run: ToolFn = Box::new(move |call, arguments| {
        Box::pin(async move {
            let input: I = from_value(arguments).map_err(Problem::malformed)?;
            let ToolResult { summary, output, picture } = run(call, input).await?;
            let value = serde_json::to_value(output).map_err(Problem::serialization)?;
            Ok(ToolContent { summary, value, picture })
        })
    });
    let input_schema = portable_schema(&schema_for_input::<I>().expect("arguments are an object"));
    Tool {
        name,
        title,
        about,
        effect,
        input_schema,
        output_schema: portable_schema(&schema_for_output::<O>()),
        run,
    }
}

/// Removes Rust-specific formats (`format: uint64`), which strict JSON Schema readers reject, and line breaks in
/// descriptions.
fn portable_schema(schema: &JsonObject) -> Arc<JsonObject> {
    let mut schema = Value::Object(schema.clone());
    strip(&mut schema);
    match schema {
        Value::Object(schema) => Arc::new(schema),
        _ => Arc::default(),
    }
}

fn strip(schema: &mut Value) {
    match schema {
        Value::Object(fields) => {
            // A property named `format` has a schema as its value, not a string.
            fields.retain(|name, value| !(name == "format" && value.is_string()));
            if let Some(Value::String(text)) = fields.get_mut("description") {
                *text = text.replace('\n', " ");
            }
            fields.values_mut().for_each(strip);
        }
        Value::Array(items) => items.iter_mut().for_each(strip),
        _ => {}
    }
}

/// Result of a tool's function.
pub struct ToolResult<O> {
    /// Summary in a sentence or two.
    pub summary: String,
    pub output: O,
    /// PNG.
    pub picture: Option<Vec<u8>>,
}

/// A running call of a tool.
#[derive(Clone)]
pub struct ToolCall {
    session: Arc<AgentSession>,
    context: RequestContext<RoleServer>,
}

impl ToolCall {
    /// For an agent's request.
    pub fn new(session: Arc<AgentSession>, context: RequestContext<RoleServer>) -> ToolCall {
        ToolCall { session, context }
    }

    /// The agent's session.
    pub fn session(&self) -> &AgentSession {
        &self.session
    }

    /// Calls an operation; cancelled when the agent cancels the call.
    pub async fn ask(&self, operation: &str, fields: Value) -> HandlerResult<Value> {
        self.unless_cancelled(self.session.ask(operation, fields)).await?.value()
    }

    /// Calls an operation and parses its response.
    pub async fn read<T: DeserializeOwned>(&self, operation: &str, fields: Value) -> HandlerResult<T> {
        self.unless_cancelled(self.session.read(operation, fields)).await
    }

    /// Calls an operation that returns a picture.
    pub async fn picture(&self, operation: &str, fields: Value) -> HandlerResult<Vec<u8>> {
        self.unless_cancelled(self.session.ask(operation, fields)).await?.media()
    }

    async fn unless_cancelled<T>(&self, work: impl Future<Output = HandlerResult<T>>) -> HandlerResult<T> {
        tokio::select! {
            biased;
            () = self.context.ct.cancelled() => Err(Problem::cancelled()),
            done = work => done,
        }
    }

    /// Queues a job and waits for its end, at most `seconds`; otherwise cancels it.
    pub async fn job(&self, operation: &str, fields: Value, seconds: f64) -> HandlerResult<JobInfo> {
        let job: JobInfo = self.read(operation, fields).await?;
        self.session.track_job(&job.id);
        let ended = self.ended(&job.id, seconds).await;
        if ended.is_err() {
            self.session.cancel_job(&job.id).await;
        }
        self.session.untrack_job(&job.id);
        ended
    }

    async fn ended(&self, id: &str, seconds: f64) -> HandlerResult<JobInfo> {
        let job = self.until(id, seconds, |job| job.ended()).await?;
        match job.state.as_str() {
            "succeeded" => Ok(job),
            "failed" => Err(job.error.unwrap_or_else(Problem::internal)),
            _ => Err(Problem::cancelled()),
        }
    }

    /// Waits until a job satisfies `so`, at most `seconds`, and reports progress meanwhile.
    pub async fn until(&self, id: &str, seconds: f64, so: fn(&JobInfo) -> bool) -> HandlerResult<JobInfo> {
        let (since, mut said) = (Instant::now(), (String::new(), 0.0));
        loop {
            let job: JobInfo = self.read("get_job", json!({"id": id})).await?;
            if so(&job) {
                return Ok(job);
            }
            let elapsed = since.elapsed().as_secs_f64();
            if elapsed > seconds {
                return Err(Error::Deadline { seconds }.into());
            }
            let stage = job.progress.summary();
            if stage != said.0 || elapsed - said.1 >= 1.0 {
                self.progress(elapsed, &stage).await;
                said = (stage, elapsed);
            }
            let pause = Duration::from_millis(if elapsed < 1.0 { 20 } else { 250 });
            tokio::select! {
                biased;
                () = self.context.ct.cancelled() => return Err(Problem::cancelled()),
                () = tokio::time::sleep(pause) => {}
            }
        }
    }

    /// Sends a progress notification, if requested. Progress is in seconds, since the protocol requires it to increase
    /// and stages have separate totals.
    async fn progress(&self, seconds: f64, stage: &str) {
        let Some(token) = self.context.meta.get_progress_token() else { return };
        let output = ProgressNotificationParam::new(token, seconds).with_message(stage);
        let _ = self.context.peer.notify_progress(output).await;
    }
}

/// The fields of a job that are needed here.
#[derive(Deserialize)]
pub struct JobInfo {
    pub id: String,
    pub state: String,
    pub progress: JobStage,
    pub result: Option<Value>,
    pub error: Option<Problem>,
}

/// Progress of a job.
#[derive(Deserialize)]
pub struct JobStage {
    pub stage: String,
    pub done: u64,
    pub total: u64,
}

impl JobInfo {
    /// Whether it has ended.
    pub fn ended(&self) -> bool {
        matches!(self.state.as_str(), "succeeded" | "failed" | "cancelled")
    }
}

impl JobStage {
    fn summary(&self) -> String {
        match self.total {
            0 => self.stage.clone(),
            total => format!("{} ({} of {total})", self.stage, self.done),
        }
    }
}

/// Estimate of a latent.
#[derive(Clone, Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct LatentInfo {
    /// `density`, `friction`, `restitution`, or a free effect parameter `effect.parameter`.
    pub name: String,
    /// The estimate; if not identifiable, the search's current value.
    pub value: f64,
    /// 95 % interval; `[null, null]` if there is none.
    pub ci95: [Option<f64>; 2],
    /// Whether the trials determine it.
    pub identifiable: bool,
}

/// Estimates as text.
pub fn describe_latents(known: &[LatentInfo]) -> String {
    let word = |k: &LatentInfo| match (k.identifiable, k.ci95) {
        (true, [Some(low), Some(high)]) => format!("{} {:.3} (95 % {low:.3} to {high:.3})", k.name, k.value),
        (true, _) => format!("{} {:.3}", k.name, k.value),
        (false, _) => {
            format!("{} cannot be determined from these trials (current value {:.3})", k.name, k.value)
        }
    };
    known.iter().map(word).collect::<Vec<_>>().join("; ")
}

/// Latent factors to simulate with; absent ones are the scene's own.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
pub struct LatentsArg {
    /// kg/m^2
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    /// Surface coefficient.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Surface coefficient, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
}

/// An effect beyond gravity and contact.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
pub struct EffectArg {
    /// `linear_drag`, ...; the resource `iplw://effects` lists all.
    pub name: String,
    /// Values in the effect's units; absent ones have their neutral value.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
}

/// A tool as the protocol lists it.
impl From<&Tool> for model::Tool {
    fn from(tool: &Tool) -> model::Tool {
        let hints = model::ToolAnnotations::with_title(tool.title)
            .read_only(tool.effect == SideEffect::ReadOnly)
            .destructive(false)
            .idempotent(tool.effect != SideEffect::SpendsInteractions)
            .open_world(false);
        model::Tool::new(tool.name, tool.about, tool.input_schema.clone())
            .with_title(tool.title)
            .with_raw_output_schema(tool.output_schema.clone())
            .with_annotations(hints)
    }
}
