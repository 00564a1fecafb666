//! Stored responses of idempotent requests, by key.

use rusqlite::{Transaction, params};

use super::Store;
use crate::error::Result;

/// A stored response.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredResponse {
    /// Idempotency key; unique.
    pub key: String,
    /// Hash of the request.
    pub fingerprint: String,
    pub status: u16,
    pub location: Option<String>,
    pub body: Vec<u8>,
}

/// Limits of the stored responses of one owner; the oldest are removed.
struct ResponseLimits {
    count: u64,
    /// Bodies, bytes.
    bytes: u64,
}

const LIMITS: ResponseLimits = ResponseLimits { count: 10_000, bytes: 64 << 20 };

impl Store {
    /// The stored response of a key.
    pub fn stored_response(&self, key: &str) -> Result<Option<StoredResponse>> {
        let select = "SELECT key, fingerprint, status, location, body, whole, record FROM whole_request WHERE key = ?1";
        self.row(select, [key], |r| {
            Ok(StoredResponse {
                key: r.get(0)?,
                fingerprint: r.get(1)?,
                status: r.get(2)?,
                location: r.get(3)?,
                body: r.get(4)?,
            })
        })
    }
}

/// Stores a response in the transaction of its effect.
pub(super) fn keep(t: &Transaction, answered: Option<&StoredResponse>) -> rusqlite::Result<()> {
    let Some(a) = answered else { return Ok(()) };
    t.execute(
        "INSERT INTO request (key, fingerprint, status, location, body) VALUES (?1, ?2, ?3, ?4, ?5)",
        params![a.key, a.fingerprint, a.status, a.location, a.body],
    )?;
    remove_oldest(t, &a.key, &LIMITS)
}

/// Removes the oldest responses beyond the limits of the owner of `key`, but never the newest. The query reads an index only.
fn remove_oldest(t: &Transaction, key: &str, limits: &ResponseLimits) -> rusqlite::Result<()> {
    // A key is "OWNER KEY", or "KEY" without an owner.
    let owner = key.split_inclusive(' ').next().filter(|first| first.ends_with(' ')).unwrap_or_default();
    let mut select = t.prepare_cached(OF_OWNER)?;
    let mut rows = select.query([owner])?;
    let (mut count, mut bytes) = (0, 0);
    while let Some(row) = rows.next()? {
        count += 1;
        bytes += row.get::<_, i64>(1)? as u64;
        if count > 1 && (count > limits.count || bytes > limits.bytes) {
            let last: i64 = row.get(0)?;
            let which = "substr(key, 1, instr(key, ' ')) = ?1 AND number <= ?2";
            return t.execute(&format!("DELETE FROM request WHERE {which}"), params![owner, last]).map(drop);
        }
    }
    Ok(())
}

const OF_OWNER: &str = "SELECT number, octet_length(body) FROM main.request \
                        WHERE substr(key, 1, instr(key, ' ')) = ?1 ORDER BY number DESC";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn response_and_effect_are_atomic() {
        let store = Store::in_memory().unwrap();
        let response = |body: &str| StoredResponse {
            key: "k".into(),
            fingerprint: "f".into(),
            status: 201,
            location: Some("/here".into()),
            body: body.into(),
        };
        store.add_world("w1", "{}", None, Some(&response("first"))).unwrap();
        assert_eq!(store.stored_response("k").unwrap(), Some(response("first")));
        assert!(
            store.add_world("w2", "{}", None, Some(&response("second"))).is_err(),
            "a key has one answer"
        );
        assert_eq!(store.worlds().unwrap().len(), 1, "and its effect is gone too");
        assert_eq!(store.stored_response("other").unwrap(), None);
    }

    fn response(key: &str, bytes: usize) -> StoredResponse {
        let (key, fingerprint) = (key.to_string(), "f".to_string());
        StoredResponse { key, fingerprint, status: 200, location: None, body: vec![0; bytes] }
    }

    #[test]
    fn owners_do_not_displace_each_others_responses() {
        let store = Store::in_memory().unwrap();
        let put = |key: &str, bytes: usize| {
            let limits = ResponseLimits { count: 3, bytes: 1000 };
            let done = store.atomically(|t| {
                keep(t, Some(&response(key, bytes)))?;
                remove_oldest(t, key, &limits)
            });
            done.unwrap();
        };
        let keys = || -> Vec<String> {
            store
                .rows("SELECT key, whole, record FROM whole_request ORDER BY number", [], |r| r.get(0))
                .unwrap()
        };
        put("first", 1);
        put("ann 0", 1);
        (0..5).for_each(|i| put(&format!("bob {i}"), 10));
        assert_eq!(keys(), ["first", "ann 0", "bob 2", "bob 3", "bob 4"], "by number");
        put("ann 1", 600);
        put("ann 2", 399);
        assert_eq!(keys().len(), 7);
        put("ann 3", 500);
        assert_eq!(keys()[4..], ["ann 2", "ann 3"], "by size");
        put("ann 4", 2000);
        assert_eq!(keys(), ["first", "bob 2", "bob 3", "bob 4", "ann 4"], "the newest stays");
        (0..4).for_each(|i| put(&format!("second{i}"), 1));
        assert_eq!(keys()[..4], ["bob 2", "bob 3", "bob 4", "ann 4"]);
    }

    #[test]
    fn limits_are_checked_in_the_index_alone() {
        let store = Store::in_memory().unwrap();
        let select = format!("EXPLAIN QUERY PLAN {OF_OWNER}");
        let plan: String = store.connection().query_row(&select, ["ann "], |r| r.get(3)).unwrap();
        assert!(plan.contains("USING COVERING INDEX request_of_owner"), "{plan}");
    }
}
