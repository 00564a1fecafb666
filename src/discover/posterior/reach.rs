//! How far the beginnings of trials go on: as far as the model, where it is fitted, predicts them.
//!
//! A beginning starts where everything is known, so that all of it is of the model's values alone: it tells a hundred times as much
//! as the same stretch from a start that has to be found. But where the model lacks something, what it predicts is wrong from some
//! time on, and any values that come nearer are wrong ones. So beginnings grow in stages; from each fit, those that leave the noise
//! end before they do, and stretches whose starts are found along take over from there.

use std::cmp::Ordering;
use std::collections::HashMap;

use super::unnamed::Unnamed;
use crate::discover::base;
use crate::discover::model::{self, Data, Frozen, Layout, Pass, Slot, State, Term};
use crate::discover::noise::Noise;
use crate::discover::prepare::Ready;
use crate::discover::stats::median;
use crate::discover::survey;
use crate::discover::window::{Kind, Point, Window, leave_runs};
use crate::error::Result;
use crate::trajectory::Trajectory;
use crate::world::{Engine, Sample};

/// Most intervals of beginnings, stage by stage.
pub const STAGES: [usize; 3] = [8, 12, 16];
/// Most intervals of a beginning at all.
pub const RUN: usize = STAGES[2];
/// Standard deviations of the noise that a prediction is off by where it is no longer one.
const OFF: f64 = 6.0;
/// Steps of a fit between stages.
const STEPS: usize = 6;

/// What a set's model is fitted to, and where its fit stands.
pub struct OfModel {
    pub windows: Vec<Window>,
    /// Scale of the residuals by window, m.
    pub sd: Vec<f64>,
    pub layout: Layout,
    pub state: State,
    pub noise: Noise,
    /// What the longest beginnings lose, by which models of the same trials are judged; see [`Grown`].
    pub left: f64,
    /// A field that the set has no name for, among the layout's terms.
    pub unnamed: Option<Unnamed>,
    /// Points from which draws begin, where such a field is drawn along.
    pub cloud: Vec<Sample>,
}

impl OfModel {
    /// Terms that have names.
    pub fn named(&self) -> &[Term] {
        let unnamed = self.unnamed.as_ref().map_or(0, |u| u.effects.len());
        &self.layout.terms[..self.layout.terms.len() - unnamed]
    }
}

/// What sets' models are fitted to.
pub struct Grounds<'a> {
    pub ready: &'a Ready,
    /// By trial.
    pub observed: &'a [&'a Trajectory],
    pub engine: Engine,
    pub seed: u64,
}

/// The model of a fit, beginnings as long as it predicts them. The fit may stand in a hollow of its own, which longer beginnings
/// contradict: of it, of what is found over longer ones, and of what is found where each number is tried far to either side, whichever
/// predicts them best is taken (MSAC: Torr and Zisserman, Comput. Vis. Image Underst. 78 (2000) 138).
pub fn reached(grounds: &Grounds, layout: &Layout, values: &[f64]) -> Result<OfModel> {
    let shots = Shots::fitted(grounds, layout, values)?;
    let mut best = shots.grown(grounds, layout, values.to_vec())?;
    for most in STAGES.into_iter().skip(1) {
        let windows = cut(&grounds.ready.whole, &vec![f64::INFINITY; grounds.ready.settings.len()], most);
        let (data, start) = shots.data(grounds, &windows, &best.values, best.noise);
        if !survey::possible(&data, layout) {
            break;
        }
        let other = survey::survey(&data, layout, &start, grounds.seed)?;
        best = best.or(shots.grown(grounds, layout, other.values)?);
    }
    let open = cut(&grounds.ready.whole, &vec![f64::INFINITY; grounds.ready.settings.len()], RUN);
    let (data, start) = shots.data(grounds, &open, &best.values, grounds.ready.simulated);
    if survey::possible(&data, layout) {
        let other = survey::ranged(&data, layout, &start)?;
        if other.values != best.values {
            best = best.or(shots.grown(grounds, layout, other.values)?);
        }
    }
    settled(grounds, layout, best)
}

/// What a fit's beginnings are cut to, and where it stands on them.
fn settled(grounds: &Grounds, layout: &Layout, grown: Grown) -> Result<OfModel> {
    let Grown { values, until, noise, left } = grown;
    let windows = cut(&grounds.ready.whole, &until, RUN);
    let (mut data, start) = Shots::fitted(grounds, layout, &values)?.data(grounds, &windows, &values, noise);
    // The last word on starts is of where the values are by now.
    data.frozen.clear();
    let (state, _) = model::fit(&data, layout, start, STEPS)?;
    let sd = data.sd;
    let noise = Noise { sd: noise, ..grounds.ready.noise };
    Ok(OfModel { windows, sd, layout: layout.clone(), state, noise, left, unnamed: None, cloud: Vec::new() })
}

