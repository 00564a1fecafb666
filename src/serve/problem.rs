//! Errors on the wire: RFC 9457 problem details. Status codes of errors are assigned only here.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::access::AuthError;
use crate::error::{Error, abbreviate};

/// An error response (`application/problem+json`, RFC 9457).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// URI of the problem type; its last part is stable.
    #[serde(rename = "type")]
    #[schema(example = "https://iplw.dev/problems/invalid-value")]
    pub kind: String,
    pub title: String,
    pub status: u16,
    /// Description of the error in this request, and what to do.
    pub detail: String,
    /// The invalid field.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub field: Option<String>,
    /// The field's value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<String>,
    /// Allowed values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub allowed: Option<String>,
}

/// Result of a handler.
pub type HandlerResult<T> = std::result::Result<T, Problem>;

/// Media type of errors.
pub const PROBLEM_JSON: &str = "application/problem+json";

/// Media type of errors for clients that accept msgpack.
pub const PROBLEM_MSGPACK: &str = "application/problem+msgpack";

const PROBLEM_TYPE_BASE: &str = "https://iplw.dev/problems/";

impl Problem {
    /// A problem without a field.
    pub fn new(status: StatusCode, slug: &str, title: &str, detail: impl Into<String>) -> Problem {
        Problem {
            kind: format!("{PROBLEM_TYPE_BASE}{slug}"),
            title: title.into(),
            status: status.as_u16(),
            detail: detail.into(),
            field: None,
            value: None,
            allowed: None,
        }
    }

    /// A request that cannot be parsed: invalid JSON, an unknown field, a wrong type. Oversized ones stay 413.
    pub fn malformed(error: Error) -> Problem {
        let is_too_large = matches!(error, Error::TooLarge { .. });
        let problem = Problem::from(error);
        if is_too_large {
            return problem;
        }
        Problem {
            kind: format!("{PROBLEM_TYPE_BASE}malformed"),
            title: "The request cannot be read".into(),
            status: StatusCode::BAD_REQUEST.as_u16(),
            ..problem
        }
    }

    /// A body above the limit.
    pub fn body_too_large(limit: usize) -> Problem {
        Problem::too_large(format!("body: at most {limit} bytes are allowed; split the request"))
    }

    /// A body that arrives too slowly.
    pub fn body_timeout(seconds: f64) -> Problem {
        let detail = format!("body: did not arrive within {seconds} s; send it faster or split the request");
        Problem::new(StatusCode::REQUEST_TIMEOUT, "slow", "The body arrived too slowly", detail)
    }

    /// A request above a limit.
    pub fn too_large(detail: String) -> Problem {
        Problem::new(StatusCode::PAYLOAD_TOO_LARGE, "too-large", "The request is too large", detail)
    }

    /// Too many concurrent requests.
    pub fn busy(limit: usize) -> Problem {
        let detail = format!("{limit} requests are in progress; try again in a second");
        Problem::new(StatusCode::TOO_MANY_REQUESTS, "busy", "Too many concurrent requests", detail)
    }

    /// The client, or all together, have too many bytes in unanswered requests.
    pub fn too_many_body_bytes() -> Problem {
        let detail = String::from(
            "the bodies of the requests in progress are too large together; try again in a second",
        );
        Problem::new(StatusCode::TOO_MANY_REQUESTS, "busy", "Too many bytes in requests", detail)
    }

    /// Too many connections of a client.
    pub fn too_many_connections(limit: usize) -> Problem {
        let detail =
            format!("this token has {limit} busy connections; reuse one of them, or try again in a second");
        Problem::new(StatusCode::TOO_MANY_REQUESTS, "busy", "Too many connections", detail)
    }

    /// A request whose idempotency key is in use.
    pub fn request_in_progress(key: &str) -> Problem {
        let detail = format!("a request with Idempotency-Key {key:?} is in progress; try again in a second");
        Problem::new(StatusCode::CONFLICT, "under-way", "The same request is in progress", detail)
    }

    /// A request that the client cancelled.
    pub fn cancelled() -> Problem {
        Problem::from(Error::Cancelled)
    }

