//! Builds the report of a diagnosis.

use crate::error::Result;
use crate::inference::data::noise::Noise;
use crate::inference::data::preprocessing::InsufficientData;
use crate::inference::mixed_model::fitted_model::{FittedModel, ModelView, held_out_square};
use crate::inference::mixed_model::model_fit::{ModelFitter, RecordingContext};
use crate::inference::model::{Linearization, SegmentData};
use crate::inference::next_experiment::next_experiment;
use crate::inference::report::estimates::{calibrated_latents, effect_estimates, model_scores, strings};
use crate::inference::report::evidence::{self, Evidence, ResidualSds};
use crate::inference::report::expected_rss::ExpectedRss;
use crate::inference::report::extended_scene::{extend_scene, set_initial_states};
use crate::inference::report::prediction_gain::{self, ErrorScale, unexplained_share};
use crate::inference::report::residual_map;
use crate::inference::report::text::{self, reason, residual_summary};
use crate::inference::report::trajectory_residuals;
use crate::inference::report::{
    self, Diagnosis, PredictiveCheck, RecommendedExperiment, TrialEffectEstimate, TrialEffects, Verdict,
};
use crate::inference::residual_law::{FittedLaw, LawProblem};
use crate::inference::selection::Decision;
use crate::inference::selection::search::SearchResult;
use crate::inference::trial_checks::between_trial_variation;
use crate::inference::trial_checks::per_trial;
use crate::inference::trial_checks::predictive_check;
use crate::inference::trial_checks::predictive_sd;
use crate::inference::{DiagnosisConfig, DiagnosisResult};
use crate::reality::Trial;
use crate::task::Scene;

/// Inputs of a report, in addition to the search result and the decision.
pub struct ReportInput<'a> {
    pub scene: &'a Scene,
    pub trials: &'a [Trial],
    pub data: &'a SegmentData<'a>,
    /// Indices of the used trials.
    pub trial_indices: &'a [usize],
    /// Names of the settings.
    pub setting_names: &'a [String],
    pub noise: &'a Noise,
    pub expected: &'a ExpectedRss,
    pub scale: &'a ErrorScale,
    pub context: RecordingContext,
}

impl<'a> ReportInput<'a> {
    /// A fitter with the recording's context.
    fn fitter(&self) -> ModelFitter<'a, 'a> {
        ModelFitter::new(self.data, self.noise).with_context(self.context.clone())
    }

    /// The experiment that discriminates what is not decided.
    fn next_experiment(
        &self,
        found: &SearchResult,
        decision: &Decision,
        config: &DiagnosisConfig,
    ) -> Result<Option<RecommendedExperiment>> {
        let discrepancy = Some(&self.context.discrepancy);
        let (segments, models) = (self.data.segments, decision.undecided(found));
        next_experiment(self.scene, segments, &models, decision.verdict, discrepancy, self.noise, config)
    }
}

/// Report, extended scene and evidence of a diagnosis.
pub fn build_report(
    input: &ReportInput,
    found: SearchResult,
    decision: &Decision,
    config: &DiagnosisConfig,
) -> Result<DiagnosisResult> {
    let ReportInput { scene, trials, data, trial_indices: used, .. } = input;
    let (names, noise, scale) = (input.setting_names, input.noise, input.scale);
    let (segments, settings, verdict) = (data.segments, data.settings, decision.verdict);
    let (base, fits) = (&found.base, &found.fits);
    let (best, fitter) = (decision.selected.map(|c| &fits[c]), input.fitter());
    let model = best.unwrap_or(base);
    let law = match verdict {
        Verdict::Unknown => {
            LawProblem { fitter: &fitter, base, model, field: decision.field.as_ref() }.law(noise)?
        }
        _ => None,
    };
    // The extended scene has no larger error than the scene on held-out trials.
    let extension = if held_out_square(model) <= held_out_square(base) { model.view() } else { base.view() };
    let view = law.as_ref().filter(|l| l.offered).map_or(extension, FittedLaw::view);
    let mut gain = prediction_gain::prediction_gain(base, best, settings, names.len(), scale);
    if let (Some(held_out), Some(_)) = (&mut gain.held_out, decision.gain) {
        held_out.excess_removed = decision.gain;
    }
    let unlike = between_trial_variation::between_trial_variation(model);
    let remainder = residual_summary(base, model, decision, noise, &gain, scale);
    let (launches, predictive) = per_trial(input, model, model_to_check(&found, best, verdict))?;
    let field = match &decision.field {
        Some(field) => residual_map::residual_field(&fitter, model, field.spec)?,
        None => None,
    };
    let bands = [predictive_sds(input, base, base.view())?, predictive_sds(input, model, view)?];
    let evidence = evidence::evidence(data, [base.view(), view], bands, names)?;
    let residual_law = law.as_ref().map(|l| l.report(base, model, scale));
    let described =
        residual_law.as_ref().map_or(String::new(), text::law_text) + &between_trial_variation::text(&unlike);
    let diagnosis = Diagnosis {
        format: report::FORMAT.into(),
        verdict,
        reason: reason(&found, decision, &remainder, used.len()) + &described,
        effects: effect_estimates(model, names, |name| decision.inclusion_probability(&found, name)),
        rivals: decision.rivals.iter().map(|i| strings(&fits[*i].effect_names())).collect(),
        calibrated: calibrated_latents(&fitter, model, base.layout.latent_count())?,
        residual: Some(prediction_gain::base_misfit(base, segments, input.expected, noise, scale)),
        gain,
        unexplained_share: match verdict {
            Verdict::None => Some(0.0),
            _ => unexplained_share(base, model, input.expected, segments),
        },
        residual_law,
        next_experiment: input.next_experiment(&found, decision, config)?,
        scores: model_scores(&found, decision, names),
        remainder: Some(remainder),
        launches,
        unlike,
        predictive,
        field,
        paths: trajectory_residuals::trajectory_residuals(&evidence, used),
        odd_trials: Vec::new(),
        surface_offsets: Vec::new(),
        unused_contacts: Vec::new(),
        failed: found.failed.iter().map(|n| strings(n)).collect(),
        seed: config.seed,
    };
    let extended = extend_scene(scene, trials, segments, used, view);
    Ok(DiagnosisResult { diagnosis, extended, evidence })
}

