//! `informative`: the batch of actions with the highest Fisher information about the latents.
//!
//! With theta the latents (and the estimated effect parameters), every candidate c contributes Fisher
//! information F_c = sum_k J_k J_k^T / sigma^2, with J_k the sensitivity of the k-th observed coordinate. The
//! information before the batch is M = prior precision + information of the trials measured so far. Actions are
//! selected greedily: each maximises log det(M + F) (D-optimal design). With a performance surface each
//! minimises sum_i (dP/d theta_i)^2 Var_i, the uncertainty that affects performance (weighted A-optimal
//! design). The prior keeps unidentifiable latents, such as density in bowling, from mattering.
//!
//! Source: ours. Design criteria: Fedorov 1972, Chaloner and Verdinelli 1995; greedy selection is near-optimal
//! for the submodular log det (Nemhauser et al. 1978).
//!
//! Sensitivities are those of segments, not of whole trajectories: the simulation is restarted from each
//! observed state of the nominal trajectory and evaluated one observation later. Over a whole trajectory
//! collisions amplify any difference, and such chaotic sensitivities are large and useless. For the same reason
//! the two one-sided differences of a segment are compared and the smaller one is used, or zero if their signs
//! differ: a hit on one side and a miss on the other is a discontinuity, not a gradient.
//!
//! Range of validity: positions are assumed to be observed at the scene's own times, independently, with
//! standard deviation [`OBSERVATION_SD_M`]; model error violates this. The strategy helps where the simulation
//! can match the world (see docs/calibration.md); if the simulation lacks drag, the most informative actions
//! are also the most biased.

use nalgebra::{DMatrix, DVector};

use super::gradient::mean_abs_gradient;
use super::{AcquisitionContext, ActionSelection, CandidateSimulation, ExpectedPosteriorSd, Strategy};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::task::scene::EffectTerm;
use crate::task::{Placement, Scene};
use crate::trajectory::{Termination, Trajectory};
use crate::world::{Latents, ParameterSpace, ParameterVector, Rollout, Simulator};

/// The strategy's row in the registry.
pub struct InformativeStrategy;

/// Assumed standard deviation of an observed coordinate after one observation interval, m: camera noise and
/// small model error together. Larger values give the prior more weight and select more similar actions;
/// smaller values ignore the prior.
pub const OBSERVATION_SD_M: f64 = 0.05;
/// Finite-difference step as a share of the search's standard deviation, and its minimum as a share of the
/// prior's.
const FD_STEP_SHARES: (f64, f64) = (0.5, 0.02);
/// Scenes per batch; bounds memory.
const SCENES_PER_BATCH: usize = 16;

impl Strategy for InformativeStrategy {
    fn name(&self) -> &'static str {
        "informative"
    }

    fn select(&self, situation: &AcquisitionContext, n: usize) -> Result<ActionSelection> {
        let known = InformationModel::new(situation);
        let mut scenes = Vec::with_capacity(situation.candidates.len() + situation.trials.len());
        for candidate in situation.candidates {
            scenes.push(place(situation, candidate.task, &candidate.action)?);
        }
        scenes.extend(situation.trials.iter().map(|t| t.scene.clone()));
        let (told, rollouts) = known.information(&scenes, situation.progress)?;
        let (candidates, trials) = told.split_at(situation.candidates.len());
        let before = trials.iter().fold(known.prior_precision(), |sum, f| sum + f);
        let weights = match situation.importance {
            Some(importance) => Some(mean_abs_gradient(importance, situation.estimate, situation.spread)?),
            None => None,
        };
        // Scaled by the prior, so that the criterion is independent of units; see `InformationModel::scale`.
        let weight = |g: [f64; 3], i: usize| g.get(i).map_or(0.0, |g| g * known.scale[i]);
        let weights = weights.map(|g| DVector::from_fn(known.scale.len(), |i, _| weight(g, i)));
        let indices = match weights.filter(|w| w.norm() > 0.0) {
            Some(w) => greedy_design(before.clone(), candidates, n, |m| -weighted_variance(m, &w)),
            None => greedy_design(before.clone(), candidates, n, log_det),
        };
        let after = indices.iter().fold(before.clone(), |sum, i| sum + &candidates[*i]);
        let expected = known.expected_sd(situation.prior, before, after);
        Ok(ActionSelection { indices, rollouts, groups: None, expected })
    }
}

