//! A model fitted to all launches and scored on each from the others.
//!
//! First by least squares (`model::fit`), which finds the way; then by generalised least squares with the variance components
//! that the launches show, about the new place, until it stays; then held out.

use nalgebra::{DMatrix, DVector};

use super::columns::{self, Columns};
use super::components::{DECLARED, Likelihood, NEAR, SIZES, WIDE};
use super::gaussian::{self, Components, Pooled, Prior, Told};
use super::launch::{self, Frame, Part};
use super::leave_out::leave_out;
use super::library;
use super::model::{self, Data, Extra, Layout, Look, Mode, Pass, Slot, State, Term, What};
use super::modes;
use super::noise::Noise;
use super::robust;
use super::score;
use super::stats::inverse;
use super::window::Kind;
use crate::distribution::f_survival;
use crate::distribution::t_quantile;
use crate::error::{Error, Result};
use crate::world::effect::Effect;

/// Share of what is believed of sizes that is left where the data are asked alone.
const UNBELIEVED: f64 = 1e-4;
/// Most rounds of generalised least squares, and nats of a round below which they end.
const ROUNDS: usize = 8;
const SETTLED: f64 = 0.05;
/// Nats less after a step that are no reason to try a shorter one; nats that a fit promises itself of its next step beyond which
/// it has not come to rest.
const SLIGHT: f64 = 1.0;
/// How far a shape that stays where it is may move, as a share of the difference for derivatives by it.
const FIXED: f64 = 1e-2;
/// Share of a step below which none helps.
const SHORTEST: f64 = 0.2;

/// A model fitted to all trials, and what the others say of each.
pub struct Fitted {
    /// The effects, in the layout's order.
    pub set: Vec<&'static Effect>,
    pub layout: Layout,
    pub state: State,
    pub pass: Pass,
    /// Held-out squares by trial, units of the noise: what gains are told in.
    pub held: Vec<f64>,
    /// Log predictive density by launch: what models are compared by. (A spoilt launch's is not yet spared.)
    pub score: Vec<f64>,
    /// What is left of held-out launches: squares of slow coordinates, in units of the noise.
    pub squares: Vec<f64>,
    /// Variance components, all launches together.
    pub components: Components,
    /// What the slots' values are known by.
    pub covariance: DMatrix<f64>,
    /// Variances of the slots by leaving launches out.
    pub robust: DVector<f64>,
    /// What each part says at the components.
    pub told: Vec<Told>,
    /// What is believed of the slots, about where they stand.
    pub prior: Prior,
    /// Corrected p by term, filled in by the search.
    pub p_values: Vec<f64>,
}

/// Where a fit stands: every window there, what launches say of it, and what the slots are known by.
struct Stand {
    /// Log density of everything, priors included: what a fit climbs.
    quality: f64,
    state: State,
    prior: Prior,
    looks: Vec<Look>,
    parts: Vec<Part>,
    told: Vec<Told>,
    components: Components,
    /// Where launches ask the slots to go, and what they are known by.
    step: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Stand {
    /// What is believed of the slots where launches are predicted. A shape that has not come to rest stays where it is: the model is
    /// not linear as far as it is asked to go, and would promise launches what no value of it keeps. (A gust of a period without
    /// bounds is a wind; told so, it predicted launches better by 20 nats than it could be fitted to them.)
    fn prior(&self, layout: &Layout) -> Prior {
        let mut prior = self.prior.clone();
        if quality(&self.told, &prior, &self.step) < self.quality + SLIGHT {
            return prior;
        }
        for i in (0..layout.slots.len()).filter(|i| layout.shapes(*i)) {
            prior.precision.row_mut(i).fill(0.0);
            prior.precision.column_mut(i).fill(0.0);
            prior.precision[(i, i)] = (FIXED * layout.slots[i].step).powi(-2);
            prior.off[i] = 0.0;
        }
        prior
    }
}

/// Log density of everything with the slots a step away: what launches say and what is believed.
fn quality(told: &[Told], prior: &Prior, step: &DVector<f64>) -> f64 {
    let off = &prior.off - step;
    told.iter().map(|t| t.density(step)).sum::<f64>() - 0.5 * off.dot(&(&prior.precision * &off))
}

/// A model as pictures and the extended scene show it.
#[derive(Clone, Copy)]
pub struct Shown<'a> {
    pub layout: &'a Layout,
    pub state: &'a State,
    pub pass: &'a Pass,
}

/// Fits and scores models of one recording.
pub struct Fitter<'a, 'b> {
    pub data: &'b Data<'a>,
    pub frames: Vec<Frame>,
    /// What a window's residuals, in units of its own scale, are in units of the noise.
    pub scales: Vec<f64>,
    pub folds: Vec<usize>,
}

