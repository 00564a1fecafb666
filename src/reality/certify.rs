//! Certification of tasks: the share of actions that solve a candidate, and one solution that is stable under small perturbations.
//!
//! Source: PHYRE (Bakhtin et al. 2019) keeps a task only if it has a solution that is stable under small perturbations of the action.
//! This module is part of `reality` because actions are evaluated in the family's real world.

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use super::hidden::certification_world;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::rng::{self, Stream};
use crate::task::scene::EffectTerm;
use crate::task::{
    CANDIDATE_SEED, CERTIFIED_FORMAT, CandidateDraws, Certificate, CertifiedRow, CertifiedTasks, Family,
    Placement, Scene, SolvingShareBin, ValidAction,
};
use crate::world::{Engine, Latents, Rollout, Simulator};

/// Number of perturbed copies that must also solve the task when a certificate is checked.
pub const PERTURBATIONS: usize = 8;
/// Number of perturbed copies that must solve the task for certification. It exceeds [`PERTURBATIONS`] to correct for selection: the
/// first of many actions to pass few copies often passes by chance.
const CERTIFICATION_PERTURBATIONS: usize = 40;
/// Maximum change of an action's component in a perturbed copy: 0.5 px of a scene 256 px wide.
pub const MAX_PERTURBATION: f64 = 0.002;
/// Maximum number of solutions checked for stability per candidate.
const MAX_STABILITY_CHECKS: usize = 150;
/// Solving share, in the world to which the bins do not apply, above which a candidate is trivial there.
const MAX_TRIVIAL_SOLVING_SHARE: f64 = 0.5;
/// Number of actions for the initial screening of a candidate.
const SCREENING_ACTIONS: usize = 200;

/// Selects the family's tasks: assigns candidates in order to the bins of their solving shares until all bins are full.
pub fn certify(family: &Family, seed: u64, progress: &dyn Progress) -> Result<CertifiedTasks> {
    let mut search = CertificationSearch::new(family, seed, family.selection.n_tasks())?;
    loop {
        progress.report("certifying tasks", search.certified_count() as u64, search.wanted as u64)?;
        if search.step()?.is_none() {
            break;
        }
    }
    if search.certified_count() < search.wanted {
        return Err(Error::Failed(format!(
            "certified only {} of {} tasks of {}",
            search.certified_count(),
            search.wanted,
            family.name
        )));
    }
    Ok(search.certified())
}

/// Outcome of a candidate's evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CertificationOutcome {
    /// The scene is invalid, for example because objects overlap.
    NoScene,
    /// No sampled valid action solves it, or there is no valid action.
    Unsolvable,
    /// The solving share is below the first bin.
    TooHard,
    /// The solving share is above the last bin.
    TooEasy,
    /// The candidate is trivial in the other of the two worlds (with or without the real world's effects).
    ByItself,
    /// The solving share lies between bins or in a full bin.
    NotWanted,
    /// No checked solution is stable under perturbations.
    Unstable,
    /// Certified as a task.
    Certified,
}

/// Result of a candidate's evaluation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CandidateResult {
    /// Index of the candidate.
    pub candidate: usize,
    /// Outcome of the evaluation.
    pub outcome: CertificationOutcome,
    /// Share of valid actions that solve it, from the screening or the full sample.
    pub share: f64,
    /// Bin of a certified candidate.
    pub bin: Option<usize>,
    /// Certificate of a certified candidate.
    pub certificate: Option<Certificate>,
}

/// Search for a family's tasks, candidate by candidate; it can be resumed from earlier results.
pub struct CertificationSearch<'a> {
    family: &'a Family,
    seed: u64,
    wanted: usize,
    draws: CandidateDraws,
    /// Open slots of each bin.
    room: Vec<usize>,
    judged: Vec<CandidateResult>,
}

