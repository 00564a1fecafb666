//! Browsers: a page that somebody visits must not command a server on their machine, or read it.
//!
//! | a page's way | what stands in it |
//! |---|---|
//! | its name is made to mean our address (DNS rebinding) | `Host` must be a name we are called by: 421 |
//! | it sends a request though it may not read the answer | `Origin` must be our own or allowed, and so must what `Sec-Fetch-Site` says: 403 |
//! | it sends a form or plain text, for which browsers ask nobody | a page's body must be of a declared type: 415 |
//! | it shows ours in a frame, or as a script or picture of its own | headers of every answer |
//!
//! Who is no browser says none of this and notices nothing of it but the first.

use std::net::IpAddr;

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};

use crate::serve::problem::{Answer, Problem};

/// Which names we are called by, and whose pages may ask.
pub struct Callers {
    /// Names, lower case; `*` is any.
    hosts: Vec<String>,
    /// The address we listen at.
    address: IpAddr,
    /// As browsers write them.
    origins: Vec<String>,
}

/// Whether a page asks.
#[derive(Clone, Copy)]
pub struct FromPage(pub bool);

impl Callers {
    /// Of a server that listens at an address.
    pub fn new(address: IpAddr, hosts: &[String], origins: &[String]) -> Callers {
        let lower = |all: &[String]| all.iter().map(|h| h.to_ascii_lowercase()).collect();
        Callers { hosts: lower(hosts), address, origins: lower(origins) }
    }

    /// Errors unless a request is for us and, if a page sends it, from one that may; whether a page sends it.
    pub fn admit(&self, request: &Request) -> Answer<FromPage> {
        let headers = request.headers();
        let host = host(headers, request.uri());
        if let Some(host) = host
            && !self.calls_us(host)
        {
            return Err(Problem::misdirected(host));
        }
        let origin = text(headers, header::ORIGIN);
        let site = text(headers, HeaderName::from_static("sec-fetch-site"));
        let allowed = origin.is_some_and(|o| self.allows(o) || is_own(o, host));
        match (origin, site) {
            (Some(origin), _) if !allowed => Err(Problem::foreign_page("Origin", origin)),
            (None, Some(site @ ("cross-site" | "same-site"))) if !visits(request) => {
                Err(Problem::foreign_page("Sec-Fetch-Site", site))
            }
            _ => Ok(FromPage(origin.is_some() || site.is_some())),
        }
    }

    /// The answer to a browser that asks whether a page may ask, if this is what is asked.
    pub fn preflight(&self, request: &Request) -> Option<Response> {
        let headers = request.headers();
        let asks =
            request.method() == Method::OPTIONS && headers.contains_key("access-control-request-method");
        let origin = text(headers, header::ORIGIN).filter(|_| asks)?;
        if !self.allows(origin) {
            return None;
        }
        let told = [
            (header::ACCESS_CONTROL_ALLOW_METHODS, "GET, POST, PUT, DELETE"),
            (header::ACCESS_CONTROL_ALLOW_HEADERS, TAKEN),
            (header::ACCESS_CONTROL_MAX_AGE, "600"),
        ];
        Some((StatusCode::NO_CONTENT, told).into_response())
    }

    /// What every answer tells browsers; `policy` is what they may do with this one.
    pub fn cover(&self, origin: Option<&str>, policy: &'static str, response: &mut Response) {
        let headers = response.headers_mut();
        let mut put = |name: &'static str, value: &'static str| {
            headers.insert(HeaderName::from_static(name), HeaderValue::from_static(value));
        };
        put("x-content-type-options", "nosniff");
        put("x-frame-options", "DENY");
        put("referrer-policy", "no-referrer");
        put("content-security-policy", policy);
        let allowed = origin.filter(|o| self.allows(o)).and_then(|o| HeaderValue::from_str(o).ok());
        put("cross-origin-resource-policy", if allowed.is_some() { "cross-origin" } else { "same-origin" });
        if let Some(origin) = allowed {
            headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, origin);
            headers.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, HeaderValue::from_static(SHOWN));
        }
        if !self.origins.is_empty() {
            headers.append(header::VARY, HeaderValue::from_static("Origin"));
        }
    }

    /// Whether a `Host` is one of ours, whatever its port: ports are mapped on the way.
    fn calls_us(&self, host: &str) -> bool {
        let name = without_port(host).trim_end_matches('.').to_ascii_lowercase();
        if self.hosts.iter().any(|h| *h == "*" || *h == name) {
            return true;
        }
        match name.trim_matches(['[', ']']).parse::<IpAddr>() {
            // No page has an address as its name unless it comes from there.
            Ok(ip) => self.address.is_unspecified() || ip == self.address || ip.is_loopback(),
            Err(_) => name == "localhost",
        }
    }

    fn allows(&self, origin: &str) -> bool {
        self.origins.iter().any(|o| o.eq_ignore_ascii_case(origin))
    }
}

/// Headers that a page may send.
const TAKEN: &str = "Authorization, Content-Type, Accept, Idempotency-Key, Last-Event-ID, X-Deadline, \
    X-Request-Id, Traceparent";
/// Headers that a page may read.
const SHOWN: &str = "Location, Retry-After, Idempotent-Replayed, X-Request-Id";
/// Nothing in an answer runs or loads anything; a picture may say how it looks.
pub const OF_ANSWERS: &str = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'; sandbox";
/// The documentation is a page of ours.
pub const OF_DOCS: &str = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; \
    frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

fn text(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    // What is not text is no origin of ours.
    headers.get(name).map(|value| value.to_str().unwrap_or("?"))
}

/// Whom the request is for.
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

/// Whether an origin is the very place that was asked.
fn is_own(origin: &str, host: Option<&str>) -> bool {
    let place = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
    place.zip(host).is_some_and(|(place, host)| place.eq_ignore_ascii_case(host))
}

/// Whether somebody follows a link to a page of ours; what is not under `/v1/` does nothing.
fn visits(request: &Request) -> bool {
    let goes = text(request.headers(), HeaderName::from_static("sec-fetch-mode")) == Some("navigate");
    goes && request.method() == Method::GET && !request.uri().path().starts_with("/v1/")
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;

    fn status(callers: &Callers, method: &str, path: &str, headers: &[(&str, &str)]) -> u16 {
        let request =
            headers.iter().fold(Request::builder().method(method).uri(path), |r, (k, v)| r.header(*k, *v));
        match callers.admit(&request.body(Body::empty()).unwrap()) {
            Ok(FromPage(page)) => u16::from(page),
            Err(problem) => problem.status,
        }
    }

    #[test]
    fn only_our_own_names_are_answered() {
        let host = |address: &str, allowed: &[&str], host: &str| {
            let allowed: Vec<String> = allowed.iter().map(|h| h.to_string()).collect();
            status(
                &Callers::new(address.parse().unwrap(), &allowed, &[]),
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
    fn foreign_pages_are_refused_and_who_is_no_browser_is_not() {
        let callers = Callers::new("127.0.0.1".parse().unwrap(), &[], &["https://lab.example".into()]);
        let of = |method, path, headers: &[(&str, &str)]| {
            let host = [("host", "localhost:8080")];
            status(&callers, method, path, &[&host[..], headers].concat())
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
