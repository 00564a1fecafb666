//! An operation's part of the OpenAPI document.

use std::collections::BTreeMap;

use utoipa::openapi::path::{Operation, Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::request_body::RequestBody;
use utoipa::openapi::schema::{SchemaType, Type};
use utoipa::openapi::security::SecurityRequirement;
use utoipa::openapi::{Content, HeaderBuilder, Ref, RefOr, Required, Response, Schema};
use utoipa::{PartialSchema, ToSchema};

use super::examples::example;
use crate::access::Scope;
use crate::serve::problem::{PROBLEM_JSON, Problem};
use crate::serve::wire::MSGPACK;

/// Name of the security scheme.
pub const SECURITY_SCHEME: &str = "token";

/// The OpenAPI operation under construction, and the schemas it refers to.
pub struct OperationDoc {
    operation: Operation,
    /// By status.
    responses: BTreeMap<u16, Response>,
    body: Option<RequestBody>,
    /// By name.
    pub schemas: Vec<(String, RefOr<Schema>)>,
    /// Links from its responses to other operations.
    pub links: Vec<ResponseLink>,
}

/// A response that holds an id used in the path of other operations (OpenAPI link object).
pub struct ResponseLink {
    /// Status of the response.
    pub status: u16,
    /// Path of the target operations up to the id; operations below it are targets as well.
    pub path: &'static str,
    /// JSON pointer to the id in the response.
    pub id: &'static str,
}

impl OperationDoc {
    /// An operation of this name and tag.
    pub fn new(name: &str, tag: &str) -> OperationDoc {
        let mut operation = Operation::new();
        operation.operation_id = Some(name.into());
        operation.tags = Some(vec![tag.into()]);
        OperationDoc {
            operation,
            responses: BTreeMap::new(),
            body: None,
            schemas: Vec::new(),
            links: Vec::new(),
        }
    }

    /// The OpenAPI operation.
    pub fn operation(&self) -> Operation {
        let mut operation = self.operation.clone();
        operation.request_body = self.body.clone().map(RefOr::T);
        let responses = self.responses.iter().map(|(s, r)| (s.to_string(), RefOr::T(r.clone())));
        operation.responses.responses = responses.collect();
        operation
    }

    /// Required scope, and the responses to requests that lack it.
    pub fn require_scope(&mut self, needs: Option<Scope>) {
        self.problem(421, "Wrong `Host`: the server does not have this name");
        self.problem(503, "The request's deadline has passed, or storage failed or is damaged");
        let Some(scope) = needs else {
            self.problem(403, "The origin is not allowed");
            self.operation.security = Some(Vec::new());
            return;
        };
        let about = format!("The token lacks the scope {}, or the origin is not allowed", scope.name());
        self.problem(401, "The token is missing or invalid");
        self.problem(403, if scope == Scope::Read { "The origin is not allowed" } else { &about });
        // A server without tokens needs no authentication.
        self.operation.security = Some(vec![
            SecurityRequirement::default(),
            SecurityRequirement::new(SECURITY_SCHEME, [scope.name()]),
        ]);
    }

    /// Summary; after an empty line, the description.
    pub fn about(&mut self, text: &str) {
        let (summary, more) = text.split_once("\n\n").map_or((text, None), |(s, more)| (s, Some(more)));
        self.operation.summary = Some(summary.into());
        self.operation.description = more.map(String::from);
    }

    /// A path parameter of type string, with an optional example.
    pub fn path(&mut self, name: &str, example: Option<&str>) {
        let parameter = ParameterBuilder::new().name(name).parameter_in(ParameterIn::Path);
        let parameter = parameter.required(Required::True).schema(Some(String::schema()));
        self.parameter(parameter.example(example.map(Into::into)).build());
    }

    /// An optional query parameter.
    pub fn query<T: PartialSchema>(&mut self, name: &str, about: &str) {
        self.optional_parameter(ParameterIn::Query, name, about, T::schema());
    }

    /// An optional header.
    pub fn header<T: PartialSchema>(&mut self, name: &str, about: &str) {
        let mut schema = T::schema();
        if let RefOr::T(Schema::Object(object)) = &mut schema
            && let SchemaType::Type(one) = &object.schema_type
        {
            object.schema_type = SchemaType::Array(vec![one.clone(), Type::Null]);
        }
        self.optional_parameter(ParameterIn::Header, name, about, schema);
    }

    /// The `Idempotency-Key` header.
    pub fn idempotency_key(&mut self) {
        let about = "A repeated request with the same key has no further effect and gets the same response";
        self.header::<String>("Idempotency-Key", about);
    }

    /// A JSON body; a malformed or invalid one is a 400 or a 422.
    pub fn body<T: ToSchema>(&mut self) {
        let schema = self.reference::<T>();
        self.body_of("application/json", schema);
        let shown = self.operation.operation_id.as_deref().and_then(example);
        let content = self.body.as_mut().and_then(|body| body.content.get_mut("application/json"));
        if let Some(RefOr::T(content)) = content {
            content.example = shown;
        }
        self.problem(400, "");
        self.problem(422, "");
    }

    /// A text or binary body.
    pub fn body_of_media(&mut self, kind: &str) {
        let schema = if kind.starts_with("text/") { String::schema() } else { Vec::<u8>::schema() };
        self.body_of(kind, schema);
    }

    /// Whether there is a body.
    pub fn has_body(&self) -> bool {
        self.body.is_some()
    }

    /// Media types of the body; msgpack is accepted wherever JSON is.
    pub fn body_types(&self) -> Vec<String> {
        let kinds = self.body.iter().flat_map(|b| b.content.keys().cloned());
        let packed = |kind: &String| (kind == "application/json").then(|| MSGPACK.to_string());
        kinds.flat_map(|kind| packed(&kind).into_iter().chain([kind])).collect()
    }

    /// A JSON response; an existing description stays if `about` is empty.
    pub fn json<T: ToSchema>(&mut self, status: u16, about: &str) {
        let schema = self.reference::<T>();
        self.response(status, about).content.insert("application/json".into(), content(schema));
    }

    /// Adds a schema to the document.
    pub fn schema<T: ToSchema>(&mut self) {
        self.reference::<T>();
    }

    /// A text or binary response.
    pub fn media(&mut self, status: u16, about: &str, kinds: &[&str]) {
        for kind in kinds {
            let is_text = kind.starts_with("text/") || *kind == "image/svg+xml";
            let schema = if is_text { String::schema() } else { Vec::<u8>::schema() };
            self.response(status, about).content.insert((*kind).into(), content(schema));
        }
    }

    /// A JSON response without a schema.
    pub fn any_json(&mut self, status: u16) {
        let any = utoipa::openapi::schema::Object::new();
        let any = content(RefOr::T(Schema::Object(any)));
        self.response(status, "").content.insert("application/json".into(), any);
    }

    /// A response without a body.
    pub fn empty(&mut self, status: u16, about: &str) {
        self.response(status, about);
    }

    /// A problem response.
    pub fn problem(&mut self, status: u16, about: &str) {
        let schema = self.reference::<Problem>();
        self.response(status, about).content.insert(PROBLEM_JSON.into(), content(schema));
    }

    /// The `Location` header of a response.
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

    fn optional_parameter(&mut self, place: ParameterIn, name: &str, about: &str, schema: RefOr<Schema>) {
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
        self.problem(408, "The body arrived too slowly");
        self.problem(413, "");
        self.problem(415, "A browser sent a body of an undeclared media type");
    }

    /// Adds the schema to the document and refers to it.
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