impl<'a, 'b> Fitter<'a, 'b> {
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
        }
    }

    /// A layout fitted from a start and scored; `None` where it cannot be simulated or its covariance fails.
    pub fn fit(&self, layout: Layout, start: State, rounds: usize) -> Result<Option<Fitted>> {
        match simulated(model::fit(self.data, &layout, start, rounds))? {
            Some((state, _)) => self.refined(layout, state),
            None => Ok(None),
        }
    }

    /// Generalised least squares and the score from a state nearby. A step that makes launches less likely is taken half as far.
    pub fn refined(&self, layout: Layout, state: State) -> Result<Option<Fitted>> {
        let set: Vec<&'static Effect> = layout.terms.iter().map(|t| t.effect).collect();
        let strengths = !layout.strengths(&state.values).is_empty();
        let first = Components::start(&prior(&layout, &state), strengths);
        let Some(mut best) = self.stands(&layout, &set, state, &first, WIDE)? else { return Ok(None) };
        let mut share = 1.0;
        for _ in 0..ROUNDS {
            let next = self.onwards(&layout, &set, &best, share);
            let Some(there) = self.stands(&layout, &set, next, &best.components, NEAR)? else { break };
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
        Ok(self.scored(layout, best))
    }

    /// A state with the components that launches show there; `None` where it cannot be simulated or its covariance fails.
    fn stands(
        &self,
        layout: &Layout,
        set: &[&Effect],
        state: State,
        from: &Components,
        first: f64,
    ) -> Result<Option<Stand>> {
        let Some((looks, parts)) = self.parts(layout, set, &state, &[])? else { return Ok(None) };
        let prior = prior(layout, &state);
        let here = DVector::zeros(layout.slots.len());
        let components = Likelihood::new(&parts, from).most(&prior, first, |_| true);
        let Some(told) = gaussian::all_told(&parts, &components) else { return Ok(None) };
        let quality = quality(&told, &prior, &here);
        let Some(Pooled { step, covariance }) = gaussian::pooled(told.iter(), &prior) else {
            return Ok(None);
        };
        Ok(Some(Stand { quality, state, prior, looks, parts, told, components, step, covariance }))
    }

    /// The state that a share of the step from where a fit stands leads to, launches at their modes.
    fn onwards(&self, layout: &Layout, set: &[&Effect], stand: &Stand, share: f64) -> State {
        let mut state = stand.state.clone();
        let columns = Columns::of(layout, &state.values);
        let taken = allowed(layout, &state.values, &(&stand.step * share));
        let (parts, looks) = (&stand.parts, &stand.looks);
        let mut modes = modes::modes(parts, &columns, &pushes(set), &stand.components, &taken, looks.len());
        // A lift turns what falls straight down sideways, and in second order holds it back: in a plane that nobody saw.
        let unseen = modes.iter_mut().zip(&self.frames).filter(|(_, frame)| !frame.moves_in_plane());
        unseen.flat_map(|(mode, _)| &mut mode.pushes).for_each(|push| push.1 = 0.0);
        move_by(&mut state, looks, &taken, modes);
        state
    }

    /// A model where its fit ended; `None` where what it predicts cannot be told.
    fn scored(&self, layout: Layout, stand: Stand) -> Option<Fitted> {
        let prior = stand.prior(&layout);
        let Stand { state, looks, parts, told, components, covariance, step, .. } = stand;
        let score = score::held_out(&parts, &prior, &components, &self.folds)?;
        if score.iter().any(|s| !s.is_finite()) {
            return None;
        }
        let all = Pooled { step, covariance };
        let robust = robust::variances(&told, &prior, &all);
        let (_, squares) = score::held_out_with(&parts, &told, &prior, &self.folds)?;
        let pass = model::summed(self.data, looks, layout.slots.len());
        let groups: Vec<usize> = (0..pass.trials.len()).collect();
        let (held, _) = leave_out(&layout, &state.values, &pass.trials, self.data.settings, &groups, &[]);
        let set = layout.terms.iter().map(|t| t.effect).collect();
        let p_values = vec![1.0; layout.terms.len()];
        Some(Fitted {
            set,
            layout,
            state,
            pass,
            held,
            score,
            squares,
            components,
            covariance: all.covariance,
            robust,
            told,
            prior,
            p_values,
        })
    }

    /// Every window at a state and what launches say of it, with columns for `extras` after those of the slots.
    pub fn parts(
        &self,
        layout: &Layout,
        set: &[&Effect],
        state: &State,
        extras: &[Extra],
    ) -> Result<Option<(Vec<Look>, Vec<Part>)>> {
        let all: Vec<Extra> = pushes(set).into_iter().chain(extras.iter().cloned()).collect();
        let Some(looks) = simulated(model::looks(self.data, layout, state, &all))? else { return Ok(None) };
        let parts = self.reduced(layout, state, &looks);
        Ok(parts.map(|parts| (looks, parts)))
    }

    /// As [`Fitter::parts`], with `count` columns given by window: two rows a point.
    pub fn parts_with(
        &self,
        layout: &Layout,
        set: &[&Effect],
        state: &State,
        count: usize,
        columns: &dyn Fn(usize) -> Option<DMatrix<f64>>,
    ) -> Result<Option<Vec<Part>>> {
        let pushes = pushes(set);
        let Some(mut looks) = simulated(model::looks(self.data, layout, state, &pushes))? else {
            return Ok(None);
        };
        for (w, look) in looks.iter_mut().enumerate() {
            look.append(count, columns(w));
        }
        Ok(self.reduced(layout, state, &looks))
    }

    fn reduced(&self, layout: &Layout, state: &State, looks: &[Look]) -> Option<Vec<Part>> {
        let columns = Columns::of(layout, &state.values);
        launch::parts(self.data.windows, &self.frames, looks, &columns, &self.scales)
    }
}

