//! Horizon extension: initial segments of trials are as long as the fitted model predicts them.
//!
//! An initial segment starts from a known state, so all its information is about the parameters: a hundred
//! times that of the same segment from an unknown state. But if the model has a discrepancy, its predictions
//! are wrong after some time, and parameters that reduce that error are wrong, too. So the horizon grows in
//! stages. After each fit, segments end before they deviate beyond the noise; segments with fitted initial
//! states take over from there.

use std::cmp::Ordering;
use std::collections::HashMap;

use super::basis_field::BasisField;
use crate::error::Result;
use crate::inference::base_model;
use crate::inference::data::noise::Noise;
use crate::inference::data::preprocessing::PreprocessedData;
use crate::inference::global_search;
use crate::inference::model::{
    self, CachedJacobian, FitEvaluation, FitState, Parameter, ParameterLayout, SegmentData, Term,
};
use crate::inference::segment::{Observation, Segment, SegmentKind, remove_overlaps};
use crate::inference::statistics::median;
use crate::progress::Progress;
use crate::trajectory::Trajectory;
use crate::world::{Engine, ParameterVector};

/// Maximum number of observation intervals of an initial segment, by stage.
pub const HORIZON_STAGES: [usize; 3] = [8, 12, 16];
/// Maximum number of observation intervals of an initial segment.
pub const MAX_HORIZON: usize = HORIZON_STAGES[2];
/// Deviation, in standard deviations of the noise, at which a prediction has failed.
const MAX_DEVIATION_SD: f64 = 6.0;
/// Gauss-Newton steps per stage.
const GAUSS_NEWTON_STEPS: usize = 6;

/// A fitted model with its segments.
pub struct PreparedModel {
    pub windows: Vec<Segment>,
    /// Standard deviation of the residuals by segment, m.
    pub sd: Vec<f64>,
    pub layout: ParameterLayout,
    pub state: FitState,
    pub noise: Noise,
    /// Truncated loss on the longest initial segments, for comparing models of the same trials; see
    /// [`GrownFit`].
    pub loss: f64,
    /// A discrepancy field among the layout's terms.
    pub field: Option<BasisField>,
    /// Draws that seed the sampler if a field is sampled.
    pub draws: Vec<ParameterVector>,
}

impl PreparedModel {
    /// Terms of named effects.
    pub fn named_terms(&self) -> &[Term] {
        let field_terms = self.field.as_ref().map_or(0, |u| u.effects.len());
        &self.layout.terms[..self.layout.terms.len() - field_terms]
    }
}

/// Data of the fits.
pub struct FitData<'a> {
    pub ready: &'a PreprocessedData,
    /// Ends the computation once it is cancelled.
    pub progress: &'a dyn Progress,
    /// Observations by trial.
    pub observed: &'a [&'a Trajectory],
    pub engine: Engine,
    pub seed: u64,
}

/// Extends the horizon as far as the fit predicts. The fit may be in a local optimum that longer segments
/// contradict: of this fit, fits by global search over longer segments, and fits from parameters perturbed to
/// either side, the one with the lowest truncated loss wins (MSAC: Torr and Zisserman, Comput. Vis. Image
/// Underst. 78 (2000) 138).
pub fn extend_horizon(grounds: &FitData, layout: &ParameterLayout, values: &[f64]) -> Result<PreparedModel> {
    let shots = SegmentStates::fit(grounds, layout, values)?;
    let mut best = shots.grow(grounds, layout, values.to_vec())?;
    for most in HORIZON_STAGES.into_iter().skip(1) {
        let windows = truncate_initial_segments(
            &grounds.ready.untrimmed,
            &vec![f64::INFINITY; grounds.ready.settings.len()],
            most,
        );
        let (data, start) = shots.data(grounds, &windows, &best.values, best.noise);
        if !global_search::is_applicable(&data, layout) {
            break;
        }
        let other = global_search::global_search(&data, layout, &start, grounds.seed)?;
        best = best.better(shots.grow(grounds, layout, other.values)?);
    }
    let open = truncate_initial_segments(
        &grounds.ready.untrimmed,
        &vec![f64::INFINITY; grounds.ready.settings.len()],
        MAX_HORIZON,
    );
    let (data, start) = shots.data(grounds, &open, &best.values, grounds.ready.engine_sd);
    if global_search::is_applicable(&data, layout) {
        let other = global_search::wide_scan(&data, layout, &start)?;
        if other.values != best.values {
            best = best.better(shots.grow(grounds, layout, other.values)?);
        }
    }
    finalise(grounds, layout, best)
}

