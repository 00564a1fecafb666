//! How far the batched engine is from what the machine can do:
//! `cargo bench --features levels --bench limits -- [SCENES.jsonl [MOST]]`, MOST being the greatest number of rollouts whose memory is
//! measured (100000).
//!
//! 1. Arithmetic: operations of a step, counted by running the kernel on a register that counts (`Level::Counted`; it
//!    takes the same way through the code as every other level), times steps a second, against the rate at which this
//!    machine multiplies and adds in a loop with nothing else in it, measured in the same run with the same
//!    instructions. Fused multiply-adds would double that rate, but one level would then round unlike another:
//!    bit-identity over levels forbids them. Both limits are printed. Effects are written for single numbers and not
//!    counted: drag takes three products a body and step.
//! 2. Cores: rollouts a second on the wall by number of threads.
//! 3. Memory: peak of a process of its own that simulates so many rollouts and keeps whether each was solved.

mod common;
mod peak;

use std::time::Instant;

use common::{Clock, level_name, rollouts, scenes};
use iplw::task::Scene;
use iplw::world::{Engine, Level, Operations, Rollout, Settings, operations, simulate_map_set};

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
        let steps = run(Level::Counted, &rollouts);
        (operations(), steps)
    });
    let each = |n: u64| n as f64 / steps as f64;
    let Operations { simple, slow, choices, moves } = counted;
    println!("\n== arithmetic, one core, every step simulated");
    println!(
        "a rollout's step takes {:.0} sums, differences and products, {:.1} quotients and roots, {:.0} comparisons and \
         choices, {:.0} numbers moved",
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
    for level in Level::ALL.iter().copied().filter(|l| l.available() && *l != Level::Plain) {
        let clock = Clock::start();
        let rate = pool.install(|| {
            let start = Instant::now();
            run(level, &rollouts);
            // About half a second each time.
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
        // Comparisons and choices take the same units' time as sums and products.
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

/// Simulates every step of every rollout; how many there were.
fn run(level: Level, rollouts: &[Rollout]) -> u64 {
    let settings = Settings { level, end_at_rest: false };
    let steps = simulate_map_set(settings, rollouts, Engine::Lanes, |_, t| u64::from(t.outcome.steps));
    steps.expect("legal scenes").iter().sum()
}

fn cores(scenes: &[Scene]) {
    let rollouts = rollouts(scenes);
    let all = std::thread::available_parallelism().map_or(1, usize::from);
    println!("\n== cores, rollouts a second on the wall, default settings");
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
        "\n== memory, lanes, all cores: peak of a process that keeps only whether each rollout was solved"
    );
    for count in [1000, 10_000, 100_000].into_iter().filter(|n| *n <= most) {
        let mut command = std::process::Command::new(std::env::current_exe().expect("this program's path"));
        let ran = command.arg("--only-simulate").arg(count.to_string()).args(path).output();
        let said = ran.expect("it runs").stdout;
        println!("{count:8} rollouts: {}", String::from_utf8_lossy(&said).trim());
    }
}

/// In the child process: simulates and says how much memory that took.
fn only_simulate(count: usize, scenes: &[Scene]) {
    let own = rollouts(scenes);
    let rollouts: Vec<Rollout> = own.iter().cycle().take(count).copied().collect();
    let before = resident("VmHWM:");
    solved(&rollouts, Engine::Lanes);
    let asked = (size_of::<Rollout>() * count) as f64 / 1e6;
    match (before, resident("VmHWM:")) {
        (Some(before), Some(peak)) => println!(
            "{peak:6.1} MB, {:.1} of it while simulating (the list of what to simulate: {asked:.1} MB)",
            peak - before
        ),
        _ => println!("this system does not tell"),
    }
}

fn solved(rollouts: &[Rollout], engine: Engine) -> usize {
    let settings = Settings { level: Level::best(), end_at_rest: true };
    let all = simulate_map_set(settings, rollouts, engine, |_, t| t.solved()).expect("legal scenes");
    all.into_iter().filter(|s| *s).count()
}

/// MB, as Linux keeps it.
fn resident(what: &str) -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with(what))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1e3)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
