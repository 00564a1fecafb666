//! How likely trials are at any values of latents and effects' parameters: the likelihood that posteriors are drawn from.
//!
//! Windows are simulated anew at the values, from the starts that the fit found; what they show is taken against what was seen, in
//! coordinates across the start (restricted likelihood: what another start would do as well does not count), under the variance
//! components that launches may have: where parts depend on them, the likelihood is the mean over components drawn at the fit, of each
//! likelihood relative to what it is at the fit ([`super::under`]). Parts of launches are multivariate Student t. What launches have in common
//! that the model lacks, a force field of some strength, is integrated out ([`super::discrepancy`]).
//!
//! Sources: as in `launch`; model discrepancy integrated out: Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425.
//!
//! Differences from the source: how windows depend on their starts is as at the fit; within a window that dependence is taken for
//! straight. Components are drawn once, where the fit stands, and the most that launches have reason to differ by is as there: points
//! far from it are told by few of the draws. At the fit itself the likelihood is that of the fit's components, and log evidence with it: a
//! model with more components pays nothing for them.

use std::borrow::Cow;

use nalgebra::DVector;
use rayon::prelude::*;

use super::along::{Along, BELIEVED};
use super::discrepancy::Field;
use super::under::{Place, Under};
use super::unnamed::{Lacks, Unnamed};
use crate::discover::components;
use crate::discover::field::Over;
use crate::discover::fit::{Fitted, Fitter};
use crate::discover::launch::{self, Part};
use crate::discover::model::{self, Layout, Look, Mode, State};
use crate::discover::window::Window;
use crate::error::Result;
use crate::estimate::forces::UnnamedForces;
use crate::estimate::sampler::{Marginal, Prior, Reference, Target, log_sum_exp, one_of};
use crate::rng;
use crate::task::Scene;
use crate::world::{Engine, Rollout, Sample, simulate_map};

/// By how much the reference is wider than the fit says.
pub const WIDER: f64 = 1.5;
/// Points whose rollouts are made together.
const TOGETHER: usize = 64;
/// Draws of the variance components over which a likelihood is the mean.
const DRAWN: usize = 16;

/// The likelihood of trials, ready to be evaluated.
pub struct Density {
    layout: Layout,
    prior: Prior,
    engine: Engine,
    windows: Vec<Kept>,
    /// Under components as they may be, without draws whose covariance fails; under those of the fit alone where parts depend on none.
    under: Vec<Under>,
    /// What each kind of shared field is made of.
    kinds: Vec<Unnamed>,
    /// The field that the model has, if it has one: drawn along.
    along: Option<Along>,
}

/// Shared fields as they may be, one of a kind for some draws.
#[derive(Clone, Debug, PartialEq)]
pub struct Carried {
    pub over: Over,
    pub forces: UnnamedForces,
}

/// Windows of parts that depend on the values, and their places; `None` where a covariance fails.
type Windows = Option<(Vec<Kept>, Vec<Place>)>;

/// What points lack.
pub struct Lacking {
    /// Probability of each shared field over all points, none first.
    pub fields: Vec<(Field, f64)>,
    /// What it may be in each.
    pub carried: Vec<Carried>,
}

/// A window that depends on the values.
struct Kept {
    window: Window,
    /// As it stands at its start.
    scene: Scene,
    nuisances: Vec<f64>,
    mode: Option<Mode>,
    /// What it showed at the fit, two numbers a point, m.
    shown: Vec<f64>,
    /// Index of its part.
    part: usize,
}

impl Density {
    /// Of the windows of a fitted model, and of shared fields that may be there beside it; `seed`: of components. `None` where the model cannot
    /// be simulated or its covariance fails.
    pub fn new(
        fitter: &Fitter,
        fit: &Fitted,
        prior: Prior,
        lacks: &Lacks,
        seed: u64,
    ) -> Result<Option<Density>> {
        let (data, layout, state) = (fitter.data, &fit.layout, &fit.state);
        let Some((looks, parts)) = fitter.parts(layout, &fit.set, state, &lacks.extras())? else {
            return Ok(None);
        };
        let Some((windows, places)) = kept(fitter, fit, &looks, &parts)? else { return Ok(None) };
        let new = |c, before| Under::new(&parts, &places, c, layout.slots.len(), (lacks, before));
        let Some(at_fit) = new(&fit.components, None) else { return Ok(None) };
        let along = match lacks {
            Lacks::Known(unnamed) => match Along::new(&at_fit.parts, unnamed, &fit.prior.precision) {
                None => return Ok(None),
                found => found,
            },
            Lacks::Nothing | Lacks::Any(_) => None,
        };
        let mut likely = components::Likelihood::new(&parts, &fit.components);
        let mut under = Vec::new();
        if likely.depend() {
            let drawn = likely.drawn(&fit.prior, DRAWN, &mut rng::stream(seed, "components"));
            under = drawn.par_iter().filter_map(|c| Some(new(c, Some(&at_fit))?.ready())).collect();
        }
        if under.is_empty() {
            under.push(at_fit.ready());
        }
        let drawn = along.iter().flat_map(|along| along.amounts()).map(|_| BELIEVED);
        let prior = Prior::new(prior.marginals().iter().copied().chain(drawn).collect())?;
        Ok(Some(Density {
            layout: layout.clone(),
            prior,
            engine: data.engine,
            windows,
            under,
            kinds: lacks.kinds(),
            along,
        }))
    }

