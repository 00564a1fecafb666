//! Errors on the wire: RFC 9457 problem details, and the only place that knows status codes.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::access::Unknown;
use crate::error::{Error, shown};

/// What went wrong (`application/problem+json`, RFC 9457).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// Names the kind of problem; the last part is fixed, the text elsewhere may change.
    #[serde(rename = "type")]
    #[schema(example = "https://iplw.dev/problems/invalid-value")]
    pub kind: String,
    pub title: String,
    pub status: u16,
    /// What went wrong this time, and what to do.
    pub detail: String,
    /// The field concerned.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub field: Option<String>,
    /// The value it had.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<String>,
    /// What it may be.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub allowed: Option<String>,
}

/// Answers of handlers.
pub type Answer<T> = std::result::Result<T, Problem>;

/// Media type of every error.
pub const PROBLEM: &str = "application/problem+json";

/// The same for clients that accept msgpack.
pub const PROBLEM_MSGPACK: &str = "application/problem+msgpack";

const BASE: &str = "https://iplw.dev/problems/";

impl Problem {
    /// A problem without a field.
    pub fn new(status: StatusCode, slug: &str, title: &str, detail: impl Into<String>) -> Problem {
        Problem {
            kind: format!("{BASE}{slug}"),
            title: title.into(),
            status: status.as_u16(),
            detail: detail.into(),
            field: None,
            value: None,
            allowed: None,
        }
    }

    /// A request that could not be read: not JSON, an unknown field, a wrong type. One that holds too much is told so.
    pub fn malformed(error: Error) -> Problem {
        let too_much = matches!(error, Error::TooLarge { .. });
        let problem = Problem::from(error);
        if too_much {
            return problem;
        }
        Problem {
            kind: format!("{BASE}malformed"),
            title: "The request cannot be read".into(),
            status: StatusCode::BAD_REQUEST.as_u16(),
            ..problem
        }
    }

    /// A body above the limit.
    pub fn body_too_large(limit: usize) -> Problem {
        Problem::too_large(format!("body: at most {limit} bytes at a time; send it in parts"))
    }

    /// A body that takes too long to come.
    pub fn slow(seconds: f64) -> Problem {
        let detail = format!("body: not there within {seconds} s; send it faster, or in parts");
        Problem::new(StatusCode::REQUEST_TIMEOUT, "slow", "The body takes too long", detail)
    }

    /// More than is taken at a time.
    pub fn too_large(detail: String) -> Problem {
        Problem::new(StatusCode::PAYLOAD_TOO_LARGE, "too-large", "Too much at a time", detail)
    }

    /// More requests at a time than are taken.
    pub fn busy(limit: usize) -> Problem {
        let detail = format!("{limit} requests are being worked on; try again in a second");
        Problem::new(StatusCode::TOO_MANY_REQUESTS, "busy", "Too many requests at a time", detail)
    }

    /// A request whose key is being worked on.
    pub fn under_way(key: &str) -> Problem {
        let detail =
            format!("a request with Idempotency-Key {key:?} is being worked on; ask again in a second");
        Problem::new(StatusCode::CONFLICT, "under-way", "The same request is under way", detail)
    }

    /// A request that its sender took back.
    pub fn cancelled() -> Problem {
        Problem::from(Error::Cancelled)
    }