/// Greedy selection: adds the option that raises `worth(sum so far)` most, `n` times; the first wins a tie.
fn greedy_design(
    before: DMatrix<f64>,
    options: &[DMatrix<f64>],
    n: usize,
    worth: impl Fn(&DMatrix<f64>) -> f64,
) -> Vec<usize> {
    let mut sum = before;
    let mut left: Vec<usize> = (0..options.len()).collect();
    let mut taken = Vec::with_capacity(n.min(options.len()));
    while taken.len() < n && !left.is_empty() {
        let worths = left.iter().map(|i| worth(&(&sum + &options[*i])));
        let (best, _) = worths
            .enumerate()
            .fold((0, f64::NEG_INFINITY), |best, (k, w)| if w > best.1 { (k, w) } else { best });
        let index = left.remove(best);
        sum += &options[index];
        taken.push(index);
    }
    taken
}

/// log det of a positive definite matrix; minus infinity for one that is not.
fn log_det(m: &DMatrix<f64>) -> f64 {
    m.clone().cholesky().map_or(f64::NEG_INFINITY, |c| {
        2.0 * c.l_dirty().diagonal().iter().map(|v| libm::log(*v)).sum::<f64>()
    })
}

/// sum_i (w_i sd_i)^2 for the covariance m^-1; infinite if there is none.
fn weighted_variance(m: &DMatrix<f64>, w: &DVector<f64>) -> f64 {
    m.clone().cholesky().map_or(f64::INFINITY, |c| {
        let covariance = c.inverse();
        (0..w.len()).map(|i| w[i] * w[i] * covariance[(i, i)]).sum()
    })
}

fn place(situation: &AcquisitionContext, task: usize, action: &crate::task::ValidAction) -> Result<Scene> {
    let found = situation.tasks.get(task).map(|t| t.place(action));
    match found {
        Some(Placement::Valid(scene)) => Ok(*scene),
        _ => Err(Error::Failed(format!("a candidate of task {task} cannot be placed again"))),
    }
}

/// Finite-difference design around the current estimate.
struct InformationModel<'a> {
    world: &'a CandidateSimulation,
    coordinates: &'a ParameterSpace,
    /// Centre of the differences.
    centre: ParameterVector,
    /// (low, high) of each coordinate, within bounds; equal to the centre for a fixed one.
    ends: Vec<(f64, f64)>,
    /// Prior standard deviation of each coordinate, and 1 for a fixed one. Information is in these units.
    scale: ParameterVector,
}

