//! Declaration of an operation: everything that the transports, the OpenAPI document and the job queue know of it.
//!
//! ```text
//! get("get_surface", "/v1/surfaces/{id}", "workflow", READ)
//!     .about("One surface with its points.")
//!     .errors(&[(404, "")])
//!     .handler(|app, PathId(id)| one(app, &id))
//! ```
//!
//! The handler's types supply the rest: its input ([`Extractor`]) gives the parameters and the body, its output
//! ([`HandlerOutput`]) the response.

use std::sync::Arc;

use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;
use utoipa::openapi::path::HttpMethod;

use super::describe::{OperationDoc, ResponseLink};
use super::extractor::Extractor;
use super::idempotency::{IdempotencyKey, RecordResponse, idempotent};
use super::request::OperationRequest;
use super::response::{HandlerOutput, OperationResponse, Payload};
use crate::access::Scope;
use crate::error::Result;
use crate::job::Work;
use crate::serve::execution_class::ExecutionClass;
use crate::serve::problem::HandlerResult;
use crate::serve::request_context::RequestContext;
use crate::serve::state::CoreState;
use crate::serve::wire::{BinaryArrays, JobOut};

/// An operation of the API.
pub struct Operation {
    /// Its `operationId`, and its name over ZeroMQ.
    pub name: &'static str,
    pub method: HttpMethod,
    /// Path over HTTP; `{id}` is a parameter.
    pub path: &'static str,
    /// Scope that the token must have.
    pub required_scope: RequiredScope,
    /// Whether it reads a body.
    pub has_body: bool,
    /// Whether it accepts an `Idempotency-Key`.
    pub idempotent_method: bool,
    /// Whether it is available over HTTP only.
    pub http_only: bool,
    /// Its part of the OpenAPI document.
    pub doc: OperationDoc,
    /// Kind of the job it queues, and the function that builds the job's work from its plan, also after a restart.
    pub job: Option<(&'static str, BuildWork)>,
    prepare: PrepareFn,
}

/// Scope that an operation requires; `None` if it needs no token.
pub type RequiredScope = Option<Scope>;
/// Needs no token: for monitoring.
pub const PUBLIC: RequiredScope = None;
/// Reads a resource.
pub const READ: RequiredScope = Some(Scope::Read);
/// Creates or changes a resource.
pub const ACT: RequiredScope = Some(Scope::Act);
/// Manages shared resources.
pub const ADMIN: RequiredScope = Some(Scope::Admin);

/// Builds a job's work from its plan.
pub type BuildWork = fn(&Arc<CoreState>, &Value) -> Result<Work>;

type PrepareFn = Box<dyn Fn(&RequestContext, OperationRequest) -> HandlerResult<PreparedCall> + Send + Sync>;

/// Runs the handler.
pub type HandlerFn = Box<dyn FnOnce(&RequestContext) -> HandlerResult<OperationResponse> + Send>;

/// A parsed and authorised request, ready to run.
pub struct PreparedCall {
    pub class: ExecutionClass,
    pub work: HandlerFn,
}

/// An operation whose required scope the caller has.
pub struct Authorized<'a>(&'a Operation);

impl Operation {
    /// Errors unless the caller has the required scope.
    pub fn authorize(&self, app: &RequestContext) -> HandlerResult<Authorized<'_>> {
        self.required_scope.map_or(Ok(()), |scope| app.require_scope(scope))?;
        Ok(Authorized(self))
    }
}

impl Authorized<'_> {
    /// Extracts the handler's input and rejects unknown fields.
    pub fn prepare(self, app: &RequestContext, request: OperationRequest) -> HandlerResult<PreparedCall> {
        (self.0.prepare)(app, request)
    }
}

/// `GET` of a path.
pub fn get(name: &'static str, path: &'static str, tag: &str, needs: RequiredScope) -> Declaration {
    Declaration::new(name, HttpMethod::Get, path, tag, needs)
}

