//! Fault injection: data directories that were closed cleanly and then damaged at random. A damaged store returns the original data
//! or an error that names the damage. `cargo test` runs a hundred cases of each kind, `make damage` a thousand.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::json;

use super::policies::tests::named;
use super::{JobList, JobState, MeasuredOutcomes, Store, StoredResponse, check, salvage};
use crate::error::{Error, Result};

/// A deterministic pseudo-random generator (Marsaglia 2003, xorshift with shifts 13, 7, 17).
struct Xorshift(u64);

impl Xorshift {
    fn below(&mut self, limit: u64) -> u64 {
        for (left, by) in [(true, 13), (false, 7), (true, 17)] {
            self.0 ^= if left { self.0 << by } else { self.0 >> by };
        }
        self.0 % limit
    }
}

const JOBS: i64 = 60;

/// A directory with all kinds of records, large enough for trees of several levels and overflow pages.
fn fill(directory: &Path) {
    let store = Store::open(directory).unwrap();
    for i in 0..JOBS {
        let config = json!({"task": "bowling", "seed": i, "words": "x".repeat(i as usize * 7)});
        let answer = |key: String| StoredResponse {
            key,
            fingerprint: format!("f{i}"),
            status: 202,
            location: Some(format!("/v1/jobs/job-{i}")),
            body: vec![i as u8; 40],
        };
        let response = |_: &_| Some(answer(format!("key-{i}")));
        let mut job = store.add_job("iplw", &config, &config, i as u64, Some("ann"), &response).unwrap();
        store.open_round(job.number, 0, &format!("[{i}]")).unwrap();
        let measured: MeasuredOutcomes =
            (0..4).map(|n| (n, (n != 2).then(|| format!("{{\"x\":{i}.{n}}}")))).collect();
        store.put_measured(job.number, &measured, None, None).unwrap();
        store.close_round(job.number, 0, "done").unwrap();
        store.put_artifact(job.number, "surface", &vec![i as u8; 100 * i as usize]).unwrap();
        if i % 3 != 0 {
            job.state = JobState::Succeeded;
            job.result = Some(json!({"found": vec![0.1; 20 * i as usize]}));
            store.update_job(&job).unwrap();
        }
        store.add_world(&format!("w{i}"), &config.to_string(), Some("bob"), None).unwrap();
        store.set_world_latents(&format!("w{i}"), i as u64, &format!("l{i}")).unwrap();
        store.put_surface("bowling", &format!("c{i}"), &"s".repeat(50 * i as usize), None).unwrap();
    }
    for i in 0..4 {
        store.put_policy(&named(&format!("p{i}")), &vec![i as u8; 3000], None).unwrap();
    }
    store.remove_job(JOBS / 2).unwrap();
    store.flush_worlds().unwrap();
}

/// All queries of a store and their results.
fn query_all(store: &Store) -> BTreeMap<String, Result<String>> {
    let mut all = BTreeMap::new();
    let mut ask = |what: String, answer: Result<String>| drop(all.insert(what, answer));
    fn debug<T: std::fmt::Debug>(answer: Result<T>) -> Result<String> {
        answer.map(|a| format!("{a:?}"))
    }
    ask("worlds".into(), debug(store.worlds()));
    ask("unfinished".into(), debug(store.unfinished()));
    ask("jobs".into(), debug(store.jobs(&JobList::default(), None, 1000, None)));
    ask("jobs of ann".into(), debug(store.jobs(&JobList::default(), None, 1000, Some("ann"))));
    ask("states".into(), debug(store.jobs_by_state()));
    ask("ended".into(), debug(store.ended_before(1 << 40)));
    ask("policies".into(), debug(store.policies(0, 1000, None)));
    ask("surfaces".into(), debug(store.surfaces(0, 1000)));
    for i in 0..=JOBS {
        ask(format!("job {i}"), debug(store.job(i)));
        ask(format!("rounds {i}"), debug(store.rounds(i)));
        ask(format!("last round {i}"), debug(store.last_round(i)));
        ask(format!("measured {i}"), debug(store.measured(i, 0)));
        ask(format!("artifact {i}"), debug(store.artifact(i, "surface")));
        ask(format!("answer {i}"), debug(store.stored_response(&format!("key-{i}"))));
        ask(format!("surface {i}"), debug(store.surface(i)));
        ask(format!("surface like {i}"), debug(store.surface_like("bowling", &format!("c{i}"))));
    }
    for i in 0..5 {
        ask(format!("policy {i}"), debug(store.policy(&format!("p{i}"))));
        ask(format!("weights {i}"), debug(store.weights(&format!("p{i}"))));
    }
    all
}

