//! Seconds that a diagnosis of 14 trials of 70 observations takes: every single effect of the library's flights and every
//! pair that the hidden worlds have, the slowest and the middle one.
//! `cargo bench --bench diagnosis`

#[path = "../tests/discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with others, which use the rest")]
mod worlds;

use std::time::Instant;

use iplw::discover::{Config, diagnose};
use iplw::progress::Silent;
use worlds::{DOUBLES, Hidden, Noise, SINGLES};

const TRIALS: usize = 14;
const OBSERVATIONS: usize = 70;
/// Path shift, noise deviations.
const SHIFT: f64 = 8.0;

fn main() -> Result<(), iplw::error::Error> {
    let single = (0..SINGLES).map(|k| worlds::single(k, 11));
    let double = (0..DOUBLES).map(|k| worlds::double(k, 11));
    let outside = (0..worlds::OUTSIDE.len()).map(|k| worlds::outside(k, 11));
    time("nothing hidden", [worlds::nothing()].into_iter())?;
    time("one effect", single)?;
    time("two effects", double)?;
    time("outside the library", outside)
}

fn time(what: &str, all: impl Iterator<Item = Hidden>) -> Result<(), iplw::error::Error> {
    let mut seconds = Vec::new();
    for hidden in all {
        let trials = worlds::trials(&hidden, Noise::White, TRIALS, OBSERVATIONS, SHIFT, 11);
        let start = Instant::now();
        let found = diagnose(&worlds::scene(), &trials, &Config::standard(1), &Silent)?;
        let taken = start.elapsed().as_secs_f64();
        eprintln!("  {}: {:?} in {taken:.2} s", hidden.names.join(" + "), found.diagnosis.verdict);
        seconds.push(taken);
    }
    seconds.sort_by(f64::total_cmp);
    let (middle, most) = (seconds[seconds.len() / 2], seconds[seconds.len() - 1]);
    println!("{what}: {} diagnoses, middle {middle:.2} s, slowest {most:.2} s", seconds.len());
    Ok(())
}
