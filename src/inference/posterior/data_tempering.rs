//! Data tempering: adds a discrepancy field to the model and samples it with the parameters over increasing
//! horizons.
//!
//! A field that is integrated out in a linearisation around a model without it (`discrepancy`) fails if it
//! displaces trajectories by a hundred times the noise: parameters then compensate for it with false
//! confidence. So if a discrepancy is likely, a field of monomials of position, velocity and speed is
//! simulated, and parameters and coefficients are sampled together (`sampled_field`): first on short initial
//! segments, which are nearly unimodal, then on longer ones, each time starting from the previous draws
//! (Chopin, Biometrika 89 (2002) 539). Gauss-Newton on long segments ends in local optima
//! (docs/calibration.md).
//!
//! Differences from the source: the horizon grows for all trials at once, and only mean and covariance of the
//! draws pass to the next stage.
//!
//! Range of validity: discrepancies that such a field can represent. Segments end where the most likely draw no
//! longer predicts them.

use super::basis_field::{AllFields, BasisField, DiscrepancyModel};
use super::horizon::{FitData, MAX_HORIZON, PreparedModel, horizon_loss, truncate_initial_segments};
use super::log_likelihood::LogLikelihood;
use super::prior;
use super::whitened::whiten;
use crate::error::Result;
use crate::estimate::sampler::smc::{SmcConfig, smc};
use crate::estimate::sampler::{JointPrior, ReferenceDensity, Target as _};
use crate::inference::data::noise::Noise;
use crate::inference::mixed_model::model_fit::ModelFitter;
use crate::inference::model::{self, FitState, SegmentData};
use crate::inference::segment::{Segment, SegmentKind};
use crate::progress::Progress;
use crate::rng;
use crate::world::ParameterVector;

/// Maximum posterior probability of no discrepancy for a field to be added.
const MAX_NO_FIELD_PROBABILITY: f64 = 0.01;
/// Horizon of each stage, observation intervals; chosen in docs/calibration.md.
const STAGE_INTERVALS: [usize; 4] = [3, 4, 6, 8];
/// Particles and moves of each of two runs; chosen in docs/calibration.md.
const PARTICLES: usize = 128;
const MOVES: usize = 6;
const FINAL_MOVES: usize = 16;
/// Scale inflation of the reference density of the next stage.
const REFERENCE_INFLATION: f64 = 1.2;
/// Name of the stage in progress reports.
const PROGRESS_STAGE: &str = "sampling the discrepancy field";

/// Adds a discrepancy field if one is likely and improves the prediction of initial segments. `believed`: prior
/// of the latents.
pub fn with_discrepancy_field(
    fit_data: &FitData,
    model: PreparedModel,
    believed: &[(f64, f64); 3],
    progress: &dyn Progress,
) -> Result<PreparedModel> {
    let Some(every) = detect_discrepancy(fit_data, &model)? else { return Ok(model) };
    let numbers = prior::parameter_priors(&model.layout, &fit_data.ready.setting_names, believed);
    let way =
        DataTempering { grounds: fit_data, model: &model, prior: prior::joint_prior(&numbers)?, progress };
    let mut found =
        TemperedFit { values: model.state.values.clone(), field: every.powers, draws: Vec::new() };
    for (i, most) in STAGE_INTERVALS.into_iter().enumerate() {
        let Some(next) = way.temper(&found, i, most)? else { return Ok(model) };
        found = next;
    }
    let found = way.finish(found)?;
    Ok(if found.loss < model.loss { found } else { model })
}

/// All candidate fields along the model's paths, if a discrepancy is likely.
fn detect_discrepancy(grounds: &FitData, model: &PreparedModel) -> Result<Option<AllFields>> {
    let data = SegmentData::new(&model.windows, &grounds.ready.settings, model.sd.clone(), grounds.engine);
    let data = data.until_stopped(grounds.progress);
    let fitter = ModelFitter::new(&data, &model.noise);
    let Some(fit) = fitter.run_gls(model.layout.clone(), model.state.clone())? else { return Ok(None) };
    let lacks = DiscrepancyModel::Marginalised(AllFields::along_paths(&fitter, &fit.layout, &fit.state)?);
    let Some((_, parts)) = fitter.groups(&fit.layout, &fit.state, &lacks.perturbations())? else {
        return Ok(None);
    };
    let slots = fit.layout.parameters.len();
    let whitened = parts.iter().map(|p| whiten(p, &fit.components, slots).map(|w| w.0));
    let Some(whitened) = whitened.collect::<Option<Vec<_>>>() else { return Ok(None) };
    let fields = lacks.discrepancy(&whitened, grounds.progress)?;
    let own: Vec<_> = whitened.iter().map(|p| p.residual.clone()).collect();
    let none = fields.probabilities(&[fields.log_likelihoods(&whitened, &own)])[0];
    Ok(match lacks {
        DiscrepancyModel::Marginalised(every) if none < MAX_NO_FIELD_PROBABILITY => Some(every),
        _ => None,
    })
}

/// State of data tempering: the most likely draw, and all draws.
struct TemperedFit {
    values: Vec<f64>,
    field: BasisField,
    draws: Vec<ParameterVector>,
}

/// Inputs of data tempering.
struct DataTempering<'a> {
    grounds: &'a FitData<'a>,
    model: &'a PreparedModel,
    /// Prior of the model's parameters.
    prior: JointPrior,
    progress: &'a dyn Progress,
}

/// Reports a stage's progress as a share of all stages.
struct StageProgress<'a> {
    whole: &'a dyn Progress,
    before: usize,
}

/// Progress units of a stage.
const PROGRESS_UNITS_PER_STAGE: u64 = 1000;