/// Refits the initial states on the final segments.
fn finalise(grounds: &FitData, layout: &ParameterLayout, grown: GrownFit) -> Result<PreparedModel> {
    let GrownFit { values, end_times: until, noise, loss } = grown;
    let windows = truncate_initial_segments(&grounds.ready.untrimmed, &until, MAX_HORIZON);
    let (mut data, start) =
        SegmentStates::fit(grounds, layout, &values)?.data(grounds, &windows, &values, noise);
    // The initial states are linearised again at the final parameters.
    data.cached_jacobians.clear();
    let (state, _) = model::fit(&data, layout, start, GAUSS_NEWTON_STEPS)?;
    let sd = data.sd;
    let noise = Noise { sd: noise, ..grounds.ready.noise };
    Ok(PreparedModel {
        windows,
        sd,
        layout: layout.clone(),
        state,
        noise,
        loss,
        field: None,
        draws: Vec::new(),
    })
}

/// Parameters and the horizon that they predict.
struct GrownFit {
    values: Vec<f64>,
    /// End of each trial's initial segment, s.
    end_times: Vec<f64>,
    /// Standard deviation of the noise of an observed coordinate, m.
    noise: f64,
    /// Truncated quadratic loss on the longest initial segments: per observation the mean squared residual in
    /// units of [`MAX_DEVIATION_SD`] standard deviations of a common noise; 1 for failed observations and all
    /// later ones.
    loss: f64,
}

impl GrownFit {
    /// The fit with the lower loss.
    fn better(self, other: GrownFit) -> GrownFit {
        if other.loss < self.loss { other } else { self }
    }
}

/// Fitted initial states of all multi-step segments.
struct SegmentStates {
    /// By trial and start time.
    states: HashMap<(usize, u64), SegmentState>,
}

/// A segment's initial state, its cached Jacobian, and whether its simulation followed the observations.
struct SegmentState {
    nuisances: Vec<f64>,
    frozen: CachedJacobian,
    is_valid: bool,
}

impl SegmentStates {
    fn fit(grounds: &FitData, layout: &ParameterLayout, values: &[f64]) -> Result<SegmentStates> {
        let windows: Vec<Segment> =
            grounds.ready.untrimmed.iter().filter(|w| w.kind == SegmentKind::MultiStep).cloned().collect();
        let sd = vec![grounds.ready.engine_sd; windows.len()];
        let data = SegmentData::new(&windows, &grounds.ready.settings, sd, grounds.engine);
        let mut data = data.until_stopped(grounds.progress);
        let start = FitState::new(values.to_vec(), windows.iter().map(|w| w.nuisances.clone()).collect());
        let nuisances = base_model::initialise_nuisances(&data, grounds.observed, layout, &start)?;
        let (state, pass) = model::fit(&data, layout, FitState { nuisances, ..start }, GAUSS_NEWTON_STEPS)?;
        base_model::drop_diverged(&mut data, &pass);
        let latents: Vec<usize> = layout.parameters.iter().filter_map(Parameter::latent).collect();
        let only = ParameterLayout::new(&latents, Vec::new(), 1);
        let at = FitState::new(state.values[..latents.len()].to_vec(), state.nuisances.clone());
        model::cache_jacobians(&mut data, &only, &at)?;
        let frozen = std::mem::take(&mut data.cached_jacobians);
        let known = windows.iter().zip(state.nuisances).zip(frozen).zip(&data.sd);
        let known = known.map(|(((w, nuisances), frozen), sd)| {
            ((w.trial, w.start.to_bits()), SegmentState { nuisances, frozen, is_valid: sd.is_finite() })
        });
        Ok(SegmentStates { states: known.collect() })
    }

