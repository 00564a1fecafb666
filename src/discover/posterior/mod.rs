//! What is known of latents and effects, given trials: draws from the posterior, of one set of effects or of several.
//!
//! 1. Trials are cut into windows and the model of every set is fitted, as a diagnosis does it.
//!    `models`: they; `reach`: beginnings of trials, whose starts are known, go on as far as the model predicts them.
//! 2. `density`: how likely the windows are at any values, about that fit; `under`: variance components are integrated out, as a mean
//!    over draws of them; `discrepancy`: so is what launches share that the model lacks; `follow`: if it is to be followed, it is put
//!    into the model first (`unnamed`: what such a field is) and drawn `along`; `whitened`: coordinates in which that is plain;
//!    `prior`: what is believed of every number.
//! 3. `estimate::sampler` draws, beginning near the fit; `likelihood`: the same density for samplers of one's own.
//! 4. Sets are weighed by how well each predicts launches from the others (`decide`); their evidence stands beside that.
//!    `document`: all of it as it is written; `config`: what can be asked; `wanted`: what people
//!    say they want.
//!
//! Sources: sequential Monte Carlo (Del Moral, Doucet and Jasra 2006), model discrepancy (Kennedy and O'Hagan 2001), stacking by
//! bootstrapped predictive densities (Yao et al. 2018).
//!
//! Range of validity: how windows depend on their unknown starts is held at the fit; so is the noise.

mod along;
mod config;
mod density;
mod discrepancy;
mod document;
mod follow;
mod likelihood;
mod models;
mod prior;
mod reach;
mod under;
mod unnamed;
mod wanted;
mod whitened;

use crate::discover::field::Over;
use crate::error::Result;
use crate::estimate::sampler::Draws;
use crate::estimate::sampler::mcmc::mcmc;
use crate::estimate::sampler::smc::smc;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::rng;
use crate::task::Scene;
pub use config::{PosteriorConfig, Sampler};
use density::Lacking;
pub use density::{Carried, Density};
pub use discrepancy::Field;
pub use document::Document;
pub use likelihood::{LIKELIHOOD_FORMAT, Likelihood};
use models::{Ask, Weighed, with_models};
pub use prior::Known;
pub use wanted::Wanted;

/// By how much oftener particles are moved where a field is drawn along.
const MOVES: usize = 2;

/// Draws from the posterior of every set.
#[derive(Clone, Debug)]
pub struct Posterior {
    pub sets: Vec<OfSet>,
    /// Trials that had anything to say, and those that there were.
    pub trials: [usize; 2],
    /// Noise of an observed coordinate, m.
    pub noise: f64,
}

/// The posterior of one set of effects.
#[derive(Clone, Debug)]
pub struct OfSet {
    /// Names of the effects.
    pub set: Vec<String>,
    /// What each number of a point is.
    pub numbers: Vec<Known>,
    /// Where the fit stood.
    pub fit: Vec<f64>,
    pub draws: Draws,
    /// Probability of each kind of shared field that the model may lack, the first of which is none; and what it may be, for draws that
    /// have one.
    pub fields: Vec<(Field, f64)>,
    pub carried: Vec<Carried>,
    /// What the field depends on that the model lacked and that was followed.
    pub followed: Option<Over>,
    /// Probability of the set among all, by how it predicts launches; and how likely each launch was, told from the others.
    pub weight: f64,
    pub predictive: f64,
    /// Windows that are simulated for a likelihood, and parts of launches that it is a product over.
    pub sizes: (usize, usize),
}

/// Draws what is known of a scene's latents (those it has to `calibrate`) and of the parameters of effects.
pub fn posterior(
    scene: &Scene,
    trials: &[Trial],
    config: &PosteriorConfig,
    progress: &dyn Progress,
) -> Result<Posterior> {
    with_models(scene, trials, config, progress, |models, ready| {
        let mut sets = Vec::with_capacity(models.len());
        let mut noise = f64::INFINITY;
        for (s, Weighed { model, weight, predictive }) in models.iter().enumerate() {
            let own = Ask { model, ready, config };
            let (density, numbers, reference, fit) = own.likelihood()?;
            // A field is many numbers more, among which particles take longer to forget where they stood.
            let more = if model.unnamed.is_some() { MOVES } else { 1 };
            let draws = match &config.sampler {
                Sampler::Smc(own) => smc(&density, &reference, &own.moving(more), progress)?,
                Sampler::Mcmc(own) => mcmc(&density, &reference, own, progress)?,
            };
            noise = noise.min(model.noise.sd);
            let Lacking { fields, carried } =
                density.lacking(&draws.points, rng::derive(config.seed, "lacking", s as u64))?;
            sets.push(OfSet {
                set: model.named().iter().map(|t| t.effect.name.to_string()).collect(),
                numbers,
                fit,
                fields,
                carried,
                followed: model.unnamed.as_ref().map(|u| u.over),
                draws,
                weight: *weight,
                predictive: *predictive,
                sizes: density.sizes(),
            });
        }
        Ok(Posterior { sets, trials: [ready.kept.len(), trials.len()], noise })
    })
}
