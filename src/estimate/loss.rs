//! Losses of parameter samples on trials, with exact racing.
//!
//! The loss of a sample is the mean of [`TrialSegment::loss`] over segments. Terms are non-negative, so a
//! sample whose partial sum exceeds the worst total of as many completed samples as there are elites cannot
//! become an elite: [`Racing::On`] drops it without changing the result. Sums run over trials in a fixed order,
//! so elites and everything computed from them are bit-identical with racing on or off.

use crate::error::Result;
use crate::progress::Progress;
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::{Engine, Latents, ParameterSpace, ParameterVector, Rollout, Simulator};

use super::segment::TrialSegment;

/// The simulation that is compared with the trials.
#[derive(Clone, Copy)]
pub struct Simulation<'a> {
    /// Physics engine.
    pub engine: Engine,
    /// Effects in addition to the scene's, before a sample's values are applied.
    pub effects: &'a [EffectTerm],
    /// Coordinates of a sample.
    pub coordinates: &'a ParameterSpace,
}

/// Whether samples that cannot become elites are dropped early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Racing {
    /// Drop samples that cannot be among the best `elites`.
    On { elites: usize },
    /// Complete every sample.
    Off,
}

/// Losses of samples and their simulation cost.
#[derive(Clone, Debug)]
pub struct Losses {
    /// (n_samples,) mean squared residual per trial, m^2; infinite for dropped samples.
    pub values: Vec<f64>,
    /// Number of simulated rollouts.
    pub rollouts: u64,
}

/// Minimum number of segments per racing stage, and maximum number of stages.
const MIN_SEGMENTS_PER_STAGE: usize = 3;
const MAX_RACING_STAGES: usize = 16;
/// Rollouts per engine batch, between two progress reports.
const ROLLOUTS_PER_BATCH: usize = 2048;

/// Loss of every sample: the mean over segments.
pub fn segment_losses(
    samples: &[ParameterVector],
    segments: &[TrialSegment],
    simulation: Simulation,
    racing: Racing,
    progress: &dyn Progress,
) -> Result<Losses> {
    let physics = sample_physics(samples, simulation);
    let all: Vec<usize> = (0..samples.len()).collect();
    let mut sums = vec![0.0; samples.len()];
    let mut rollouts = 0;
    let total = (samples.len() * segments.len()) as u64;
    let mut advance = |samples_left: &[usize], from: usize, to: usize, sums: &mut [f64]| -> Result<()> {
        // Segments in order, so that every sample's sum grows in the same order.
        let pairs: Vec<(usize, usize)> = (from..to)
            .flat_map(|segment| samples_left.iter().map(move |sample| (segment, *sample)))
            .collect();
        for part in pairs.chunks(simulation.engine.batch_size(ROLLOUTS_PER_BATCH)) {
            progress.report("simulating samples", rollouts, total)?;
            let batch: Vec<Rollout> =
                part.iter().map(|(p, s)| rollout(&segments[*p].scene, &physics[*s])).collect();
            let residuals = Simulator::new(simulation.engine)
                .budget(&progress)
                .map(&batch, |i, t| segments[part[i].0].loss(&t))?;
            part.iter().zip(residuals).for_each(|((_, s), r)| sums[*s] += r);
            rollouts += part.len() as u64;
        }
        Ok(())
    };
    let stage = MIN_SEGMENTS_PER_STAGE.max(segments.len() / MAX_RACING_STAGES);
    let mut running = all;
    match racing {
        Racing::Off => advance(&running, 0, segments.len(), &mut sums)?,
        Racing::On { elites } => {
            let first = stage.min(segments.len());
            advance(&running, 0, first, &mut sums)?;
            // The likely elites are completed first: their worst total bounds the true threshold from above.
            running.sort_by(|a, b| sums[*a].total_cmp(&sums[*b]).then(a.cmp(b)));
            let rest = running.split_off(elites.min(running.len()));
            advance(&running, first, segments.len(), &mut sums)?;
            let threshold = running.iter().map(|s| sums[*s]).fold(0.0, f64::max);
            running = rest;
            let mut at = first;
            while at < segments.len() && !running.is_empty() {
                let (remaining, dropped): (Vec<_>, Vec<_>) =
                    running.into_iter().partition(|s| sums[*s] <= threshold);
                dropped.into_iter().for_each(|s| sums[s] = f64::INFINITY);
                running = remaining;
                let next = (at + stage).min(segments.len());
                advance(&running, at, next, &mut sums)?;
                at = next;
            }
        }
    }
    let n = segments.len().max(1) as f64;
    Ok(Losses { values: sums.into_iter().map(|s| s / n).collect(), rollouts })
}

/// [`TrialSegment::residuals`] of every sample on every segment: `[sample][segment]`.
pub fn segment_residuals(
    samples: &[ParameterVector],
    segments: &[TrialSegment],
    simulation: Simulation,
    stage: &str,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Vec<f64>>>> {
    let physics = sample_physics(samples, simulation);
    let mut rows = vec![Vec::with_capacity(segments.len()); samples.len()];
    let together = (simulation.engine.batch_size(ROLLOUTS_PER_BATCH) / samples.len().max(1)).max(1);
    for (k, part) in segments.chunks(together).enumerate() {
        progress.report(stage, (k * together) as u64, segments.len() as u64)?;
        let batch: Vec<Rollout> = part
            .iter()
            .flat_map(|p| physics.iter().map(|parameters| rollout(&p.scene, parameters)))
            .collect();
        let residuals = Simulator::new(simulation.engine)
            .budget(&progress)
            .map(&batch, |i, t| part[i / samples.len()].residuals(&t))?;
        residuals.into_iter().enumerate().for_each(|(i, v)| rows[i % samples.len()].push(v));
    }
    Ok(rows)
}

/// Latents and effects of each sample.
fn sample_physics(samples: &[ParameterVector], simulation: Simulation) -> Vec<(Latents, Vec<EffectTerm>)> {
    let all = simulation.coordinates;
    samples.iter().map(|s| (all.latents(s), all.effects(s, simulation.effects))).collect()
}

fn rollout<'a>(scene: &'a Scene, (latents, effects): &'a (Latents, Vec<EffectTerm>)) -> Rollout<'a> {
    Rollout { latents: *latents, effects, stop_at_goal: false, ..Rollout::of(scene) }
}
