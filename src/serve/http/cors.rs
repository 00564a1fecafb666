//! Protection against web pages: a page that somebody is_navigation must neither control nor read a server on their machine.
//!
//! | attack | defence |
//! |---|---|
//! | DNS rebinding | `Host` must be a name of this server, else 421 |
//! | cross-site requests (CSRF) | `Origin` must be the server's own or an allowed one, and so must `Sec-Fetch-Site`, else 403 |
//! | form posts and plain text, which need no preflight | a browser's body must have a declared media type, else 415 |
//! | framing, or inclusion as a script or image | headers of every response |
//!
//! Other clients send none of these headers and are only subject to the first.

use std::net::IpAddr;

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};

use crate::serve::problem::{HandlerResult, Problem};

/// Accepted `Host` names and allowed origins.
pub struct OriginPolicy {
    /// Names, lower case; `*` accepts any.
    hosts: Vec<String>,
    /// The address that the server listens on.
    address: IpAddr,
    /// Allowed origins, as browsers send them.
    origins: Vec<String>,
}

/// Whether a browser sent the request.
#[derive(Clone, Copy)]
pub struct FromBrowser(pub bool);

impl OriginPolicy {
    /// For a server that listens on an address.
    pub fn new(address: IpAddr, hosts: &[String], origins: &[String]) -> OriginPolicy {
        let lower = |all: &[String]| all.iter().map(|h| h.to_ascii_lowercase()).collect();
        OriginPolicy { hosts: lower(hosts), address, origins: lower(origins) }
    }

    /// Errors unless the `Host` is this server's and, for browsers, the origin is allowed; returns whether a browser sent it.
    pub fn check(&self, request: &Request) -> HandlerResult<FromBrowser> {
        let headers = request.headers();
        let host = host(headers, request.uri());
        if let Some(host) = host
            && !self.is_own_host(host)
        {
            return Err(Problem::misdirected(host));
        }
        let origin = text(headers, header::ORIGIN);
        let site = text(headers, HeaderName::from_static("sec-fetch-site"));
        let allowed = origin.is_some_and(|o| self.allows_origin(o) || is_same_origin(o, host));
        match (origin, site) {
            (Some(origin), _) if !allowed => Err(Problem::forbidden_origin("Origin", origin)),
            (None, Some(site @ ("cross-site" | "same-site"))) if !is_navigation(request) => {
                Err(Problem::forbidden_origin("Sec-Fetch-Site", site))
            }
            _ => Ok(FromBrowser(origin.is_some() || site.is_some())),
        }
    }

    /// The response to a CORS preflight request of an allowed origin.
    pub fn preflight(&self, request: &Request) -> Option<Response> {
        let headers = request.headers();
        let asks =
            request.method() == Method::OPTIONS && headers.contains_key("access-control-request-method");
        let origin = text(headers, header::ORIGIN).filter(|_| asks)?;
        if !self.allows_origin(origin) {
            return None;
        }
        let preflight_headers = [
            (header::ACCESS_CONTROL_ALLOW_METHODS, "GET, POST, PUT, PATCH, DELETE"),
            (header::ACCESS_CONTROL_ALLOW_HEADERS, ALLOWED_REQUEST_HEADERS),
            (header::ACCESS_CONTROL_MAX_AGE, "600"),
        ];
        Some((StatusCode::NO_CONTENT, preflight_headers).into_response())
    }

    /// Sets the security and CORS headers of a response; `policy` is its Content-Security-Policy.
    pub fn apply_headers(&self, origin: Option<&str>, policy: &'static str, response: &mut Response) {
        let headers = response.headers_mut();
        let mut put = |name: &'static str, value: &'static str| {
            headers.insert(HeaderName::from_static(name), HeaderValue::from_static(value));
        };
        put("x-content-type-options", "nosniff");
        put("x-frame-options", "DENY");
        put("referrer-policy", "no-referrer");
        put("content-security-policy", policy);
        let allowed = origin.filter(|o| self.allows_origin(o)).and_then(|o| HeaderValue::from_str(o).ok());
        put("cross-origin-resource-policy", if allowed.is_some() { "cross-origin" } else { "same-origin" });
        if let Some(origin) = allowed {
            headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, origin);
            headers.insert(
                header::ACCESS_CONTROL_EXPOSE_HEADERS,
                HeaderValue::from_static(EXPOSED_RESPONSE_HEADERS),
            );
        }
        if !self.origins.is_empty() {
            headers.append(header::VARY, HeaderValue::from_static("Origin"));
        }
    }

    /// Whether a `Host` names this server; the port is ignored because it may be mapped.
    fn is_own_host(&self, host: &str) -> bool {
        let name = without_port(host).trim_end_matches('.').to_ascii_lowercase();
        if self.hosts.iter().any(|h| *h == "*" || *h == name) {
            return true;
        }
        match name.trim_matches(['[', ']']).parse::<IpAddr>() {
            // A literal address cannot be rebound by DNS.
            Ok(ip) => self.address.is_unspecified() || ip == self.address || ip.is_loopback(),
            Err(_) => name == "localhost",
        }
    }

    fn allows_origin(&self, origin: &str) -> bool {
        self.origins.iter().any(|o| o.eq_ignore_ascii_case(origin))
    }
}

