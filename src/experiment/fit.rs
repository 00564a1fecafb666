//! A round's fit, and the report's last word on it.

use super::config::EstimateConfig;
use super::report::{EstimateReport, Stopped};
use super::workflow::Choice;
use crate::error::Result;
use crate::estimate::cem::Sample;
use crate::estimate::fitness::{Racing, Simulation, losses_on};
use crate::estimate::interval::intervals;
use crate::estimate::{Cem, Field, Piece, Refined, refine, told};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng;

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
/// Reach, as a share of the prior's deviation, with which a refined estimate is refined again.
const AGAIN: f64 = 0.02;

/// One round's iterations of the search, then refining from where it stands and from the estimate `before`.
pub(super) fn fit_round(
    cem: &mut Cem,
    before: Option<Sample>,
    trials: &[Trial],
    config: &EstimateConfig,
    round: usize,
    progress: &dyn Progress,
) -> Result<Fitted> {
    let simulation = Simulation { engine: config.engine, effects: &[] };
    let pieces = Piece::whole(trials);
    let mut stream = rng::stream(rng::derive(config.seed, "search", round as u64), "cem");
    let (mut residual, mut rollouts, mut best) = (f64::INFINITY, 0, cem.estimate());
    for _ in 0..config.cem.iterations {
        let samples = cem.ask(&mut stream);
        let racing = if config.racing { Racing::On { elites: cem.elites() } } else { Racing::Off };
        let scored = losses_on(&samples, &pieces, simulation, racing, progress)?;
        rollouts += scored.rollouts;
        for (sample, loss) in samples.iter().zip(&scored.values) {
            if *loss < residual {
                (residual, best) = (*loss, *sample);
            }
        }
        cem.tell(&samples, &scored.values);
    }
    if !config.refine {
        return Ok(Fitted { residual, refined: None, rollouts });
    }
    let (field, cost) = field(cem.estimate(), config, &pieces, simulation, progress)?;
    rollouts += cost;
    let near = field.prior.map(|sd| AGAIN * sd);
    let starts = [Some((cem.estimate(), cem.deviations())), Some((best, near)), before.map(|b| (b, near))];
    let mut found: Option<Refined> = None;
    for (start, reach) in starts.into_iter().flatten() {
        let refined = refine(start, reach, &field, &pieces, simulation, STEPS[0], progress)?;
        rollouts += refined.rollouts;
        if found.as_ref().is_none_or(|f| refined.beats(f)) {
            found = Some(refined);
        }
    }
    // What the trials do not tell stays where the search has it.
    let refined =
        found.map(|f| std::array::from_fn(|j| if field.told[j] { f.estimate[j] } else { cem.estimate()[j] }));
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
    estimate: Sample,
    spread: Sample,
    trials: &[Trial],
    config: &EstimateConfig,
    found: Found,
    progress: &dyn Progress,
) -> Result<EstimateReport> {
    let simulation = Simulation { engine: config.engine, effects: &[] };
    let pieces = Piece::whole(trials);
    let (field, cost) = field(estimate, config, &pieces, simulation, progress)?;
    let reach = if config.refine { field.prior.map(|sd| AGAIN * sd) } else { spread };
    let refined = refine(estimate, reach, &field, &pieces, simulation, STEPS[1], progress)?;
    let mut latents = intervals(estimate, &refined, &field);
    let effects = latents.split_off(3);
    Ok(EstimateReport {
        latents,
        effects,
        residuals: found.residuals,
        estimates: found.estimates,
        choices: found.choices,
        real_interactions: found.real_interactions,
        rollouts: found.rollouts + cost + refined.rollouts,
        stopped: found.stopped,
        seconds: None,
        strategy: config.strategy.clone(),
        seed: config.seed,
        config: config.clone(),
        version: env!("CARGO_PKG_VERSION").into(),
    })
}

/// Where the latents may lie, and which of them the pieces tell; and the rollouts it took.
fn field(
    estimate: Sample,
    config: &EstimateConfig,
    pieces: &[Piece],
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(Field, u64)> {
    let prior = config.cem.start().map(|p| p.1);
    let mut field = Field { prior, limits: config.cem.limits(), told: [true; 4] };
    let (told, cost) = told(estimate, &field, pieces, simulation, progress)?;
    field.told = told;
    Ok((field, cost))
}
