//! Basis functions of a discrepancy field: radial functions of position, of velocity and of time that
//! accelerate along x and y, and radial functions of position that accelerate along and across the velocity.
//!
//! They are also effects of the registry, so that a fitted field can be simulated; see `residual_law`.

use std::ops::Range;

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use crate::inference::segment::{Segment, SegmentKind};
use crate::world::effect::{Effect, clock_push, gaussian, place_drive, place_push, velocity_push};

/// Grid sizes over x and y, over vx and vy, and over time.
const POSITION_GRID: [usize; 2] = [8, 5];
const VELOCITY_GRID: [usize; 2] = [4, 3];
const TIME_GRID: usize = 16;
/// Number of radial basis functions, each with two amplitudes.
pub const BASIS_FUNCTION_COUNT: usize =
    2 * POSITION_GRID[0] * POSITION_GRID[1] + VELOCITY_GRID[0] * VELOCITY_GRID[1] + TIME_GRID;

/// Inputs of a discrepancy field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FieldInputs {
    /// All inputs.
    All,
    Place,
    Velocity,
    Clock,
    /// Position and direction of motion.
    Heading,
    /// Monomials of position, velocity and speed, without radial basis functions; see `formula`.
    Powers,
}

/// Inputs of radial fields, in the order in which they are tried.
pub const RADIAL_INPUTS: [FieldInputs; 5] =
    [FieldInputs::All, FieldInputs::Place, FieldInputs::Velocity, FieldInputs::Clock, FieldInputs::Heading];

/// Radial basis functions of position, velocity and time; those of position also act along and across the
/// velocity.
pub struct FieldBasis {
    position: Vec<RadialBasisFunction>,
    velocity: Vec<RadialBasisFunction>,
    time: Vec<RadialBasisFunction>,
}

/// A Gaussian radial basis function; the second axis is unused for time.
pub struct RadialBasisFunction {
    centre: [f64; 2],
    width: [f64; 2],
}

impl RadialBasisFunction {
    /// Value at a point, 1 at the centre.
    pub fn at(&self, at: [f64; 2]) -> f64 {
        gaussian([0, 1].map(|a| (at[a] - self.centre[a]) / self.width[a]))
    }
}

impl FieldBasis {
    /// Grids over the positions, velocities and times of flights; without flights, of all segments.
    pub fn over(segments: &[Segment], paths: &[Vec<[f64; 4]>]) -> FieldBasis {
        let flew = segments.iter().any(|w| w.kind == SegmentKind::Flight);
        let flights = || (0..segments.len()).filter(|w| !flew || segments[*w].kind == SegmentKind::Flight);
        let all = |k: usize| -> Vec<f64> {
            flights().flat_map(|w| paths[w].iter().map(move |s| s[k])).filter(|v| v.is_finite()).collect()
        };
        let clock =
            flights().flat_map(|w| segments[w].observations.iter().map(move |p| segments[w].start + p.time));
        FieldBasis {
            position: radial_grid([robust_range(all(0)), robust_range(all(1))], POSITION_GRID),
            velocity: radial_grid([robust_range(all(2)), robust_range(all(3))], VELOCITY_GRID),
            time: radial_grid([robust_range(clock.collect()), [0.0; 2]], [TIME_GRID, 1]),
        }
    }

    /// Indices of the functions with some inputs.
    pub fn indices(&self, over: FieldInputs) -> Range<usize> {
        let [place, speed, clock] =
            [&self.position, &self.velocity, &self.time].map(|gaussian_lanes| 2 * gaussian_lanes.len());
        match over {
            FieldInputs::All => 0..self.count(),
            FieldInputs::Place => 0..place,
            FieldInputs::Velocity => place..place + speed,
            FieldInputs::Clock => place + speed..place + speed + clock,
            FieldInputs::Heading => place + speed + clock..self.count(),
            FieldInputs::Powers => 0..0,
        }
    }

    /// Number of functions.
    pub fn count(&self) -> usize {
        2 * (2 * self.position.len() + self.velocity.len() + self.time.len())
    }

    /// Accelerations at a state: along x and y for each function; the last along and across the velocity.
    pub fn accelerations(&self, time: f64, [x, y, vx, vy]: [f64; 4]) -> Vec<[f64; 2]> {
        let of = |gaussian_lanes: &[RadialBasisFunction], at: [f64; 2]| -> Vec<f64> {
            gaussian_lanes.iter().map(|b| b.at(at)).collect()
        };
        let (places, speeds) = (of(&self.position, [x, y]), of(&self.velocity, [vx, vy]));
        let times = of(&self.time, [time, 0.0]);
        let speed = (vx * vx + vy * vy).sqrt().max(1e-9);
        let along =
            places.iter().flat_map(|f| [[f * vx / speed, f * vy / speed], [-f * vy / speed, f * vx / speed]]);
        places.iter().chain(&speeds).chain(&times).flat_map(|f| [[*f, 0.0], [0.0, *f]]).chain(along).collect()
    }

