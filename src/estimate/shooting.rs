//! Trials cut into stretches that are simulated anew from what was seen, so that chance in one collision does not
//! drown everything after it.
//!
//! Source: multiple shooting (Bock 1983) with the start of every stretch a nuisance that is not searched for but
//! projected out; the projection is the variable projection of Golub and Pereyra (1973) in Kaufman's form.
//!
//! Which starts are taken for known:
//! - An observation with positions, velocities and spins of all bodies is taken at its word: a stretch from it to the
//!   next observation.
//! - Else a stretch is [`WINDOW`] observations long. Its positions at the start are as noisy as any other
//!   observation; velocities and spins are unknown and fitted through the simulation at the reference latents. The
//!   covariance of what follows is then I + J V J^T in units of the noise's variance, J the derivatives of the
//!   simulated positions by the start and V the start's covariance, next to infinite for what was not seen; the
//!   differences are whitened with it. What the latents do that another start could do as well does not count.
//!
//! Of each trial the stretches are kept that react most to a latent's moving by its prior's deviation, which are those
//! with contacts in them (and free flight, for drag).
//!
//! Range of validity: effects that look at the clock see it start at 0 in every stretch; effects of a sensor or on the
//! action would act on every stretch's start, so a simulation that has them should be fitted by whole trajectories.
//! Contacts that are going on
//! at an observation restart cold, an error of about a millimetre.

use nalgebra::{DMatrix, DVector};

use super::fitness::{Simulation, vectors};
use super::piece::{Piece, Weighing, up_to_last};
use super::refine::Field;
use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::trajectory::{Track, Trajectory};
use crate::world::Sample;

/// Observations after the start in a stretch whose start is not fully known: enough to see the motion before and
/// after a contact. Longer ones let chance grow; shorter ones have little left when the start is projected out.
const WINDOW: usize = 4;
/// Stretches kept of a trial for each latent.
const KEPT: usize = 6;
/// Observations between the starts of two windows, at least.
const APART: usize = 2;
/// Windows of a trial whose start is worth fitting.
const FITTED: usize = 16;
/// Least reaction of a stretch worth keeping, m^2.
const REACTS: f64 = 1e-6;
/// Loss at which a stretch counts half, m^2.
const BOUND: f64 = 1.0;
/// Variance of a velocity (m/s) or spin (rad/s) that was not seen, in units of the noise's variance.
const UNSEEN: f64 = 1e6;
/// Steps by which positions (m), velocities (m/s) and spins (rad/s) are varied for derivatives.
const VARIED: [f64; 5] = [0.01, 0.01, 0.05, 0.05, 0.1];
/// Iterations of fitting a start.
const ITERATIONS: usize = 2;

