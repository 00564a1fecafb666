//! Content negotiation: the response format of a client's `Accept` header (RFC 9110, section 12.5.1).

use axum::http::HeaderMap;

use crate::serve::wire::{MSGPACK, WireFormat};

/// The preferred format: msgpack if it is named and its quality is not below JSON's, the first named winning ties. A quality of
/// 0 excludes a format; if both are excluded, the response is JSON.
pub fn negotiate(headers: &HeaderMap) -> WireFormat {
    let mut formats = AcceptedFormats::default();
    let values = headers.get_all("accept").into_iter().filter_map(|v| v.to_str().ok());
    for (position, range) in values.flat_map(|v| v.split(',')).enumerate() {
        let mut parts = range.split(';').map(str::trim);
        let kind = parts.next().unwrap_or_default().to_ascii_lowercase();
        let parameters: Vec<String> = parts.map(str::to_ascii_lowercase).collect();
        let quality = parameters.iter().find_map(|p| p.strip_prefix("q=")).map_or(1.0, |q| {
            // A malformed quality counts as 1.
            q.parse().unwrap_or(1.0)
        });
        let accept_range =
            AcceptRange { quality, position, raw: parameters.iter().any(|p| p == "arrays=raw") };
        match kind.as_str() {
            MSGPACK => prefer(&mut formats.msgpack, accept_range),
            "application/json" => prefer(&mut formats.json, accept_range),
            "application/*" | "*/*" => prefer(&mut formats.any, accept_range),
            _ => {}
        }
    }
    formats.form()
}

/// Ranges of the header, by format.
#[derive(Default)]
struct AcceptedFormats {
    msgpack: Option<AcceptRange>,
    json: Option<AcceptRange>,
    /// Wildcard.
    any: Option<AcceptRange>,
}

#[derive(Clone, Copy)]
struct AcceptRange {
    /// From 0, not acceptable, to 1.
    quality: f64,
    /// Position of the range in the header.
    position: usize,
    raw: bool,
}

/// Keeps the range of higher quality, else the first; a format may be named twice, with and without raw arrays.
fn prefer(best: &mut Option<AcceptRange>, accept_range: AcceptRange) {
    if best.is_none_or(|k| accept_range.quality > k.quality) {
        *best = Some(accept_range);
    }
}

impl AcceptedFormats {
    fn form(&self) -> WireFormat {
        let accepted = |named: Option<AcceptRange>| named.or(self.any).filter(|l| l.quality > 0.0);
        let Some(msgpack) = accepted(self.msgpack) else { return WireFormat::Json };
        let better = match accepted(self.json) {
            None => true,
            Some(json) => {
                let earlier = self.msgpack.is_some() && msgpack.position < json.position;
                msgpack.quality > json.quality || (msgpack.quality == json.quality && earlier)
            }
        };
        if better { WireFormat::Msgpack { raw: msgpack.raw } } else { WireFormat::Json }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(accept: &[&str]) -> WireFormat {
        let values = accept.iter().map(|v| (axum::http::header::ACCEPT, v.parse().unwrap()));
        negotiate(&values.collect())
    }

    #[test]
    fn excludes_quality_zero() {
        let packed = WireFormat::Msgpack { raw: false };
        assert_eq!(of(&["application/msgpack;q=0, application/json"]), WireFormat::Json);
        assert_eq!(of(&["application/msgpack; q=0.0"]), WireFormat::Json);
        assert_eq!(of(&["application/json;q=0, application/msgpack"]), packed);
        assert_eq!(of(&["application/json;q=0, */*"]), packed);
    }

    #[test]
    fn prefers_quality_then_order() {
        let packed = WireFormat::Msgpack { raw: false };
        for json in [&[][..], &["*/*"], &["text/html"], &["application/json, application/msgpack"]] {
            assert_eq!(of(json), WireFormat::Json, "{json:?}");
        }
        assert_eq!(of(&["application/json;q=0.5, application/msgpack"]), packed);
        assert_eq!(of(&["application/msgpack;q=0.5, application/json"]), WireFormat::Json);
        assert_eq!(of(&["application/msgpack", "application/json"]), packed);
        assert_eq!(of(&["application/msgpack, */*"]), packed);
        let raw = WireFormat::Msgpack { raw: true };
        assert_eq!(of(&["Application/Msgpack; arrays=raw, application/json"]), raw);
    }
}
