//! The OpenAPI document: the operations' descriptions and what they share. For generated clients and tests it is complete: every
//! response has a description, shared parameters have bounds, unsigned integers go beyond 63 bits, and binary bodies are
//! binary.

use axum::http::StatusCode;
use utoipa::openapi::link::Link;
use utoipa::openapi::path::{Operation, Parameter, PathItem, PathsBuilder};
use utoipa::openapi::schema::{
    AdditionalProperties, ArrayItems, KnownFormat, Object, Schema, SchemaFormat, SchemaType, Type,
};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::openapi::{Content, OpenApi, RefOr, Required};
use utoipa::{Number, OpenApi as _};

use crate::serve::operation::{ResponseLink, SECURITY_SCHEME};
use crate::serve::problem::Problem;

/// The document without the operations.
#[derive(utoipa::OpenApi)]
#[openapi(
    info(
        title = "iplw",
        description = "2D physics worlds to act in, latent factors to estimate, policies to transfer. \
            All quantities are SI. Every error is a problem (RFC 9457) that names the field, its value and what \
            is allowed. A POST that creates something accepts an `Idempotency-Key`: repeated with the same key, it has \
            no further effect and gets the same response. Lists are paginated: `limit`, and `cursor` from the `next` of \
            the previous page. Every route that accepts JSON accepts the same map as `application/msgpack`, and returns it \
            if the client accepts it. In msgpack an array may be extension 78, `[dtype, shape, bytes]` with NumPy's \
            dtype, little endian, C order; responses use it on `Accept: application/msgpack; arrays=raw`.",
    ),
    tags(
        (name = "worlds", description = "Worlds as resources: reset, step, set_latents, rollout, render."),
        (name = "control", description = "Control tasks: driven mechanisms in many steps, in vectors of environments."),
        (name = "batch", description = "Many worlds in one request, atomically."),
        (name = "tasks", description = "Task families."),
        (name = "workflow", description = "Explore, measure and estimate, as jobs."),
        (name = "policies", description = "Train, act, evaluate, download and upload weights."),
        (name = "jobs", description = "Long-running work: progress by server-sent events, cancellation."),
        (name = "system", description = "Health, metrics, this document."),
    ),
    components(schemas(Problem))
)]
struct DocumentHeader;

/// The document of these operations: pretty JSON with a newline at the end.
pub fn document(operations: &[crate::serve::operation::Operation]) -> String {
    let mut document = DocumentHeader::openapi();
    document.info.version = env!("CARGO_PKG_VERSION").into();
    let schemas = &mut document.components.get_or_insert_default().schemas;
    for operation in operations {
        schemas.extend(operation.doc.schemas.iter().cloned());
        let mut described = operation.doc.operation();
        operation.doc.links.iter().for_each(|lead| links(lead, operations, &mut described));
        let item = PathItem::new(operation.method.clone(), described);
        document.paths =
            PathsBuilder::from(std::mem::take(&mut document.paths)).path(operation.path, item).build();
    }
    let token = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some(
        "A token of `iplw token new`, with the scope that each operation names. A server without tokens needs \
         none.",
    ));
    let components = document.components.get_or_insert_default();
    components.add_security_scheme(SECURITY_SCHEME, SecurityScheme::Http(token.build()));
    complete(&mut document);
    document.to_pretty_json().map(|json| json + "\n").unwrap_or_default()
}

/// Adds OpenAPI links from a response to the operations that take the id it contains.
fn links(lead: &ResponseLink, operations: &[crate::serve::operation::Operation], from: &mut Operation) {
    let below = |path: &str| {
        path.strip_prefix(lead.path).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    };
    let Some(RefOr::T(response)) = from.responses.responses.get_mut(&lead.status.to_string()) else { return };
    for to in operations.iter().filter(|o| below(o.path)) {
        let id = format!("$response.body#{}", lead.id);
        let link = Link::builder().operation_id(to.name).parameter("id", id).build();
        response.links.insert(to.name.into(), RefOr::T(link));
    }
}

