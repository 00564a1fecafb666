//! Multiple shooting: trials cut into segments that are simulated from observed states, so that chaos in one
//! collision does not dominate everything after it.
//!
//! Source: multiple shooting (Bock 1983). The initial state of a segment is a nuisance parameter that is
//! projected out by variable projection (Golub and Pereyra 1973) in Kaufman's form.
//!
//! Initial states:
//! - An observation with positions, velocities and spins of all bodies is taken as exact. The segment reaches
//!   to the next observation.
//! - Otherwise a segment has [`OBSERVATIONS_PER_SEGMENT`] observations. Initial positions are as noisy as any
//!   other observation; velocities and spins are unknown and fitted by simulation at the reference latents. The
//!   covariance of the residuals is I + J V J^T in units of the noise variance, with J the Jacobian of the
//!   simulated positions with respect to the initial state and V its covariance, nearly infinite for unobserved
//!   components. Residuals are whitened with it, so a change that another initial state could explain does not
//!   count.
//!
//! Of each trial the segments that are most sensitive to a latent (moved by its prior standard deviation) are
//! kept. These contain contacts (and free flight, for drag).
//!
//! Range of validity: effects that depend on the clock start at 0 in every segment. Effects on sensors or on
//! the action would act at the start of every segment; fit simulations with them on whole trials. Contacts that
//! are established at an observation restart without warm start, an error of about a millimetre.

use nalgebra::{DMatrix, DVector};

use super::loss::{Simulation, segment_residuals};
use super::refine::SearchBounds;
use super::segment::{ResidualWhitening, TrialSegment, finite_sum_of_squares, truncate_to_last_observation};
use crate::error::Result;
use crate::progress::Progress;
use crate::reality::Trial;
use crate::trajectory::{Track, Trajectory};
use crate::world::ParameterVector;

/// Observations per segment with a partly unknown initial state: enough for the motion before and after a
/// contact. Longer segments become chaotic; shorter ones lose most information when the initial state is
/// projected out.
const OBSERVATIONS_PER_SEGMENT: usize = 4;
/// Segments kept per trial and latent.
const SEGMENTS_PER_TRIAL_AND_LATENT: usize = 6;
/// Minimum number of observations between the starts of two segments.
const MIN_SEGMENT_SPACING: usize = 2;
/// Maximum number of segments per trial whose initial state is fitted.
const MAX_FITTED_SEGMENTS_PER_TRIAL: usize = 16;
/// Minimum squared change of a segment's residuals, m^2.
const MIN_SENSITIVITY_M2: f64 = 1e-6;
/// Loss at which a segment counts half, m^2.
const LOSS_SCALE_M2: f64 = 1.0;
/// Prior variance of an unobserved velocity (m/s) or spin (rad/s), in units of the noise variance.
const UNOBSERVED_VARIANCE_RATIO: f64 = 1e6;
/// Finite-difference steps of x, y (m), vx, vy (m/s) and spin (rad/s).
const FD_STEPS: [f64; 5] = [0.01, 0.01, 0.05, 0.05, 0.1];
/// Gauss-Newton iterations for an initial state.
const START_ITERATIONS: usize = 2;

