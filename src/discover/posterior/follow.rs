//! What launches share and no set of effects accounts for, put into the model: a force field, drawn along with everything else.
//!
//! A field that is integrated out straight about a model without it (`discrepancy`) cannot follow what bends paths by a hundred times the
//! noise: values then make up for it, and are sure of what is wrong. So where none is unlikely, a field of powers of place, velocity
//! and speed is simulated, and values and its coefficients are drawn together (`along`), first of short beginnings of trials, which
//! leave much open but lead nowhere wrong, then of longer and longer ones, each time from where the draws before stood: tempering by
//! data (Chopin, Biometrika 89 (2002) 539). (Steps by Gauss and Newton on long beginnings ended in hollows a hundred nats below the truth.)
//!
//! Differences from the source: beginnings grow for all trials at once, and what the draws of the last length hand on is their mean and
//! covariance.
//!
//! Range of validity: what such a field can be. Beginnings end where even their likeliest draw does not predict them.

use super::density::Density;
use super::prior;
use super::reach::{Grounds, OfModel, RUN, cut, left};
use super::unnamed::{Every, Lacks, Unnamed};
use super::whitened::whiten;
use crate::discover::fit::Fitter;
use crate::discover::model::{self, Data, State};
use crate::discover::noise::Noise;
use crate::discover::window::{Kind, Window};
use crate::error::Result;
use crate::estimate::sampler::smc::{SmcConfig, smc};
use crate::estimate::sampler::{Prior, Reference, Target as _};
use crate::progress::Progress;
use crate::rng;
use crate::world::Sample;

/// Probability of none up to which a field is put into the model.
const UNLIKELY: f64 = 0.01;
/// Lengths of beginnings, intervals. (Of 11 and more, paths part so far that friction was off by two to four of its deviations.)
const LENGTHS: [usize; 4] = [3, 4, 6, 8];
/// Particles of each of two runs, and moves of each. (Of a hundred particles the draws of friction were a third narrower than of three
/// hundred.)
const PARTICLES: usize = 128;
const MOVES: usize = 6;
const LAST_MOVES: usize = 16;
/// How much wider than the draws of one length those of the next begin.
const WIDER: f64 = 1.2;
/// What is said of it while it goes on.
const DOING: &str = "following what no effect accounts for";

/// The model with what it lacks, if it lacks something and a field predicts beginnings better; `believed`: of latents beforehand.
pub fn completed(
    grounds: &Grounds,
    model: OfModel,
    believed: &[(f64, f64); 3],
    progress: &dyn Progress,
) -> Result<OfModel> {
    let Some(every) = lacking(grounds, &model)? else { return Ok(model) };
    let numbers = prior::known(&model.layout, &grounds.ready.names, believed);
    let way = Way { grounds, model: &model, prior: prior::of(&numbers)?, progress };
    let mut found = Followed { values: model.state.values.clone(), unnamed: every.powers, cloud: Vec::new() };
    for (i, most) in LENGTHS.into_iter().enumerate() {
        let Some(next) = way.on(&found, i, most)? else { return Ok(model) };
        found = next;
    }
    let found = way.ended(found)?;
    Ok(if found.left < model.left { found } else { model })
}

/// Every field where a model leads, if it is likely to lack one.
fn lacking(grounds: &Grounds, model: &OfModel) -> Result<Option<Every>> {
    let data = Data::new(&model.windows, &grounds.ready.settings, model.sd.clone(), grounds.engine);
    let fitter = Fitter::new(&data, &model.noise);
    let Some(fit) = fitter.refined(model.layout.clone(), model.state.clone())? else { return Ok(None) };
    let lacks = Lacks::Any(Every::of(&fitter, &fit.layout, &fit.state)?);
    let Some((_, parts)) = fitter.parts(&fit.layout, &fit.set, &fit.state, &lacks.extras())? else {
        return Ok(None);
    };
    let slots = fit.layout.slots.len();
    let whitened = parts.iter().map(|p| whiten(p, &fit.components, slots).map(|w| w.0));
    let Some(whitened) = whitened.collect::<Option<Vec<_>>>() else { return Ok(None) };
    let fields = lacks.discrepancy(&whitened);
    let own: Vec<_> = whitened.iter().map(|p| p.left.clone()).collect();
    let none = fields.probabilities(&[fields.log_likelihoods(&whitened, &own)])[0];
    Ok(match lacks {
        Lacks::Any(every) if none < UNLIKELY => Some(every),
        _ => None,
    })
}

/// Where a field has been followed to: the likeliest draw, and all of them.
struct Followed {
    values: Vec<f64>,
    unnamed: Unnamed,
    cloud: Vec<Sample>,
}

/// What a field is followed with.
struct Way<'a> {
    grounds: &'a Grounds<'a>,
    model: &'a OfModel,
    /// Of the model's own numbers.
    prior: Prior,
    progress: &'a dyn Progress,
}

/// Tells of drawing as a part of all: the lengths before it are done.
struct Part<'a> {
    whole: &'a dyn Progress,
    before: usize,
}

