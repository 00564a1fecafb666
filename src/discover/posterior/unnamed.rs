//! What launches share and no set of effects accounts for, put into the model: a field of Gaussian bumps, fitted with everything else.
//!
//! A field that is integrated out straight about a model without it (`discrepancy`) cannot follow what bends paths by a hundred times the
//! noise: values then make up for it, and are sure of what is wrong. So where a field is likelier than none, the kind that is likeliest is
//! simulated, and values and its coefficients take steps together (Gauss and Newton), each kept if beginnings, which grow with it, are
//! predicted better than before. About the field where it ends up, what is not known of it is integrated out.
//!
//! Differences from Kennedy and O'Hagan (2001): the field is part of the forces and not of what is seen, so that it goes on through
//! contacts and can be rolled out anywhere.

use super::discrepancy::{Discrepancy, Kinds};
use super::reach::{Grounds, Grown, OfModel, RUN, Shots, cut, reached};
use super::whitened::{Whitened, whiten};
use crate::discover::field::{self, OVERS, Over};
use crate::discover::fit::{Fitted, Fitter};
use crate::discover::gaussian::{self, Pooled};
use crate::discover::launch::Part;
use crate::discover::law::POWERS;
use crate::discover::model::{Data, Extra, Layout, Slot, State, Term, paths};
use crate::discover::noise::Noise;
use crate::error::Result;
use crate::progress::Progress;
use crate::world::effect::{Effect, monomial};

/// Amplitude by which derivatives by a field's functions are taken, m/s^2.
const SLIGHT: f64 = 0.02;
/// Probability of none up to which a field is put into the model.
const UNLIKELY: f64 = 0.01;
/// Kinds that are followed. (Bumps over places or everything are more than most worlds take, and were never what was left out of drags
/// and winds; powers met those to the noise.)
const KINDS: [Over; 3] = [Over::Powers, Over::Velocity, Over::Clock];
/// Standard deviations of coefficients of fields that are followed, m/s^2; of weaker ones short beginnings tell too little.
const FOLLOWED: [f64; 3] = [0.6, 2.0, 6.0];
/// Least size of a power where paths lead: of what is nothing there a unit would be without end.
const LEAST: f64 = 1e-6;
/// What is said of it while it goes on.
const DOING: &str = "following what no effect accounts for";
/// Most steps, shares of each that are tried, and how many in a row that leave more than a share of the loss are the last.
const ROUNDS: usize = 24;
const SHARES: [f64; 2] = [1.0, 0.5];
const SETTLED: f64 = 0.99;
const SLOW: usize = 2;
/// Most turns in which starts are found anew and the field is followed on.
const TURNS: usize = 8;

/// A field in a model.
#[derive(Clone)]
pub struct Unnamed {
    pub over: Over,
    /// The effects that its functions are, two functions each: their first two parameters are the amplitudes.
    effects: Vec<(&'static Effect, Vec<f64>)>,
    /// Amplitude of each effect that pushes with 1 m/s^2 at most.
    units: Vec<f64>,
    /// Coefficients by function, m/s^2.
    amounts: Vec<f64>,
}

impl Unnamed {
    /// Nothing of a field of some effects.
    fn nothing(over: Over, effects: Vec<(&'static Effect, Vec<f64>)>) -> Unnamed {
        Unnamed { over, units: vec![1.0; effects.len()], amounts: vec![0.0; 2 * effects.len()], effects }
    }

    /// Directions in which a model would move with a little of each function.
    fn extras(&self) -> Vec<Extra> {
        let of = |((effect, values), unit): (&(&'static Effect, Vec<f64>), &f64)| {
            [0, 1].map(|k| {
                let mut values = values.clone();
                (values[0], values[1]) = (0.0, 0.0);
                values[k] = SLIGHT * unit;
                Extra { effect, values, unit: SLIGHT }
            })
        };
        self.effects.iter().zip(&self.units).flat_map(of).collect()
    }

    /// Its effects as terms of a model, none of whose numbers is fitted.
    fn terms(&self) -> impl Iterator<Item = Term> {
        let sized = self.effects.iter().zip(&self.units).zip(self.amounts.chunks_exact(2));
        sized.map(|(((effect, values), unit), amounts)| {
            let mut start = values.clone();
            for k in 0..2 {
                let [low, high] = effect.parameters[k].bounds;
                start[k] = (amounts[k] * unit).clamp(low, high);
            }
            Term { effect, per_setting: false, free: vec![false; start.len()], start, difference: None }
        })
    }

    /// A layout with its terms after those that have names.
    fn beside(&self, named: &[Term], layout: &Layout, settings: usize) -> Layout {
        let latents: Vec<usize> = layout.slots.iter().filter_map(Slot::latent).collect();
        Layout::new(&latents, named.iter().cloned().chain(self.terms()).collect(), settings)
    }
}

impl OfModel {
    /// Terms that have names.
    pub fn named(&self) -> &[Term] {
        let unnamed = self.unnamed.as_ref().map_or(0, |u| u.effects.len());
        &self.layout.terms[..self.layout.terms.len() - unnamed]
    }
}

/// What a model may lack.
pub enum Lacks<'a> {
    Nothing,
    /// A field of bumps of any kind.
    Any(Every),
    /// More or less of the field that it has.
    Known(&'a Unnamed),
}

/// Every field that may be there, nothing of any yet, where windows lead.
pub struct Every {
    powers: Unnamed,
    bumps: Unnamed,
    /// Which of all bumps each kind of field has.
    kinds: Kinds,
}

impl Every {
    /// Where windows lead at a state.
    pub fn of(fitter: &Fitter, layout: &Layout, state: &State) -> Result<Every> {
        let paths = paths(fitter.data, layout, state)?;
        let functions = field::functions(fitter.data.windows, &paths);
        Ok(Every {
            powers: powers(&paths),
            bumps: Unnamed::nothing(Over::All, functions.effects()),
            kinds: OVERS.map(|over| (over, functions.range(over))).to_vec(),
        })
    }

    /// The field of one kind.
    fn only(&self, over: Over) -> Option<Unnamed> {
        if over == Over::Powers {
            return Some(self.powers.clone());
        }
        let range = &self.kinds.iter().find(|k| k.0 == over)?.1;
        Some(Unnamed::nothing(over, self.bumps.effects[range.start / 2..range.end / 2].to_vec()))
    }
}

/// Powers of place, velocity and speed, as large as they are where paths lead.
fn powers(paths: &[Vec<[f64; 4]>]) -> Unnamed {
    let largest = |powers: &[u8; 5]| {
        let of = |s: &[f64; 4]| {
            let all = [s[0], s[1], s[2], s[3], s[2].hypot(s[3])];
            all.iter().zip(powers).map(|(v, p)| v.abs().powi(i32::from(*p))).product::<f64>()
        };
        paths.iter().flatten().map(of).filter(|v| v.is_finite()).fold(0.0, f64::max).max(LEAST)
    };
    let effect = |powers: &[u8; 5]| {
        let values = [0.0; 2].into_iter().chain(powers.iter().map(|p| f64::from(*p)));
        (&monomial::EFFECT, values.collect())
    };
    let units = POWERS.iter().map(|p| 1.0 / largest(p)).collect();
    Unnamed { units, ..Unnamed::nothing(Over::Powers, POWERS.iter().map(effect).collect()) }
}

impl Lacks<'_> {
    /// Directions in which the model would move with a little of each function.
    pub fn extras(&self) -> Vec<Extra> {
        match self {
            Lacks::Nothing => Vec::new(),
            Lacks::Any(every) => every.bumps.extras(),
            Lacks::Known(unnamed) => unnamed.extras(),
        }
    }

    /// The fields that may be there, from parts with derivatives by the functions.
    pub fn discrepancy(&self, parts: &[Whitened]) -> Discrepancy {
        match self {
            Lacks::Nothing => Discrepancy::new(parts, &[]),
            Lacks::Any(every) => Discrepancy::new(parts, &every.kinds),
            Lacks::Known(unnamed) => Discrepancy::about(parts, unnamed.over, &unnamed.amounts),
        }
    }
}

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
        (values, Unnamed { amounts, ..at.unnamed.clone() })
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
    use crate::discover::fixture::term;

