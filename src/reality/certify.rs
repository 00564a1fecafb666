//! Certifying tasks: how many actions solve a candidate, and one solution that survives small perturbations.
//!
//! Source: PHYRE (Bakhtin et al. 2019) keeps a task only if it has a solution that still solves when the
//! action is perturbed a little. It stands here because the family's real world is needed to try actions in.

use rand::RngExt;
use rand::seq::SliceRandom;

use super::hidden::standard;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::rng::{self, Stream};
use crate::task::scene::EffectTerm;
use crate::task::{CANDIDATE_SEED, Certificate, CertifiedRow, Family, Placement, Scene, ValidAction};
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
/// Actions of the first, rough look at a candidate.
const ROUGH: usize = 200;

/// Picks the family's tasks: candidates in order, each into the bin its share falls into, until all are full.
pub fn certify(family: &Family, seed: u64, progress: &dyn Progress) -> Result<Vec<CertifiedRow>> {
    let real = standard(family);
    let physics = |in_real: bool| Physics {
        latents: real.latents,
        effects: if in_real { &real.effects } else { &[] },
        engine: real.engine,
    };
    let mut room: Vec<usize> = family.selection.bins.iter().map(|b| b.2).collect();
    let wanted: usize = room.iter().sum();
    let bin_of = |share: f64| family.selection.bins.iter().position(|b| (b.0..=b.1).contains(&share));
    let mut rows = Vec::new();
    for (candidate, scene) in (family.candidates)(CANDIDATE_SEED).iter().enumerate() {
        progress.report("certifying tasks", rows.len() as u64, wanted as u64)?;
        if rows.len() == wanted {
            break;
        }
        let own = rng::derive(seed, "certify", candidate as u64);
        let judged = physics(family.selection.in_real_world);
        // A rough share first: most candidates fall into bins that are full.
        let rough = sample(scene, ROUGH, &mut rng::stream(own, "rough"), judged)?.share();
        let near = |b: &(f64, f64, usize)| rough > b.0 / 2.0 - 0.004 && rough < b.1 * 1.3 + 0.004;
        if !family.selection.bins.iter().zip(&room).any(|(b, left)| *left > 0 && near(b)) {
            continue;
        }
        let actions = family.selection.sample;
        let mut judged = sample(scene, actions, &mut rng::stream(own, "share"), judged)?;
        let Some(bin) = bin_of(judged.share()).filter(|b| room[*b] > 0) else { continue };
        let mut other =
            sample(scene, actions, &mut rng::stream(own, "share"), physics(!family.selection.in_real_world))?;
        if !family.selection.in_real_world {
            std::mem::swap(&mut judged, &mut other);
        }
        let (in_real, undamped) = (judged, other);
        let mut stream = rng::stream(own, "perturb");
        let Some(action) = stable(scene, &in_real.solutions, &mut stream, physics(true))? else { continue };
        room[bin] -= 1;
        rows.push(CertifiedRow {
            candidate,
            certificate: Certificate {
                action: action.values().to_vec(),
                seed: own,
                solving_share: in_real.share(),
                solving_share_undamped: undamped.share(),
            },
        });
    }
    if rows.len() < wanted {
        return Err(Error::Failed(format!(
            "only {} of {wanted} tasks of {} could be certified",
            rows.len(),
            family.name
        )));
    }
    rows.sort_by_key(|r| r.candidate);
    Ok(rows)
}

/// Whether an action and its perturbed copies solve a scene in the family's real world, on `engine`.
pub fn holds(family: &Family, scene: &Scene, certificate: &Certificate, engine: Engine) -> Result<bool> {
    let real = standard(family);
    let physics = Physics { latents: real.latents, effects: &real.effects, engine };
    let space = scene.action.as_ref().expect("a candidate has an action space");
    let action = space.validate(&certificate.action)?;
    survives(scene, &action, PERTURBATIONS, &mut rng::stream(certificate.seed, "recheck"), physics)
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
fn stable(
    scene: &Scene,
    solutions: &[ValidAction],
    stream: &mut Stream,
    physics: Physics,
) -> Result<Option<ValidAction>> {
    for action in solutions.iter().take(TRIED) {
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
        let moved: Vec<f64> = action
            .values()
            .iter()
            .map(|v| (v + size * (2.0 * stream.random::<f64>() - 1.0)).clamp(0.0, 1.0))
            .collect();
        match space.place(scene, &space.validate(&moved)?) {
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
        .map(|scene| Rollout { scene, latents: physics.latents, effects: physics.effects, stop: true })
        .collect();
    simulate_map(&rollouts, physics.engine, |_, t| t.solved())
}
