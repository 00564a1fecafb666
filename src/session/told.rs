//! Who watches a world, and that it is gone.

use super::state::lock;
use super::watch::{What, WorldWatcher};
use super::world::World;

impl World {
    /// What happens from now on, and what is still kept after event number `after` (0 for all that is).
    pub fn watch(&self, after: u64) -> WorldWatcher {
        self.lookout.watch(after)
    }
}

impl Drop for World {
    fn drop(&mut self) {
        let interactions = lock(&self.state).interactions;
        self.lookout.tell(interactions, || What::Gone);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Duration;

    use super::*;
    use crate::budget::Endless;
    use crate::session::watch::{Brought, FILM_STATES, Happened, KEPT_EVENTS, KEPT_STATES};
    use crate::session::{Action, Batch, Catalogue, Kind, Reset, WorldConfig};
    use crate::world::Latents;

    fn world(kind: Kind) -> World {
        let tasks = Catalogue::new().named("bowling:000").unwrap();
        World::new(WorldConfig {
            tasks,
            kind,
            engine: crate::world::Engine::Auto,
            latents: Latents::default(),
            effects: None,
            noise: 0.0,
            budget: None,
            sealed: None,
            seed: 0,
        })
        .unwrap()
    }

    /// What is there to be seen now.
    fn seen(watcher: &mut WorldWatcher) -> Vec<Arc<Happened>> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        let mut all = Vec::new();
        let soon = std::time::Duration::from_millis(1);
        let next = |w: &mut WorldWatcher| {
            runtime.block_on(async { tokio::time::timeout(soon, w.next()).await.ok().flatten() })
        };
        while let Some(event) = next(watcher) {
            all.push(event);
        }
        all
    }

    fn kept(world: &World) -> usize {
        world.lookout.kept().0
    }

    #[test]
    fn steps_are_told_with_what_was_observed_to_those_who_watch() {
        for kind in [Kind::Sim, Kind::Real] {
            let world = world(kind);
            world.reset(&Reset::default()).unwrap();
            assert_eq!(kept(&world), 0, "nobody watches");
            let mut watcher = world.watch(0);
            world.reset(&Reset::default()).unwrap();
            let index = |i| Action::Index(i);
            let tried: Vec<_> = (0..40).map(|i| world.step(&index(i), &Endless)).collect();
            let valid = tried.iter().flatten().filter(|s| s.invalid.is_none()).count();
            assert_eq!(valid, 1);
            let events = seen(&mut watcher);
            assert!(matches!(&events[0].what, What::Reset { task, .. } if task == "bowling:000"));
            let last = events.last().unwrap();
            let What::Step { action, brought: Brought::Done { film: Some(film), .. }, .. } = &last.what
            else {
                panic!("{last:?}")
            };
            assert_eq!((action.len(), last.interactions), (3, 1));
            assert!(film.t.len() > 10 && film.bodies.iter().all(|b| b.x.len() == film.t.len()));
            let refused = |e: &Happened| matches!(&e.what, What::Step { brought: Brought::Refused(_), .. });
            assert_eq!(events.iter().filter(|e| refused(e)).count() + 2, events.len());
        }
    }

    #[test]
    fn a_watcher_goes_on_where_it_was_and_the_oldest_are_missed() {
        let world = world(Kind::Sim);
        let mut watcher = world.watch(0);
        (0..3).for_each(|_| drop(world.reset(&Reset::default()).unwrap()));
        let numbers = |w: &mut WorldWatcher| seen(w).iter().map(|e| e.number).collect::<Vec<_>>();
        assert_eq!(numbers(&mut watcher), [1, 2, 3]);
        drop(watcher);
        world.reset(&Reset::default()).unwrap();
        assert_eq!(numbers(&mut world.watch(2)), [3, 4], "also what happened in between");
        assert_eq!(numbers(&mut world.watch(99)), [1, 2, 3, 4], "a number of another watch");
        let mut slow = world.watch(0);
        (0..2 * KEPT_EVENTS).for_each(|_| drop(world.reset(&Reset::default()).unwrap()));
        let (all, last) = (numbers(&mut slow), 4 + 2 * KEPT_EVENTS as u64);
        assert_eq!((all.len(), all.last()), (KEPT_EVENTS, Some(&last)));
    }

    #[test]
    fn films_are_bounded() {
        let world = world(Kind::Sim);
        let mut watcher = world.watch(0);
        let actions: Vec<Action> = (0..200).map(Action::Index).collect();
        let one = |action: &Action| Batch {
            actions: vec![action.clone()],
            task: None,
            trajectories: true,
            stop: false,
            interventions: Vec::new(),
        };
        actions.iter().for_each(|a| drop(world.rollout(&one(a), &Endless).unwrap()));
        let states = world.lookout.kept().1;
        assert!(states > 0 && states <= KEPT_STATES, "{states}");
        assert!(seen(&mut watcher).iter().all(|e| e.states() <= FILM_STATES + 3));
    }

    #[test]
    fn what_was_kept_goes_when_nobody_watches_and_a_world_that_goes_says_so() {
        let world = world(Kind::Sim);
        let watcher = world.watch(0);
        world.reset(&Reset::default()).unwrap();
        let sweep = |s: u64| world.lookout.sweep(Duration::from_secs(s));
        (0..99).for_each(sweep);
        assert_eq!(kept(&world), 1, "it is watched");
        drop(watcher);
        (100..110).for_each(sweep);
        assert_eq!(kept(&world), 1, "the connection may have broken");
        sweep(120);
        assert_eq!(kept(&world), 0);
        assert!(!world.lookout.is_on());
        let mut watcher = world.watch(0);
        drop(world);
        assert!(matches!(seen(&mut watcher)[..], [ref e] if matches!(e.what, What::Gone)));
    }
}
