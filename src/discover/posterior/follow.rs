//! What launches share and no set of effects accounts for, put into the model: a force field, fitted with everything else.
//!
//! A field that is integrated out straight about a model without it (`discrepancy`) cannot follow what bends paths by a hundred times the
//! noise: values then make up for it, and are sure of what is wrong. So where none is unlikely, a field of each of some kinds is simulated, and
//! values and its coefficients take steps together (Gauss and Newton), each kept if beginnings, which grow with it, are predicted better than
//! before; the kind that predicts them best goes on. About the field where it ends up, what is not known of it is integrated out.
//!
//! Differences from Kennedy and O'Hagan (2001): the field is part of the forces and not of what is seen, so that it goes on through
//! contacts.
//!
//! Range of validity: steps may end in a hollow of their own, and what is not known of the field is straight about where they do, so that
//! intervals are narrower than errors are (`docs/posterior.md`).

use super::discrepancy::Discrepancy;
use super::reach::{Grounds, Grown, OfModel, RUN, Shots, cut, reached};
use super::unnamed::{Every, Lacks, Unnamed};
use super::whitened::{Whitened, whiten};
use crate::discover::field::{self, Over};
use crate::discover::fit::{Fitted, Fitter};
use crate::discover::gaussian::{self, Pooled};
use crate::discover::launch::Part;
use crate::discover::model::{Data, Layout};
use crate::discover::noise::Noise;
use crate::error::Result;
use crate::progress::Progress;

/// Probability of none up to which a field is put into the model.
const UNLIKELY: f64 = 0.01;
/// Kinds that are followed. (Bumps over places or everything are more than most worlds take, and were never what was left out of drags
/// and winds; powers met those to the noise.)
const KINDS: [Over; 3] = [Over::Powers, Over::Velocity, Over::Clock];
/// Standard deviations of coefficients of fields that are followed, m/s^2; of weaker ones short beginnings tell too little.
const FOLLOWED: [f64; 3] = [0.6, 2.0, 6.0];
/// What is said of it while it goes on.
const DOING: &str = "following what no effect accounts for";
/// Most steps, shares of each that are tried, and how many in a row that leave more than a share of the loss are the last.
const ROUNDS: usize = 24;
const SHARES: [f64; 2] = [1.0, 0.5];
const SETTLED: f64 = 0.99;
const SLOW: usize = 2;
/// Most turns in which starts are found anew and the field is followed on.
const TURNS: usize = 8;

/// The model with what it lacks, if it lacks something: of the kinds of field that which, followed, predicts beginnings best.
pub fn completed(grounds: &Grounds, model: OfModel, progress: &dyn Progress) -> Result<OfModel> {
    let Some(every) = lacking(grounds, &model)? else { return Ok(model) };
    let all = (KINDS.len() + TURNS) as u64;
    let shots = Shots::fitted(grounds, &model.layout, &model.state.values)?;
    let mut best: Option<Followed> = None;
    for (i, over) in KINDS.iter().enumerate() {
        progress.report(DOING, i as u64, all)?;
        let Some(unnamed) = every.only(*over) else { continue };
        let way = Way { grounds, shots: &shots, model: &model };
        let found = way.followed(unnamed, &model.state.values)?;
        if best.as_ref().is_none_or(|b| found.grown.left < b.grown.left) {
            best = Some(found);
        }
    }
    let Some(mut best) = best.filter(|b| b.grown.left < model.left) else { return Ok(model) };
    for turn in 0..TURNS {
        progress.report(DOING, (KINDS.len() + turn) as u64, all)?;
        let shots = Shots::fitted(grounds, &best.layout, &best.grown.values)?;
        let way = Way { grounds, shots: &shots, model: &model };
        let next = way.followed(best.unnamed.clone(), &best.grown.values)?;
        let settled = next.grown.left > SETTLED * best.grown.left;
        if next.grown.left < best.grown.left {
            best = next;
        }
        if settled {
            break;
        }
    }
    let Followed { unnamed, layout, grown } = best;
    let found = reached(grounds, &layout, &grown.values)?;
    Ok(match found.left < model.left {
        true => OfModel { unnamed: Some(unnamed), ..found },
        false => model,
    })
}

