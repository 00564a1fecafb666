//! Model predictive path integral control: planning by sampled commands.
//!
//! Source: Williams, Aldrich and Theodorou, Journal of Guidance, Control and Dynamics 40 (2017) 344.
//!
//! Differences from the source: samples are smooth in time (exponentially correlated), the temperature is relative to the spread
//! of the returns, and a sequence's return is its mean over a set of possible physics. An episode that ends without success costs as
//! much as a reward of -1 in every step of the horizon.

use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use super::model::{ControlModel, ControlOutcome, ControlState, RewardKind};
use crate::rng::{self, derive_seed};
use crate::world::mechanism::JointTerm;

/// Settings of the planner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MppiConfig {
    /// Number of steps ahead.
    pub horizon: usize,
    /// Number of sampled sequences, and rounds of sampling, of each plan.
    pub samples: usize,
    pub rounds: usize,
    /// Standard deviation of samples as a share of half the range of commands.
    pub spread: f64,
    /// Correlation of a sample's neighbouring commands.
    pub smoothness: f64,
    /// Temperature as a share of the standard deviation of returns.
    pub temperature: f64,
    /// Weight of the last reward: the value of the state that is reached.
    pub final_weight: f64,
    pub seed: u64,
}

impl Default for MppiConfig {
    fn default() -> MppiConfig {
        MppiConfig {
            horizon: 50,
            samples: 128,
            rounds: 1,
            spread: 0.6,
            smoothness: 0.8,
            temperature: 0.1,
            final_weight: 10.0,
            seed: 0,
        }
    }
}

/// A planner with its current sequence of commands.
pub struct Mppi<'a> {
    model: &'a ControlModel,
    /// Effects of each possible physics.
    physics: Vec<Vec<JointTerm>>,
    config: MppiConfig,
    /// Commands of the coming steps.
    mean: Vec<Vec<f64>>,
    plans: u64,
}

impl<'a> Mppi<'a> {
    /// A planner for a set of possible physics, not empty.
    pub fn new(model: &'a ControlModel, physics: Vec<Vec<JointTerm>>, config: MppiConfig) -> Mppi<'a> {
        let mut out = Mppi { model, physics, config, mean: Vec::new(), plans: 0 };
        out.restart();
        out
    }

    /// Forgets the current sequence, at the start of an episode.
    pub fn restart(&mut self) {
        self.mean = vec![self.model.idle(); self.config.horizon];
    }

    /// The command for a state.
    pub fn act(&mut self, state: &ControlState) -> Vec<f64> {
        let states: Vec<ControlState> =
            self.physics.iter().map(|terms| state.with_terms(terms.clone())).collect();
        for round in 0..self.config.rounds {
            let samples = self.samples(round as u64);
            let returns = self.returns(&states, &samples);
            self.mean = weighted_mean(&samples, &returns, self.config.temperature);
        }
        self.plans += 1;
        let first = self.mean.remove(0);
        self.mean.push(self.mean.last().cloned().unwrap_or_else(|| self.model.idle()));
        first
    }

    /// Sequences around the current one; the first is the current one itself.
    fn samples(&self, round: u64) -> Vec<Vec<Vec<f64>>> {
        let MppiConfig { samples, spread, smoothness, seed, .. } = self.config;
        let index = self.plans * self.config.rounds as u64 + round;
        let mut stream = rng::stream(derive_seed(seed, "mppi", index), "samples");
        let fresh = (1.0 - smoothness * smoothness).sqrt();
        (0..samples)
            .map(|k| {
                let mut noise = vec![0.0; self.model.ranges.len()];
                let each = self.mean.iter().enumerate().map(|(t, mean)| {
                    for (noise, [low, high]) in noise.iter_mut().zip(&self.model.ranges) {
                        let z: f64 = StandardNormal.sample(&mut stream);
                        let sd = 0.5 * (high - low) * spread;
                        *noise = if t == 0 { sd * z } else { smoothness * *noise + fresh * sd * z };
                    }
                    let moved = |((m, noise), [low, high]): ((&f64, &f64), &[f64; 2])| match k {
                        0 => *m,
                        _ => (m + noise).clamp(*low, *high),
                    };
                    mean.iter().zip(&noise).zip(&self.model.ranges).map(moved).collect()
                });
                each.collect()
            })
            .collect()
    }

    /// Mean return of each sequence over the possible physics.
    fn returns(&self, states: &[ControlState], samples: &[Vec<Vec<f64>>]) -> Vec<f64> {
        let horizon = self.config.horizon as f64;
        let of = |outcomes: &Vec<ControlOutcome>| {
            let sum: f64 = outcomes.iter().map(|o| o.reward).sum();
            let Some(last) = outcomes.last() else { return 0.0 };
            sum + match (last.terminated, last.success) {
                (false, _) => self.config.final_weight * last.reward,
                (true, Some(true)) => 0.0,
                (true, _) => -horizon,
            }
        };
        let per_state: Vec<Vec<f64>> = states
            .par_iter()
            .map(|state| {
                let rolled = self.model.rollouts(&vec![state; samples.len()], samples, RewardKind::Dense);
                rolled.iter().map(of).collect()
            })
            .collect();
        (0..samples.len())
            .map(|k| per_state.iter().map(|own| own[k]).sum::<f64>() / per_state.len() as f64)
            .collect()
    }
}

/// Mean of the samples, weighted by exp(return / temperature).
fn weighted_mean(samples: &[Vec<Vec<f64>>], returns: &[f64], temperature: f64) -> Vec<Vec<f64>> {
    let finite: Vec<f64> = returns.iter().copied().filter(|r| r.is_finite()).collect();
    if finite.is_empty() {
        return samples[0].clone();
    }
    let count = finite.len() as f64;
    let mean = finite.iter().sum::<f64>() / count;
    let sd = (finite.iter().map(|r| (r - mean) * (r - mean)).sum::<f64>() / count).sqrt().max(1e-9);
    let best = finite.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = returns.iter().map(|r| libm::exp((r - best) / (temperature * sd))).collect();
    let total: f64 = weights.iter().sum();
    let mut out = samples[0].clone();
    for (t, row) in out.iter_mut().enumerate() {
        for (m, value) in row.iter_mut().enumerate() {
            *value = samples.iter().zip(&weights).map(|(s, w)| w * s[t][m]).sum::<f64>() / total;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::control::control_task;

    /// Swings a pendulum up that its motor cannot lift at once, and holds it.
    #[test]
    fn swings_a_pendulum_up() {
        let model = ControlModel::new(control_task("pendulum_swing_up").unwrap().clone()).unwrap();
        let mut planner = Mppi::new(&model, vec![Vec::new()], MppiConfig::default());
        let mut state = model.initial(vec![0.1], vec![0.0], Vec::new(), Vec::new());
        let mut rewards = Vec::new();
        for _ in 0..300 {
            let action = vec![planner.act(&state)];
            let motion = model.advance(&[&state], std::slice::from_ref(&action)).remove(0);
            rewards.push(
                model.rollouts(&[&state], std::slice::from_ref(&action), RewardKind::Dense)[0][0].reward,
            );
            model.moved(&mut state, &action, &motion);
        }
        let held = rewards[250..].iter().sum::<f64>() / 50.0;
        assert!(held > 0.95, "{held}");
    }
}