/// Informative segments of all trials at the latents `reference`, and the number of rollouts used.
pub fn shooting_segments(
    trials: &[Trial],
    reference: &ParameterVector,
    bounds: &SearchBounds,
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(Vec<TrialSegment>, u64)> {
    let (mut segments, mut candidates) = (Vec::new(), Vec::new());
    for (number, trial) in trials.iter().enumerate() {
        let observations = &trial.observed;
        let mut of_trial = Vec::new();
        for from in 0..observations.times.len().saturating_sub(1) {
            if !observations.bodies.iter().all(|b| b.x[from].is_finite() && b.y[from].is_finite()) {
                continue;
            }
            if observations
                .bodies
                .iter()
                .all(|b| [b.vx[from], b.vy[from], b.omega[from]].iter().all(|v| v.is_finite()))
            {
                let start: Vec<InitialState> =
                    observations.bodies.iter().map(|b| InitialState::observed(b, from)).collect();
                let whitening = ResidualWhitening { factor: None, loss_scale: LOSS_SCALE_M2 };
                let to = if from == 0 && !observes_velocities(observations) {
                    OBSERVATIONS_PER_SEGMENT
                } else {
                    1
                };
                segments.push(cut_segment(trial, number, from, to, &start, Some(whitening)));
            } else {
                of_trial.push(SegmentStart { trial: number, from, motion: unexplained_motion(trial, from) });
            }
        }
        of_trial.retain(|w| w.motion > 0.0);
        of_trial.sort_by(|a, b| b.motion.total_cmp(&a.motion).then(a.from.cmp(&b.from)));
        // Overlapping segments see the same contact: only the one with the largest motion is kept.
        let mut chosen: Vec<SegmentStart> = Vec::new();
        for candidate in of_trial {
            if chosen.len() < MAX_FITTED_SEGMENTS_PER_TRIAL
                && chosen.iter().all(|c| c.from.abs_diff(candidate.from) >= MIN_SEGMENT_SPACING)
            {
                chosen.push(candidate);
            }
        }
        let mut of_trial = chosen;
        of_trial.sort_by_key(|w| w.from);
        candidates.append(&mut of_trial);
    }
    let mut rollouts = 0;
    // Batches bound the memory of scenes.
    for part in candidates.chunks(64) {
        let fitted = fit_initial_states(part, trials, reference, simulation, progress)?;
        rollouts += fitted.1;
        segments.extend(fitted.0);
    }
    segments.sort_by_key(|p| p.trial);
    let (selected, cost) = select_sensitive(segments, reference, bounds, simulation, progress)?;
    Ok((selected, rollouts + cost))
}

/// Initial state of a body.
#[derive(Clone, Copy)]
struct InitialState {
    position: [f64; 2],
    angle: f64,
    velocity: [f64; 2],
    omega: f64,
}

/// Start of a segment with a partly unknown initial state.
struct SegmentStart {
    trial: usize,
    from: usize,
    /// Unexplained motion, m; see [`unexplained_motion`].
    motion: f64,
}

impl InitialState {
    fn observed(track: &Track, i: usize) -> InitialState {
        let known = |v: f64| if v.is_finite() { v } else { 0.0 };
        InitialState {
            position: [track.x[i], track.y[i]],
            angle: known(track.angle[i]),
            velocity: [known(track.vx[i]), known(track.vy[i])],
            omega: known(track.omega[i]),
        }
    }

    /// Perturbed in one of x, y, vx, vy, spin.
    fn perturbed(mut self, which: usize, by: f64) -> InitialState {
        match which {
            0 | 1 => self.position[which] += by,
            2 | 3 => self.velocity[which - 2] += by,
            _ => self.omega += by,
        }
        self
    }
}

fn observes_velocities(observations: &Trajectory) -> bool {
    observations.bodies.iter().all(|b| b.vx.get(1).is_some_and(|v| v.is_finite()))
}

/// The segment from observation `from` over `count` more, with the given initial states.
fn cut_segment(
    trial: &Trial,
    number: usize,
    from: usize,
    count: usize,
    start: &[InitialState],
    whitening: Option<ResidualWhitening>,
) -> TrialSegment {
    let observations = &trial.observed;
    let to = (from + count + 1).min(observations.times.len());
    let mut observed = Trajectory {
        times: observations.times[from + 1..to].iter().map(|t| t - observations.times[from]).collect(),
        ..Trajectory::default()
    };
    let mut scene = trial.scene.clone();
    scene.goal = None;
    for (track, start) in observations.bodies.iter().zip(start) {
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
    let scene = truncate_to_last_observation(scene, &observed);
    TrialSegment { trial: number, scene, observed, whitening }
}

/// The largest change of velocity beyond gravity's within a segment, times the time between observations, m; 0
/// if almost nothing moves or the segment is truncated.
fn unexplained_motion(trial: &Trial, from: usize) -> f64 {
    let (observations, g) = (&trial.observed, trial.scene.gravity);
    if from + OBSERVATIONS_PER_SEGMENT >= observations.times.len() {
        return 0.0;
    }
    let mut most: f64 = 0.0;
    for b in &observations.bodies {
        let moved = (b.x[from + OBSERVATIONS_PER_SEGMENT] - b.x[from])
            .hypot(b.y[from + OBSERVATIONS_PER_SEGMENT] - b.y[from]);
        for i in from + 1..from + OBSERVATIONS_PER_SEGMENT {
            let (d0, d1) = (
                observations.times[i] - observations.times[i - 1],
                observations.times[i + 1] - observations.times[i],
            );
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

/// Initial guesses of a body's state at an observation, from neighbouring positions.
fn initial_guesses(trial: &Trial, body: usize, from: usize) -> Vec<InitialState> {
    let (observations, g) = (&trial.observed, trial.scene.gravity);
    let track = &observations.bodies[body];
    let at = InitialState::observed(track, from);
    let between = |i: usize, j: usize| {
        let dt = observations.times[j] - observations.times[i];
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
    let start = |v: [f64; 2], omega: f64| InitialState { velocity: v, omega, ..at };
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

/// Fits initial states at the reference latents and computes the resulting covariance of residuals.
fn fit_initial_states(
    candidates: &[SegmentStart],
    trials: &[Trial],
    reference: &ParameterVector,
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(Vec<TrialSegment>, u64)> {
    let mut rollouts = 0;
    let reference = std::slice::from_ref(reference);
    let mut simulate = |segments: &[TrialSegment]| -> Result<Vec<Vec<f64>>> {
        rollouts += segments.len() as u64;
        Ok(segment_residuals(reference, segments, simulation, "fitting initial states", progress)?
            .swap_remove(0))
    };
    let make = |w: &SegmentStart, start: &[InitialState]| {
        cut_segment(&trials[w.trial], w.trial, w.from, OBSERVATIONS_PER_SEGMENT, start, None)
    };
    let mut starts = best_initial_guesses(candidates, trials, &make, &mut simulate)?;
    for _ in 0..START_ITERATIONS {
        gauss_newton_step(candidates, &mut starts, &make, &mut simulate)?;
    }
    let linearised = jacobians(candidates, &starts, 0..5, &make, &mut simulate)?;
    let whitened = candidates.iter().zip(&starts).zip(&linearised).filter_map(|((w, s), (_, j))| {
        let factor = Some(residual_covariance(j).cholesky()?.l());
        Some(TrialSegment {
            whitening: Some(ResidualWhitening { factor, loss_scale: LOSS_SCALE_M2 }),
            ..make(w, s)
        })
    });
    Ok((whitened.collect(), rollouts))
}

/// Builds a segment from its start and initial states.
type MakeSegment<'a> = dyn Fn(&SegmentStart, &[InitialState]) -> TrialSegment + 'a;
/// Simulates segments and returns the residuals of each.
type SimulateResiduals<'a> = dyn FnMut(&[TrialSegment]) -> Result<Vec<Vec<f64>>> + 'a;

/// The best initial guess of every body, judged by its own track.
fn best_initial_guesses(
    candidates: &[SegmentStart],
    trials: &[Trial],
    make: &MakeSegment,
    simulate: &mut SimulateResiduals,
) -> Result<Vec<Vec<InitialState>>> {
    let bodies = |w: &SegmentStart| 0..trials[w.trial].observed.bodies.len();
    let of = |w: &SegmentStart| bodies(w).map(|b| initial_guesses(&trials[w.trial], b, w.from)).collect();
    let all: Vec<Vec<Vec<InitialState>>> = candidates.iter().map(of).collect();
    let rounds = all.iter().flatten().map(Vec::len).max().unwrap_or(0);
    let mut starts: Vec<Vec<InitialState>> = all.iter().map(|w| w.iter().map(|g| g[0]).collect()).collect();
    let mut least: Vec<Vec<f64>> = all.iter().map(|w| vec![f64::INFINITY; w.len()]).collect();
    for k in 0..rounds {
        let proposals: Vec<Vec<InitialState>> =
            all.iter().map(|w| w.iter().map(|g| g[k.min(g.len() - 1)]).collect()).collect();
        let segments: Vec<TrialSegment> =
            candidates.iter().zip(&proposals).map(|(w, s)| make(w, s)).collect();
        for (i, vector) in simulate(&segments)?.iter().enumerate() {
            for (b, own) in vector.chunks(2 * segments[i].observed.times.len()).enumerate() {
                let loss = finite_sum_of_squares(own);
                if loss < least[i][b] {
                    (least[i][b], starts[i][b]) = (loss, proposals[i][b]);
                }
            }
        }
    }
    Ok(starts)
}

/// One damped Gauss-Newton step of all initial velocities and spins, accepted where it reduces the residuals.
fn gauss_newton_step(
    candidates: &[SegmentStart],
    starts: &mut [Vec<InitialState>],
    make: &MakeSegment,
    simulate: &mut SimulateResiduals,
) -> Result<()> {
    let linearised = jacobians(candidates, starts, 2..5, make, simulate)?;
    let mut proposals = Vec::new();
    for (i, (r, j)) in linearised.iter().enumerate() {
        let ridge = 1e-4 * j.norm_squared() / j.ncols().max(1) as f64 + 1e-9;
        let normal = j.tr_mul(j) + DMatrix::identity(j.ncols(), j.ncols()) * ridge;
        let step = normal.cholesky().map(|c| -c.solve(&j.tr_mul(r)));
        for share in [1.0, 0.3] {
            let mut moved = starts[i].clone();
            if let Some(step) = &step {
                for (c, by) in step.iter().enumerate() {
                    moved[c / 3] = moved[c / 3].perturbed(2 + c % 3, share * by.clamp(-5.0, 5.0));
                }
            }
            proposals.push(moved);
        }
    }
    let segments: Vec<TrialSegment> =
        proposals.iter().enumerate().map(|(n, s)| make(&candidates[n / 2], s)).collect();
    let found = simulate(&segments)?;
    for (i, (r, _)) in linearised.iter().enumerate() {
        let mut least = finite_sum_of_squares(r.as_slice());
        for n in [2 * i, 2 * i + 1] {
            let loss = finite_sum_of_squares(&found[n]);
            if loss < least && found[n].iter().any(|v| v.is_finite()) {
                (least, starts[i]) = (loss, proposals[n].clone());
            }
        }
    }
    Ok(())
}

/// Covariance of the residuals in units of the noise variance, from the Jacobian with respect to the initial
/// state.
fn residual_covariance(j: &DMatrix<f64>) -> DMatrix<f64> {
    let mut covariance = DMatrix::identity(j.nrows(), j.nrows());
    for (c, column) in j.column_iter().enumerate() {
        let variance = if c % 5 < 2 { 1.0 } else { UNOBSERVED_VARIANCE_RATIO };
        covariance += variance * column * column.transpose();
    }
    covariance
}

/// Residuals of every segment and their Jacobian with respect to the components `which` of x, y, vx, vy, spin
/// of every body; missing values are 0.
fn jacobians(
    candidates: &[SegmentStart],
    starts: &[Vec<InitialState>],
    which: std::ops::Range<usize>,
    make: &MakeSegment,
    simulate: &mut SimulateResiduals,
) -> Result<Vec<(DVector<f64>, DMatrix<f64>)>> {
    let mut segments = Vec::new();
    for (w, start) in candidates.iter().zip(starts) {
        segments.push(make(w, start));
        for b in 0..start.len() {
            for c in which.clone() {
                for to in [-1.0, 1.0] {
                    let mut moved = start.clone();
                    moved[b] = moved[b].perturbed(c, to * FD_STEPS[c]);
                    segments.push(make(w, &moved));
                }
            }
        }
    }
    let found = simulate(&segments)?;
    let mut rows = found.iter();
    let known = |v: f64| if v.is_finite() { v } else { 0.0 };
    let mut all = Vec::with_capacity(candidates.len());
    for start in starts {
        let columns = start.len() * which.len();
        let Some(base) = rows.next() else { break };
        let mut j = DMatrix::zeros(base.len(), columns);
        for column in 0..columns {
            let (Some(before), Some(after)) = (rows.next(), rows.next()) else { break };
            let step = 2.0 * FD_STEPS[which.start + column % which.len()];
            for (row, (b, a)) in before.iter().zip(after).enumerate() {
                j[(row, column)] = known((a - b) / step);
            }
        }
        all.push((DVector::from_iterator(base.len(), base.iter().map(|v| known(*v))), j));
    }
    Ok(all)
}

/// The segments of each trial that are most sensitive to the latents, and the rollouts used.
fn select_sensitive(
    segments: Vec<TrialSegment>,
    reference: &ParameterVector,
    bounds: &SearchBounds,
    simulation: Simulation,
    progress: &dyn Progress,
) -> Result<(Vec<TrialSegment>, u64)> {
    let searched: Vec<usize> = (0..bounds.prior_sd.len()).filter(|j| bounds.prior_sd[*j] > 0.0).collect();
    let mut samples = Vec::new();
    for j in &searched {
        for to in [-1.0, 1.0] {
            let mut moved = reference.clone();
            moved[*j] =
                (reference[*j] + to * bounds.prior_sd[*j]).clamp(bounds.limits[*j][0], bounds.limits[*j][1]);
            samples.push(moved);
        }
    }
    let rows = segment_residuals(&samples, &segments, simulation, "choosing segments", progress)?;
    let mut keep = vec![false; segments.len()];
    for k in 0..searched.len() {
        let reacts = |p: usize| {
            let pairs = rows[2 * k][p].iter().zip(&rows[2 * k + 1][p]);
            let sum: f64 = pairs.map(|(a, b)| (a - b).powi(2)).filter(|d| d.is_finite()).sum();
            sum.min(LOSS_SCALE_M2)
        };
        let mut order: Vec<(usize, f64)> =
            (0..segments.len()).map(|p| (p, reacts(p))).filter(|(_, r)| *r > MIN_SENSITIVITY_M2).collect();
        order.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let mut of_trial = vec![0; segments.last().map_or(0, |p| p.trial + 1)];
        for (p, _) in order {
            let count = &mut of_trial[segments[p].trial];
            if *count < SEGMENTS_PER_TRIAL_AND_LATENT {
                *count += 1;
                keep[p] = true;
            }
        }
    }
    let cost = (samples.len() * segments.len()) as u64;
    let selected = segments.into_iter().zip(keep).filter(|(_, k)| *k).map(|(p, _)| p).collect();
    Ok((selected, cost))
}
