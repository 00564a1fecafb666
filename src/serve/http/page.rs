//! The web page at `/`: files of `web/dist`, built from `web/src` by `make web` and embedded in the program.
//!
//! It needs no token because it contains no data: it calls the API like any client. File names do not change between versions,
//! so browsers revalidate each time (`no-cache`) by `ETag`.

use std::sync::{Arc, LazyLock};

use axum::Router;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use ring::digest::{SHA256, digest};

use crate::serve::state::AppState;

/// A file of the page.
struct StaticFile {
    path: &'static str,
    kind: &'static str,
    bytes: &'static [u8],
}

macro_rules! files {
    ($($path:literal is $kind:literal in $name:literal),+ $(,)?) => {
        [$(StaticFile {
            path: $path,
            kind: $kind,
            bytes: include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/web/dist/", $name)),
        }),+]
    };
}

const FILES: [StaticFile; 4] = files![
    "/" is "text/html; charset=utf-8" in "index.html",
    "/assets/app.js" is "text/javascript; charset=utf-8" in "app.js",
    "/assets/app.css" is "text/css; charset=utf-8" in "app.css",
    "/assets/icon.svg" is "image/svg+xml" in "icon.svg",
];

/// `ETag` of each file: half of its SHA-256.
static ETAGS: LazyLock<[String; FILES.len()]> = LazyLock::new(|| FILES.each_ref().map(|f| tag(f.bytes)));

/// Content-Security-Policy of the page: it runs and loads only its own files, and calls only this server.
pub const PAGE_CSP: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'none'; require-trusted-types-for 'script'";

/// A route for each file.
pub fn routes() -> Router<Arc<AppState>> {
    FILES.iter().enumerate().fold(Router::new(), |router, (i, file)| {
        router.route(file.path, get(move |headers: HeaderMap| async move { answer(i, &headers) }))
    })
}

/// Whether a path belongs to the page.
pub fn contains(path: &str) -> bool {
    FILES.iter().any(|file| file.path == path)
}

fn answer(number: usize, headers: &HeaderMap) -> Response {
    let (file, tag) = (&FILES[number], &ETAGS[number]);
    let headers_for = |kind| {
        [
            (header::CONTENT_TYPE, HeaderValue::from_static(kind)),
            (header::CACHE_CONTROL, HeaderValue::from_static("no-cache")),
            (header::VARY, HeaderValue::from_static("Accept")),
        ]
    };
    if file.path == "/" && !accepts_html(headers) {
        return (headers_for("text/plain; charset=utf-8"), plain_text()).into_response();
    }
    let if_none_match = headers.get(header::IF_NONE_MATCH).and_then(|v| v.to_str().ok());
    let same = if_none_match.is_some_and(|if_none_match| {
        if_none_match.split(',').any(|k| k.trim().trim_start_matches("W/") == tag)
    });
    let mut response = match same {
        true => (StatusCode::NOT_MODIFIED, headers_for(file.kind)).into_response(),
        false => (headers_for(file.kind), file.bytes).into_response(),
    };
    if let Ok(tag) = HeaderValue::from_str(tag) {
        response.headers_mut().insert(header::ETAG, tag);
    }
    response
}

/// Browsers name `text/html`; clients that accept anything (curl) get a plain-text overview.
fn accepts_html(headers: &HeaderMap) -> bool {
    let accepted = headers.get_all(header::ACCEPT).iter().filter_map(|v| v.to_str().ok());
    accepted.flat_map(|v| v.split(',')).any(|range| {
        let (kind, more) = range.split_once(';').unwrap_or((range, ""));
        let refused = more.split(';').any(|p| matches!(p.trim(), "q=0" | "q=0.0" | "q=0.00" | "q=0.000"));
        kind.trim().eq_ignore_ascii_case("text/html") && !refused
    })
}

fn plain_text() -> String {
    format!(
        "iplw {}\n\n/              web page\n/docs/         API documentation\n\
         /openapi.json  OpenAPI document\n/v1/worlds     worlds; /v1/tasks tasks; /v1/jobs jobs\n",
        env!("CARGO_PKG_VERSION")
    )
}

fn tag(bytes: &[u8]) -> String {
    let whole = digest(&SHA256, bytes);
    let half = &whole.as_ref()[..16];
    format!("\"{}\"", half.iter().map(|b| format!("{b:02x}")).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn html_clients_get_the_page() {
        let wants = |accept: &str| {
            let value = (header::ACCEPT, HeaderValue::from_str(accept).unwrap());
            accepts_html(&[value].into_iter().collect())
        };
        assert!(wants("text/html,application/xhtml+xml,*/*;q=0.8") && wants("Text/HTML;q=0.5"));
        assert!(!wants("*/*") && !wants("application/json") && !wants("text/html;q=0, */*"));
        assert!(!accepts_html(&HeaderMap::new()));
    }

    #[test]
    fn page_contacts_no_other_host() {
        for file in FILES {
            let text = std::str::from_utf8(file.bytes).unwrap();
            let foreign = text.match_indices("://").map(|(at, _)| {
                let from = text[..at].rfind(|c: char| !c.is_ascii_alphabetic()).map_or(0, |i| i + 1);
                &text[from..text.len().min(at + 30)]
            });
            // Namespace and problem-type URIs are not requested.
            let foreign_urls: Vec<&str> =
                foreign.filter(|u| !u.contains("www.w3.org") && !u.contains("iplw.dev")).collect();
            assert!(foreign_urls.is_empty(), "{} names {foreign_urls:?}", file.path);
        }
    }
}