/// `POST` to a path.
pub fn post(name: &'static str, path: &'static str, tag: &str, needs: RequiredScope) -> Declaration {
    Declaration::new(name, HttpMethod::Post, path, tag, needs)
}

/// `PUT` to a path.
pub fn put(name: &'static str, path: &'static str, tag: &str, needs: RequiredScope) -> Declaration {
    Declaration::new(name, HttpMethod::Put, path, tag, needs)
}

/// `PATCH` of a path: changes some fields of a resource.
pub fn patch(name: &'static str, path: &'static str, tag: &str, needs: RequiredScope) -> Declaration {
    Declaration::new(name, HttpMethod::Patch, path, tag, needs)
}

/// `DELETE` of a path.
pub fn delete(name: &'static str, path: &'static str, tag: &str, needs: RequiredScope) -> Declaration {
    Declaration::new(name, HttpMethod::Delete, path, tag, needs)
}

/// An operation without a handler yet.
pub struct Declaration {
    name: &'static str,
    method: HttpMethod,
    path: &'static str,
    required_scope: RequiredScope,
    http_only: bool,
    doc: OperationDoc,
}

/// `Location` of a created resource: description of the header, and the path.
pub struct Location<T> {
    about: &'static str,
    path: fn(&T) -> String,
}

/// The response has a `Location` header.
pub fn location<T>(about: &'static str, path: fn(&T) -> String) -> Option<Location<T>> {
    Some(Location { about, path })
}

impl Declaration {
    fn new(
        name: &'static str,
        method: HttpMethod,
        path: &'static str,
        tag: &str,
        needs: RequiredScope,
    ) -> Declaration {
        let mut doc = OperationDoc::new(name, tag);
        doc.require_scope(needs);
        Declaration { name, method, path, required_scope: needs, http_only: false, doc }
    }

    /// Summary; after an empty line, the description.
    pub fn about(mut self, text: &str) -> Declaration {
        self.doc.about(text);
        self
    }

    /// Problem responses by status; an empty text means the status's default description.
    pub fn errors(mut self, with: &[(u16, &str)]) -> Declaration {
        with.iter().for_each(|(status, about)| self.doc.problem(*status, about));
        self
    }

    /// A further response, or the description of the default one.
    pub fn response<T: ToSchema>(mut self, status: u16, about: &str) -> Declaration {
        self.doc.json::<T>(status, about);
        self
    }

    /// A response without a body.
    pub fn empty_response(mut self, status: u16, about: &str) -> Declaration {
        self.doc.empty(status, about);
        self
    }

    /// A response with another media type: bytes or text.
    pub fn media_response(mut self, status: u16, about: &str, kinds: &[&str]) -> Declaration {
        self.doc.media(status, about, kinds);
        self
    }

    /// Schema of the events' data.
    pub fn event_schema<T: ToSchema>(mut self) -> Declaration {
        self.doc.schema::<T>();
        self
    }

    /// A response of this status holds an id, at a JSON pointer, that is a parameter of the operations at `path` and below.
    pub fn links(mut self, status: u16, path: &'static str, id: &'static str) -> Declaration {
        self.doc.links.push(ResponseLink { status, path, id });
        self
    }

    /// Not available over ZeroMQ.
    pub fn http_only(mut self) -> Declaration {
        self.http_only = true;
        self
    }

    /// Handler of class [`ExecutionClass::Blocking`].
    pub fn handler<I: Extractor, O: HandlerOutput>(
        self,
        work: impl Fn(&RequestContext, I) -> Result<O> + Copy + Send + Sync + 'static,
    ) -> Operation {
        self.classified_handler(|_, _| ExecutionClass::Blocking, work)
    }

    /// Handler of class [`ExecutionClass::Compute`].
    pub fn compute_handler<I: Extractor, O: HandlerOutput>(
        self,
        work: impl Fn(&RequestContext, I) -> Result<O> + Copy + Send + Sync + 'static,
    ) -> Operation {
        self.classified_handler(|_, _| ExecutionClass::Compute, work)
    }