    /// A bug in this program.
    pub fn internal() -> Problem {
        let detail = "the server failed unexpectedly (a bug); the request had no further effect";
        Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "defect", "Internal error", detail)
    }

    /// A response that cannot be serialised: a bug.
    pub fn serialization(e: impl std::fmt::Display) -> Problem {
        tracing::error!("a response cannot be serialised: {e}");
        Problem::internal()
    }

    /// Authentication failed.
    pub fn unauthorized(why: AuthError) -> Problem {
        let detail = match why {
            AuthError::Missing => {
                "this server requires a token: send `Authorization: Bearer TOKEN`, or use it as the password of ZeroMQ's PLAIN"
            }
            AuthError::Wrong => {
                "the token is unknown or was revoked; ask the server's administrator for a new one"
            }
            AuthError::Expired => "the token has expired; ask the server's administrator for a new one",
        };
        Problem::new(StatusCode::UNAUTHORIZED, "unauthorized", "Authentication failed", detail)
    }

    /// A request whose `Host` names another server.
    pub fn misdirected(host: &str) -> Problem {
        let detail = "this server does not have that name; `iplw serve --allow-host NAME` adds it";
        let problem = Problem::new(StatusCode::MISDIRECTED_REQUEST, "misdirected", "Wrong host", detail);
        let allowed = "localhost, an address that the server listens on, or a name given by --allow-host";
        Problem {
            field: Some("Host".into()),
            value: Some(host.into()),
            allowed: Some(allowed.into()),
            ..problem
        }
    }

    /// A browser request from an origin that is not allowed; `header` shows the origin.
    pub fn forbidden_origin(header: &str, value: &str) -> Problem {
        let detail =
            "pages of this origin may not call this server; `iplw serve --allow-origin ORIGIN` allows it";
        let problem = Problem::new(StatusCode::FORBIDDEN, "foreign-page", "Origin not allowed", detail);
        let allowed = "absent, the server's own origin, or one given by --allow-origin";
        Problem {
            field: Some(header.into()),
            value: Some(value.into()),
            allowed: Some(allowed.into()),
            ..problem
        }
    }

    /// A browser's request body of a media type that the operation does not declare.
    pub fn media_type(kind: &str, declared: &[String]) -> Problem {
        let detail = "a browser must send the body with a media type that the operation declares";
        let title = "Unsupported media type";
        let problem = Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "media-type", title, detail);
        let (value, allowed) = (Some(format!("{kind:?}")), Some(declared.join(", ")));
        Problem { field: Some("Content-Type".into()), value, allowed, ..problem }
    }

    /// An unknown path.
    pub fn no_route(path: &str) -> Problem {
        let detail = format!("there is no resource at {path}; /openapi.json lists all paths");
        Problem::new(StatusCode::NOT_FOUND, "not-found", "Not found", detail)
    }

    /// A method that the path does not support.
    pub fn no_method(method: &str, path: &str) -> Problem {
        let detail = format!("{path} does not support {method}; the Allow header lists its methods");
        Problem::new(StatusCode::METHOD_NOT_ALLOWED, "method-not-allowed", "Method not allowed", detail)
    }
}

impl From<Error> for Problem {
    fn from(error: Error) -> Problem {
        let detail = error.to_string();
        let problem = |status, slug, title| Problem::new(status, slug, title, detail.clone());
        match error {
            Error::Input(input) => {
                let some = |text: String| Some(text).filter(|t| !t.is_empty());
                Problem {
                    field: some(input.field),
                    value: some(input.value),
                    allowed: some(input.allowed),
                    ..problem(StatusCode::UNPROCESSABLE_ENTITY, "invalid-value", "A value is not allowed")
                }
            }
            Error::NotFound { id, .. } => Problem {
                value: Some(abbreviate(&id)),
                ..problem(StatusCode::NOT_FOUND, "not-found", "Not found")
            },
            Error::Refused { .. } => {
                problem(StatusCode::CONFLICT, "refused", "Conflict with the current state")
            }
            Error::Sealed { .. } => problem(StatusCode::FORBIDDEN, "sealed", "The world is sealed"),
            Error::TooLarge { .. } => {
                problem(StatusCode::PAYLOAD_TOO_LARGE, "too-large", "The request is too large")
            }
            Error::Budget { .. } => {
                problem(StatusCode::TOO_MANY_REQUESTS, "budget-spent", "The budget is spent")
            }
            Error::Capacity { .. } => problem(StatusCode::TOO_MANY_REQUESTS, "capacity", "Capacity reached"),
            Error::Denied { .. } => problem(StatusCode::FORBIDDEN, "forbidden", "Not allowed"),
            Error::Cancelled => problem(StatusCode::CONFLICT, "cancelled", "Cancelled"),
            Error::Deadline { .. } => {
                problem(StatusCode::SERVICE_UNAVAILABLE, "deadline", "The deadline has passed")
            }
            Error::Interrupted { .. } => {
                problem(StatusCode::SERVICE_UNAVAILABLE, "interrupted", "The server stopped")
            }
            Error::Failed(_) => {
                problem(StatusCode::UNPROCESSABLE_ENTITY, "no-result", "The computation has no result")
            }
            Error::Io { .. } => problem(StatusCode::SERVICE_UNAVAILABLE, "storage", "Storage failed"),
            Error::Damaged { what, .. } => Problem {
                value: Some(what),
                ..problem(StatusCode::SERVICE_UNAVAILABLE, "damaged", "A stored record is damaged")
            },
            Error::Entry { field, error } => Problem { field: Some(field), detail, ..Problem::from(*error) },
        }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let body = serde_json::to_vec(&self).unwrap_or_default();
        let kind = HeaderValue::from_static(PROBLEM_JSON);
        let mut response = (status, [(header::CONTENT_TYPE, kind)], body).into_response();
        if status == StatusCode::TOO_MANY_REQUESTS && self.kind.ends_with("/busy") {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from_static("1"));
        }
        if status == StatusCode::UNAUTHORIZED {
            let how = HeaderValue::from_static("Bearer realm=\"iplw\"");
            response.headers_mut().insert(header::WWW_AUTHENTICATE, how);
        }
        // The middleware may reformat it.
        response.extensions_mut().insert(self);
        response
    }
}

/// The error of a failed job, as a problem in JSON.
pub fn explain(error: &Error) -> serde_json::Value {
    serde_json::to_value(Problem::from(error.clone())).unwrap_or_default()
}
