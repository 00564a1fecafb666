//! A search of the whole range of values, for trials whose starts are known.
//!
//! Where things collide the way downhill from the nominal latents ends in the first hollow: the right friction and a
//! rough floor are far apart, and in between every collision goes another way. Stretches that start from what was seen
//! have no nuisances, so many values can simply be tried: the cross-entropy method over latents and parameters at once,
//! each stretch counting by the logarithm of how far off it is, so that those that fit say more than those that went
//! astray. Where that meets too narrow a place, numbers are tried on grids: one after the other, and two together that make
//! up for each other.
//!
//! Sources: the cross-entropy method (Rubinstein and Kroese 2004); Cauchy's likelihood as a redescending loss (Huber and
//! Ronchetti, Robust Statistics, chapter 4).

use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, StandardNormal};

use super::library;
use super::model::{self, Data, Layout, Look, Slot, State, What};
use super::window::{self, Kind};
use crate::error::Result;
use crate::rng;
use crate::world::effect::{ActsOn, Parameter, Role, Shape};
use crate::world::latent::FACTORS;

/// Values tried in a round for each number searched for, and the fewest; the share of the best that the next round is
/// drawn about; rounds, and how many more for each number that only shapes an effect.
const SAMPLES: [usize; 2] = [14, 48];
const ELITES: f64 = 0.2;
const ROUNDS: [usize; 2] = [14, 2];
/// Share of the old mean and covariance that is kept.
const KEPT: f64 = 0.2;
/// How many times as many values are tried where there are edges, of which as many as elsewhere are the best.
const EDGES: usize = 3;
/// Stretches that take part: so many of those that fit at the start, and of those that do not.
const STRETCHES: usize = 24;
/// Places that frame something.
const FEWEST: usize = 4;
/// Square, over what noise leaves, up to which a stretch fits.
const FITS: f64 = 6.0;
/// Deviation of latents about where they stand, as a share of the range that is usual.
const WIDE: f64 = 0.35;
/// The same share for half of the first round's values.
const NARROW: f64 = 0.02;
/// Shares of the first deviations from which edges are searched for again.
const CLOSER: [f64; 3] = [0.2, 0.05, 0.02];
/// Widths of a scan, as shares of the deviation, each about the best value of the one before, and the values tried on each
/// side: where there are edges, and to end a search. Where nothing is right yet, the place that fits is a few hundredths of
/// the deviation wide. How often every number gets its turn.
const WIDTHS: [(f64, i32); 4] = [(2.0, 100), (0.4, 12), (0.08, 12), (0.015, 12)];
const NEAR: [(f64, i32); 3] = [(0.1, 12), (0.02, 12), (0.004, 12)];
const TURNS: usize = 3;
/// Widths of a grid over two numbers at once, and the values of each tried on each side.
const GRIDS: [(f64, i32); 3] = [(2.0, 20), (0.2, 10), (0.03, 10)];
/// Shares of the places where things go wrong that a frame may leave out on each side.
const MARGINS: [f64; 3] = [0.0, 0.1, 0.3];
/// Size of an amplitude at most, in sizes that are usual.
const MOST: f64 = 3.0;
/// Values that a latent usually has at most.
const USUAL: f64 = 2.0;

/// Whether there is anything to survey: stretches without nuisances, and values that all trials share.
pub fn possible(data: &Data, layout: &Layout) -> bool {
    !layout.slots.is_empty()
        && layout.slots.iter().all(|s| s.setting.is_none())
        && window::leaping(data.windows)
}