/// `Access-Control-Allow-Headers`.
const ALLOWED_REQUEST_HEADERS: &str = "Authorization, Content-Type, Accept, Idempotency-Key, Last-Event-ID, X-Deadline, \
    X-Request-Id, Traceparent";
/// `Access-Control-Expose-Headers`.
const EXPOSED_RESPONSE_HEADERS: &str = "Location, Retry-After, Idempotent-Replayed, X-Request-Id";
/// Content-Security-Policy of API responses: nothing runs or loads; SVG may have inline styles.
pub const API_CSP: &str = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'; sandbox";
/// Content-Security-Policy of the API documentation.
pub const DOCS_CSP: &str = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; \
    frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

fn text(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    // A value that is not text matches no origin.
    headers.get(name).map(|value| value.to_str().unwrap_or("?"))
}

/// The authority that the request addresses.
fn host<'a>(headers: &'a HeaderMap, uri: &'a Uri) -> Option<&'a str> {
    uri.authority().map(|a| a.as_str()).or_else(|| text(headers, header::HOST))
}

fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if !name.ends_with(':') && port.bytes().all(|b| b.is_ascii_digit()) => {
            if name.contains(':') && !name.ends_with(']') { host } else { name }
        }
        _ => host,
    }
}

/// Whether an origin is the server itself.
fn is_same_origin(origin: &str, host: Option<&str>) -> bool {
    let place = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
    place.zip(host).is_some_and(|(place, host)| place.eq_ignore_ascii_case(host))
}

/// Whether it is a navigation to a page of the server; paths outside `/v1/` have no side effects.
fn is_navigation(request: &Request) -> bool {
    let goes = text(request.headers(), HeaderName::from_static("sec-fetch-mode")) == Some("navigate");
    goes && request.method() == Method::GET && !request.uri().path().starts_with("/v1/")
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;

    fn status(origins: &OriginPolicy, method: &str, path: &str, headers: &[(&str, &str)]) -> u16 {
        let request =
            headers.iter().fold(Request::builder().method(method).uri(path), |r, (k, v)| r.header(*k, *v));
        match origins.check(&request.body(Body::empty()).unwrap()) {
            Ok(FromBrowser(page)) => u16::from(page),
            Err(problem) => problem.status,
        }
    }

    #[test]
    fn checks_host() {
        let host = |address: &str, allowed: &[&str], host: &str| {
            let allowed: Vec<String> = allowed.iter().map(|h| h.to_string()).collect();
            status(
                &OriginPolicy::new(address.parse().unwrap(), &allowed, &[]),
                "GET",
                "/v1/jobs",
                &[("host", host)],
            )
        };
        for ours in ["localhost", "LOCALHOST:8080", "localhost.", "127.0.0.1:80", "[::1]:8080", "[::1]"] {
            assert_eq!(host("127.0.0.1", &[], ours), 0, "{ours}");
        }
        for foreign in
            ["evil.example", "evil.example:8080", "localhost.evil.example", "10.0.0.1", "", "?", "a:b:c"]
        {
            assert_eq!(host("127.0.0.1", &[], foreign), 421, "{foreign}");
        }
        assert_eq!(host("0.0.0.0", &[], "10.0.0.1:8080"), 0);
        assert_eq!(host("10.0.0.1", &[], "10.0.0.1"), 0);
        assert_eq!(host("10.0.0.1", &[], "10.0.0.2"), 421);
        assert_eq!(host("0.0.0.0", &[], "rig.lab"), 421);
        assert_eq!(host("0.0.0.0", &["Rig.lab"], "rig.LAB:99"), 0);
        assert_eq!(host("0.0.0.0", &["*"], "anything"), 0);
    }

    #[test]
    fn rejects_foreign_origins_only() {
        let origins = OriginPolicy::new("127.0.0.1".parse().unwrap(), &[], &["https://lab.example".into()]);
        let of = |method, path, headers: &[(&str, &str)]| {
            let host = [("host", "localhost:8080")];
            status(&origins, method, path, &[&host[..], headers].concat())
        };
        assert_eq!(of("POST", "/v1/iplw", &[]), 0);
        assert_eq!(of("POST", "/v1/iplw", &[("origin", "http://localhost:8080")]), 1);
        assert_eq!(
            of("POST", "/v1/iplw", &[("origin", "https://lab.example"), ("sec-fetch-site", "cross-site")]),
            1
        );
        for origin in ["http://localhost", "http://localhost:9", "null", "https://evil.example", "\u{e9}"] {
            assert_eq!(of("GET", "/v1/jobs", &[("origin", origin)]), 403, "{origin}");
        }
        for site in ["cross-site", "same-site"] {
            assert_eq!(of("GET", "/v1/jobs", &[("sec-fetch-site", site)]), 403, "{site}");
        }
        assert_eq!(of("GET", "/v1/jobs", &[("sec-fetch-site", "same-origin")]), 1);
        let link = [("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate")];
        assert_eq!((of("GET", "/docs/", &link), of("GET", "/v1/jobs", &link)), (1, 403));
        assert_eq!(of("POST", "/docs/", &link), 403);
    }
}
