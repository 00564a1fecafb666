//! Certifying tasks: how many actions solve a candidate, and one solution that survives small perturbations.
//!
//! Source: PHYRE (Bakhtin et al. 2019) keeps a task only if it has a solution that still solves when the
//! action is perturbed a little. It stands here because the family's real world is needed to try actions in.

use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use super::hidden::standard;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::rng::{self, Stream};
use crate::task::scene::EffectTerm;
use crate::task::{
    Bin, CANDIDATE_SEED, CERTIFIED_FORMAT, Certificate, Certified, CertifiedRow, Draws, Family, Placement,
    Scene, ValidAction,
};
use crate::world::{Engine, Latents, Rollout, simulate_map};

/// Perturbed copies of a certified action that must solve too, whenever a certificate is checked.
pub const PERTURBATIONS: usize = 8;
/// Perturbed copies that must solve for an action to be certified. More than are checked later: the first of many
/// actions to survive few copies would often owe it to luck.
const SEARCHED: usize = 40;
/// Largest change of an action's component in a perturbed copy: 0.5 px of a scene 256 px wide.
pub const PERTURBATION: f64 = 0.002;
/// Solutions tried for stability before a candidate is given up.
const TRIED: usize = 150;
/// Share of actions, in the world that bins are not about, beyond which a candidate solves itself there.
const BY_ITSELF: f64 = 0.5;
/// Actions of the first, rough look at a candidate.
const ROUGH: usize = 200;

/// Picks the family's tasks: candidates in order, each into the bin its share falls into, until all are full.
pub fn certify(family: &Family, seed: u64, progress: &dyn Progress) -> Result<Certified> {
    let mut search = Search::new(family, seed, family.selection.wanted())?;
    loop {
        progress.report("certifying tasks", search.found() as u64, search.wanted as u64)?;
        if search.step()?.is_none() {
            break;
        }
    }
    if search.found() < search.wanted {
        return Err(Error::Failed(format!(
            "only {} of {} tasks of {} could be certified",
            search.found(),
            search.wanted,
            family.name
        )));
    }
    Ok(search.certified())
}

/// What became of a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Its scene cannot stand: things overlap, say.
    NoScene,
    /// None of the sampled valid actions solves it, or there is none.
    Unsolvable,
    /// Fewer actions solve it than the first bin asks for.
    TooHard,
    /// More actions solve it than the last bin allows.
    TooEasy,
    /// In the other of the two worlds, with or without what the real one has, it all but solves itself.
    ByItself,
    /// Its share falls between bins, or into one that is full.
    NotWanted,
    /// Actions solve it, but none that was tried goes on to if it is perturbed.
    Unstable,
    /// It is a task.
    Certified,
}

/// A candidate that was looked at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Judged {
    /// Its number.
    pub candidate: usize,
    /// What became of it.
    pub outcome: Outcome,
    /// Share of valid actions that solve it, from as many as were needed to know.
    pub share: f64,
    /// Its bin, where it has one.
    pub bin: Option<usize>,
    /// The evidence, if it is a task.
    pub certificate: Option<Certificate>,
}

/// A search for a family's tasks, candidate by candidate; it can go on from what an earlier one found.
pub struct Search<'a> {
    family: &'a Family,
    seed: u64,
    wanted: usize,
    draws: Draws,
    /// Tasks that each bin still wants.
    room: Vec<usize>,
    judged: Vec<Judged>,
}

