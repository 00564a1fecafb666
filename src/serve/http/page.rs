//! The page for people, at `/`: files of `web/dist`, made from `web/src` by `make web` and part of the program.
//!
//! It needs no token, since it holds nothing but itself: what it shows it asks of the operations like any client. Names
//! of files stay the same from version to version, so browsers ask each time (`no-cache`) and are told by the `ETag` that
//! nothing has changed.

use std::sync::{Arc, LazyLock};

use axum::Router;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use ring::digest::{SHA256, digest};

use crate::serve::shared::Shared;

/// A file of the page.
struct File {
    path: &'static str,
    kind: &'static str,
    bytes: &'static [u8],
}

macro_rules! files {
    ($($path:literal is $kind:literal in $name:literal),+ $(,)?) => {
        [$(File {
            path: $path,
            kind: $kind,
            bytes: include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/web/dist/", $name)),
        }),+]
    };
}

const FILES: [File; 4] = files![
    "/" is "text/html; charset=utf-8" in "index.html",
    "/assets/app.js" is "text/javascript; charset=utf-8" in "app.js",
    "/assets/app.css" is "text/css; charset=utf-8" in "app.css",
    "/assets/icon.svg" is "image/svg+xml" in "icon.svg",
];

/// An `ETag` for each file: half of its SHA-256.
static TAGS: LazyLock<[String; FILES.len()]> = LazyLock::new(|| FILES.each_ref().map(|f| tag(f.bytes)));

/// What the page may do in a browser: run and load what is ours, and ask us.
pub const MAY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'none'; require-trusted-types-for 'script'";

/// A route for each file.
pub fn routes() -> Router<Arc<Shared>> {
    FILES.iter().enumerate().fold(Router::new(), |router, (i, file)| {
        router.route(file.path, get(move |headers: HeaderMap| async move { answer(i, &headers) }))
    })
}

/// Whether a path is the page's.
pub fn has(path: &str) -> bool {
    FILES.iter().any(|file| file.path == path)
}

fn answer(number: usize, headers: &HeaderMap) -> Response {
    let (file, tag) = (&FILES[number], &TAGS[number]);
    let told = |kind| {
        [
            (header::CONTENT_TYPE, HeaderValue::from_static(kind)),
            (header::CACHE_CONTROL, HeaderValue::from_static("no-cache")),
            (header::VARY, HeaderValue::from_static("Accept")),
        ]
    };
    if file.path == "/" && !wants_page(headers) {
        return (told("text/plain; charset=utf-8"), words()).into_response();
    }
    let known = headers.get(header::IF_NONE_MATCH).and_then(|v| v.to_str().ok());
    let same = known.is_some_and(|known| known.split(',').any(|k| k.trim().trim_start_matches("W/") == tag));
    let mut response = match same {
        true => (StatusCode::NOT_MODIFIED, told(file.kind)).into_response(),
        false => (told(file.kind), file.bytes).into_response(),
    };
    if let Ok(tag) = HeaderValue::from_str(tag) {
        response.headers_mut().insert(header::ETAG, tag);
    }
    response
}

/// Browsers name `text/html`; what takes anything (curl) is told in words where things are.
fn wants_page(headers: &HeaderMap) -> bool {
    let accepted = headers.get_all(header::ACCEPT).iter().filter_map(|v| v.to_str().ok());
    accepted.flat_map(|v| v.split(',')).any(|range| {
        let (kind, more) = range.split_once(';').unwrap_or((range, ""));
        let refused = more.split(';').any(|p| matches!(p.trim(), "q=0" | "q=0.0" | "q=0.00" | "q=0.000"));
        kind.trim().eq_ignore_ascii_case("text/html") && !refused
    })
}

fn words() -> String {
    format!(
        "iplw {}\n\n/              a page to look at worlds with, in a browser\n/docs/         every operation, to try out\n\
         /openapi.json  the same as a document\n/v1/worlds     the worlds, /v1/tasks the tasks, /v1/jobs the jobs\n",
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
    fn who_names_html_gets_the_page() {
        let wants = |accept: &str| {
            let value = (header::ACCEPT, HeaderValue::from_str(accept).unwrap());
            wants_page(&[value].into_iter().collect())
        };
        assert!(wants("text/html,application/xhtml+xml,*/*;q=0.8") && wants("Text/HTML;q=0.5"));
        assert!(!wants("*/*") && !wants("application/json") && !wants("text/html;q=0, */*"));
        assert!(!wants_page(&HeaderMap::new()));
    }

    #[test]
    fn the_page_asks_nobody_else() {
        for file in FILES {
            let text = std::str::from_utf8(file.bytes).unwrap();
            let foreign = text.match_indices("://").map(|(at, _)| {
                let from = text[..at].rfind(|c: char| !c.is_ascii_alphabetic()).map_or(0, |i| i + 1);
                &text[from..text.len().min(at + 30)]
            });
            // Names of formats are no addresses; problems are told apart by theirs.
            let asked: Vec<&str> =
                foreign.filter(|u| !u.contains("www.w3.org") && !u.contains("iplw.dev")).collect();
            assert!(asked.is_empty(), "{} names {asked:?}", file.path);
        }
    }
}