    /// Fits the parameters on a horizon that grows in stages.
    fn grow(&self, grounds: &FitData, layout: &ParameterLayout, mut values: Vec<f64>) -> Result<GrownFit> {
        let mut noise = grounds.ready.engine_sd;
        let open = vec![f64::INFINITY; grounds.ready.settings.len()];
        let mut until = open.clone();
        for most in HORIZON_STAGES {
            // Observations that the previous stage failed to predict may succeed now.
            until.clone_from(&open);
            let all = truncate_initial_segments(&grounds.ready.untrimmed, &open, most);
            let (data, start) = self.data(grounds, &all, &values, noise);
            let shown = model::predict(&data, layout, &start)?;
            truncate_at_deviation(&all, &shown, noise, &mut until);
            let windows = truncate_initial_segments(&grounds.ready.untrimmed, &until, most);
            let (data, start) = self.data(grounds, &windows, &values, noise);
            let (state, pass) = model::fit(&data, layout, start, GAUSS_NEWTON_STEPS)?;
            values = state.values;
            noise = estimate_noise(&windows, &pass, grounds.ready.engine_sd);
        }
        until.clone_from(&open);
        let all = truncate_initial_segments(&grounds.ready.untrimmed, &open, MAX_HORIZON);
        let (data, start) = self.data(grounds, &all, &values, noise);
        let shown = model::predict(&data, layout, &start)?;
        truncate_at_deviation(&all, &shown, noise, &mut until);
        let loss = horizon_loss(&all, &shown, grounds.ready.engine_sd, &mut open.clone());
        Ok(GrownFit { values, end_times: until, noise, loss })
    }

    /// Segments as data, with their initial states.
    fn data<'a>(
        &self,
        grounds: &'a FitData,
        windows: &'a [Segment],
        values: &[f64],
        simulated: f64,
    ) -> (SegmentData<'a>, FitState) {
        let of = |w: &Segment| {
            self.states.get(&(w.trial, w.start.to_bits())).filter(|_| w.kind == SegmentKind::MultiStep)
        };
        let scale = |w: &Segment| match of(w) {
            Some(known) if !known.is_valid => f64::INFINITY,
            _ if w.kind.uses_engine() => simulated,
            _ => grounds.ready.noise.sd,
        };
        let sd = windows.iter().map(scale).collect();
        let data = SegmentData::new(windows, &grounds.ready.settings, sd, grounds.engine);
        let mut data = data.until_stopped(grounds.progress);
        data.cached_jacobians =
            windows.iter().map(|w| of(w).map(|k| k.frozen.clone()).unwrap_or_default()).collect();
        let start = |w: &Segment| of(w).map_or_else(|| w.nuisances.clone(), |k| k.nuisances.clone());
        (data, FitState::new(values.to_vec(), windows.iter().map(start).collect()))
    }
}

/// Initial segments of at most `most` intervals that end before `until`, by trial, and the segments after them.
pub fn truncate_initial_segments(all: &[Segment], until: &[f64], most: usize) -> Vec<Segment> {
    let shortened = |w: &Segment| {
        if w.kind != SegmentKind::FromInitialState {
            return Some(w.clone());
        }
        let bodies = w.scene.bodies.len().max(1);
        let mut points = w.observations.clone();
        points.truncate(most * bodies);
        points.retain(|p| p.time < until[w.trial]);
        let last = points.last()?.time;
        let mut out = Segment { observations: points, ..w.clone() };
        out.scene.steps =
            ((last / w.scene.time_step).round() as u32 + u32::from(w.scene.observe_every == 1)).max(1);
        Some(out)
    };
    let mut windows: Vec<Segment> = all.iter().filter_map(shortened).collect();
    remove_overlaps(&mut windows);
    windows
}

/// Ends initial segments before the first observation that deviates beyond the noise.
fn truncate_at_deviation(windows: &[Segment], shown: &[Vec<f64>], sd: f64, until: &mut [f64]) {
    for (window, shown) in windows.iter().zip(shown).filter(|(w, _)| w.kind == SegmentKind::FromInitialState)
    {
        let off = |(point, at): &(&Observation, &[f64])| {
            // NaN counts as a deviation.
            let far = |k: usize| {
                (point.position[k] - at[k]).abs().partial_cmp(&(MAX_DEVIATION_SD * sd))
                    != Some(Ordering::Less)
            };
            far(0) || far(1)
        };
        if let Some((point, _)) = window.observations.iter().zip(shown.chunks_exact(2)).find(off) {
            until[window.trial] = until[window.trial].min(point.time - 1e-9);
        }
    }
}

