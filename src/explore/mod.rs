//! Which actions to spend on the real world.
//!
//! Source: Semage et al., section on action selection: candidate actions are tried on the simulation at the
//! current estimate and ranked by what they would tell. A strategy is one file and one row in [`REGISTRY`].

mod candidate;
mod collisions;
mod gradient;
mod informative;
mod mixed;
mod random;
mod rolling;
mod strategy;

use crate::error::{Error, Result};
pub(crate) use candidate::draw;
pub use candidate::{Candidate, World, candidates, collisions_of};
use strategy::ranked;
pub use strategy::{Chosen, Expected, Groups, Importance, Situation, Strategy};

/// Every known strategy.
pub static REGISTRY: &[&dyn Strategy] = &[
    &collisions::Collisions,
    &rolling::Rolling,
    &random::Random,
    &mixed::Mixed,
    &gradient::Gradient,
    &informative::Informative,
];

/// The strategy named `name`.
pub fn strategy(name: &str) -> Result<&'static dyn Strategy> {
    REGISTRY.iter().copied().find(|s| s.name() == name).ok_or_else(|| Error::NotFound {
        kind: "strategy",
        id: name.to_string(),
        known: REGISTRY.iter().map(|s| s.name().to_string()).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;
    use crate::task::Scene;
    use crate::task::action::Discrete;
    use crate::task::{ActionSpace, family};
    use crate::trajectory::Trajectory;
    use crate::world::{Coordinates, Engine, Latents, Rollout};

    pub(super) fn some() -> Vec<Candidate> {
        let space =
            ActionSpace { components: vec![], bounds: None, discrete: Discrete::Grid { counts: vec![100] } };
        (0..100)
            .map(|i| Candidate {
                task: 0,
                action: space.at(i).unwrap(),
                collisions: (i as u32 * 7) % 13,
                rolling_steps: (i as u32 * 31) % 97,
            })
            .collect()
    }

    /// The same slope everywhere.
    pub(super) struct Slope(pub [f64; 3]);
    impl Importance for Slope {
        fn gradient(&self, _: [f64; 3]) -> [f64; 3] {
            self.0
        }
    }

    /// What a strategy sees that looks at candidates alone.
    pub(super) fn seen<'a>(
        candidates: &'a [Candidate],
        world: &'a World,
        importance: Option<&'a dyn Importance>,
    ) -> Situation<'a> {
        Situation {
            tasks: &[],
            candidates,
            world,
            coordinates: &LATENTS,
            estimate: &[1.0, 0.5, 0.5, 0.0],
            spread: &[0.5, 0.2, 0.2, 0.0],
            prior: &[0.5, 0.25, 0.25, 0.0],
            trials: &[],
            importance,
            progress: &Silent,
        }
    }

    /// Nothing is fitted along.
    static LATENTS: std::sync::LazyLock<Coordinates> = std::sync::LazyLock::new(|| Coordinates::new(&[]));

    pub(super) static WORLD: World = World {
        latents: Latents { density: Some(1.0), friction: Some(0.5), restitution: Some(0.5) },
        effects: vec![],
        engine: Engine::Auto,
    };

    pub(super) fn chosen_with(
        name: &str,
        candidates: &[Candidate],
        n: usize,
        importance: Option<&dyn Importance>,
    ) -> Chosen {
        strategy(name).unwrap().choose(&seen(candidates, &WORLD, importance), n).unwrap()
    }

    fn choose(name: &str, candidates: &[Candidate], n: usize) -> Vec<usize> {
        chosen_with(name, candidates, n, None).indices
    }

    /// Contract of every strategy, on real candidates: n distinct indices, fewer only if there are fewer, always
    /// the same ones, with a surface beside it or, where none is needed, without; and as many as the groups say.
    #[test]
    fn every_strategy_keeps_its_contract() {
        let tasks = family("basketball").unwrap().tasks();
        let candidates =
            candidates(&tasks, 40, &WORLD, &mut crate::rng::stream(1, "candidates"), &Silent).unwrap();
        let slope = Slope([0.0, 0.4, -2.0]);
        for strategy in REGISTRY {
            let name = strategy.name();
            for importance in [Some(&slope as &dyn Importance), None] {
                if strategy.needs_importance() && importance.is_none() {
                    continue;
                }
                for n in [0, 1, 7, 40, 100] {
                    let situation = Situation { tasks: &tasks, ..seen(&candidates, &WORLD, importance) };
                    let chosen = strategy.choose(&situation, n).unwrap();
                    assert_eq!(chosen, strategy.choose(&situation, n).unwrap(), "{name}");
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
                let nothing = seen(&[], &WORLD, importance);
                assert!(strategy.choose(&nothing, 5).unwrap().indices.is_empty(), "{name}");
            }
        }
    }

    #[test]
    fn groups_are_rich_in_what_they_are_named_for() {
        let candidates = some();
        let mean = |name: &str, of: fn(&Candidate) -> u32| {
            let chosen = choose(name, &candidates, 10);
            chosen.iter().map(|i| f64::from(of(&candidates[*i]))).sum::<f64>() / 10.0
        };
        assert!(mean("collisions", |c| c.collisions) > 11.0 && mean("rolling", |c| c.rolling_steps) > 85.0);
        assert!(mean("mixed", |c| c.collisions) > mean("random", |c| c.collisions));
        assert!(mean("mixed", |c| c.rolling_steps) > mean("random", |c| c.rolling_steps));
    }

    /// In bowling the paper's count; in basketball, where only one body moves, the ball's contacts with the plank;
    /// with a single carrier, contacts with anything.
    #[test]
    fn collisions_are_contacts_of_what_carries_the_latents() {
        let simulated = |name: &str, carriers: Option<&[&str]>| {
            let tasks = family(name).unwrap().tasks();
            let drawn = draw(&tasks[..5], 60, &mut crate::rng::stream(2, "candidates")).unwrap();
            let mut scenes: Vec<Scene> = drawn.into_iter().map(|(_, _, scene)| *scene).collect();
            for scene in &mut scenes {
                let named = |c: &[&str]| c.iter().map(|c| c.to_string()).collect();
                scene.carriers = carriers.map(named).or(scene.carriers.take());
            }
            let rollout = |scene| Rollout { latents: WORLD.latents, stop: false, ..Rollout::of(scene) };
            let rollouts: Vec<Rollout> = scenes.iter().map(rollout).collect();
            let found = crate::world::simulate(&rollouts, Engine::Auto).unwrap();
            scenes.into_iter().zip(found).collect::<Vec<_>>()
        };
        let total = |found: &[(Scene, Trajectory)]| -> u32 {
            found.iter().map(|(scene, t)| collisions_of(scene, t)).sum()
        };
        let bowling = simulated("bowling", None);
        assert!(
            bowling.iter().all(|(scene, t)| collisions_of(scene, t) == t.collisions) && total(&bowling) > 20
        );
        let basketball = simulated("basketball", None);
        for (scene, t) in &basketball {
            let on_plank = t.events.iter().filter(|e| e.between.iter().any(|name| name == "plank")).count();
            assert_eq!((collisions_of(scene, t) as usize, t.collisions), (on_plank, 0));
        }
        assert!(total(&basketball) > 10);
        let alone = simulated("basketball", Some(&["ball"]));
        assert!(alone.iter().all(|(scene, t)| collisions_of(scene, t) as usize == t.events.len()));
        assert!(total(&alone) > total(&basketball));
    }
}