fn pushes(set: &[&Effect]) -> Vec<Extra> {
    columns::pushes_beside(set).into_iter().map(|p| p.1).collect()
}

/// A step as far as bounds allow it.
fn allowed(layout: &Layout, values: &[f64], step: &DVector<f64>) -> DVector<f64> {
    let slots = layout.slots.iter().zip(values).zip(step.iter());
    let taken = slots.map(|((slot, v), s)| (v + s).clamp(slot.bounds[0], slot.bounds[1]) - v);
    DVector::from_iterator(step.len(), taken)
}

/// Moves values by a step, launches to their modes, and every window's start along with them.
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

/// How far a slot's value may differ from launch to launch without naming anything.
fn differs(layout: &Layout, slot: usize) -> f64 {
    let What::Parameter(t, p) = layout.slots[slot].what else { return 0.0 };
    let effect = layout.terms[t].effect;
    let place = (0..p).filter(|k| effect.parameters[*k].is_amplitude()).count();
    effect.between_trial_sd.get(place).copied().unwrap_or(0.0)
}

/// Least deviation of a size between settings, as a share of what is plausible.
const BETWEEN: f64 = 0.05;

/// Weak priors of a layout's slots about where it stands. Sizes by setting are drawn about a mean of their own, as far as they
/// are seen to differ: a setting that no other launch tells is one like the others.
pub fn prior(layout: &Layout, state: &State) -> Prior {
    let q = layout.slots.len();
    let none = || vec![0.0; q];
    let mut out = Prior {
        precision: DMatrix::zeros(q, q),
        off: DVector::zeros(q),
        plausible: none(),
        reason: none(),
        by_setting: layout.slots.iter().map(|s| s.setting.is_some()).collect(),
    };
    for (i, slot) in layout.slots.iter().enumerate() {
        let parameter = match slot.what {
            What::Parameter(t, p) => Some(&layout.terms[t].effect.parameters[p]),
            What::Latent(_) => None,
        };
        let Some(parameter) = parameter.filter(|p| p.prior_sd.is_finite()) else {
            out.precision[(i, i)] = slot.ridge();
            continue;
        };
        out.off[i] = parameter.neutral - state.values[i];
        out.reason[i] = (SIZES * out.off[i].abs()).max(DECLARED * differs(layout, i));
        out.plausible[i] = if parameter.is_amplitude() { parameter.prior_sd } else { 0.0 };
        let alike: Vec<usize> = (0..q).filter(|j| layout.slots[*j].what == slot.what).collect();
        if alike.len() < 2 {
            out.precision[(i, i)] = parameter.prior_sd.powi(-2);
        }
        if alike.len() < 2 || alike[0] != i {
            continue;
        }
        let n = alike.len() as f64;
        let mean = alike.iter().map(|j| state.values[*j]).sum::<f64>() / n;
        let between = alike.iter().map(|j| (state.values[*j] - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let between = between.max((BETWEEN * parameter.prior_sd).powi(2));
        // Inverse of between I + plausible^2 J.
        let shared = parameter.prior_sd.powi(2) / (between + n * parameter.prior_sd.powi(2));
        for (j, k) in alike.iter().flat_map(|j| alike.iter().map(move |k| (*j, *k))) {
            out.precision[(j, k)] = (f64::from(j == k) - shared) / between;
        }
    }
    out
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

    /// p of the hypothesis that a term's amplitudes are all nothing (Wald); not corrected for the search.
    pub fn p_value(&self, term: usize) -> f64 {
        let own: Vec<usize> =
            self.layout.of_term(term).into_iter().filter(|i| !self.layout.shapes(*i)).collect();
        let off = DVector::from_fn(own.len(), |i, _| self.state.values[own[i]] - self.neutral(own[i]));
        let v = DMatrix::from_fn(own.len(), own.len(), |i, j| self.covariance[(own[i], own[j])]);
        let (p, g) = (own.len() as f64, self.score.len() as f64);
        f_survival(off.dot(&(inverse(&v) * &off)) / p, p, (g - p).max(1.0))
    }

    /// Half the width of a slot's 95 % interval; infinite if the data do not tell the value.
    pub fn half_width(&self, slot: usize) -> f64 {
        let information: f64 = self.told.iter().map(|t| t.gram[(slot, slot)]).sum();
        if information <= 0.0 {
            return f64::INFINITY;
        }
        self.quantile() * self.covariance[(slot, slot)].max(self.robust[slot]).max(0.0).sqrt()
    }

    /// Half the width of a 95 % interval of one standard deviation.
    fn quantile(&self) -> f64 {
        t_quantile(0.05, (self.score.len() as f64 - 1.0).max(1.0))
    }

    /// Half the widths of all slots' 95 % intervals where next to nothing is believed of sizes: large where the data tell a slot
    /// only together with others.
    pub fn half_widths_without_belief(&self) -> Vec<f64> {
        let here = DVector::zeros(self.layout.slots.len());
        let mut gram = prior(&self.layout, &self.state).precision * UNBELIEVED;
        self.told.iter().for_each(|t| gram += &t.gram * t.weight(&here));
        let Some(factor) = gram.cholesky() else { return vec![f64::INFINITY; here.len()] };
        let quantile = self.quantile();
        factor.inverse().diagonal().iter().map(|v| quantile * v.max(0.0).sqrt()).collect()
    }

    /// The value of a slot at which its effect vanishes; a latent's own value.
    pub fn neutral(&self, slot: usize) -> f64 {
        match self.layout.slots[slot].what {
            What::Parameter(t, p) => self.layout.terms[t].effect.parameters[p].neutral,
            What::Latent(_) => self.state.values[slot],
        }
    }

    /// Whether a slot's effect is there for how it differs from launch to launch alone: it has a reason to, and does so by more
    /// than every launch may, and than its mean is known.
    pub fn is_there_by_spread(&self, slot: usize) -> bool {
        let usual = differs(&self.layout, slot);
        usual > 0.0 && self.spread(slot).is_some_and(|s| s > usual && s > self.half_width(slot))
    }

    /// Root of the mean square of what held-out launches leave above the noise, in its units.
    pub fn slow(&self) -> f64 {
        let count: f64 = self.told.iter().map(|t| t.count).sum();
        (self.squares.iter().sum::<f64>() / count.max(1.0) - 1.0).max(0.0).sqrt()
    }

    /// Standard deviation of a slot's value from launch to launch, by itself and with its effect's strength; `None` where it does
    /// not differ.
    pub fn spread(&self, slot: usize) -> Option<f64> {
        let own = self.components.spread.get(slot).copied().unwrap_or(0.0);
        let strengths = self.layout.strengths(&self.state.values);
        let size = strengths.iter().flatten().find(|(i, _)| *i == slot).map_or(0.0, |(_, size)| *size);
        Some(own.hypot(self.components.strength * size)).filter(|s| *s > 0.0)
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
        let [low, high] = library::bounds(term.effect, parameter);
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

    /// Two settings' lifts are drawn about a mean of their own: a setting of which nothing is known is one like the other. A lift
    /// may differ by launch as far as its effect declares, however small it is.
    #[test]
    fn sizes_by_setting_have_a_mean() {
        let lift = Term { per_setting: true, ..term("lift") };
        let layout = Layout::new(&[], vec![lift, term("quadratic_drag")], 2);
        let prior = prior(&layout, &State::new(vec![0.5, 0.3, 0.1], Vec::new()));
        assert!(prior.precision[(0, 1)] < 0.0 && prior.precision[(0, 2)] == 0.0);
        assert_eq!(prior.by_setting, [true, true, false]);
        let usual = term("lift").effect.between_trial_sd[0];
        assert_eq!(prior.reason[..2], [DECLARED * usual; 2]);
        assert!((prior.reason[2] - SIZES * 0.1).abs() < 1e-12);
    }
}