impl<'a> InformationModel<'a> {
    fn new(situation: &AcquisitionContext<'a>) -> InformationModel<'a> {
        let coordinates = situation.coordinates;
        let centre = coordinates.clamp(situation.estimate);
        let end = |i: usize, to: f64| {
            if situation.prior[i] <= 0.0 {
                return centre[i];
            }
            let step = (FD_STEP_SHARES.0 * situation.spread[i]).max(FD_STEP_SHARES.1 * situation.prior[i]);
            let [low, high] = coordinates.bounds(i);
            let moved = centre[i] + to * step;
            // The lower end stays at half of a coefficient: force laws are non-linear near zero.
            let least = if to < 0.0 && low >= 0.0 { 0.5 * centre[i] } else { low };
            moved.max(least).clamp(low, high)
        };
        let ends = (0..coordinates.len()).map(|i| (end(i, -1.0), end(i, 1.0))).collect();
        let scale = situation.prior.iter().map(|p| if *p > 0.0 { *p } else { 1.0 }).collect();
        InformationModel { world: situation.world, coordinates, centre, ends, scale }
    }

    /// Prior precision in prior standard deviations: the identity.
    fn prior_precision(&self) -> DMatrix<f64> {
        DMatrix::identity(self.scale.len(), self.scale.len())
    }

    fn zeros(&self) -> DMatrix<f64> {
        DMatrix::zeros(self.scale.len(), self.scale.len())
    }

    /// Standard deviations of the searched coordinates for the information `before` and `after` a batch.
    fn expected_sd(
        &self,
        prior: &[f64],
        before: DMatrix<f64>,
        after: DMatrix<f64>,
    ) -> Vec<ExpectedPosteriorSd> {
        let deviations = |m: DMatrix<f64>| m.cholesky().map(|c| c.inverse().diagonal().map(f64::sqrt));
        let (Some(before), Some(after)) = (deviations(before), deviations(after)) else { return Vec::new() };
        let of = |i: usize| ExpectedPosteriorSd {
            name: self.coordinates.name(i),
            before: before[i] * self.scale[i],
            after: after[i] * self.scale[i],
        };
        (0..prior.len()).filter(|i| prior[*i] > 0.0).map(of).collect()
    }

    /// Fisher information of each scene, and the simulation cost in full rollouts.
    fn information(&self, scenes: &[Scene], progress: &dyn Progress) -> Result<(Vec<DMatrix<f64>>, u64)> {
        let mut found = Vec::with_capacity(scenes.len());
        let (mut steps, mut whole) = (0u64, 0u64);
        for chunk in scenes.chunks(SCENES_PER_BATCH) {
            progress.report("measuring sensitivities", found.len() as u64, scenes.len() as u64)?;
            let nominal: Vec<Rollout> = chunk
                .iter()
                .map(|scene| Rollout {
                    latents: self.coordinates.latents(&self.centre),
                    effects: &self.world.effects,
                    ..Rollout::of(scene)
                })
                .collect();
            let trajectories = Simulator::new(self.world.engine).budget(&progress).map(&nominal, |_, t| t)?;
            whole += chunk.iter().map(|s| u64::from(s.steps)).sum::<u64>();
            steps += trajectories.iter().map(|t| u64::from(t.outcome.steps)).sum::<u64>();
            let mut segments = Vec::new();
            for (owner, (scene, trajectory)) in chunk.iter().zip(&trajectories).enumerate() {
                segments.extend(cut_segments(scene, trajectory).into_iter().map(|scene| (owner, scene)));
            }
            let mut sums = vec![self.zeros(); chunk.len()];
            let ends = self.simulate_variants(&segments, progress)?;
            for ((owner, scene), variants) in segments.iter().zip(ends.chunks(self.variants().len())) {
                sums[*owner] += self.segment_information(variants);
                steps += u64::from(scene.steps) * variants.len() as u64;
            }
            found.append(&mut sums);
        }
        let each = whole as f64 / scenes.len().max(1) as f64;
        Ok((found, (steps as f64 / each.max(1.0)).ceil() as u64))
    }

    /// The centre and both ends of every searched coordinate: (index, value).
    fn variants(&self) -> Vec<(usize, f64)> {
        let ends = (0..self.ends.len()).flat_map(|i| [(i, self.ends[i].0), (i, self.ends[i].1)]);
        std::iter::once((0, self.centre[0])).chain(ends.filter(|(i, v)| *v != self.centre[*i])).collect()
    }

    /// Final positions of every segment in every variant, by segment: (2 n_bodies,) m.
    fn simulate_variants(
        &self,
        segments: &[(usize, Scene)],
        progress: &dyn Progress,
    ) -> Result<Vec<Vec<f64>>> {
        let worlds: Vec<(Latents, Vec<EffectTerm>)> = self
            .variants()
            .into_iter()
            .map(|(i, value)| {
                let mut at = self.centre.clone();
                at[i] = value;
                (self.coordinates.latents(&at), self.coordinates.effects(&at, &self.world.effects))
            })
            .collect();
        let rollouts: Vec<Rollout> = segments
            .iter()
            .flat_map(|(_, scene)| {
                worlds.iter().map(move |(latents, effects)| Rollout {
                    latents: *latents,
                    effects,
                    stop_at_goal: false,
                    ..Rollout::of(scene)
                })
            })
            .collect();
        Simulator::new(self.world.engine).budget(&progress).map(&rollouts, |_, t| {
            if t.outcome.end == Termination::Diverged {
                return Vec::new();
            }
            t.bodies.iter().flat_map(|b| [b.x.last(), b.y.last()]).flatten().copied().collect()
        })
    }

    /// Fisher information of one segment from its final positions in every variant.
    fn segment_information(&self, variants: &[Vec<f64>]) -> DMatrix<f64> {
        let nominal = &variants[0];
        if variants.iter().any(|v| v.len() != nominal.len()) {
            return self.zeros();
        }
        let kinds = self.variants();
        let mut sum = self.zeros();
        for (k, at_centre) in nominal.iter().enumerate() {
            let mut slopes = vec![Vec::new(); self.scale.len()];
            for ((i, value), moved) in kinds.iter().zip(variants).skip(1) {
                slopes[*i].push((moved[k] - at_centre) / (value - self.centre[*i]));
            }
            let j = DVector::from_fn(self.scale.len(), |i, _| {
                smallest_slope(&slopes[i]) * self.scale[i] / OBSERVATION_SD_M
            });
            sum += &j * j.transpose();
        }
        sum
    }
}

/// The slope of smallest magnitude; 0 if signs differ or there is none.
fn smallest_slope(slopes: &[f64]) -> f64 {
    let low = slopes.iter().copied().fold(f64::INFINITY, f64::min);
    let high = slopes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !low.is_finite() || !high.is_finite() {
        0.0
    } else if low > 0.0 {
        low
    } else if high < 0.0 {
        high
    } else {
        0.0
    }
}

/// Segments from every observed state to the next observation, without goal. Segments without motion carry no
/// information and are skipped.
fn cut_segments(scene: &Scene, trajectory: &Trajectory) -> Vec<Scene> {
    let moves = |k: usize| {
        let shift = |b: &crate::trajectory::Track| (b.x[k + 1] - b.x[k]).hypot(b.y[k + 1] - b.y[k]);
        trajectory.bodies.iter().any(|b| shift(b) > 1e-6)
    };
    let segments = trajectory.times.len().saturating_sub(1);
    (0..segments).filter(|k| moves(*k)).map(|k| restart(scene, trajectory, k)).collect()
}

fn restart(scene: &Scene, trajectory: &Trajectory, k: usize) -> Scene {
    let mut segment = scene.clone();
    let span = trajectory.times[k + 1] - trajectory.times[k];
    segment.steps = ((span / scene.time_step).round() as u32).max(1);
    segment.observe_every = segment.steps;
    segment.goal = None;
    for body in &mut segment.bodies {
        let Some(track) = trajectory.track(&body.name) else { continue };
        body.position = Some([track.x[k], track.y[k]]);
        body.angle = track.angle[k];
        body.velocity = [track.vx[k], track.vy[k]];
        body.angular_velocity = track.omega[k];
    }
    segment
}

#[cfg(test)]
mod tests {
    use super::super::tests::{ConstantGradient, SIMULATION, context};
    use super::super::{ActionCandidate, Importance, simulate_candidates, strategy};
    use super::*;
    use crate::progress::NoProgress;
    use crate::rng;
    use crate::task::{Split, Task, family, split};
    use crate::world::Simulator;

