//! What windows are predicted to show at a state, without derivatives.

use super::data::Data;
use super::engine::{placed, predicted};
use super::layout::Layout;
use super::state::State;
use crate::discover::window::Window;
use crate::error::Result;
use crate::task::Scene;
use crate::world::{Rollout, Simulator};

/// Positions at every window's points, two numbers each, m; NaN where a path diverged.
pub fn shown(data: &Data, layout: &Layout, state: &State) -> Result<Vec<Vec<f64>>> {
    let simulated: Vec<(usize, &Window)> =
        data.windows.iter().enumerate().filter(|(_, w)| w.kind.simulated()).collect();
    let scenes: Vec<Scene> =
        simulated.iter().map(|(w, window)| placed(window, &state.nuisances[*w])).collect();
    let physics =
        |(_, window): &(usize, &Window)| layout.physics(&state.values, window.setting, window.start);
    let physics: Vec<_> = simulated.iter().map(physics).collect();
    let rollouts: Vec<Rollout> = scenes
        .iter()
        .zip(&physics)
        .zip(&simulated)
        .map(|((scene, physics), (_, window))| window.rollout(scene, physics))
        .collect();
    let by_engine = Simulator::new(data.engine)
        .budget(&data.progress)
        .map(&rollouts, |i, path| predicted(simulated[i].1, &path))?;
    let mut by_engine = by_engine.into_iter();
    let of = |w: usize, window: &Window| match window.kind.simulated() {
        true => by_engine.next().unwrap_or_default(),
        false => seen(window, layout, &state.of(w)),
    };
    data.each_window(of)
}

/// The same of a window that is integrated here, at a state of that window alone.
pub fn seen(window: &Window, layout: &Layout, state: &State) -> Vec<f64> {
    let nuisances = state.nuisances.first().map_or(&[][..], Vec::as_slice);
    layout.path(window, &state.values_in(0), &state.beside(0)).seen(nuisances, |_, _| ())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{flights, leaps, shots, term};
    use crate::discover::model::looks;
    use crate::world::Engine;

    /// What is shown is what residuals are taken from.
    #[test]
    fn what_is_shown_is_what_residuals_are_of() {
        let layout = Layout::new(&[], vec![term("wind")], 1);
        for (windows, settings) in [flights([0.4, 0.0], 2), shots(), leaps(0.3)] {
            let data = Data::new(&windows, &settings, vec![1e-3; windows.len()], Engine::Lanes);
            let nuisances = windows.iter().map(|w| w.nuisances.clone()).collect();
            let state = State::new(vec![0.2, 0.1], nuisances);
            let shown = shown(&data, &layout, &state).unwrap();
            let looks = looks(&data, &layout, &state, &[]).unwrap();
            for (w, (window, look)) in windows.iter().zip(&looks).enumerate() {
                assert_eq!(shown[w].len(), 2 * window.points.len());
                if look.start.ncols() > 0 {
                    // Starts take up what they can: of the rest, the residual across them is what was seen less what is shown.
                    let off = nalgebra::DVector::from_fn(look.residual.len(), |i, _| {
                        let point = window.points.get(i / 2);
                        point
                            .map_or(0.0, |p| (p.seen[i % 2] - shown[w][i]) * look.weights[i / 2] * look.share)
                    });
                    let rest = &look.start
                        * crate::discover::stats::inverse(&look.start.tr_mul(&look.start))
                        * look.start.tr_mul(&off);
                    assert!((off - rest - &look.residual).amax() < 1e-6 * (1.0 + look.residual.amax()));
                }
            }
        }
    }
}
