//! Requests that were answered, by the key their sender gave them: asked again, they get the same answer.

use rusqlite::{OptionalExtension, Transaction, params};

use super::{Store, seal, sql};
use crate::error::Result;

/// An answered request.
#[derive(Clone, Debug, PartialEq)]
pub struct Answered {
    /// What its sender calls it; unique.
    pub key: String,
    /// What was asked: the same for the same request, different for any other.
    pub fingerprint: String,
    pub status: u16,
    pub location: Option<String>,
    pub body: Vec<u8>,
}

/// Answers kept; the oldest go first.
const KEPT: i64 = 10_000;

impl Store {
    /// The request with this key, if it was answered.
    pub fn answered(&self, key: &str) -> Result<Option<Answered>> {
        let select = "SELECT key, fingerprint, status, location, body, whole, record FROM whole_request WHERE key = ?1";
        let row = |r: &rusqlite::Row| {
            seal::whole(r)?;
            Ok(Answered {
                key: r.get(0)?,
                fingerprint: r.get(1)?,
                status: r.get(2)?,
                location: r.get(3)?,
                body: r.get(4)?,
            })
        };
        self.connection().query_row(select, [key], row).optional().map_err(sql)
    }
}

/// Keeps an answer in the transaction that has its effect: both last, or neither.
pub(super) fn keep(t: &Transaction, answered: Option<&Answered>) -> rusqlite::Result<()> {
    let Some(a) = answered else { return Ok(()) };
    t.execute(
        "INSERT INTO request (key, fingerprint, status, location, body) VALUES (?1, ?2, ?3, ?4, ?5)",
        params![a.key, a.fingerprint, a.status, a.location, a.body],
    )?;
    t.execute("DELETE FROM request WHERE number <= ?1", [t.last_insert_rowid() - KEPT]).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_kept_with_its_effect_or_not_at_all() {
        let store = Store::in_memory().unwrap();
        let answered = |body: &str| Answered {
            key: "k".into(),
            fingerprint: "f".into(),
            status: 201,
            location: Some("/here".into()),
            body: body.into(),
        };
        store.add_world("w1", "{}", None, Some(&answered("first"))).unwrap();
        assert_eq!(store.answered("k").unwrap(), Some(answered("first")));
        assert!(
            store.add_world("w2", "{}", None, Some(&answered("second"))).is_err(),
            "a key has one answer"
        );
        assert_eq!(store.worlds().unwrap().len(), 1, "and its effect is gone too");
        assert_eq!(store.answered("other").unwrap(), None);
    }
}