impl<'a> Search<'a> {
    /// A search for so many tasks, spread over the family's bins as it says.
    pub fn new(family: &'a Family, seed: u64, wanted: usize) -> Result<Search<'a>> {
        let draws = family.draws(CANDIDATE_SEED)?;
        let bins: Vec<usize> = family.selection.bins.iter().map(|b| b.tasks).collect();
        Ok(Search { family, seed, wanted, draws, room: spread(&bins, wanted), judged: Vec::new() })
    }

    /// What was looked at so far.
    pub fn judged(&self) -> &[Judged] {
        &self.judged
    }

    /// Tasks that each bin still wants.
    pub fn room(&self) -> &[usize] {
        &self.room
    }

    /// Tasks found so far.
    pub fn found(&self) -> usize {
        self.wanted - self.room.iter().sum::<usize>()
    }

    /// The candidates' numbers, and why other draws are none.
    pub fn draws(&self) -> &Draws {
        &self.draws
    }

    /// Takes over what an earlier search with the same seed found of the next candidate.
    pub fn take(&mut self, judged: Judged) -> Result<()> {
        let next = self.judged.len();
        let known = judged.bin.is_none_or(|b| b < self.room.len() && self.room[b] > 0);
        let whole = (judged.outcome == Outcome::Certified) == (judged.certificate.is_some());
        if judged.candidate != next || next >= self.draws.candidates.len() || !known || !whole {
            let allowed = format!("candidate {next} of this search");
            return Err(Error::input("candidate", judged.candidate, allowed));
        }
        if let (Outcome::Certified, Some(bin)) = (judged.outcome, judged.bin) {
            self.room[bin] -= 1;
        }
        self.judged.push(judged);
        Ok(())
    }

    /// Looks at the next candidate; `None` if all bins are full or there are no more.
    pub fn step(&mut self) -> Result<Option<&Judged>> {
        let candidate = self.judged.len();
        if self.found() == self.wanted || candidate >= self.draws.candidates.len() {
            return Ok(None);
        }
        let judged = match self.family.scene(&self.draws.candidates[candidate]) {
            Ok(scene) => self.judge(candidate, &scene)?,
            Err(_) => self.saying(candidate, Outcome::NoScene, 0.0),
        };
        self.take(judged)?;
        Ok(self.judged.last())
    }

    /// The tasks found, as their file has them.
    pub fn certified(&self) -> Certified {
        let row = |j: &Judged| {
            let certificate = j.certificate.clone()?;
            Some(CertifiedRow { candidate: j.candidate, certificate })
        };
        Certified {
            format: CERTIFIED_FORMAT.into(),
            family: self.family.name.into(),
            digest: self.family.digest.clone(),
            rows: self.judged.iter().filter_map(row).collect(),
        }
    }

    fn judge(&self, candidate: usize, scene: &Scene) -> Result<Judged> {
        let selection = &self.family.selection;
        let real = standard(self.family);
        let physics = |in_real: bool| Physics {
            latents: real.latents,
            effects: if in_real { &real.effects } else { &[] },
            engine: real.engine,
        };
        let own = rng::derive(self.seed, "certify", candidate as u64);
        let judged = physics(selection.in_real_world);
        // A rough share first: most candidates fall into bins that are full.
        let rough = sample(scene, ROUGH, &mut rng::stream(own, "rough"), judged)?.share();
        let near = |b: &Bin| rough > b.from / 2.0 - 0.004 && rough < b.to * 1.3 + 0.004;
        if !selection.bins.iter().zip(&self.room).any(|(b, left)| *left > 0 && near(b)) {
            return Ok(self.saying(candidate, self.unwanted(rough), rough));
        }
        let actions = selection.sample;
        let mut judged = sample(scene, actions, &mut rng::stream(own, "share"), judged)?;
        let share = judged.share();
        let holds = |b: &Bin| (b.from..=b.to).contains(&share);
        let Some(bin) = selection.bins.iter().position(holds).filter(|b| self.room[*b] > 0) else {
            return Ok(self.saying(candidate, self.unwanted(share), share));
        };
        let mut other =
            sample(scene, actions, &mut rng::stream(own, "share"), physics(!selection.in_real_world))?;
        // Where the last bin takes what everything solves, that is wanted.
        if other.share() > BY_ITSELF && selection.bins.iter().all(|b| b.to <= BY_ITSELF) {
            return Ok(self.saying(candidate, Outcome::ByItself, share));
        }
        if !selection.in_real_world {
            std::mem::swap(&mut judged, &mut other);
        }
        let (in_real, undamped) = (judged, other);
        let mut stream = rng::stream(own, "perturb");
        // What whoever wrote the scene says solves it comes first.
        let said = self.family.solutions(&self.draws.candidates[candidate]);
        let solutions = said.iter().take(TRIED).chain(in_real.solutions.iter().take(TRIED));
        let Some(action) = stable(scene, solutions, &mut stream, physics(true))? else {
            return Ok(self.saying(candidate, Outcome::Unstable, share));
        };
        let certificate = Certificate {
            action: action.values().to_vec(),
            seed: own,
            solving_share: in_real.share(),
            solving_share_undamped: undamped.share(),
        };
        Ok(Judged {
            candidate,
            outcome: Outcome::Certified,
            share,
            bin: Some(bin),
            certificate: Some(certificate),
        })
    }

    fn saying(&self, candidate: usize, outcome: Outcome, share: f64) -> Judged {
        Judged { candidate, outcome, share, bin: None, certificate: None }
    }

    /// What a candidate is whose share no bin wants.
    fn unwanted(&self, share: f64) -> Outcome {
        let bins = &self.family.selection.bins;
        match (bins.first(), bins.last()) {
            _ if share == 0.0 => Outcome::Unsolvable,
            (Some(first), _) if share < first.from => Outcome::TooHard,
            (_, Some(last)) if share > last.to => Outcome::TooEasy,
            _ => Outcome::NotWanted,
        }
    }
}

/// `wanted` spread in proportion to `bins`: one after the other to the bin that is furthest behind.
fn spread(bins: &[usize], wanted: usize) -> Vec<usize> {
    let total: usize = bins.iter().sum();
    let mut given = vec![0; bins.len()];
    for n in 1..=wanted {
        let behind = |i: usize| (bins[i] * n) as i64 - (given[i] * total) as i64;
        // The first of equals.
        if let Some(next) = (0..bins.len()).rev().max_by_key(|i| behind(*i)) {
            given[next] += 1;
        }
    }
    given
}

/// Whether an action and its perturbed copies solve a scene in the family's real world, on `engine`.
pub fn holds(family: &Family, scene: &Scene, certificate: &Certificate, engine: Engine) -> Result<bool> {
    let real = standard(family);
    let physics = Physics { latents: real.latents, effects: &real.effects, engine };
    let space = scene.action.as_ref().expect("a candidate has an action space");
    let action = space.validate(&certificate.action)?;
    survives(scene, &action, PERTURBATIONS, &mut rng::stream(certificate.seed, "recheck"), physics)
}

/// Which actions solve a scene in the family's real world; `None` for what cannot be placed.
pub fn tried(family: &Family, scene: &Scene, actions: &[ValidAction]) -> Result<Vec<Option<bool>>> {
    let real = standard(family);
    let physics = Physics { latents: real.latents, effects: &real.effects, engine: real.engine };
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
struct Physics<'a> {
    latents: Latents,
    effects: &'a [EffectTerm],
    engine: Engine,
}

struct Sampled {
    valid: usize,
    solutions: Vec<ValidAction>,
}

impl Sampled {
    fn share(&self) -> f64 {
        self.solutions.len() as f64 / self.valid.max(1) as f64
    }
}

/// Tries random discrete actions until `count` valid ones have been.
fn sample(scene: &Scene, count: usize, stream: &mut Stream, physics: Physics) -> Result<Sampled> {
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
    Ok(Sampled { valid, solutions })
}

/// The first solution that survives its perturbations.
fn stable<'a>(
    scene: &Scene,
    solutions: impl Iterator<Item = &'a ValidAction>,
    stream: &mut Stream,
    physics: Physics,
) -> Result<Option<ValidAction>> {
    for action in solutions {
        if !survives(scene, action, SEARCHED, stream, physics)? {
            continue;
        }
        // The solution itself must be one to the other engine too.
        let space = scene.action.as_ref().expect("a candidate has an action space");
        if let Placement::Valid(placed) = space.place(scene, action)
            && solved(&[&placed], Physics { engine: Engine::Rapier, ..physics })?[0]
        {
            return Ok(Some(action.clone()));
        }
    }
    Ok(None)
}

