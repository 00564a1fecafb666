//! Up to eight rollouts of a mechanism, one per lane.
//!
//! The classical Runge-Kutta method with a fixed step; a motor's command in a step is its mean over the step. Observations
//! between steps are interpolated by cubic Hermite polynomials, which have the method's order.

#![allow(unsafe_code, reason = "calls code compiled for SIMD features that were detected on this machine")]

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{__m128d, __m256d, __m512d};

use super::super::lanes::simd::{Register, V, Wide};
use rayon::prelude::*;

use super::super::lanes::SimdLevel;
use super::command::{CommandCursor, Commands};
use super::dynamics::{IDLE_LINK, JointValues, LARGE, LinkLanes, NONE, TreeLanes, accelerations};
use super::effect::{DriveLaw, JointLanes, JointLaw, JointTerm, LawValues, MAX_PARAMETERS, TorqueLaw};
use super::rollout::{JointMotion, JointRollout};
use super::tree::Tree;
use crate::task::joint::Control;
use crate::world::effect::LANES;

/// Weight of each stage's rates in the step, and the part of the step from the start to the next stage.
const STAGES: &[[f64; 2]] = &[[1.0, 0.5], [2.0, 0.5], [2.0, 1.0], [1.0, 0.0]];

/// Laws of one joint.
struct JointLaws {
    torques: Vec<(&'static dyn TorqueLaw, LawValues)>,
    drives: Vec<(&'static dyn DriveLaw, LawValues)>,
}

/// The state of a batch.
struct Batch<'a> {
    rollouts: &'a [JointRollout<'a>],
    tree: TreeLanes,
    laws: Vec<JointLaws>,
    /// By joint.
    position: Vec<V>,
    velocity: Vec<V>,
    /// Command of each joint in the step.
    commands: Vec<V>,
    /// Whether a lane has a torque field.
    has_field: bool,
    time_step: f64,
}

/// Simulates rollouts in parallel: the same bits on any number of threads and in any batch. All rollouts are of the same joints,
/// motors and springs. Neighbours with the same effects in the same joints share registers.
pub fn simulate(rollouts: &[JointRollout]) -> Vec<JointMotion> {
    let alike = rollouts.chunk_by(has_same_effects);
    let batches: Vec<&[JointRollout]> = alike.flat_map(|own| own.chunks(LANES)).collect();
    batches.into_par_iter().flat_map_iter(run).collect()
}

/// Whether two rollouts have the same effects in the same joints.
fn has_same_effects(a: &JointRollout, b: &JointRollout) -> bool {
    let is_same = |(a, b): (&JointTerm, &JointTerm)| a.joint == b.joint && a.effect.name == b.effect.name;
    a.terms.len() == b.terms.len() && a.terms.iter().zip(&b.terms).all(is_same)
}

/// Simulates up to [`LANES`] rollouts with the same effects.
fn run(rollouts: &[JointRollout]) -> Vec<JointMotion> {
    let mut batch = Batch::new(rollouts);
    let joints = batch.tree.links.len();
    let mut observers: Vec<Observer> =
        rollouts.iter().map(|rollout| Observer::new(rollout, joints)).collect();
    let mut commands: Vec<LaneCommands> =
        rollouts.iter().map(|rollout| LaneCommands::new(rollout, joints)).collect();
    let mut before = (batch.position.clone(), batch.velocity.clone());
    let mut step = 0u32;
    while observers.iter().any(|observer| observer.due.is_finite()) {
        before.0.copy_from_slice(&batch.position);
        before.1.copy_from_slice(&batch.velocity);
        for (lane, commands) in commands.iter_mut().enumerate() {
            commands.set(lane, step, batch.time_step, &mut batch.commands);
        }
        batch.step();
        step += 1;
        for (lane, observer) in observers.iter_mut().enumerate() {
            observer.observe(lane, step, &batch, &before);
        }
    }
    observers.into_iter().map(|observer| observer.motion).collect()
}

