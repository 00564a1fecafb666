//! Puts what was found into a report.

use super::band;
use super::by_launch;
use super::check;
use super::described::{FittedLaw, LawProblem};
use super::evidence::{self, Evidence, ResidualSds};
use super::expected::ExpectedRss;
use super::extend::{extend_scene, set_initial_states};
use super::fit::{FittedModel, ModelFitter, ModelView, RecordingContext, held_out_square};
use super::gain::{self, ErrorScale, unexplained_share};
use super::model::{Linearization, SegmentData};
use super::noise::Noise;
use super::paths;
use super::picture;
use super::report::{
    self, Diagnosis, PredictionGain, PredictiveCheck, RecommendedExperiment, TrialEffectEstimate,
    TrialEffects, Verdict,
};
use super::search::SearchResult;
use super::selection::Decision;
use super::sizes::{calibrated_latents, effect_estimates, model_scores, strings};
use super::unlike;
use super::words::{self, reason, residual_summary};
use super::{DiagnosisConfig, DiagnosisResult, advise};
use crate::error::Result;
use crate::reality::Trial;
use crate::task::Scene;

/// What a report is made from, besides the search and its verdict.
pub struct ReportInput<'a> {
    pub scene: &'a Scene,
    pub trials: &'a [Trial],
    pub data: &'a SegmentData<'a>,
    /// Which of the trials the windows are of.
    pub trial_indices: &'a [usize],
    /// Names of the settings.
    pub setting_names: &'a [String],
    pub noise: &'a Noise,
    pub expected: &'a ExpectedRss,
    pub scale: &'a ErrorScale,
    pub context: Option<RecordingContext>,
}

impl<'a> ReportInput<'a> {
    /// A fitter in the recording's context.
    fn fitter(&self) -> ModelFitter<'a, 'a> {
        ModelFitter { context: self.context.clone(), ..ModelFitter::new(self.data, self.noise) }
    }
}

/// The report of a search, the extended scene and what pictures show.
pub fn build_report(
    given: &ReportInput,
    found: SearchResult,
    decision: &Decision,
    config: &DiagnosisConfig,
) -> Result<DiagnosisResult> {
    let ReportInput {
        scene,
        trials,
        data,
        trial_indices: kept,
        setting_names: names,
        noise,
        expected,
        scale,
        ..
    } = given;
    let (windows, settings, verdict) = (data.segments, data.settings, decision.verdict);
    let SearchResult { base, fits, .. } = &found;
    let best = decision.selected.map(|c| &fits[c]);
    let model = best.unwrap_or(base);
    let fitter = given.fitter();
    let law = match verdict {
        Verdict::Unknown => {
            LawProblem { fitter: &fitter, base, model, field: decision.field.as_ref() }.law(noise)?
        }
        _ => None,
    };
    // The extended scene is never worse than the scene on held-out trials.
    let extension = if held_out_square(model) <= held_out_square(base) { model.view() } else { base.view() };
    let shown = law.as_ref().filter(|l| l.offered).map_or(extension, FittedLaw::view);
    let mut gain = gain::prediction_gain(base, best, settings, names.len(), scale);
    if let (Some(held_out), Some(_)) = (&mut gain.held_out, decision.gain) {
        held_out.excess_removed = decision.gain;
    }
    let next = advise::next_experiment(scene, windows, fits, &decision.rivals, verdict, noise, config)?;
    let rival_names = |i: &usize| strings(&fits[*i].effect_names());
    let unlike = unlike::between_trial_variation(model);
    let remainder = residual_summary(base, model, decision, noise, &gain, scale);
    let (launches, predictive) = per_trial(given, model, model_to_check(&found, best, verdict))?;
    let field = match &decision.field {
        Some(field) => picture::residual_field(&fitter, model, field.spec)?,
        None => None,
    };
    let bands = [predictive_sds(given, base, base.view())?, predictive_sds(given, model, shown)?];
    let evidence = evidence::evidence(data, [base.view(), shown], bands, names)?;
    let residual_law = law.as_ref().map(|l| l.report(base, model, scale));
    let described = residual_law.as_ref().map_or(String::new(), words::law_text);
    let diagnosis = Diagnosis {
        format: report::FORMAT,
        verdict,
        reason: reason(&found, decision, &remainder, kept.len()) + &described + &unlike::text(&unlike),
        effects: effect_estimates(model, names, |name| decision.inclusion_probability(&found, name)),
        rivals: decision.rivals.iter().map(rival_names).collect(),
        calibrated: calibrated_latents(&fitter, model, base.layout.latent_count())?,
        residual: Some(gain::base_misfit(base, windows, expected, noise, scale)),
        gain,
        unexplained_share: match verdict {
            Verdict::None => Some(0.0),
            _ => unexplained_share(base, model, expected, windows),
        },
        residual_law,
        next_experiment: next,
        scores: model_scores(&found, decision, names),
        remainder: Some(remainder),
        launches,
        unlike,
        predictive,
        field,
        paths: paths::trajectory_residuals(&evidence, kept),
        odd_trials: Vec::new(),
        surface_offsets: Vec::new(),
        failed: found.failed.iter().map(|n| strings(n)).collect(),
        seed: config.seed,
    };
    let extended = extend_scene(scene, trials, windows, kept, shown);
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
    given: &ReportInput,
    model: &FittedModel,
    checked: &FittedModel,
) -> Result<(Vec<TrialEffects>, Option<PredictiveCheck>)> {
    let ReportInput { trials, data, trial_indices: kept, setting_names: names, .. } = given;
    let fitter = given.fitter();
    let Some((mut looks, parts)) = fitter.groups(&model.layout, &model.state, &[])? else {
        return Ok((Vec::new(), None));
    };
    let launch = |(sizes, (i, trial)): (Vec<TrialEffectEstimate>, (usize, &usize))| TrialEffects {
        trial: *trial,
        name: trials[*trial].name.clone(),
        setting: trials[*trial].setting.as_ref().map(|_| names[data.settings[i]].clone()),
        sizes,
    };
    let sizes = by_launch::trial_estimates(model, &parts, data.settings);
    let launches = sizes.into_iter().zip(kept.iter().enumerate()).map(launch).collect();
    if !std::ptr::eq(model, checked) {
        let Some((others, _)) = fitter.groups(&checked.layout, &checked.state, &[])? else {
            return Ok((launches, None));
        };
        looks = others;
    }
    Ok((launches, check::predictive_check(&fitter, checked, &looks, kept)))
}

