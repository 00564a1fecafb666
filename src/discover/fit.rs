//! A model fitted to all trials, with its evidence.
//!
//! First by least squares (`model::fit`), which finds the way; then by generalised least squares with the shared discrepancy and
//! the variance components, linearised anew until it stays. The variance components are those of the recording
//! ([`Context`]): they are estimated once, from the richest model, so that no model calls its misfit noise.

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};

use super::columns::{Columns, pushes};
use super::components::{Likelihood, NEAR, WIDE};
use super::gaussian::{self, Components, Told};
use super::launch::{self, Frame, Part};
use super::leave_out::leave_out;
use super::library;
use super::model::{self, Data, Extra, Layout, Look, Mode, Pass, Slot, State, Term, What};
use super::modes;
use super::noise::Noise;
use super::score;
use super::selection::{Laplace, Prior, SharedDiscrepancy, marginal, profile};
use super::window::Kind;
use crate::distribution::t_quantile;
use crate::error::{Error, Result};
use crate::world::effect::{DataRange, Effect};

/// Most rounds of generalised least squares, and nats of a round below which they end.
const ROUNDS: usize = 8;
const SETTLED: f64 = 0.05;
/// Nats that the linearisation promises beyond the log posterior where a fit stands, above which it has not converged.
const SLIGHT: f64 = 1.0;
/// Nats that an edge beyond all data costs: it is as probable that there are some beyond it, of which the integral over a normal
/// prior knows nothing.
const OPEN_EDGE: f64 = std::f64::consts::LN_2;
/// Share of a step below which none helps.
const SHORTEST: f64 = 0.2;

/// Estimates of a recording that are the same for every set of effects.
#[derive(Clone)]
pub struct Context {
    pub discrepancy: SharedDiscrepancy,
    pub components: Components,
    /// Size of the response to each random acceleration in the richest model.
    pub responses: Vec<f64>,
}

impl Context {
    /// The components of a model whose random accelerations have some responses: what is observed of them is the same for every
    /// model, also for one whose clock runs at another rate.
    fn components_at(&self, responses: &[f64]) -> Components {
        let mut out = self.components.clone();
        for (push, (richest, own)) in out.push.iter_mut().zip(self.responses.iter().zip(responses)) {
            *push *= if *own > 0.0 && *richest > 0.0 { richest / own } else { 1.0 };
        }
        out
    }
}

/// Sizes of the responses to random accelerations, whose columns follow those of `slots`.
pub fn responses(looks: &[Look], slots: usize) -> Vec<f64> {
    let of = |k: usize| looks.iter().map(|l| l.columns.column(slots + k).norm_squared()).sum::<f64>().sqrt();
    (0..pushes().len()).map(of).collect()
}

/// A model fitted to all trials.
pub struct Fitted {
    /// The effects, in the layout's order.
    pub set: Vec<&'static Effect>,
    pub layout: Layout,
    pub state: State,
    pub pass: Pass,
    /// Held-out squares by trial, units of the noise: the errors that gains are computed from.
    pub held: Vec<f64>,
    /// By trial: the step of the parameters without it.
    pub held_out_steps: Vec<DVector<f64>>,
    /// Log evidence, nats.
    pub log_evidence: f64,
    /// Log of likelihood times prior density where the fit ended, the shared discrepancy at its mode.
    pub log_joint: f64,
    /// Most probable size of the shared discrepancy, in its largest plausible one.
    pub discrepancy_scale: f64,
    /// Squared residuals by trial at the mode, in units of the noise, the shared discrepancy not subtracted.
    pub squares: Vec<f64>,
    /// Variance components.
    pub components: Components,
    /// Posterior covariance of the parameters.
    pub covariance: DMatrix<f64>,
    /// Statistics of every group of observations about the parameters, at the variance components.
    pub told: Vec<Told>,
    /// Prior of the parameters, about where they stand.
    pub prior: Prior,
    /// Of the scene, m/s^2.
    pub gravity: f64,
}

/// Where a fit stands.
struct Stand {
    /// Log posterior density there.
    quality: f64,
    state: State,
    prior: Prior,
    looks: Vec<Look>,
    parts: Vec<Part>,
    told: Vec<Told>,
    components: Components,
    laplace: Laplace,
}

/// A model as pictures and the extended scene show it.
#[derive(Clone, Copy)]
pub struct Shown<'a> {
    pub layout: &'a Layout,
    pub state: &'a State,
    pub pass: &'a Pass,
}

