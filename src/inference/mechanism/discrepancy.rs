//! Shared discrepancy of a mechanism: a small torque field over each joint's position, velocity and motor torque, and a small
//! smooth error of each encoder, the same in all trials.
//!
//! The largest plausible torque is sqrt((1 % of the typical torque)^2 + (6 % of the torque that the simulation lacks)^2), the
//! shares of the shared discrepancy of bodies; the largest encoder error is 0.1 % of the range.

use std::f64::consts::PI;

use nalgebra::DMatrix;

use super::linearization::Terms;
use super::recording::{JointRecording, motor_torque};
use crate::inference::selection::SETTINGS;
use crate::task::joint::JointKind;
use crate::world::mechanism::{FieldShape, TorqueField, TorqueFunction};

/// Numbers of radial basis functions over position and velocity.
const BUMPS: [usize; 2] = [5, 4];
/// Number over the position of a revolute joint, around the circle.
const PERIODIC_BUMPS: usize = 6;
/// Encoder errors: smooth functions of the position.
const ENCODER_MODES: usize = 2;
/// Largest plausible encoder error as a share of the range of positions.
const ENCODER_OF_RANGE: f64 = 0.001;

/// Least squared response to a combination of functions, in units of the noise, for it to matter.
const LEAST_SQUARE: f64 = 0.1;

/// Responses of all segments to the shared discrepancy.
pub struct JointDiscrepancy {
    /// By segment, in white coordinates: response to each combination of functions at its largest plausible size.
    pub responses: Vec<DMatrix<f64>>,
    /// By segment, in white coordinates: response to a constant torque in each joint of 1 % of the typical one.
    pub constant: Vec<DMatrix<f64>>,
    /// Ratio of a broad field, as large as the missing torque, to the largest plausible one.
    pub broad_ratio: f64,
}

/// The discrepancy along the paths of a model; `None` if it cannot be simulated.
pub fn discrepancy(
    recording: &JointRecording,
    terms: &Terms,
    states: &[Vec<f64>],
) -> Option<JointDiscrepancy> {
    let joints = recording.noise.len();
    let field = field(recording);
    let norms = norms(recording, &field);
    let base = |j: usize| SETTINGS.discrepancy_of_gravity * recording.scales[j].torque;
    let cap =
        |j: usize| base(j).hypot(SETTINGS.discrepancy_of_acceleration * recording.scales[j].missing_torque);
    let sizes: Vec<f64> = field.functions.iter().map(|f| cap(f.joint) / norms[f.joint]).collect();
    let mut responses = recording.field_responses(terms, states, &field, &sizes)?;
    let constants: Vec<usize> = (0..joints)
        .filter_map(|j| field.functions.iter().position(|f| f.joint == j && f.shape == FieldShape::Constant))
        .collect();
    let constant = responses.iter().map(|all| {
        DMatrix::from_fn(all.nrows(), joints, |i, j| all[(i, constants[j])] / sizes[constants[j]] * base(j))
    });
    let constant: Vec<DMatrix<f64>> = constant.collect();
    for (segment, all) in recording.segments.iter().zip(&mut responses) {
        let (count, before) = (segment.states.len(), all.ncols());
        let mut wide = std::mem::replace(all, DMatrix::zeros(0, 0))
            .resize_horizontally(before + ENCODER_MODES * joints, 0.0);
        for (j, scales) in recording.scales.iter().enumerate() {
            let size = ENCODER_OF_RANGE * scales.range;
            for (i, state) in segment.states.iter().enumerate() {
                let modes = match recording.tree.kinds[j] {
                    JointKind::Revolute => <[f64; 2]>::from(libm::sincos(state[j][0])),
                    JointKind::Prismatic => {
                        let x = (state[j][0] - field.centre[j][0]) / scales.range;
                        [x * x, x * x * x]
                    }
                };
                for (m, mode) in modes.into_iter().enumerate() {
                    wide[(j * count + i, before + ENCODER_MODES * j + m)] = size * mode;
                }
            }
        }
        *all = wide;
    }
    let ratio = |j: usize| recording.scales[j].missing_torque / cap(j);
    let broad_ratio = (0..joints).map(ratio).fold(3.0, f64::max);
    let white = |all: &[DMatrix<f64>]| -> Vec<DMatrix<f64>> {
        recording.segments.iter().zip(all).map(|(segment, own)| recording.white(segment, own)).collect()
    };
    let responses = distinguishable(&white(&responses), broad_ratio);
    Some(JointDiscrepancy { responses, constant: white(&constant), broad_ratio })
}