impl<'a> Batch<'a> {
    fn new(rollouts: &'a [JointRollout<'a>]) -> Batch<'a> {
        let tree = rollouts[0].tree;
        let joints = tree.links.len();
        let mut links = vec![LinkLanes::default(); joints];
        (0..LANES).for_each(|lane| links.iter_mut().for_each(|link| link.set(lane, &IDLE_LINK)));
        let mut lanes =
            TreeLanes { kinds: tree.kinds.clone(), parents: tree.parents.clone(), links, gravity: [NONE; 2] };
        let (mut position, mut velocity) = (vec![NONE; joints], vec![NONE; joints]);
        for (lane, rollout) in rollouts.iter().enumerate() {
            let (links, gravity) = rollout.physics();
            lanes.links.iter_mut().zip(&links).for_each(|(to, from)| to.set(lane, from));
            (lanes.gravity[0][lane], lanes.gravity[1][lane]) = (gravity[0], gravity[1]);
            for j in 0..joints {
                (position[j][lane], velocity[j][lane]) = (rollout.position[j], rollout.velocity[j]);
            }
        }
        Batch {
            rollouts,
            tree: lanes,
            laws: (0..joints).map(|joint| JointLaws::of(rollouts, joint)).collect(),
            position,
            velocity,
            commands: vec![NONE; joints],
            has_field: rollouts.iter().any(|r| r.field.is_some()),
            time_step: tree.time_step,
        }
    }

    /// Advances every lane by a step, with the widest instructions of the machine.
    fn step(&mut self) {
        match SimdLevel::best() {
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx512 => {
                #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw")]
                fn step(batch: &mut Batch) {
                    batch.step_with::<__m512d, 1>();
                }
                // SAFETY: the instructions were detected.
                unsafe { step(self) }
            }
            #[cfg(target_arch = "x86_64")]
            SimdLevel::Avx2 => {
                #[target_feature(enable = "avx2")]
                fn step(batch: &mut Batch) {
                    batch.step_with::<__m256d, 2>();
                }
                // SAFETY: the instructions were detected.
                unsafe { step(self) }
            }
            #[cfg(target_arch = "x86_64")]
            _ => self.step_with::<__m128d, 4>(),
            #[cfg(not(target_arch = "x86_64"))]
            _ => self.step_with::<f64, LANES>(),
        }
    }

    #[inline(always)]
    fn step_with<R: Register, const N: usize>(&mut self) {
        // Each size is another copy to compile; see `LARGE`.
        match self.position.len() {
            1 | 2 => self.step_of::<R, N, 2>(),
            _ => self.step_of::<R, N, LARGE>(),
        }
    }

    #[inline(always)]
    fn step_of<R: Register, const N: usize, const D: usize>(&mut self) {
        let n = self.position.len();
        let zero: Wide<R, N> = Wide::all(0.0);
        let (mut q0, mut v0) = ([zero; D], [zero; D]);
        for j in 0..n {
            (q0[j], v0[j]) = (Wide::load(&self.position[j]), Wide::load(&self.velocity[j]));
        }
        let (mut q, mut v) = (q0, v0);
        let (mut sum_v, mut sum_a) = ([zero; D], [zero; D]);
        // A slice whose length the compiler does not know: unrolled, this loop takes it minutes.
        for [weight, by] in std::hint::black_box(STAGES) {
            let tau = self.torques(&q, &v);
            let a = accelerations(&self.tree, &q, &v, &tau);
            let (weight, by) = (Wide::all(*weight), Wide::all(*by * self.time_step));
            for j in 0..n {
                sum_v[j] = sum_v[j] + weight * v[j];
                sum_a[j] = sum_a[j] + weight * a[j];
                (q[j], v[j]) = (q0[j] + by * v[j], v0[j] + by * a[j]);
            }
        }
        let sixth = Wide::all(self.time_step / 6.0);
        for j in 0..n {
            (q0[j] + sixth * sum_v[j]).store(&mut self.position[j]);
            (v0[j] + sixth * sum_a[j]).store(&mut self.velocity[j]);
        }
    }

    /// Torques of motors, effects and torque fields.
    #[inline(always)]
    fn torques<R: Register, const N: usize, const D: usize>(
        &self,
        q: &JointValues<R, N, D>,
        v: &JointValues<R, N, D>,
    ) -> JointValues<R, N, D> {
        let mut out = [Wide::all(0.0); D];
        let tree = self.rollouts[0].tree;
        for j in 0..self.position.len() {
            let laws = &self.laws[j];
            let motor = tree.motors[j].as_ref();
            let command: Wide<R, N> = Wide::load(&self.commands[j]);
            let mut drive = Wide::all(0.0);
            if let Some(motor) = motor {
                let (stiffness, damping) = (Wide::all(motor.stiffness), Wide::all(motor.damping));
                let free = match motor.control {
                    Control::Torque => command,
                    Control::Velocity => damping * (command - v[j]),
                    Control::Position => stiffness * (command - q[j]) - damping * v[j],
                };
                drive = free.below(Wide::all(motor.max_torque)).above(Wide::all(-motor.max_torque));
            }
            let passive = passive_torque(tree, j, q[j], v[j]);
            if laws.torques.is_empty() && laws.drives.is_empty() && !self.has_field {
                out[j] = passive.map_or(drive, |passive| drive + passive);
                continue;
            }
            let mut joint =
                JointLanes { max_torque: motor.map_or(0.0, |m| m.max_torque), ..JointLanes::default() };
            q[j].store(&mut joint.position);
            v[j].store(&mut joint.velocity);
            drive.store(&mut joint.drive);
            out[j] = Wide::load(&self.with_laws(j, joint));
            out[j] = passive.map_or(out[j], |passive| out[j] + passive);
        }
        out
    }

    /// Torque of a joint with its laws and torque fields.
    fn with_laws(&self, j: usize, mut joint: JointLanes) -> [f64; LANES] {
        for (law, values) in &self.laws[j].drives {
            law.change_lanes(values, &mut joint);
        }
        let mut total = joint.drive;
        for (law, values) in &self.laws[j].torques {
            law.add_lanes(values, &joint, &mut total);
        }
        for (lane, rollout) in self.rollouts.iter().enumerate() {
            let Some((field, coefficients)) = &rollout.field else { continue };
            let state = [joint.position[lane], joint.velocity[lane], joint.drive[lane]];
            for (function, coefficient) in coefficients.iter().filter(|(k, _)| field.functions[*k].joint == j)
            {
                total[lane] += coefficient * field.at(*function, state);
            }
        }
        total
    }
}

