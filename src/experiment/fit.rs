//! A round's fit, and the report's last word on it.

use super::choice::Choice;
use super::config::{EstimateConfig, ResidualKind};
use super::report::{EstimateReport, Stopped};
use crate::error::Result;
use crate::estimate::fitness::{Racing, Simulation, losses_on};
use crate::estimate::interval::intervals;
use crate::estimate::shooting::stretches;
use crate::estimate::{Cem, Field, Piece, Refined, refine, told};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng;
use crate::world::latent::FACTORS;
use crate::world::{Coordinates, Sample};

/// What a round's fit found.
pub(super) struct Fitted {
    /// The least loss seen, m^2 per trajectory.
    pub residual: f64,
    /// The estimate, if the configuration has it refined.
    pub refined: Option<Sample>,
    /// Rollouts spent.
    pub rollouts: u64,
}

/// Steps of refining after a round, and for the report, which starts where the last round ended.
const STEPS: [usize; 2] = [10, 5];
/// Times that trials are cut and refined on in a round, for the residual `shooting`.
const LOOKS: usize = 3;
/// Reach, as a share of the prior's deviation, with which a refined estimate is refined again.
const AGAIN: f64 = 0.02;

/// One round's iterations of the search, then refining from where it stands and from the estimate `before`.
pub(super) fn fit_round(
    cem: &mut Cem,
    before: Option<&Sample>,
    trials: &[Trial],
    config: &EstimateConfig,
    round: usize,
    progress: &dyn Progress,
) -> Result<Fitted> {
    let coordinates = config.cem.coordinates();
    let simulation = simulation(config, &coordinates);
    let reference = before.cloned().unwrap_or_else(|| cem.estimate());
    let (mut pieces, mut rollouts) = cut(&reference, trials, config, simulation, progress)?;
    let mut stream = rng::stream(rng::derive(config.seed, "search", round as u64), "cem");
    let (mut residual, mut best) = (f64::INFINITY, cem.estimate());
    for _ in 0..config.cem.iterations {
        let samples = cem.ask(&mut stream);
        let racing = if config.racing { Racing::On { elites: cem.elites() } } else { Racing::Off };
        let scored = losses_on(&samples, &pieces, simulation, racing, progress)?;
        rollouts += scored.rollouts;
        for (sample, loss) in samples.iter().zip(&scored.values) {
            if *loss < residual {
                (residual, best) = (*loss, sample.clone());
            }
        }
        cem.tell(&samples, &scored.values);
    }
    if !config.refine {
        return Ok(Fitted { residual, refined: None, rollouts });
    }
    let near: Sample = config.cem.deviations().iter().map(|sd| AGAIN * sd).collect();
    let mut starts = vec![(cem.estimate(), cem.deviations()), (best, near.clone())];
    starts.extend(before.map(|b| (b.clone(), near.clone())));
    let (mut told, mut found): (Vec<bool>, Option<Refined>) = (Vec::new(), None);
    // Stretches are cut as seen from an estimate, so a better one is worth another look.
    let looks = if config.residual == ResidualKind::Shooting { LOOKS } else { 1 };
    for look in 0..looks {
        let from = found.as_ref().map_or_else(|| cem.estimate(), |f| f.estimate.clone());
        if config.residual == ResidualKind::Shooting {
            let (again, cost) = cut(&from, trials, config, simulation, progress)?;
            pieces = again;
            rollouts += cost;
        }
        let (field, cost) = field(&from, config, &pieces, simulation, progress)?;
        rollouts += cost;
        told.clone_from(&field.told);
        if look > 0 {
            starts = vec![(from, near.clone())];
            found = None;
        }
        for (start, reach) in &starts {
            let refined = refine(start, reach, &field, &pieces, simulation, STEPS[0], progress)?;
            rollouts += refined.rollouts;
            if found.as_ref().is_none_or(|f| refined.beats(f)) {
                found = Some(refined);
            }
        }
    }
    // What the trials do not tell stays where the search has it.
    let searched = cem.estimate();
    let refined = found.map(|f| {
        let of = |j: usize| if told[j] { f.estimate[j] } else { searched[j] };
        (0..searched.len()).map(of).collect()
    });
    Ok(Fitted { residual, refined, rollouts })
}

/// What a search has gathered when it ends.
pub(super) struct Found {
    pub residuals: Vec<f64>,
    pub estimates: Vec<Sample>,
    pub choices: Vec<Choice>,
    pub rollouts: u64,
    pub real_interactions: u64,
    pub stopped: Stopped,
}

/// Adds intervals to what was found.
pub(super) fn report_on(
    estimate: &Sample,
    spread: &Sample,
    trials: &[Trial],
    config: &EstimateConfig,
    found: Found,
    progress: &dyn Progress,
) -> Result<EstimateReport> {
    let coordinates = config.cem.coordinates();
    let simulation = simulation(config, &coordinates);
    let (pieces, cut_cost) = cut(estimate, trials, config, simulation, progress)?;
    let (field, cost) = field(estimate, config, &pieces, simulation, progress)?;
    let again = || field.prior.iter().map(|sd| AGAIN * sd).collect();
    let reach: Sample = if config.refine { again() } else { spread.clone() };
    let refined = refine(estimate, &reach, &field, &pieces, simulation, STEPS[1], progress)?;
    let mut latents = intervals(estimate, &refined, &field, &coordinates);
    let effects = latents.split_off(FACTORS.len());
    Ok(EstimateReport {
        latents,
        effects,
        residuals: found.residuals,
        estimates: found.estimates,
        choices: found.choices,
        real_interactions: found.real_interactions,
        rollouts: found.rollouts + cut_cost + cost + refined.rollouts,
        stopped: found.stopped,
        seconds: None,
        strategy: config.strategy.clone(),
        seed: config.seed,
        config: config.clone(),
        version: env!("CARGO_PKG_VERSION").into(),
    })
}

/// What the trials are compared with the simulation by, seen from `reference`; and the rollouts it took.
fn cut(
    reference: &Sample,
    trials: &[Trial],
    config: &EstimateConfig,
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(Vec<Piece>, u64)> {
    match config.residual {
        ResidualKind::Trajectory => Ok((Piece::whole(trials), 0)),
        ResidualKind::Shooting => stretches(trials, reference, &all(config), simulation, progress),
    }
}

/// Where the latents may lie, and which of them the pieces tell; and the rollouts it took.
fn field(
    estimate: &Sample,
    config: &EstimateConfig,
    pieces: &[Piece],
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(Field, u64)> {
    let mut field = all(config);
    let (told, cost) = told(estimate, &field, pieces, simulation, progress)?;
    field.told = told;
    Ok((field, cost))
}

/// Where the coordinates may lie, all of them open.
fn all(config: &EstimateConfig) -> Field {
    let (prior, limits) = (config.cem.deviations(), config.cem.limits());
    Field { told: vec![true; prior.len()], prior, limits }
}

/// The simulation that the trials are compared with.
pub(super) fn simulation<'a>(config: &'a EstimateConfig, coordinates: &'a Coordinates) -> Simulation<'a> {
    Simulation { engine: config.engine, effects: &config.effects, coordinates }
}
