//! `iplw excite`: commands of motors that tell what a simulation of a mechanism lacks.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use iplw::design::{Excitation, ExcitationConfig, ExcitationDesign, ExcitationGoal, design_excitations};
use iplw::error::{Error, Result, check_range};
use iplw::inference::mechanism::parse_effect_in_joint;
use iplw::picture::plot::{Series, lines, panels};
use iplw::task::Scene;
use iplw::world::mechanism::effect::find;
use serde::Deserialize;

use super::compact_json::compact_json;
use super::output;

/// Maximum number of pairs that are printed.
const MAX_PAIRS: usize = 5;

/// Design the commands of motors for the next recording of a mechanism.
///
/// Simulates steps, sweeps of frequency, sums of sines, slow ramps and steps to rest within the motors' limits, and chooses the trials
/// that best discriminate between the effects that the simulation may lack, or that measure their sizes most precisely. Writes commands-1.csv, ... (for `iplw rollout
/// --commands` and the robot), design.json and design.svg.
#[derive(clap::Args)]
#[command(after_long_help = EXAMPLES)]
pub struct Args {
    /// Scene with joints and motors (iplw.scene/2).
    #[arg(long, value_name = "FILE")]
    scene: PathBuf,
    /// Report of `iplw diagnose`: ask about the effects in its sets [default: all effects that the joints can have]
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Discriminate between effects, or measure their sizes precisely.
    #[arg(long, value_enum, default_value = "discriminate")]
    goal: GoalOption,
    /// Number of trials.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=50))]
    trials: u16,
    /// Duration of a trial, s.
    #[arg(long, default_value_t = 5.0)]
    duration: f64,
    /// Standard deviation of measured positions, rad or m.
    #[arg(long, default_value_t = 0.001)]
    noise: f64,
    /// Largest velocity of any joint, rad/s or m/s [default: none]
    #[arg(long, value_name = "VELOCITY")]
    max_velocity: Option<f64>,
    /// Positions that a joint must keep to, rad or m; may be repeated.
    #[arg(long, value_name = "JOINT=LOW..HIGH", value_parser = named_range)]
    position: Vec<(String, [f64; 2])>,
    /// Lowest and highest command of a motor; may be repeated [default: 90 % of the torque limit]
    #[arg(long, value_name = "JOINT=LOW..HIGH", value_parser = named_range, allow_hyphen_values = true)]
    command: Vec<(String, [f64; 2])>,
    /// Seed of the candidates.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Output directory.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

const EXAMPLES: &str = "\
Examples:
  Three trials of five seconds that tell most about a pendulum:
    iplw excite --scene pendulum.json --out next
  One that discriminates between the effects that a diagnosis left open, with the cart within half a metre:
    iplw excite --scene cart.json --report report/report.json --trials 1 --position slide=-0.5..0.5 --out next";

/// [`ExcitationGoal`] on the command line.
#[derive(Clone, Copy, ValueEnum)]
enum GoalOption {
    Discriminate,
    Precision,
}

/// Parses `NAME=LOW..HIGH`.
fn named_range(text: &str) -> std::result::Result<(String, [f64; 2]), String> {
    let parsed = text.split_once('=').and_then(|(name, range)| {
        let (low, high) = range.split_once("..")?;
        Some((name.to_string(), [low.parse::<f64>().ok()?, high.parse::<f64>().ok()?]))
    });
    match parsed {
        Some((name, [low, high])) if low < high && low.is_finite() && high.is_finite() => {
            Ok((name, [low, high]))
        }
        _ => Err("give the name of a joint and two ascending numbers, as hinge=-0.5..0.5".into()),
    }
}

pub fn run(args: &Args) -> Result<()> {
    let text = |path: &Path| std::fs::read_to_string(path).map_err(|e| Error::io(path, e));
    let scene = Scene::from_json(&text(&args.scene)?).map_err(|e| e.in_file(args.scene.display()))?;
    let effects = args.report.as_deref().map_or(Ok(Vec::new()), |path| {
        effects_of_report(&text(path)?).map_err(|e| e.in_file(path.display()))
    })?;
    let config = ExcitationConfig {
        goal: match args.goal {
            GoalOption::Discriminate => ExcitationGoal::Discriminate,
            GoalOption::Precision => ExcitationGoal::Precision,
        },
        trials: args.trials.into(),
        duration: check_range("--duration", args.duration, 0.5, 60.0)?,
        effects,
        noise: check_range("--noise", args.noise, 1e-9, 1.0)?,
        max_velocity: args.max_velocity.map(|v| check_range("--max-velocity", v, 1e-6, 1e6)).transpose()?,
        positions: args.position.clone(),
        commands: args.command.clone(),
        seed: args.seed,
    };
    output::prepare_directory("--out", &args.out)?;
    let bar = output::TerminalProgress::new();
    let design = design_excitations(&scene, &config, &bar)?;
    bar.clear();
    for (k, excitation) in design.excitations.iter().enumerate() {
        output::write_whole(&args.out.join(format!("commands-{}.csv", k + 1)), &commands_csv(excitation)?)?;
    }
    output::write_whole(&args.out.join("design.json"), (compact_json(&design)? + "\n").as_bytes())?;
    output::write_whole(&args.out.join("design.svg"), figure(&design).as_bytes())?;
    output::print(&summary(&design, &args.out))
}

/// The effects in the sets of a report, as (effect, joint).
fn effects_of_report(text: &str) -> Result<Vec<(String, String)>> {
    #[derive(Deserialize)]
    struct Report {
        rivals: Vec<Vec<String>>,
    }
    let report: Report = iplw::json::parse(text)?;
    let mut out: Vec<(String, String)> = Vec::new();
    for name in report.rivals.iter().flatten() {
        let Some((effect, joint)) = parse_effect_in_joint(name) else {
            return Err(Error::input("rivals", name.as_str(), "effects in joints, as `payload (hinge)`"));
        };
        let own = (effect.to_string(), joint.to_string());
        // The resolution of an encoder shows under any commands.
        if !out.contains(&own) && !find(effect)?.is_resolution() {
            out.push(own);
        }
    }
    Ok(out)
}

/// Commands for `iplw rollout --commands`: rows where a command changes.
fn commands_csv(excitation: &Excitation) -> Result<Vec<u8>> {
    let names: Vec<String> =
        excitation.commands.iter().map(|(joint, _)| format!("{joint}.command")).collect();
    let header: Vec<&str> = std::iter::once("t").chain(names.iter().map(String::as_str)).collect();
    let rows = excitation.times.iter().enumerate().map(|(i, t)| {
        let commands = excitation.commands.iter().map(|(_, values)| values[i].to_string());
        std::iter::once(t.to_string()).chain(commands).collect::<Vec<String>>()
    });
    output::csv(&header, rows)
}

/// Commands and simulated positions of each trial.
fn figure(design: &ExcitationDesign) -> String {
    let plots: Vec<String> = design
        .excitations
        .iter()
        .enumerate()
        .flat_map(|(k, own)| {
            let series = |curves: &[(String, Vec<f64>)]| -> Vec<Series> {
                let of = |(name, values): &(String, Vec<f64>)| Series {
                    name: name.clone(),
                    points: own.times.iter().copied().zip(values.iter().copied()).collect(),
                    ..Series::default()
                };
                curves.iter().map(of).collect()
            };
            let title = |of: &str| format!("Trial {} ({}): {of}", k + 1, own.family);
            [
                lines(&title("commands"), "t (s)", "command (N m, N)", &series(&own.commands)),
                lines(&title("simulated positions"), "t (s)", "position (rad, m)", &series(&own.positions)),
            ]
        })
        .collect();
    panels("Excitations", &plots, 2)
}

/// Text for a terminal.
fn summary(design: &ExcitationDesign, out: &Path) -> String {
    let mut text = format!("{} of {} candidates within the limits\n", design.allowed, design.candidates);
    for (k, own) in design.excitations.iter().enumerate() {
        text += &format!("{}. {}: {:.2} nats with the trials before\n", k + 1, own.family, own.score);
    }
    if let (Some(mean), Some(sd)) = (design.random_score, design.random_sd) {
        text += &format!("as many trials of random steps: {mean:.2} +- {sd:.2}\n");
    }
    if !design.hard_pairs.is_empty() {
        text += "hardly discriminated (expected log Bayes factor at half the plausible size):\n";
        for (a, b, factor) in design.hard_pairs.iter().take(MAX_PAIRS) {
            text += &format!("  {a} and {b}: {factor:.2}\n");
        }
        let more = design.hard_pairs.len().saturating_sub(MAX_PAIRS);
        text += &if more > 0 { format!("  and {more} more pairs, in design.json\n") } else { String::new() };
    }
    text + &format!("{}: commands-1.csv, ..., design.json, design.svg\n", out.display())
}