/// Values, and how far beginnings go that they predict.
struct Grown {
    values: Vec<f64>,
    /// When each trial's beginning ends, s.
    until: Vec<f64>,
    /// Noise of an observed coordinate, m.
    noise: f64,
    /// Loss over the longest beginnings: of each observation the mean square of its coordinates, in squares of [`OFF`] deviations of one noise
    /// for all fits; 1 where it is off or comes after one that is.
    left: f64,
}

impl Grown {
    /// Whichever leaves less.
    fn or(self, other: Grown) -> Grown {
        if other.left < self.left { other } else { self }
    }
}

/// Every stretch whose start was found along, fitted at some values.
struct Shots {
    /// By trial and place among the whole windows.
    known: HashMap<(usize, u64), Known>,
}

/// A stretch's start, how it moves with it, and whether it went as simulated.
struct Known {
    nuisances: Vec<f64>,
    frozen: Frozen,
    counts: bool,
}

impl Shots {
    fn fitted(grounds: &Grounds, layout: &Layout, values: &[f64]) -> Result<Shots> {
        let windows: Vec<Window> =
            grounds.ready.whole.iter().filter(|w| w.kind == Kind::Shot).cloned().collect();
        let sd = vec![grounds.ready.simulated; windows.len()];
        let mut data = Data::new(&windows, &grounds.ready.settings, sd, grounds.engine);
        let start = State::new(values.to_vec(), windows.iter().map(|w| w.nuisances.clone()).collect());
        let nuisances = base::guessed(&data, grounds.observed, layout, &start)?;
        let (state, pass) = model::fit(&data, layout, State { nuisances, ..start }, STEPS)?;
        base::leave_astray(&mut data, &pass);
        let latents: Vec<usize> = layout.slots.iter().filter_map(Slot::latent).collect();
        let only = Layout::new(&latents, Vec::new(), 1);
        let at = State::new(state.values[..latents.len()].to_vec(), state.nuisances.clone());
        model::freeze(&mut data, &only, &at)?;
        let frozen = std::mem::take(&mut data.frozen);
        let known = windows.iter().zip(state.nuisances).zip(frozen).zip(&data.sd);
        let known = known.map(|(((w, nuisances), frozen), sd)| {
            ((w.trial, w.start.to_bits()), Known { nuisances, frozen, counts: sd.is_finite() })
        });
        Ok(Shots { known: known.collect() })
    }

    /// Values fitted to beginnings that grow in stages, as far as they are predicted.
    fn grown(&self, grounds: &Grounds, layout: &Layout, mut values: Vec<f64>) -> Result<Grown> {
        let mut noise = grounds.ready.simulated;
        let open = vec![f64::INFINITY; grounds.ready.settings.len()];
        let mut until = open.clone();
        for most in STAGES {
            // What the last stage's values did not predict, this one's may.
            until.clone_from(&open);
            let all = cut(&grounds.ready.whole, &open, most);
            let (data, start) = self.data(grounds, &all, &values, noise);
            let shown = model::shown(&data, layout, &start)?;
            ends(&all, &shown, noise, &mut until);
            let windows = cut(&grounds.ready.whole, &until, most);
            let (data, start) = self.data(grounds, &windows, &values, noise);
            let (state, pass) = model::fit(&data, layout, start, STEPS)?;
            values = state.values;
            noise = noise_of(&windows, &pass, grounds.ready.simulated);
        }
        until.clone_from(&open);
        let all = cut(&grounds.ready.whole, &open, RUN);
        let (data, start) = self.data(grounds, &all, &values, noise);
        let shown = model::shown(&data, layout, &start)?;
        ends(&all, &shown, noise, &mut until);
        let left = left(&all, &shown, grounds.ready.simulated, &mut open.clone());
        Ok(Grown { values, until, noise, left })
    }

    /// Windows as data, and where they start.
    fn data<'a>(
        &self,
        grounds: &'a Grounds,
        windows: &'a [Window],
        values: &[f64],
        simulated: f64,
    ) -> (Data<'a>, State) {
        let of = |w: &Window| self.known.get(&(w.trial, w.start.to_bits())).filter(|_| w.kind == Kind::Shot);
        let scale = |w: &Window| match of(w) {
            Some(known) if !known.counts => f64::INFINITY,
            _ if w.kind.simulated() => simulated,
            _ => grounds.ready.noise.sd,
        };
        let sd = windows.iter().map(scale).collect();
        let mut data = Data::new(windows, &grounds.ready.settings, sd, grounds.engine);
        data.frozen = windows.iter().map(|w| of(w).map(|k| k.frozen.clone()).unwrap_or_default()).collect();
        let start = |w: &Window| of(w).map_or_else(|| w.nuisances.clone(), |k| k.nuisances.clone());
        (data, State::new(values.to_vec(), windows.iter().map(start).collect()))
    }
}

