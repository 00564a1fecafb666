//! Puts what was found into a report.

use super::band;
use super::by_launch;
use super::check;
use super::described::{Law, Rest};
use super::evidence::{self, Bands, Evidence};
use super::expected::Expected;
use super::extend::{extend, place};
use super::fit::{Context, Fitted, Fitter, Shown, held};
use super::gain::{self, Scale, unexplained};
use super::model::{Data, Look};
use super::noise::Noise;
use super::paths;
use super::picture;
use super::report::{
    self, Diagnosis, PredictionGain, PredictiveCheck, RecommendedExperiment, TrialEffectEstimate,
    TrialEffects, Verdict,
};
use super::search::Found;
use super::selection::Decision;
use super::sizes::{calibrated, effects, scores, strings};
use super::unlike;
use super::words::{self, reason, remainder};
use super::{DiagnosisConfig, DiagnosisResult, advise};
use crate::error::Result;
use crate::reality::Trial;
use crate::task::Scene;

/// What a report is made from, besides the search and its verdict.
pub struct Given<'a> {
    pub scene: &'a Scene,
    pub trials: &'a [Trial],
    pub data: &'a Data<'a>,
    /// Which of the trials the windows are of.
    pub kept: &'a [usize],
    /// Names of the settings.
    pub names: &'a [String],
    pub noise: &'a Noise,
    pub expected: &'a Expected,
    pub scale: &'a Scale,
    pub context: Option<Context>,
}

impl<'a> Given<'a> {
    /// A fitter in the recording's context.
    fn fitter(&self) -> Fitter<'a, 'a> {
        Fitter { context: self.context.clone(), ..Fitter::new(self.data, self.noise) }
    }
}

/// The report of a search, the extended scene and what pictures show.
pub fn conclude(
    given: &Given,
    found: Found,
    decision: &Decision,
    config: &DiagnosisConfig,
) -> Result<DiagnosisResult> {
    let Given { scene, trials, data, kept, names, noise, expected, scale, .. } = given;
    let (windows, settings, verdict) = (data.windows, data.settings, decision.verdict);
    let Found { base, fits, .. } = &found;
    let best = decision.champion.map(|c| &fits[c]);
    let model = best.unwrap_or(base);
    let fitter = given.fitter();
    let law = match verdict {
        Verdict::Unknown => {
            Rest { fitter: &fitter, base, model, field: decision.field.as_ref() }.law(noise)?
        }
        _ => None,
    };
    // The extended scene is never worse than the scene on held-out trials.
    let extension = if held(model) <= held(base) { model.shown() } else { base.shown() };
    let shown = law.as_ref().filter(|l| l.offered).map_or(extension, Law::shown);
    let mut gain = gain::gain(base, best, settings, names.len(), scale);
    if let (Some(held_out), Some(_)) = (&mut gain.held_out, decision.gain) {
        held_out.excess_removed = decision.gain;
    }
    let next = advise::next(scene, windows, fits, &decision.rivals, verdict, noise, config)?;
    let rival_names = |i: &usize| strings(&fits[*i].names());
    let unlike = unlike::unlike(model);
    let remainder = remainder(base, model, decision, noise, &gain, scale);
    let (launches, predictive) = by_launch(given, model, checked(&found, best, verdict))?;
    let field = match &decision.field {
        Some(field) => picture::field(&fitter, model, field.form)?,
        None => None,
    };
    let bands = [bands(given, base, base.shown())?, bands(given, model, shown)?];
    let evidence = evidence::evidence(data, [base.shown(), shown], bands, names)?;
    let residual_law = law.as_ref().map(|l| l.report(base, model, scale));
    let described = residual_law.as_ref().map_or(String::new(), words::described);
    let diagnosis = Diagnosis {
        format: report::FORMAT,
        verdict,
        reason: reason(&found, decision, &remainder, kept.len()) + &described + &unlike::text(&unlike),
        effects: effects(model, names, |name| decision.inclusion(&found, name)),
        rivals: decision.rivals.iter().map(rival_names).collect(),
        calibrated: calibrated(&fitter, model, base.layout.latents())?,
        residual: Some(gain::residual(base, windows, expected, noise, scale)),
        gain,
        unexplained_share: match verdict {
            Verdict::None => Some(0.0),
            _ => unexplained(base, model, expected, windows),
        },
        residual_law,
        next_experiment: next,
        scores: scores(&found, decision, names),
        remainder: Some(remainder),
        launches,
        unlike,
        predictive,
        field,
        paths: paths::paths(&evidence, kept),
        odd_trials: Vec::new(),
        surface_offsets: Vec::new(),
        failed: found.failed.iter().map(|n| strings(n)).collect(),
        seed: config.seed,
    };
    let extended = extend(scene, trials, windows, kept, shown);
    Ok(DiagnosisResult { diagnosis, extended, evidence })
}