/// Torque of a joint's spring and stops; `None` without them.
#[inline(always)]
fn passive_torque<R: Register, const N: usize>(
    tree: &Tree,
    j: usize,
    q: Wide<R, N>,
    v: Wide<R, N>,
) -> Option<Wide<R, N>> {
    let spring = tree.springs[j].map(|spring| {
        let off = q - Wide::all(spring.rest);
        Wide::all(-spring.stiffness) * off - Wide::all(spring.damping) * v
    });
    let Some(stop) = &tree.stops[j] else { return spring };
    let (zero, one) = (Wide::all(0.0), Wide::all(1.0));
    let (stiffness, rate) = (Wide::all(stop.stiffness), Wide::all(stop.damping) * v);
    let above = (q - Wide::all(stop.high)).above(zero) * (one + rate).above(zero);
    let below = (Wide::all(stop.low) - q).above(zero) * (one - rate).above(zero);
    let push = stiffness * (below - above);
    Some(spring.map_or(push, |spring| spring + push))
}

impl JointLaws {
    fn of(rollouts: &[JointRollout], joint: usize) -> JointLaws {
        let mut out = JointLaws { torques: Vec::new(), drives: Vec::new() };
        for (k, term) in rollouts[0].terms.iter().enumerate().filter(|(_, term)| term.joint == joint) {
            let mut values: LawValues = [[0.0; MAX_PARAMETERS]; LANES];
            for (lane, values) in values.iter_mut().enumerate() {
                let own = &rollouts.get(lane).unwrap_or(&rollouts[0]).terms[k].values;
                values[..own.len()].copy_from_slice(own);
            }
            match term.effect.law {
                JointLaw::Torque(law) => out.torques.push((law, values)),
                JointLaw::Drive(law) => out.drives.push((law, values)),
                _ => {}
            }
        }
        out
    }
}

/// Commands of a rollout's joints, step by step.
struct LaneCommands<'a> {
    commands: &'a Commands,
    first_time: f64,
    /// Joints with commands, their delays and places in the commands.
    joints: Vec<(usize, f64, CommandCursor)>,
}

