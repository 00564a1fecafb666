//! What an operation says of itself in the OpenAPI document.

use std::collections::BTreeMap;

use utoipa::openapi::path::{Operation, Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::request_body::RequestBody;
use utoipa::openapi::schema::{SchemaType, Type};
use utoipa::openapi::security::SecurityRequirement;
use utoipa::openapi::{Content, HeaderBuilder, Ref, RefOr, Required, Response, Schema};
use utoipa::{PartialSchema, ToSchema};

use crate::access::Scope;
use crate::serve::problem::{PROBLEM, Problem};
use crate::serve::wire::MSGPACK;

/// Name of the security scheme.
pub const TOKEN: &str = "token";

/// An operation of the document under way, and the schemas it refers to.
pub struct Described {
    operation: Operation,
    /// By status.
    responses: BTreeMap<u16, Response>,
    body: Option<RequestBody>,
    /// By name.
    pub schemas: Vec<(String, RefOr<Schema>)>,
    /// What its answers lead to.
    pub leads: Vec<Lead>,
}

/// An answer that tells an id, which stands in the path of others.
pub struct Lead {
    /// The answer's.
    pub status: u16,
    /// Of the others, up to the id; those below it too.
    pub path: &'static str,
    /// Where the id is in the answer, a JSON pointer.
    pub id: &'static str,
}

impl Described {
    /// By name, among those of a tag.
    pub fn new(name: &str, tag: &str) -> Described {
        let mut operation = Operation::new();
        operation.operation_id = Some(name.into());
        operation.tags = Some(vec![tag.into()]);
        Described {
            operation,
            responses: BTreeMap::new(),
            body: None,
            schemas: Vec::new(),
            leads: Vec::new(),
        }
    }

    /// The operation of the document.
    pub fn operation(&self) -> Operation {
        let mut operation = self.operation.clone();
        operation.request_body = self.body.clone().map(RefOr::T);
        let responses = self.responses.iter().map(|(s, r)| (s.to_string(), RefOr::T(r.clone())));
        operation.responses.responses = responses.collect();
        operation
    }

    /// What a token must allow for it: what is answered without one, or with a weaker one.
    pub fn needs(&mut self, needs: Option<Scope>) {
        self.problem(421, "The server is not called so");
        self.problem(503, "The request's deadline has passed, or storage fails or is damaged");
        let Some(scope) = needs else {
            self.problem(403, "Not from this page");
            self.operation.security = Some(Vec::new());
            return;
        };
        let about = format!("The token may not {}, or not from this page", scope.name());
        self.problem(401, "No token, or none that is good");
        self.problem(403, if scope == Scope::Read { "Not from this page" } else { &about });
        // A server without tokens asks for none.
        self.operation.security =
            Some(vec![SecurityRequirement::default(), SecurityRequirement::new(TOKEN, [scope.name()])]);
    }

    /// A summary; after an empty line, a description.
    pub fn about(&mut self, text: &str) {
        let (summary, more) = text.split_once("\n\n").map_or((text, None), |(s, more)| (s, Some(more)));
        self.operation.summary = Some(summary.into());
        self.operation.description = more.map(String::from);
    }

    /// A part of the path, text, with an example if there is one.
    pub fn path(&mut self, name: &str, example: Option<&str>) {
        let parameter = ParameterBuilder::new().name(name).parameter_in(ParameterIn::Path);
        let parameter = parameter.required(Required::True).schema(Some(String::schema()));
        self.parameter(parameter.example(example.map(Into::into)).build());
    }

    /// A parameter after the `?`, which may be absent.
    pub fn query<T: PartialSchema>(&mut self, name: &str, about: &str) {
        self.optional(ParameterIn::Query, name, about, T::schema());
    }

    /// A header, which may be absent.
    pub fn header<T: PartialSchema>(&mut self, name: &str, about: &str) {
        let mut schema = T::schema();
        if let RefOr::T(Schema::Object(object)) = &mut schema
            && let SchemaType::Type(one) = &object.schema_type
        {
            object.schema_type = SchemaType::Array(vec![one.clone(), Type::Null]);
        }
        self.optional(ParameterIn::Header, name, about, schema);
    }

    /// The header that makes it one that may be repeated.
    pub fn key(&mut self) {
        let about = "Repeated under the same key, the request has no further effect and is answered the same";
        self.header::<String>("Idempotency-Key", about);
    }

    /// A body of JSON, which may turn out not to be what is taken.
    pub fn body<T: ToSchema>(&mut self) {
        let schema = self.reference::<T>();
        self.body_of("application/json", schema);
        self.problem(400, "");
        self.problem(422, "");
    }

    /// A body of text or bytes.
    pub fn body_of_media(&mut self, kind: &str) {
        let schema = if kind.starts_with("text/") { String::schema() } else { Vec::<u8>::schema() };
        self.body_of(kind, schema);
    }

    /// Whether there is a body.
    pub fn takes_body(&self) -> bool {
        self.body.is_some()
    }

    /// The media types of its body; msgpack goes wherever JSON does.
    pub fn body_types(&self) -> Vec<String> {
        let kinds = self.body.iter().flat_map(|b| b.content.keys().cloned());
        let packed = |kind: &String| (kind == "application/json").then(|| MSGPACK.to_string());
        kinds.flat_map(|kind| packed(&kind).into_iter().chain([kind])).collect()
    }

    /// An answer of JSON; what is said of a status already stays, unless there is more to say.
    pub fn json<T: ToSchema>(&mut self, status: u16, about: &str) {
        let schema = self.reference::<T>();
        self.response(status, about).content.insert("application/json".into(), content(schema));
    }

    /// The document has this schema, whatever refers to it.
    pub fn schema<T: ToSchema>(&mut self) {
        self.reference::<T>();
    }

    /// An answer of text or bytes.
    pub fn media(&mut self, status: u16, about: &str, kinds: &[&str]) {
        for kind in kinds {
            let is_text = kind.starts_with("text/") || *kind == "image/svg+xml";
            let schema = if is_text { String::schema() } else { Vec::<u8>::schema() };
            self.response(status, about).content.insert((*kind).into(), content(schema));
        }
    }

    /// An answer of JSON of which nothing is said.
    pub fn any_json(&mut self, status: u16) {
        let any = utoipa::openapi::schema::Object::new();
        let any = content(RefOr::T(Schema::Object(any)));
        self.response(status, "").content.insert("application/json".into(), any);
    }

    /// An answer without a body.
    pub fn nothing(&mut self, status: u16, about: &str) {
        self.response(status, about);
    }

    /// A problem it may answer with.
    pub fn problem(&mut self, status: u16, about: &str) {
        let schema = self.reference::<Problem>();
        self.response(status, about).content.insert(PROBLEM.into(), content(schema));
    }

    /// Where what was made is found.
    pub fn location(&mut self, status: u16, about: &str) {
        let header = HeaderBuilder::new().schema(Some(String::schema())).description(Some(about)).build();
        self.response(status, "").headers.insert("Location".into(), RefOr::T(header));
    }

    fn response(&mut self, status: u16, about: &str) -> &mut Response {
        let response = self.responses.entry(status).or_insert_with(|| Response::new(""));
        if !about.is_empty() {
            response.description = about.into();
        }
        response
    }

    fn optional(&mut self, place: ParameterIn, name: &str, about: &str, schema: RefOr<Schema>) {
        let parameter = ParameterBuilder::new().name(name).parameter_in(place).required(Required::False);
        self.parameter(parameter.description(Some(about)).schema(Some(schema)).build());
    }

    fn parameter(&mut self, parameter: Parameter) {
        self.operation.parameters.get_or_insert_default().push(RefOr::T(parameter));
    }

    fn body_of(&mut self, kind: &str, schema: RefOr<Schema>) {
        let body = self.body.get_or_insert_with(RequestBody::new);
        body.required = Some(Required::True);
        body.content.insert(kind.into(), content(schema));
        self.problem(408, "The body takes too long");
        self.problem(413, "");
        self.problem(415, "A page sends a body of another type");
    }

    /// The schema by name, which the document is to have.
    fn reference<T: ToSchema>(&mut self) -> RefOr<Schema> {
        let name = T::name();
        self.schemas.push((name.to_string(), T::schema()));
        T::schemas(&mut self.schemas);
        RefOr::Ref(Ref::from_schema_name(name))
    }
}

fn content(schema: RefOr<Schema>) -> RefOr<Content> {
    RefOr::T(Content::new(Some(schema)))
}