/// Beginnings of at most so many intervals that end before `until`, by trial, and the stretches after them.
pub fn cut(all: &[Window], until: &[f64], most: usize) -> Vec<Window> {
    let shortened = |w: &Window| {
        if w.kind != Kind::Run {
            return Some(w.clone());
        }
        let bodies = w.scene.bodies.len().max(1);
        let mut points = w.points.clone();
        points.truncate(most * bodies);
        points.retain(|p| p.time < until[w.trial]);
        let last = points.last()?.time;
        let mut out = Window { points, ..w.clone() };
        out.scene.steps =
            ((last / w.scene.time_step).round() as u32 + u32::from(w.scene.observe_every == 1)).max(1);
        Some(out)
    };
    let mut windows: Vec<Window> = all.iter().filter_map(shortened).collect();
    leave_runs(&mut windows);
    windows
}

/// Ends beginnings before the first observation that is off by more than noise, of what is shown by window.
fn ends(windows: &[Window], shown: &[Vec<f64>], sd: f64, until: &mut [f64]) {
    for (window, shown) in windows.iter().zip(shown).filter(|(w, _)| w.kind == Kind::Run) {
        let off = |(point, at): &(&Point, &[f64])| {
            // What is no number is far off, too.
            let far =
                |k: usize| (point.seen[k] - at[k]).abs().partial_cmp(&(OFF * sd)) != Some(Ordering::Less);
            far(0) || far(1)
        };
        if let Some((point, _)) = window.points.iter().zip(shown.chunks_exact(2)).find(off) {
            until[window.trial] = until[window.trial].min(point.time - 1e-9);
        }
    }
}

/// [`Grown::left`]; `until`: by trial, when nothing is looked at any more, s, brought forward to what is off first.
pub fn left(windows: &[Window], shown: &[Vec<f64>], sd: f64, until: &mut [f64]) -> f64 {
    ends(windows, shown, sd, until);
    let runs = windows.iter().zip(shown).filter(|(w, _)| w.kind == Kind::Run);
    let of = |(point, at, until): (&Point, &[f64], f64)| {
        let square = |k: usize| ((point.seen[k] - at[k]) / (OFF * sd)).powi(2);
        if point.time < until { (0.5 * (square(0) + square(1))).min(1.0) } else { 1.0 }
    };
    let points = runs.flat_map(|(w, shown)| {
        w.points.iter().zip(shown.chunks_exact(2)).map(|(point, at)| (point, at, until[w.trial]))
    });
    points.map(of).sum()
}

/// Noise of beginnings that are predicted, m, by their median residual; what was known before where there are none.
fn noise_of(windows: &[Window], pass: &Pass, known: f64) -> f64 {
    let runs = windows.iter().zip(&pass.residuals).filter(|(w, _)| w.kind == Kind::Run);
    let all: Vec<f64> = runs.flat_map(|(_, left)| left).map(|r| r.abs()).filter(|r| r.is_finite()).collect();
    // The median of a normal distribution's absolute value is 0.6745 of its deviation.
    let own = median(&all) / 0.674_489_750_196;
    if all.len() >= FEWEST { own.clamp(LEAST * known, known) } else { known }
}

/// Fewest residuals by which noise is told anew, and least share of what was known: beginnings at rest fit themselves.
const FEWEST: usize = 100;
const LEAST: f64 = 0.2;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::leaps;

    /// Beginnings of one body, three observations each, and what is shown of them.
    fn runs(off: [[f64; 3]; 2]) -> (Vec<Window>, Vec<Vec<f64>>) {
        let template = leaps(0.0).0.remove(0);
        let point = |k: usize| Point { time: k as f64, seen: [0.0, 0.0], ..template.points[0] };
        let run = |trial: usize| Window {
            trial,
            kind: Kind::Run,
            points: (1..=3).map(point).collect(),
            ..template.clone()
        };
        let shown = off.map(|own| own.iter().flat_map(|x| [*x, 0.0]).collect());
        (vec![run(0), run(1)], shown.to_vec())
    }

    /// Squares count in proportion up to where a beginning is off, and from there on all alike, whatever noise a fit took itself to have.
    #[test]
    fn what_is_off_and_what_follows_counts_as_lost() {
        let of = |off| {
            let (windows, shown) = runs(off);
            left(&windows, &shown, 0.1, &mut [f64::INFINITY; 2])
        };
        assert_eq!(of([[0.0; 3]; 2]), 0.0);
        let square = |x: f64| 0.5 * (x / (OFF * 0.1)).powi(2);
        assert!((of([[0.3, 0.0, 0.1], [0.0; 3]]) - square(0.3) - square(0.1)).abs() < 1e-12);
        assert!((of([[0.3, 0.7, 0.0], [0.0, 0.0, 0.2]]) - square(0.3) - 2.0 - square(0.2)).abs() < 1e-12);
        assert_eq!(of([[f64::NAN, 0.0, 0.0], [0.0; 3]]), 3.0);
    }

    #[test]
    fn of_two_fits_that_which_leaves_less_is_taken() {
        let grown = |left| Grown { values: vec![left], until: Vec::new(), noise: 0.0, left };
        assert_eq!(grown(2.0).or(grown(1.0)).left, 1.0);
        assert_eq!(grown(1.0).or(grown(2.0)).left, 1.0);
        assert_eq!(grown(1.0).or(grown(f64::NAN)).left, 1.0);
    }
}