impl<'a> LaneCommands<'a> {
    fn new(rollout: &JointRollout<'a>, joints: usize) -> LaneCommands<'a> {
        let driven = (0..joints).filter(|j| rollout.commands.drives(*j));
        let own = driven.map(|j| (j, rollout.delays(j)[0], CommandCursor::default()));
        LaneCommands { commands: rollout.commands, first_time: rollout.first_time(), joints: own.collect() }
    }

    /// Sets the mean commands of a step in a lane.
    fn set(&mut self, lane: usize, step: u32, time_step: f64, all: &mut [V]) {
        for (joint, delay, cursor) in &mut self.joints {
            let from = self.first_time + f64::from(step) * time_step - *delay;
            all[*joint][lane] = self.commands.next_mean(*joint, [from, from + time_step], cursor);
        }
    }
}

/// Records the observations of a rollout.
struct Observer<'a> {
    rollout: &'a JointRollout<'a>,
    first_time: f64,
    /// By joint: age of its measurements, s.
    lags: Vec<f64>,
    /// By joint: whether an encoder changes its positions.
    encoders: Vec<bool>,
    /// By joint: index of the next observation.
    next: Vec<usize>,
    /// Time of the final state, s.
    last: Option<f64>,
    /// Time of the next observation of any joint, s; infinite at the end.
    due: f64,
    motion: JointMotion,
}

impl<'a> Observer<'a> {
    fn new(rollout: &'a JointRollout<'a>, joints: usize) -> Observer<'a> {
        let empty = || vec![vec![f64::NAN; rollout.times.len()]; joints];
        let mut out = Observer {
            rollout,
            first_time: rollout.first_time(),
            lags: (0..joints).map(|j| rollout.delays(j)[1]).collect(),
            encoders: (0..joints).map(|j| rollout.has_encoder_effect(j)).collect(),
            next: vec![0; joints],
            last: rollout.times.last().map(|last| rollout.first_time() + last - rollout.start),
            due: 0.0,
            motion: JointMotion {
                positions: empty(),
                velocities: empty(),
                end: (rollout.position.clone(), rollout.velocity.clone()),
            },
        };
        out.due = out.earliest();
        out
    }

    /// Time of the next observation of any joint, s.
    fn earliest(&self) -> f64 {
        let of = |(next, lag): (&usize, &f64)| self.rollout.times.get(*next).map(|time| time - lag);
        self.next.iter().zip(&self.lags).filter_map(of).fold(f64::INFINITY, f64::min)
    }

    /// Records the observations up to the end of a step.
    fn observe(&mut self, lane: usize, step: u32, batch: &Batch, before: &(Vec<V>, Vec<V>)) {
        let h = batch.time_step;
        let from = self.first_time + f64::from(step - 1) * h;
        // A thousandth of a step: times are rounded.
        let end = from + 1.001 * h;
        if self.due > end {
            return;
        }
        let at = |j: usize, time: f64| {
            let ends = [before.0[j], before.1[j], batch.position[j], batch.velocity[j]];
            let [p0, v0, p1, v1] = ends.map(|v| v[lane]);
            hermite([p0, v0 * h, p1, v1 * h], (time - from) / h, h)
        };
        if let Some(last) = self.last.filter(|last| *last <= end) {
            self.last = None;
            let states = (0..self.next.len()).map(|j| at(j, last));
            self.motion.end = states.unzip();
        }
        for j in 0..self.next.len() {
            let lag = self.lags[j];
            while let Some(time) = self.rollout.times.get(self.next[j]).filter(|time| **time - lag <= end) {
                let (position, velocity) = at(j, time - lag);
                let k = self.next[j];
                self.motion.positions[j][k] = match self.encoders[j] {
                    true => self.rollout.measured(j, time - lag, [position, velocity]),
                    false => position,
                };
                self.motion.velocities[j][k] = velocity;
                self.next[j] += 1;
            }
        }
        self.due = self.earliest();
    }
}

/// Value and derivative of the cubic polynomial with these values and slopes (over a step of length `h`) at both ends.
fn hermite([p0, m0, p1, m1]: [f64; 4], s: f64, h: f64) -> (f64, f64) {
    let (a, b) = (2.0 * (p0 - p1) + m0 + m1, 3.0 * (p1 - p0) - 2.0 * m0 - m1);
    (p0 + s * (m0 + s * (b + s * a)), (m0 + s * (2.0 * b + s * 3.0 * a)) / h)
}