/// The state of the best values found about `start`. Edges in space, which paths feel by leaps and bounds as they cross
/// them a step sooner or later, are searched for again, closer and closer: the way downhill does not lead to them.
pub fn survey(data: &Data, layout: &Layout, start: &State, seed: u64) -> Result<State> {
    let looks = model::looks(data, layout, start, &[])?;
    let spread = reach(data, layout, start, &looks);
    let leaps = telling(data, &looks);
    let best = search(data, layout, start, &spread, &leaps, seed)?;
    let best = crossed(data, layout, best, &spread, &leaps)?;
    let mut best = scan(data, layout, best, &spread, &leaps, &NEAR)?;
    if layout.has_edges() {
        let places = places(data, layout, start)?;
        for margin in MARGINS.into_iter().filter(|_| places[0].len() >= FEWEST) {
            let (start, spread) = framed(layout, start, &spread, &places, margin);
            let other = scan(data, layout, start, &spread, &leaps, &WIDTHS)?;
            let losses = model::losses(data, layout, &[best.values.clone(), other.values.clone()], &leaps)?;
            best = if losses[1] < losses[0] { other } else { best };
        }
        // What is right by now of the latents need not be searched for again.
        let own = |(i, s): (usize, &f64)| if layout.slots[i].latent().is_some() { NARROW * s } else { *s };
        let spread: Vec<f64> = spread.iter().enumerate().map(own).collect();
        for share in CLOSER {
            let looks = model::looks(data, layout, &best, &[])?;
            let spread: Vec<f64> = spread.iter().map(|s| share * s).collect();
            let leaps = telling(data, &looks);
            best = search(data, layout, &best, &spread, &leaps, seed)?;
            best = scan(data, layout, best, &spread, &leaps, &WIDTHS)?;
        }
        // An edge is told by the few that cross it: in the end all have their say.
        let spread: Vec<f64> = spread.iter().map(|s| CLOSER[2] * s).collect();
        best = scan(data, layout, best, &spread, &counting(data), &WIDTHS)?;
    }
    Ok(best)
}

/// x and y of the places where the model without the effect goes wrong, each in order, m.
fn places(data: &Data, layout: &Layout, start: &State) -> Result<[Vec<f64>; 2]> {
    let mut without = start.clone();
    for (i, value) in without.values.iter_mut().enumerate() {
        if let Some(amplitude) = layout.parameter(i).filter(|p| p.is_amplitude()) {
            *value = amplitude.neutral;
        }
    }
    let mut places: [Vec<f64>; 2] = Default::default();
    for (look, window) in model::looks(data, layout, &without, &[])?.iter().zip(data.windows) {
        let off = |i: usize| look.residual[2 * i].hypot(look.residual[2 * i + 1]);
        for (i, point) in window.points.iter().enumerate().filter(|_| window.kind == Kind::Leap) {
            if off(i).powi(2) > FITS {
                let from = window.scene.bodies[point.body].position.unwrap_or(point.seen);
                (0..2).for_each(|k| places[k].push(0.5 * (from[k] + point.seen[k])));
            }
        }
    }
    places.iter_mut().for_each(|p| p.sort_by(f64::total_cmp));
    Ok(places)
}

/// A start with edges about `places`, all but the outermost share `margin`, and deviations from it; latents are taken for
/// nearly right.
fn framed(
    layout: &Layout,
    start: &State,
    spread: &[f64],
    places: &[Vec<f64>; 2],
    margin: f64,
) -> (State, Vec<f64>) {
    let at = |k: usize, share: f64| places[k][(share * (places[k].len() - 1) as f64) as usize];
    let (mut framed, mut near) = (start.clone(), spread.to_vec());
    for (i, near) in near.iter_mut().enumerate() {
        let Some(parameter) = layout.parameter(i) else {
            *near *= NARROW;
            continue;
        };
        let Role::Shape(Shape::Edge { axis, end }) = parameter.role else {
            // The way downhill from nothing leads to small amplitudes alone.
            *near = MOST * parameter.size;
            framed.values[i] = parameter.neutral + *near;
            continue;
        };
        let share = if end == 0 { margin } else { 1.0 - margin };
        framed.values[i] = at(axis, share);
        *near = 0.25 * (at(axis, 1.0) - at(axis, 0.0)) + 0.2;
    }
    (framed, near)
}