    fn drawn_candidates(name: &str, count: usize, seed: u64) -> (Vec<Task>, Vec<ActionCandidate>) {
        let tasks = split(&family(name).unwrap().tasks(), Split::Train);
        let found = simulate_candidates(
            &tasks,
            count,
            &SIMULATION,
            &mut rng::stream(seed, "candidates"),
            &NoProgress,
        )
        .unwrap();
        (tasks, found)
    }

    fn select_ten(
        name: &str,
        tasks: &[Task],
        candidates: &[ActionCandidate],
        importance: Option<&dyn Importance>,
    ) -> Vec<usize> {
        let situation = AcquisitionContext { tasks, ..context(candidates, &SIMULATION, importance) };
        strategy(name).unwrap().select(&situation, 10).unwrap().indices
    }

    /// Density is unidentifiable in bowling and keeps its sd; friction and restitution improve.
    #[test]
    fn reports_expected_standard_deviations() {
        let (tasks, candidates) = drawn_candidates("bowling", 30, 3);
        let situation = AcquisitionContext { tasks: &tasks, ..context(&candidates, &SIMULATION, None) };
        let expected = strategy("informative").unwrap().select(&situation, 5).unwrap().expected;
        let names: Vec<&str> = expected.iter().map(|e| e.name.as_str()).collect();
        assert_eq!(names, ["density", "friction", "restitution"]);
        for (e, prior) in expected.iter().zip(situation.prior) {
            assert!((e.before - prior).abs() < 1e-12, "nothing is measured yet: {e:?}");
        }
        assert!(expected[0].after > 0.9 * expected[0].before, "{expected:?}");
        assert!(expected[1..].iter().all(|e| e.after < 0.5 * e.before), "{expected:?}");
    }

