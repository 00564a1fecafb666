//! The table of everything a client can ask for: a row an operation, under its name in the OpenAPI document. A row
//! takes the path's and the query's parameters and the body's fields as one map, and gives what HTTP's body would be.

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use super::batch::FEW;
use super::once::{Once, once};
use super::render::Picture;
use super::{
    Page, asked, batch, diagnosis, estimation, evaluation, job, learning, policy, render, surface, system,
    task, trials, world,
};
use crate::error::Error;
use crate::json::from_value;
use crate::serve::app::App;
use crate::serve::problem::{Answer, Problem};
use crate::serve::wire::{ActionIn, Array, Bulk, Data, StepIn, TellQuery, packed};

/// A row of the table.
pub struct Operation {
    /// Its `operationId`.
    pub name: &'static str,
    /// Whether it is done in a fraction of a millisecond without waiting for the disk, however it ends.
    pub is_light: fn(&App, &Asked) -> bool,
    /// Carries it out.
    pub run: fn(&App, Asked) -> Answer<Reply>,
}

/// What is asked of an operation.
#[derive(Default)]
pub struct Asked {
    pub fields: Map<String, Value>,
    /// A body of bytes, where an operation takes one.
    pub bytes: Option<Vec<u8>>,
    /// So that it may be repeated.
    pub once: Option<Once>,
    /// Whether arrays are wanted apart from the rest.
    pub raw: bool,
}

