//! Disk usage of an owner's records.

use super::{Store, sql};
use crate::error::Result;

/// Number and size of an owner's records.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OwnerUsage {
    pub policies: u64,
    pub jobs: u64,
    /// Weights of policies; requests, plans, results, artifacts, names and notes of jobs; configurations of worlds; bytes.
    pub bytes: u64,
}

// `octet_length` reads a row's header, not the value.
const SELECT: &str = "
    WITH size (policies, jobs, bytes) AS (
        SELECT count(*), 0, sum(bytes) FROM main.policy WHERE owner IS ?1
        UNION ALL
        SELECT 0, count(*), sum(octet_length(config) + coalesce(octet_length(plan), 0)
            + coalesce(octet_length(result), 0)) FROM main.job WHERE owner IS ?1
        UNION ALL
        SELECT 0, 0, sum(octet_length(body)) FROM main.artifact
            WHERE job IN (SELECT number FROM main.job WHERE owner IS ?1)
        UNION ALL
        SELECT 0, 0, sum(octet_length(name) + octet_length(note)) FROM main.metadata
            WHERE job IN (SELECT number FROM main.job WHERE owner IS ?1)
        UNION ALL
        SELECT 0, 0, sum(octet_length(config)) FROM main.world WHERE owner IS ?1
    )
    SELECT sum(policies), sum(jobs), coalesce(sum(bytes), 0) FROM size";

impl Store {
    /// Usage of the records of `owner`; of those without an owner for `None`. Takes a time proportional to their number.
    pub fn owner_usage(&self, owner: Option<&str>) -> Result<OwnerUsage> {
        let c = self.connection();
        let mut select = c.prepare_cached(SELECT).map_err(sql)?;
        let usage = select.query_row([owner], |r| {
            let count = |i: usize| r.get::<_, i64>(i).map(|n| n as u64);
            Ok(OwnerUsage { policies: count(0)?, jobs: count(1)?, bytes: count(2)? })
        });
        usage.map_err(sql)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::store::PolicyRow;
    use crate::store::policies::tests::named;

    #[test]
    fn counts_the_records_of_one_owner() {
        let store = Store::in_memory().unwrap();
        assert_eq!(store.owner_usage(Some("ann")).unwrap(), OwnerUsage::default());
        for (owner, times) in [(Some("ann"), 2), (Some("bob"), 1), (None, 1)] {
            let name = owner.unwrap_or("all");
            for i in 0..times {
                let policy = PolicyRow { owner: owner.map(String::from), ..named(&format!("{name}{i}")) };
                store.put_policy(&policy, &[0; 1000], None).unwrap();
                let mut job =
                    store.add_job("iplw", &json!("é"), &json!("plan"), 0, owner, &|_| None).unwrap();
                job.result = Some(json!([1.5]));
                store.update_job(&job).unwrap();
                store.annotate_job(job.number, Some("naïf"), Some("note")).unwrap();
                store.put_artifact(job.number, "surface", &[0; 500]).unwrap();
                store.add_world(&format!("{name}{i}"), "{\"a\":1}", owner, None).unwrap();
            }
        }
        let one = 1000 + 4 + 6 + 5 + 500 + 5 + 4 + 7;
        assert_eq!(
            store.owner_usage(Some("ann")).unwrap(),
            OwnerUsage { policies: 2, jobs: 2, bytes: 2 * one }
        );
        for owner in [Some("bob"), None] {
            assert_eq!(store.owner_usage(owner).unwrap(), OwnerUsage { policies: 1, jobs: 1, bytes: one });
        }
    }

    /// No table is scanned.
    #[test]
    fn uses_indexes() {
        let store = Store::in_memory().unwrap();
        let c = store.connection();
        let mut plan = c.prepare(&format!("EXPLAIN QUERY PLAN {SELECT}")).unwrap();
        let steps = plan.query_map(["ann"], |r| r.get::<_, String>(3)).unwrap();
        let steps: Vec<String> = steps.collect::<rusqlite::Result<_>>().unwrap();
        let scans = |table: &str| steps.iter().any(|s| s.starts_with(&format!("SCAN {table}")));
        assert!(!["policy", "job", "artifact", "metadata", "world"].into_iter().any(scans), "{steps:#?}");
    }
}