/// The cross-entropy method over some leaps, from deviations `spread`.
fn search(
    data: &Data,
    layout: &Layout,
    start: &State,
    spread: &[f64],
    leaps: &[usize],
    seed: u64,
) -> Result<State> {
    let shapes = (0..layout.slots.len()).filter(|i| layout.shapes(*i)).count();
    let edges = if layout.has_edges() { EDGES } else { 1 };
    let samples = (SAMPLES[0] * layout.slots.len()).max(SAMPLES[1]) * edges;
    let elite = (ELITES * samples as f64).ceil() as usize / edges;
    let q = layout.slots.len();
    let mut mean = DVector::from_column_slice(&start.values);
    let mut covariance = DMatrix::from_fn(q, q, |i, j| if i == j { spread[i].powi(2) } else { 0.0 });
    let mut stream = rng::stream(seed, "survey");
    let latent = |i: usize| layout.slots[i].latent().is_some();
    let mut best = (f64::INFINITY, start.values.clone());
    for round in 0..ROUNDS[0] + ROUNDS[1] * shapes {
        let factor = root(&covariance);
        let mut tried: Vec<Vec<f64>> = (0..samples)
            .map(|k| {
                let mut draw: DVector<f64> = DVector::from_fn(q, |_, _| StandardNormal.sample(&mut stream));
                if round == 0 && k % 2 == 0 {
                    // The latents may be right already, and it is only the effect that is missing.
                    (0..q).filter(|i| latent(*i)).for_each(|i| draw[i] *= NARROW);
                }
                let value = &mean + &factor * draw;
                let within =
                    |(i, v): (usize, &f64)| v.clamp(layout.slots[i].bounds[0], layout.slots[i].bounds[1]);
                value.iter().enumerate().map(within).collect()
            })
            .collect();
        if round == 0 {
            tried[0].clone_from(&start.values);
        } else {
            tried[0].clone_from(&best.1);
        }
        let losses = model::losses(data, layout, &tried, leaps)?;
        let mut order: Vec<usize> = (0..samples).collect();
        order.sort_by(|a, b| losses[*a].total_cmp(&losses[*b]).then(a.cmp(b)));
        if losses[order[0]] < best.0 {
            best = (losses[order[0]], tried[order[0]].clone());
        }
        let elites: Vec<DVector<f64>> =
            order.iter().take(elite).map(|i| DVector::from_column_slice(&tried[*i])).collect();
        let centre = elites.iter().fold(DVector::zeros(q), |a, e| a + e) / elite as f64;
        let mut own = DMatrix::zeros(q, q);
        for e in &elites {
            let off = e - &centre;
            own += &off * off.transpose() / elite as f64;
        }
        mean = mean * KEPT + centre * (1.0 - KEPT);
        covariance = covariance * KEPT + own * (1.0 - KEPT);
    }
    Ok(State { values: best.1, nuisances: start.nuisances.clone() })
}

/// One number after the other is tried over its whole reach and ever closer, amplitudes first. Stretches that lie within
/// the edges tell an amplitude sharply whatever the edges are, and a draw of all numbers at once hardly ever meets so narrow
/// a place.
fn scan(
    data: &Data,
    layout: &Layout,
    start: State,
    spread: &[f64],
    leaps: &[usize],
    widths: &[(f64, i32)],
) -> Result<State> {
    let mut best = lone(data, layout, start.values, leaps)?;
    let amplitude = |i: &usize| layout.parameter(*i).is_some_and(Parameter::is_amplitude);
    let (first, then): (Vec<usize>, Vec<usize>) = (0..layout.slots.len()).partition(amplitude);
    for _ in 0..TURNS {
        let before = best.0;
        for i in first.iter().chain(&then).copied() {
            for (width, side) in widths.iter().copied() {
                let to = steps(layout, &best.1, spread, i, width, side);
                let moved = |to: f64| replaced(&best.1, &[(i, to)]);
                let tried = to.into_iter().map(moved).collect();
                best = better(data, layout, best, tried, leaps)?;
            }
        }
        if best.0 > 0.999 * before {
            break;
        }
    }
    Ok(State { values: best.1, nuisances: start.nuisances })
}

/// Restitution together with what else contacts do is tried on grids, each about the best of the one before. The two make up
/// for each other along a valley across both, too narrow to be drawn, and no way of one of them alone leads along it.
fn crossed(data: &Data, layout: &Layout, start: State, spread: &[f64], leaps: &[usize]) -> Result<State> {
    let contact = |i: &usize| match layout.slots[*i].what {
        What::Parameter(t, _) => layout.terms[t].effect.acts_on() == ActsOn::Contact,
        What::Latent(l) => FACTORS[l].name == "restitution",
    };
    let (latents, effects): (Vec<usize>, Vec<usize>) =
        (0..layout.slots.len()).filter(contact).partition(|i| layout.slots[*i].latent().is_some());
    if effects.is_empty() {
        return Ok(start);
    }
    let mut best = lone(data, layout, start.values, leaps)?;
    for (l, e) in latents.iter().flat_map(|l| effects.iter().map(|e| (*l, *e))) {
        for (width, side) in GRIDS {
            let [rows, columns] = [l, e].map(|i| steps(layout, &best.1, spread, i, width, side));
            let pairs = rows.iter().flat_map(|r| columns.iter().map(|c| (*r, *c)));
            let tried = pairs.map(|(r, c)| replaced(&best.1, &[(l, r), (e, c)])).collect();
            best = better(data, layout, best, tried, leaps)?;
        }
    }
    Ok(State { values: best.1, nuisances: start.nuisances })
}

