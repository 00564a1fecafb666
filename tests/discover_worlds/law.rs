//! Paths of one ball under a law that may differ between trials: in flight, bouncing on a floor or rolling
//! along it; and the part of a path change that initial states cannot explain.
//!
//! Fourth-order Runge-Kutta at 1/2000 s; a bounce ends a step at the time of contact. A ball that stops
//! bouncing slides and rolls.

use super::Force;
use super::shared::through_lens;

/// Radius of the ball, m.
pub const RADIUS: f64 = 0.05;
const GRAVITY: f64 = 9.81;
/// Longest step, s.
const STEP: f64 = 5e-4;
/// Approach speed below which a ball rests on the floor, m/s: what it gains within two steps.
const REST: f64 = 2.0 * GRAVITY * STEP;

/// x, y (m), vx, vy (m/s), spin (rad/s), angle (rad).
pub type State = [f64; 6];

/// How a ball moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    Flies,
    Bounces,
    Rolls,
}

/// Dynamics and observation of one trial.
#[derive(Clone)]
pub struct Law {
    /// Sizes and forces; only components along the floor act on a rolling ball.
    pub pushes: Vec<(f64, Force)>,
    /// Lift in the first flight and after each bounce, 1/s; the last value persists.
    pub lifts: Vec<f64>,
    /// Clock rate, length scale and camera tilt (rad).
    pub clock: f64,
    pub scale: f64,
    pub turn: f64,
    /// Radial distortion of the lens, 1/m^2, and by how much the floor is higher than thought, m.
    pub lens: f64,
    pub height: f64,
    /// The floor's restitution at zero speed and its decrease with impact speed, s/m.
    pub restitution: f64,
    pub slope: f64,
    pub friction: f64,
    /// Tangential restitution.
    pub tangential: f64,
    /// Rolling resistance over the load.
    pub rolling: f64,
}

impl Law {
    /// Gravity and a floor with the given restitution and friction.
    pub fn plain(restitution: f64, friction: f64) -> Law {
        Law {
            pushes: Vec::new(),
            lifts: vec![0.0],
            clock: 1.0,
            scale: 1.0,
            turn: 0.0,
            lens: 0.0,
            height: 0.0,
            restitution,
            slope: 0.0,
            friction,
            tangential: 0.0,
            rolling: 0.0,
        }
    }

    /// x, y (m) and angle (rad) without error at increasing times, s.
    pub fn seen(&self, motion: Motion, start: State, times: &[f64]) -> Vec<[f64; 3]> {
        let (mut state, mut now, mut bounces) = (start, 0.0, 0);
        let (cos, sin) = (self.turn.cos(), self.turn.sin());
        let mut see = |time: &f64| {
            let until = time / self.clock;
            let steps = ((until - now) / STEP).ceil().max(1.0);
            let (from, h) = (now, (until - now) / steps);
            for k in 0..steps as usize {
                state = self.advance(motion, from + h * k as f64, state, h, &mut bounces);
            }
            now = until;
            let [x, y] = [self.scale * state[0], self.scale * (state[1] + self.height)];
            let [x, y] = through_lens(self.lens, [x * cos - y * sin, y * cos + x * sin]);
            [x, y, state[5] + self.turn]
        };
        times.iter().map(&mut see).collect()
    }

    /// One step of `h` s, with a bounce if one occurs.
    fn advance(&self, motion: Motion, t: f64, s: State, h: f64, bounces: &mut usize) -> State {
        let to = self.step(motion, t, s, h, *bounces);
        match motion {
            Motion::Flies => to,
            // A rolling ball comes to rest and does not reverse.
            Motion::Rolls if to[2] * s[2] <= 0.0 => [to[0], s[1], 0.0, 0.0, 0.0, to[5]],
            Motion::Rolls => to,
            Motion::Bounces if to[1] >= RADIUS || to[3] >= 0.0 => to,
            Motion::Bounces if -to[3] < REST => self.rebound([to[0], RADIUS, to[2], to[3], to[4], to[5]]),
            Motion::Bounces => {
                let near = (h * (s[1] - RADIUS) / (s[1] - to[1])).clamp(0.0, h);
                let met = self.step(motion, t, s, near, *bounces);
                let part = (near - (met[1] - RADIUS) / met[3]).clamp(0.0, h);
                let met = self.step(motion, t, s, part, *bounces);
                *bounces += 1;
                self.step(motion, t + part, self.rebound(met), h - part, *bounces)
            }
        }
    }

