//! Launches as the score sees them: what a model leaves of each, in coordinates in which its covariance is simple.
//!
//! A window's residual and columns are taken in slow coordinates (the polynomials that `noise` holds for motion; where there
//! are few points, the points themselves), its start is projected out by an orthonormal complement (restricted likelihood,
//! with the flat prior on starts in *observed* coordinates, the same for every candidate), noise is made white, and the
//! slow misfit's covariance diagonal. What is left is a Gaussian of covariance
//! diag(1 + slow^2 misfit) + columns' spreads + own columns' variances, in units of the noise.
//!
//! Source: restricted likelihood (Patterson and Thompson, Biometrika 58 (1971) 545), model discrepancy as a Gaussian process
//! (Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425).

use std::borrow::Cow;
use std::collections::HashMap;

use nalgebra::{DMatrix, DVector, Dyn, QR};

use super::columns::{Columns, Own};
use super::kernels;
use super::model::{Data, Look};
use super::noise::{self, Noise};
use super::path::Impact;
use super::window::{Kind, Window};
use crate::error::Result;

/// Length over which slow misfit changes, as a share of the usual flight (the prototype's; Matern 3/2).
const SLOW_LENGTH: f64 = 0.25;

/// Observations that share a scale: all measured windows of a launch, or one stretch that started from what was seen.
#[derive(Clone, Debug)]
pub struct Part {
    /// Index of the trial.
    pub launch: usize,
    /// A block a window: nothing but sizes that differ by launch makes windows depend on each other.
    pub blocks: Vec<Block>,
    /// Whether sizes may differ from launch to launch: they do where something was measured.
    pub differs: bool,
}

/// A window's share of a part.
#[derive(Clone, Debug)]
pub struct Block {
    /// Index of the window.
    pub window: usize,
    /// What the model leaves.
    pub left: DVector<f64>,
    /// Variance of the slow misfit of unit amplitude, by coordinate.
    pub slow: DVector<f64>,
    /// Derivatives by slot, then by extra.
    pub columns: DMatrix<f64>,
    /// What all windows of a launch have alike (pushes, and strengths of effects), of unit standard deviation.
    pub alike: DMatrix<f64>,
    pub alike_of: Vec<Own>,
    /// Columns with variances of their own, of unit standard deviation.
    pub own: DMatrix<f64>,
    pub kinds: Vec<Own>,
    /// Logarithm of the determinant of what made noise white, squared.
    pub log_white: f64,
}

/// What does not change about a window while models do.
#[derive(Clone)]
pub struct Frame {
    /// (coordinates, points): slow ones, or the points that count.
    basis: DMatrix<f64>,
    /// Noise, unless it is white, and slow misfit, if there may be any, in them, by coordinate axis.
    white: Option<DMatrix<f64>>,
    slow: Option<DMatrix<f64>>,
    /// Whether anything moved along x and y: what never does is no observation.
    axes: [bool; 2],
    /// Whether it comes after a contact of its trial.
    after: bool,
}

impl Frame {
    /// Covariance of the slow misfit of unit amplitude at the window's points, in two factors: itself in slow coordinates times
    /// their basis (coordinates, points), and the basis; `None` where there is none.
    pub fn slow_at_points(&self) -> Option<(DMatrix<f64>, &DMatrix<f64>)> {
        self.slow.as_ref().map(|slow| (slow * &self.basis, &self.basis))
    }

    /// Whether the window moves along both axes: what pushes along one that is never seen to move is told by nothing.
    pub fn moves_in_plane(&self) -> bool {
        self.axes == [true; 2]
    }

    /// Whether a contact may have changed what its window flies with.
    pub fn is_renewed(&self, window: &Window) -> bool {
        self.after || window.kind == Kind::Contact
    }
}

/// Frames of all windows.
pub fn frames(windows: &[Window], noise: &Noise) -> Vec<Frame> {
    let flights = windows.iter().filter(|w| w.kind == Kind::Flight);
    let durations: Vec<f64> = flights.map(|w| w.points.last().map_or(0.0, |p| p.time)).collect();
    let length = SLOW_LENGTH * super::stats::median(&durations).max(1e-6);
    let mut first: HashMap<usize, f64> = HashMap::new();
    for flight in windows.iter().filter(|w| w.kind == Kind::Flight) {
        let start = first.entry(flight.trial).or_insert(flight.start);
        *start = start.min(flight.start);
    }
    let after = |w: &Window| first.get(&w.trial).is_some_and(|start| *start < w.start);
    windows.iter().map(|w| frame(w, noise, length, after(w))).collect()
}

