//! Information of motions about effects in joints, before anything is measured.

use nalgebra::DMatrix;

use super::discrepancy::discrepancy;
use super::linearization::{JointLinearization, slots};
use super::model_fit::not_simulable;
use super::recording::{JointRecording, JointSegment};
use super::report::effect_in_joint;
use super::search::candidates;
use crate::error::{Error, Result};
use crate::inference::mixed_model::coordinates::{orthonormalise, project_out};
use crate::progress::Progress;
use crate::reality::JointTrial;
use crate::task::Scene;
use crate::world::mechanism::{JointTerm, Tree, scene_terms};

/// Products of responses to effects, by trial, in units of the noise, with initial states projected out.
pub struct ExcitationInformation {
    /// Effects, in joints that can have them.
    pub effects: Vec<JointTerm>,
    /// Columns of each effect's sizes, of plausible size each.
    pub columns: Vec<std::ops::Range<usize>>,
    /// By trial: products of all columns; those after the effects' are the shared discrepancy's, of plausible size.
    pub products: Vec<DMatrix<f64>>,
}

/// The information of simulated trials about the effects that a scene may lack, or about those in `wanted`, as (effect, joint);
/// `noise`: standard deviation of measured positions, rad or m.
pub fn information(
    scene: &Scene,
    trials: &[JointTrial],
    wanted: &[(String, String)],
    noise: f64,
    progress: &dyn Progress,
) -> Result<ExcitationInformation> {
    let tree = Tree::of(scene)?;
    let mut recording = JointRecording::new(&tree, scene_terms(scene, &tree)?, trials)?;
    recording.noise.fill(noise);
    let states = recording.initial_states();
    let base = recording.linearise(&[], &states).ok_or_else(not_simulable)?;
    let effects = effects(&recording, wanted)?;
    let shared = discrepancy(&recording, &Vec::new(), &states).ok_or_else(not_simulable)?;
    let nuisances: Vec<DMatrix<f64>> = recording
        .segments
        .iter()
        .zip(&base)
        .map(|(segment, own)| orthonormalise(&recording.white(segment, &own.nuisances)).0)
        .collect();
    let project = |w: usize, white: &DMatrix<f64>| project_out(&nuisances[w], white);
    // By segment: responses side by side.
    let mut responses: Vec<Vec<DMatrix<f64>>> = vec![Vec::new(); recording.segments.len()];
    let (mut columns, mut first) = (Vec::new(), 0);
    for (k, effect) in effects.iter().enumerate() {
        progress.report("responses to effects", k as u64, effects.len() as u64)?;
        let own = sensitivities(&recording, effect, &states)?;
        first += own[0].ncols();
        columns.push(first - own[0].ncols()..first);
        own.into_iter().enumerate().for_each(|(w, own)| responses[w].push(project(w, &own)));
    }
    let count = first + shared.responses[0].ncols();
    let mut products = vec![DMatrix::zeros(count, count); trials.len()];
    for (w, (mut own, shared)) in responses.into_iter().zip(shared.responses).enumerate() {
        own.push(project(w, &shared));
        let all: Vec<_> = own.iter().flat_map(DMatrix::column_iter).collect();
        let all = DMatrix::from_columns(&all);
        products[recording.segments[w].trial] += all.tr_mul(&all);
    }
    Ok(ExcitationInformation { effects, columns, products })
}

/// The effects that joints can have, of no size; those in `wanted` alone if there are any.
fn effects(recording: &JointRecording, wanted: &[(String, String)]) -> Result<Vec<JointTerm>> {
    let all = candidates(recording).into_iter().map(|candidate| {
        let JointTerm { effect, joint, .. } = candidate.starts[0];
        effect.neutral(joint)
    });
    let all: Vec<JointTerm> = all.collect();
    let name = |t: &JointTerm| effect_in_joint(t.effect.name, &recording.tree.names[t.joint]);
    let names: Vec<String> = all.iter().map(name).collect();
    let wanted: Vec<String> = wanted.iter().map(|(effect, joint)| effect_in_joint(effect, joint)).collect();
    if let Some(unknown) = wanted.iter().find(|name| !names.contains(name)) {
        return Err(Error::not_found("effect in joints", unknown, names.iter().map(String::as_str)));
    }
    let is_wanted = |name: &String| wanted.is_empty() || wanted.contains(name);
    Ok(all.into_iter().zip(names).filter(|(_, name)| is_wanted(name)).map(|(term, _)| term).collect())
}

/// By segment, in white coordinates: responses to the sizes of an effect, of plausible size each. They are those of a small effect, or
/// where a small one has none, as a limit that is not reached, of a plausible one.
fn sensitivities(
    recording: &JointRecording,
    effect: &JointTerm,
    states: &[Vec<f64>],
) -> Result<Vec<DMatrix<f64>>> {
    let at = |term: &JointTerm| -> Result<Vec<DMatrix<f64>>> {
        let terms = std::slice::from_ref(term);
        let sizes = sizes(recording, effect);
        let own = recording.linearise(terms, states).ok_or_else(not_simulable)?;
        let scaled = |(segment, own): (&JointSegment, &JointLinearization)| {
            let white = recording.white(segment, &own.jacobian);
            let columns: Vec<_> = sizes.iter().map(|(k, _, size)| white.column(*k) * *size).collect();
            DMatrix::from_columns(&columns)
        };
        Ok(recording.segments.iter().zip(&own).map(scaled).collect())
    };
    let small = at(effect)?;
    if small.iter().any(|own| own.iter().any(|v| *v != 0.0)) {
        return Ok(small);
    }
    let mut plausible = effect.clone();
    for (_, parameter, size) in sizes(recording, effect) {
        let declared = &effect.effect.parameters[parameter];
        let up = declared.neutral + size <= declared.bounds[1];
        plausible.values[parameter] = declared.neutral + if up { size } else { -size };
    }
    at(&plausible)
}

/// Parameters of an effect that are sizes, not the shape of its law: column of the linearization, index, plausible size.
fn sizes(recording: &JointRecording, effect: &JointTerm) -> Vec<(usize, usize, f64)> {
    let terms = std::slice::from_ref(effect);
    let is_size = |p: usize| p == 0 || effect.effect.parameters[p].neutral == 0.0;
    let all = slots(terms).into_iter().enumerate().filter(|(_, slot)| is_size(slot.parameter));
    all.map(|(k, slot)| (k, slot.parameter, recording.plausible(terms, slot))).collect()
}
