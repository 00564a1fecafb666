//! Candidates: families of commands within the ranges of the motors.

use std::f64::consts::TAU;

use rand::RngExt;

use super::config::ExcitationConfig;
use crate::error::{Error, Result};
use crate::rng::Stream;
use crate::task::joint::{Control, Motor};
use crate::world::mechanism::{Commands, Tree};

/// Rate of commands and of simulated observations, 1/s.
const RATE: f64 = 100.0;
/// Largest command as a share of a motor's torque limit.
const SHARE_OF_LIMIT: f64 = 0.9;

/// A family of commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExcitationFamily {
    Steps,
    Sweep,
    Sines,
    Ramps,
    Releases,
}

/// Every family with its name.
pub const FAMILIES: [(ExcitationFamily, &str); 5] = [
    (ExcitationFamily::Steps, "random steps"),
    (ExcitationFamily::Sweep, "sweep of frequency"),
    (ExcitationFamily::Sines, "sum of sines"),
    (ExcitationFamily::Ramps, "slow ramps"),
    (ExcitationFamily::Releases, "steps to rest"),
];

/// Times of commands and observations of a trial, s.
pub fn sample_times(duration: f64) -> Vec<f64> {
    (0..=(duration * RATE).round() as usize).map(|i| i as f64 / RATE).collect()
}

/// Lowest and highest command by joint; none for a joint without a motor.
pub fn command_ranges(tree: &Tree, config: &ExcitationConfig) -> Result<Vec<Option<[f64; 2]>>> {
    if let Some((unknown, _)) =
        config.commands.iter().chain(&config.positions).find(|(n, _)| tree.joint(n).is_none())
    {
        return Err(Error::not_found("joint", unknown, tree.names.iter().map(String::as_str)));
    }
    let of = |(name, motor): (&String, &Option<Motor>)| {
        let Some(motor) = motor else { return Ok(None) };
        match config.commands.iter().find(|(own, _)| own == name) {
            Some((_, range)) => Ok(Some(*range)),
            None if motor.control == Control::Torque && motor.has_limit() => {
                Ok(Some([-SHARE_OF_LIMIT * motor.max_torque, SHARE_OF_LIMIT * motor.max_torque]))
            }
            None => {
                let allowed = "the lowest and highest command of a motor without `max_torque`, or not commanded by torque";
                Err(Error::input(format!("commands.{name}"), "none", allowed))
            }
        }
    };
    let ranges: Vec<Option<[f64; 2]>> = tree.names.iter().zip(&tree.motors).map(of).collect::<Result<_>>()?;
    match ranges.iter().any(Option::is_some) {
        true => Ok(ranges),
        false => Err(Error::input("motors", "none", "a scene with a motor: excitations are commands")),
    }
}

/// Commands of a family for all motors.
pub fn draw(
    family: ExcitationFamily,
    ranges: &[Option<[f64; 2]>],
    duration: f64,
    stream: &mut Stream,
) -> Commands {
    let times = sample_times(duration);
    let values = ranges.iter().map(|range| match range {
        None => Vec::new(),
        Some([low, high]) => {
            let scale = |share: f64| 0.5 * (low + high) + 0.5 * (high - low) * share.clamp(-1.0, 1.0);
            shares(family, &times, duration, stream).into_iter().map(scale).collect()
        }
    });
    Commands::new(times.clone(), values.collect())
}

/// Commands of one motor, from -1 to 1.
fn shares(family: ExcitationFamily, times: &[f64], duration: f64, stream: &mut Stream) -> Vec<f64> {
    let size: f64 = stream.random_range(0.3..1.0);
    match family {
        ExcitationFamily::Steps | ExcitationFamily::Releases => {
            let is_release = family == ExcitationFamily::Releases;
            let (mut level, mut until, mut rests) = (0.0, 0.0, true);
            let mut value = |t: f64| {
                if t >= until {
                    rests = !rests;
                    level = if is_release && rests { 0.0 } else { stream.random_range(-1.0..1.0) };
                    until = t + stream.random_range(0.1..0.6) * if is_release { 2.0 } else { 1.0 };
                }
                level
            };
            times.iter().map(|t| value(*t)).collect()
        }
        ExcitationFamily::Sweep => {
            let from: f64 = stream.random_range(0.1..0.5);
            let to: f64 = stream.random_range(1.0..6.0);
            let phase = |t: f64| TAU * (from * t + 0.5 * (to - from) * t * t / duration);
            times.iter().map(|t| size * libm::sin(phase(*t))).collect()
        }
        ExcitationFamily::Sines => {
            let waves: [(f64, f64); 5] =
                std::array::from_fn(|_| (stream.random_range(0.2..4.0), stream.random_range(0.0..TAU)));
            let sum = |t: f64| waves.iter().map(|(f, phase)| libm::sin(TAU * f * t + phase)).sum::<f64>();
            times.iter().map(|t| size * sum(*t) / 2.5).collect()
        }
        ExcitationFamily::Ramps => {
            let period: f64 = stream.random_range(0.5..2.0) * duration;
            let start: f64 = stream.random_range(0.0..1.0);
            let triangle = |t: f64| {
                let phase = t / period + start;
                4.0 * (phase - (phase + 0.5).floor()).abs() - 1.0
            };
            times.iter().map(|t| size * triangle(*t)).collect()
        }
    }
}
