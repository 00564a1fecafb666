//! A declaration: everything the transports, the document and the queue of jobs know of an operation.
//!
//! ```text
//! get("get_surface", "/v1/surfaces/{id}", "workflow", READ)
//!     .about("One surface with its points.")
//!     .refuses(&[(404, "")])
//!     .does(|app, Id(id)| one(app, &id))
//! ```
//!
//! The types of the function say the rest: what it takes ([`Input`]) is its parameters and its body, what it gives
//! ([`Output`]) its answer.

use std::sync::Arc;

use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;
use utoipa::openapi::path::HttpMethod;

use super::asked::Asked;
use super::describe::{Described, Lead};
use super::input::Input;
use super::once::{Keep, Once, once};
use super::reply::{Content, Output, Reply};
use crate::access::Scope;
use crate::error::Result;
use crate::job::Work;
use crate::serve::app::App;
use crate::serve::problem::Answer;
use crate::serve::shared::Base;
use crate::serve::weight::Weight;
use crate::serve::wire::{Bulk, JobOut};

/// Something a client can ask for.
pub struct Operation {
    /// Its `operationId`, and its name over ZeroMQ.
    pub name: &'static str,
    pub method: HttpMethod,
    /// Over HTTP; `{id}` stands for a parameter.
    pub path: &'static str,
    /// What a token must allow, for its bearer to ask for it.
    pub needs: Needs,
    /// Whether it reads a body.
    pub takes_body: bool,
    /// Whether it takes an `Idempotency-Key`: repeated under the same key, it makes nothing.
    pub keyed: bool,
    /// Whether ZeroMQ does not have it.
    pub only_http: bool,
    /// What the OpenAPI document says of it.
    pub described: Described,
    /// The job it queues: its kind, and how its work is made from its plan, also after a restart.
    pub job: Option<(&'static str, MakeWork)>,
    ready: Ready,
}

/// The scope that an operation needs; `None`: no token at all.
pub type Needs = Option<Scope>;
/// For whoever watches over the server.
pub const OPEN: Needs = None;
/// Shows something.
pub const READ: Needs = Some(Scope::Read);
/// Makes or moves something.
pub const ACT: Needs = Some(Scope::Act);
/// Is about what all share.
pub const ADMIN: Needs = Some(Scope::Admin);

/// Makes a job's work from its plan.
pub type MakeWork = fn(&Arc<Base>, &Value) -> Result<Work>;

type Ready = Box<dyn Fn(&App, Asked) -> Answer<Call> + Send + Sync>;

/// Does what was asked.
pub type Doing = Box<dyn FnOnce(&App) -> Answer<Reply> + Send>;

/// What was asked, understood: ready to be done.
pub struct Call {
    pub weight: Weight,
    pub work: Doing,
}

impl Operation {
    /// Reads what is asked of it; who may not ask is refused, and what it does not take.
    pub fn ready(&self, app: &App, asked: Asked) -> Answer<Call> {
        self.admits(app)?;
        (self.ready)(app, asked)
    }

    /// Errors unless whoever asks may ask for it.
    pub fn admits(&self, app: &App) -> Answer<()> {
        Ok(self.needs.map_or(Ok(()), |scope| app.needs(scope))?)
    }
}

/// `GET` of a path.
pub fn get(name: &'static str, path: &'static str, tag: &str, needs: Needs) -> Declaration {
    Declaration::new(name, HttpMethod::Get, path, tag, needs)
}

/// `POST` to a path.
pub fn post(name: &'static str, path: &'static str, tag: &str, needs: Needs) -> Declaration {
    Declaration::new(name, HttpMethod::Post, path, tag, needs)
}

/// `PUT` to a path.
pub fn put(name: &'static str, path: &'static str, tag: &str, needs: Needs) -> Declaration {
    Declaration::new(name, HttpMethod::Put, path, tag, needs)
}

/// `DELETE` of a path.
pub fn delete(name: &'static str, path: &'static str, tag: &str, needs: Needs) -> Declaration {
    Declaration::new(name, HttpMethod::Delete, path, tag, needs)
}

/// An operation that does not say yet what it does.
pub struct Declaration {
    name: &'static str,
    method: HttpMethod,
    path: &'static str,
    needs: Needs,
    only_http: bool,
    described: Described,
}

/// Where what was made is found: what the header is for, and the path.
pub struct Location<T> {
    about: &'static str,
    path: fn(&T) -> String,
}

/// The answer has a `Location`.
pub fn at<T>(about: &'static str, path: fn(&T) -> String) -> Option<Location<T>> {
    Some(Location { about, path })
}

impl Declaration {
    fn new(
        name: &'static str,
        method: HttpMethod,
        path: &'static str,
        tag: &str,
        needs: Needs,
    ) -> Declaration {
        let mut described = Described::new(name, tag);
        described.needs(needs);
        Declaration { name, method, path, needs, only_http: false, described }
    }

    /// What it does; after an empty line, what else there is to know.
    pub fn about(mut self, text: &str) -> Declaration {
        self.described.about(text);
        self
    }