    /// Windows that are simulated for a likelihood, and all parts.
    pub fn sizes(&self) -> (usize, usize) {
        (self.windows.len(), self.under[0].parts.len())
    }

    /// Memory that it takes, without the windows' scenes, bytes.
    pub fn bytes(&self) -> usize {
        let windows = self.windows.iter().map(|k| 4 * k.shown.len());
        size_of::<f64>() * windows.chain(self.under.iter().map(Under::numbers)).sum::<usize>()
    }

    /// Where draws begin of which nothing but a fit is known: about where points are likely, as far as everything is straight.
    pub fn reference(&self, fit: &Fitted) -> Reference {
        let inside = |(v, m): (&f64, &Marginal)| {
            let [low, high] = m.bounds();
            v.clamp(low, high)
        };
        let (likeliest, mut covariance) = match &self.along {
            Some(along) => {
                let (at, covariance) = along.likeliest(&fit.state.values);
                (at, covariance.clone())
            }
            None => (fit.state.values.clone(), fit.covariance.clone()),
        };
        let at: Vec<f64> = likeliest.iter().zip(self.prior.marginals()).map(inside).collect();
        for i in 0..fit.state.values.len() {
            // Launches that disagree know less than each of them claims.
            let share = (fit.robust[i] / covariance[(i, i)]).max(1.0);
            if share.is_finite() {
                covariance.row_mut(i).scale_mut(share.sqrt());
                covariance.column_mut(i).scale_mut(share.sqrt());
            }
        }
        Reference::new(&at, &covariance, WIDER, &self.prior)
    }

    /// The model's layout at a point.
    fn layout_at(&self, point: &[f64]) -> Cow<'_, Layout> {
        match &self.along {
            Some(along) => Cow::Owned(along.layout(&self.layout, point)),
            None => Cow::Borrowed(&self.layout),
        }
    }

    /// By point: by how much what every window shows there is off what it showed at the fit, m.
    fn off(&self, points: &[Sample]) -> Result<Vec<Vec<DVector<f64>>>> {
        let simulated: Vec<usize> =
            (0..self.windows.len()).filter(|w| self.windows[*w].window.kind.simulated()).collect();
        let integrated: Vec<usize> =
            (0..self.windows.len()).filter(|w| !self.windows[*w].window.kind.simulated()).collect();
        let layouts: Vec<Cow<Layout>> = points.iter().map(|p| self.layout_at(p)).collect();
        let mut physics = Vec::with_capacity(points.len() * simulated.len());
        // Window by window, so that lanes of a batch roll the same scene out.
        for w in &simulated {
            let window = &self.windows[*w].window;
            let at = layouts.iter().zip(points);
            physics.extend(at.map(|(layout, p)| layout.physics(p, window.setting, window.start)));
        }
        let n = points.len().max(1);
        let of = |i: usize| &self.windows[simulated[i / n]];
        let rollouts: Vec<Rollout> = physics
            .iter()
            .enumerate()
            .map(|(i, physics)| of(i).window.rollout(&of(i).scene, physics))
            .collect();
        let by_engine = simulate_map(&rollouts, self.engine, |i, path| {
            let w = simulated[i / n];
            self.windows[w].off(&model::predicted(&self.windows[w].window, &path))
        })?;
        let by_hand = |i: usize| {
            let kept = &self.windows[integrated[i / n]];
            let state = State {
                modes: kept.mode.iter().cloned().collect(),
                ..State::new(points[i % n].clone(), vec![kept.nuisances.clone()])
            };
            kept.off(&model::seen(&kept.window, &layouts[i % n], &state))
        };
        let by_hand: Vec<DVector<f64>> =
            (0..integrated.len() * points.len()).into_par_iter().map(by_hand).collect();
        let mut out = vec![vec![DVector::zeros(0); self.windows.len()]; points.len()];
        for (of, all) in [(&simulated, by_engine), (&integrated, by_hand)] {
            for (i, off) in all.into_iter().enumerate() {
                out[i % n][of[i / n]] = off;
            }
        }
        Ok(out)
    }

    /// What every part leaves where windows are so far off, under each of the components.
    fn left(&self, off: &[DVector<f64>]) -> Vec<Vec<DVector<f64>>> {
        let of = |under: &Under| {
            let mut left = under.left();
            for ((kept, map), off) in self.windows.iter().zip(&under.maps).zip(off) {
                left[kept.part] += map * off;
            }
            left
        };
        self.under.iter().map(of).collect()
    }

    /// Of every point, by its number, what parts leave there.
    fn at_each<T: Send>(
        &self,
        points: &[Sample],
        of: impl Fn(usize, &[Vec<DVector<f64>>]) -> T + Sync,
    ) -> Result<Vec<T>> {
        let mut out = Vec::with_capacity(points.len());
        for together in points.chunks(TOGETHER) {
            let (first, off) = (out.len(), self.off(together)?);
            out.par_extend(off.par_iter().enumerate().map(|(i, off)| of(first + i, &self.left(off))));
        }
        Ok(out)
    }

    /// Log likelihoods of what is left under each of the components, beside every shared field: `[components][field]`.
    fn under_each(&self, left: &[Vec<DVector<f64>>]) -> Vec<Vec<f64>> {
        self.under.iter().zip(left).map(|(under, left)| under.log_likelihoods(left)).collect()
    }

    /// What is lacking at points drawn from the posterior.
    pub fn lacking(&self, points: &[Sample], seed: u64) -> Result<Lacking> {
        if let Some(along) = &self.along {
            let none = Field { over: None, strength: 0.0 };
            let field = along.field(points);
            let carried = field.over.map(|over| Carried { over, forces: along.forces(points) });
            return Ok(Lacking {
                fields: vec![(none, 0.0), (field, 1.0)],
                carried: carried.into_iter().collect(),
            });
        }
        let of = |i: usize, left: &[Vec<DVector<f64>>]| {
            let under_each = self.under_each(left);
            let mut stream = rng::stream(rng::derive(seed, "draw", i as u64), "field");
            let mixed: Vec<f64> = under_each.iter().map(|of| log_sum_exp(of.iter().copied())).collect();
            let k = one_of(&mixed, &mut stream).unwrap_or(0);
            let drawn = self.under[k].discrepancy.drawn(&left[k], &under_each[k], &mut stream);
            (beside(&under_each), drawn)
        };
        let (all, drawn): (Vec<_>, Vec<_>) = self.at_each(points, of)?.into_iter().unzip();
        let carried = (0..self.kinds.len()).filter_map(|kind| self.carried(kind, &drawn)).collect();
        let discrepancy = &self.under[0].discrepancy;
        let fields = discrepancy.fields().into_iter().zip(discrepancy.probabilities(&all)).collect();
        Ok(Lacking { fields, carried })
    }

    /// Those fields that are of a kind, if there are any.
    fn carried(&self, kind: usize, drawn: &[Option<(usize, DVector<f64>)>]) -> Option<Carried> {
        let own = drawn.iter().enumerate().filter_map(|(i, d)| d.as_ref().map(|(k, more)| (i, *k, more)));
        let unnamed = &self.kinds[kind];
        let (draws, amplitudes): (Vec<usize>, Vec<Vec<f64>>) =
            own.filter(|(_, k, _)| *k == kind).map(|(i, _, more)| (i, unnamed.amplitudes(more))).unzip();
        let forces = UnnamedForces { effects: unnamed.shapes(), draws, amplitudes };
        (!forces.draws.is_empty()).then_some(Carried { over: unnamed.over, forces })
    }
}

