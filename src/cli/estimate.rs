//! `iplw estimate`: estimation of the latent factors of a hidden world.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use iplw::commands::EstimationRequest;
use iplw::error::{Error, Result};
use iplw::experiment::surface;
use iplw::experiment::{EstimateConfig, EstimateReport, Memory, OrderConstraint, acquisition, estimate_with};
use iplw::explore::Importance;
use iplw::inference;
use iplw::inference::posterior::{PosteriorConfig, PosteriorDocument};
use iplw::reality::{HiddenWorld, Trial, with_trial_settings};
use iplw::task::{Family, Scene, Split, split};
use iplw::world::{Engine, LINEAR_DRAG};

use super::measure::write_trials;
use super::{output, parse, posterior};

/// Estimate the latent factors of a hidden world.
///
/// Repeats three steps: choose actions in simulation by a strategy, execute them in the hidden world, and fit the latents by the
/// cross-entropy method.
#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    request: EstimationRequest,
    /// Hidden world: damping=0.8,density=..,friction=..,restitution=..,noise=.. [default: the family's]
    #[arg(long, default_value = "")]
    real: String,
    /// Performance surface of `iplw surface`, for gradient and informative [default: computed if needed]
    #[arg(long)]
    surface: Option<PathBuf>,
    /// Preset: fast (small smoothed iterations on all trials) or paper (1000 samples, 200 elites, once a round).
    #[arg(long, default_value = "fast")]
    preset: String,
    /// Trials used for fitting: all or last_round [default: the preset's]
    #[arg(long)]
    memory: Option<String>,
    /// Prior constraint on a latent, such as restitution>0.5 or friction<floor; may be repeated.
    #[arg(long)]
    sense: Vec<String>,
    /// Short for --fit linear_drag.c.
    #[arg(long)]
    fit_drag: bool,
    /// Simulate all samples to the end instead of dropping hopeless ones early.
    #[arg(long)]
    no_racing: bool,
    /// Physics engine: auto, rapier, lanes or gpu.
    #[arg(long, default_value = "auto")]
    engine: String,
    /// Also sample the posterior given the trials, and save it as `iplw posterior` does [default: no]
    #[arg(long, value_name = "DIR")]
    save_posterior: Option<PathBuf>,
    /// Also write the measured trials and their scene, as `iplw measure` does, for example for `iplw diagnose` [default: no]
    #[arg(long, value_name = "DIR")]
    save_trials: Option<PathBuf>,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<()> {
    let (tasks, family) = parse::tasks(&args.request.task)?;
    let mut config = match args.preset.as_str() {
        "fast" => EstimateConfig::fast(family.prior),
        "paper" => EstimateConfig::paper(family.prior),
        other => return Err(Error::input("--preset", format!("{other:?}"), "fast or paper")),
    };
    if let Some(name) = &args.memory {
        let allowed = "all or last_round";
        config.memory =
            Memory::named(name).ok_or_else(|| Error::input("--memory", format!("{name:?}"), allowed))?;
    }
    if args.fit_drag {
        config.cem.add_free_parameter(LINEAR_DRAG);
    }
    config.senses = args.sense.iter().map(|s| OrderConstraint::parse(s)).collect::<Result<_>>()?;
    config.racing = !args.no_racing;
    config.engine = Engine::from_name(&args.engine)?;
    let config = args.request.config(config)?;
    for (option, out) in [("--save-posterior", &args.save_posterior), ("--save-trials", &args.save_trials)] {
        out.as_ref().map_or(Ok(()), |out| output::prepare_directory(option, out))?;
    }
    let mut hidden = parse::real(&args.real, family)?;
    (hidden.budget, hidden.seed) = (args.request.budget, config.seed);
    let mut world = HiddenWorld::new(hidden)?;
    let training = if tasks.len() > 1 { split(&tasks, Split::Train) } else { tasks };
    let bar = output::TerminalProgress::new();
    let started = Instant::now();
    let importance = importance(args, &config, family, &bar)?;
    let (mut report, trials) = estimate_with(&training, &mut world, &config, importance, &bar)?;
    report.seconds = Some(started.elapsed().as_secs_f64());
    if let Some(out) = &args.save_trials {
        write_trials(out, &training[0].scene, trials.clone())?;
    }
    let known = args
        .save_posterior
        .as_ref()
        .map(|out| Ok((out, posterior_document(&training[0].scene, trials, &config, &bar)?)));
    let known = known.transpose()?;
    bar.clear();
    if let Some((out, document)) = &known {
        posterior::write(out, document)?;
    }
    if args.json {
        return output::print(&output::pretty_json(&report)?);
    }
    let known = known.map_or(String::new(), |(out, d)| posterior::summary_with_path(out, &d));
    output::print(&(table(&report) + &fit_text(&report, args.save_trials.as_deref()) + &known))
}