    fn step(&self, motion: Motion, t: f64, s: State, h: f64, bounces: usize) -> State {
        let lift = self.lifts[bounces.min(self.lifts.len() - 1)];
        let slope = |t: f64, s: State| {
            let mut a = [0.0, 0.0];
            for (size, push) in &self.pushes {
                let own = push(t, [s[0], s[1], s[2], s[3]]);
                a = [a[0] + size * own[0], a[1] + size * own[1]];
            }
            if motion == Motion::Rolls {
                let a = if s[2] == 0.0 { 0.0 } else { a[0] - self.rolling * GRAVITY * s[2].signum() };
                return [s[2], 0.0, a, 0.0, -a / RADIUS, s[4]];
            }
            [s[2], s[3], a[0] - lift * s[3], a[1] + lift * s[2] - GRAVITY, 0.0, s[4]]
        };
        let add = |k: State, h: f64| -> State { std::array::from_fn(|i| s[i] + h * k[i]) };
        let k1 = slope(t, s);
        let k2 = slope(t + h / 2.0, add(k1, h / 2.0));
        let k3 = slope(t + h / 2.0, add(k2, h / 2.0));
        let k4 = slope(t + h, add(k3, h));
        std::array::from_fn(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
    }

    /// State after an impact of a full disc: a third of the mass resists slip.
    fn rebound(&self, mut s: State) -> State {
        let (restitution, tangential) = match -s[3] < REST {
            true => (0.0, 0.0),
            false => ((self.restitution + self.slope * s[3]).clamp(0.0, 1.0), self.tangential),
        };
        let push = -(1.0 + restitution) * s[3];
        let slip = s[2] + RADIUS * s[4];
        let grip = ((1.0 + tangential) * slip / 3.0).clamp(-self.friction * push, self.friction * push);
        s[3] += push;
        s[2] -= grip;
        s[4] -= 2.0 * grip / RADIUS;
        s
    }
}

/// Root-mean-square path difference between two laws, m, that neither the trials' initial states nor a common
/// restitution and friction of the floor can explain (to first order).
pub fn distinguishable_shift(
    motion: Motion,
    starts: &[State],
    times: &[Vec<f64>],
    plain: &Law,
    other: &Law,
) -> f64 {
    const SMALL: f64 = 1e-5;
    let (mut changes, mut shared) = (Vec::new(), [Vec::new(), Vec::new()]);
    for (start, times) in starts.iter().zip(times) {
        let flat = |law: &Law, start: State| -> Vec<f64> {
            law.seen(motion, start, times).iter().flat_map(|p| [p[0], p[1]]).collect()
        };
        let path = flat(plain, *start);
        let from = |seen: Vec<f64>| -> Vec<f64> { seen.iter().zip(&path).map(|(a, b)| a - b).collect() };
        let perturbed = |i: usize| {
            let mut start = *start;
            start[i] += SMALL;
            from(flat(plain, start))
        };
        let own = basis((0..5).map(perturbed).collect());
        let floors = [
            Law { restitution: plain.restitution + SMALL, ..plain.clone() },
            Law { friction: plain.friction + SMALL, ..plain.clone() },
        ];
        for (all, floor) in shared.iter_mut().zip(&floors) {
            let mut change = from(flat(floor, *start));
            leave(&mut change, &own);
            all.extend(change);
        }
        let mut change = from(flat(other, *start));
        leave(&mut change, &own);
        changes.extend(change);
    }
    leave(&mut changes, &basis(shared.to_vec()));
    (dot(&changes, &changes) / changes.len() as f64).sqrt()
}

/// Orthonormal basis of the columns; negligible columns are dropped.
fn basis(columns: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let mut out: Vec<Vec<f64>> = Vec::new();
    for mut column in columns {
        let whole = dot(&column, &column).sqrt();
        leave(&mut column, &out);
        let left = dot(&column, &column).sqrt();
        if left > 1e-6 * whole && left > 1e-12 {
            column.iter_mut().for_each(|v| *v /= left);
            out.push(column);
        }
    }
    out
}

/// Projects a vector onto the complement of an orthonormal basis.
fn leave(vector: &mut [f64], basis: &[Vec<f64>]) {
    for b in basis {
        let along = dot(vector, b);
        vector.iter_mut().zip(b).for_each(|(v, b)| *v -= along * b);
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