/// Truncated loss, see [`GrownFit`]; `until`: by trial, end of the evaluated range, s, shortened to the first
/// failed observation.
pub fn horizon_loss(windows: &[Segment], shown: &[Vec<f64>], sd: f64, until: &mut [f64]) -> f64 {
    truncate_at_deviation(windows, shown, sd, until);
    let runs = windows.iter().zip(shown).filter(|(w, _)| w.kind == SegmentKind::FromInitialState);
    let of = |(point, at, until): (&Observation, &[f64], f64)| {
        let square = |k: usize| ((point.position[k] - at[k]) / (MAX_DEVIATION_SD * sd)).powi(2);
        if point.time < until { (0.5 * (square(0) + square(1))).min(1.0) } else { 1.0 }
    };
    let points = runs.flat_map(|(w, shown)| {
        w.observations.iter().zip(shown.chunks_exact(2)).map(|(point, at)| (point, at, until[w.trial]))
    });
    points.map(of).sum()
}

/// Noise standard deviation from the median absolute residual of initial segments, m; the prior value if there
/// are too few.
fn estimate_noise(windows: &[Segment], pass: &FitEvaluation, known: f64) -> f64 {
    let runs = windows.iter().zip(&pass.residuals).filter(|(w, _)| w.kind == SegmentKind::FromInitialState);
    let all: Vec<f64> =
        runs.flat_map(|(_, residuals)| residuals).map(|r| r.abs()).filter(|r| r.is_finite()).collect();
    // The median absolute value of a normal is 0.6745 standard deviations.
    let own = median(&all) / 0.674_489_750_196;
    if all.len() >= MIN_RESIDUALS { own.clamp(MIN_NOISE_RATIO * known, known) } else { known }
}

/// Minimum number of residuals for an estimate of the noise, and its minimum relative to the prior value:
/// segments at rest fit exactly.
const MIN_RESIDUALS: usize = 100;
const MIN_NOISE_RATIO: f64 = 0.2;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::one_step_segments;

    /// Initial segments of one body with three observations each, and predictions for them.
    fn synthetic_segments(off: [[f64; 3]; 2]) -> (Vec<Segment>, Vec<Vec<f64>>) {
        let template = one_step_segments(0.0).0.remove(0);
        let point =
            |k: usize| Observation { time: k as f64, position: [0.0, 0.0], ..template.observations[0] };
        let run = |trial: usize| Segment {
            trial,
            kind: SegmentKind::FromInitialState,
            observations: (1..=3).map(point).collect(),
            ..template.clone()
        };
        let shown = off.map(|own| own.iter().flat_map(|x| [*x, 0.0]).collect());
        (vec![run(0), run(1)], shown.to_vec())
    }

    /// The loss is quadratic up to a failure and constant after it, on a common noise scale.
    #[test]
    fn failed_and_later_observations_count_fully() {
        let of = |off| {
            let (windows, shown) = synthetic_segments(off);
            horizon_loss(&windows, &shown, 0.1, &mut [f64::INFINITY; 2])
        };
        assert_eq!(of([[0.0; 3]; 2]), 0.0);
        let square = |x: f64| 0.5 * (x / (MAX_DEVIATION_SD * 0.1)).powi(2);
        assert!((of([[0.3, 0.0, 0.1], [0.0; 3]]) - square(0.3) - square(0.1)).abs() < 1e-12);
        assert!((of([[0.3, 0.7, 0.0], [0.0, 0.0, 0.2]]) - square(0.3) - 2.0 - square(0.2)).abs() < 1e-12);
        assert_eq!(of([[f64::NAN, 0.0, 0.0], [0.0; 3]]), 3.0);
    }

    #[test]
    fn better_fit_has_the_lower_loss() {
        let grown = |loss| GrownFit { values: vec![loss], end_times: Vec::new(), noise: 0.0, loss };
        assert_eq!(grown(2.0).better(grown(1.0)).loss, 1.0);
        assert_eq!(grown(1.0).better(grown(2.0)).loss, 1.0);
        assert_eq!(grown(1.0).better(grown(f64::NAN)).loss, 1.0);
    }
}
