//! Declaration of API operations: once, next to the handler, for every transport.
//!
//! | module | contents |
//! |---|---|
//! | `declare` | the declaration: name, method, path, input, responses, handler |
//! | `describe` | its part of the OpenAPI document |
//! | `request` | a request, independent of the transport |
//! | `extractor` | handler inputs: path id, JSON body, page, bytes |
//! | `response` | handler outputs |
//! | `idempotency` | idempotent requests |
//! | `events` | event streams |
//! | `pagination` | pages of lists |

mod declare;
mod describe;
mod events;
mod examples;
mod extractor;
mod idempotency;
mod pagination;
mod request;
mod response;

pub use declare::{ACT, ADMIN, Operation, PUBLIC, READ, delete, get, location, patch, post, put};
pub use describe::{OperationDoc, ResponseLink, SECURITY_SCHEME};
pub use events::{EventStream, NextEvent, ServerEvent};
pub use extractor::{AcceptsBinaryArrays, BodyWithJson, Extractor, JsonBody, LastEventId, PathId, RawBody};
pub use idempotency::{IdempotencyKey, RecordResponse};
pub use pagination::Pagination;
pub use request::{HttpRequestParts, OperationRequest};
pub use response::{HandlerOutput, MediaBody, OperationResponse, Payload, SerializableValue};