/// Every field where a model leads, if it is likely to lack one.
fn lacking(grounds: &Grounds, model: &OfModel) -> Result<Option<Every>> {
    let data = Data::new(&model.windows, &grounds.ready.settings, model.sd.clone(), grounds.engine);
    let fitter = Fitter::new(&data, &model.noise);
    let Some(fit) = fitter.refined(model.layout.clone(), model.state.clone())? else { return Ok(None) };
    let lacks = Lacks::Any(Every::of(&fitter, &fit.layout, &fit.state)?);
    let Some((_, whitened)) = parts(&fitter, &fit, &lacks)? else { return Ok(None) };
    let unlikely = Likelihoods::of(&lacks, &whitened).none() < UNLIKELY;
    Ok(match lacks {
        Lacks::Any(every) if unlikely => Some(every),
        _ => None,
    })
}

/// Parts with columns for what a model may lack, as they are and whitened.
fn parts(fitter: &Fitter, fit: &Fitted, lacks: &Lacks) -> Result<Option<(Vec<Part>, Vec<Whitened>)>> {
    let Some((_, parts)) = fitter.parts(&fit.layout, &fit.set, &fit.state, &lacks.extras())? else {
        return Ok(None);
    };
    let slots = fit.layout.slots.len();
    let whitened: Option<Vec<Whitened>> =
        parts.iter().map(|p| whiten(p, &fit.components, slots).map(|w| w.0)).collect();
    Ok(whitened.map(|whitened| (parts, whitened)))
}

/// How likely parts are beside each field that may be there.
struct Likelihoods {
    fields: Discrepancy,
    all: Vec<f64>,
}

impl Likelihoods {
    fn of(lacks: &Lacks, parts: &[Whitened]) -> Likelihoods {
        let fields = lacks.discrepancy(parts);
        let left: Vec<_> = parts.iter().map(|p| p.left.clone()).collect();
        let all = fields.log_likelihoods(parts, &left);
        Likelihoods { fields, all }
    }

    /// Probability of none.
    fn none(&self) -> f64 {
        self.fields.probabilities(std::slice::from_ref(&self.all))[0]
    }

    /// Strength of the likeliest field, m/s^2.
    fn strength(&self) -> f64 {
        let best = (1..self.all.len()).max_by(|a, b| self.all[*a].total_cmp(&self.all[*b]));
        best.map_or(0.0, |best| self.fields.fields()[best].strength)
    }
}

/// A field followed as far as it went.
struct Followed {
    unnamed: Unnamed,
    layout: Layout,
    grown: Grown,
}

/// From where a field is followed.
struct Way<'a> {
    grounds: &'a Grounds<'a>,
    shots: &'a Shots,
    model: &'a OfModel,
}

