//! Which form of an answer a client accepts (RFC 9110, section 12.5.1).

use axum::http::HeaderMap;

use crate::serve::wire::{Form, MSGPACK};

/// The form a client likes best: msgpack if it names it and likes it no less than JSON, the first named being preferred
/// among equals. What has a quality of 0 is not accepted; where neither is, JSON is given all the same.
pub fn accepted(headers: &HeaderMap) -> Form {
    let mut found = Found::default();
    let values = headers.get_all("accept").into_iter().filter_map(|v| v.to_str().ok());
    for (place, range) in values.flat_map(|v| v.split(',')).enumerate() {
        let mut parts = range.split(';').map(str::trim);
        let kind = parts.next().unwrap_or_default().to_ascii_lowercase();
        let parameters: Vec<String> = parts.map(str::to_ascii_lowercase).collect();
        let quality = parameters.iter().find_map(|p| p.strip_prefix("q=")).map_or(1.0, |q| {
            // What is no number says nothing.
            q.parse().unwrap_or(1.0)
        });
        let liked = Liked { quality, place, raw: parameters.iter().any(|p| p == "arrays=raw") };
        match kind.as_str() {
            MSGPACK => keep(&mut found.msgpack, liked),
            "application/json" => keep(&mut found.json, liked),
            "application/*" | "*/*" => keep(&mut found.any, liked),
            _ => {}
        }
    }
    found.form()
}

/// What was said of each form.
#[derive(Default)]
struct Found {
    msgpack: Option<Liked>,
    json: Option<Liked>,
    /// Of whatever is not named.
    any: Option<Liked>,
}

#[derive(Clone, Copy)]
struct Liked {
    /// From 0, not accepted, to 1.
    quality: f64,
    /// Number of the range in the header.
    place: usize,
    raw: bool,
}

/// Keeps what is said first; a form may be named twice, with and without raw arrays.
fn keep(known: &mut Option<Liked>, liked: Liked) {
    if known.is_none_or(|k| liked.quality > k.quality) {
        *known = Some(liked);
    }
}

impl Found {
    fn form(&self) -> Form {
        let accepted = |named: Option<Liked>| named.or(self.any).filter(|l| l.quality > 0.0);
        let Some(msgpack) = accepted(self.msgpack) else { return Form::Json };
        let better = match accepted(self.json) {
            None => true,
            Some(json) => {
                let earlier = self.msgpack.is_some() && msgpack.place < json.place;
                msgpack.quality > json.quality || (msgpack.quality == json.quality && earlier)
            }
        };
        if better { Form::Msgpack { raw: msgpack.raw } } else { Form::Json }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(accept: &[&str]) -> Form {
        let values = accept.iter().map(|v| (axum::http::header::ACCEPT, v.parse().unwrap()));
        accepted(&values.collect())
    }

    #[test]
    fn what_is_not_accepted_is_not_given() {
        let packed = Form::Msgpack { raw: false };
        assert_eq!(of(&["application/msgpack;q=0, application/json"]), Form::Json);
        assert_eq!(of(&["application/msgpack; q=0.0"]), Form::Json);
        assert_eq!(of(&["application/json;q=0, application/msgpack"]), packed);
        assert_eq!(of(&["application/json;q=0, */*"]), packed);
    }

    #[test]
    fn the_form_liked_best_is_given_and_the_first_of_equals() {
        let packed = Form::Msgpack { raw: false };
        for json in [&[][..], &["*/*"], &["text/html"], &["application/json, application/msgpack"]] {
            assert_eq!(of(json), Form::Json, "{json:?}");
        }
        assert_eq!(of(&["application/json;q=0.5, application/msgpack"]), packed);
        assert_eq!(of(&["application/msgpack;q=0.5, application/json"]), Form::Json);
        assert_eq!(of(&["application/msgpack", "application/json"]), packed);
        assert_eq!(of(&["application/msgpack, */*"]), packed);
        let raw = Form::Msgpack { raw: true };
        assert_eq!(of(&["Application/Msgpack; arrays=raw, application/json"]), raw);
    }
}