/// Fits models of one recording.
#[derive(Clone)]
pub struct Fitter<'a, 'b> {
    pub data: &'b Data<'a>,
    pub frames: Vec<Frame>,
    /// What a window's residuals, in units of its own scale, are in units of the noise.
    pub scales: Vec<f64>,
    pub folds: Vec<usize>,
    /// Ranges of position, speed and time in the data.
    pub range: DataRange,
    /// m/s^2
    pub gravity: f64,
    pub context: Option<Context>,
}

impl<'a, 'b> Fitter<'a, 'b> {
    /// Without shared discrepancy; every model estimates variance components of its own.
    pub fn new(data: &'b Data<'a>, noise: &Noise) -> Fitter<'a, 'b> {
        let scale = |(w, sd): (&super::window::Window, &f64)| match w.kind {
            Kind::Contact => sd / noise.sd,
            _ if sd.is_finite() => 1.0,
            _ => f64::NAN,
        };
        Fitter {
            data,
            frames: launch::frames(data.windows, noise),
            scales: data.windows.iter().zip(&data.sd).map(scale).collect(),
            folds: score::folds(data.settings),
            range: library::span(data.windows),
            gravity: library::gravity(data.windows),
            context: None,
        }
    }

    /// A layout fitted from a start; `None` where it cannot be simulated or its covariance fails.
    pub fn fit(&self, layout: Layout, start: State, rounds: usize) -> Result<Option<Fitted>> {
        match simulated(model::fit(self.data, &layout, start, rounds))? {
            Some((state, _)) => self.refined(layout, state),
            None => Ok(None),
        }
    }

    /// Generalised least squares from a state nearby. A step that makes the data less likely is taken half as far.
    pub fn refined(&self, layout: Layout, state: State) -> Result<Option<Fitted>> {
        let best = self.best_stand(&layout, state)?;
        Ok(best.and_then(|best| self.scored(layout, best)))
    }

    /// Log of likelihood times prior density of a fitted model that has another value of one parameter, all others at their mode.
    pub fn log_joint_with(&self, fit: &Fitted, slot: usize, value: f64) -> Result<Option<f64>> {
        let (mut layout, mut state) = (fit.layout.clone(), fit.state.clone());
        layout.slots[slot].is_fixed = true;
        state.values[slot] = value;
        Ok(self.best_stand(&layout, state)?.map(|stand| stand.quality))
    }

    /// Where generalised least squares from a state nearby ends.
    fn best_stand(&self, layout: &Layout, state: State) -> Result<Option<Stand>> {
        let first = Components::start(!layout.terms.is_empty());
        let Some(mut best) = self.stands(layout, state, &first, WIDE)? else { return Ok(None) };
        let mut share = 1.0;
        for _ in 0..ROUNDS {
            let next = self.onwards(layout, &best, share);
            let Some(there) = self.stands(layout, next, &best.components, NEAR)? else { break };
            let gained = there.quality - best.quality;
            if gained > 0.0 {
                best = there;
                share = 1.0;
            } else {
                share *= 0.5;
            }
            if (-SLIGHT..SETTLED).contains(&gained) || share < SHORTEST {
                break;
            }
        }
        Ok(Some(best))
    }

    /// The iterate at a state; `None` where it cannot be simulated or its covariance fails.
    fn stands(&self, layout: &Layout, state: State, from: &Components, first: f64) -> Result<Option<Stand>> {
        let Some(looks) = simulated(model::looks(self.data, layout, &state, &pushes()))? else {
            return Ok(None);
        };
        let prior = self.prior(layout, &state);
        let Some(parts) = self.with_discrepancy(layout, &state, &looks)? else { return Ok(None) };
        let components = match &self.context {
            Some(context) => context.components_at(&responses(&looks, layout.slots.len())),
            None => Likelihood::new(&parts, from).most(first, self.data.progress)?,
        };
        let Some(told) = gaussian::all_told(&parts, &components) else { return Ok(None) };
        self.data.progress.check_stop()?;
        let Some(laplace) = marginal(&told, &prior) else { return Ok(None) };
        let quality = profile(&told, &prior, laplace.scale);
        Ok(Some(Stand { quality, state, prior, looks, parts, told, components, laplace }))
    }