fn frame(window: &Window, noise: &Noise, length: f64, after: bool) -> Frame {
    let points = &window.points;
    let axes = match window.kind.simulated() {
        true => [true; 2],
        false => [0, 1].map(|a| points.iter().any(|p| p.seen[a] != points[0].seen[a])),
    };
    let times: Vec<f64> = points.iter().map(|p| p.time).collect();
    let sizes: Vec<f64> = points.iter().map(|p| p.weight).collect();
    // Rows are over their own noise, that of a mean of several observations being less.
    let weights: Vec<f64> = sizes.iter().map(|size| size.sqrt()).collect();
    let n = points.len();
    let rho = if window.kind.simulated() { 0.0 } else { noise.rho };
    let basis = window.smooth.as_ref().and_then(|_| noise::slow_basis(&times, &weights));
    let counted: Vec<usize> = (0..n).filter(|i| weights[*i] > 0.0).collect();
    match basis {
        Some(q) => Frame {
            white: (rho != 0.0).then(|| q.tr_mul(&kernels::autoregressive(rho, &sizes, &q))),
            slow: Some(slow(&times, &weights, length, &q)),
            basis: q.transpose(),
            axes,
            after,
        },
        None => Frame {
            // What does not count is no coordinate.
            basis: DMatrix::from_fn(counted.len(), n, |k, i| f64::from(counted[k] == i)),
            slow: None,
            white: (rho != 0.0).then(|| noise::correlation(&counted, rho)),
            axes,
            after,
        },
    }
}

/// Covariance of the slow misfit of unit amplitude in slow coordinates, rows over the noise of their observations.
fn slow(times: &[f64], weights: &[f64], length: f64, basis: &DMatrix<f64>) -> DMatrix<f64> {
    let rows = DMatrix::from_fn(basis.nrows(), basis.ncols(), |i, k| weights[i] * basis[(i, k)]);
    rows.tr_mul(&kernels::matern(times, length, &rows))
}

/// A window's part of its launch; `scale` is by how much its residuals were made smaller than in units of the noise.
fn reduced(
    (w, window): (usize, &Window),
    frame: &Frame,
    look: &Look,
    columns: &Columns,
    scale: f64,
) -> Option<Block> {
    let (slots, pushes) = (columns.slots, columns.pushes);
    let impact = look.impact;
    let n = window.points.len();
    let extras = look.columns.ncols() - slots - pushes;
    let leaps = impact.map_or(0, |_| 2);
    let order = Order { slots, extras, pushes, leaps };
    let of = |c: usize, i: usize| match c {
        _ if c < slots => look.columns[(i, c)],
        _ if c < slots + extras => look.columns[(i, c + pushes)],
        _ if c < order.leap(0) => look.columns[(i, c - extras)],
        _ if c == order.left() => look.residual[i],
        _ => leap(window, look, impact, c - order.leap(0), i),
    };
    let rows = Rows {
        used: (0..2).filter(|a| frame.axes[*a]).collect(),
        points: n,
        coordinates: frame.basis.nrows(),
        held: (look.residual.len() - 2 * n) / 2,
        share: look.share,
        scale: scale / look.share,
    };
    let start = rows.of(frame, look.start.ncols(), &|c, i| look.start[(i, c)]);
    let simple = simple(frame, &rows, &start, rows.of(frame, order.left() + 1, &of))?;
    if simple.columns.iter().any(|v| !v.is_finite()) {
        return None;
    }
    Some(block(simple, &order, columns, (w, window), frame))
}

/// Which column of a window's block is which: slots, extras, pushes, leaps, and what is left.
struct Order {
    slots: usize,
    extras: usize,
    pushes: usize,
    leaps: usize,
}

impl Order {
    fn push(&self, k: usize) -> usize {
        self.slots + self.extras + k
    }

    fn leap(&self, k: usize) -> usize {
        self.push(self.pushes) + k
    }

    fn left(&self) -> usize {
        self.leap(self.leaps)
    }
}

/// How a look's rows come to be coordinates: slow ones, axis after axis, then what is held of nuisances.
struct Rows {
    used: Vec<usize>,
    points: usize,
    coordinates: usize,
    held: usize,
    share: f64,
    scale: f64,
}

impl Rows {
    /// All of them.
    fn dims(&self) -> usize {
        self.coordinates * self.used.len() + self.held
    }

    /// `count` columns whose values by column and row are given.
    fn of(&self, frame: &Frame, count: usize, value: &dyn Fn(usize, usize) -> f64) -> DMatrix<f64> {
        let (n, k) = (self.points, self.coordinates);
        let mut out = DMatrix::zeros(self.dims(), count);
        for (b, axis) in self.used.iter().enumerate() {
            let rows = DMatrix::from_fn(n, count, |i, c| value(c, 2 * i + axis) * self.scale);
            out.rows_mut(b * k, k).copy_from(&(&frame.basis * rows));
        }
        for (h, c) in (0..self.held).flat_map(|h| (0..count).map(move |c| (h, c))) {
            out[(k * self.used.len() + h, c)] = value(c, 2 * n + 2 * h) / self.share;
        }
        out
    }

