//! Fuzzing on stable Rust: deterministic mutants of each target's seeds (`fuzz/targets/`). The test suite runs a few thousand of
//! each; `make fuzz` runs the long count of each target, and `FUZZ_RUNS=1000000 cargo test --test fuzz zmtp` any count.
//! `FUZZ_SEED=17` sets the first seed; a failure names the seed and saves the mutant.

#[path = "../../fuzz/targets/mod.rs"]
mod targets;

mod memory;

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use iplw::rng::stream;
use iplw::serve::fuzz::{FuzzOutcome, operations};
use memory::{MemoryUse, counted, largest};
use targets::{MIB, Target, named};

/// Maximum memory in use, bytes.
const MAX_BYTES_IN_USE: i64 = 64 * MIB as i64;
/// Interval of progress messages of a long run.
const PROGRESS_INTERVAL: Duration = Duration::from_secs(60);

/// Maxima over executions.
#[derive(Default)]
struct Maxima {
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
    let (mut taken, mut worst, mut last_report) = (0u64, Maxima::default(), begun);
    for (done, seed) in (first..first + runs).enumerate() {
        let bytes = targets::mutant(target, &seeds, &mut stream(seed, name));
        let since = Instant::now();
        let (fate, used) = counted(|| catch_unwind(AssertUnwindSafe(|| (target.check)(&bytes))));
        worst.time = worst.time.max(since.elapsed());
        taken += u64::from(check_execution(target, seed, &bytes, fate, used) == FuzzOutcome::Accepted);
        worst = Maxima { most: worst.most.max(used.most), taken: worst.taken.max(used.taken), ..worst };
        if last_report.elapsed() > PROGRESS_INTERVAL {
            last_report = Instant::now();
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

/// Panics and saves the mutant if an execution panicked or used too much memory.
fn check_execution(
    target: &Target,
    seed: u64,
    bytes: &[u8],
    fate: std::thread::Result<FuzzOutcome>,
    used: MemoryUse,
) -> FuzzOutcome {
    let wrong = match &fate {
        Err(panic) => {
            let text = panic.downcast_ref::<String>().cloned();
            text.or_else(|| panic.downcast_ref::<&str>().map(ToString::to_string)).or(Some("a panic".into()))
        }
        Ok(_) if used.most > MAX_BYTES_IN_USE => Some(format!("{} bytes at a time", used.most)),
        Ok(_) if largest() > MAX_BYTES_IN_USE as usize => Some(format!("a piece of {} bytes", largest())),
        Ok(_) if used.taken > target.work => Some(format!("{} bytes in all", used.taken)),
        Ok(_) => None,
    };
    if let Some(wrong) = wrong {
        let place = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{}-{seed}", target.name));
        let saved = std::fs::write(&place, bytes).map_or("nowhere".into(), |()| place.display().to_string());
        panic!("{} FUZZ_SEED={seed}: {wrong}\nkept in {saved}: {}", target.name, bytes.escape_ascii());
    }
    fate.unwrap_or(FuzzOutcome::Rejected)
}

macro_rules! fuzz {
    ($($name:ident)*) => {
        $(#[test]
        fn $name() {
            run(stringify!($name));
        })*

        /// Every row of the targets has a test.
        #[test]
        fn every_target_is_run() {
            assert_eq!(targets::TARGETS.map(|t| t.name), [$(stringify!($name)),*]);
        }
    };
}

fuzz!(zmtp msgpack bodies requests trials tracks weights tokens limits families imports);

/// Every operation has seeds, and accepts some if it takes a JSON body.
#[test]
fn every_operation_is_fuzzed() {
    let target = named("bodies");
    let seeds = (target.seeds)();
    let taken = seeds.iter().filter(|seed| (target.check)(seed) == FuzzOutcome::Accepted);
    let taken: BTreeSet<&str> = taken.map(|seed| operations()[usize::from(seed[0])]).collect();
    let missing: Vec<&str> = operations().into_iter().filter(|name| !taken.contains(name)).collect();
    assert!(missing.is_empty(), "no seed of {missing:?} is taken");
}

/// Test of the memory accounting.
#[test]
fn memory_is_counted() {
    let (_, used) = counted(|| (vec![1u8; 3 << 20], drop(vec![1u8; 5 << 20])));
    assert!((used.most >> 20, used.taken >> 20) == (8, 8) && largest() >= 5 << 20, "{used:?}");
    let (_, used) = counted(|| (0..10).for_each(|_| drop(std::hint::black_box(vec![1u8; 1 << 20]))));
    assert!((used.most >> 20, used.taken >> 20) == (1, 10), "{used:?}");
}