impl<'a> CertificationSearch<'a> {
    /// A search for `wanted` tasks, distributed over the family's bins in proportion to their sizes.
    pub fn new(family: &'a Family, seed: u64, wanted: usize) -> Result<CertificationSearch<'a>> {
        let draws = family.draws(CANDIDATE_SEED)?;
        let bins: Vec<usize> = family.selection.bins.iter().map(|b| b.tasks).collect();
        Ok(CertificationSearch {
            family,
            seed,
            wanted,
            draws,
            room: distribute(&bins, wanted),
            judged: Vec::new(),
        })
    }

    /// Results so far.
    pub fn results(&self) -> &[CandidateResult] {
        &self.judged
    }

    /// Open slots of each bin.
    pub fn open_slots(&self) -> &[usize] {
        &self.room
    }

    /// Number of certified tasks so far.
    pub fn certified_count(&self) -> usize {
        self.wanted - self.room.iter().sum::<usize>()
    }

    /// The candidates, and the reasons for rejected draws.
    pub fn draws(&self) -> &CandidateDraws {
        &self.draws
    }

    /// Adds the result of the next candidate from an earlier search with the same seed.
    pub fn resume_with(&mut self, judged: CandidateResult) -> Result<()> {
        let next = self.judged.len();
        let known = judged.bin.is_none_or(|b| b < self.room.len() && self.room[b] > 0);
        let whole = (judged.outcome == CertificationOutcome::Certified) == (judged.certificate.is_some());
        if judged.candidate != next || next >= self.draws.candidates.len() || !known || !whole {
            let allowed = format!("candidate {next} of this search");
            return Err(Error::input("candidate", judged.candidate, allowed));
        }
        if let (CertificationOutcome::Certified, Some(bin)) = (judged.outcome, judged.bin) {
            self.room[bin] -= 1;
        }
        self.judged.push(judged);
        Ok(())
    }

    /// Evaluates the next candidate; `None` if all bins are full or no candidate is left.
    pub fn step(&mut self) -> Result<Option<&CandidateResult>> {
        let candidate = self.judged.len();
        if self.certified_count() == self.wanted || candidate >= self.draws.candidates.len() {
            return Ok(None);
        }
        let judged = match self.family.scene(&self.draws.candidates[candidate]) {
            Ok(scene) => self.evaluate_candidate(candidate, &scene)?,
            Err(_) => self.rejected(candidate, CertificationOutcome::NoScene, 0.0),
        };
        self.resume_with(judged)?;
        Ok(self.judged.last())
    }

    /// The certified tasks in their file format.
    pub fn certified(&self) -> CertifiedTasks {
        let row = |j: &CandidateResult| {
            let certificate = j.certificate.clone()?;
            Some(CertifiedRow { candidate: j.candidate, certificate })
        };
        CertifiedTasks {
            format: CERTIFIED_FORMAT.into(),
            family: self.family.name.into(),
            digest: self.family.digest.clone(),
            rows: self.judged.iter().filter_map(row).collect(),
        }
    }

    fn evaluate_candidate(&self, candidate: usize, scene: &Scene) -> Result<CandidateResult> {
        let selection = &self.family.selection;
        let real = certification_world(self.family);
        let physics = |in_real: bool| CandidatePhysics {
            latents: real.latents,
            effects: if in_real { &real.effects } else { &[] },
            engine: real.engine,
        };
        let own = rng::derive_seed(self.seed, "certify", candidate as u64);
        let judged = physics(selection.in_real_world);
        // Screening first: most candidates fall into full bins.
        let rough = sample(scene, SCREENING_ACTIONS, &mut rng::stream(own, "rough"), judged)?.share();
        let near = |b: &SolvingShareBin| rough > b.from / 2.0 - 0.004 && rough < b.to * 1.3 + 0.004;
        if !selection.bins.iter().zip(&self.room).any(|(b, left)| *left > 0 && near(b)) {
            return Ok(self.rejected(candidate, self.rejection_outcome(rough), rough));
        }
        let actions = selection.sample;
        let mut judged = sample(scene, actions, &mut rng::stream(own, "share"), judged)?;
        let share = judged.share();
        let holds = |b: &SolvingShareBin| (b.from..=b.to).contains(&share);
        let Some(bin) = selection.bins.iter().position(holds).filter(|b| self.room[*b] > 0) else {
            return Ok(self.rejected(candidate, self.rejection_outcome(share), share));
        };
        let mut other =
            sample(scene, actions, &mut rng::stream(own, "share"), physics(!selection.in_real_world))?;
        // If the last bin includes trivial candidates, they are allowed.
        if other.share() > MAX_TRIVIAL_SOLVING_SHARE
            && selection.bins.iter().all(|b| b.to <= MAX_TRIVIAL_SOLVING_SHARE)
        {
            return Ok(self.rejected(candidate, CertificationOutcome::ByItself, share));
        }
        if !selection.in_real_world {
            std::mem::swap(&mut judged, &mut other);
        }
        let (in_real, undamped) = (judged, other);
        let mut stream = rng::stream(own, "perturb");
        // The scene author's solutions come first.
        let said = self.family.solutions(&self.draws.candidates[candidate]);
        let solutions =
            said.iter().take(MAX_STABILITY_CHECKS).chain(in_real.solutions.iter().take(MAX_STABILITY_CHECKS));
        let Some(action) = stable(scene, solutions, &mut stream, physics(true))? else {
            return Ok(self.rejected(candidate, CertificationOutcome::Unstable, share));
        };
        let certificate = Certificate {
            action: action.values().to_vec(),
            seed: own,
            solving_share: in_real.share(),
            solving_share_undamped: undamped.share(),
        };
        Ok(CandidateResult {
            candidate,
            outcome: CertificationOutcome::Certified,
            share,
            bin: Some(bin),
            certificate: Some(certificate),
        })
    }

    fn rejected(&self, candidate: usize, outcome: CertificationOutcome, share: f64) -> CandidateResult {
        CandidateResult { candidate, outcome, share, bin: None, certificate: None }
    }

    /// Outcome of a candidate whose share is in no open bin.
    fn rejection_outcome(&self, share: f64) -> CertificationOutcome {
        let bins = &self.family.selection.bins;
        match (bins.first(), bins.last()) {
            _ if share == 0.0 => CertificationOutcome::Unsolvable,
            (Some(first), _) if share < first.from => CertificationOutcome::TooHard,
            (_, Some(last)) if share > last.to => CertificationOutcome::TooEasy,
            _ => CertificationOutcome::NotWanted,
        }
    }
}

/// Distributes `wanted` in proportion to `bins`, one at a time to the bin that is furthest behind.
fn distribute(bins: &[usize], wanted: usize) -> Vec<usize> {
    let total: usize = bins.iter().sum();
    let mut given = vec![0; bins.len()];
    for n in 1..=wanted {
        let behind = |i: usize| (bins[i] * n) as i64 - (given[i] * total) as i64;
        // Ties go to the first bin.
        if let Some(next) = (0..bins.len()).rev().max_by_key(|i| behind(*i)) {
            given[next] += 1;
        }
    }
    given
}

/// Whether an action and its perturbed copies solve a scene in the family's real world, on `engine`.
pub fn is_certificate_valid(
    family: &Family,
    scene: &Scene,
    certificate: &Certificate,
    engine: Engine,
) -> Result<bool> {
    let real = certification_world(family);
    let physics = CandidatePhysics { latents: real.latents, effects: &real.effects, engine };
    let space = scene.action.as_ref().expect("a candidate has an action space");
    let action = space.validate(&certificate.action)?;
    survives(scene, &action, PERTURBATIONS, &mut rng::stream(certificate.seed, "recheck"), physics)
}

/// Whether each action solves a scene in the family's real world; `None` if it cannot be placed.
pub fn solving_actions(family: &Family, scene: &Scene, actions: &[ValidAction]) -> Result<Vec<Option<bool>>> {
    let real = certification_world(family);
    let physics = CandidatePhysics { latents: real.latents, effects: &real.effects, engine: real.engine };
    let space = scene.action.as_ref().expect("a candidate has an action space");
    let place = |action| match space.place(scene, action) {
        Placement::Valid(placed) => Some(placed),
        Placement::Invalid(_) => None,
    };
    let placed: Vec<Option<Box<Scene>>> = actions.iter().map(place).collect();
    let scenes: Vec<&Scene> = placed.iter().flatten().map(Box::as_ref).collect();
    let mut solved = solved(&scenes, physics)?.into_iter();
    Ok(placed.iter().map(|p| p.as_ref().and_then(|_| solved.next())).collect())
}

#[derive(Clone, Copy)]
struct CandidatePhysics<'a> {
    latents: Latents,
    effects: &'a [EffectTerm],
    engine: Engine,
}