    /// Two bodies' paths.
    fn field() -> Unnamed {
        powers(&[vec![[2.0, -1.0, 3.0, 4.0], [1.0, 0.5, 0.0, 0.0]], vec![[-1.0, 0.0, f64::NAN, 0.0]]])
    }

    /// A coefficient is the push where it is largest, whatever the power is of; what is nothing everywhere has a unit all the same.
    #[test]
    fn powers_push_by_as_much_as_their_coefficients_say() {
        let field = field();
        let place = |powers: [u8; 5]| POWERS.iter().position(|p| *p == powers).unwrap();
        assert_eq!(field.units[place([0; 5])], 1.0);
        assert_eq!(field.units[place([1, 0, 0, 0, 0])], 0.5);
        assert_eq!(field.units[place([0, 0, 0, 1, 1])], 1.0 / 20.0);
        assert_eq!((field.amounts.len(), field.effects.len()), (2 * POWERS.len(), POWERS.len()));
        let still = powers(&[vec![[0.0; 4]]]);
        assert!(still.units.iter().all(|u| u.is_finite()));
        let extra = &field.extras()[2 * place([0, 0, 0, 1, 1]) + 1];
        assert_eq!((extra.values[0], extra.values[1], extra.unit), (0.0, SLIGHT / 20.0, SLIGHT));
    }

    /// Its terms come after those that have names, none of their numbers is fitted, and the layout's values stay what they were.
    #[test]
    fn a_field_adds_no_numbers() {
        let named = Layout::new(&[1], vec![term("quadratic_drag")], 1);
        let amounts = vec![0.4; 2 * POWERS.len()];
        let layout = Unnamed { amounts, ..field() }.beside(&named.terms, &named, 1);
        assert_eq!((layout.slots.len(), layout.terms.len()), (named.slots.len(), 1 + POWERS.len()));
        assert_eq!(layout.terms[0].effect.name, "quadratic_drag");
        assert_eq!(layout.terms[2].start[..2], [0.2, 0.2], "x: 0.4 m/s^2 at 2 m");
    }

    /// A share of a step ends at a bound of a value, and moves the field's coefficients by the same share.
    #[test]
    fn a_step_ends_at_a_bound() {
        let layout = Layout::new(&[1], Vec::new(), 1);
        let mut by = vec![0.0; 1 + 2 * POWERS.len()];
        (by[0], by[3]) = (-4.0, 1.0);
        let grown = Grown { values: vec![0.5], until: Vec::new(), noise: 0.0, left: 0.0 };
        let at = Followed { unnamed: field(), layout, grown };
        let (values, unnamed) = Step { values: vec![0.5], by }.taken(&at, 0.5);
        assert_eq!((values, unnamed.amounts[2], unnamed.amounts[0]), (vec![0.0], 0.5, 0.0));
    }
}
