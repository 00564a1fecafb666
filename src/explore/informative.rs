//! `informative`: the batch of actions that leaves the least uncertainty about the latents.
//!
//! With theta the latents (and the parameters of effects that are fitted along with them), every candidate c
//! brings Fisher information F_c = sum_k J_k J_k^T / sigma^2, where J_k is the sensitivity of the k-th observed
//! coordinate. What is known before the batch is M = prior precision + information of the trials already paid for.
//! Actions are taken one by one, each the one that raises log det(M + F) most (D-optimal design); with a performance
//! surface at hand, each the one that lowers sum_i (dP/d theta_i)^2 Var_i most: the part of the uncertainty that
//! performance feels (a weighted A-optimal design). The prior keeps latents that nothing tells, such as the density
//! in bowling, from counting: what no action changes favours none.
//!
//! Source: ours. Design criteria: Fedorov 1972, Chaloner and Verdinelli 1995; greedy choice is near the best for
//! log det, which has diminishing returns (Nemhauser et al. 1978).
//!
//! Sensitivities are of segments, not of whole trajectories: the simulation is restarted from each observed state of
//! the nominal trajectory and looked at one observation later. Over a whole trajectory collisions amplify any
//! difference until it says nothing, and such sensitivities are large, and useless. For the same reason the two
//! one-sided differences of a segment are compared and the smaller one is taken, none if their signs differ: a disc
//! that hits on one side and misses on the other is a jump, not a slope.
//!
//! Range of validity: positions are taken to be observed at the scene's own times, independently, to within
//! [`SIGMA`]; errors that a wrong model makes are neither. Where the simulation can match the world (or its drag is
//! fitted along), nine actions on bowling left mean errors over four seeds of 0.003 in friction and 0.008 in
//! restitution, where random ones left 0.2 and 0.01 and `mixed` 0.15 and 0.03. Where it lacks the drag, actions that
//! tell the latents most are also pulled most, and no strategy is right.

use nalgebra::{DMatrix, DVector};

use super::gradient::magnitudes;
use super::{Chosen, Expected, Situation, Strategy, World};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::task::scene::EffectTerm;
use crate::task::{Placement, Scene};
use crate::trajectory::{End, Trajectory};
use crate::world::{Coordinates, Latents, Rollout, Sample, simulate_map};

/// The strategy's row in the registry.
pub struct Informative;

/// Standard deviation that an observed coordinate is taken to have after one observation interval, m: what a
/// camera and a model that lacks a little drag leave together. Larger trusts the prior longer (and spreads the batch
/// less over kinds of action), smaller takes the prior for nothing.
pub const SIGMA: f64 = 0.05;
/// Step of the differences as a share of the search's spread, and its least size as a share of the prior's.
const STEP: (f64, f64) = (0.5, 0.02);
/// Scenes whose segments are held in memory at once.
const CHUNK: usize = 16;

impl Strategy for Informative {
    fn name(&self) -> &'static str {
        "informative"
    }

    fn choose(&self, situation: &Situation, n: usize) -> Result<Chosen> {
        let known = Probe::new(situation);
        let mut scenes = Vec::with_capacity(situation.candidates.len() + situation.trials.len());
        for candidate in situation.candidates {
            scenes.push(placed(situation, candidate.task, &candidate.action)?);
        }
        scenes.extend(situation.trials.iter().map(|t| t.scene.clone()));
        let (told, rollouts) = known.information(&scenes, situation.progress)?;
        let (candidates, trials) = told.split_at(situation.candidates.len());
        let before = trials.iter().fold(known.precision(), |sum, f| sum + f);
        let weights = match situation.importance {
            Some(importance) => Some(magnitudes(importance, situation.estimate, situation.spread)?),
            None => None,
        };
        // Scaled by the prior, so that the criterion does not depend on units; see `Probe::scale`.
        let weight = |g: [f64; 3], i: usize| g.get(i).map_or(0.0, |g| g * known.scale[i]);
        let weights = weights.map(|g| DVector::from_fn(known.scale.len(), |i, _| weight(g, i)));
        let indices = match weights.filter(|w| w.norm() > 0.0) {
            Some(w) => greedy(before.clone(), candidates, n, |m| -weighted_variance(m, &w)),
            None => greedy(before.clone(), candidates, n, log_det),
        };
        let after = indices.iter().fold(before.clone(), |sum, i| sum + &candidates[*i]);
        let expected = known.expected(situation.prior, before, after);
        Ok(Chosen { indices, rollouts, groups: None, expected })
    }
}

