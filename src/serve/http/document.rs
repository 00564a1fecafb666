//! The OpenAPI document: what each operation says of itself, and what is said of all, so that generated clients and tests
//! made from it meet no surprise: a description of every response, bounds of parameters that many operations share,
//! whole numbers beyond 63 bits, bytes as bytes.

use axum::http::StatusCode;
use utoipa::openapi::link::Link;
use utoipa::openapi::path::{Operation, Parameter, PathItem, PathsBuilder};
use utoipa::openapi::schema::{
    AdditionalProperties, ArrayItems, KnownFormat, Object, Schema, SchemaFormat, SchemaType, Type,
};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::openapi::{Content, OpenApi, RefOr, Required};
use utoipa::{Number, OpenApi as _};

use crate::serve::operation::{Lead, TOKEN};
use crate::serve::problem::Problem;

/// Everything but what the operations say of themselves.
#[derive(utoipa::OpenApi)]
#[openapi(
    info(
        title = "iplw",
        description = "2D physics worlds to act in, latent factors to estimate, policies to transfer. \
            All quantities are SI. Every error is a problem (RFC 9457) that names the field, its value and what \
            is allowed. A POST that makes something takes an `Idempotency-Key`: repeated under the same key, it \
            makes nothing and is answered the same. Lists come in pages: `limit`, and `cursor` from the `next` of \
            the page before. Every route that takes JSON takes the same map as `application/msgpack`, and gives it \
            where that is accepted. In msgpack an array may be extension 78, `[dtype, shape, bytes]` with NumPy's \
            dtype, little endian, C order; answers have them so on `Accept: application/msgpack; arrays=raw`.",
    ),
    tags(
        (name = "worlds", description = "Worlds as resources: reset, step, set_latents, rollout, render."),
        (name = "batch", description = "Many worlds in one request: all of it is done, or nothing."),
        (name = "tasks", description = "Built-in families of tasks."),
        (name = "workflow", description = "Explore, measure, estimate: as a job."),
        (name = "policies", description = "Train, act, evaluate, download and upload weights."),
        (name = "jobs", description = "Long work: progress by server-sent events, cancel."),
        (name = "system", description = "Health, metrics, this document."),
    ),
    components(schemas(Problem))
)]
struct Head;

/// The document of these operations: pretty JSON with a newline at the end.
pub fn document(operations: &[crate::serve::operation::Operation]) -> String {
    let mut document = Head::openapi();
    document.info.version = env!("CARGO_PKG_VERSION").into();
    let schemas = &mut document.components.get_or_insert_default().schemas;
    for operation in operations {
        schemas.extend(operation.described.schemas.iter().cloned());
        let mut described = operation.described.operation();
        operation.described.leads.iter().for_each(|lead| links(lead, operations, &mut described));
        let item = PathItem::new(operation.method.clone(), described);
        document.paths =
            PathsBuilder::from(std::mem::take(&mut document.paths)).path(operation.path, item).build();
    }
    let token = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some(
        "A token of `iplw token new`, with the scope that each operation names. A server that has no tokens asks \
         for none.",
    ));
    let components = document.components.get_or_insert_default();
    components.add_security_scheme(TOKEN, SecurityScheme::Http(token.build()));
    complete(&mut document);
    document.to_pretty_json().map(|json| json + "\n").unwrap_or_default()
}

/// Links an answer to every operation that is asked for with the id it tells.
fn links(lead: &Lead, operations: &[crate::serve::operation::Operation], from: &mut Operation) {
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
        let operations = [&mut item.get, &mut item.post, &mut item.put, &mut item.delete];
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
            response.description = code.and_then(|c| c.canonical_reason()).unwrap_or("The answer").into();
        }
        response.content.iter_mut().for_each(|(kind, content)| bytes(kind, content));
    }
    operation.parameters.iter_mut().flatten().for_each(parameter);
}

/// References to schemas without a required field.
fn optional(document: &OpenApi) -> Vec<String> {
    let schemas = document.components.iter().flat_map(|c| &c.schemas);
    let empty = schemas.filter(|(_, s)| matches!(s, RefOr::T(Schema::Object(o)) if o.required.is_empty()));
    empty.map(|(name, _)| format!("#/components/schemas/{name}")).collect()
}

/// No body is `{}`: where every field may be absent, so may the body.
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

/// Bounds that hold wherever a parameter of this name is.
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

/// A body that is neither text nor JSON is bytes, not a list of numbers.
fn bytes(kind: &str, content: &mut RefOr<Content>) {
    let RefOr::T(content) = content else { return };
    if kind == "application/octet-stream" || kind.starts_with("image/png") {
        let binary = Object::builder()
            .schema_type(SchemaType::Type(Type::String))
            .format(Some(SchemaFormat::KnownFormat(KnownFormat::Binary)));
        content.schema = Some(RefOr::T(binary.build().into()));
    }
}

/// Whole numbers from 0 on go to 2^64 - 1; `int64` would say 2^63 - 1.
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
