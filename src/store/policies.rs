//! Policies as rows, with their weights as blobs.

use rusqlite::{OptionalExtension, Row, params};
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use super::{Store, checksum, json, layout, query, sql};
use crate::error::{Error, Result};

/// A policy.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[schema(as = PolicyOut)]
pub struct PolicyRow {
    pub id: String,
    /// Family whose actions it scores; `any` for built-in policies.
    pub task: String,
    /// `fixed`, `randomised`, `believed`, `direct` (in a real world alone), `learned_on`, `uploaded` or `none`.
    pub training: String,
    /// Description.
    pub about: String,
    /// Configuration of its training.
    #[schema(value_type = Object)]
    pub config: Value,
    /// Id of the job that trained it.
    pub job: Option<String>,
    /// Version of the program that stored it.
    pub version: String,
    /// Size of its weights, bytes.
    pub bytes: u64,
    /// Name of the token that stored it.
    #[serde(skip)]
    pub owner: Option<String>,
}

impl Store {
    /// Stores a policy and its weights under `policy.id`; returns whether it is new. Replaces an existing one, which keeps its owner;
    /// errors if that owner is not `of`, if given.
    pub fn put_policy(&self, policy: &PolicyRow, weights: &[u8], of: Option<&str>) -> Result<bool> {
        // A new file name each time: until the row changes, the old weights stay readable.
        let c = self.connection();
        let next: i64 =
            c.query_row("SELECT coalesce(max(number), 0) + 1 FROM policy", [], |r| r.get(0)).map_err(sql)?;
        let old = c
            .query_row(
                "SELECT blob, owner, whole, record FROM whole_policy WHERE id = ?1",
                [&policy.id],
                |r| {
                    checksum::verify(r)?;
                    Ok((r.get::<_, String>(0)?, r.get::<_, Option<String>>(1)?))
                },
            )
            .optional()
            .map_err(sql)?;
        let owner = old.as_ref().map_or(policy.owner.as_deref(), |(_, owner)| owner.as_deref());
        if old.is_some() && of.is_some_and(|of| owner != Some(of)) {
            let reason = format!("the policy {} belongs to another owner; choose another name", policy.id);
            return Err(Error::Refused { reason });
        }
        let blob = layout::blob_name(&policy.id, next);
        self.blobs.write(&blob, weights)?;
        c.execute(
            "INSERT OR REPLACE INTO policy (number, id, task, training, about, config, job, version, blob, bytes, \
             owner, digest) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)",
            params![
                next,
                policy.id,
                policy.task,
                policy.training,
                policy.about,
                policy.config.to_string(),
                policy.job,
                env!("CARGO_PKG_VERSION"),
                blob,
                weights.len() as i64,
                owner,
                checksum::sha256(weights),
            ],
        )
        .map_err(sql)?;
        let new = old.is_none();
        if let Some((old, _)) = old {
            self.blobs.remove(&old);
        }
        Ok(new)
    }

    /// The policy called `id`.
    pub fn policy(&self, id: &str) -> Result<Option<PolicyRow>> {
        self.row(&format!("SELECT {COLUMNS} FROM whole_policy WHERE id = ?1"), [id], row)
    }

    /// Its weights.
    pub fn weights(&self, id: &str) -> Result<Option<Vec<u8>>> {
        // The connection stays locked while the file is read, so that it is not replaced meanwhile.
        let c = self.connection();
        let found = c
            .query_row("SELECT blob, digest, whole, record FROM whole_policy WHERE id = ?1", [id], |r| {
                checksum::verify(r)?;
                Ok((r.get::<_, String>(0)?, r.get::<_, String>(1)?))
            })
            .optional()
            .map_err(sql)?;
        found.map(|(blob, digest)| self.blobs.read(&blob, &digest)).transpose()
    }

    /// At most `limit` policies with their numbers, after number `after`, in order; of one owner or of all. Replacing the weights
    /// assigns a new number.
    pub fn policies(&self, after: i64, limit: usize, owner: Option<&str>) -> Result<Vec<(i64, PolicyRow)>> {
        let which = "number > ?1 AND (?3 IS NULL OR owner = ?3)";
        let select =
            format!("SELECT {COLUMNS}, number FROM whole_policy WHERE {which} ORDER BY number LIMIT ?2");
        self.rows(&select, params![after, limit as i64, owner], |r| Ok((r.get("number")?, row(r)?)))
    }