/// How wide residuals should be; `shown` may hold more than the model whose components they are.
fn predictive_sds(given: &ReportInput, model: &FittedModel, shown: ModelView) -> Result<Option<ResidualSds>> {
    let fitter = given.fitter();
    let looks = fitter.groups(shown.layout, shown.state, &[])?;
    let of = |(looks, _): (Vec<Linearization>, _)| {
        band::predictive_sds(&fitter, shown, &looks, &model.components, &model.covariance, given.noise)
    };
    Ok(looks.map(of))
}

/// The report where too little can be told from the trials to judge anything.
pub fn insufficient_data_report(
    scene: &Scene,
    trials: &[Trial],
    reason: &str,
    config: &DiagnosisConfig,
) -> DiagnosisResult {
    let diagnosis = Diagnosis {
        format: report::FORMAT,
        verdict: Verdict::InsufficientData,
        reason: reason.to_string(),
        effects: Vec::new(),
        rivals: Vec::new(),
        calibrated: Vec::new(),
        residual: None,
        gain: PredictionGain::default(),
        unexplained_share: None,
        residual_law: None,
        remainder: None,
        odd_trials: Vec::new(),
        surface_offsets: Vec::new(),
        failed: Vec::new(),
        next_experiment: Some(RecommendedExperiment {
            why: reason.to_string(),
            action: "measure more trials, each with ten or more observations between contacts".into(),
            separates: Vec::new(),
            scene: None,
        }),
        scores: Vec::new(),
        launches: Vec::new(),
        unlike: Vec::new(),
        predictive: None,
        field: None,
        paths: Default::default(),
        seed: config.seed,
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
    use crate::discover::fixture::{ball, trials};

    /// Where nothing can be judged the report says so and what to do, and the scene is placed so that it rolls out.
    #[test]
    fn too_little_is_a_report_too() {
        let trials = trials(&[vec![[0.0, 1.0, 2.0], [0.1, 1.3, 2.1]]]);
        let found = insufficient_data_report(&ball(), &trials, "one trial", &DiagnosisConfig::standard(5));
        assert_eq!(found.diagnosis.verdict, Verdict::InsufficientData);
        assert_eq!((found.diagnosis.reason.as_str(), found.diagnosis.seed), ("one trial", 5));
        assert!(found.diagnosis.next_experiment.is_some() && found.diagnosis.effects.is_empty());
        assert!(found.extended.bodies.iter().all(|b| b.position.is_some()));
    }
}
