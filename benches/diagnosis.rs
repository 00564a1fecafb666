//! Duration of a diagnosis of 14 trials with 70 observations each, for every single flight effect of the library and every pair in
//! the hidden worlds: median and maximum.
//! `cargo bench --bench diagnosis`

#[path = "../tests/discover_worlds/mod.rs"]
#[allow(dead_code, reason = "shared with others, which use the rest")]
mod worlds;

use std::time::Instant;

use iplw::inference::{DiagnosisConfig, diagnose};
use iplw::progress::NoProgress;
use worlds::{DOUBLES, HiddenForce, Noise, SINGLES};

const TRIALS: usize = 14;
const OBSERVATIONS: usize = 70;
/// Path shift, in standard deviations of the noise.
const SHIFT: f64 = 8.0;

fn main() -> Result<(), iplw::error::Error> {
    let single = (0..SINGLES).map(|k| worlds::single(k, 11));
    let double = (0..DOUBLES).map(|k| worlds::double(k, 11));
    let outside = (0..worlds::OUTSIDE.len()).map(|k| worlds::outside(k, 11));
    time("nothing hidden", [worlds::no_effect()].into_iter())?;
    time("one effect", single)?;
    time("two effects", double)?;
    time("outside the library", outside)
}

fn time(what: &str, all: impl Iterator<Item = HiddenForce>) -> Result<(), iplw::error::Error> {
    let mut seconds = Vec::new();
    for hidden in all {
        let trials = worlds::trials(&hidden, Noise::White, TRIALS, OBSERVATIONS, SHIFT, 11);
        let start = Instant::now();
        let found = diagnose(&worlds::scene(), &trials, &DiagnosisConfig::standard(1), &NoProgress)?;
        let taken = start.elapsed().as_secs_f64();
        eprintln!("  {}: {:?} in {taken:.2} s", hidden.names.join(" + "), found.diagnosis.verdict);
        seconds.push(taken);
    }
    seconds.sort_by(f64::total_cmp);
    let (middle, most) = (seconds[seconds.len() / 2], seconds[seconds.len() - 1]);
    println!("{what}: {} diagnoses, median {middle:.2} s, slowest {most:.2} s", seconds.len());
    Ok(())
}
