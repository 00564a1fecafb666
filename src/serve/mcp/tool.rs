//! A tool: how it is declared, what it is given, and what it gives.

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

use super::desk::Desk;
use crate::error::Error;
use crate::json::from_value;
use crate::serve::problem::{Answer, Problem};

/// Something an agent can call.
pub struct Tool {
    pub name: &'static str,
    pub title: &'static str,
    /// What it does, for whoever chooses among tools.
    pub about: &'static str,
    pub effect: Effect,
    /// JSON Schema of its arguments and of its answer.
    pub takes: Arc<JsonObject>,
    pub gives: Arc<JsonObject>,
    pub run: Run,
}

/// What a call leaves behind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Nothing.
    Shows,
    /// Records and jobs; a second call may find them and go on.
    Keeps,
    /// Real interactions, which are counted.
    Spends,
}

type Run = Box<dyn Fn(Call, Value) -> Pin<Box<dyn Future<Output = Answer<Shown>> + Send>> + Send + Sync>;

/// An answer on its way out.
pub struct Shown {
    /// What there is to know, in a sentence or two.
    pub words: String,
    /// All of it.
    pub value: Value,
    /// PNG.
    pub picture: Option<Vec<u8>>,
}

/// A tool by its function, whose types say what it takes and gives.
pub fn tool<I, O, F>(
    name: &'static str,
    title: &'static str,
    effect: Effect,
    about: &'static str,
    run: fn(Call, I) -> F,
) -> Tool
where
    I: DeserializeOwned + JsonSchema + Send + 'static,
    O: Serialize + JsonSchema + 'static,
    F: Future<Output = Answer<Told<O>>> + Send + 'static,
{
    let run: Run = Box::new(move |call, arguments| {
        Box::pin(async move {
            let input: I = from_value(arguments).map_err(Problem::malformed)?;
            let Told { words, told, picture } = run(call, input).await?;
            let value = serde_json::to_value(told).map_err(Problem::unwritable)?;
            Ok(Shown { words, value, picture })
        })
    });
    let takes = plain(&schema_for_input::<I>().expect("arguments are an object"));
    Tool { name, title, about, effect, takes, gives: plain(&schema_for_output::<O>()), run }
}