/// Posterior samples of the estimated parameters, given the trials of the estimation.
fn posterior_document(
    scene: &Scene,
    trials: Vec<Trial>,
    config: &EstimateConfig,
    bar: &output::TerminalProgress,
) -> Result<PosteriorDocument> {
    let (scene, trials) = with_trial_settings(scene, trials)?;
    let posterior_config = PosteriorConfig {
        sets: vec![config.cem.free_effects()],
        prior: config.cem.prior,
        engine: config.engine,
        ..PosteriorConfig::standard(config.seed)
    };
    Ok(PosteriorDocument::new(
        &inference::posterior::posterior(&scene, &trials, &posterior_config, bar)?,
        &posterior_config,
    ))
}

/// The performance surface: from the file, or a quick one if the strategy needs it.
fn importance(
    args: &Args,
    config: &EstimateConfig,
    family: &Family,
    bar: &output::TerminalProgress,
) -> Result<Option<Arc<dyn Importance>>> {
    if let Some(path) = &args.surface {
        return Ok(Some(Arc::new(super::surface::read(path, family)?)));
    }
    if !acquisition::needs_importance(&config.strategy)? {
        return Ok(None);
    }
    Ok(Some(Arc::new(surface::quick(family, bar)?)))
}

/// The quality of the fit, and the next command after a bad one.
fn fit_text(report: &EstimateReport, trials: Option<&Path>) -> String {
    let Some(fit) = &report.fit else { return String::new() };
    let bad = fit.adequate == Some(false);
    let next = match trials.map(Path::display) {
        _ if !bad => String::new(),
        Some(dir) => format!(
            "next: iplw diagnose --scene {dir}/scene.json --trials {dir}/trials.csv --out {dir}/diagnosis\n"
        ),
        None => "next: repeat with --save-trials DIR, then \
                 iplw diagnose --scene DIR/scene.json --trials DIR/trials.csv --out DIR/diagnosis\n"
            .into(),
    };
    format!("fit: {}\n{next}", fit.text)
}

/// The report as text.
fn table(report: &EstimateReport) -> String {
    let flag = if report.has_bad_fit() { " (ignores the misfit)" } else { "" };
    let mut text = format!("latent         estimate   95 % interval{flag}\n");
    for l in report.latents.iter().chain(&report.effects) {
        let interval = match l.ci95 {
            [Some(low), Some(high)] if l.identifiable => format!("{low:.3} to {high:.3}"),
            _ => "not identifiable from these trials".to_string(),
        };
        text += &format!("{:<13} {:>9.3}   {interval}\n", l.name, l.value);
    }
    let groups: Vec<_> = report.choices.iter().filter_map(|c| c.groups).collect();
    if !groups.is_empty() {
        let shares = groups.iter().map(|g| format!("{}:{}", g.collisions, g.rolling));
        let shares = shares.collect::<Vec<_>>().join(", ");
        text += &format!("actions for collisions : rolling, round by round: {shares}\n");
    }
    text += &format!(
        "{} real interactions, {} simulated rollouts, {:.1} s; ended: {:?}\n",
        report.real_interactions,
        report.rollouts,
        report.seconds.unwrap_or_default(),
        report.stopped
    );
    text
}
