//! The batched engine compared with the machine's limits:
//! `cargo bench --features levels --bench limits -- [SCENES.jsonl [MOST]]`, where MOST is the largest number of rollouts in the memory
//! measurement (100000).
//!
//! 1. Arithmetic: operations per step times steps per second, relative to the rate of a loop of multiplications and additions with the
//!    same instructions in the same run. Operations are counted by running the kernel on a counting register type
//!    (`SimdLevel::Counted`), which follows the same code path as all other levels. Fused multiply-adds would double the limit, but
//!    they round differently, which bit-identity between levels excludes. Both limits are printed. Effects use scalar code and are
//!    not counted: drag takes three products per body and step.
//! 2. Cores: rollouts per second of wall-clock time, by number of threads.
//! 3. Memory: peak of a separate process that simulates the rollouts and keeps whether each is solved.

mod common;
mod peak;

use std::time::Instant;

use common::{Clock, level_name, rollouts, scenes};
use iplw::task::Scene;
use iplw::world::{BatchSettings, Engine, OperationCounts, Rollout, SimdLevel, Simulator, operations};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    if let [mode, count, path @ ..] = arguments.as_slice()
        && mode == "--only-simulate"
    {
        return only_simulate(count.parse().expect("a number"), &scenes(path.first()));
    }
    let own = scenes(arguments.first());
    let most = arguments.get(1).map_or(100_000, |n| n.parse().expect("a number of rollouts"));
    arithmetic(&own);
    cores(&own);
    memory(arguments.first(), most);
}

fn arithmetic(scenes: &[Scene]) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread");
    let rollouts = rollouts(scenes);
    let (counted, steps) = pool.install(|| {
        operations();
        let steps = run(SimdLevel::Counted, &rollouts);
        (operations(), steps)
    });
    let each = |n: u64| n as f64 / steps as f64;
    let OperationCounts { simple, slow, choices, moves } = counted;
    println!("\n== arithmetic, one core, every step simulated");
    println!(
        "operations per rollout step: {:.0} sums, differences and products, {:.1} quotients and roots, {:.0} comparisons and \
         selections, {:.0} moves",
        each(simple),
        each(slow),
        each(choices),
        each(moves)
    );
    println!(
        "{:10} {:>10} {:>9} {:>16} {:>9} {:>16} {:>9} {:>14}",
        "level",
        "Msteps/s",
        "Gflop/s",
        "limit, no fusing",
        "reached",
        "limit with FMA",
        "reached",
        "with choices"
    );
    for level in SimdLevel::ALL.iter().copied().filter(|l| l.available() && *l != SimdLevel::Plain) {
        let clock = Clock::start();
        let rate = pool.install(|| {
            let start = Instant::now();
            run(level, &rollouts);
            // About half a second per repetition.
            let passes = (0.5 / start.elapsed().as_secs_f64()).ceil() as usize;
            let rates = (0..7).map(|_| {
                let start = clock.seconds();
                let steps: u64 = (0..passes).map(|_| run(level, &rollouts)).sum();
                steps as f64 / (clock.seconds() - start)
            });
            median(rates.collect())
        });
        let flops = rate * each(simple + slow);
        let [plain, fused] = [false, true].map(|fused| pool.install(|| peak::flops(level, fused, &clock)));
        let against = |limit: Option<f64>| match limit {
            Some(limit) => [format!("{:.1}", limit / 1e9), format!("{:.0} %", 100.0 * flops / limit)],
            None => ["none".to_string(), String::new()],
        };
        let ([limit, share], [fused, of_fused]) = (against(plain), against(fused));
        // Comparisons and selections occupy the same execution units as sums and products.
        let busy = plain.map_or(0.0, |p| 100.0 * rate * each(simple + slow + choices) / p);
        println!(
            "{:10} {:10.2} {:9.2} {limit:>16} {share:>9} {fused:>16} {of_fused:>9} {:>14}",
            level_name(level),
            rate / 1e6,
            flops / 1e9,
            format!("{busy:.0} %")
        );
    }
}

/// Simulates every step of every rollout and returns the number of steps.
fn run(level: SimdLevel, rollouts: &[Rollout]) -> u64 {
    let settings = BatchSettings { level, end_at_rest: false };
    let steps =
        Simulator::new(Engine::Lanes).settings(settings).map(rollouts, |_, t| u64::from(t.outcome.steps));
    steps.expect("legal scenes").iter().sum()
}

fn cores(scenes: &[Scene]) {
    let rollouts = rollouts(scenes);
    let all = std::thread::available_parallelism().map_or(1, usize::from);
    println!("\n== cores, rollouts per second of wall-clock time, default settings");
    println!(
        "{:8} {:>8} {:>12} {:>9} {:>9} {:>6}",
        "engine", "threads", "rollouts/s", "lowest", "highest", "x one"
    );
    for (engine, passes) in [(Engine::Lanes, 40), (Engine::Rapier, 1)] {
        let many: Vec<Rollout> = std::iter::repeat_n(&rollouts, passes).flatten().copied().collect();
        let mut one = 0.0;
        let sizes = std::iter::successors(Some(1), |n| (*n < all).then(|| (2 * n).min(all)));
        for threads in sizes {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let mut rates: Vec<f64> = (0..5)
                .map(|_| {
                    let start = Instant::now();
                    pool.install(|| solved(&many, engine));
                    many.len() as f64 / start.elapsed().as_secs_f64()
                })
                .collect();
            rates.sort_by(f64::total_cmp);
            let rate = rates[2];
            if threads == 1 {
                one = rate;
            }
            println!(
                "{:8} {threads:8} {rate:12.0} {:9.0} {:9.0} {:6.2}",
                engine.name(),
                rates[0],
                rates[4],
                rate / one
            );
        }
    }
}

fn memory(path: Option<&String>, most: usize) {
    println!(
        "\n== memory, lanes, all cores: peak of a process that keeps only whether each rollout is solved"
    );
    for count in [1000, 10_000, 100_000].into_iter().filter(|n| *n <= most) {
        let mut command = std::process::Command::new(std::env::current_exe().expect("this program's path"));
        let ran = command.arg("--only-simulate").arg(count.to_string()).args(path).output();
        let said = ran.expect("it runs").stdout;
        println!("{count:8} rollouts: {}", String::from_utf8_lossy(&said).trim());
    }
}

/// In the child process: simulates and prints the memory used.
fn only_simulate(count: usize, scenes: &[Scene]) {
    let own = rollouts(scenes);
    let rollouts: Vec<Rollout> = own.iter().cycle().take(count).copied().collect();
    let before = resident("VmHWM:");
    solved(&rollouts, Engine::Lanes);
    let asked = (size_of::<Rollout>() * count) as f64 / 1e6;
    match (before, resident("VmHWM:")) {
        (Some(before), Some(peak)) => println!(
            "{peak:6.1} MB, {:.1} of it while simulating (list of rollouts: {asked:.1} MB)",
            peak - before
        ),
        _ => println!("memory is not available on this system"),
    }
}

fn solved(rollouts: &[Rollout], engine: Engine) -> usize {
    let settings = BatchSettings { level: SimdLevel::best(), end_at_rest: true };
    let all =
        Simulator::new(engine).settings(settings).map(rollouts, |_, t| t.solved()).expect("legal scenes");
    all.into_iter().filter(|s| *s).count()
}

/// Value of a field in `/proc/self/status`, MB.
fn resident(what: &str) -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with(what))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1e3)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