    /// Handler whose execution class depends on its input.
    pub fn classified_handler<I: Extractor, O: HandlerOutput>(
        mut self,
        classify: impl Fn(&RequestContext, &I) -> ExecutionClass + Send + Sync + 'static,
        work: impl Fn(&RequestContext, I) -> Result<O> + Copy + Send + Sync + 'static,
    ) -> Operation {
        I::describe(&mut self.doc);
        O::describe(&mut self.doc);
        self.operation(false, move |app, input: I, _| PreparedCall {
            class: classify(app, &input),
            work: Box::new(move |app| Ok(work(app, input)?.into_response())),
        })
    }

    /// Handler that creates a resource. It accepts an `Idempotency-Key`: `work` receives a function that builds the response to
    /// be stored in the same transaction, and a repeated request gets the stored response.
    pub fn create_handler<I: Extractor, T: Serialize + BinaryArrays + ToSchema + 'static>(
        self,
        status: u16,
        location: Option<Location<T>>,
        work: impl Fn(&RequestContext, I, RecordResponse<T>) -> Result<T> + Copy + Send + Sync + 'static,
    ) -> Operation {
        self.create_in_class(ExecutionClass::Blocking, status, location, work)
    }

    fn create_in_class<I: Extractor, T: Serialize + BinaryArrays + ToSchema + 'static>(
        mut self,
        class: ExecutionClass,
        status: u16,
        location: Option<Location<T>>,
        work: impl Fn(&RequestContext, I, RecordResponse<T>) -> Result<T> + Copy + Send + Sync + 'static,
    ) -> Operation {
        I::describe(&mut self.doc);
        self.doc.idempotency_key();
        self.doc.json::<T>(status, "");
        if let Some(location) = &location {
            self.doc.location(status, location.about);
        }
        let place = location.map(|l| l.path);
        self.operation(true, move |_, input: I, by| PreparedCall {
            class,
            work: Box::new(move |app| {
                let (made, replayed) =
                    idempotent(app, by, status, place, |app, keep| work(app, input, keep))?;
                let (status, location) = (made.status, made.location);
                Ok(OperationResponse { status, location, replayed, content: Payload::Json(made.body) })
            }),
        })
    }

    /// Handler that queues a job: `begin` validates the request and fixes the plan, `work` executes the plan, now or after a
    /// restart.
    pub fn job<I: Extractor>(
        mut self,
        kind: &'static str,
        begin: impl Fn(&RequestContext, I, RecordResponse<JobOut>) -> Result<JobOut>
        + Copy
        + Send
        + Sync
        + 'static,
        work: BuildWork,
    ) -> Operation {
        self.doc.problem(429, "Too many jobs are waiting");
        self.doc.links.push(ResponseLink { status: 202, path: "/v1/jobs/{id}", id: "/id" });
        let place = location("Path of the job", |job: &JobOut| format!("/v1/jobs/{}", job.id));
        // Its validation may take long, and much memory.
        let operation = self.create_in_class(ExecutionClass::Compute, 202, place, begin);
        Operation { job: Some((kind, work)), ..operation }
    }

    fn operation<I: Extractor>(
        self,
        idempotent_method: bool,
        call: impl Fn(&RequestContext, I, Option<IdempotencyKey>) -> PreparedCall + Send + Sync + 'static,
    ) -> Operation {
        let prepare = move |app: &RequestContext, mut request: OperationRequest| {
            let by = request.idempotency_key.take();
            let input = I::extract(&mut request)?;
            request.reject_unread_fields()?;
            Ok(call(app, input, by))
        };
        Operation {
            name: self.name,
            method: self.method,
            path: self.path,
            required_scope: self.required_scope,
            has_body: self.doc.has_body(),
            idempotent_method,
            http_only: self.http_only,
            doc: self.doc,
            job: None,
            prepare: Box::new(prepare),
        }
    }
}
