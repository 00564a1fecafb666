//! Data that are fixed during a diagnosis.

use crate::error::Result;
use crate::inference::segment::Segment;
use crate::progress::{NoProgress, Progress};
use crate::world::Engine;

/// Segments and their noise.
pub struct SegmentData<'a> {
    pub segments: &'a [Segment],
    pub trial_count: usize,
    /// Setting of each trial.
    pub settings: &'a [usize],
    /// Standard deviation of the residuals by segment, m; infinite for unused segments.
    pub sd: Vec<f64>,
    /// Cached Jacobians by segment; empty for segments without nuisances.
    pub cached_jacobians: Vec<CachedJacobian>,
    pub engine: Engine,
    /// Ends computations on the data once they are cancelled.
    pub progress: &'a dyn Progress,
}

impl<'a> SegmentData<'a> {
    /// Segments of as many trials as there are settings, without cached Jacobians.
    pub fn new(
        segments: &'a [Segment],
        settings: &'a [usize],
        sd: Vec<f64>,
        engine: Engine,
    ) -> SegmentData<'a> {
        let (cached_jacobians, progress) = (Vec::new(), &NoProgress);
        SegmentData {
            segments,
            trial_count: settings.len(),
            settings,
            sd,
            cached_jacobians,
            engine,
            progress,
        }
    }

    /// The same data; computations on them end once `progress` is cancelled.
    pub fn until_stopped(self, progress: &'a dyn Progress) -> SegmentData<'a> {
        SegmentData { progress, ..self }
    }

    /// Applies `of` to every segment; ends if the computation is cancelled.
    pub fn each_segment<T>(&self, mut of: impl FnMut(usize, &'a Segment) -> T) -> Result<Vec<T>> {
        let one = |(w, segment)| self.progress.check_stop().map(|()| of(w, segment));
        self.segments.iter().enumerate().map(one).collect()
    }

    /// Number of settings.
    pub fn setting_count(&self) -> usize {
        self.settings.iter().max().map_or(1, |s| s + 1)
    }

    /// Cached Jacobian of a segment, if there is one.
    pub fn cached_jacobian(&self, segment: usize) -> Option<&CachedJacobian> {
        self.cached_jacobians.get(segment).filter(|f| !f.nuisances.is_empty())
    }
}

/// Derivatives of predictions that depend little on the candidate effects.
#[derive(Clone, Default)]
pub struct CachedJacobian {
    pub nuisances: Vec<Vec<f64>>,
    /// By the latents, which are the first parameters.
    pub latents: Vec<Vec<f64>>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::model::{FitState, ParameterLayout, cache_jacobians};
    use crate::inference::testing::segments::{multi_step_segments, one_step_segments, term};

    /// Multi-step segments have a cached Jacobian; one-step segments have no nuisances to cache.
    #[test]
    fn jacobians_are_cached_for_segments_with_nuisances() {
        for ((segments, settings), used) in [(multi_step_segments(), true), (one_step_segments(0.0), false)] {
            let mut data = SegmentData::new(&segments, &settings, vec![1e-3; segments.len()], Engine::Lanes);
            assert!(data.cached_jacobian(0).is_none(), "nothing yet");
            let nuisances = segments.iter().map(|w| w.nuisances.clone()).collect();
            let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
            cache_jacobians(&mut data, &layout, &FitState::new(vec![0.0; 2], nuisances)).unwrap();
            assert_eq!(data.cached_jacobian(0).is_some(), used);
        }
    }
}