    /// The functions as effects, two functions each: their first two parameters are the amplitudes.
    pub fn effects(&self) -> Vec<(&'static Effect, Vec<f64>)> {
        let plane = |effect: &'static Effect| {
            move |b: &RadialBasisFunction| (effect, [[0.0; 2], b.centre, b.width].concat())
        };
        let clock = |b: &RadialBasisFunction| (&clock_push::EFFECT, vec![0.0, 0.0, b.centre[0], b.width[0]]);
        let places = self.position.iter().map(plane(&place_push::EFFECT));
        let speeds = self.velocity.iter().map(plane(&velocity_push::EFFECT));
        let drives = self.position.iter().map(plane(&place_drive::EFFECT));
        places.chain(speeds).chain(self.time.iter().map(clock)).chain(drives).collect()
    }

    /// Position responses: the functions integrated twice along a segment's trajectory, two rows per
    /// observation.
    pub fn responses(&self, segment: &Segment, path: &[[f64; 4]]) -> DMatrix<f64> {
        let n = segment.observations.len();
        let mut out = DMatrix::zeros(2 * n, self.count());
        let mut before: Option<(f64, Vec<[f64; 2]>)> = None;
        let mut moved = vec![[[0.0f64; 2]; 2]; self.count()];
        for (i, (point, state)) in segment.observations.iter().zip(path).enumerate() {
            let now = self.accelerations(segment.start + point.time, *state);
            if let Some((time, last)) = before {
                let dt = point.time - time;
                for (k, [place, speed]) in moved.iter_mut().enumerate() {
                    for axis in 0..2 {
                        let a = 0.5 * (last[k][axis] + now[k][axis]);
                        place[axis] += speed[axis] * dt + 0.5 * a * dt * dt;
                        speed[axis] += a * dt;
                        out[(2 * i + axis, k)] = place[axis];
                    }
                }
            }
            before = Some((point.time, now));
        }
        out
    }
}

/// The 2 % and 98 % quantiles; zeros if there are no values.
pub fn robust_range(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    let at =
        |share: f64| values.get((share * (values.len().max(1) - 1) as f64) as usize).copied().unwrap_or(0.0);
    [at(0.02), at(0.98)]
}

/// Radial functions on a regular grid between the ends; their width is the grid spacing.
pub fn radial_grid(ends: [[f64; 2]; 2], counts: [usize; 2]) -> Vec<RadialBasisFunction> {
    let width = [0, 1].map(|a| (ends[a][1] - ends[a][0]) / (counts[a].max(2) - 1) as f64 + 1e-3);
    let at = |i: usize, j: usize| [ends[0][0] + width[0] * i as f64, ends[1][0] + width[1] * j as f64];
    let places = (0..counts[0]).flat_map(|i| (0..counts[1]).map(move |j| (i, j)));
    places.map(|(i, j)| RadialBasisFunction { centre: at(i, j), width }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::world::effect::{EffectKind, MotionState, SimulationContext};

    #[test]
    fn radial_functions_form_a_grid() {
        let grid = radial_grid([[0.0, 2.0], [1.0, 3.0]], [3, 2]);
        assert_eq!(grid.len(), 6);
        let at: Vec<f64> = grid.iter().map(|b| b.at([1.0, 3.0])).collect();
        let most = at.iter().copied().fold(0.0, f64::max);
        assert_eq!(at.iter().position(|v| *v == most), Some(3));
    }

    fn functions() -> FieldBasis {
        FieldBasis {
            position: radial_grid([[-1.0, 2.0], [0.0, 3.0]], POSITION_GRID),
            velocity: radial_grid([[-4.0, 5.0], [-3.0, 2.0]], VELOCITY_GRID),
            time: radial_grid([[0.2, 1.4], [0.0; 2]], [TIME_GRID, 1]),
        }
    }

    /// Every function belongs to all inputs and to one kind.
    #[test]
    fn every_function_has_one_kind_of_input() {
        let functions = functions();
        let names = ["place_push", "velocity_push", "clock_push", "place_drive"];
        let mut next = 0;
        for (over, name) in RADIAL_INPUTS[1..].iter().zip(names) {
            let range = functions.indices(*over);
            assert_eq!(range.start, next, "{over:?}");
            next = range.end;
            assert!(functions.effects()[range.start / 2..range.end / 2].iter().all(|e| e.0.name == name));
        }
        assert_eq!((functions.indices(FieldInputs::All), next), (0..functions.count(), functions.count()));
        assert_eq!(functions.count(), 2 * BASIS_FUNCTION_COUNT);
    }

    /// The fitted functions equal the simulated effects.
    #[test]
    fn basis_functions_equal_effects() {
        let (functions, dt) = (functions(), 1e-6);
        let effects = functions.effects();
        assert_eq!(2 * effects.len(), functions.count());
        let around = SimulationContext { time_step: dt, gravity: [0.0, -9.81] };
        for (time, [x, y, vx, vy]) in [(0.3, [0.1, 1.2, 2.0, -1.0]), (1.1, [1.7, 2.9, -3.0, 0.5])] {
            for (k, expected) in functions.accelerations(time, [x, y, vx, vy]).into_iter().enumerate() {
                let (effect, mut values) = effects[k / 2].clone();
                values[k % 2] = 1.0;
                let EffectKind::Motion(law) = effect.kind else {
                    panic!("{} is no law of motion", effect.name)
                };
                let body = MotionState { time, x, y, vx, vy, omega: 0.0 };
                let kicked = law.kick(&law.constants(&values, &around), body, dt);
                let got = [(kicked[0] - vx) / dt, (kicked[1] - vy) / dt];
                let off = (0..2).map(|a| (got[a] - expected[a]).abs()).fold(0.0, f64::max);
                assert!(off < 1e-5, "{} {k}: {got:?} for {expected:?}", effect.name);
            }
        }
    }
}
