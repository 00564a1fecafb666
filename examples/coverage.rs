//! Coverage of 95 % confidence intervals: many estimations of hidden worlds with random latents, with an otherwise
//! correct simulation.
//!
//! `cargo run --release --example coverage -- [bowling|basketball] [estimations] [noise in m] [trajectory|shooting] [trials]`
//!
//! A calibrated interval contains the true value in 95 of 100 estimations; the sampling range in a run of 100 is 90 to 99.
//! `far off` counts the misses by more than twice the interval's half-width: a few occur by chance, many indicate
//! convergence to a wrong optimum.

use iplw::error::{Error, Result};
use iplw::experiment::{EstimateConfig, ResidualKind, estimate};
use iplw::progress::NoProgress;
use iplw::reality::{HiddenConfig, HiddenWorld, standard};
use iplw::rng;
use iplw::task::{Split, family, split};
use iplw::world::Latents;
use iplw::world::latent::FACTORS;
use rand::RngExt;

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let arg = |i: usize, default: &str| args.get(i).cloned().unwrap_or(default.into());
    let number = |i: usize, default: &str| {
        let text = arg(i, default);
        text.parse::<f64>().map_err(|_| Error::input("argument", text, "a number"))
    };
    let family = family(&arg(0, "basketball"))?;
    let (count, noise, trials) = (number(1, "100")? as u64, number(2, "0.02")?, number(4, "10")? as usize);
    let tasks = split(&family.tasks(), Split::Train);
    let residual = ResidualKind::from_name(&arg(3, "trajectory"))?;
    let (mut held, mut far, mut unknown) = ([0u32; 3], [0u32; 3], [0u32; 3]);
    let (mut widths, mut errors) = (vec![Vec::new(); 3], vec![Vec::new(); 3]);
    for seed in 0..count {
        let mut stream = rng::stream(seed, "truth");
        let mut between = |low: f64, high: f64| low + (high - low) * stream.random::<f64>();
        let truth = [between(0.2, 2.0), between(0.1, 0.9), between(0.2, 0.9)];
        let hidden = HiddenConfig {
            latents: Latents::of(truth),
            effects: Vec::new(),
            noise,
            seed,
            ..standard(family)
        };
        let config = EstimateConfig {
            rounds: 1,
            actions: trials,
            residual,
            seed,
            ..EstimateConfig::fast(family.prior)
        };
        let (report, _) = estimate(&tasks, &mut HiddenWorld::new(hidden)?, &config, &NoProgress)?;
        for (i, found) in report.latents.iter().enumerate() {
            match found.ci95 {
                [Some(low), Some(high)] => {
                    let off = (found.value - truth[i]).abs();
                    held[i] += u32::from((low..=high).contains(&truth[i]));
                    far[i] += u32::from(off > high - low);
                    widths[i].push(high - low);
                    errors[i].push(off);
                    if std::env::var_os("SHOW").is_some() && off > high - low {
                        println!(
                            "  seed {seed}: {} {:.4} [{low:.4}, {high:.4}] for {:.4}",
                            found.name, found.value, truth[i]
                        );
                    }
                }
                _ => unknown[i] += 1,
            }
        }
    }
    println!("{}, {count} estimations of {trials} trials, noise {noise} m, {}", family.name, residual.name());
    println!("latent        coverage   median width   median error   far off   not identified");
    for i in 0..3 {
        let n = count as u32 - unknown[i];
        let share =
            if n > 0 { format!("{:.1} %", 100.0 * f64::from(held[i]) / f64::from(n)) } else { "-".into() };
        println!(
            "{:<12} {share:>9} {:>14.5} {:>14.5} {:>9} {:>16}",
            FACTORS[i].name,
            median(&mut widths[i]),
            median(&mut errors[i]),
            far[i],
            unknown[i]
        );
    }
    Ok(())
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
