//! Headers that must be unambiguous: a request whose parts two readers could read differently is refused.

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, header};

use crate::error::Error;
use crate::serve::problem::{HandlerResult, Problem};

/// Errors unless there is one `Host`, at most one `Authorization`, and no transfer coding but `chunked`.
pub fn check(request: &Request) -> HandlerResult<()> {
    let headers = request.headers();
    let hosts = count(headers, &header::HOST);
    let addressed = hosts == 1 || (hosts == 0 && request.uri().authority().is_some());
    if !addressed {
        return Err(refuse("Host", format!("given {hosts} times"), "one Host header"));
    }
    let tokens = count(headers, &header::AUTHORIZATION);
    if tokens > 1 {
        return Err(refuse(
            "Authorization",
            format!("given {tokens} times"),
            "at most one Authorization header",
        ));
    }
    let mut codings = headers.get_all(header::TRANSFER_ENCODING).iter();
    match codings.find(|coding| !coding.as_bytes().trim_ascii().eq_ignore_ascii_case(b"chunked")) {
        Some(coding) => {
            let allowed = "chunked: bodies are not compressed in transfer";
            Err(refuse("Transfer-Encoding", format!("{coding:?}"), allowed))
        }
        None => Ok(()),
    }
}

fn count(headers: &HeaderMap, name: &HeaderName) -> usize {
    headers.get_all(name).iter().count()
}

fn refuse(field: &str, value: String, allowed: &str) -> Problem {
    Problem::malformed(Error::input(field, value, allowed))
}

#[cfg(test)]
mod tests {
    use axum::body::Body;

    use super::*;

    fn status(headers: &[(&str, &str)]) -> u16 {
        let request = headers.iter().fold(Request::builder().uri("/v1/jobs"), |r, (k, v)| r.header(*k, *v));
        check(&request.body(Body::empty()).unwrap()).map_or_else(|problem| problem.status, |()| 200)
    }

    #[test]
    fn refuses_ambiguous_heads() {
        let host = ("host", "localhost");
        assert_eq!(status(&[host]), 200);
        assert_eq!(status(&[]), 400);
        assert_eq!(status(&[host, host]), 400);
        assert_eq!(status(&[host, ("authorization", "Bearer a")]), 200);
        assert_eq!(status(&[host, ("authorization", "Bearer a"), ("authorization", "Bearer b")]), 400);
        assert_eq!(status(&[host, ("transfer-encoding", "Chunked")]), 200);
        for coding in ["gzip, chunked", "identity", "chunked, chunked", ""] {
            assert_eq!(status(&[host, ("transfer-encoding", coding)]), 400, "{coding}");
        }
    }
}