/// The model that trials are checked by: the reported one; where the verdict is `unknown` and no set is reported the most probable
/// set, so that a single odd trial does not hide.
fn model_to_check<'f>(
    found: &'f SearchResult,
    best: Option<&'f FittedModel>,
    verdict: Verdict,
) -> &'f FittedModel {
    let probable = || found.ranked(|_| true).first().map(|i| &found.fits[*i]);
    best.or_else(|| if verdict == Verdict::Unknown { probable() } else { None }).unwrap_or(&found.base)
}

/// Estimates of a model by trial, and how trials compare with the predictions that the model `checked` makes from the others.
fn per_trial(
    input: &ReportInput,
    model: &FittedModel,
    checked: &FittedModel,
) -> Result<(Vec<TrialEffects>, Option<PredictiveCheck>)> {
    let ReportInput { trials, data, trial_indices: used, setting_names: names, .. } = input;
    let fitter = input.fitter();
    let Some((mut linearizations, groups)) = fitter.groups(&model.layout, &model.state, &[])? else {
        return Ok((Vec::new(), None));
    };
    let launch = |(sizes, (i, trial)): (Vec<TrialEffectEstimate>, (usize, &usize))| TrialEffects {
        trial: *trial,
        name: trials[*trial].name.clone(),
        setting: trials[*trial].setting.as_ref().map(|_| names[data.settings[i]].clone()),
        sizes,
    };
    let sizes = per_trial::trial_estimates(model, &groups, data.settings, data.progress)?;
    let launches = sizes.into_iter().zip(used.iter().enumerate()).map(launch).collect();
    if !std::ptr::eq(model, checked) {
        let Some((others, _)) = fitter.groups(&checked.layout, &checked.state, &[])? else {
            return Ok((launches, None));
        };
        linearizations = others;
    }
    Ok((launches, predictive_check::predictive_check(&fitter, checked, &linearizations, used)?))
}

/// Predictive standard deviations of residuals; `view` may have more terms than the model whose components
/// are used.
fn predictive_sds(input: &ReportInput, model: &FittedModel, view: ModelView) -> Result<Option<ResidualSds>> {
    let fitter = input.fitter();
    let linearizations = fitter.groups(view.layout, view.state, &[])?;
    let of = |(linearizations, _): (Vec<Linearization>, _)| {
        predictive_sd::predictive_sds(
            &fitter,
            view,
            &linearizations,
            &model.components,
            &model.covariance,
            input.noise,
        )
    };
    linearizations.map(of).transpose()
}

/// Report for insufficient data.
pub fn insufficient_data_report(
    scene: &Scene,
    trials: &[Trial],
    lack: &InsufficientData,
    config: &DiagnosisConfig,
) -> DiagnosisResult {
    let diagnosis = Diagnosis {
        format: report::FORMAT.into(),
        verdict: Verdict::InsufficientData,
        reason: lack.reason.clone(),
        next_experiment: Some(RecommendedExperiment {
            why: lack.reason.clone(),
            action: lack.action.into(),
            separates: Vec::new(),
            scene: None,
        }),
        seed: config.seed,
        ..Diagnosis::default()
    };
    let mut extended = scene.clone();
    if let Some(trial) = trials.first() {
        set_initial_states(&mut extended, &trial.scene, None);
    }
    DiagnosisResult { diagnosis, extended, evidence: Evidence::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::testing::segments::{ball, observed_trials};

    /// The report gives the reason and an action, and the scene can be simulated.
    #[test]
    fn insufficient_data_give_a_report() {
        let trials = observed_trials(&[vec![[0.0, 1.0, 2.0], [0.1, 1.3, 2.1]]]);
        let lack = InsufficientData { reason: "one trial".into(), action: "measure more" };
        let found = insufficient_data_report(&ball(), &trials, &lack, &DiagnosisConfig::standard(5));
        assert_eq!(found.diagnosis.verdict, Verdict::InsufficientData);
        assert_eq!((found.diagnosis.reason.as_str(), found.diagnosis.seed), ("one trial", 5));
        assert!(found.diagnosis.next_experiment.is_some() && found.diagnosis.effects.is_empty());
        assert!(found.extended.bodies.iter().all(|b| b.position.is_some()));
    }
}