    /// Statuses of problems it may answer with; an empty text stands for the status's own.
    pub fn refuses(mut self, with: &[(u16, &str)]) -> Declaration {
        with.iter().for_each(|(status, about)| self.described.problem(*status, about));
        self
    }

    /// A status it answers with besides, or what the usual one is about.
    pub fn answers<T: ToSchema>(mut self, status: u16, about: &str) -> Declaration {
        self.described.json::<T>(status, about);
        self
    }

    /// The same without a body.
    pub fn answers_nothing(mut self, status: u16, about: &str) -> Declaration {
        self.described.nothing(status, about);
        self
    }

    /// The same with another media type; bytes or text.
    pub fn answers_media(mut self, status: u16, about: &str, kinds: &[&str]) -> Declaration {
        self.described.media(status, about, kinds);
        self
    }

    /// What an event of the answer has as data.
    pub fn tells<T: ToSchema>(mut self) -> Declaration {
        self.described.schema::<T>();
        self
    }

    /// An answer of this status tells an id, at a JSON pointer, with which to ask for what is at `path` and below it.
    pub fn leads_to(mut self, status: u16, path: &'static str, id: &'static str) -> Declaration {
        self.described.leads.push(Lead { status, path, id });
        self
    }

    /// ZeroMQ does not have it.
    pub fn only_http(mut self) -> Declaration {
        self.only_http = true;
        self
    }

    /// Answers with what `work` gives.
    pub fn does<I: Input, O: Output>(
        self,
        work: impl Fn(&App, I) -> Result<O> + Copy + Send + Sync + 'static,
    ) -> Operation {
        self.weighed(|_, _| Weight::Usual, work)
    }

    /// The same for what computes.
    pub fn computes<I: Input, O: Output>(
        self,
        work: impl Fn(&App, I) -> Result<O> + Copy + Send + Sync + 'static,
    ) -> Operation {
        self.weighed(|_, _| Weight::Heavy, work)
    }

    /// The same, `weigh` telling what it costs.
    pub fn weighed<I: Input, O: Output>(
        mut self,
        weigh: impl Fn(&App, &I) -> Weight + Send + Sync + 'static,
        work: impl Fn(&App, I) -> Result<O> + Copy + Send + Sync + 'static,
    ) -> Operation {
        I::describe(&mut self.described);
        O::describe(&mut self.described);
        self.operation(false, move |app, input: I, _| Call {
            weight: weigh(app, &input),
            work: Box::new(move |app| Ok(work(app, input)?.reply())),
        })
    }

    /// Makes something, once: `work` is given what makes the answer that is to be kept with its effect, and repeated
    /// under the same key the operation makes nothing and is answered the same.
    pub fn makes<I: Input, T: Serialize + Bulk + ToSchema + 'static>(
        mut self,
        status: u16,
        location: Option<Location<T>>,
        work: impl Fn(&App, I, Keep<T>) -> Result<T> + Copy + Send + Sync + 'static,
    ) -> Operation {
        I::describe(&mut self.described);
        self.described.key();
        self.described.json::<T>(status, "");
        if let Some(location) = &location {
            self.described.location(status, location.about);
        }
        let place = location.map(|l| l.path);
        self.operation(true, move |_, input: I, by| Call {
            weight: Weight::Usual,
            work: Box::new(move |app| {
                let (made, again) = once(app, by, status, place, |app, keep| work(app, input, keep))?;
                let (status, location) = (made.status, made.location);
                Ok(Reply { status, location, again, content: Content::Json(made.body) })
            }),
        })
    }

    /// Queues a job of a kind: `begin` checks what is asked and decides on everything, `work` does what was decided,
    /// now or after a restart.
    pub fn queues<I: Input>(
        mut self,
        kind: &'static str,
        begin: impl Fn(&App, I, Keep<JobOut>) -> Result<JobOut> + Copy + Send + Sync + 'static,
        work: MakeWork,
    ) -> Operation {
        self.described.problem(429, "Too many waiting jobs");
        self.described.leads.push(Lead { status: 202, path: "/v1/jobs/{id}", id: "/id" });
        let place = at("Where the job is", |job: &JobOut| format!("/v1/jobs/{}", job.id));
        Operation { job: Some((kind, work)), ..self.makes(202, place, begin) }
    }

    fn operation<I: Input>(
        self,
        keyed: bool,
        call: impl Fn(&App, I, Option<Once>) -> Call + Send + Sync + 'static,
    ) -> Operation {
        let ready = move |app: &App, mut asked: Asked| {
            let by = asked.once.take();
            let input = I::read(&mut asked)?;
            asked.nothing_more()?;
            Ok(call(app, input, by))
        };
        Operation {
            name: self.name,
            method: self.method,
            path: self.path,
            needs: self.needs,
            takes_body: self.described.takes_body(),
            keyed,
            only_http: self.only_http,
            described: self.described,
            job: None,
            ready: Box::new(ready),
        }
    }
}
