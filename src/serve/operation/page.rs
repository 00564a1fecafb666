//! Pages of lists, by the key of the last item seen: items that come or go meanwhile shift nothing.

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;

use crate::error::{Error, Result};

/// Which part of a list.
pub struct Page {
    limit: usize,
    /// `list:key` of the last item of the page before.
    after: Option<(String, String)>,
    cursor: String,
}

/// Items of a page where nothing else is asked for.
const USUAL: usize = 100;
/// Most items of a page.
const MOST: usize = 1000;

impl Page {
    /// From `limit` and `cursor`; other parameters are refused.
    pub fn from_query(pairs: &[(String, String)]) -> Result<Page> {
        let mut page = Page { limit: USUAL, after: None, cursor: String::new() };
        for (i, (name, value)) in pairs.iter().enumerate() {
            if pairs[..i].iter().any(|(n, _)| n == name) {
                return Err(Error::input(name, "given twice", "each parameter once"));
            }
            match name.as_str() {
                "limit" => {
                    let limit = value.parse().ok().filter(|n| (1..=MOST).contains(n));
                    page.limit = limit.ok_or_else(|| {
                        Error::input(
                            "limit",
                            format!("{value:?}"),
                            format!("a whole number from 1 to {MOST}"),
                        )
                    })?;
                }
                "cursor" => {
                    page.cursor = value.clone();
                    let bytes = URL_SAFE_NO_PAD.decode(value).ok();
                    let key = bytes.and_then(|b| String::from_utf8(b).ok());
                    let parts = key.as_deref().and_then(|k| k.split_once(':'));
                    let (list, key) = parts.ok_or_else(|| page.refuse())?;
                    page.after = Some((list.into(), key.into()));
                }
                _ => return Err(Error::input(name, format!("{value:?}"), "the parameters limit and cursor")),
            }
        }
        Ok(page)
    }

    /// Items to fetch: one more than the page holds, to know whether there are more.
    pub fn fetch(&self) -> usize {
        self.limit + 1
    }

    /// The key of the last item seen of the list; `None` at its start.
    pub fn after<T: std::str::FromStr>(&self, list: &str) -> Result<Option<T>> {
        match &self.after {
            None => Ok(None),
            Some((of, key)) if of == list => key.parse().map(Some).map_err(|_| self.refuse()),
            Some(_) => Err(self.refuse()),
        }
    }

    /// Cuts what was fetched to the page; the cursor of the next one, if there is one.
    pub fn cut<T, K: std::fmt::Display>(
        &self,
        list: &str,
        items: &mut Vec<T>,
        key: fn(&T) -> K,
    ) -> Option<String> {
        if items.len() <= self.limit {
            return None;
        }
        items.truncate(self.limit);
        items.last().map(|last| URL_SAFE_NO_PAD.encode(format!("{list}:{}", key(last))))
    }

    fn refuse(&self) -> Error {
        Error::input("cursor", format!("{:?}", self.cursor), "the `next` of a page of this list")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(limit: &str, cursor: Option<String>) -> Result<Page> {
        let mut pairs = vec![("limit".to_string(), limit.to_string())];
        pairs.extend(cursor.map(|c| ("cursor".to_string(), c)));
        Page::from_query(&pairs)
    }

    #[test]
    fn pages_join_to_the_whole_list() {
        let all: Vec<i64> = (1..=10).collect();
        for limit in 1..=11 {
            let (mut seen, mut cursor) = (Vec::new(), None);
            loop {
                let page = page(&limit.to_string(), cursor.take()).unwrap();
                let after = page.after::<i64>("n").unwrap().unwrap_or(0);
                let mut items: Vec<i64> =
                    all.iter().copied().filter(|n| *n > after).take(page.fetch()).collect();
                cursor = page.cut("n", &mut items, |n| *n);
                assert!(!items.is_empty() && items.len() <= limit);
                seen.extend(items);
                if cursor.is_none() {
                    break;
                }
            }
            assert_eq!(seen, all, "{limit}");
        }
    }

    #[test]
    fn bad_pages_are_refused() {
        for limit in ["0", "1001", "-1", "x", ""] {
            assert!(page(limit, None).is_err(), "{limit}");
        }
        for cursor in ["", "x", "%", "bjo", "bjp4"] {
            let read = page("1", Some(cursor.into())).and_then(|p| p.after::<i64>("n"));
            assert!(read.err().unwrap().to_string().contains("`cursor`"), "{cursor}");
        }
        let of_another = page("1", Some(URL_SAFE_NO_PAD.encode("m:1"))).unwrap();
        assert!(of_another.after::<i64>("n").is_err());
        assert!(Page::from_query(&[("limits".into(), "1".into())]).is_err());
        assert!(Page::from_query(&[("limit".into(), "1".into()), ("limit".into(), "1".into())]).is_err());
    }
}