/// Whether an action and so many perturbed copies of it are valid and solve.
fn survives(
    scene: &Scene,
    action: &ValidAction,
    copies: usize,
    stream: &mut Stream,
    physics: Physics,
) -> Result<bool> {
    let space = scene.action.as_ref().expect("a candidate has an action space");
    let mut scenes = Vec::new();
    for copy in 0..=copies {
        let size = if copy == 0 { 0.0 } else { PERTURBATION };
        match space.place(scene, &action.trembled(size, stream)) {
            Placement::Valid(placed) => scenes.push(placed),
            Placement::Invalid(_) => return Ok(false),
        }
    }
    let scenes: Vec<&Scene> = scenes.iter().map(|s| s.as_ref()).collect();
    Ok(solved(&scenes, physics)?.into_iter().all(|s| s))
}

fn solved(scenes: &[&Scene], physics: Physics) -> Result<Vec<bool>> {
    let rollouts: Vec<Rollout> = scenes
        .iter()
        .map(|scene| Rollout { latents: physics.latents, effects: physics.effects, ..Rollout::of(scene) })
        .collect();
    simulate_map(&rollouts, physics.engine, |_, t| t.solved())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_are_spread_as_bins_are() {
        assert_eq!(spread(&[20, 20, 20, 20, 20], 100), [20; 5]);
        assert_eq!(spread(&[20, 20, 20, 20, 20], 3), [1, 1, 1, 0, 0]);
        assert_eq!(spread(&[1, 3], 8), [2, 6]);
        assert_eq!(spread(&[25], 4), [4]);
    }
}
