//! Estimates of the peak memory of computations on trials, so that a server can refuse what is too large before it starts.
//!
//! The memory of a fit grows with the number of segments and with their observations, of which long segments keep
//! [`MAX_OBSERVATIONS`] averages: Jacobians by every parameter, perturbation and basis function, for every candidate set. The figures
//! were measured on throws of 1 to 3 balls, 20 to 200 trials of 25 to 2000 frames; estimates are 1.0 to 2.5 times the measured peaks.

use crate::error::Result;
use crate::inference::data::preprocessing::{MAX_INITIAL_INTERVALS, index_settings};
use crate::inference::posterior::MAX_HORIZON;
use crate::inference::segment::{MAX_OBSERVATIONS, Segment, Segmentation, segment_trials};
use crate::progress::Progress;
use crate::reality::Trial;
use crate::task::Scene;

/// Memory of an observation of a body before averaging: tracks, segments, and smoothing polynomials.
const BYTES_PER_ROW: u64 = 600;
/// Memory of a segment, and of each of its averaged observations, in a diagnosis: the fits of all candidate sets.
const DIAGNOSIS_BYTES: [u64; 2] = [850_000, 3_000];
/// The same in a posterior or a likelihood: the columns of all discrepancy fields under each draw of the variance components.
const POSTERIOR_BYTES: [u64; 2] = [900_000, 25_000];
/// The part of a segment that each thread needs for itself.
const BYTES_PER_THREAD: u64 = 60_000;
/// Number of threads in the measurements.
const MEASURED_THREADS: u64 = 2;

/// Size of the data, from which estimates follow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DataSize {
    /// Number of observations of a body at a time.
    pub rows: u64,
    pub segments: u64,
    /// Number of observations of all segments once long ones are averaged.
    pub observations: u64,
}

/// Peak memory of a diagnosis, bytes.
pub fn diagnosis(scene: &Scene, trials: &[Trial], progress: &dyn Progress) -> Result<u64> {
    Ok(size(scene, trials, MAX_INITIAL_INTERVALS, progress)?.bytes(DIAGNOSIS_BYTES))
}

/// Peak memory of a posterior or a likelihood, bytes.
pub fn posterior(scene: &Scene, trials: &[Trial], progress: &dyn Progress) -> Result<u64> {
    Ok(size(scene, trials, MAX_HORIZON, progress)?.bytes(POSTERIOR_BYTES))
}

fn size(scene: &Scene, trials: &[Trial], longest: usize, progress: &dyn Progress) -> Result<DataSize> {
    let (_, settings) = index_settings(trials);
    let Segmentation { segments, .. } = segment_trials(scene, trials, &settings, longest, progress)?;
    let tracks = trials.iter().flat_map(|t| &t.observed.bodies);
    Ok(DataSize {
        rows: tracks.map(|track| track.len() as u64).sum(),
        segments: segments.len() as u64,
        observations: segments.iter().map(averaged_observations).sum(),
    })
}

fn averaged_observations(segment: &Segment) -> u64 {
    segment.observations.len().min(MAX_OBSERVATIONS) as u64
}

impl DataSize {
    fn bytes(&self, [segment, observation]: [u64; 2]) -> u64 {
        let more_threads = (rayon::current_num_threads() as u64).saturating_sub(MEASURED_THREADS);
        self.rows * BYTES_PER_ROW
            + self.segments * (segment + more_threads * BYTES_PER_THREAD)
            + self.observations * observation
    }
}
