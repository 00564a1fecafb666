//! Selection of actions for real-world trials.
//!
//! Source: Semage et al., section on action selection: candidate actions are simulated at the current estimate
//! and ranked by how informative they are. A strategy is one file and one row in [`REGISTRY`].

mod candidate;
mod collisions;
mod gradient;
mod informative;
mod mixed;
mod random;
mod rolling;
mod strategy;

use crate::error::{Error, Result};
pub(crate) use candidate::draw_placeable;
pub use candidate::{ActionCandidate, CandidateSimulation, informative_collisions, simulate_candidates};
use strategy::rank_by;
pub use strategy::{
    AcquisitionContext, ActionSelection, ExpectedPosteriorSd, GroupCounts, Importance, Strategy,
};

/// All strategies.
pub static REGISTRY: &[&dyn Strategy] = &[
    &collisions::CollisionsStrategy,
    &rolling::RollingStrategy,
    &random::RandomStrategy,
    &mixed::MixedStrategy,
    &gradient::GradientStrategy,
    &informative::InformativeStrategy,
];

/// The strategy named `name`.
pub fn strategy(name: &str) -> Result<&'static dyn Strategy> {
    REGISTRY
        .iter()
        .copied()
        .find(|s| s.name() == name)
        .ok_or_else(|| Error::not_found("strategy", name, REGISTRY.iter().map(|s| s.name())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::NoProgress;
    use crate::task::Scene;
    use crate::task::action::Discretisation;
    use crate::task::{ActionSpace, family};
    use crate::trajectory::Trajectory;
    use crate::world::{Engine, Latents, ParameterSpace, Rollout};

    pub(super) fn synthetic_candidates() -> Vec<ActionCandidate> {
        let space = ActionSpace {
            components: vec![],
            bounds: None,
            discrete: Discretisation::Grid { counts: vec![100] },
        };
        (0..100)
            .map(|i| ActionCandidate {
                task: 0,
                action: space.at(i).unwrap(),
                collisions: (i as u32 * 7) % 13,
                rolling_steps: (i as u32 * 31) % 97,
            })
            .collect()
    }

    /// The same slope everywhere.
    pub(super) struct ConstantGradient(pub [f64; 3]);
    impl Importance for ConstantGradient {
        fn gradient(&self, _: [f64; 3]) -> [f64; 3] {
            self.0
        }
    }

    /// The context for a strategy that uses candidates alone.
    pub(super) fn context<'a>(
        candidates: &'a [ActionCandidate],
        world: &'a CandidateSimulation,
        importance: Option<&'a dyn Importance>,
    ) -> AcquisitionContext<'a> {
        AcquisitionContext {
            tasks: &[],
            candidates,
            world,
            coordinates: &LATENTS_ONLY,
            estimate: &[1.0, 0.5, 0.5, 0.0],
            spread: &[0.5, 0.2, 0.2, 0.0],
            prior: &[0.5, 0.25, 0.25, 0.0],
            trials: &[],
            importance,
            progress: &NoProgress,
        }
    }

    /// No estimated effect parameters.
    static LATENTS_ONLY: std::sync::LazyLock<ParameterSpace> =
        std::sync::LazyLock::new(|| ParameterSpace::new(&[]));

    pub(super) static SIMULATION: CandidateSimulation = CandidateSimulation {
        latents: Latents { density: Some(1.0), friction: Some(0.5), restitution: Some(0.5) },
        effects: vec![],
        engine: Engine::Auto,
    };

    pub(super) fn select_with(
        name: &str,
        candidates: &[ActionCandidate],
        n: usize,
        importance: Option<&dyn Importance>,
    ) -> ActionSelection {
        strategy(name).unwrap().select(&context(candidates, &SIMULATION, importance), n).unwrap()
    }

    fn select_indices(name: &str, candidates: &[ActionCandidate], n: usize) -> Vec<usize> {
        select_with(name, candidates, n, None).indices
    }

    /// Contract of every strategy, on real candidates: n distinct indices (fewer only if there are fewer
    /// candidates), deterministic, with and without a surface, and consistent with the group counts.
    #[test]
    fn every_strategy_fulfils_its_contract() {
        let tasks = family("basketball").unwrap().tasks();
        let candidates = simulate_candidates(
            &tasks,
            40,
            &SIMULATION,
            &mut crate::rng::stream(1, "candidates"),
            &NoProgress,
        )
        .unwrap();
        let slope = ConstantGradient([0.0, 0.4, -2.0]);
        for strategy in REGISTRY {
            let name = strategy.name();
            for importance in [Some(&slope as &dyn Importance), None] {
                if strategy.needs_importance() && importance.is_none() {
                    continue;
                }
                for n in [0, 1, 7, 40, 100] {
                    let situation =
                        AcquisitionContext { tasks: &tasks, ..context(&candidates, &SIMULATION, importance) };
                    let chosen = strategy.select(&situation, n).unwrap();
                    assert_eq!(chosen, strategy.select(&situation, n).unwrap(), "{name}");
                    let mut distinct = chosen.indices.clone();
                    distinct.sort_unstable();
                    distinct.dedup();
                    assert_eq!(distinct.len(), n.min(40), "{name} for {n}");
                    assert!(
                        chosen.indices.len() == distinct.len() && distinct.iter().all(|i| *i < 40),
                        "{name}"
                    );
                    if let Some(groups) = chosen.groups {
                        assert_eq!(groups.collisions + groups.rolling, chosen.indices.len(), "{name}");
                    }
                }
                let nothing = context(&[], &SIMULATION, importance);
                assert!(strategy.select(&nothing, 5).unwrap().indices.is_empty(), "{name}");
            }
        }
    }

    #[test]
    fn strategies_favour_their_named_quantity() {
        let candidates = synthetic_candidates();
        let mean = |name: &str, of: fn(&ActionCandidate) -> u32| {
            let chosen = select_indices(name, &candidates, 10);
            chosen.iter().map(|i| f64::from(of(&candidates[*i]))).sum::<f64>() / 10.0
        };
        assert!(mean("collisions", |c| c.collisions) > 11.0 && mean("rolling", |c| c.rolling_steps) > 85.0);
        assert!(mean("mixed", |c| c.collisions) > mean("random", |c| c.collisions));
        assert!(mean("mixed", |c| c.rolling_steps) > mean("random", |c| c.rolling_steps));
    }

    /// Bowling: the paper's count. Basketball: only one body moves, so contacts of the ball with the plank. A
    /// single carrier: contacts with anything.
    #[test]
    fn collisions_are_contacts_between_latent_carriers() {
        let simulated = |name: &str, carriers: Option<&[&str]>| {
            let tasks = family(name).unwrap().tasks();
            let drawn =
                draw_placeable(&tasks[..5], 60, &mut crate::rng::stream(2, "candidates"), &NoProgress)
                    .unwrap();
            let mut scenes: Vec<Scene> = drawn.into_iter().map(|(_, _, scene)| *scene).collect();
            for scene in &mut scenes {
                let named = |c: &[&str]| c.iter().map(|c| c.to_string()).collect();
                scene.carriers = carriers.map(named).or(scene.carriers.take());
            }
            let rollout =
                |scene| Rollout { latents: SIMULATION.latents, stop_at_goal: false, ..Rollout::of(scene) };
            let rollouts: Vec<Rollout> = scenes.iter().map(rollout).collect();
            let found = crate::world::Simulator::new(Engine::Auto).run(&rollouts).unwrap();
            scenes.into_iter().zip(found).collect::<Vec<_>>()
        };
        let total = |found: &[(Scene, Trajectory)]| -> u32 {
            found.iter().map(|(scene, t)| informative_collisions(scene, t)).sum()
        };
        let bowling = simulated("bowling", None);
        assert!(
            bowling.iter().all(|(scene, t)| informative_collisions(scene, t) == t.collisions)
                && total(&bowling) > 20
        );
        let basketball = simulated("basketball", None);
        for (scene, t) in &basketball {
            let on_plank = t.events.iter().filter(|e| e.between.iter().any(|name| name == "plank")).count();
            assert_eq!((informative_collisions(scene, t) as usize, t.collisions), (on_plank, 0));
        }
        assert!(total(&basketball) > 10);
        let alone = simulated("basketball", Some(&["ball"]));
        assert!(alone.iter().all(|(scene, t)| informative_collisions(scene, t) as usize == t.events.len()));
        assert!(total(&alone) > total(&basketball));
    }
}