/// What an operation answers.
pub struct Reply {
    /// What HTTP's body would be, but for the arrays, as msgpack; nil if it has none.
    pub result: Vec<u8>,
    /// Arrays by name.
    pub arrays: Vec<(&'static str, Array)>,
}

/// All operations but those that only HTTP has: `metrics`, a page for Prometheus, and `follow_job`, a stream of events
/// (ask for the job instead).
pub static OPERATIONS: [Operation; 41] = [
    row("list_worlds", |app, a| a.page(app, world::list)),
    row("create_world", |app, mut a| {
        let (body, by) = (a.body()?, a.once.take());
        a.made(app, by, |app, keep| world::create(app, body, keep))
    }),
    light("get_world", always, |app, mut a| a.only_id().and_then(|id| a.out(world::get(app, &id)?))),
    row("delete_world", |app, mut a| {
        world::delete(app, &a.only_id()?)?;
        Reply::plain(&())
    }),
    light("reset_world", one_light, |app, mut a| {
        let (id, body) = (a.id()?, a.body()?);
        a.out(world::reset(app, &id, body)?)
    }),
    light("step_world", one_light, |app, mut a| {
        let (id, body) = (a.id()?, a.step()?);
        a.out(world::step(app, &id, body)?)
    }),
    row("set_latents", |app, mut a| {
        let (id, body) = (a.id()?, a.body()?);
        a.out(world::set_latents(app, &id, body)?)
    }),
    row("rollout_world", |app, mut a| {
        let (id, body) = (a.id()?, a.body()?);
        a.out(world::rollout(app, &id, body, a.raw)?)
    }),
    row("render_world", |app, mut a| {
        let id = a.id()?;
        let picture = Picture::from_query(&a.pairs()?)?;
        bytes(render::render(app, &id, &picture)?.bytes)
    }),
    row("create_worlds", |app, mut a| {
        let (body, by) = (a.body()?, a.once.take());
        a.made(app, by, |app, keep| batch::create(app, body, keep))
    }),
    row("delete_worlds", |app, mut a| {
        batch::delete(app, a.body()?)?;
        Reply::plain(&())
    }),
    light("reset_worlds", few_light, |app, mut a| {
        let body = a.body()?;
        a.out(batch::reset(app, body)?)
    }),
    light("step_worlds", few_light, |app, mut a| {
        let body = a.body()?;
        a.out(batch::step(app, body)?)
    }),
    row("list_families", |app, a| a.page(app, task::families)),
    row("list_tasks", |app, mut a| {
        let family = a.text("family")?;
        a.page(app, |app, page| task::family(app, &family, page))
    }),
    row("get_task", |app, mut a| {
        let (family, number) = (a.text("family")?, a.text("number")?);
        a.nothing_more()?;
        a.out(task::task(app, &family, &number)?)
    }),
    row("start_iplw", |app, mut a| {
        let kept = Value::Object(a.fields.clone());
        let (body, by) = (a.body()?, a.once.take());
        a.made(app, by, |app, keep| estimation::begin(app, body, &kept, keep))
    }),
    row("list_proposals", |app, mut a| a.only_id().and_then(|id| a.out(asked::proposals(app, &id)?))),
    row("tell_trials", |app, mut a| {
        let (id, by) = (a.id()?, a.once.take());
        if !a.fields.contains_key("csv") {
            let body = a.body()?;
            return a.made(app, by, |app, keep| asked::tell(app, &id, body, keep));
        }
        let csv = a.text("csv")?;
        let query = TellQuery::from_query(&a.pairs()?)?;
        a.made(app, by, |app, keep| asked::tell_csv(app, &id, &csv, &query, keep))
    }),
    row("start_diagnosis", |app, mut a| {
        let (body, by) = (a.body()?, a.once.take());
        a.made(app, by, |app, keep| diagnosis::begin(app, body, keep))
    }),
    row("find_surface", |app, mut a| {
        let kept = Value::Object(a.fields.clone());
        let (body, by) = (a.body()?, a.once.take());
        a.made(app, by, |app, keep| surface::begin(app, body, &kept, keep))
    }),
    row("list_surfaces", |app, a| a.page(app, surface::list)),
    row("get_surface", |app, mut a| a.only_id().and_then(|id| a.out(surface::get(app, &id)?))),
    row("draw_surface", |app, mut a| bytes(surface::drawn(app, &a.only_id()?)?.into_bytes())),
    row("delete_surface", |app, mut a| {
        surface::delete(app, &a.only_id()?)?;
        Reply::plain(&())
    }),
    row("learn_policy", |app, mut a| {
        let (id, by) = (a.id()?, a.once.take());
        let mut kept = a.fields.clone();
        kept.insert("policy".into(), id.clone().into());
        let body = a.body()?;
        a.made(app, by, |app, keep| learning::begin(app, &id, &body, &Value::Object(kept), keep))
    }),
    row("train_policy", |app, mut a| {
        let kept = Value::Object(a.fields.clone());
        let (body, by) = (a.body()?, a.once.take());
        a.made(app, by, |app, keep| policy::training(app, body, &kept, keep))
    }),
    row("list_policies", |app, a| a.page(app, policy::list)),
    row("get_policy", |app, mut a| a.only_id().and_then(|id| a.out(policy::get(app, &id)?))),
    row("delete_policy", |app, mut a| {
        policy::delete(app, &a.only_id()?)?;
        Reply::plain(&())
    }),
    row("download_weights", |app, mut a| {
        let id = a.only_id()?;
        bytes(policy::weights(app, &id)?)
    }),
    row("upload_weights", |app, mut a| {
        let id = a.only_id()?;
        let missing = || Error::input("body", "missing", "an array of type |u1: the weights as safetensors");
        let weights = a.bytes.take().ok_or_else(missing)?;
        a.out(policy::put_weights(app, &id, &weights)?.0)
    }),
    row("act", |app, mut a| {
        let (id, body) = (a.id()?, a.body()?);
        a.out(policy::act(app, &id, &body)?)
    }),
    row("evaluate_policy", |app, mut a| {
        let (id, by) = (a.id()?, a.once.take());
        let mut kept = a.fields.clone();
        kept.insert("policy".into(), id.clone().into());
        let body = a.body()?;
        a.made(app, by, |app, keep| evaluation::begin(app, &id, &body, &Value::Object(kept), keep))
    }),
    row("list_jobs", |app, a| a.page(app, job::list)),
    row("get_job", |app, mut a| a.only_id().and_then(|id| a.out(job::get(app, &id)?))),
    row("delete_job", |app, mut a| {
        let id = a.only_id()?;
        job::delete(app, &id)?.map_or_else(|| Reply::plain(&()), |job| a.out(job))
    }),
    row("list_trials", |app, mut a| {
        let id = a.id()?;
        match a.fields.remove("format").as_ref().map(|f| f.as_str().unwrap_or("")) {
            None | Some("json") => a.page(app, |app, page| trials::page(app, &id, page)),
            Some("csv") => a.nothing_more().and_then(|()| bytes(trials::csv(app, &id)?.into_bytes())),
            Some("scene") => a.nothing_more().and_then(|()| a.out(trials::scene(app, &id)?)),
            Some(other) => Err(Error::input("format", format!("{other:?}"), "json, csv or scene").into()),
        }
    }),
    light("healthz", always, |_, a| a.nothing_more().and_then(|()| a.out(system::health("ok")))),
    light("readyz", always, |app, a| {
        a.nothing_more()?;
        a.out(system::health(if *app.stopping.borrow() { "stopping" } else { "ready" }))
    }),
    row("openapi", |_, a| {
        a.nothing_more()?;
        let document: Option<Value> = serde_json::from_str(&crate::serve::openapi_document()).ok();
        Reply::plain(&document)
    }),
];

/// The operation with this name.
pub fn operation(name: &str) -> Answer<&'static Operation> {
    OPERATIONS.iter().find(|o| o.name == name).ok_or_else(|| {
        let known = OPERATIONS.iter().map(|o| o.name.to_string()).collect();
        Error::NotFound { kind: "operation", id: name.into(), known }.into()
    })
}

fn always(_: &App, _: &Asked) -> bool {
    true
}

const fn row(name: &'static str, run: fn(&App, Asked) -> Answer<Reply>) -> Operation {
    Operation { name, is_light: |_, _| false, run }
}

const fn light(
    name: &'static str,
    is_light: fn(&App, &Asked) -> bool,
    run: fn(&App, Asked) -> Answer<Reply>,
) -> Operation {
    Operation { name, is_light, run }
}