struct ActionSample {
    valid: usize,
    solutions: Vec<ValidAction>,
}

impl ActionSample {
    fn share(&self) -> f64 {
        self.solutions.len() as f64 / self.valid.max(1) as f64
    }
}

/// Evaluates random discrete actions until `count` of them are valid.
fn sample(
    scene: &Scene,
    count: usize,
    stream: &mut Stream,
    physics: CandidatePhysics,
) -> Result<ActionSample> {
    let space = scene.action.as_ref().expect("a candidate has an action space");
    let mut order: Vec<usize> = (0..space.count()).collect();
    order.shuffle(stream);
    let mut placed = Vec::with_capacity(count);
    for index in order {
        if placed.len() == count {
            break;
        }
        let action = space.at(index)?;
        if let Placement::Valid(scene) = space.place(scene, &action) {
            placed.push((action, scene));
        }
    }
    let scenes: Vec<&Scene> = placed.iter().map(|(_, s)| s.as_ref()).collect();
    let solved = solved(&scenes, physics)?;
    let valid = placed.len();
    let solutions = placed.into_iter().zip(solved).filter(|(_, s)| *s).map(|((a, _), _)| a).collect();
    Ok(ActionSample { valid, solutions })
}

/// The first solution that is stable under perturbations.
fn stable<'a>(
    scene: &Scene,
    solutions: impl Iterator<Item = &'a ValidAction>,
    stream: &mut Stream,
    physics: CandidatePhysics,
) -> Result<Option<ValidAction>> {
    for action in solutions {
        if !survives(scene, action, CERTIFICATION_PERTURBATIONS, stream, physics)? {
            continue;
        }
        // The solution must also solve the task in the other engine.
        let space = scene.action.as_ref().expect("a candidate has an action space");
        if let Placement::Valid(placed) = space.place(scene, action)
            && solved(&[&placed], CandidatePhysics { engine: Engine::Rapier, ..physics })?[0]
        {
            return Ok(Some(action.clone()));
        }
    }
    Ok(None)
}

