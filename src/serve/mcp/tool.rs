//! Declaration of tools, their calls and results.

use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rmcp::RoleServer;
use rmcp::model::{self, JsonObject, ProgressNotificationParam, ToolAnnotations};
use rmcp::service::RequestContext;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use utoipa::ToSchema;

use super::agent_session::AgentSession;
use crate::error::Error;
use crate::estimate::LatentEstimate;
use crate::json::from_value;
use crate::serve::problem::{HandlerResult, Problem};
use crate::serve::wire::TaskOut;
use crate::store::JobState;

/// A tool that an agent can call.
pub struct Tool {
    /// As the protocol lists it.
    pub declaration: model::Tool,
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
    dyn Fn(ToolCall, Value) -> Pin<Box<dyn Future<Output = HandlerResult<ToolResult<Value>>> + Send>>
        + Send
        + Sync,
>;

/// Declares a tool by its function; the types of its argument and output give the schemas. `about` describes it to the agent.
pub fn tool<I, O, F>(
    name: &'static str,
    title: &'static str,
    effect: SideEffect,
    about: &'static str,
    run: fn(ToolCall, I) -> F,
) -> Tool
where
    I: DeserializeOwned + ToSchema + Send + 'static,
    O: Serialize + ToSchema + 'static,
    F: Future<Output = HandlerResult<ToolResult<O>>> + Send + 'static,
{
    let run: ToolFn = Box::new(move |call, arguments| {
        Box::pin(async move {
            let input: I = from_value(arguments).map_err(Problem::malformed)?;
            let ToolResult { summary, output, picture } = run(call, input).await?;
            let output = serde_json::to_value(output).map_err(Problem::serialization)?;
            Ok(ToolResult { summary, output, picture })
        })
    });
    let hints = ToolAnnotations::with_title(title)
        .read_only(effect == SideEffect::ReadOnly)
        .destructive(false)
        .idempotent(effect != SideEffect::SpendsInteractions)
        .open_world(false);
    let declaration = model::Tool::new(name, about, json_schema::<I>())
        .with_title(title)
        .with_raw_output_schema(json_schema::<O>())
        .with_annotations(hints);
    Tool { declaration, run }
}

/// Self-contained JSON Schema of a type: the components of the OpenAPI document that it refers to are in `$defs`.
fn json_schema<T: ToSchema>() -> Arc<JsonObject> {
    let mut components = Vec::new();
    T::schemas(&mut components);
    let mut schema = json!(T::schema());
    if !components.is_empty() {
        schema["$defs"] = json!(components.into_iter().collect::<BTreeMap<_, _>>());
    }
    to_portable(&mut schema);
    Arc::new(schema.as_object().cloned().unwrap_or_default())
}

/// Refers to `$defs`; removes formats of numbers (`format: int64`), which strict JSON Schema readers reject, and line breaks in
/// descriptions.
fn to_portable(schema: &mut Value) {
    match schema {
        Value::Object(fields) => {
            // A property named `format` has a schema as its value, not a string.
            fields.retain(|name, value| !(name == "format" && value.is_string()));
            if let Some(Value::String(text)) = fields.get_mut("description") {
                *text = text.replace('\n', " ");
            }
            if let Some(Value::String(target)) = fields.get_mut("$ref") {
                *target = target.replace("#/components/schemas/", "#/$defs/");
            }
            fields.values_mut().for_each(to_portable);
        }
        Value::Array(items) => items.iter_mut().for_each(to_portable),
        _ => {}
    }
}

/// Result of a tool's function.
pub struct ToolResult<O> {
    /// Summary in a sentence or two.
    pub summary: String,
    /// The complete output.
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

    /// Calls an operation and returns the body of its response; cancelled when the agent cancels the call.
    pub async fn ask(&self, operation: &str, fields: Value) -> HandlerResult<Vec<u8>> {
        self.unless_cancelled(self.session.ask(operation, fields)).await
    }

    /// Calls an operation and parses its response.
    pub async fn read<T: DeserializeOwned>(&self, operation: &str, fields: Value) -> HandlerResult<T> {
        self.unless_cancelled(self.session.read(operation, fields)).await
    }

    /// A task by id.
    pub async fn task(&self, id: &str) -> HandlerResult<TaskOut> {
        let (family, number) = id.split_once(':').unwrap_or((id, ""));
        self.read("get_task", json!({"family": family, "number": number})).await
    }

    async fn unless_cancelled<T>(&self, work: impl Future<Output = HandlerResult<T>>) -> HandlerResult<T> {
        tokio::select! {
            biased;
            () = self.context.ct.cancelled() => Err(Problem::cancelled()),
            done = work => done,
        }
    }

    /// Queues a job, waits for its end, at most `seconds`, and parses its result; cancels it otherwise.
    pub async fn job<T: DeserializeOwned>(
        &self,
        operation: &str,
        fields: Value,
        seconds: f64,
    ) -> HandlerResult<T> {
        let job: JobInfo = self.read(operation, fields).await?;
        self.session.track_job(&job.id);
        let result = self.result(&job.id, seconds).await;
        if result.is_err() {
            self.session.cancel_job(&job.id).await;
        }
        self.session.untrack_job(&job.id);
        Ok(from_value(result?)?)
    }

    async fn result(&self, id: &str, seconds: f64) -> HandlerResult<Value> {
        let job = self.until(id, seconds, |job| job.state.ended()).await?;
        match job.state {
            JobState::Succeeded => job.result.ok_or_else(Problem::internal),
            JobState::Failed => Err(job.error.unwrap_or_else(Problem::internal)),
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
    pub state: JobState,
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

impl JobStage {
    fn summary(&self) -> String {
        match self.total {
            0 => self.stage.clone(),
            total => format!("{} ({} of {total})", self.stage, self.done),
        }
    }
}

/// Estimates as text.
pub fn describe_latents(known: &[LatentEstimate]) -> String {
    let word = |k: &LatentEstimate| match (k.identifiable, k.ci95) {
        (true, [Some(low), Some(high)]) => format!("{} {:.3} (95 % {low:.3} to {high:.3})", k.name, k.value),
        (true, _) => format!("{} {:.3}", k.name, k.value),
        (false, _) => {
            format!("{} cannot be determined from these trials (current value {:.3})", k.name, k.value)
        }
    };
    known.iter().map(word).collect::<Vec<_>>().join("; ")
}