/// The model that trials are checked by: the reported one; where the verdict is `unknown` and no set is reported the most probable
/// set, so that a single odd trial does not hide.
fn checked<'f>(found: &'f Found, best: Option<&'f Fitted>, verdict: Verdict) -> &'f Fitted {
    let probable = || found.ranked(|_| true).first().map(|i| &found.fits[*i]);
    best.or_else(|| if verdict == Verdict::Unknown { probable() } else { None }).unwrap_or(&found.base)
}

/// Estimates of a model by trial, and how trials compare with the predictions that the model `checked` makes from the others.
fn by_launch(
    given: &Given,
    model: &Fitted,
    checked: &Fitted,
) -> Result<(Vec<TrialEffects>, Option<PredictiveCheck>)> {
    let Given { trials, data, kept, names, .. } = given;
    let fitter = given.fitter();
    let Some((mut looks, parts)) = fitter.parts(&model.layout, &model.state, &[])? else {
        return Ok((Vec::new(), None));
    };
    let launch = |(sizes, (i, trial)): (Vec<TrialEffectEstimate>, (usize, &usize))| TrialEffects {
        trial: *trial,
        name: trials[*trial].name.clone(),
        setting: trials[*trial].setting.as_ref().map(|_| names[data.settings[i]].clone()),
        sizes,
    };
    let sizes = by_launch::sizes(model, &parts, data.settings);
    let launches = sizes.into_iter().zip(kept.iter().enumerate()).map(launch).collect();
    if !std::ptr::eq(model, checked) {
        let Some((others, _)) = fitter.parts(&checked.layout, &checked.state, &[])? else {
            return Ok((launches, None));
        };
        looks = others;
    }
    Ok((launches, check::predictive(&fitter, checked, &looks, kept)?))
}

/// How wide residuals should be; `shown` may hold more than the model whose components they are.
fn bands(given: &Given, model: &Fitted, shown: Shown) -> Result<Option<Bands>> {
    let fitter = given.fitter();
    let looks = fitter.parts(shown.layout, shown.state, &[])?;
    let of = |(looks, _): (Vec<Look>, _)| {
        band::bands(&fitter, shown, &looks, &model.components, &model.covariance, given.noise)
    };
    looks.map(of).transpose()
}

/// The report where too little can be told from the trials to judge anything.
pub fn insufficient(
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
        place(&mut extended, &trial.scene, None);
    }
    DiagnosisResult { diagnosis, extended, evidence: Evidence::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fixture::{ball, seen};

    /// Where nothing can be judged the report says so and what to do, and the scene is placed so that it rolls out.
    #[test]
    fn too_little_is_a_report_too() {
        let trials = seen(&[vec![[0.0, 1.0, 2.0], [0.1, 1.3, 2.1]]]);
        let found = insufficient(&ball(), &trials, "one trial", &DiagnosisConfig::standard(5));
        assert_eq!(found.diagnosis.verdict, Verdict::InsufficientData);
        assert_eq!((found.diagnosis.reason.as_str(), found.diagnosis.seed), ("one trial", 5));
        assert!(found.diagnosis.next_experiment.is_some() && found.diagnosis.effects.is_empty());
        assert!(found.extended.bodies.iter().all(|b| b.position.is_some()));
    }
}
