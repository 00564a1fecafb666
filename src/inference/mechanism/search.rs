//! Search over sets of effects in joints: singles, then pairs and triples beside the most probable sets.

use rayon::prelude::*;

use super::discrepancy::discrepancy;
use super::linearization::Terms;
use super::model_fit::{JointContext, JointFit, not_simulable};
use super::recording::JointRecording;
use crate::error::Result;
use crate::inference::mixed_model::group_statistics::VarianceComponents;
use crate::inference::selection::maximise_components;
use crate::inference::selection::search::log_prior;
use crate::progress::Progress;
use crate::world::mechanism::JointTerm;
use crate::world::mechanism::effect::REGISTRY;

/// Number of sets that are extended, and of extensions of each that are fitted.
const PARENTS: usize = 3;
const EXTENSIONS: usize = 6;
/// Starts of a set that are fitted.
const MAX_STARTS: usize = 3;
/// Log posterior below the most probable set within which sets are compared again, nats.
const MAX_DISTANCE: f64 = 20.0;
/// Effects of the richest model, in every joint that can have them.
const RICHEST: [&str; 4] = ["viscous_friction", "coulomb_friction", "torque_offset", "motor_gain"];
/// Plausible trial discrepancy as a share of the range of positions, and in units of the noise.
const DISCREPANCY_OF_RANGE: f64 = 0.002;
const DISCREPANCY_OF_NOISE: f64 = 0.5;

/// Fitted sets with their log posteriors.
pub struct JointSearch {
    pub base: JointFit,
    pub fits: Vec<JointFit>,
    /// Evidence times prior probability, by fit.
    pub log_posterior: Vec<f64>,
}

/// A candidate: an effect in a joint, with its starting values.
#[derive(Clone)]
pub struct JointCandidate {
    pub starts: Vec<JointTerm>,
}

/// Effects in joints that the scene does not have yet.
pub fn candidates(recording: &JointRecording) -> Vec<JointCandidate> {
    let tree = recording.tree;
    let has_gravity = tree.gravity[0].hypot(tree.gravity[1]) > 0.0;
    let mut out = Vec::new();
    for joint in 0..tree.links.len() {
        for effect in REGISTRY.iter().copied() {
            let known =
                recording.scene_terms.iter().any(|t| t.joint == joint && t.effect.name == effect.name);
            let (driven, on_world) = (tree.motors[joint].is_some(), tree.parents[joint].is_none());
            if known
                || effect.is_resolution()
                || !effect.fits(tree.kinds[joint], driven, on_world, has_gravity)
            {
                continue;
            }
            let mut starts = vec![effect.neutral(joint)];
            for (p, parameter) in effect.parameters.iter().enumerate() {
                let unit = recording.scales[joint].of(parameter.scale);
                let moved = |start: &JointTerm, by: f64| {
                    let mut start = start.clone();
                    start.values[p] =
                        (parameter.neutral + by * unit).clamp(parameter.bounds[0], parameter.bounds[1]);
                    start
                };
                starts = starts
                    .iter()
                    .flat_map(|s| parameter.starts.iter().map(move |by| moved(s, *by)))
                    .collect();
            }
            out.push(JointCandidate { starts });
        }
    }
    out
}

/// The context of a recording: components and discrepancy from the richest model.
pub fn context<'a, 'b>(
    recording: &'b JointRecording<'a>,
    progress: &'b dyn Progress,
) -> Result<JointContext<'a, 'b>> {
    let components = VarianceComponents::initial(true);
    let plain = JointContext { recording, discrepancy: None, components, progress };
    let terms: Terms = candidates(recording)
        .into_iter()
        .filter(|c| RICHEST.contains(&c.starts[0].effect.name))
        .map(|c| c.starts[0].clone())
        .collect();
    let richest = plain.fit(terms, recording.initial_states())?.ok_or_else(not_simulable)?;
    plain.context_of(&richest)
}