    /// Removes a policy and its weights; whether it existed.
    pub fn remove_policy(&self, id: &str) -> Result<bool> {
        let c = self.connection();
        let blob: Option<String> = c
            .query_row("DELETE FROM policy WHERE id = ?1 RETURNING blob", [id], |r| r.get(0))
            .optional()
            .map_err(sql)?;
        if let Some(blob) = &blob {
            self.blobs.remove(blob);
        }
        Ok(blob.is_some())
    }

    /// Removes weights without a row, which a crash may leave.
    pub fn sweep_blobs(&self) -> Result<()> {
        let c = self.connection();
        let row = |r: &Row| checksum::verify(r).and_then(|()| r.get(0));
        let names: Vec<String> =
            query(&c, "SELECT blob, whole, record FROM whole_policy", [], row).map_err(sql)?;
        self.blobs.retain(|name| names.iter().any(|n| n == name))
    }
}

const COLUMNS: &str = "id, task, training, about, config, job, version, bytes, owner, whole, record";

fn row(row: &Row) -> rusqlite::Result<PolicyRow> {
    Ok(PolicyRow {
        id: row.get(0)?,
        task: row.get(1)?,
        training: row.get(2)?,
        about: row.get(3)?,
        config: json(row, 4)?,
        job: row.get(5)?,
        version: row.get(6)?,
        bytes: row.get::<_, i64>(7)? as u64,
        owner: row.get(8)?,
    })
}

#[cfg(test)]
pub mod tests {
    use super::*;

    pub fn named(id: &str) -> PolicyRow {
        PolicyRow {
            id: id.into(),
            task: "bowling".into(),
            training: "fixed".into(),
            about: "a policy".into(),
            config: Value::Null,
            job: None,
            version: env!("CARGO_PKG_VERSION").into(),
            bytes: 3,
            owner: None,
        }
    }

    #[test]
    fn weights_survive_restart_and_replacement() {
        let dir = tempfile::tempdir().unwrap();
        {
            let store = Store::open(dir.path()).unwrap();
            assert!(store.put_policy(&named("a"), &[1, 2, 3], None).unwrap());
            assert!(store.put_policy(&named("b"), &[9], None).unwrap());
            assert!(!store.put_policy(&named("a"), &[4, 5, 6], None).unwrap());
        }
        // Leftovers of a crash are removed.
        std::fs::write(dir.path().join("policies/.c.9.safetensors.5.0.part"), [0]).unwrap();
        let store = Store::open(dir.path()).unwrap();
        assert_eq!(store.weights("a").unwrap().unwrap(), [4, 5, 6]);
        assert_eq!(store.policy("a").unwrap().unwrap(), named("a"));
        assert_eq!(std::fs::read_dir(dir.path().join("policies")).unwrap().count(), 2);
        assert!(store.remove_policy("b").unwrap() && !store.remove_policy("b").unwrap());
        assert_eq!(store.weights("b").unwrap(), None);
        assert_eq!(store.policies(0, 9, None).unwrap(), [(3, named("a"))]);
        assert_eq!(store.policies(3, 9, None).unwrap(), []);
    }

    #[test]
    fn only_owner_replaces_policy() {
        let store = Store::in_memory().unwrap();
        let of = |owner: &str| PolicyRow { owner: Some(owner.into()), ..named("a") };
        assert!(store.put_policy(&of("ann"), &[1], Some("ann")).unwrap());
        let refused = store.put_policy(&of("bob"), &[2], Some("bob")).unwrap_err().to_string();
        assert!(refused.contains("another owner"), "{refused}");
        assert_eq!(store.weights("a").unwrap().unwrap(), [1]);
        assert!(!store.put_policy(&of("root"), &[3], None).unwrap());
        assert_eq!(store.policy("a").unwrap().unwrap().owner.as_deref(), Some("ann"));
        assert_eq!(store.policies(0, 9, Some("bob")).unwrap(), []);
        assert_eq!(store.policies(0, 9, Some("ann")).unwrap().len(), 1);
    }
}