/// A schema without what is Rust's alone (`format: uint64`), which strict readers of JSON Schema refuse, and without the line
/// breaks of comments.
fn plain(schema: &JsonObject) -> Arc<JsonObject> {
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
            // A property called so has a schema, not a word.
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

/// What a tool's function gives.
pub struct Told<O> {
    /// What there is to know, in a sentence or two.
    pub words: String,
    pub told: O,
    /// PNG.
    pub picture: Option<Vec<u8>>,
}

/// A call under way.
#[derive(Clone)]
pub struct Call {
    desk: Arc<Desk>,
    context: RequestContext<RoleServer>,
}

impl Call {
    /// Of an agent's request.
    pub fn new(desk: Arc<Desk>, context: RequestContext<RoleServer>) -> Call {
        Call { desk, context }
    }

    /// Where operations are asked for.
    pub fn desk(&self) -> &Desk {
        &self.desk
    }

    /// Asks for an operation; given up when the agent cancels the call.
    pub async fn ask(&self, operation: &str, fields: Value) -> Answer<Value> {
        self.unless_cancelled(self.desk.ask(operation, fields)).await?.value()
    }

    /// The same, as what is known of the answer.
    pub async fn read<T: DeserializeOwned>(&self, operation: &str, fields: Value) -> Answer<T> {
        self.unless_cancelled(self.desk.read(operation, fields)).await
    }

    /// The same for a picture.
    pub async fn picture(&self, operation: &str, fields: Value) -> Answer<Vec<u8>> {
        self.unless_cancelled(self.desk.ask(operation, fields)).await?.media()
    }

    async fn unless_cancelled<T>(&self, work: impl Future<Output = Answer<T>>) -> Answer<T> {
        tokio::select! {
            biased;
            () = self.context.ct.cancelled() => Err(Problem::cancelled()),
            done = work => done,
        }
    }

    /// Queues a job and waits for its end, at most so long, s; a job that nobody waits for any more is cancelled.
    pub async fn job(&self, operation: &str, fields: Value, seconds: f64) -> Answer<Job> {
        let job: Job = self.read(operation, fields).await?;
        self.desk.begun(&job.id);
        let ended = self.ended(&job.id, seconds).await;
        if ended.is_err() {
            self.desk.give_up(&job.id).await;
        }
        self.desk.over(&job.id);
        ended
    }

    async fn ended(&self, id: &str, seconds: f64) -> Answer<Job> {
        let job = self.until(id, seconds, |job| job.ended()).await?;
        match job.state.as_str() {
            "succeeded" => Ok(job),
            "failed" => Err(job.error.unwrap_or_else(Problem::defect)),
            _ => Err(Problem::cancelled()),
        }
    }

    /// Waits until a job is so, at most so long, s, and says how far it is meanwhile.
    pub async fn until(&self, id: &str, seconds: f64, so: fn(&Job) -> bool) -> Answer<Job> {
        let (since, mut said) = (Instant::now(), (String::new(), 0.0));
        loop {
            let job: Job = self.read("get_job", json!({"id": id})).await?;
            if so(&job) {
                return Ok(job);
            }
            let elapsed = since.elapsed().as_secs_f64();
            if elapsed > seconds {
                return Err(Error::Deadline { seconds }.into());
            }
            let stage = job.progress.words();
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

    /// Tells the agent's program, if it asked for that. The figure is seconds: stages have totals of their own, and the
    /// protocol wants one that never falls.
    async fn progress(&self, seconds: f64, stage: &str) {
        let Some(token) = self.context.meta.get_progress_token() else { return };
        let told = ProgressNotificationParam::new(token, seconds).with_message(stage);
        let _ = self.context.peer.notify_progress(told).await;
    }
}

/// What is read of a job.
#[derive(Deserialize)]
pub struct Job {
    pub id: String,
    pub state: String,
    pub progress: Progress,
    pub result: Option<Value>,
    pub error: Option<Problem>,
}

/// How far a job is.
#[derive(Deserialize)]
pub struct Progress {
    pub stage: String,
    pub done: u64,
    pub total: u64,
}

impl Job {
    /// Whether nothing more becomes of it.
    pub fn ended(&self) -> bool {
        matches!(self.state.as_str(), "succeeded" | "failed" | "cancelled")
    }
}

impl Progress {
    fn words(&self) -> String {
        match self.total {
            0 => self.stage.clone(),
            total => format!("{} ({} of {total})", self.stage, self.done),
        }
    }
}

/// What is known of a latent.
#[derive(Clone, Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
pub struct Known {
    /// `density`, `friction`, `restitution`, or a parameter fitted along, `effect.parameter`.
    pub name: String,
    /// The estimate; of one that is not identifiable merely where the search stands.
    pub value: f64,
    /// Its 95 % interval; `[null, null]` where there is none.
    pub ci95: [Option<f64>; 2],
    /// Whether the trials tell it.
    pub identifiable: bool,
}

/// Latents in words.
pub fn known_words(known: &[Known]) -> String {
    let word = |k: &Known| match (k.identifiable, k.ci95) {
        (true, [Some(low), Some(high)]) => format!("{} {:.3} (95 % {low:.3} to {high:.3})", k.name, k.value),
        (true, _) => format!("{} {:.3}", k.name, k.value),
        (false, _) => format!("{} is not told by these trials (the search stands at {:.3})", k.name, k.value),
    };
    known.iter().map(word).collect::<Vec<_>>().join("; ")
}

/// Latent factors to simulate with; those absent are the scene's own.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(crate = "rmcp::schemars")]
#[serde(deny_unknown_fields)]
pub struct Latents {
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
pub struct EffectTerm {
    /// `linear_drag`, ...: the resource `iplw://effects` lists them.
    pub name: String,
    /// By name, in the effect's units; those absent leave it neutral.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
}

/// A tool as the protocol lists it.
impl From<&Tool> for model::Tool {
    fn from(tool: &Tool) -> model::Tool {
        let hints = model::ToolAnnotations::with_title(tool.title)
            .read_only(tool.effect == Effect::Shows)
            .destructive(false)
            .idempotent(tool.effect != Effect::Spends)
            .open_world(false);
        model::Tool::new(tool.name, tool.about, tool.takes.clone())
            .with_title(tool.title)
            .with_raw_output_schema(tool.gives.clone())
            .with_annotations(hints)
    }
}