    /// The state that a share of the step from where a fit stands leads to, trials at their conditional modes.
    fn onwards(&self, layout: &Layout, stand: &Stand, share: f64) -> State {
        let mut state = stand.state.clone();
        let columns = Columns::of(layout, &state.values, self.gravity);
        let step = stand.laplace.step.rows(0, layout.slots.len()).into_owned();
        let taken = allowed(layout, &state.values, &(&step * share));
        let (parts, looks) = (&stand.parts, &stand.looks);
        let mut all = stand.laplace.step.clone();
        all.rows_mut(0, taken.len()).copy_from(&taken);
        let mut modes = modes::modes(parts, &columns, &pushes(), &stand.components, &all, looks.len());
        // A lift turns what falls straight down sideways, and in second order holds it back: in a plane that nobody saw.
        let unseen = modes.iter_mut().zip(&self.frames).filter(|(_, frame)| !frame.moves_in_plane());
        unseen.flat_map(|(mode, _)| &mut mode.pushes).for_each(|push| push.1 = 0.0);
        move_by(&mut state, looks, &taken, modes);
        state
    }

    /// A model where its fit ended.
    fn scored(&self, layout: Layout, stand: Stand) -> Option<Fitted> {
        let Stand { quality, state, prior, looks, parts, told, components, laplace } = stand;
        let q = layout.slots.len();
        // Where the fit has not converged the linearisation promises what no value keeps.
        let excess = laplace.log_joint - quality - SLIGHT;
        let open = (0..q).filter(|i| layout.edged(*i) && is_open(*i, &told, &prior)).count();
        let log_evidence = laplace.log_evidence - excess.max(0.0) - open as f64 * OPEN_EDGE;
        let mut step = laplace.step.clone();
        step.rows_mut(q, laplace.step.len() - q).fill(0.0);
        let mut squares = vec![0.0; self.data.trials];
        for part in &parts {
            squares[part.launch] += part.square_at(&step);
        }
        let pass = model::summed(self.data, looks, q);
        let groups: Vec<usize> = (0..pass.trials.len()).collect();
        let (held, held_out_steps) =
            leave_out(&layout, &state.values, &pass.trials, self.data.settings, &groups, &[]);
        Some(Fitted {
            set: layout.terms.iter().map(|t| t.effect).collect(),
            told: told.iter().map(|t| t.of_first(q)).collect(),
            layout,
            state,
            pass,
            held,
            held_out_steps,
            log_evidence,
            log_joint: quality,
            discrepancy_scale: laplace.scale,
            squares,
            components,
            covariance: laplace.covariance,
            prior,
            gravity: self.gravity,
        })
    }

    /// Every window at a state and its parts, with columns for `extras` after those of the slots.
    pub fn parts(
        &self,
        layout: &Layout,
        state: &State,
        extras: &[Extra],
    ) -> Result<Option<(Vec<Look>, Vec<Part>)>> {
        let all: Vec<Extra> = pushes().into_iter().chain(extras.iter().cloned()).collect();
        let Some(looks) = simulated(model::looks(self.data, layout, state, &all))? else { return Ok(None) };
        let parts = self.reduced(layout, state, |w| Cow::Borrowed(&looks[w]))?;
        Ok(parts.map(|parts| (looks, parts)))
    }

    /// As [`Fitter::parts`], with `count` columns given by window: two rows a point.
    pub fn parts_with(
        &self,
        layout: &Layout,
        state: &State,
        count: usize,
        columns: &dyn Fn(usize) -> Option<DMatrix<f64>>,
    ) -> Result<Option<Vec<Part>>> {
        let Some(looks) = simulated(model::looks(self.data, layout, state, &pushes()))? else {
            return Ok(None);
        };
        self.reduced(layout, state, |w| Cow::Owned(looks[w].with(count, columns(w))))
    }

    /// Parts with the columns of the shared discrepancy after those of the slots, if there is one.
    pub fn with_discrepancy(
        &self,
        layout: &Layout,
        state: &State,
        looks: &[Look],
    ) -> Result<Option<Vec<Part>>> {
        let discrepancy = self.context.as_ref().map(|c| &c.discrepancy).filter(|d| d.count > 0);
        self.reduced(layout, state, |w| match discrepancy {
            Some(d) => Cow::Owned(looks[w].with(d.count, Some(d.columns[w].clone()))),
            None => Cow::Borrowed(&looks[w]),
        })
    }

    /// Parts of looks that are made one at a time: their columns take far more memory than the parts.
    fn reduced<'l>(
        &self,
        layout: &Layout,
        state: &State,
        look: impl Fn(usize) -> Cow<'l, Look>,
    ) -> Result<Option<Vec<Part>>> {
        let columns = Columns::of(layout, &state.values, self.gravity);
        launch::parts(self.data, &self.frames, look, &columns, &self.scales)
    }
}