/// Files of a directory, recursively.
fn files(directory: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { all.extend(files(&path)) } else { all.push(path) }
    }
    all.sort();
    all
}

fn copy(from: &Path, to: &Path) {
    for file in files(from) {
        let there = to.join(file.strip_prefix(from).unwrap());
        fs::create_dir_all(there.parent().unwrap()).unwrap();
        fs::copy(&file, there).unwrap();
    }
}

/// Counts of the outcomes of damaged directories.
#[derive(Debug, Default)]
struct DamageOutcomes {
    at_start: usize,
    when_read: usize,
    all_there: usize,
    wrong: Vec<String>,
}

/// Damages copies of a directory `times` times by `how`, which returns a description.
fn damaged(times: usize, seed: u64, how: impl Fn(&mut Vec<u8>, &mut Xorshift) -> String) -> DamageOutcomes {
    let place = tempfile::tempdir().unwrap();
    let whole = place.path().join("whole");
    fill(&whole);
    let expected = query_all(&Store::open(&whole).unwrap());
    let (mut draws, mut outcomes) = (Xorshift(seed), DamageOutcomes::default());
    for i in 0..times {
        let copied = place.path().join(format!("{i}"));
        copy(&whole, &copied);
        // Half of the damage to the database, the other half to any non-empty file.
        let mut of: Vec<PathBuf> = files(&copied);
        of.retain(|f| !f.ends_with("lock"));
        let one = draws.below(of.len() as u64) as usize;
        let file = if draws.below(2) == 0 { copied.join("iplw.sqlite") } else { of[one].clone() };
        let mut bytes = fs::read(&file).unwrap();
        let did =
            format!("{} of {}", how(&mut bytes, &mut draws), file.strip_prefix(&copied).unwrap().display());
        fs::write(&file, bytes).unwrap();
        query_damaged(&copied, &expected, &did, &mut outcomes);
        fs::remove_dir_all(&copied).unwrap();
    }
    outcomes
}

/// Opens a damaged directory and runs all queries.
fn query_damaged(
    directory: &Path,
    expected: &BTreeMap<String, Result<String>>,
    did: &str,
    outcomes: &mut DamageOutcomes,
) {
    let store = match Store::open(directory) {
        Ok(store) => store,
        Err(e) => {
            assert!(clear(&e), "{did}: {e:?}");
            return outcomes.at_start += 1;
        }
    };
    let mut complete = true;
    for (query, answer) in query_all(&store) {
        match answer {
            Ok(_) if answer == expected[&query] => {}
            Ok(other) => outcomes.wrong.push(format!("{did}: {query}: {other}")),
            Err(e) => {
                assert!(clear(&e), "{did}: {query}: {e:?}");
                complete = false;
            }
        }
    }
    if complete { outcomes.all_there += 1 } else { outcomes.when_read += 1 }
}

/// Whether the error reports damage or an unsupported version.
fn clear(error: &Error) -> bool {
    match error {
        Error::Damaged { what, how } => !what.is_empty() && !how.is_empty(),
        Error::Refused { reason } => reason.contains("later version"),
        Error::Io { path, message } => path.contains("iplw.sqlite") && !message.is_empty(),
        _ => false,
    }
}

fn truncate(bytes: &mut Vec<u8>, draws: &mut Xorshift) -> String {
    let length = draws.below(bytes.len() as u64);
    bytes.truncate(length as usize);
    format!("the first {length} bytes")
}

fn flip(bytes: &mut [u8], draws: &mut Xorshift) -> String {
    // One in eight in the first page's header and the schema, which are small and critical.
    let near = if draws.below(8) == 0 { 3000.min(bytes.len() as u64) } else { bytes.len() as u64 };
    let (at, bit) = (draws.below(near) as usize, draws.below(8));
    bytes[at] ^= 1 << bit;
    format!("bit {bit} of byte {at}")
}

fn run(times: usize) {
    for (name, outcomes) in [
        ("truncations", damaged(times, 0x9e37_79b9_7f4a_7c15, truncate)),
        ("bit flips", damaged(times, 0xd1b5_4a32_d192_ed03, |bytes, draws| flip(bytes, draws))),
    ] {
        println!(
            "{times} {name}: said at start {}, said when read {}, all there {}, wrong data {}",
            outcomes.at_start,
            outcomes.when_read,
            outcomes.all_there,
            outcomes.wrong.len()
        );
        assert!(outcomes.wrong.is_empty(), "{name}: {:#?}", &outcomes.wrong[..outcomes.wrong.len().min(5)]);
        assert_eq!(outcomes.at_start + outcomes.when_read + outcomes.all_there, times);
        assert!(outcomes.at_start > times / 4, "most of a database matters: {outcomes:?}");
    }
}

