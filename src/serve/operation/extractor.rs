//! Extractors: the input of a handler. Several are a tuple, in the order in which the document lists them.

use serde::de::DeserializeOwned;
use serde_json::Value;
use utoipa::ToSchema;

use super::describe::OperationDoc;
use super::pagination::Pagination;
use super::request::OperationRequest;
use crate::serve::problem::HandlerResult;

/// Extracts a handler's input from a request.
pub trait Extractor: Sized + Send + 'static {
    /// Adds it to the OpenAPI document.
    fn describe(to: &mut OperationDoc);
    /// Extracts it.
    fn extract(from: &mut OperationRequest) -> HandlerResult<Self>;
}

/// The `{id}` of the path.
pub struct PathId(pub String);

/// A JSON object as the body.
pub struct JsonBody<T>(pub T);

/// A JSON object as the body, and the JSON itself to be stored.
pub struct BodyWithJson<T>(pub T, pub Value);

/// A binary body.
pub struct RawBody(pub Vec<u8>);

/// Number of the last event received; 0 if none was.
pub struct LastEventId(pub u64);

/// Whether the client wants arrays in binary form.
pub struct AcceptsBinaryArrays(pub bool);

impl Extractor for PathId {
    fn describe(to: &mut OperationDoc) {
        to.path("id", None);
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<PathId> {
        from.path_parameter("id").map(PathId)
    }
}

impl<T: DeserializeOwned + ToSchema + Send + 'static> Extractor for JsonBody<T> {
    fn describe(to: &mut OperationDoc) {
        to.body::<T>();
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<JsonBody<T>> {
        from.body().map(JsonBody)
    }
}

impl<T: DeserializeOwned + ToSchema + Send + 'static> Extractor for BodyWithJson<T> {
    fn describe(to: &mut OperationDoc) {
        to.body::<T>();
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<BodyWithJson<T>> {
        from.body_with_json().map(|(body, json)| BodyWithJson(body, json))
    }
}

impl Extractor for RawBody {
    fn describe(to: &mut OperationDoc) {
        to.body_of_media("application/octet-stream");
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<RawBody> {
        from.binary_body("the weights as safetensors").map(RawBody)
    }
}

impl Extractor for LastEventId {
    fn describe(to: &mut OperationDoc) {
        to.header::<u64>("Last-Event-ID", "Number of the last event received");
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<LastEventId> {
        from.last_event().map(LastEventId)
    }
}

impl Extractor for AcceptsBinaryArrays {
    fn describe(_: &mut OperationDoc) {}

    fn extract(from: &mut OperationRequest) -> HandlerResult<AcceptsBinaryArrays> {
        Ok(AcceptsBinaryArrays(from.raw))
    }
}

impl Extractor for Pagination {
    fn describe(to: &mut OperationDoc) {
        to.query::<u32>("limit", "Maximum number of items, 1 to 1000; default 100");
        to.query::<String>("cursor", "`next` of the previous page");
        to.problem(422, "");
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<Pagination> {
        Ok(Pagination::from_query(&from.query()?)?)
    }
}

impl Extractor for () {
    fn describe(_: &mut OperationDoc) {}

    fn extract(_: &mut OperationRequest) -> HandlerResult<()> {
        Ok(())
    }
}

impl<A: Extractor, B: Extractor> Extractor for (A, B) {
    fn describe(to: &mut OperationDoc) {
        A::describe(to);
        B::describe(to);
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<(A, B)> {
        Ok((A::extract(from)?, B::extract(from)?))
    }
}

impl<A: Extractor, B: Extractor, C: Extractor> Extractor for (A, B, C) {
    fn describe(to: &mut OperationDoc) {
        A::describe(to);
        B::describe(to);
        C::describe(to);
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<(A, B, C)> {
        Ok((A::extract(from)?, B::extract(from)?, C::extract(from)?))
    }
}