impl Progress for StageProgress<'_> {
    fn report(&self, _stage: &str, done: u64, total: u64) -> Result<()> {
        let own = PROGRESS_UNITS_PER_STAGE * done / total.max(1);
        self.whole.report(
            PROGRESS_STAGE,
            PROGRESS_UNITS_PER_STAGE * self.before as u64 + own,
            PROGRESS_UNITS_PER_STAGE * STAGE_INTERVALS.len() as u64,
        )
    }

    fn check_stop(&self) -> Result<()> {
        self.whole.check_stop()
    }
}

impl DataTempering<'_> {
    fn noise(&self) -> Noise {
        Noise { sd: self.grounds.ready.engine_sd, ..self.grounds.ready.noise }
    }

    /// Initial segments of at most `most` intervals that end before `until`, by trial.
    fn initial_segments(&self, most: usize, until: &[f64]) -> Vec<Segment> {
        let all = truncate_initial_segments(&self.grounds.ready.untrimmed, until, most);
        all.into_iter().filter(|w| w.kind == SegmentKind::FromInitialState).collect()
    }

    /// Samples the posterior on a horizon of `most` intervals from the previous stage, the `before`-th; `None`
    /// if the model cannot be fitted.
    fn temper(&self, from: &TemperedFit, before: usize, most: usize) -> Result<Option<TemperedFit>> {
        let FitData { ready, engine, seed, .. } = self.grounds;
        let open = vec![f64::INFINITY; ready.settings.len()];
        let (windows, noise) = (self.initial_segments(most, &open), self.noise());
        let data = SegmentData::new(&windows, &ready.settings, vec![noise.sd; windows.len()], *engine);
        let data = data.until_stopped(self.progress);
        let layout =
            from.field.appended_to(self.model.named_terms(), &self.model.layout, ready.setting_names.len());
        let starts = windows.iter().map(|w| w.nuisances.clone()).collect();
        let fitter = ModelFitter::new(&data, &noise);
        let Some(fit) = fitter.run_gls(layout, FitState::new(from.values.clone(), starts))? else {
            return Ok(None);
        };
        let lacks = DiscrepancyModel::Sampled(&from.field);
        let Some(density) = LogLikelihood::new(&fitter, &fit, self.prior.clone(), &lacks, *seed)? else {
            return Ok(None);
        };
        let reference = match from.draws.as_slice() {
            [] => density.reference(&fit),
            cloud => ReferenceDensity::from_points(cloud, REFERENCE_INFLATION, density.prior()),
        };
        let config = SmcConfig {
            particles: PARTICLES,
            runs: 2,
            moves: MOVES,
            last_moves: FINAL_MOVES,
            seed: rng::derive_seed(*seed, "length", most as u64),
        };
        let draws = smc(&density, &reference, &config, &StageProgress { whole: self.progress, before })?;
        let log = |i: &usize| draws.log_likelihoods[*i] + density.prior().log_density(&draws.points[*i]);
        let Some(best) = (0..draws.points.len()).max_by(|a, b| log(a).total_cmp(&log(b))) else {
            return Ok(None);
        };
        let (values, amounts) = draws.points[best].split_at(from.values.len());
        let field = from.field.with_coefficients(amounts.to_vec());
        Ok(Some(TemperedFit { values: values.to_vec(), field, draws: draws.points }))
    }

    /// The final model with its field, restricted to segments from known initial states as far as the most
    /// likely draw predicts them: initial states of later segments are biased towards the current fit.
    fn finish(&self, found: TemperedFit) -> Result<PreparedModel> {
        let TemperedFit { values, field, draws: cloud } = found;
        let FitData { ready, engine, .. } = self.grounds;
        let layout =
            field.appended_to(self.model.named_terms(), &self.model.layout, ready.setting_names.len());
        let shown = |windows: &[Segment]| {
            let data =
                SegmentData::new(windows, &ready.settings, vec![ready.engine_sd; windows.len()], *engine);
            let data = data.until_stopped(self.progress);
            let starts = windows.iter().map(|w| w.nuisances.clone()).collect();
            model::predict(&data, &layout, &FitState::new(values.clone(), starts))
        };
        let mut until = vec![f64::INFINITY; ready.settings.len()];
        let longest = self.initial_segments(MAX_HORIZON, &until);
        let loss = horizon_loss(&longest, &shown(&longest)?, ready.engine_sd, &mut until);
        let windows = self.initial_segments(STAGE_INTERVALS[STAGE_INTERVALS.len() - 1], &until);
        let starts = windows.iter().map(|w| w.nuisances.clone()).collect();
        let state = FitState::new(values, starts);
        let sd = vec![ready.engine_sd; windows.len()];
        Ok(PreparedModel {
            sd,
            windows,
            layout,
            state,
            noise: self.noise(),
            loss,
            field: Some(field),
            draws: cloud,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    /// A stage reports its share of the whole.
    #[test]
    fn reports_stage_progress_as_a_share() {
        struct RecordedProgress(Mutex<Vec<(String, u64, u64)>>);
        impl Progress for RecordedProgress {
            fn report(&self, stage: &str, done: u64, total: u64) -> Result<()> {
                self.0.lock().unwrap().push((stage.into(), done, total));
                Ok(())
            }
        }
        let told = RecordedProgress(Mutex::new(Vec::new()));
        StageProgress { whole: &told, before: 1 }.report("drawing", 300, 600).unwrap();
        StageProgress { whole: &told, before: 0 }.report("drawing", 0, 0).unwrap();
        let all = PROGRESS_UNITS_PER_STAGE * STAGE_INTERVALS.len() as u64;
        assert_eq!(
            told.0.into_inner().unwrap(),
            [(PROGRESS_STAGE.into(), 1500, all), (PROGRESS_STAGE.into(), 0, all)]
        );
    }
}