    /// A covariance of an axis in all coordinates across a start; `rest` of each that is held.
    fn within(&self, axis: &DMatrix<f64>, rest: f64, across: &Across) -> DMatrix<f64> {
        let k = self.coordinates;
        let mut out = DMatrix::zeros(self.dims(), self.dims());
        for b in 0..self.used.len() {
            out.view_mut((b * k, b * k), (k, k)).copy_from(axis);
        }
        (k * self.used.len()..self.dims()).for_each(|h| out[(h, h)] = rest);
        across.project(across.project(out).transpose())
    }
}

/// Columns in coordinates in which noise is white and slow misfit uncorrelated.
struct Simple {
    columns: DMatrix<f64>,
    slow: DVector<f64>,
    log_white: f64,
}

/// Takes the start away, makes noise white and the slow misfit's covariance diagonal.
fn simple(frame: &Frame, rows: &Rows, start: &DMatrix<f64>, of: DMatrix<f64>) -> Option<Simple> {
    let across = Across::of(start)?;
    let mut columns = across.project(of);
    let mut log_white = 0.0;
    let mut misfit = frame.slow.as_ref().map(|slow| rows.within(slow, 0.0, &across));
    if let Some(white) = &frame.white {
        let white = rows.within(white, 1.0, &across).cholesky()?;
        log_white = 2.0 * white.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let root = white.l();
        columns = root.solve_lower_triangular(&columns)?;
        if let Some(own) = &mut misfit {
            let half = root.solve_lower_triangular(own)?;
            *own = root.solve_lower_triangular(&half.transpose())?;
        }
    }
    let mut slow = DVector::zeros(columns.nrows());
    if let Some(misfit) = misfit {
        let eigen = (0.5 * (&misfit + misfit.transpose())).symmetric_eigen();
        slow = eigen.eigenvalues.map(|v| v.max(0.0));
        columns = eigen.eigenvectors.transpose() * columns;
    }
    Some(Simple { columns, slow, log_white })
}

/// Which of the columns the model fits, which a launch has alike in all its windows, and which each window has of its own.
fn block(
    simple: Simple,
    order: &Order,
    columns: &Columns,
    (w, window): (usize, &Window),
    frame: &Frame,
) -> Block {
    let column = |c: usize| simple.columns.column(c).into_owned();
    let m = simple.columns.nrows();
    let mut own: Vec<(Own, DVector<f64>)> = Vec::new();
    let mut alike: Vec<(Own, DVector<f64>)> = Vec::new();
    let flies = matches!(window.kind, Kind::Flight | Kind::Contact);
    for (k, (place, fresh)) in columns.of.iter().enumerate() {
        match fresh {
            true if flies => own.push((Own::Push(*place), column(order.push(k)))),
            true => (),
            false if flies => alike.push((Own::Push(*place), column(order.push(k)))),
            false => alike.push((Own::Push(*place), DVector::zeros(m))),
        }
    }
    let renewed = columns.renewed.iter().enumerate().filter(|_| flies && frame.is_renewed(window));
    for (k, (c, plausible)) in renewed {
        let at = if *c < order.slots { *c } else { order.push(*c - order.slots) };
        own.push((Own::Renewed(k), column(at) * *plausible));
    }
    own.extend((0..order.leaps).map(|k| (Own::Leap, column(order.leap(k)))));
    for sizes in &columns.strengths {
        let all = sizes.iter().fold(DVector::zeros(m), |all, (slot, size)| all + column(*slot) * *size);
        alike.push((Own::Strength, all));
    }
    let beside = |of: &[(Own, DVector<f64>)]| DMatrix::from_fn(m, of.len(), |i, k| of[k].1[i]);
    let names = |of: &[(Own, DVector<f64>)]| of.iter().map(|o| o.0).collect();
    Block {
        window: w,
        left: column(order.left()),
        columns: simple.columns.columns(0, order.push(0)).into_owned(),
        alike: beside(&alike),
        alike_of: names(&alike),
        own: beside(&own),
        kinds: names(&own),
        slow: simple.slow,
        log_white: simple.log_white,
    }
}