/// Whether the data say less of a slot than its prior.
fn is_open(slot: usize, told: &[Told], prior: &Prior) -> bool {
    told.iter().map(|t| t.gram[(slot, slot)]).sum::<f64>() < prior.precision[(slot, slot)]
}

/// A step as far as bounds allow it; fixed values stay.
fn allowed(layout: &Layout, values: &[f64], step: &DVector<f64>) -> DVector<f64> {
    let slots = layout.slots.iter().zip(values).zip(step.iter());
    let taken = slots.map(|((slot, v), s)| match slot.is_fixed {
        true => 0.0,
        false => (v + s).clamp(slot.bounds[0], slot.bounds[1]) - v,
    });
    DVector::from_iterator(step.len(), taken)
}

/// Moves values by a step, trials to their modes, and every window's start along with them.
fn move_by(state: &mut State, looks: &[Look], taken: &DVector<f64>, modes: Vec<Mode>) {
    state.values.iter_mut().zip(taken.iter()).for_each(|(v, step)| *v += step);
    for (w, mode) in modes.iter().enumerate() {
        let before = state.modes.get(w);
        let size = |k: usize| mode.sizes[k] - before.map_or(0.0, |m| m.sizes[k]);
        let push = |k: usize| mode.pushes[k].1 - before.map_or(0.0, |m| m.pushes[k].1);
        let slots = (0..taken.len()).map(|k| taken[k] + size(k));
        let all = slots.chain((0..mode.pushes.len()).map(push)).collect::<Vec<_>>();
        let moved = looks[w].start_step(&DVector::from_vec(all));
        state.nuisances[w].iter_mut().zip(moved.iter()).for_each(|(n, m)| *n += m.clamp(-50.0, 50.0));
    }
    state.modes = modes;
}

impl Fitter<'_, '_> {
    /// Prior of a layout's parameters about where it stands.
    pub fn prior(&self, layout: &Layout, state: &State) -> Prior {
        Prior::of(layout, &state.values, &self.range, self.gravity)
    }
}