fn complete(document: &mut OpenApi) {
    let optional = optional(document);
    for item in document.paths.paths.values_mut() {
        let operations = [&mut item.get, &mut item.post, &mut item.put, &mut item.patch, &mut item.delete];
        for one in operations.into_iter().flatten() {
            operation(one);
            body(one, &optional);
        }
    }
    if let Some(components) = &mut document.components {
        components.schemas.values_mut().for_each(schema);
    }
}

fn operation(operation: &mut Operation) {
    for (status, response) in &mut operation.responses.responses {
        let RefOr::T(response) = response else { continue };
        if response.description.is_empty() {
            let code = status.parse().ok().and_then(|code| StatusCode::from_u16(code).ok());
            response.description = code.and_then(|c| c.canonical_reason()).unwrap_or("Response").into();
        }
        response.content.iter_mut().for_each(|(kind, content)| bytes(kind, content));
    }
    operation.parameters.iter_mut().flatten().for_each(parameter);
}

/// References to schemas without required fields.
fn optional(document: &OpenApi) -> Vec<String> {
    let schemas = document.components.iter().flat_map(|c| &c.schemas);
    let empty = schemas.filter(|(_, s)| matches!(s, RefOr::T(Schema::Object(o)) if o.required.is_empty()));
    empty.map(|(name, _)| format!("#/components/schemas/{name}")).collect()
}

/// A missing body is `{}`, so the body is optional if all fields are.
fn body(operation: &mut Operation, optional: &[String]) {
    let Some(RefOr::T(body)) = &mut operation.request_body else { return };
    body.content.iter_mut().for_each(|(kind, content)| bytes(kind, content));
    let absent = |content: &RefOr<Content>| match content {
        RefOr::T(Content { schema: Some(RefOr::Ref(to)), .. }) => optional.contains(&to.ref_location),
        _ => false,
    };
    if !body.content.is_empty() && body.content.values().all(absent) {
        body.required = Some(Required::False);
    }
}

/// Bounds of parameters, by name.
fn parameter(parameter: &mut RefOr<Parameter>) {
    let RefOr::T(parameter) = parameter else { return };
    let Some(RefOr::T(Schema::Object(object))) = &mut parameter.schema else { return };
    match parameter.name.as_str() {
        "limit" => {
            object.minimum = Some(Number::UInt(1));
            object.maximum = Some(Number::UInt(1000));
        }
        "Idempotency-Key" => object.pattern = Some("^[!-~]{1,255}$".into()),
        _ => {}
    }
}

/// A body that is neither text nor JSON is binary, not a list of numbers.
fn bytes(kind: &str, content: &mut RefOr<Content>) {
    let RefOr::T(content) = content else { return };
    if kind == "application/octet-stream" || kind.starts_with("image/png") {
        let binary = Object::builder()
            .schema_type(SchemaType::Type(Type::String))
            .format(Some(SchemaFormat::KnownFormat(KnownFormat::Binary)));
        content.schema = Some(RefOr::T(binary.build().into()));
    }
}

/// Unsigned integers go up to 2^64 - 1; `int64` would limit them to 2^63 - 1.
fn schema(node: &mut RefOr<Schema>) {
    let RefOr::T(node) = node else { return };
    match node {
        Schema::Object(object) => {
            let long = SchemaFormat::KnownFormat(KnownFormat::Int64);
            let none =
                |least: &Number| matches!(least, Number::Int(0) | Number::UInt(0) | Number::Float(0.0));
            if object.format == Some(long) && object.minimum.as_ref().is_some_and(none) {
                object.format = None;
                object.maximum = Some(Number::UInt(usize::MAX));
            }
            object.properties.values_mut().for_each(schema);
            if let Some(AdditionalProperties::RefOr(more)) = object.additional_properties.as_deref_mut() {
                schema(more);
            }
        }
        Schema::Array(array) => {
            if let ArrayItems::RefOrSchema(items) = &mut array.items {
                schema(items);
            }
        }
        Schema::OneOf(one) => one.items.iter_mut().for_each(schema),
        Schema::AllOf(all) => all.items.iter_mut().for_each(schema),
        Schema::AnyOf(any) => any.items.iter_mut().for_each(schema),
        _ => {}
    }
}