/// What a contact that errs along its normal (0) or its tangent (1) by its speed of approach does to row `i`.
pub fn leap(window: &Window, look: &Look, impact: Option<Impact>, way: usize, i: usize) -> f64 {
    let (Some(met), Some(surface)) = (impact, &window.surface) else { return 0.0 };
    let Some(point) = window.points.get(i / 2) else { return 0.0 };
    let [nx, ny] = surface.normal;
    let along = [[nx, ny], [-ny, nx]][way][i % 2];
    (point.time - met.time).max(0.0) * along * met.approach * look.weights[i / 2] * look.share
}

/// Everything across the columns of a start.
struct Across {
    turn: QR<f64, Dyn, Dyn>,
    rank: usize,
}

impl Across {
    /// `None` where nothing is left beside the start.
    fn of(start: &DMatrix<f64>) -> Option<Across> {
        let mut basis: Vec<DVector<f64>> = Vec::new();
        for column in start.column_iter() {
            let size = column.norm();
            let mut rest = column.into_owned();
            for _ in 0..2 {
                for b in &basis {
                    let along = b.dot(&rest);
                    rest.axpy(-along, b, 1.0);
                }
            }
            if rest.norm() > 1e-9 * size && size > 0.0 {
                basis.push(rest.normalize());
            }
        }
        let rank = basis.len();
        let columns = DMatrix::from_fn(start.nrows(), rank, |i, k| basis[k][i]);
        (rank < start.nrows()).then(|| Across { turn: columns.qr(), rank })
    }

    /// Coordinates across the start, of every column.
    fn project(&self, mut of: DMatrix<f64>) -> DMatrix<f64> {
        if self.rank > 0 {
            self.turn.q_tr_mul(&mut of);
        }
        of.rows(self.rank, of.nrows() - self.rank).into_owned()
    }
}

/// All launches' parts. `look`: a window at a state, with columns for `slots`, then [`pushes`], then extras;
/// `scales`: of each window's residuals, in units of the noise.
pub fn parts<'l>(
    data: &Data,
    frames: &[Frame],
    look: impl Fn(usize) -> Cow<'l, Look>,
    columns: &Columns,
    scales: &[f64],
) -> Result<Option<Vec<Part>>> {
    let mut out: Vec<Part> = Vec::new();
    for (w, window) in data.windows.iter().enumerate().filter(|(w, _)| scales[*w].is_finite()) {
        data.progress.check_stop()?;
        let look = look(w);
        let Some(block) = reduced((w, window), &frames[w], &look, columns, scales[w]) else {
            if look.residual.iter().all(|r| r.is_finite()) {
                continue;
            }
            return Ok(None);
        };
        let differs = !window.kind.simulated();
        match out.last_mut() {
            Some(last) if last.launch == window.trial && last.differs && differs => last.blocks.push(block),
            _ => out.push(Part { launch: window.trial, blocks: vec![block], differs }),
        }
    }
    Ok(Some(out))
}

/// By how much a window's coordinates of what is left grow with what was seen, 1/m: (coordinates, two a point). `None` where nothing
/// is left beside its start.
pub fn by_position(window: (usize, &Window), frame: &Frame, look: &Look, scale: f64) -> Option<DMatrix<f64>> {
    let n = 2 * window.1.points.len();
    let mut own = look.bare();
    own.append(n, Some(DMatrix::identity(n, n)));
    let none = Columns { slots: 0, pushes: 0, of: Vec::new(), renewed: Vec::new(), strengths: Vec::new() };
    reduced(window, frame, &own, &none, scale).map(|block| block.columns)
}

impl Block {
    /// Residual after a step of the parameters.
    pub fn residual_at(&self, step: &DVector<f64>) -> DVector<f64> {
        &self.left - &self.columns * step
    }
}

impl Part {
    /// Square of what is left with the slots `step` away, in units of the noise.
    pub fn square_at(&self, step: &DVector<f64>) -> f64 {
        self.blocks.iter().map(|b| b.residual_at(step).norm_squared()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a start takes up is gone, whatever its columns are scaled by, and lengths across it are kept.
    #[test]
    fn a_start_is_projected_out() {
        let start = DMatrix::from_fn(6, 3, |i, k| match k {
            0 => 1.0,
            1 => 1e4 * i as f64,
            _ => 0.0,
        });
        let across = Across::of(&start).unwrap();
        let line = DMatrix::from_fn(6, 1, |i, _| 3.0 - 2.0 * i as f64);
        assert!(across.project(line).norm() < 1e-9);
        let bend = DMatrix::from_column_slice(6, 1, &[5.0, -1.0, -4.0, -4.0, -1.0, 5.0]);
        let seen = across.project(bend.clone());
        assert_eq!(seen.nrows(), 4, "a column of nothing takes nothing up");
        assert!((seen.norm() - bend.norm()).abs() < 1e-9);
    }
}
