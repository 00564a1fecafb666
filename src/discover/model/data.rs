//! What is fixed during a diagnosis.

use crate::discover::window::Window;
use crate::error::Result;
use crate::progress::{NoProgress, Progress};
use crate::world::Engine;

/// Windows and their noise.
pub struct Data<'a> {
    pub windows: &'a [Window],
    pub trials: usize,
    /// Setting of each trial.
    pub settings: &'a [usize],
    /// Scale of the residuals by window, m.
    pub sd: Vec<f64>,
    /// Derivatives of shots by their nuisances and by the latents, found once: by window; empty for others.
    pub frozen: Vec<Frozen>,
    pub engine: Engine,
    /// Ends computations on the data once they are cancelled.
    pub progress: &'a dyn Progress,
}

impl<'a> Data<'a> {
    /// Windows of as many trials as there are settings; nothing is frozen yet.
    pub fn new(windows: &'a [Window], settings: &'a [usize], sd: Vec<f64>, engine: Engine) -> Data<'a> {
        let (frozen, progress) = (Vec::new(), &NoProgress);
        Data { windows, trials: settings.len(), settings, sd, frozen, engine, progress }
    }

    /// The same, of which computations end once `progress` says so.
    pub fn until_stopped(self, progress: &'a dyn Progress) -> Data<'a> {
        Data { progress, ..self }
    }

    /// `of` every window, checked before each whether the computation must end.
    pub fn each_window<T>(&self, mut of: impl FnMut(usize, &'a Window) -> T) -> Result<Vec<T>> {
        let one = |(w, window)| self.progress.check_stop().map(|()| of(w, window));
        self.windows.iter().enumerate().map(one).collect()
    }

    /// How many settings there are.
    pub fn setting_count(&self) -> usize {
        self.settings.iter().max().map_or(1, |s| s + 1)
    }

    /// What is kept of a window's derivatives, if anything is.
    pub fn frozen(&self, window: usize) -> Option<&Frozen> {
        self.frozen.get(window).filter(|f| !f.nuisances.is_empty())
    }
}

/// Derivatives that change little with what a search tries.
#[derive(Clone, Default)]
pub struct Frozen {
    pub nuisances: Vec<Vec<f64>>,
    /// Of the first slots, which are the latents.
    pub latents: Vec<Vec<f64>>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{leaps, shots, term};
    use crate::discover::model::{Layout, State, freeze};

    /// Of a shot it is kept how its start moves it; a leap has no start to move, and is simulated with every model.
    #[test]
    fn what_is_kept_is_of_windows_with_nuisances() {
        for ((windows, settings), kept) in [(shots(), true), (leaps(0.0), false)] {
            let mut data = Data::new(&windows, &settings, vec![1e-3; windows.len()], Engine::Lanes);
            assert!(data.frozen(0).is_none(), "nothing yet");
            let nuisances = windows.iter().map(|w| w.nuisances.clone()).collect();
            let layout = Layout::new(&[], vec![term("wind")], 1);
            freeze(&mut data, &layout, &State::new(vec![0.0; 2], nuisances)).unwrap();
            assert_eq!(data.frozen(0).is_some(), kept);
        }
    }
}