fn one_light(app: &App, asked: &Asked) -> bool {
    world::is_light(app, asked.fields.get("id").and_then(Value::as_str).into_iter())
}

fn few_light(app: &App, asked: &Asked) -> bool {
    let ids = asked.fields.get("worlds").and_then(Value::as_array);
    let ids = ids.into_iter().flatten().filter_map(Value::as_str).take(FEW + 1);
    let ids: Vec<String> = ids.map(String::from).collect();
    batch::is_light(app, &ids)
}

fn bytes(body: Vec<u8>) -> Answer<Reply> {
    let arrays = vec![("body", Array::line(Data::Bytes(body)))];
    Ok(Reply { arrays, ..Reply::plain(&Map::new())? })
}

impl Reply {
    /// An answer without arrays.
    pub fn plain<T: Serialize + ?Sized>(answer: &T) -> Answer<Reply> {
        let mut result = Vec::with_capacity(256);
        packed(&mut result, answer).map_err(|e| {
            tracing::error!("an answer cannot be written: {e}");
            Problem::defect()
        })?;
        Ok(Reply { result, arrays: Vec::new() })
    }
}

impl Asked {
    /// Ids of what is worked on: requests of one client that share any are carried out in order.
    pub fn names(&self) -> Vec<String> {
        let one = ["id", "world"].into_iter().filter_map(|f| self.fields.get(f)?.as_str());
        let many = self.fields.get("worlds").and_then(Value::as_array).into_iter().flatten();
        one.chain(many.filter_map(Value::as_str)).map(String::from).collect()
    }

    fn id(&mut self) -> Answer<String> {
        self.text("id")
    }

    /// The id, where nothing else is taken.
    fn only_id(&mut self) -> Answer<String> {
        let id = self.id()?;
        self.nothing_more().map(|()| id)
    }

    /// Takes a field that must be there and be text (or a number: tasks have them).
    fn text(&mut self, field: &str) -> Answer<String> {
        match self.fields.remove(field) {
            Some(Value::String(text)) => Ok(text),
            Some(Value::Number(n)) => Ok(n.to_string()),
            Some(other) => Err(Problem::malformed(Error::input(field, other, "text"))),
            None => Err(Problem::malformed(Error::input(field, "missing", "text"))),
        }
    }

    /// What is left, as an operation's body.
    fn body<T: DeserializeOwned>(&mut self) -> Answer<T> {
        from_value(Value::Object(std::mem::take(&mut self.fields))).map_err(Problem::malformed)
    }

    /// What is left, as the body of a step: what most of them are is read at once, and the rest with care.
    fn step(&mut self) -> Answer<StepIn> {
        let action = match self.fields.get("action") {
            Some(Value::Array(numbers)) if self.fields.len() == 1 => {
                numbers.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>()
            }
            _ => None,
        };
        action.map_or_else(|| self.body(), |numbers| Ok(StepIn { action: ActionIn::Vector(numbers) }))
    }

    /// What is left, as query parameters.
    fn pairs(&mut self) -> Answer<Vec<(String, String)>> {
        let pair = |(name, value): (String, Value)| {
            let text = written(&value).ok_or_else(|| {
                Problem::malformed(Error::input(&name, &value, "text, a number, true or false, or numbers"))
            })?;
            Ok((name, text))
        };
        std::mem::take(&mut self.fields).into_iter().filter(|(_, v)| !v.is_null()).map(pair).collect()
    }

    fn nothing_more(&self) -> Answer<()> {
        match self.fields.iter().next() {
            None => Ok(()),
            Some((name, value)) => {
                Err(Error::input(name, value, "absent: the operation does not take it").into())
            }
        }
    }

    fn page<T: Serialize + Bulk>(
        mut self,
        app: &App,
        work: impl FnOnce(&App, &Page) -> crate::error::Result<T>,
    ) -> Answer<Reply> {
        let page = Page::from_query(&self.pairs()?)?;
        self.out(work(app, &page)?)
    }

    fn out<T: Serialize + Bulk>(&self, mut answer: T) -> Answer<Reply> {
        let arrays = if self.raw { answer.bulk() } else { Vec::new() };
        Ok(Reply { arrays, ..Reply::plain(&answer)? })
    }

    fn made<T: Serialize>(
        &self,
        app: &App,
        by: Option<Once>,
        work: impl FnOnce(&App, super::Keep<T>) -> crate::error::Result<T>,
    ) -> Answer<Reply> {
        let (answered, _) = once(app, by, 200, |_| None, work)?;
        Reply::plain(&serde_json::from_slice::<Value>(&answered.body).unwrap_or_default())
    }
}

/// A value as a query parameter would have it: numbers of a list with commas between.
fn written(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Number(n) => Some(n.to_string()),
        Value::Bool(b) => Some(b.to_string()),
        Value::Array(items) => {
            let items = items.iter().map(|i| i.is_number().then(|| i.to_string()));
            Some(items.collect::<Option<Vec<_>>>()?.join(","))
        }
        Value::Null | Value::Object(_) => None,
    }
}
