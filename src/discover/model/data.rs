//! What is fixed during a diagnosis.

use crate::discover::window::Segment;
use crate::world::Engine;

/// Windows and their noise.
pub struct SegmentData<'a> {
    pub segments: &'a [Segment],
    pub trial_count: usize,
    /// Setting of each trial.
    pub settings: &'a [usize],
    /// Scale of the residuals by window, m.
    pub sd: Vec<f64>,
    /// Derivatives of shots by their nuisances and by the latents, found once: by window; empty for others.
    pub cached_jacobians: Vec<CachedJacobian>,
    pub engine: Engine,
}

impl<'a> SegmentData<'a> {
    /// Windows of as many trials as there are settings; nothing is frozen yet.
    pub fn new(
        segments: &'a [Segment],
        settings: &'a [usize],
        sd: Vec<f64>,
        engine: Engine,
    ) -> SegmentData<'a> {
        SegmentData {
            segments,
            trial_count: settings.len(),
            settings,
            sd,
            cached_jacobians: Vec::new(),
            engine,
        }
    }

    /// How many settings there are.
    pub fn setting_count(&self) -> usize {
        self.settings.iter().max().map_or(1, |s| s + 1)
    }

    /// What is kept of a window's derivatives, if anything is.
    pub fn cached_jacobian(&self, window: usize) -> Option<&CachedJacobian> {
        self.cached_jacobians.get(window).filter(|f| !f.nuisances.is_empty())
    }
}

/// Derivatives that change little with what a search tries.
#[derive(Clone, Default)]
pub struct CachedJacobian {
    pub nuisances: Vec<Vec<f64>>,
    /// Of the first slots, which are the latents.
    pub latents: Vec<Vec<f64>>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{multi_step_segments, one_step_segments, term};
    use crate::discover::model::{FitState, ParameterLayout, cache_jacobians};

    /// Of a shot it is kept how its start moves it; a leap has no start to move, and is simulated with every model.
    #[test]
    fn what_is_kept_is_of_windows_with_nuisances() {
        for ((windows, settings), kept) in [(multi_step_segments(), true), (one_step_segments(0.0), false)] {
            let mut data = SegmentData::new(&windows, &settings, vec![1e-3; windows.len()], Engine::Lanes);
            assert!(data.cached_jacobian(0).is_none(), "nothing yet");
            let nuisances = windows.iter().map(|w| w.nuisances.clone()).collect();
            let layout = ParameterLayout::new(&[], vec![term("wind")], 1);
            cache_jacobians(&mut data, &layout, &FitState::new(vec![0.0; 2], nuisances)).unwrap();
            assert_eq!(data.cached_jacobian(0).is_some(), kept);
        }
    }
}