    /// A defect of this program.
    pub fn defect() -> Problem {
        let detail = "the program has a defect; the request had no further effect";
        Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "defect", "Internal error", detail)
    }

    /// An answer that cannot be written: a defect too.
    pub fn unwritable(e: impl std::fmt::Display) -> Problem {
        tracing::error!("an answer cannot be written: {e}");
        Problem::defect()
    }

    /// Nobody is known by what was presented.
    pub fn unauthorized(why: Unknown) -> Problem {
        let detail = match why {
            Unknown::Missing => {
                "this server asks for a token: `Authorization: Bearer TOKEN`, or as the password of ZeroMQ's PLAIN"
            }
            Unknown::Wrong => {
                "the token is not one of this server's, or no longer; ask whoever runs it for one"
            }
            Unknown::Expired => "the token has expired; ask whoever runs the server for another",
        };
        Problem::new(StatusCode::UNAUTHORIZED, "unauthorized", "Not known", detail)
    }

    /// A request for somebody else, as its `Host` says.
    pub fn misdirected(host: &str) -> Problem {
        let detail = "this server is not called so; `iplw serve --allow-host NAME` lets it be";
        let problem =
            Problem::new(StatusCode::MISDIRECTED_REQUEST, "misdirected", "Not for this server", detail);
        let allowed = "localhost, an address this server listens at, or a name of --allow-host";
        Problem {
            field: Some("Host".into()),
            value: Some(host.into()),
            allowed: Some(allowed.into()),
            ..problem
        }
    }

    /// A request that a page sends which may not; `said` where it says so.
    pub fn foreign_page(said: &str, value: &str) -> Problem {
        let detail =
            "a page from elsewhere may not ask this server; `iplw serve --allow-origin ORIGIN` lets it";
        let problem = Problem::new(StatusCode::FORBIDDEN, "foreign-page", "Not from this page", detail);
        let allowed = "absent, the server's own, or one of --allow-origin";
        Problem {
            field: Some(said.into()),
            value: Some(value.into()),
            allowed: Some(allowed.into()),
            ..problem
        }
    }

    /// A page's body of a type that the operation does not declare.
    pub fn media_type(kind: &str, declared: &[String]) -> Problem {
        let detail = "a page has to say of what type its body is, as the operation declares it";
        let title = "Not a type that is taken";
        let problem = Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "media-type", title, detail);
        let (value, allowed) = (Some(format!("{kind:?}")), Some(declared.join(", ")));
        Problem { field: Some("Content-Type".into()), value, allowed, ..problem }
    }

    /// A path that leads nowhere.
    pub fn no_route(path: &str) -> Problem {
        let detail = format!("nothing is at {path}; /openapi.json lists what there is");
        Problem::new(StatusCode::NOT_FOUND, "not-found", "Not found", detail)
    }

    /// A method that the path does not take.
    pub fn no_method(method: &str, path: &str) -> Problem {
        let detail = format!("{path} does not take {method}; the Allow header lists what it takes");
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
                value: Some(shown(&id)),
                ..problem(StatusCode::NOT_FOUND, "not-found", "Not found")
            },
            Error::Refused { .. } => problem(StatusCode::CONFLICT, "refused", "Not in this state"),
            Error::Sealed { .. } => problem(StatusCode::FORBIDDEN, "sealed", "The world is sealed"),
            Error::TooLarge { .. } => {
                problem(StatusCode::PAYLOAD_TOO_LARGE, "too-large", "Too much at a time")
            }
            Error::Budget { .. } => {
                problem(StatusCode::TOO_MANY_REQUESTS, "budget-spent", "The budget is spent")
            }
            Error::Capacity { .. } => problem(StatusCode::TOO_MANY_REQUESTS, "capacity", "No room for more"),
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
            Error::Entry { field, error } => Problem { field: Some(field), detail, ..Problem::from(*error) },
        }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let body = serde_json::to_vec(&self).unwrap_or_default();
        let kind = HeaderValue::from_static(PROBLEM);
        let mut response = (status, [(header::CONTENT_TYPE, kind)], body).into_response();
        if status == StatusCode::TOO_MANY_REQUESTS && self.kind.ends_with("/busy") {
            response.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from_static("1"));
        }
        if status == StatusCode::UNAUTHORIZED {
            let how = HeaderValue::from_static("Bearer realm=\"iplw\"");
            response.headers_mut().insert(header::WWW_AUTHENTICATE, how);
        }
        // For whoever wants it in another form.
        response.extensions_mut().insert(self);
        response
    }
}

/// What a failed job's owner is told: the same problem, as JSON.
pub fn explain(error: &Error) -> serde_json::Value {
    serde_json::to_value(Problem::from(error.clone())).unwrap_or_default()
}