    /// Information about (friction, restitution) of candidates, computed independently: derivatives from the
    /// start to half a second after the second contact, with a finer step, on the general engine.
    fn independent_information(tasks: &[Task], candidates: &[ActionCandidate], chosen: &[usize]) -> [f64; 3] {
        let mut sum = [1.0, 1.0, 0.0];
        for index in chosen {
            let c = &candidates[*index];
            let Placement::Valid(mut scene) = tasks[c.task].place(&c.action) else { panic!("placed before") };
            scene.goal = None;
            scene.observe_every = 12;
            let run = |friction: f64, restitution: f64, steps: u32| {
                let scene = Scene { steps, ..(*scene).clone() };
                let latents = Latents::of([1.0, friction, restitution]);
                let rollout = Rollout { latents, stop_at_goal: false, ..Rollout::of(&scene) };
                Simulator::new(crate::world::Engine::Rapier).run(&[rollout]).unwrap().remove(0)
            };
            let whole = run(0.5, 0.5, scene.steps);
            // Up to half a second after the second contact, before motion becomes chaotic.
            let second = whole.events.get(1).map_or(f64::INFINITY, |e| e.time + 0.5);
            let steps = ((second / scene.time_step) as u32).clamp(1, scene.steps);
            let h = 0.01;
            let ends = [(0.5 - h, 0.5), (0.5 + h, 0.5), (0.5, 0.5 - h), (0.5, 0.5 + h)]
                .map(|(f, r)| run(f, r, steps));
            for b in 0..scene.bodies.len() {
                for k in 0..ends.iter().map(|t| t.times.len()).min().unwrap() {
                    for of in [
                        |t: &crate::trajectory::Track, k: usize| t.x[k],
                        |t: &crate::trajectory::Track, k: usize| t.y[k],
                    ] {
                        let d = |i: usize, j: usize| {
                            ((of(&ends[j].bodies[b], k) - of(&ends[i].bodies[b], k)) / (2.0 * h) * 0.25
                                / 0.05)
                                .clamp(-20.0, 20.0)
                        };
                        let (f, r) = (d(0, 1), d(2, 3));
                        sum[0] += f * f;
                        sum[1] += r * r;
                        sum[2] += f * r;
                    }
                }
            }
        }
        sum
    }

    fn determinant([a, b, c]: [f64; 3]) -> f64 {
        a * b - c * c
    }

    /// Its selection is more informative than the others' by an independent engine and derivatives.
    #[test]
    fn selection_is_more_informative_than_others() {
        let mut logs = [0.0; 3];
        for seed in 0..4 {
            let (tasks, candidates) = drawn_candidates("basketball", 60, seed);
            for (log, name) in logs.iter_mut().zip(["informative", "random", "mixed"]) {
                let chosen = select_ten(name, &tasks, &candidates, None);
                *log += determinant(independent_information(&tasks, &candidates, &chosen)).ln() / 4.0;
            }
        }
        let [ours, random, mixed] = logs;
        eprintln!("mean log det: informative {ours:.2}, random {random:.2}, mixed {mixed:.2}");
        assert!(ours > random + 0.5 && ours > mixed, "{logs:?}");
    }