/// Units that a length is told in.
const UNITS: u64 = 1000;

impl Progress for Part<'_> {
    fn report(&self, _stage: &str, done: u64, total: u64) -> Result<()> {
        let own = UNITS * done / total.max(1);
        self.whole.report(DOING, UNITS * self.before as u64 + own, UNITS * LENGTHS.len() as u64)
    }
}

impl Way<'_> {
    fn noise(&self) -> Noise {
        Noise { sd: self.grounds.ready.simulated, ..self.grounds.ready.noise }
    }

    /// Beginnings of at most so many intervals that end before `until`, by trial.
    fn beginnings(&self, most: usize, until: &[f64]) -> Vec<Window> {
        let all = cut(&self.grounds.ready.whole, until, most);
        all.into_iter().filter(|w| w.kind == Kind::Run).collect()
    }

    /// Draws of beginnings of at most so many intervals, from where those of shorter ones stood, after so many lengths; none where nothing can
    /// be told.
    fn on(&self, from: &Followed, before: usize, most: usize) -> Result<Option<Followed>> {
        let Grounds { ready, engine, seed, .. } = self.grounds;
        let open = vec![f64::INFINITY; ready.settings.len()];
        let (windows, noise) = (self.beginnings(most, &open), self.noise());
        let data = Data::new(&windows, &ready.settings, vec![noise.sd; windows.len()], *engine);
        let layout = from.unnamed.beside(self.model.named(), &self.model.layout, ready.names.len());
        let starts = windows.iter().map(|w| w.nuisances.clone()).collect();
        let fitter = Fitter::new(&data, &noise);
        let Some(fit) = fitter.refined(layout, State::new(from.values.clone(), starts))? else {
            return Ok(None);
        };
        let lacks = Lacks::Known(&from.unnamed);
        let Some(density) = Density::new(&fitter, &fit, self.prior.clone(), &lacks, *seed)? else {
            return Ok(None);
        };
        let reference = match from.cloud.as_slice() {
            [] => density.reference(&fit),
            cloud => Reference::about(cloud, WIDER, density.prior()),
        };
        let config = SmcConfig {
            particles: PARTICLES,
            runs: 2,
            moves: MOVES,
            last_moves: LAST_MOVES,
            seed: rng::derive(*seed, "length", most as u64),
        };
        let draws = smc(&density, &reference, &config, &Part { whole: self.progress, before })?;
        let log = |i: &usize| draws.log_likelihoods[*i] + density.prior().log_density(&draws.points[*i]);
        let Some(best) = (0..draws.points.len()).max_by(|a, b| log(a).total_cmp(&log(b))) else {
            return Ok(None);
        };
        let (values, amounts) = draws.points[best].split_at(from.values.len());
        let unnamed = from.unnamed.with(amounts.to_vec());
        Ok(Some(Followed { values: values.to_vec(), unnamed, cloud: draws.points }))
    }

    /// The model with a field, asked of beginnings alone, as far as the likeliest draw predicts them: what comes after them starts somewhere that
    /// was found with one field and one friction, and speaks for those.
    fn ended(&self, found: Followed) -> Result<OfModel> {
        let Followed { values, unnamed, cloud } = found;
        let Grounds { ready, engine, .. } = self.grounds;
        let layout = unnamed.beside(self.model.named(), &self.model.layout, ready.names.len());
        let shown = |windows: &[Window]| {
            let data = Data::new(windows, &ready.settings, vec![ready.simulated; windows.len()], *engine);
            let starts = windows.iter().map(|w| w.nuisances.clone()).collect();
            model::shown(&data, &layout, &State::new(values.clone(), starts))
        };
        let mut until = vec![f64::INFINITY; ready.settings.len()];
        let longest = self.beginnings(RUN, &until);
        let left = left(&longest, &shown(&longest)?, ready.simulated, &mut until);
        let windows = self.beginnings(LENGTHS[LENGTHS.len() - 1], &until);
        let starts = windows.iter().map(|w| w.nuisances.clone()).collect();
        let state = State::new(values, starts);
        let sd = vec![ready.simulated; windows.len()];
        Ok(OfModel { sd, windows, layout, state, noise: self.noise(), left, unnamed: Some(unnamed), cloud })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    /// What draws of a length report is a part of all lengths.
    #[test]
    fn a_length_is_told_as_a_part_of_all() {
        struct Told(Mutex<Vec<(String, u64, u64)>>);
        impl Progress for Told {
            fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
                self.0.lock().unwrap().push((stage.into(), done, total));
                Ok(())
            }
        }
        let told = Told(Mutex::new(Vec::new()));
        Part { whole: &told, before: 1 }.report("drawing", 300, 600).unwrap();
        Part { whole: &told, before: 0 }.report("drawing", 0, 0).unwrap();
        let all = UNITS * LENGTHS.len() as u64;
        assert_eq!(told.0.into_inner().unwrap(), [(DOING.into(), 1500, all), (DOING.into(), 0, all)]);
    }
}
