//! `iplw estimate`: the latent factors of a hidden world.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use iplw::discover;
use iplw::discover::posterior::{Document, PosteriorConfig};
use iplw::error::{Error, Result};
use iplw::experiment::surface;
use iplw::experiment::{EstimateConfig, EstimateReport, Memory, ResidualKind, Sense, estimate_with, ways};
use iplw::explore::Importance;
use iplw::reality::{HiddenWorld, Trial, settled, standard};
use iplw::task::{DEFAULT_FAMILY, Family, Scene, Split, split};
use iplw::world::DRAG;
use iplw::world::{EffectParameter, Engine};

use super::{output, parse, posterior};

/// Explores in simulation by a strategy, spends the chosen actions on the hidden world, fits the latents by the
/// cross-entropy method, and repeats.
#[derive(clap::Args)]
pub struct Args {
    /// A family, or one task such as bowling:017.
    #[arg(long, default_value = DEFAULT_FAMILY)]
    task: String,
    /// The hidden world, over the family's own: `damping=0.8,density=..,friction=..,restitution=..,noise=..`.
    #[arg(long, default_value = "")]
    real: String,
    /// collisions, rolling, random, mixed, gradient or informative, by candidates simulated at the estimate; or, of what is drawn as known,
    /// probing (what tells most of latents and parameters) or success (what tells most of whether plans work), a minute a round.
    #[arg(long, default_value = "mixed")]
    strategy: String,
    /// A performance surface that `iplw surface` wrote: `gradient` takes its shares from it (and finds one itself if
    /// none is given), `informative` weighs the latents by it.
    #[arg(long)]
    surface: Option<PathBuf>,
    /// `fast`: small smoothed iterations on all trials; `paper`: 1000 samples, 200 elites, once a round.
    #[arg(long, default_value = "fast")]
    preset: String,
    /// Most rounds; the preset's if not given.
    #[arg(long)]
    rounds: Option<usize>,
    /// Real interactions a round; the preset's if not given.
    #[arg(long)]
    actions: Option<usize>,
    /// Most real interactions in all.
    #[arg(long)]
    budget: Option<u64>,
    /// Samples per iteration of the search; the preset's if not given.
    #[arg(long)]
    samples: Option<usize>,
    /// Which trials a round is fitted to: all or last_round; the preset's if not given.
    #[arg(long)]
    memory: Option<String>,
    /// trajectory: every sample is simulated from start to end; shooting: anew from what was observed, a stretch at
    /// a time.
    #[arg(long, default_value = "trajectory")]
    residual: String,
    /// What is known of a latent beforehand, `restitution>0.5` or `friction<floor`; may be given several times.
    #[arg(long)]
    sense: Vec<String>,
    /// Give the simulation an effect and fit a parameter of it along, `quadratic_drag.k`; may be given several times.
    /// `iplw effects` lists them.
    #[arg(long)]
    fit: Vec<String>,
    /// Short for `--fit linear_drag.c`.
    #[arg(long)]
    fit_drag: bool,
    /// Simulate every sample to the end, to see what dropping hopeless ones saves.
    #[arg(long)]
    no_racing: bool,
    /// Engine of the simulation.
    #[arg(long, default_value = "auto")]
    engine: String,
    /// Also draw what is known from the posterior given the trials, latents and the parameters of --fit, into this directory:
    /// posterior.json and report.html, as `iplw posterior` writes them.
    #[arg(long, value_name = "DIR")]
    posterior: Option<PathBuf>,
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> Result<()> {
    let (tasks, family) = parse::tasks(&args.task)?;
    let mut config = match args.preset.as_str() {
        "fast" => EstimateConfig::fast(family.prior),
        "paper" => EstimateConfig::paper(family.prior),
        other => return Err(Error::input("--preset", format!("{other:?}"), "fast or paper")),
    };
    config.strategy = args.strategy.clone();
    config.rounds = args.rounds.unwrap_or(config.rounds);
    config.actions = args.actions.unwrap_or(config.actions);
    config.candidates = config.candidates.max(config.actions * 10);
    if let Some(samples) = args.samples {
        config.cem.elites = (samples * config.cem.elites / config.cem.samples).max(2);
        config.cem.samples = samples;
    }
    config.memory = match args.memory.as_deref() {
        None => config.memory,
        Some("all") => Memory::All,
        Some("last_round") => Memory::LastRound,
        Some(other) => return Err(Error::input("--memory", format!("{other:?}"), "all or last_round")),
    };
    if args.fit_drag {
        config.cem.fit_along(DRAG);
    }
    for name in &args.fit {
        config.cem.fit_along(EffectParameter::parse(name)?);
    }
    config.residual = ResidualKind::from_name(&args.residual)?;
    config.senses = args.sense.iter().map(|s| Sense::parse(s)).collect::<Result<_>>()?;
    config.racing = !args.no_racing;
    config.engine = Engine::from_name(&args.engine)?;
    config.seed = args.seed;
    config.validate()?;
    args.posterior.as_ref().map_or(Ok(()), |out| output::directory("--posterior", out))?;
    let mut hidden = parse::real(&args.real, standard(family))?;
    (hidden.budget, hidden.seed) = (args.budget, args.seed);
    let mut world = HiddenWorld::new(hidden)?;
    let training = if tasks.len() > 1 { split(&tasks, Split::Train) } else { tasks };
    let bar = output::Bar::new();
    let started = Instant::now();
    let importance = importance(args, family, &bar)?;
    let (mut report, trials) = estimate_with(&training, &mut world, &config, importance, &bar)?;
    report.seconds = Some(started.elapsed().as_secs_f64());
    let known =
        args.posterior.as_ref().map(|out| Ok((out, known(&training[0].scene, trials, &config, &bar)?)));
    let known = known.transpose()?;
    bar.clear();
    if let Some((out, document)) = &known {
        posterior::write(out, document)?;
    }
    if args.json {
        let text = serde_json::to_string_pretty(&report).map_err(|e| Error::Failed(e.to_string()))?;
        return output::print(&(text + "\n"));
    }
    let known = known.map_or(String::new(), |(out, d)| posterior::told(out, &d));
    output::print(&(table(&report) + &known))
}

/// Draws from the posterior of what was estimated, given the trials that it was estimated from.
fn known(scene: &Scene, trials: Vec<Trial>, config: &EstimateConfig, bar: &output::Bar) -> Result<Document> {
    let (scene, trials) = settled(scene, trials)?;
    let wanted = PosteriorConfig {
        sets: vec![config.cem.effects_fitted()],
        prior: config.cem.prior,
        engine: config.engine,
        ..PosteriorConfig::standard(config.seed)
    };
    Ok(Document::new(&discover::posterior::posterior(&scene, &trials, &wanted, bar)?, &wanted))
}

/// The surface beside the estimation: the file's, or the cheap one where the strategy cannot do without.
fn importance(args: &Args, family: &Family, bar: &output::Bar) -> Result<Option<Arc<dyn Importance>>> {
    if let Some(path) = &args.surface {
        return Ok(Some(Arc::new(super::surface::read(path, family)?)));
    }
    if !ways::needs_importance(&args.strategy)? {
        return Ok(None);
    }
    Ok(Some(Arc::new(surface::quick(family, bar)?)))
}

/// The report for people.
fn table(report: &EstimateReport) -> String {
    let mut text = String::from("latent         estimate   95 % interval\n");
    for l in report.latents.iter().chain(&report.effects) {
        let interval = match l.ci95 {
            [Some(low), Some(high)] if l.identifiable => format!("{low:.3} to {high:.3}"),
            _ => "cannot be identified from such trials".to_string(),
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