fn kept(fitter: &Fitter, fit: &Fitted, looks: &[Look], parts: &[Part]) -> Result<Windows> {
    let (data, layout, state) = (fitter.data, &fit.layout, &fit.state);
    let mut shown = model::shown(data, layout, state)?;
    let (mut windows, mut places) = (Vec::new(), Vec::new());
    for (p, part) in parts.iter().enumerate() {
        let mut row = 0;
        for block in &part.blocks {
            let w = block.window;
            let (window, look) = (&data.windows[w], &looks[w]);
            let moves = |k: usize| look.columns.column(k).amax() > 0.0;
            if !layout.terms.is_empty() || (0..layout.slots.len()).any(moves) {
                let by = launch::by_position((w, window), &fitter.frames[w], look, fitter.scales[w]);
                let Some(by_position) = by else { return Ok(None) };
                places.push(Place { part: p, row, by_position });
                windows.push(Kept {
                    scene: model::placed(window, &state.nuisances[w]),
                    window: window.clone(),
                    nuisances: state.nuisances[w].clone(),
                    mode: state.modes.get(w).cloned(),
                    shown: std::mem::take(&mut shown[w]),
                    part: p,
                });
            }
            row += block.left.len();
        }
    }
    Ok(Some((windows, places)))
}

impl Kept {
    /// By how much `shown` is off what the window showed at the fit, m.
    fn off(&self, shown: &[f64]) -> DVector<f64> {
        let of = |i: usize, _| self.shown[i] - shown.get(i).copied().unwrap_or(f64::NAN);
        DVector::from_fn(self.shown.len(), of)
    }
}

/// Log likelihoods beside every shared field, of those under each of the components: their mean.
fn beside(under_each: &[Vec<f64>]) -> Vec<f64> {
    let count = libm::log(under_each.len() as f64);
    let fields = under_each.first().map_or(0, Vec::len);
    (0..fields).map(|f| log_sum_exp(under_each.iter().map(|of| of[f])) - count).collect()
}

impl Target for Density {
    fn prior(&self) -> &Prior {
        &self.prior
    }

    fn alone(&self) -> usize {
        if self.along.is_some() { self.layout.slots.len() } else { 0 }
    }

    fn log_likelihoods(&self, points: &[Sample]) -> Result<Vec<f64>> {
        self.at_each(points, |_, left| log_sum_exp(beside(&self.under_each(left))))
    }
}