impl Way<'_> {
    /// Steps of values and field together, each kept if it leaves less of the beginnings.
    fn followed(&self, unnamed: Unnamed, values: &[f64]) -> Result<Followed> {
        let layout = self.layout(&unnamed);
        let grown = self.shots.grown(self.grounds, &layout, values.to_vec())?;
        let mut best = Followed { unnamed, layout, grown };
        let mut slow = 0;
        for _ in 0..ROUNDS {
            let mut next = None;
            let steps = self.steps(&best)?;
            for (share, step) in SHARES.iter().flat_map(|share| steps.iter().map(move |s| (*share, s))) {
                let (values, unnamed) = step.taken(&best, share);
                let layout = self.layout(&unnamed);
                let grown = self.shots.grown(self.grounds, &layout, values)?;
                if grown.left < best.grown.left {
                    next = Some(Followed { unnamed, layout, grown });
                    break;
                }
            }
            let Some(next) = next else { break };
            slow = if next.grown.left > SETTLED * best.grown.left { slow + 1 } else { 0 };
            best = next;
            if slow == SLOW {
                break;
            }
        }
        Ok(best)
    }

    /// The set's layout with a field.
    fn layout(&self, unnamed: &Unnamed) -> Layout {
        unnamed.beside(self.model.named(), &self.model.layout, self.grounds.ready.names.len())
    }

    /// Steps from where a field is, by how strong it is taken to be, the likeliest strength first; none where nothing can be told.
    fn steps(&self, at: &Followed) -> Result<Vec<Step>> {
        let Followed { unnamed, layout, grown } = at;
        let windows = cut(&self.grounds.ready.whole, &grown.until, RUN);
        let (data, state) = self.shots.data(self.grounds, &windows, &grown.values, grown.noise);
        let noise = Noise { sd: grown.noise, ..self.grounds.ready.noise };
        let fitter = Fitter::new(&data, &noise);
        let Some(fit) = fitter.refined(layout.clone(), state)? else { return Ok(Vec::new()) };
        let lacks = Lacks::Known(unnamed);
        let Some((parts, whitened)) = parts(&fitter, &fit, &lacks)? else { return Ok(Vec::new()) };
        let likeliest = Likelihoods::of(&lacks, &whitened).strength();
        let mut strengths = FOLLOWED;
        strengths.sort_by(|a, b| (a - likeliest).abs().total_cmp(&(b - likeliest).abs()));
        let of = |strength: f64| {
            let by = together(&fit, &parts, unnamed, strength)?;
            Some(Step { values: fit.state.values.clone(), by })
        };
        Ok(strengths.into_iter().filter_map(of).collect())
    }
}

/// Where values and a field are asked to go.
struct Step {
    values: Vec<f64>,
    /// By slot, then by function.
    by: Vec<f64>,
}

impl Step {
    /// Values, within bounds, and the field after a share of it.
    fn taken(&self, at: &Followed, share: f64) -> (Vec<f64>, Unnamed) {
        let slots = at.layout.slots.iter().zip(&self.values).zip(&self.by);
        let values = slots.map(|((s, v), by)| (v + share * by).clamp(s.bounds[0], s.bounds[1])).collect();
        let own = at.unnamed.amounts.iter().zip(&self.by[self.values.len()..]);
        let amounts = own.map(|(a, by)| a + share * by).collect();
        (values, at.unnamed.with(amounts))
    }
}

/// Where launches ask slots and a field's functions to go, both together.
fn together(fit: &Fitted, parts: &[Part], from: &Unnamed, strength: f64) -> Option<Vec<f64>> {
    let slots = fit.layout.slots.len();
    let all = slots + from.amounts.len();
    let mut components = fit.components.clone();
    components.spread.resize(all, 0.0);
    let mut prior = field::believed(fit, all, strength);
    from.amounts.iter().enumerate().for_each(|(k, a)| prior.off[slots + k] = -a);
    let (_, components) = field::beside(parts, &components, &prior)?;
    let told = gaussian::all_told(parts, &components)?;
    let Pooled { step, .. } = gaussian::pooled(told.iter(), &prior)?;
    Some(step.iter().copied().collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::posterior::unnamed::powers;

    /// A share of a step ends at a bound of a value, and moves the field's coefficients by the same share.
    #[test]
    fn a_step_ends_at_a_bound() {
        let unnamed = powers(&[vec![[2.0, -1.0, 3.0, 4.0]]]);
        let layout = Layout::new(&[1], Vec::new(), 1);
        let mut by = vec![0.0; 1 + unnamed.amounts.len()];
        (by[0], by[3]) = (-4.0, 1.0);
        let grown = Grown { values: vec![0.5], until: Vec::new(), noise: 0.0, left: 0.0 };
        let at = Followed { unnamed, layout, grown };
        let (values, unnamed) = Step { values: vec![0.5], by }.taken(&at, 0.5);
        assert_eq!((values, unnamed.amounts[2], unnamed.amounts[0]), (vec![0.0], 0.5, 0.0));
    }
}
