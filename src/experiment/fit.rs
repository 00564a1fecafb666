//! Fit of a round, and the report with confidence intervals.

use super::config::{EstimateConfig, ResidualKind};
use super::report::{EstimateReport, StopReason};
use super::selection_summary::SelectionSummary;
use crate::error::Result;
use crate::estimate::interval::confidence_intervals;
use crate::estimate::loss::{Racing, Simulation, segment_losses};
use crate::estimate::shooting::shooting_segments;
use crate::estimate::{Cem, RefinedEstimate, SearchBounds, TrialSegment, identifiable_coordinates, refine};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng;
use crate::world::latent::FACTORS;
use crate::world::{ParameterSpace, ParameterVector};

/// Result of a round's fit.
pub(super) struct RoundFit {
    /// Smallest loss of all samples, m^2 per trajectory.
    pub residual: f64,
    /// Refined estimate, if the configuration requests refinement.
    pub refined: Option<ParameterVector>,
    /// Rollouts simulated.
    pub rollouts: u64,
}

/// Refinement steps after a round, and for the report, which starts at the last round's estimate.
const REFINEMENT_STEPS: [usize; 2] = [10, 5];
/// Repetitions of segmentation and refinement in a round, for the residual `shooting`.
const MAX_RESEGMENTATIONS: usize = 3;
/// Initial search radius of a repeated refinement, as a share of the prior's standard deviation.
const RESTART_SD_SHARE: f64 = 0.02;

/// Runs one round's iterations of the cross-entropy method, then refines its mean, its best sample and the estimate `before`.
pub(super) fn fit_round(
    cem: &mut Cem,
    before: Option<&ParameterVector>,
    trials: &[Trial],
    config: &EstimateConfig,
    round: usize,
    progress: &dyn Progress,
) -> Result<RoundFit> {
    let coordinates = config.cem.coordinates();
    let simulation = simulation(config, &coordinates);
    let reference = before.cloned().unwrap_or_else(|| cem.estimate());
    let (mut pieces, mut rollouts) = segment_trials(&reference, trials, config, simulation, progress)?;
    let mut stream = rng::stream(rng::derive_seed(config.seed, "search", round as u64), "cem");
    let (mut residual, mut best) = (f64::INFINITY, cem.estimate());
    for _ in 0..config.cem.iterations {
        let samples = cem.ask(&mut stream);
        let racing = if config.racing { Racing::On { elites: cem.elites() } } else { Racing::Off };
        let scored = segment_losses(&samples, &pieces, simulation, racing, progress)?;
        rollouts += scored.rollouts;
        for (sample, loss) in samples.iter().zip(&scored.values) {
            if *loss < residual {
                (residual, best) = (*loss, sample.clone());
            }
        }
        cem.tell(&samples, &scored.values);
    }
    if !config.refine {
        return Ok(RoundFit { residual, refined: None, rollouts });
    }
    let near: ParameterVector = config.cem.prior_sd().iter().map(|sd| RESTART_SD_SHARE * sd).collect();
    let mut starts = vec![(cem.estimate(), cem.standard_deviations()), (best, near.clone())];
    starts.extend(before.map(|b| (b.clone(), near.clone())));
    let (mut identified, mut found): (Vec<bool>, Option<RefinedEstimate>) = (Vec::new(), None);
    // The segments depend on the reference estimate, so a better estimate warrants new segments.
    let looks = if config.residual == ResidualKind::Shooting { MAX_RESEGMENTATIONS } else { 1 };
    for look in 0..looks {
        let from = found.as_ref().map_or_else(|| cem.estimate(), |f| f.estimate.clone());
        if config.residual == ResidualKind::Shooting {
            let (segments, cost) = segment_trials(&from, trials, config, simulation, progress)?;
            pieces = segments;
            rollouts += cost;
        }
        let (field, cost) = identifiable_bounds(&from, config, &pieces, simulation, progress)?;
        rollouts += cost;
        identified.clone_from(&field.identifiable);
        if look > 0 {
            starts = vec![(from, near.clone())];
            found = None;
        }
        for (start, reach) in &starts {
            let refined = refine(start, reach, &field, &pieces, simulation, REFINEMENT_STEPS[0], progress)?;
            rollouts += refined.rollouts;
            if found.as_ref().is_none_or(|f| refined.fits_better_than(f)) {
                found = Some(refined);
            }
        }
    }
    // Coordinates that the trials do not identify keep the search's estimate.
    let searched = cem.estimate();
    let refined = found.map(|f| {
        let of = |j: usize| if identified[j] { f.estimate[j] } else { searched[j] };
        (0..searched.len()).map(of).collect()
    });
    Ok(RoundFit { residual, refined, rollouts })
}

