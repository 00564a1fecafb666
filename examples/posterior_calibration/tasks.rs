//! Worlds with friction and restitution drawn from the prior, and random actions.

use iplw::error::Result;
use iplw::estimate::sampler::{JointPrior, Marginal};
use iplw::experiment::random_trials;
use iplw::progress::NoProgress;
use iplw::reality::{HiddenConfig, HiddenWorld, standard, with_trial_settings};
use iplw::rng;
use iplw::task::scene::EffectTerm;
use iplw::task::{Split, family, split};
use iplw::world::Latents;

use super::{Run, SampledWorld};

/// Latents that are drawn and estimated.
pub const PARAMETERS: [&str; 2] = ["friction", "restitution"];

/// A world with trials; `prior` holds the mean and standard deviation of each factor.
pub fn sample_world(run: &Run, prior: &[(f64, f64); 3], seed: u64) -> Result<SampledWorld> {
    let family = family(&run.task)?;
    let belief = |k: usize, low, high| Marginal::Normal { mean: prior[k].0, sd: prior[k].1, low, high };
    let prior = JointPrior::new(vec![belief(1, 0.0, 10.0), belief(2, 0.0, 1.0)])?;
    let truth = prior.draw(&mut rng::stream(seed, "truth"));
    let latents =
        Latents { friction: Some(truth[0]), restitution: Some(truth[1]), ..standard(family).latents };
    let effects = run.leave.iter().map(|text| term(text)).collect();
    let hidden = HiddenConfig { latents, effects, noise: run.noise, seed, ..standard(family) };
    let tasks = split(&family.fold(0), Split::Train);
    let trials = random_trials(&tasks, &mut HiddenWorld::new(hidden)?, run.trials, seed, &NoProgress)?;
    let (mut scene, trials) = with_trial_settings(&tasks[0].scene, trials)?;
    scene.calibrate = PARAMETERS.map(String::from).to_vec();
    Ok(SampledWorld { scene, trials, set: Vec::new(), truth })
}

/// Parses `name:parameter=value,...`.
fn term(text: &str) -> EffectTerm {
    let (name, rest) = text.split_once(':').unwrap_or((text, ""));
    let pairs = rest.split(',').filter_map(|p| p.split_once('='));
    let parameters = pairs.filter_map(|(n, v)| Some((n.to_string(), v.parse().ok()?))).collect();
    EffectTerm { name: name.into(), parameters }
}