/// Values with the loss that they have.
type Judged = (f64, Vec<f64>);

fn lone(data: &Data, layout: &Layout, values: Vec<f64>, leaps: &[usize]) -> Result<Judged> {
    Ok((model::losses(data, layout, std::slice::from_ref(&values), leaps)?[0], values))
}

/// The best of all, the one that is known if none is better.
fn better(
    data: &Data,
    layout: &Layout,
    known: Judged,
    tried: Vec<Vec<f64>>,
    leaps: &[usize],
) -> Result<Judged> {
    let losses = model::losses(data, layout, &tried, leaps)?;
    Ok(losses.into_iter().zip(tried).fold(known, |best, new| if new.0 < best.0 { new } else { best }))
}

/// Values of a slot about where it stands, `side` of them on each side up to `width` of its deviation, as far as allowed.
fn steps(layout: &Layout, values: &[f64], spread: &[f64], slot: usize, width: f64, side: i32) -> Vec<f64> {
    let [low, high] = layout.slots[slot].bounds;
    let at = |k: i32| values[slot] + width * spread[slot] * f64::from(k) / f64::from(side);
    (-side..=side).map(|k| at(k).clamp(low, high)).collect()
}

fn replaced(values: &[f64], by: &[(usize, f64)]) -> Vec<f64> {
    let mut out = values.to_vec();
    by.iter().for_each(|(i, value)| out[*i] = *value);
    out
}

/// Leaps that are not left out.
fn counting(data: &Data) -> Vec<usize> {
    let leap = |w: &usize| data.windows[*w].kind == Kind::Leap && data.sd[*w].is_finite();
    (0..data.windows.len()).filter(leap).collect()
}

/// Leaps that take part, in order: evenly spread over those that fit and over those that do not.
fn telling(data: &Data, looks: &[Look]) -> Vec<usize> {
    let fits = |w: &usize| looks[*w].square < FITS * 2.0 * data.windows[*w].points.len() as f64;
    let (well, ill): (Vec<usize>, Vec<usize>) = counting(data).into_iter().partition(fits);
    // What one kind lacks the other may have.
    let most = |other: &[usize]| 2 * STRETCHES - other.len().min(STRETCHES);
    let some = |of: &[usize], most: usize| -> Vec<usize> {
        of.iter().copied().step_by(of.len().div_ceil(most).max(1)).collect()
    };
    let mut out = [some(&well, most(&ill)), some(&ill, most(&well))].concat();
    out.sort_unstable();
    out
}

/// How far each value may plausibly be from where it stands: latents over their usual range, shapes over what the data
/// span, amplitudes as far as would move paths by what is left, within what is usual.
fn reach(data: &Data, layout: &Layout, state: &State, looks: &[Look]) -> Vec<f64> {
    let span = library::span(data.windows);
    let [x0, y0, x1, y1] = span.area;
    let left: f64 = looks.iter().map(|l| l.residual.norm_squared()).sum();
    let of = |(i, slot): (usize, &Slot)| {
        let [low, high] = slot.bounds;
        let What::Parameter(t, p) = slot.what else { return WIDE * (high - low).min(USUAL) };
        let parameter = &layout.terms[t].effect.parameters[p];
        let told: f64 = looks.iter().map(|l| l.columns.column(i).norm_squared()).sum();
        match parameter.role {
            Role::Amplitude => {
                let usual = parameter.size;
                (left / told.max(1e-12)).sqrt().clamp(0.3 * usual, MOST * usual)
            }
            Role::Shape(Shape::Place | Shape::Edge { .. }) => 0.25 * (x1 - x0).max(y1 - y0),
            Role::Shape(Shape::Velocity) => span.speed,
            Role::Shape(Shape::Period) => 0.5 * state.values[i].abs(),
            Role::Shape(Shape::Phase) => 1.5,
            Role::Shape(Shape::Power) => 1.0,
        }
    };
    layout.slots.iter().enumerate().map(of).collect()
}

/// A square root of a covariance.
fn root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = covariance.clone().symmetric_eigen();
    let mut root = eigen.eigenvectors;
    for (k, value) in eigen.eigenvalues.iter().enumerate() {
        root.column_mut(k).scale_mut(value.max(0.0).sqrt());
    }
    root
}