impl<'a, 'b> JointContext<'a, 'b> {
    /// The context with the components and the discrepancy along the paths of a fit.
    fn context_of(&self, fit: &JointFit) -> Result<JointContext<'a, 'b>> {
        let JointContext { recording, progress, .. } = *self;
        let discrepancy = discrepancy(recording, &fit.terms, &fit.states);
        let mut out = JointContext { discrepancy, components: self.components.clone(), ..*self };
        let linearizations = recording.linearise(&fit.terms, &fit.states).ok_or_else(not_simulable)?;
        let groups = out.groups(&fit.terms, &linearizations);
        let prior = out.prior(&fit.terms);
        let range = recording
            .scales
            .iter()
            .zip(&recording.noise)
            .map(|(s, noise)| s.range / noise)
            .fold(f64::INFINITY, f64::min);
        let slow = (DISCREPANCY_OF_RANGE * range).hypot(DISCREPANCY_OF_NOISE);
        let broad = out.discrepancy.as_ref().map_or(1.0, |d| d.broad_ratio);
        let best = |broad: f64| maximise_components(&groups, &prior, broad, slow, progress);
        let (narrow, wide) = (best(1.0)?, best(broad)?);
        out.components = if wide.0 > narrow.0 { wide.1 } else { narrow.1 };
        Ok(out)
    }
}

/// Compares the sets near the most probable one, and those that they contain, again with the components and the discrepancy of that one:
/// those of the richest model, which lacks most effects, are coarse. Other sets keep their distance to it.
pub fn refine<'a, 'b>(
    context: &JointContext<'a, 'b>,
    found: JointSearch,
) -> Result<(JointContext<'a, 'b>, JointSearch)> {
    let before = found.best();
    let best = found.ranked(|_| true).into_iter().find(|i| found.log_posterior[*i] >= before);
    let context = context.context_of(best.map_or(&found.base, |i| &found.fits[i]))?;
    let JointSearch { base, fits, log_posterior } = found;
    let again = |fit: &JointFit| context.fit(fit.terms.clone(), fit.states.clone());
    let near: Vec<&JointFit> = fits
        .iter()
        .zip(&log_posterior)
        .filter(|(_, own)| before - *own < MAX_DISTANCE)
        .map(|(fit, _)| fit)
        .collect();
    let is_compared = |fit: &JointFit| near.iter().any(|set| std::ptr::eq(*set, fit) || set.contains(fit));
    let refined: Vec<Result<Option<JointFit>>> =
        fits.par_iter().map(|fit| if is_compared(fit) { again(fit) } else { Ok(None) }).collect();
    let base = again(&base)?.ok_or_else(not_simulable)?;
    let mut out = JointSearch { base, fits: Vec::new(), log_posterior: Vec::new() };
    let mut far = Vec::new();
    for ((fit, own), refined) in fits.into_iter().zip(log_posterior).zip(refined) {
        match refined? {
            Some(fit) => {
                out.log_posterior.push(fit.log_evidence + log_prior(fit.terms.len()));
                out.fits.push(fit);
            }
            None => far.push((fit, own - before)),
        }
    }
    let after = out.best();
    for (fit, below) in far {
        out.fits.push(fit);
        out.log_posterior.push(after + below);
    }
    Ok((context, out))
}

/// Searches sets of up to `most` effects.
pub fn search(context: &JointContext, most: usize) -> Result<JointSearch> {
    let progress = context.progress;
    let candidates = candidates(context.recording);
    progress.report("fitting the base model", 0, 1)?;
    let base = context.fit(Vec::new(), context.recording.initial_states())?.ok_or_else(not_simulable)?;
    let mut found = JointSearch { base, fits: Vec::new(), log_posterior: Vec::new() };
    for size in 1..=most {
        let stage = ["trying single effects", "trying pairs of effects", "trying triples of effects"]
            [size.min(3) - 1];
        let before = found.best();
        let sets = match size {
            1 => candidates.iter().map(|c| starts(&found.base, c)).collect(),
            _ => extensions(context, &found, &candidates, size)?,
        };
        let (done, total) = (std::sync::atomic::AtomicU64::new(0), sets.len() as u64);
        progress.report(stage, 0, total)?;
        let fitted: Vec<Result<Option<JointFit>>> = sets
            .into_par_iter()
            .map(|set| {
                let fit = best_of(context, set)?;
                let done = 1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                progress.report(stage, done, total)?;
                Ok(fit)
            })
            .collect();
        for fit in fitted {
            if let Some(fit) = fit? {
                found.log_posterior.push(fit.log_evidence + log_prior(fit.terms.len()));
                found.fits.push(fit);
            }
        }
        if found.best() <= before {
            break;
        }
    }
    Ok(found)
}

/// A set to fit: starting values and states.
type Start = (Terms, Vec<Vec<f64>>);

