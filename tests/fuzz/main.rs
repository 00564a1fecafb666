//! Fuzzing on stable Rust: deterministic mutants of each target's seeds (`fuzz/targets/`). Some thousands of each run with the
//! tests; `make fuzz` runs as many as each target is to stand, or `FUZZ_RUNS=1000000 cargo test --test fuzz zmtp`.
//! `FUZZ_SEED=17` begins at another one; a failure names the seed and keeps the mutant.

#[path = "../../fuzz/targets/mod.rs"]
mod targets;

mod memory;

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use iplw::rng::stream;
use iplw::serve::fuzz::{Fate, operations};
use memory::{Used, counted, largest};
use targets::{MIB, Target, named};

/// Most memory at a time, bytes.
const MOST: i64 = 64 * MIB as i64;
/// How often a long run says how far it is.
const TELL: Duration = Duration::from_secs(60);

/// Most of what executions took.
#[derive(Default)]
struct Worst {
    most: i64,
    taken: u64,
    time: Duration,
}

fn run(name: &str) {
    let target = named(name);
    let number = |name: &str| std::env::var(name).ok().map(|v| v.parse::<u64>().expect("a whole number"));
    let runs = match std::env::var("FUZZ_RUNS").as_deref() {
        Ok("long") => target.long,
        _ => number("FUZZ_RUNS").unwrap_or(target.short),
    };
    let seeds = (target.seeds)();
    let (first, begun) = (number("FUZZ_SEED").unwrap_or(0), Instant::now());
    let (mut taken, mut worst, mut told) = (0u64, Worst::default(), begun);
    for (done, seed) in (first..first + runs).enumerate() {
        let bytes = targets::mutant(target, &seeds, &mut stream(seed, name));
        let since = Instant::now();
        let (fate, used) = counted(|| catch_unwind(AssertUnwindSafe(|| (target.check)(&bytes))));
        worst.time = worst.time.max(since.elapsed());
        taken += u64::from(judged(target, seed, &bytes, fate, used) == Fate::Taken);
        worst = Worst { most: worst.most.max(used.most), taken: worst.taken.max(used.taken), ..worst };
        if told.elapsed() > TELL {
            told = Instant::now();
            println!("{name}: {} executions in {:.0} s", done + 1, begun.elapsed().as_secs_f64());
        }
    }
    println!(
        "{name}: {runs} executions in {:.0} s, {:.1} % taken; most memory at a time {:.1} MiB, in all {:.1} MiB; slowest {:.3} s",
        begun.elapsed().as_secs_f64(),
        100.0 * taken as f64 / runs as f64,
        worst.most as f64 / MIB as f64,
        worst.taken as f64 / MIB as f64,
        worst.time.as_secs_f64(),
    );
    assert!(
        taken > runs / 100 && taken < runs - runs / 100,
        "mutants too tame or too wild: {taken} of {runs}"
    );
}

/// Errors, with the mutant kept, where an execution panicked or took too much.
fn judged(target: &Target, seed: u64, bytes: &[u8], fate: std::thread::Result<Fate>, used: Used) -> Fate {
    let wrong = match &fate {
        Err(panic) => {
            let text = panic.downcast_ref::<String>().cloned();
            text.or_else(|| panic.downcast_ref::<&str>().map(ToString::to_string)).or(Some("a panic".into()))
        }
        Ok(_) if used.most > MOST => Some(format!("{} bytes at a time", used.most)),
        Ok(_) if largest() > MOST as usize => Some(format!("a piece of {} bytes", largest())),
        Ok(_) if used.taken > target.work => Some(format!("{} bytes in all", used.taken)),
        Ok(_) => None,
    };
    if let Some(wrong) = wrong {
        let place = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{}-{seed}", target.name));
        let kept = std::fs::write(&place, bytes).map_or("nowhere".into(), |()| place.display().to_string());
        panic!("{} FUZZ_SEED={seed}: {wrong}\nkept in {kept}: {}", target.name, bytes.escape_ascii());
    }
    fate.unwrap_or(Fate::Refused)
}

macro_rules! fuzz {
    ($($name:ident)*) => {
        $(#[test]
        fn $name() {
            run(stringify!($name));
        })*

        /// A row of the targets is a test.
        #[test]
        fn every_target_is_run() {
            assert_eq!(targets::TARGETS.map(|t| t.name), [$(stringify!($name)),*]);
        }
    };
}

fuzz!(zmtp msgpack bodies requests trials tracks weights tokens limits families imports);

/// Every operation has seeds; each that takes a body of JSON takes some of them.
#[test]
fn every_operation_is_fuzzed() {
    let target = named("bodies");
    let seeds = (target.seeds)();
    let taken = seeds.iter().filter(|seed| (target.check)(seed) == Fate::Taken);
    let taken: BTreeSet<&str> = taken.map(|seed| operations()[usize::from(seed[0])]).collect();
    let missing: Vec<&str> = operations().into_iter().filter(|name| !taken.contains(name)).collect();
    assert!(missing.is_empty(), "no seed of {missing:?} is taken");
}

/// What the counting counts.
#[test]
fn memory_is_counted() {
    let (_, used) = counted(|| (vec![1u8; 3 << 20], drop(vec![1u8; 5 << 20])));
    assert!((used.most >> 20, used.taken >> 20) == (8, 8) && largest() >= 5 << 20, "{used:?}");
    let (_, used) = counted(|| (0..10).for_each(|_| drop(std::hint::black_box(vec![1u8; 1 << 20]))));
    assert!((used.most >> 20, used.taken >> 20) == (1, 10), "{used:?}");
}
