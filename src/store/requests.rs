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

/// Maximum stored responses; the oldest are removed.
const MAX_STORED_RESPONSES: i64 = 10_000;

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
    t.execute("DELETE FROM request WHERE number <= ?1", [t.last_insert_rowid() - MAX_STORED_RESPONSES])
        .map(drop)
}

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
}