/// Responses to the combinations of functions, of unit norm, that the recording could show: whose squared response to the largest
/// plausible broad field is above [`LEAST_SQUARE`]. Rotations of coefficients keep their prior.
fn distinguishable(responses: &[DMatrix<f64>], broad_ratio: f64) -> Vec<DMatrix<f64>> {
    let count = responses[0].ncols();
    let gram = responses.iter().fold(DMatrix::zeros(count, count), |sum, own| sum + own.tr_mul(own));
    let eigen = gram.symmetric_eigen();
    let kept: Vec<usize> =
        (0..count).filter(|k| eigen.eigenvalues[*k] * broad_ratio * broad_ratio > LEAST_SQUARE).collect();
    let rotation = eigen.eigenvectors.select_columns(&kept);
    responses.iter().map(|own| own * &rotation).collect()
}

/// The functions over the range of the data.
fn field(recording: &JointRecording) -> TorqueField {
    let joints = recording.noise.len();
    let mut out = TorqueField::default();
    for j in 0..joints {
        let states = arguments(recording, j);
        let range = |k: usize| {
            let values = || states.iter().map(|s| s[k]);
            [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)]
        };
        let ranges = [0, 1, 2].map(range);
        let is_periodic = recording.tree.kinds[j] == JointKind::Revolute;
        let (mut centre, mut half) = (
            ranges.map(|[low, high]| 0.5 * (low + high)),
            ranges.map(|[low, high]| (0.5 * (high - low)).max(1e-9)),
        );
        if is_periodic {
            (centre[0], half[0]) = (0.0, PI);
        }
        out.is_periodic.push(is_periodic);
        out.centre.push(centre);
        out.half_extent.push(half);
        let harmonics = (0..2).filter(|_| is_periodic).map(FieldShape::Harmonic);
        let driven = recording.tree.motors[j].is_some();
        let linear = (0..3).filter(|k| [!is_periodic, true, driven][*k]).map(FieldShape::Linear);
        let (positions, velocities) = (if is_periodic { PERIODIC_BUMPS } else { BUMPS[0] }, BUMPS[1]);
        let bump = |k: usize| {
            let place = |k: usize, count: usize| 2.0 * k as f64 / (count - 1) as f64 - 1.0;
            let width = |count: usize| (2.0 / (count - 1) as f64).powi(-2);
            let (p, v) = (k % positions, k / positions);
            // The ends of a period are one place.
            let count = if is_periodic { positions + 1 } else { positions };
            FieldShape::Bump {
                centre: [place(p, count), place(v, velocities)],
                inverse_square_width: [width(count), width(velocities)],
            }
        };
        let bumps = (0..positions * velocities).map(bump);
        let shapes = [FieldShape::Constant].into_iter().chain(harmonics).chain(linear).chain(bumps);
        out.functions.extend(shapes.map(|shape| TorqueFunction { joint: j, shape }));
    }
    out
}

/// Position, velocity and motor torque of a joint at all observations.
fn arguments(recording: &JointRecording, joint: usize) -> Vec<[f64; 3]> {
    let of = |segment: &super::recording::JointSegment| {
        let trial = &recording.trials[segment.trial];
        let times = &trial.times[segment.range.clone()];
        let state = |(time, states): (&f64, &Vec<[f64; 3]>)| {
            let own = &states[joint];
            [own[0], own[1], motor_torque(recording.tree, trial, joint, *time, own)]
        };
        times.iter().zip(&segment.states).map(state).collect::<Vec<[f64; 3]>>()
    };
    recording.segments.iter().flat_map(of).collect()
}

/// By joint: root of the mean, over observed states, of the sum of all squared functions.
fn norms(recording: &JointRecording, field: &TorqueField) -> Vec<f64> {
    let of = |j: usize| {
        let own: Vec<usize> = (0..field.functions.len()).filter(|k| field.functions[*k].joint == j).collect();
        let states = arguments(recording, j);
        let square =
            states.iter().map(|s| own.iter().map(|k| field.at(*k, *s).powi(2)).sum::<f64>()).sum::<f64>();
        (square / states.len().max(1) as f64).sqrt().max(1e-12)
    };
    (0..recording.noise.len()).map(of).collect()
}