/// History of a search when it ends.
pub(super) struct FitHistory {
    pub residuals: Vec<f64>,
    pub estimates: Vec<ParameterVector>,
    pub choices: Vec<SelectionSummary>,
    pub rollouts: u64,
    pub real_interactions: u64,
    pub stopped: StopReason,
}

/// The report of a search, with confidence intervals.
pub(super) fn report_on(
    estimate: &ParameterVector,
    spread: &ParameterVector,
    trials: &[Trial],
    config: &EstimateConfig,
    found: FitHistory,
    progress: &dyn Progress,
) -> Result<EstimateReport> {
    let coordinates = config.cem.coordinates();
    let simulation = simulation(config, &coordinates);
    let (pieces, cut_cost) = segment_trials(estimate, trials, config, simulation, progress)?;
    let (field, cost) = identifiable_bounds(estimate, config, &pieces, simulation, progress)?;
    let restart_radius = || field.prior_sd.iter().map(|sd| RESTART_SD_SHARE * sd).collect();
    let reach: ParameterVector = if config.refine { restart_radius() } else { spread.clone() };
    let refined = refine(estimate, &reach, &field, &pieces, simulation, REFINEMENT_STEPS[1], progress)?;
    let mut latents = confidence_intervals(estimate, &refined, &field, &coordinates);
    let effects = latents.split_off(FACTORS.len());
    Ok(EstimateReport {
        latents,
        effects,
        residuals: found.residuals,
        estimates: found.estimates,
        choices: found.choices,
        real_interactions: found.real_interactions,
        rollouts: found.rollouts + cut_cost + cost + refined.rollouts,
        fit: None,
        stopped: found.stopped,
        seconds: None,
        strategy: config.strategy.clone(),
        seed: config.seed,
        config: config.clone(),
        version: env!("CARGO_PKG_VERSION").into(),
    })
}

/// Segments of the trials for the configured residual, given the estimate `reference`; and the rollouts used.
fn segment_trials(
    reference: &ParameterVector,
    trials: &[Trial],
    config: &EstimateConfig,
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(Vec<TrialSegment>, u64)> {
    match config.residual {
        ResidualKind::Trajectory => Ok((TrialSegment::whole_trials(trials), 0)),
        ResidualKind::Shooting => {
            shooting_segments(trials, reference, &search_bounds(config), simulation, progress)
        }
    }
}

/// Search bounds of the coordinates with those that the segments identify; and the rollouts used.
fn identifiable_bounds(
    estimate: &ParameterVector,
    config: &EstimateConfig,
    pieces: &[TrialSegment],
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(SearchBounds, u64)> {
    let mut field = search_bounds(config);
    let (identified, cost) = identifiable_coordinates(estimate, &field, pieces, simulation, progress)?;
    field.identifiable = identified;
    Ok((field, cost))
}

/// Search bounds with all coordinates marked as identifiable.
fn search_bounds(config: &EstimateConfig) -> SearchBounds {
    let (prior, limits) = (config.cem.prior_sd(), config.cem.limits());
    SearchBounds { identifiable: vec![true; prior.len()], prior_sd: prior, limits }
}

/// The simulation that is fitted to the trials.
pub(super) fn simulation<'a>(config: &'a EstimateConfig, coordinates: &'a ParameterSpace) -> Simulation<'a> {
    Simulation { engine: config.engine, effects: &config.effects, coordinates }
}