/// Starts of a fit with one more effect.
fn starts(fit: &JointFit, candidate: &JointCandidate) -> Vec<Start> {
    let with = |term: &JointTerm| {
        let mut terms = fit.terms.clone();
        terms.push(term.clone());
        (terms, fit.states.clone())
    };
    candidate.starts.iter().map(with).collect()
}

/// The most probable fit over starts.
fn best_of(context: &JointContext, set: Vec<Start>) -> Result<Option<JointFit>> {
    let mut best: Option<JointFit> = None;
    for (terms, states) in most_promising(context, set)? {
        let Some(fit) = context.fit(terms, states)? else { continue };
        if best.as_ref().is_none_or(|b| fit.log_evidence > b.log_evidence) {
            best = Some(fit);
        }
    }
    Ok(best)
}

/// The starts that promise most, at most [`MAX_STARTS`].
fn most_promising(context: &JointContext, set: Vec<Start>) -> Result<Vec<Start>> {
    if set.len() <= MAX_STARTS {
        return Ok(set);
    }
    let promised: Vec<Result<(f64, Start)>> = set
        .into_par_iter()
        .map(|start| {
            let log_evidence = context.promise(start.0.clone(), &start.1)?;
            Ok((log_evidence.unwrap_or(f64::NEG_INFINITY), start))
        })
        .collect();
    let mut promised = promised.into_iter().collect::<Result<Vec<_>>>()?;
    promised.sort_by(|a, b| b.0.total_cmp(&a.0));
    Ok(promised.into_iter().take(MAX_STARTS).map(|(_, start)| start).collect())
}

/// The most promising sets of a size, each once.
fn extensions(
    context: &JointContext,
    found: &JointSearch,
    candidates: &[JointCandidate],
    size: usize,
) -> Result<Vec<Vec<Start>>> {
    let mut out: Vec<Vec<Start>> = Vec::new();
    let mut names: Vec<Vec<(&str, usize)>> = Vec::new();
    for parent in found.ranked(|fit| fit.terms.len() == size - 1).into_iter().take(PARENTS) {
        let fit = &found.fits[parent];
        let fresh = |c: &&JointCandidate| {
            let own = &c.starts[0];
            !fit.terms.iter().any(|t| t.joint == own.joint && t.effect.name == own.effect.name)
        };
        let promised: Vec<Result<(f64, Vec<Start>)>> = candidates
            .par_iter()
            .filter(|c| fresh(c))
            .map(|candidate| {
                let starts = starts(fit, &found.after_single(candidate));
                let mut most = f64::NEG_INFINITY;
                for (terms, states) in &starts {
                    most = context.promise(terms.clone(), states)?.unwrap_or(f64::NEG_INFINITY).max(most);
                }
                Ok((most, starts))
            })
            .collect();
        let mut promised = promised.into_iter().collect::<Result<Vec<_>>>()?;
        // The linearization overestimates what a fit reaches.
        promised.retain(|(log_evidence, _)| log_evidence + log_prior(size) > found.best());
        promised.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (_, starts) in promised.into_iter().take(EXTENSIONS) {
            let mut own: Vec<(&str, usize)> = starts[0].0.iter().map(|t| (t.effect.name, t.joint)).collect();
            own.sort_unstable();
            if !names.contains(&own) {
                names.push(own);
                out.push(starts);
            }
        }
    }
    Ok(out)
}

impl JointSearch {
    /// The candidate with the shape that fits best alone, where shapes have many starting values.
    fn after_single(&self, candidate: &JointCandidate) -> JointCandidate {
        let own = &candidate.starts[0];
        let is_own = |t: &JointTerm| t.joint == own.joint && t.effect.name == own.effect.name;
        match self.fits.iter().find(|fit| fit.terms.len() == 1 && is_own(&fit.terms[0])) {
            Some(fit) if candidate.starts.len() > MAX_STARTS => {
                JointCandidate { starts: vec![fit.terms[0].clone()] }
            }
            _ => candidate.clone(),
        }
    }

    /// Largest log posterior, the base model included.
    fn best(&self) -> f64 {
        self.log_posterior.iter().copied().fold(self.base.log_evidence, f64::max)
    }

    /// Indices of fits, most probable first.
    pub fn ranked(&self, which: impl Fn(&JointFit) -> bool) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.fits.len()).filter(|i| which(&self.fits[*i])).collect();
        order.sort_by(|a, b| self.log_posterior[*b].total_cmp(&self.log_posterior[*a]).then(a.cmp(b)));
        order
    }
}
