//! Keyset pagination: a cursor holds the key of the last item, so that items added or removed meanwhile shift nothing.

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;

use crate::error::{Error, Result};

/// Page size and position of a list request.
pub struct Pagination {
    limit: usize,
    /// `list:key` of the last item of the previous page.
    after: Option<(String, String)>,
    cursor: String,
}

/// Items of a page by default.
const DEFAULT_PAGE_SIZE: usize = 100;
/// Maximum items of a page.
const MAX_PAGE_SIZE: usize = 1000;

impl Pagination {
    /// Parses `limit` and `cursor`; rejects other parameters.
    pub fn from_query(pairs: &[(String, String)]) -> Result<Pagination> {
        let mut page = Pagination { limit: DEFAULT_PAGE_SIZE, after: None, cursor: String::new() };
        for (i, (name, value)) in pairs.iter().enumerate() {
            if pairs[..i].iter().any(|(n, _)| n == name) {
                return Err(Error::input(name, "given twice", "each parameter once"));
            }
            match name.as_str() {
                "limit" => {
                    let limit = value.parse().ok().filter(|n| (1..=MAX_PAGE_SIZE).contains(n));
                    page.limit = limit.ok_or_else(|| {
                        Error::input(
                            "limit",
                            format!("{value:?}"),
                            format!("a whole number from 1 to {MAX_PAGE_SIZE}"),
                        )
                    })?;
                }
                "cursor" => {
                    page.cursor = value.clone();
                    let bytes = URL_SAFE_NO_PAD.decode(value).ok();
                    let key = bytes.and_then(|b| String::from_utf8(b).ok());
                    let parts = key.as_deref().and_then(|k| k.split_once(':'));
                    let (list, key) = parts.ok_or_else(|| page.invalid_cursor())?;
                    page.after = Some((list.into(), key.into()));
                }
                _ => return Err(Error::input(name, format!("{value:?}"), "the parameters limit and cursor")),
            }
        }
        Ok(page)
    }

    /// Items to fetch: one more than the page holds, which shows whether there is a next page.
    pub fn fetch_limit(&self) -> usize {
        self.limit + 1
    }

    /// Key of the last item of the previous page; `None` on the first page.
    pub fn after<T: std::str::FromStr>(&self, list: &str) -> Result<Option<T>> {
        match &self.after {
            None => Ok(None),
            Some((of, key)) if of == list => key.parse().map(Some).map_err(|_| self.invalid_cursor()),
            Some(_) => Err(self.invalid_cursor()),
        }
    }

    /// Truncates the fetched items to the page; returns the cursor of the next page, if there is one.
    pub fn truncate<T, K: std::fmt::Display>(
        &self,
        list: &str,
        items: &mut Vec<T>,
        key: fn(&T) -> K,
    ) -> Option<String> {
        self.truncate_to(self.limit, list, items, key)
    }

    /// As [`Pagination::truncate`], for a page of at most `count` items.
    pub fn truncate_to<T, K: std::fmt::Display>(
        &self,
        count: usize,
        list: &str,
        items: &mut Vec<T>,
        key: fn(&T) -> K,
    ) -> Option<String> {
        if items.len() <= count {
            return None;
        }
        items.truncate(count);
        items.last().map(|last| URL_SAFE_NO_PAD.encode(format!("{list}:{}", key(last))))
    }

    fn invalid_cursor(&self) -> Error {
        Error::input("cursor", format!("{:?}", self.cursor), "the `next` of a previous page of this list")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(limit: &str, cursor: Option<String>) -> Result<Pagination> {
        let mut pairs = vec![("limit".to_string(), limit.to_string())];
        pairs.extend(cursor.map(|c| ("cursor".to_string(), c)));
        Pagination::from_query(&pairs)
    }

    #[test]
    fn pages_cover_the_list() {
        let all: Vec<i64> = (1..=10).collect();
        for limit in 1..=11 {
            let (mut collected, mut cursor) = (Vec::new(), None);
            loop {
                let page = page(&limit.to_string(), cursor.take()).unwrap();
                let after = page.after::<i64>("n").unwrap().unwrap_or(0);
                let mut items: Vec<i64> =
                    all.iter().copied().filter(|n| *n > after).take(page.fetch_limit()).collect();
                cursor = page.truncate("n", &mut items, |n| *n);
                assert!(!items.is_empty() && items.len() <= limit);
                collected.extend(items);
                if cursor.is_none() {
                    break;
                }
            }
            assert_eq!(collected, all, "{limit}");
        }
    }

    #[test]
    fn rejects_invalid_pages() {
        for limit in ["0", "1001", "-1", "x", ""] {
            assert!(page(limit, None).is_err(), "{limit}");
        }
        for cursor in ["", "x", "%", "bjo", "bjp4"] {
            let read = page("1", Some(cursor.into())).and_then(|p| p.after::<i64>("n"));
            assert!(read.err().unwrap().to_string().contains("`cursor`"), "{cursor}");
        }
        let of_another = page("1", Some(URL_SAFE_NO_PAD.encode("m:1"))).unwrap();
        assert!(of_another.after::<i64>("n").is_err());
        assert!(Pagination::from_query(&[("limits".into(), "1".into())]).is_err());
        assert!(
            Pagination::from_query(&[("limit".into(), "1".into()), ("limit".into(), "1".into())]).is_err()
        );
    }
}