    /// A surface that depends on one latent reduces that latent's variance more than a surface that depends on
    /// the other.
    #[test]
    fn importance_shifts_selection_to_relevant_latents() {
        let (tasks, candidates) = drawn_candidates("basketball", 60, 7);
        let variance = |slope: [f64; 3], i: usize| {
            let slope = ConstantGradient(slope);
            let situation =
                AcquisitionContext { tasks: &tasks, ..context(&candidates, &SIMULATION, Some(&slope)) };
            let chosen = InformativeStrategy.select(&situation, 5).unwrap();
            let probe = InformationModel::new(&situation);
            let scenes: Vec<Scene> = chosen
                .indices
                .iter()
                .map(|c| place(&situation, candidates[*c].task, &candidates[*c].action).unwrap())
                .collect();
            let (told, _) = probe.information(&scenes, &NoProgress).unwrap();
            let sum = told.iter().fold(probe.prior_precision(), |sum, f| sum + f);
            sum.try_inverse().unwrap()[(i, i)]
        };
        let (friction, restitution) = ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        assert!(variance(friction, 1) < variance(restitution, 1));
        assert!(variance(restitution, 2) <= variance(friction, 2));
    }

    /// A sliding disc identifies friction, a bouncing one restitution, and none density.
    #[test]
    fn information_matches_analytic_physics() {
        let scene = |velocity: [f64; 2], height: f64| {
            let (tasks, _) = drawn_candidates("bowling", 1, 1);
            let mut scene = tasks[0].scene.clone();
            scene.bodies.truncate(1);
            scene.bodies[0].shape = crate::task::shape::Disc { radius: 1.0 }.into();
            scene.bodies[0].position = Some([20.0, 1.0 + height]);
            scene.bodies[0].velocity = velocity;
            (scene.goal, scene.action, scene.steps) = (None, None, 480);
            scene
        };
        let situation = context(&[], &SIMULATION, None);
        let probe = InformationModel::new(&situation);
        let scenes = [scene([5.0, 0.0], 0.0), scene([0.0, 0.0], 8.0), scene([0.0, 0.0], 0.0)];
        let (told, rollouts) = probe.information(&scenes, &NoProgress).unwrap();
        let [slides, bounces, rests] = [&told[0], &told[1], &told[2]];
        assert!(slides[(1, 1)] > 1.0 && slides[(2, 2)] < 1e-3, "{slides}");
        assert!(bounces[(2, 2)] > 3.0 && bounces[(1, 1)] < 1e-6, "{bounces}");
        assert!(rests.norm() < 1e-6, "{rests}");
        // Density cancels for a single body.
        assert!(slides[(0, 0)] < 1e-6 && bounces[(0, 0)] < 1e-6);
        // One nominal rollout each, and seven variants for those that move: six ends and the centre.
        assert!((4..=3 * 8).contains(&rollouts), "{rollouts}");
        // The disc's first sliding second: x = v t - mu g t^2 / 2, so that one segment of a quarter second has
        // dx/dmu = -g t^2 / 2 per contact coefficient, which is the product with the floor's sqrt(1/2). It slips for
        // v / (3 mu g) = 0.48 s, not quite two segments.
        let per_segment = (9.8 * 0.25f64.powi(2) / 2.0 * 0.5f64.sqrt() * 0.25 / OBSERVATION_SD_M).powi(2);
        let segments = slides[(1, 1)] / per_segment;
        assert!((1.0..2.0).contains(&segments), "{segments}");
    }

    #[test]
    fn discontinuities_have_zero_slope() {
        assert_eq!(smallest_slope(&[2.0, 1.0]), 1.0);
        assert_eq!(smallest_slope(&[-2.0, -1.0]), -1.0);
        assert_eq!(smallest_slope(&[-2.0, 100.0]), 0.0);
        assert_eq!(smallest_slope(&[0.0, 100.0]), 0.0);
        assert_eq!((smallest_slope(&[]), smallest_slope(&[f64::NAN, 1.0])), (0.0, 1.0));
    }

    /// A repeated action adds less information.
    #[test]
    fn repeated_information_is_worth_less() {
        let f = |d: [f64; 4]| DMatrix::from_diagonal(&DVector::from_column_slice(&d));
        let options = [f([0.0, 0.0, 50.0, 0.0]), f([0.0, 20.0, 0.0, 0.0])];
        let first = |before: DMatrix<f64>| greedy_design(before, &options, 1, log_det)[0];
        assert_eq!(first(DMatrix::identity(4, 4)), 0);
        assert_eq!(first(DMatrix::identity(4, 4) + &options[0]), 1);
    }
}
