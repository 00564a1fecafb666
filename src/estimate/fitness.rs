//! Losses of latent samples against trials, and the racing that skips what cannot matter.
//!
//! The loss of a sample is the mean over trials of [`summed_squares`]. Terms are not negative, so a sample
//! whose partial sum already exceeds the worst total among as many completed samples as there are elites can
//! never become an elite: [`Racing::On`] drops it, exactly. Sums run over trials in a fixed order, so elites,
//! and everything computed from them, are the same bits with racing on or off.

use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::residual::summed_squares;
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::effect::linear_drag;
use crate::world::{Engine, Latents, Rollout, simulate_map};

use super::cem::Sample;

/// What the simulation that is compared with the trials is like.
#[derive(Clone, Copy)]
pub struct Simulation<'a> {
    /// Integrating engine.
    pub engine: Engine,
    /// Effects the simulation has beside the scene's own.
    pub effects: &'a [EffectTerm],
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

/// Trials a race completes between two looks at who may be dropped.
const LEG: usize = 3;
/// Rollouts handed to the engine between two reports of progress.
const CHUNK: usize = 2048;

/// The scenes to simulate for trials: each up to its last observation, goals ignored.
pub fn replays(trials: &[Trial]) -> Vec<Scene> {
    trials
        .iter()
        .map(|t| {
            let mut scene = t.scene.clone();
            let last = t.observed.times.last().copied().unwrap_or(0.0);
            scene.steps = ((last / scene.time_step - 1e-6).ceil() as u32).clamp(1, 1_000_000);
            scene.goal = None;
            scene
        })
        .collect()
}

/// The loss of every sample.
pub fn losses(
    samples: &[Sample],
    trials: &[Trial],
    simulation: Simulation,
    racing: Racing,
    progress: &dyn Progress,
) -> Result<Losses> {
    let scenes = replays(trials);
    let effects = effects_of(samples, simulation);
    let all: Vec<usize> = (0..samples.len()).collect();
    let mut sums = vec![0.0; samples.len()];
    let mut rollouts = 0;
    let total = (samples.len() * trials.len()) as u64;
    let mut advance = |who: &[usize], from: usize, to: usize, sums: &mut [f64]| -> Result<()> {
        for trial in from..to {
            for part in who.chunks(CHUNK) {
                progress.report("simulating samples", rollouts, total)?;
                let batch: Vec<Rollout> =
                    part.iter().map(|s| rollout(&scenes[trial], samples[*s], &effects[*s])).collect();
                let observed = &trials[trial].observed;
                let residuals = simulate_map(&batch, simulation.engine, |_, t| summed_squares(observed, &t))?;
                part.iter().zip(residuals).for_each(|(s, r)| sums[*s] += r);
                rollouts += part.len() as u64;
            }
        }
        Ok(())
    };
    let mut running = all;
    match racing {
        Racing::Off => advance(&running, 0, trials.len(), &mut sums)?,
        Racing::On { elites } => {
            let mut finished: Vec<usize> = Vec::new();
            let first = LEG.min(trials.len());
            advance(&running, 0, first, &mut sums)?;
            // The likely elites run to the end first: their worst total bounds the true threshold from above.
            running.sort_by(|a, b| sums[*a].total_cmp(&sums[*b]).then(a.cmp(b)));
            let rest = running.split_off(elites.min(running.len()));
            advance(&running, first, trials.len(), &mut sums)?;
            let threshold = running.iter().map(|s| sums[*s]).fold(0.0, f64::max);
            finished.append(&mut running);
            running = rest;
            let mut at = first;
            while at < trials.len() && !running.is_empty() {
                let (hopeful, lost): (Vec<_>, Vec<_>) =
                    running.into_iter().partition(|s| sums[*s] <= threshold);
                lost.into_iter().for_each(|s| sums[s] = f64::INFINITY);
                running = hopeful;
                let next = (at + LEG).min(trials.len());
                advance(&running, at, next, &mut sums)?;
                at = next;
            }
        }
    }
    let n = trials.len().max(1) as f64;
    Ok(Losses { values: sums.into_iter().map(|s| s / n).collect(), rollouts })
}

/// The residual of every sample on every trial: `[sample][trial]`, m^2.
pub fn matrix(
    samples: &[Sample],
    trials: &[Trial],
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<Vec<Vec<f64>>> {
    let scenes = replays(trials);
    let effects = effects_of(samples, simulation);
    let mut rows = vec![Vec::with_capacity(trials.len()); samples.len()];
    for (k, trial) in trials.iter().enumerate() {
        progress.report("measuring confidence", k as u64, trials.len() as u64)?;
        let batch: Vec<Rollout> =
            samples.iter().zip(&effects).map(|(s, e)| rollout(&scenes[k], *s, e)).collect();
        let residuals = simulate_map(&batch, simulation.engine, |_, t| summed_squares(&trial.observed, &t))?;
        rows.iter_mut().zip(residuals).for_each(|(row, r)| row.push(r));
    }
    Ok(rows)
}

fn rollout<'a>(scene: &'a Scene, sample: Sample, effects: &'a [EffectTerm]) -> Rollout<'a> {
    Rollout { scene, latents: Latents::of([sample[0], sample[1], sample[2]]), effects, stop: false }
}

/// The simulation's effects for each sample: its own, and the sample's drag.
fn effects_of(samples: &[Sample], simulation: Simulation) -> Vec<Vec<EffectTerm>> {
    let with_drag = |s: &Sample| {
        let mut all = simulation.effects.to_vec();
        if s[3] > 0.0 {
            all.push(linear_drag(s[3]));
        }
        all
    };
    samples.iter().map(with_drag).collect()
}
