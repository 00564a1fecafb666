//! Losses of latent samples against trials, and the racing that skips what cannot matter.
//!
//! The loss of a sample is the mean over trials (or pieces of them) of what [`Piece::loss`] says. Terms are not negative, so a sample
//! whose partial sum already exceeds the worst total among as many completed samples as there are elites can
//! never become an elite: [`Racing::On`] drops it, exactly. Sums run over trials in a fixed order, so elites,
//! and everything computed from them, are the same bits with racing on or off.

use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::{Coordinates, Engine, Latents, Rollout, Sample, simulate_map};

use super::piece::Piece;

/// What the simulation that is compared with the trials is like.
#[derive(Clone, Copy)]
pub struct Simulation<'a> {
    /// Integrating engine.
    pub engine: Engine,
    /// Effects the simulation has beside the scene's own, before a sample's values.
    pub effects: &'a [EffectTerm],
    /// What the numbers of a sample are.
    pub coordinates: &'a Coordinates,
}

/// Whether hopeless samples are dropped early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Racing {
    /// Drop samples that cannot be among this many best.
    On { elites: usize },
    /// Complete every sample.
    Off,
}

/// Losses of samples, and what they cost.
#[derive(Clone, Debug)]
pub struct Losses {
    /// (n_samples,) mean residual per trial, m^2; infinite for dropped samples.
    pub values: Vec<f64>,
    /// Rollouts that were simulated.
    pub rollouts: u64,
}

/// Fewest pieces a race completes between two looks at who may be dropped, and most looks.
const LEG: usize = 3;
const LEGS: usize = 16;
/// Rollouts handed to the engine between two reports of progress.
const CHUNK: usize = 2048;

/// The loss of every sample: the mean over whole trials.
pub fn losses(
    samples: &[Sample],
    trials: &[Trial],
    simulation: Simulation,
    racing: Racing,
    progress: &dyn Progress,
) -> Result<Losses> {
    losses_on(samples, &Piece::whole(trials), simulation, racing, progress)
}

/// The loss of every sample: the mean over pieces.
pub fn losses_on(
    samples: &[Sample],
    pieces: &[Piece],
    simulation: Simulation,
    racing: Racing,
    progress: &dyn Progress,
) -> Result<Losses> {
    let physics = physics_of(samples, simulation);
    let all: Vec<usize> = (0..samples.len()).collect();
    let mut sums = vec![0.0; samples.len()];
    let mut rollouts = 0;
    let total = (samples.len() * pieces.len()) as u64;
    let mut advance = |who: &[usize], from: usize, to: usize, sums: &mut [f64]| -> Result<()> {
        // Piece by piece, so that every sample's sum grows in the same order.
        let pairs: Vec<(usize, usize)> =
            (from..to).flat_map(|piece| who.iter().map(move |sample| (piece, *sample))).collect();
        for part in pairs.chunks(CHUNK) {
            progress.report("simulating samples", rollouts, total)?;
            let batch: Vec<Rollout> =
                part.iter().map(|(p, s)| rollout(&pieces[*p].scene, &physics[*s])).collect();
            let residuals = simulate_map(&batch, simulation.engine, |i, t| pieces[part[i].0].loss(&t))?;
            part.iter().zip(residuals).for_each(|((_, s), r)| sums[*s] += r);
            rollouts += part.len() as u64;
        }
        Ok(())
    };
    let leg = LEG.max(pieces.len() / LEGS);
    let mut running = all;
    match racing {
        Racing::Off => advance(&running, 0, pieces.len(), &mut sums)?,
        Racing::On { elites } => {
            let first = leg.min(pieces.len());
            advance(&running, 0, first, &mut sums)?;
            // The likely elites run to the end first: their worst total bounds the true threshold from above.
            running.sort_by(|a, b| sums[*a].total_cmp(&sums[*b]).then(a.cmp(b)));
            let rest = running.split_off(elites.min(running.len()));
            advance(&running, first, pieces.len(), &mut sums)?;
            let threshold = running.iter().map(|s| sums[*s]).fold(0.0, f64::max);
            running = rest;
            let mut at = first;
            while at < pieces.len() && !running.is_empty() {
                let (hopeful, lost): (Vec<_>, Vec<_>) =
                    running.into_iter().partition(|s| sums[*s] <= threshold);
                lost.into_iter().for_each(|s| sums[s] = f64::INFINITY);
                running = hopeful;
                let next = (at + leg).min(pieces.len());
                advance(&running, at, next, &mut sums)?;
                at = next;
            }
        }
    }
    let n = pieces.len().max(1) as f64;
    Ok(Losses { values: sums.into_iter().map(|s| s / n).collect(), rollouts })
}

/// [`Piece::vector`] of every sample on every piece: `[sample][piece]`.
pub fn vectors(
    samples: &[Sample],
    pieces: &[Piece],
    simulation: Simulation,
    stage: &str,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Vec<f64>>>> {
    let physics = physics_of(samples, simulation);
    let mut rows = vec![Vec::with_capacity(pieces.len()); samples.len()];
    let together = (CHUNK / samples.len().max(1)).max(1);
    for (k, part) in pieces.chunks(together).enumerate() {
        progress.report(stage, (k * together) as u64, pieces.len() as u64)?;
        let batch: Vec<Rollout> =
            part.iter().flat_map(|p| physics.iter().map(|own| rollout(&p.scene, own))).collect();
        let found = simulate_map(&batch, simulation.engine, |i, t| part[i / samples.len()].vector(&t))?;
        found.into_iter().enumerate().for_each(|(i, v)| rows[i % samples.len()].push(v));
    }
    Ok(rows)
}

/// What each sample is simulated with.
fn physics_of(samples: &[Sample], simulation: Simulation) -> Vec<(Latents, Vec<EffectTerm>)> {
    let all = simulation.coordinates;
    samples.iter().map(|s| (all.latents(s), all.effects(s, simulation.effects))).collect()
}

fn rollout<'a>(scene: &'a Scene, (latents, effects): &'a (Latents, Vec<EffectTerm>)) -> Rollout<'a> {
    Rollout { latents: *latents, effects, stop: false, ..Rollout::of(scene) }
}
