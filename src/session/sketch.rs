//! A rollout of nobody's world: a scene, what is placed in it, and a simulation's physics, all named by whoever asks. It
//! leaves nothing behind and spends nothing.

use super::action::{Action, unplaceable};
use super::limits::RequestLimits;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::task::scene::EffectTerm;
use crate::task::{Placement, Scene, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::{Engine, Latents, Rollout, chosen, simulate_within};

/// What is simulated.
pub struct Sketch {
    /// A valid scene.
    pub scene: Scene,
    /// What is placed before the start; without one, bodies start where the scene has them.
    pub action: Option<Action>,
    pub latents: Latents,
    /// Beyond the scene's own.
    pub effects: Vec<EffectTerm>,
    pub engine: Engine,
    /// Time steps between two samples; the scene's own if absent.
    pub observe_every: Option<u32>,
    /// Whether it ends when the goal is reached.
    pub stop: bool,
}

/// What became of a sketch.
pub struct Sketched {
    /// Engine that ran.
    pub engine: &'static str,
    /// Or why the action could not be placed.
    pub result: std::result::Result<Trajectory, String>,
}

impl Sketch {
    /// Simulates it, within what one request may cost.
    pub fn run(&self, limits: &RequestLimits, budget: &dyn Budget) -> Result<Sketched> {
        let mut scene = match self.placed()? {
            Placement::Valid(scene) => *scene,
            Placement::Invalid(reason) => {
                return Ok(Sketched { engine: self.engine.name(), result: Err(reason) });
            }
        };
        if let Some(every) = self.observe_every {
            scene.observe_every = every;
        }
        if let Some(i) = scene.bodies.iter().position(|b| b.position.is_none()) {
            let allowed = "a position in m, or an `action` that places the body";
            return Err(Error::input(format!("scene.bodies[{i}].position"), "missing", allowed));
        }
        limits.affordable(&scene, 1, true)?;
        let rollout =
            Rollout { latents: self.latents, effects: &self.effects, stop: self.stop, ..Rollout::of(&scene) };
        let engine = chosen(self.engine, &rollout)?.name();
        let done = simulate_within(budget, &[rollout], self.engine, |_, trajectory| trajectory)?.pop();
        let trajectory = done.ok_or_else(|| Error::Failed("a rollout was lost".into()))?;
        Ok(Sketched { engine, result: Ok(trajectory) })
    }

    fn placed(&self) -> Result<Placement> {
        let Some(action) = &self.action else { return Ok(Placement::Valid(Box::new(self.scene.clone()))) };
        let Some(space) = &self.scene.action else {
            let allowed = "absent: the scene has no action space, so nothing can be placed in it";
            return Err(match unplaceable(action, "") {
                Error::Input(input) => Error::input("action", input.value, allowed),
                other => other,
            });
        };
        Ok(space.place(&self.scene, &action.resolve(space, "action")?))
    }
}

/// For each action why it cannot be placed in the scene, `None` where it can; nothing is simulated.
pub fn obstacles(
    scene: &Scene,
    actions: &[Action],
    limits: &RequestLimits,
    budget: &dyn Budget,
) -> Result<Vec<Option<String>>> {
    limits.countable("actions", actions.len())?;
    let Some(space) = &scene.action else {
        return Err(Error::input(
            "scene.action",
            "missing",
            "an action space: what an action sets in the scene",
        ));
    };
    let resolved = |(i, a): (usize, &Action)| a.resolve(space, &format!("actions[{i}]"));
    let actions: Vec<ValidAction> = actions.iter().enumerate().map(resolved).collect::<Result<_>>()?;
    let why = |action: &ValidAction| {
        budget.look()?;
        Ok(match space.place(scene, action) {
            Placement::Valid(_) => None,
            Placement::Invalid(reason) => Some(reason),
        })
    };
    actions.iter().map(why).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::Endless;
    use crate::session::Catalogue;

    fn bowling(action: Option<Vec<f64>>) -> Sketch {
        Sketch {
            scene: Catalogue::new().task("bowling:000").unwrap().scene,
            action: action.map(Action::Vector),
            latents: Latents::default(),
            effects: Vec::new(),
            engine: Engine::Auto,
            observe_every: Some(4),
            stop: true,
        }
    }

    #[test]
    fn what_can_be_placed_rolls_as_finely_as_asked() {
        let solving = Catalogue::new().task("bowling:000").unwrap().certificate.unwrap().action;
        let done = bowling(Some(solving.clone())).run(&RequestLimits::STANDARD, &Endless).unwrap();
        let trajectory = done.result.unwrap();
        assert_eq!(done.engine, "lanes");
        assert!((trajectory.times[1] - 4.0 / 240.0).abs() < 1e-12, "{:?}", &trajectory.times[..2]);
        assert!(trajectory.events.iter().any(|c| c.between.contains(&"red".to_string())));
        let unplaced = bowling(None).run(&RequestLimits::STANDARD, &Endless).err().unwrap().to_string();
        assert!(unplaced.contains("scene.bodies[2].position"), "{unplaced}");
    }

    #[test]
    fn obstacles_are_what_a_rollout_would_say() {
        let sketch = bowling(None);
        let shares = [0.25, 0.5, 0.75];
        let vector = |i: usize| Action::Vector(vec![shares[i % 3], shares[i / 3], 0.5]);
        let actions: Vec<Action> = (0..9).map(vector).collect();
        let found = obstacles(&sketch.scene, &actions, &RequestLimits::STANDARD, &Endless).unwrap();
        assert!(found.iter().any(Option::is_none) && found.iter().any(Option::is_some), "{found:?}");
        for (action, obstacle) in actions.into_iter().zip(found) {
            let tried = Sketch { action: Some(action), ..bowling(None) };
            let result = tried.run(&RequestLimits::STANDARD, &Endless).unwrap().result;
            assert_eq!(result.err(), obstacle);
        }
    }
}