impl Fitted {
    /// What there is to show of it.
    pub fn shown(&self) -> Shown<'_> {
        Shown { layout: &self.layout, state: &self.state, pass: &self.pass }
    }

    /// Names, sorted.
    pub fn names(&self) -> Vec<&'static str> {
        let mut names: Vec<_> = self.set.iter().map(|e| e.name).collect();
        names.sort_unstable();
        names
    }

    /// Whether a strength stands at an end of its range, where nothing tells how large it is.
    pub fn stands_at_bound(&self) -> bool {
        let is_stuck = |(i, slot): (usize, &Slot)| {
            let value = self.state.values[i];
            let amplitude = self.layout.parameter(i).filter(|p| p.is_amplitude());
            amplitude.is_some_and(|p| slot.bounds.iter().any(|b| *b == value && *b != p.neutral))
        };
        self.layout.slots.iter().enumerate().any(is_stuck)
    }

    /// The same where amplitudes whose range ends at nothing may have either sign, from the other side for those within a standard
    /// deviation of nothing; `None` without one.
    pub fn with_either_sign(&self) -> Option<(Layout, State)> {
        let (mut layout, mut state) = (self.layout.clone(), self.state.clone());
        let mut is_any = false;
        for i in 0..layout.slots.len() {
            let Some(p) = self.layout.parameter(i).filter(|p| p.is_amplitude()) else { continue };
            let slot = &mut layout.slots[i];
            if slot.bounds[0] == p.neutral {
                slot.bounds[0] = p.neutral - (slot.bounds[1] - p.neutral);
                if state.values[i] - p.neutral <= self.covariance[(i, i)].sqrt() {
                    is_any = true;
                    state.values[i] = p.neutral - p.fd_step;
                }
            }
        }
        is_any.then_some((layout, state))
    }

    /// Whether it has all effects of another.
    pub fn holds(&self, other: &Fitted) -> bool {
        other.set.iter().all(|e| self.set.iter().any(|own| own.name == e.name))
    }

    /// This model with `more` terms: where they start, and the rest as it was fitted.
    pub fn joined(&self, more: impl IntoIterator<Item = Term>, settings: usize) -> (Layout, State) {
        let latents: Vec<usize> = self.layout.slots.iter().filter_map(Slot::latent).collect();
        let terms = self.layout.terms.iter().cloned().chain(more).collect();
        let layout = Layout::new(&latents, terms, settings);
        let mut values = layout.start(&[0.0; 3]);
        values[..self.state.values.len()].copy_from_slice(&self.state.values);
        (layout, State::new(values, self.state.nuisances.clone()))
    }

    /// The layout without one of its terms, and the values that it has.
    pub fn without(&self, term: usize, settings: usize) -> (Layout, Vec<f64>) {
        let latents: Vec<usize> = self.layout.slots.iter().filter_map(Slot::latent).collect();
        let mut terms = self.layout.terms.clone();
        terms.remove(term);
        let gone = self.layout.of_term(term);
        let kept = self.state.values.iter().enumerate().filter(|(i, _)| !gone.contains(i));
        (Layout::new(&latents, terms, settings), kept.map(|(_, v)| *v).collect())
    }

    /// Number of effect parameters; one of many settings counts once for comparisons between models.
    pub fn parameters(&self) -> usize {
        self.layout.terms.iter().map(|t| t.free.iter().filter(|f| **f).count()).sum()
    }

    /// Half the width of a slot's 95 % interval; infinite if the data do not tell the value.
    pub fn half_width(&self, slot: usize) -> f64 {
        let information: f64 = self.told.iter().map(|t| t.gram[(slot, slot)]).sum();
        if information <= 0.0 {
            return f64::INFINITY;
        }
        self.quantile() * self.covariance[(slot, slot)].max(0.0).sqrt()
    }

    /// Half the width of a 95 % interval of one standard deviation.
    fn quantile(&self) -> f64 {
        t_quantile(0.05, (self.held.len() as f64 - 1.0).max(1.0))
    }

    /// Root of the mean square residual above the noise, in its units.
    pub fn slow(&self) -> f64 {
        let count: f64 = self.told.iter().map(|t| t.count).sum();
        (self.squares.iter().sum::<f64>() / count.max(1.0) - 1.0).max(0.0).sqrt()
    }

    /// Standard deviation of a slot's value between trials: of its effect as a whole, and what its effect declares; `None` where
    /// it does not differ.
    pub fn spread(&self, slot: usize) -> Option<f64> {
        let strengths = self.layout.strengths(&self.state.values, self.gravity);
        let size = strengths.iter().flatten().find(|(i, _)| *i == slot).map_or(0.0, |(_, size)| *size);
        Some(self.declared_spread(slot).hypot(self.components.strength * size)).filter(|s| *s > 0.0)
    }

    /// Standard deviation between trials of the random acceleration that a slot's effect declares; 0 without one.
    pub fn declared_spread(&self, slot: usize) -> f64 {
        let own = (pushes().iter().zip(&self.components.push)).find_map(|(push, sd)| {
            let What::Parameter(t, p) = self.layout.slots[slot].what else { return None };
            if push.effect.name != self.layout.terms[t].effect.name {
                return None;
            }
            let moved = push.values[p] - push.effect.parameters[p].neutral;
            (moved != 0.0).then(|| sd * moved.abs() / push.unit)
        });
        own.unwrap_or(0.0)
    }
}

/// Held-out squares of all trials, units of the noise.
pub fn held(fit: &Fitted) -> f64 {
    fit.held.iter().sum()
}

/// A candidate that a world refuses to simulate is no candidate; any other error ends the search.
pub fn simulated<T>(fitted: Result<T>) -> Result<Option<T>> {
    match fitted {
        Ok(found) => Ok(Some(found)),
        Err(Error::Input(_) | Error::Failed(_)) => Ok(None),
        Err(other) => Err(other),
    }
}

/// A term's values with amplitudes of some sizes.
pub fn sized(term: &Term, sizes: &[f64]) -> Vec<f64> {
    let mut sizes = sizes.iter();
    let value = |(p, parameter): (usize, &crate::world::effect::ParameterDeclaration)| {
        if !parameter.is_amplitude() || !term.free[p] {
            return term.start[p];
        }
        let value = parameter.neutral + sizes.next().copied().unwrap_or(0.0);
        let [low, high] = parameter.bounds;
        // Off the bound, where nothing could be told.
        let hair = 1e-3 * parameter.fd_step;
        value.clamp(low, high).max(if low == parameter.neutral { low + hair } else { low })
    };
    term.effect.parameters.iter().enumerate().map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::term;

    #[test]
    fn a_step_ends_at_a_bound() {
        let layout = Layout::new(&[], vec![term("quadratic_drag"), term("lift")], 1);
        let step = DVector::from_vec(vec![-0.5, -0.5]);
        assert_eq!(allowed(&layout, &[0.1, 0.1], &step).as_slice(), [-0.1, -0.5]);
    }
}