#[test]
fn damaged_directory_is_reported_or_intact() {
    run(100);
}

#[test]
#[ignore = "long: `make damage`"]
fn directory_damaged_a_thousand_times_is_reported_or_intact() {
    run(1000);
}

/// Salvage: named records are dropped, the rest is unchanged, and numbers are not reused.
#[test]
fn salvages_intact_records() {
    let place = tempfile::tempdir().unwrap();
    let directory = place.path().join("data");
    fill(&directory);
    let expected = query_all(&Store::open(&directory).unwrap());
    let change = |statement: &str| {
        let c = rusqlite::Connection::open(directory.join("iplw.sqlite")).unwrap();
        assert!(c.execute(statement, []).unwrap() > 0, "{statement}");
    };
    change("UPDATE measured SET outcome = 'x' WHERE job = 7 AND number = 1");
    change("UPDATE world SET interactions = 1000 WHERE id = 'w9'");
    change("UPDATE job SET number = 1000 WHERE number = 60");
    fs::remove_file(directory.join("policies/p2.3.safetensors")).unwrap();
    let found: Vec<String> = check(&directory).unwrap().damaged.into_iter().map(|f| f.record).collect();
    let bad =
        ["job job-1000", "measurement 1 of job-7", "world w9", "weights of policy p2 (p2.3.safetensors)"];
    assert_eq!(found, bad);
    let refused = Store::open(&directory).err().unwrap().to_string();
    assert!(refused.contains("job-1000 and 3 more") && refused.contains("iplw check"), "{refused}");

    let saved = salvage(&directory).unwrap();
    let dropped: Vec<&str> = saved.dropped.iter().map(|f| f.record.as_str()).collect();
    assert_eq!(dropped, ["job job-1000", "measurement 1 of job-7", "world w9", "job job-7", "policy p2"]);
    assert!(saved.damaged_copy.exists());
    assert_eq!(check(&directory).unwrap().damaged, []);
    let store = Store::open(&directory).unwrap();
    let results = query_all(&store);
    for (query, answer) in &expected {
        let of_a_dropped_job = [" 7", " 60"].iter().any(|n| query.ends_with(n))
            && !query.contains("surface ")
            && !query.starts_with("answer");
        let lists = ["worlds", "unfinished", "jobs", "jobs of ann", "states", "ended", "policies"];
        if !of_a_dropped_job
            && !lists.contains(&query.as_str())
            && !["policy 2", "weights 2"].contains(&query.as_str())
        {
            assert_eq!(&results[query], answer, "{query}");
        }
    }
    assert_eq!((store.job(7).unwrap(), store.job(60).unwrap()), (None, None));
    assert!(store.measured(7, 0).unwrap().is_empty() && store.measured(60, 0).unwrap().is_empty());
    let next = store.add_job("iplw", &json!({}), &json!({}), 0, None, &|_| None).unwrap();
    assert_eq!(next.number, JOBS + 1, "no number twice");
}

/// If a page is unreadable, the records on the others are salvaged.
#[test]
fn salvages_around_unreadable_page() {
    let place = tempfile::tempdir().unwrap();
    let directory = place.path().join("data");
    fill(&directory);
    let expected = query_all(&Store::open(&directory).unwrap());
    let file = directory.join("iplw.sqlite");
    let leaf: i64 = {
        let c = rusqlite::Connection::open(&file).unwrap();
        c.query_row("SELECT rootpage FROM sqlite_schema WHERE name = 'world'", [], |r| r.get(0)).unwrap()
    };
    // The first leaf of the table `world`: the first cell of an interior page points to its first child.
    let mut bytes = fs::read(&file).unwrap();
    let page = |n: usize| (n - 1) * 4096;
    let root = page(leaf as usize);
    assert_eq!(bytes[root], 5, "an interior page");
    let cell = root + usize::from(u16::from_be_bytes([bytes[root + 12], bytes[root + 13]]));
    let child = u32::from_be_bytes(bytes[cell..cell + 4].try_into().unwrap()) as usize;
    bytes[page(child)..page(child) + 4096].fill(0);
    fs::write(&file, bytes).unwrap();
    assert!(Store::open(&directory).is_err());
    let saved = salvage(&directory).unwrap();
    assert!(saved.dropped.iter().any(|f| f.record == "table world"), "{:?}", saved.dropped);
    let store = Store::open(&directory).unwrap();
    let left = store.worlds().unwrap();
    assert!(left.len() > 10 && left.len() < JOBS as usize, "{}", left.len());
    assert_eq!(left.last().unwrap().id, "w59");
    let results = query_all(&store);
    for (query, answer) in expected.iter().filter(|(query, _)| *query != "worlds") {
        assert_eq!(&results[query], answer, "{query}");
    }
}