/// Whether an action and `copies` perturbed copies of it are valid and solve the scene.
fn survives(
    scene: &Scene,
    action: &ValidAction,
    copies: usize,
    stream: &mut Stream,
    physics: CandidatePhysics,
) -> Result<bool> {
    let space = scene.action.as_ref().expect("a candidate has an action space");
    let mut scenes = Vec::new();
    for copy in 0..=copies {
        let size = if copy == 0 { 0.0 } else { MAX_PERTURBATION };
        match space.place(scene, &action.perturbed(size, stream)) {
            Placement::Valid(placed) => scenes.push(placed),
            Placement::Invalid(_) => return Ok(false),
        }
    }
    let scenes: Vec<&Scene> = scenes.iter().map(|s| s.as_ref()).collect();
    Ok(solved(&scenes, physics)?.into_iter().all(|s| s))
}

fn solved(scenes: &[&Scene], physics: CandidatePhysics) -> Result<Vec<bool>> {
    let rollouts: Vec<Rollout> = scenes
        .iter()
        .map(|scene| Rollout { latents: physics.latents, effects: physics.effects, ..Rollout::of(scene) })
        .collect();
    Simulator::new(physics.engine).solved(&rollouts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distributes_tasks_in_proportion_to_bins() {
        assert_eq!(distribute(&[20, 20, 20, 20, 20], 100), [20; 5]);
        assert_eq!(distribute(&[20, 20, 20, 20, 20], 3), [1, 1, 1, 0, 0]);
        assert_eq!(distribute(&[1, 3], 8), [2, 6]);
        assert_eq!(distribute(&[25], 4), [4]);
    }
}