/// Takes `n` of `options` one by one, each time the one that raises `worth(sum so far)` most; the first on a tie.
fn greedy(
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

fn placed(situation: &Situation, task: usize, action: &crate::task::ValidAction) -> Result<Scene> {
    let found = situation.tasks.get(task).map(|t| t.place(action));
    match found {
        Some(Placement::Valid(scene)) => Ok(*scene),
        _ => Err(Error::Failed(format!("a candidate of task number {task} cannot be placed again"))),
    }
}

/// Around what, and how far, the simulation is varied.
struct Probe<'a> {
    world: &'a World,
    coordinates: &'a Coordinates,
    /// Where differences are taken from.
    centre: Sample,
    /// (low, high) of each coordinate, within bounds; equal to the centre for one that is not searched.
    ends: Vec<(f64, f64)>,
    /// Standard deviation of the prior of each coordinate, and 1 for one that is not searched. Information is per
    /// this unit.
    scale: Sample,
}

impl<'a> Probe<'a> {
    fn new(situation: &Situation<'a>) -> Probe<'a> {
        let coordinates = situation.coordinates;
        let centre = coordinates.clamp(situation.estimate);
        let end = |i: usize, to: f64| {
            if situation.prior[i] <= 0.0 {
                return centre[i];
            }
            let step = (STEP.0 * situation.spread[i]).max(STEP.1 * situation.prior[i]);
            let [low, high] = coordinates.bounds(i);
            let moved = centre[i] + to * step;
            // Half the value is as far down as the difference of a coefficient goes: close to zero laws bend.
            let least = if to < 0.0 && low >= 0.0 { 0.5 * centre[i] } else { low };
            moved.max(least).clamp(low, high)
        };
        let ends = (0..coordinates.len()).map(|i| (end(i, -1.0), end(i, 1.0))).collect();
        let scale = situation.prior.iter().map(|p| if *p > 0.0 { *p } else { 1.0 }).collect();
        Probe { world: situation.world, coordinates, centre, ends, scale }
    }

    /// What the prior knows, per prior standard deviation: one each.
    fn precision(&self) -> DMatrix<f64> {
        DMatrix::identity(self.scale.len(), self.scale.len())
    }

    fn nothing(&self) -> DMatrix<f64> {
        DMatrix::zeros(self.scale.len(), self.scale.len())
    }

    /// How far each coordinate that is searched is known with the information `before` and `after` a batch.
    fn expected(&self, prior: &[f64], before: DMatrix<f64>, after: DMatrix<f64>) -> Vec<Expected> {
        let deviations = |m: DMatrix<f64>| m.cholesky().map(|c| c.inverse().diagonal().map(f64::sqrt));
        let (Some(before), Some(after)) = (deviations(before), deviations(after)) else { return Vec::new() };
        let of = |i: usize| Expected {
            name: self.coordinates.name(i),
            before: before[i] * self.scale[i],
            after: after[i] * self.scale[i],
        };
        (0..prior.len()).filter(|i| prior[*i] > 0.0).map(of).collect()
    }

    /// Fisher information of observing each scene, and the full rollouts' worth of simulation it took.
    fn information(&self, scenes: &[Scene], progress: &dyn Progress) -> Result<(Vec<DMatrix<f64>>, u64)> {
        let mut found = Vec::with_capacity(scenes.len());
        let (mut steps, mut whole) = (0u64, 0u64);
        for chunk in scenes.chunks(CHUNK) {
            progress.report("measuring sensitivities", found.len() as u64, scenes.len() as u64)?;
            let nominal: Vec<Rollout> = chunk
                .iter()
                .map(|scene| Rollout {
                    latents: self.coordinates.latents(&self.centre),
                    effects: &self.world.effects,
                    ..Rollout::of(scene)
                })
                .collect();
            let trajectories = simulate_map(&nominal, self.world.engine, |_, t| t)?;
            whole += chunk.iter().map(|s| u64::from(s.steps)).sum::<u64>();
            steps += trajectories.iter().map(|t| u64::from(t.outcome.steps)).sum::<u64>();
            let mut segments = Vec::new();
            for (owner, (scene, trajectory)) in chunk.iter().zip(&trajectories).enumerate() {
                segments.extend(cut(scene, trajectory).into_iter().map(|scene| (owner, scene)));
            }
            let mut sums = vec![self.nothing(); chunk.len()];
            let ends = self.simulate_variants(&segments)?;
            for ((owner, scene), variants) in segments.iter().zip(ends.chunks(self.variants().len())) {
                sums[*owner] += self.of_segment(variants);
                steps += u64::from(scene.steps) * variants.len() as u64;
            }
            found.append(&mut sums);
        }
        let each = whole as f64 / scenes.len().max(1) as f64;
        Ok((found, (steps as f64 / each.max(1.0)).ceil() as u64))
    }

    /// The centre and both ends of every coordinate that is searched: (its index, value).
    fn variants(&self) -> Vec<(usize, f64)> {
        let ends = (0..self.ends.len()).flat_map(|i| [(i, self.ends[i].0), (i, self.ends[i].1)]);
        std::iter::once((0, self.centre[0])).chain(ends.filter(|(i, v)| *v != self.centre[*i])).collect()
    }

    /// Final positions of every segment in every variant, segment by segment: (2 n_bodies,) m.
    fn simulate_variants(&self, segments: &[(usize, Scene)]) -> Result<Vec<Vec<f64>>> {
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
                    stop: false,
                    ..Rollout::of(scene)
                })
            })
            .collect();
        simulate_map(&rollouts, self.world.engine, |_, t| {
            if t.outcome.end == End::Diverged {
                return Vec::new();
            }
            t.bodies.iter().flat_map(|b| [b.x.last(), b.y.last()]).flatten().copied().collect()
        })
    }

    /// Information of one segment from its final positions in every variant.
    fn of_segment(&self, variants: &[Vec<f64>]) -> DMatrix<f64> {
        let nominal = &variants[0];
        if variants.iter().any(|v| v.len() != nominal.len()) {
            return self.nothing();
        }
        let kinds = self.variants();
        let mut sum = self.nothing();
        for (k, at_centre) in nominal.iter().enumerate() {
            let mut slopes = vec![Vec::new(); self.scale.len()];
            for ((i, value), moved) in kinds.iter().zip(variants).skip(1) {
                slopes[*i].push((moved[k] - at_centre) / (value - self.centre[*i]));
            }
            let j = DVector::from_fn(self.scale.len(), |i, _| gentlest(&slopes[i]) * self.scale[i] / SIGMA);
            sum += &j * j.transpose();
        }
        sum
    }
}

