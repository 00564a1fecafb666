//! Handler outputs: a serialisable value, nothing, a value with a status, or bytes of a media type.

use std::io::Write;

use serde::Serialize;
use utoipa::ToSchema;

use super::describe::OperationDoc;
use super::events::EventStream;
use crate::serve::wire::{Array, BinaryArrays, msgpack};

/// A response, independent of the transport.
pub struct OperationResponse {
    /// HTTP status.
    pub status: u16,
    /// `Location` of the created resource.
    pub location: Option<String>,
    /// Whether it replays the response to an earlier request with the same key.
    pub replayed: bool,
    pub content: Payload,
}

/// Body of a response.
pub enum Payload {
    Nothing,
    Value(Box<dyn SerializableValue>),
    /// A value that is JSON already.
    Json(Vec<u8>),
    MediaBody(MediaBody),
    /// An event stream.
    EventStream(Box<dyn EventStream>),
}

/// Bytes or text with a media type.
pub struct MediaBody {
    pub kind: &'static str,
    pub bytes: Vec<u8>,
}

/// A serialisable value of any type.
pub trait SerializableValue: Send {
    /// Moves its large arrays out, by field name.
    fn take_arrays(&mut self) -> Vec<(&'static str, Array)>;
    /// As JSON.
    fn to_json(&self) -> serde_json::Result<Vec<u8>>;
    /// As msgpack.
    fn to_msgpack(&self) -> Result<Vec<u8>, msgpack::EncodeError>;
    /// Writes JSON incrementally.
    fn write_json(&self, out: &mut dyn Write) -> serde_json::Result<()>;
}

impl<T: BinaryArrays + Serialize + Send> SerializableValue for T {
    fn take_arrays(&mut self) -> Vec<(&'static str, Array)> {
        BinaryArrays::take_arrays(self)
    }

    fn to_json(&self) -> serde_json::Result<Vec<u8>> {
        serde_json::to_vec(self)
    }

    fn to_msgpack(&self) -> Result<Vec<u8>, msgpack::EncodeError> {
        msgpack::packed(self)
    }

    fn write_json(&self, out: &mut dyn Write) -> serde_json::Result<()> {
        serde_json::to_writer(out, self)
    }
}

/// Output of a handler.
pub trait HandlerOutput {
    /// Adds the response to the OpenAPI document; empty for types that the declaration describes.
    fn describe(to: &mut OperationDoc);
    /// Converts to a response.
    fn into_response(self) -> OperationResponse;
}

impl OperationResponse {
    /// Status 200.
    pub fn ok(content: Payload) -> OperationResponse {
        OperationResponse { status: 200, location: None, replayed: false, content }
    }
}

/// A value: 200.
impl<T: BinaryArrays + Serialize + ToSchema + Send + 'static> HandlerOutput for T {
    fn describe(to: &mut OperationDoc) {
        to.json::<T>(200, "");
    }

    fn into_response(self) -> OperationResponse {
        OperationResponse::ok(Payload::Value(Box::new(self)))
    }
}

/// No content: 204.
impl HandlerOutput for () {
    fn describe(to: &mut OperationDoc) {
        to.empty(204, "Deleted");
    }

    fn into_response(self) -> OperationResponse {
        OperationResponse { status: 204, ..OperationResponse::ok(Payload::Nothing) }
    }
}

/// A value with a status, which the declaration describes.
impl<T: BinaryArrays + Serialize + Send + 'static> HandlerOutput for (u16, T) {
    fn describe(_: &mut OperationDoc) {}

    fn into_response(self) -> OperationResponse {
        OperationResponse { status: self.0, ..OperationResponse::ok(Payload::Value(Box::new(self.1))) }
    }
}

/// The declaration lists the media types.
impl HandlerOutput for MediaBody {
    fn describe(_: &mut OperationDoc) {}

    fn into_response(self) -> OperationResponse {
        OperationResponse::ok(Payload::MediaBody(self))
    }
}

/// Any response; the declaration describes it.
impl HandlerOutput for OperationResponse {
    fn describe(_: &mut OperationDoc) {}

    fn into_response(self) -> OperationResponse {
        self
    }
}