/// The stretches of all trials that tell something, seen from the latents `reference`; and the rollouts it took.
pub fn stretches(
    trials: &[Trial],
    reference: &Sample,
    field: &Field,
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(Vec<Piece>, u64)> {
    let (mut pieces, mut windows) = (Vec::new(), Vec::new());
    for (number, trial) in trials.iter().enumerate() {
        let seen = &trial.observed;
        let mut of_trial = Vec::new();
        for from in 0..seen.times.len().saturating_sub(1) {
            if !seen.bodies.iter().all(|b| b.x[from].is_finite() && b.y[from].is_finite()) {
                continue;
            }
            if seen
                .bodies
                .iter()
                .all(|b| [b.vx[from], b.vy[from], b.omega[from]].iter().all(|v| v.is_finite()))
            {
                let start: Vec<Start> = seen.bodies.iter().map(|b| Start::seen(b, from)).collect();
                let weighing = Weighing { factor: None, bound: BOUND };
                let to = if from == 0 && !sees_velocities(seen) { WINDOW } else { 1 };
                pieces.push(cut(trial, number, from, to, &start, Some(weighing)));
            } else {
                of_trial.push(Window { trial: number, from, motion: motion(trial, from) });
            }
        }
        of_trial.retain(|w| w.motion > 0.0);
        of_trial.sort_by(|a, b| b.motion.total_cmp(&a.motion).then(a.from.cmp(&b.from)));
        // Neighbours see the same contact by the same observations: of those only the one in which most happens.
        let mut chosen: Vec<Window> = Vec::new();
        for window in of_trial {
            if chosen.len() < FITTED && chosen.iter().all(|c| c.from.abs_diff(window.from) >= APART) {
                chosen.push(window);
            }
        }
        let mut of_trial = chosen;
        of_trial.sort_by_key(|w| w.from);
        windows.append(&mut of_trial);
    }
    let mut rollouts = 0;
    // Batches bound the memory that scenes take.
    for part in windows.chunks(64) {
        let fitted = fit_starts(part, trials, reference, simulation, progress)?;
        rollouts += fitted.1;
        pieces.extend(fitted.0);
    }
    pieces.sort_by_key(|p| p.trial);
    let (kept, cost) = telling(pieces, reference, field, simulation, progress)?;
    Ok((kept, rollouts + cost))
}

/// How a body starts.
#[derive(Clone, Copy)]
struct Start {
    position: [f64; 2],
    angle: f64,
    velocity: [f64; 2],
    omega: f64,
}

/// A stretch whose start is not fully known.
struct Window {
    trial: usize,
    from: usize,
    /// How much happens in it, m.
    motion: f64,
}

impl Start {
    fn seen(track: &Track, i: usize) -> Start {
        let known = |v: f64| if v.is_finite() { v } else { 0.0 };
        Start {
            position: [track.x[i], track.y[i]],
            angle: known(track.angle[i]),
            velocity: [known(track.vx[i]), known(track.vy[i])],
            omega: known(track.omega[i]),
        }
    }

    /// Changed in one of x, y, vx, vy, spin.
    fn moved(mut self, which: usize, by: f64) -> Start {
        match which {
            0 | 1 => self.position[which] += by,
            2 | 3 => self.velocity[which - 2] += by,
            _ => self.omega += by,
        }
        self
    }
}

fn sees_velocities(seen: &Trajectory) -> bool {
    seen.bodies.iter().all(|b| b.vx.get(1).is_some_and(|v| v.is_finite()))
}

/// The piece from observation `from` over `count` more, with the bodies as `start` says.
fn cut(
    trial: &Trial,
    number: usize,
    from: usize,
    count: usize,
    start: &[Start],
    weighing: Option<Weighing>,
) -> Piece {
    let seen = &trial.observed;
    let to = (from + count + 1).min(seen.times.len());
    let mut observed = Trajectory {
        times: seen.times[from + 1..to].iter().map(|t| t - seen.times[from]).collect(),
        ..Trajectory::default()
    };
    let mut scene = trial.scene.clone();
    scene.goal = None;
    for (track, start) in seen.bodies.iter().zip(start) {
        let part = |v: &[f64]| v[from + 1..to].to_vec();
        observed.bodies.push(Track {
            name: track.name.clone(),
            x: part(&track.x),
            y: part(&track.y),
            angle: part(&track.angle),
            vx: part(&track.vx),
            vy: part(&track.vy),
            omega: part(&track.omega),
        });
        if let Some(body) = scene.bodies.iter_mut().find(|b| b.name == track.name) {
            body.position = Some(start.position);
            body.angle = start.angle;
            body.velocity = start.velocity.map(|v| v.clamp(-300.0, 300.0));
            body.angular_velocity = start.omega.clamp(-3000.0, 3000.0);
        }
    }
    let scene = up_to_last(scene, &observed);
    Piece { trial: number, scene, observed, weighing }
}

/// How much happens from an observation over a window: the largest change of velocity beyond gravity's, times the
/// time between observations, m; 0 if next to nothing moves or the window is cut short.
fn motion(trial: &Trial, from: usize) -> f64 {
    let (seen, g) = (&trial.observed, trial.scene.gravity);
    if from + WINDOW >= seen.times.len() {
        return 0.0;
    }
    let mut most: f64 = 0.0;
    for b in &seen.bodies {
        let moved = (b.x[from + WINDOW] - b.x[from]).hypot(b.y[from + WINDOW] - b.y[from]);
        for i in from + 1..from + WINDOW {
            let (d0, d1) = (seen.times[i] - seen.times[i - 1], seen.times[i + 1] - seen.times[i]);
            let turn = |p: &[f64], g: f64| {
                ((p[i + 1] - p[i]) / d1 - (p[i] - p[i - 1]) / d0) * d1 - g * d1 * (d0 + d1) / 2.0
            };
            let change = turn(&b.x, g[0]).hypot(turn(&b.y, g[1]));
            if change.is_finite() && moved.is_finite() && moved > 0.2 {
                most = most.max(change.min(moved));
            }
        }
    }
    most
}

/// Guesses of a body's velocity and spin at an observation, from the positions around it.
fn guesses(trial: &Trial, body: usize, from: usize) -> Vec<Start> {
    let (seen, g) = (&trial.observed, trial.scene.gravity);
    let track = &seen.bodies[body];
    let at = Start::seen(track, from);
    let between = |i: usize, j: usize| {
        let dt = seen.times[j] - seen.times[i];
        ([(track.x[j] - track.x[i]) / dt, (track.y[j] - track.y[i]) / dt], dt)
    };
    let (ahead, dt) = between(from, from + 1);
    let mut velocities = vec![[ahead[0] - g[0] * dt / 2.0, ahead[1] - g[1] * dt / 2.0], ahead];
    if from > 0 {
        let (behind, dt) = between(from - 1, from);
        velocities.push([behind[0] + g[0] * dt / 2.0, behind[1] + g[1] * dt / 2.0]);
    }
    let radius = trial.scene.body(&track.name).and_then(|b| b.shape.disc_radius());
    let turned = (track.angle[from + 1] - track.angle[from]) / dt;
    velocities.retain(|v| v.iter().all(|v| v.is_finite()));
    let start = |v: [f64; 2], omega: f64| Start { velocity: v, omega, ..at };
    let mut all = Vec::new();
    for v in velocities {
        if turned.is_finite() {
            all.push(start(v, turned));
        } else {
            all.push(start(v, 0.0));
            all.extend(radius.map(|r| start(v, -v[0] / r)));
        }
    }
    if all.is_empty() { vec![at] } else { all }
}

/// Fits the starts of windows at the reference latents and finds how their uncertainty shows.
fn fit_starts(
    windows: &[Window],
    trials: &[Trial],
    reference: &Sample,
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(Vec<Piece>, u64)> {
    let mut rollouts = 0;
    let reference = std::slice::from_ref(reference);
    let mut run = |pieces: &[Piece]| -> Result<Vec<Vec<f64>>> {
        rollouts += pieces.len() as u64;
        Ok(vectors(reference, pieces, simulation, "fitting starts", progress)?.swap_remove(0))
    };
    let piece = |w: &Window, start: &[Start]| cut(&trials[w.trial], w.trial, w.from, WINDOW, start, None);
    let mut starts = best_guesses(windows, trials, &piece, &mut run)?;
    for _ in 0..ITERATIONS {
        step(windows, &mut starts, &piece, &mut run)?;
    }
    let slopes = derivatives(windows, &starts, 0..5, &piece, &mut run)?;
    let weighed = windows.iter().zip(&starts).zip(&slopes).filter_map(|((w, s), (_, j))| {
        let factor = Some(spread(j).cholesky()?.l());
        Some(Piece { weighing: Some(Weighing { factor, bound: BOUND }), ..piece(w, s) })
    });
    Ok((weighed.collect(), rollouts))
}

/// A window with a start, as something to simulate.
type Cut<'a> = dyn Fn(&Window, &[Start]) -> Piece + 'a;
/// Simulates pieces: the differences of each from what was seen.
type Roll<'a> = dyn FnMut(&[Piece]) -> Result<Vec<Vec<f64>>> + 'a;

/// The best guess of every body of every window: by its own track, while the others are tried at their own.
fn best_guesses(
    windows: &[Window],
    trials: &[Trial],
    piece: &Cut,
    run: &mut Roll,
) -> Result<Vec<Vec<Start>>> {
    let bodies = |w: &Window| 0..trials[w.trial].observed.bodies.len();
    let of = |w: &Window| bodies(w).map(|b| guesses(&trials[w.trial], b, w.from)).collect();
    let all: Vec<Vec<Vec<Start>>> = windows.iter().map(of).collect();
    let rounds = all.iter().flatten().map(Vec::len).max().unwrap_or(0);
    let mut starts: Vec<Vec<Start>> = all.iter().map(|w| w.iter().map(|g| g[0]).collect()).collect();
    let mut least: Vec<Vec<f64>> = all.iter().map(|w| vec![f64::INFINITY; w.len()]).collect();
    for k in 0..rounds {
        let tried: Vec<Vec<Start>> =
            all.iter().map(|w| w.iter().map(|g| g[k.min(g.len() - 1)]).collect()).collect();
        let pieces: Vec<Piece> = windows.iter().zip(&tried).map(|(w, s)| piece(w, s)).collect();
        for (i, vector) in run(&pieces)?.iter().enumerate() {
            for (b, own) in vector.chunks(2 * pieces[i].observed.times.len()).enumerate() {
                let off = square(own);
                if off < least[i][b] {
                    (least[i][b], starts[i][b]) = (off, tried[i][b]);
                }
            }
        }
    }
    Ok(starts)
}

/// One damped Gauss-Newton step of the velocities and spins of every window's start, as far as it helps.
fn step(windows: &[Window], starts: &mut [Vec<Start>], piece: &Cut, run: &mut Roll) -> Result<()> {
    let slopes = derivatives(windows, starts, 2..5, piece, run)?;
    let mut tried = Vec::new();
    for (i, (r, j)) in slopes.iter().enumerate() {
        let ridge = 1e-4 * j.norm_squared() / j.ncols().max(1) as f64 + 1e-9;
        let normal = j.tr_mul(j) + DMatrix::identity(j.ncols(), j.ncols()) * ridge;
        let step = normal.cholesky().map(|c| -c.solve(&j.tr_mul(r)));
        for share in [1.0, 0.3] {
            let mut moved = starts[i].clone();
            if let Some(step) = &step {
                for (c, by) in step.iter().enumerate() {
                    moved[c / 3] = moved[c / 3].moved(2 + c % 3, share * by.clamp(-5.0, 5.0));
                }
            }
            tried.push(moved);
        }
    }
    let pieces: Vec<Piece> = tried.iter().enumerate().map(|(n, s)| piece(&windows[n / 2], s)).collect();
    let found = run(&pieces)?;
    for (i, (r, _)) in slopes.iter().enumerate() {
        let mut least = square(r.as_slice());
        for n in [2 * i, 2 * i + 1] {
            let off = square(&found[n]);
            if off < least && found[n].iter().any(|v| v.is_finite()) {
                (least, starts[i]) = (off, tried[n].clone());
            }
        }
    }
    Ok(())
}

/// Covariance of what follows a start, in units of the noise's variance, from its derivatives by that start.
fn spread(j: &DMatrix<f64>) -> DMatrix<f64> {
    let mut covariance = DMatrix::identity(j.nrows(), j.nrows());
    for (c, column) in j.column_iter().enumerate() {
        let variance = if c % 5 < 2 { 1.0 } else { UNSEEN };
        covariance += variance * column * column.transpose();
    }
    covariance
}

/// Differences of every window and their derivatives by those of x, y, vx, vy, spin of every body that are in
/// `which`; what is missing is 0.
fn derivatives(
    windows: &[Window],
    starts: &[Vec<Start>],
    which: std::ops::Range<usize>,
    piece: &Cut,
    run: &mut Roll,
) -> Result<Vec<(DVector<f64>, DMatrix<f64>)>> {
    let mut pieces = Vec::new();
    for (w, start) in windows.iter().zip(starts) {
        pieces.push(piece(w, start));
        for b in 0..start.len() {
            for c in which.clone() {
                for to in [-1.0, 1.0] {
                    let mut moved = start.clone();
                    moved[b] = moved[b].moved(c, to * VARIED[c]);
                    pieces.push(piece(w, &moved));
                }
            }
        }
    }
    let found = run(&pieces)?;
    let mut rows = found.iter();
    let known = |v: f64| if v.is_finite() { v } else { 0.0 };
    let mut all = Vec::with_capacity(windows.len());
    for start in starts {
        let columns = start.len() * which.len();
        let Some(base) = rows.next() else { break };
        let mut j = DMatrix::zeros(base.len(), columns);
        for column in 0..columns {
            let (Some(before), Some(after)) = (rows.next(), rows.next()) else { break };
            let step = 2.0 * VARIED[which.start + column % which.len()];
            for (row, (b, a)) in before.iter().zip(after).enumerate() {
                j[(row, column)] = known((a - b) / step);
            }
        }
        all.push((DVector::from_iterator(base.len(), base.iter().map(|v| known(*v))), j));
    }
    Ok(all)
}

/// The pieces of each trial that react most to the latents.
fn telling(
    pieces: Vec<Piece>,
    reference: &Sample,
    field: &Field,
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(Vec<Piece>, u64)> {
    let searched: Vec<usize> = (0..field.prior.len()).filter(|j| field.prior[*j] > 0.0).collect();
    let mut samples = Vec::new();
    for j in &searched {
        for to in [-1.0, 1.0] {
            let mut moved = reference.clone();
            moved[*j] =
                (reference[*j] + to * field.prior[*j]).clamp(field.limits[*j][0], field.limits[*j][1]);
            samples.push(moved);
        }
    }
    let rows = vectors(&samples, &pieces, simulation, "choosing stretches", progress)?;
    let mut keep = vec![false; pieces.len()];
    for k in 0..searched.len() {
        let reacts = |p: usize| {
            let pairs = rows[2 * k][p].iter().zip(&rows[2 * k + 1][p]);
            let sum: f64 = pairs.map(|(a, b)| (a - b).powi(2)).filter(|d| d.is_finite()).sum();
            sum.min(BOUND)
        };
        let mut order: Vec<(usize, f64)> =
            (0..pieces.len()).map(|p| (p, reacts(p))).filter(|(_, r)| *r > REACTS).collect();
        order.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let mut of_trial = vec![0; pieces.last().map_or(0, |p| p.trial + 1)];
        for (p, _) in order {
            let taken = &mut of_trial[pieces[p].trial];
            if *taken < KEPT {
                *taken += 1;
                keep[p] = true;
            }
        }
    }
    let cost = (samples.len() * pieces.len()) as u64;
    let kept = pieces.into_iter().zip(keep).filter(|(_, k)| *k).map(|(p, _)| p).collect();
    Ok((kept, cost))
}

fn square(values: &[f64]) -> f64 {
    values.iter().filter(|v| v.is_finite()).map(|v| v * v).sum()
}