/// The smallest of some slopes; 0 if they do not agree on the sign, or if there is none.
fn gentlest(slopes: &[f64]) -> f64 {
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

/// The scene restarted from every observed state of its trajectory, each up to the next observation, without goal.
/// Segments in which nothing moves are left out: they tell nothing.
fn cut(scene: &Scene, trajectory: &Trajectory) -> Vec<Scene> {
    let moves = |k: usize| {
        let shift = |b: &crate::trajectory::Track| (b.x[k + 1] - b.x[k]).hypot(b.y[k + 1] - b.y[k]);
        trajectory.bodies.iter().any(|b| shift(b) > 1e-6)
    };
    let segments = trajectory.times.len().saturating_sub(1);
    (0..segments).filter(|k| moves(*k)).map(|k| restarted(scene, trajectory, k)).collect()
}

fn restarted(scene: &Scene, trajectory: &Trajectory, k: usize) -> Scene {
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
    use super::super::tests::{Slope, WORLD, seen};
    use super::super::{Candidate, Importance, candidates, strategy};
    use super::*;
    use crate::progress::Silent;
    use crate::rng;
    use crate::task::{Split, Task, family, split};
    use crate::world::simulate;

    fn drawn(name: &str, count: usize, seed: u64) -> (Vec<Task>, Vec<Candidate>) {
        let tasks = split(&family(name).unwrap().tasks(), Split::Train);
        let found = candidates(&tasks, count, &WORLD, &mut rng::stream(seed, "candidates"), &Silent).unwrap();
        (tasks, found)
    }

    fn choose(
        name: &str,
        tasks: &[Task],
        candidates: &[Candidate],
        importance: Option<&dyn Importance>,
    ) -> Vec<usize> {
        let situation = Situation { tasks, ..seen(candidates, &WORLD, importance) };
        strategy(name).unwrap().choose(&situation, 10).unwrap().indices
    }

    /// Density cancels in bowling, which the batch is expected to leave as it is; the other two become better known.
    #[test]
    fn what_a_batch_is_expected_to_tell_is_said() {
        let (tasks, candidates) = drawn("bowling", 30, 3);
        let situation = Situation { tasks: &tasks, ..seen(&candidates, &WORLD, None) };
        let expected = strategy("informative").unwrap().choose(&situation, 5).unwrap().expected;
        let names: Vec<&str> = expected.iter().map(|e| e.name.as_str()).collect();
        assert_eq!(names, ["density", "friction", "restitution"]);
        for (e, prior) in expected.iter().zip(situation.prior) {
            assert!((e.before - prior).abs() < 1e-12, "nothing is measured yet: {e:?}");
        }
        assert!(expected[0].after > 0.9 * expected[0].before, "{expected:?}");
        assert!(expected[1..].iter().all(|e| e.after < 0.5 * e.before), "{expected:?}");
    }

    /// Information about (friction, restitution) of some candidates, computed another way: derivatives of the
    /// trajectory from the start to half a second after the second contact, by a finer step, on the general engine.
    fn evidence(tasks: &[Task], candidates: &[Candidate], chosen: &[usize]) -> [f64; 3] {
        let mut sum = [1.0, 1.0, 0.0];
        for index in chosen {
            let c = &candidates[*index];
            let Placement::Valid(mut scene) = tasks[c.task].place(&c.action) else { panic!("placed before") };
            scene.goal = None;
            scene.observe_every = 12;
            let run = |friction: f64, restitution: f64, steps: u32| {
                let scene = Scene { steps, ..(*scene).clone() };
                let latents = Latents::of([1.0, friction, restitution]);
                let rollout = Rollout { latents, stop: false, ..Rollout::of(&scene) };
                simulate(&[rollout], crate::world::Engine::Rapier).unwrap().remove(0)
            };
            let whole = run(0.5, 0.5, scene.steps);
            // Up to half a second after the second contact: before chaos.
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

    /// What it chooses tells more than what the others choose, judged by an engine and derivatives it did not use.
    #[test]
    fn its_ten_tell_more_than_others() {
        let mut logs = [0.0; 3];
        for seed in 0..4 {
            let (tasks, candidates) = drawn("basketball", 60, seed);
            for (log, name) in logs.iter_mut().zip(["informative", "random", "mixed"]) {
                let chosen = choose(name, &tasks, &candidates, None);
                *log += determinant(evidence(&tasks, &candidates, &chosen)).ln() / 4.0;
            }
        }
        let [ours, random, mixed] = logs;
        eprintln!("mean log det: informative {ours:.2}, random {random:.2}, mixed {mixed:.2}");
        assert!(ours > random + 0.5 && ours > mixed, "{logs:?}");
    }

    /// With a surface that asks for one latent alone, that latent's variance is smaller than with one that asks for
    /// the other.
    #[test]
    fn importance_moves_the_choice_to_what_matters() {
        let (tasks, candidates) = drawn("basketball", 60, 7);
        let variance = |slope: [f64; 3], i: usize| {
            let slope = Slope(slope);
            let situation = Situation { tasks: &tasks, ..seen(&candidates, &WORLD, Some(&slope)) };
            let chosen = Informative.choose(&situation, 5).unwrap();
            let probe = Probe::new(&situation);
            let scenes: Vec<Scene> = chosen
                .indices
                .iter()
                .map(|c| placed(&situation, candidates[*c].task, &candidates[*c].action).unwrap())
                .collect();
            let (told, _) = probe.information(&scenes, &Silent).unwrap();
            let sum = told.iter().fold(probe.precision(), |sum, f| sum + f);
            sum.try_inverse().unwrap()[(i, i)]
        };
        let (friction, restitution) = ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        assert!(variance(friction, 1) < variance(restitution, 1));
        assert!(variance(restitution, 2) <= variance(friction, 2));
    }

    /// A disc that slides to rest tells friction, one that bounces restitution, and none tells the density.
    #[test]
    fn scenes_tell_what_physics_says_they_tell() {
        let scene = |velocity: [f64; 2], height: f64| {
            let (tasks, _) = drawn("bowling", 1, 1);
            let mut scene = tasks[0].scene.clone();
            scene.bodies.truncate(1);
            scene.bodies[0].shape = crate::task::shape::Disc { radius: 1.0 }.into();
            scene.bodies[0].position = Some([20.0, 1.0 + height]);
            scene.bodies[0].velocity = velocity;
            (scene.goal, scene.action, scene.steps) = (None, None, 480);
            scene
        };
        let situation = seen(&[], &WORLD, None);
        let probe = Probe::new(&situation);
        let scenes = [scene([5.0, 0.0], 0.0), scene([0.0, 0.0], 8.0), scene([0.0, 0.0], 0.0)];
        let (told, rollouts) = probe.information(&scenes, &Silent).unwrap();
        let [slides, bounces, rests] = [&told[0], &told[1], &told[2]];
        assert!(slides[(1, 1)] > 1.0 && slides[(2, 2)] < 1e-3, "{slides}");
        assert!(bounces[(2, 2)] > 3.0 && bounces[(1, 1)] < 1e-6, "{bounces}");
        assert!(rests.norm() < 1e-6, "{rests}");
        // Density cancels for a body alone.
        assert!(slides[(0, 0)] < 1e-6 && bounces[(0, 0)] < 1e-6);
        // One nominal rollout each, and seven for those that move: six ends and the centre.
        assert!((4..=3 * 8).contains(&rollouts), "{rollouts}");
        // The disc's first sliding second: x = v t - mu g t^2 / 2, so that one segment of a quarter second has
        // dx/dmu = -g t^2 / 2 per contact coefficient, which is the product with the floor's sqrt(1/2). It slips for
        // v / (3 mu g) = 0.48 s, not quite two segments.
        let per_segment = (9.8 * 0.25f64.powi(2) / 2.0 * 0.5f64.sqrt() * 0.25 / SIGMA).powi(2);
        let segments = slides[(1, 1)] / per_segment;
        assert!((1.0..2.0).contains(&segments), "{segments}");
    }

    #[test]
    fn jumps_are_not_slopes() {
        assert_eq!(gentlest(&[2.0, 1.0]), 1.0);
        assert_eq!(gentlest(&[-2.0, -1.0]), -1.0);
        assert_eq!(gentlest(&[-2.0, 100.0]), 0.0);
        assert_eq!(gentlest(&[0.0, 100.0]), 0.0);
        assert_eq!((gentlest(&[]), gentlest(&[f64::NAN, 1.0])), (0.0, 1.0));
    }

    /// Once an action has been measured, the same one again tells less than it did.
    #[test]
    fn what_is_known_already_is_worth_less() {
        let f = |d: [f64; 4]| DMatrix::from_diagonal(&DVector::from_column_slice(&d));
        let options = [f([0.0, 0.0, 50.0, 0.0]), f([0.0, 20.0, 0.0, 0.0])];
        let first = |before: DMatrix<f64>| greedy(before, &options, 1, log_det)[0];
        assert_eq!(first(DMatrix::identity(4, 4)), 0);
        assert_eq!(first(DMatrix::identity(4, 4) + &options[0]), 1);
    }
}
