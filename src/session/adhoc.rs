//! Ad-hoc simulation: one rollout of a scene with given physics. No world is created and no interaction is counted.

use super::action::{Action, unplaceable};
use super::limits::RequestLimits;
use crate::budget::Budget;
use crate::error::{Error, Result};
use crate::task::scene::EffectTerm;
use crate::task::{Placement, Scene, ValidAction};
use crate::trajectory::Trajectory;
use crate::world::{Engine, Latents, Rollout, Simulator, select_engine};

/// An ad-hoc simulation to run.
pub struct AdhocSimulation {
    /// A valid scene.
    pub scene: Scene,
    /// Default: none; bodies start at their positions in the scene.
    pub action: Option<Action>,
    pub latents: Latents,
    /// In addition to the scene's own.
    pub effects: Vec<EffectTerm>,
    pub engine: Engine,
    /// Time steps between two samples. Default: the scene's.
    pub observe_every: Option<u32>,
    /// Whether the rollout ends when the goal is reached.
    pub stop: bool,
}

/// The result of an ad-hoc simulation.
pub struct AdhocResult {
    /// Engine that ran.
    pub engine: &'static str,
    /// The trajectory, or why the action could not be placed.
    pub result: std::result::Result<Trajectory, String>,
}

impl AdhocSimulation {
    /// Runs the simulation within the limits of one request.
    pub fn run(&self, limits: &RequestLimits, budget: &dyn Budget) -> Result<AdhocResult> {
        let mut scene = match self.placed()? {
            Placement::Valid(scene) => *scene,
            Placement::Invalid(reason) => {
                return Ok(AdhocResult { engine: self.engine.name(), result: Err(reason) });
            }
        };
        if let Some(every) = self.observe_every {
            scene.observe_every = every;
        }
        if let Some(i) = scene.bodies.iter().position(|b| b.position.is_none()) {
            let allowed = "a position in m, or an `action` that places the body";
            return Err(Error::input(format!("scene.bodies[{i}].position"), "missing", allowed));
        }
        limits.check_cost(&scene, 1, true)?;
        let rollout = Rollout {
            latents: self.latents,
            effects: &self.effects,
            stop_at_goal: self.stop,
            ..Rollout::of(&scene)
        };
        let engine = select_engine(self.engine, &rollout)?.name();
        let trajectory = Simulator::new(self.engine).budget(budget).one(rollout)?;
        Ok(AdhocResult { engine, result: Ok(trajectory) })
    }

    fn placed(&self) -> Result<Placement> {
        let Some(action) = &self.action else { return Ok(Placement::Valid(Box::new(self.scene.clone()))) };
        let Some(space) = &self.scene.action else {
            let allowed = "no action: the scene has no action space";
            return Err(unplaceable(action, "").map_input(|input| input.allowed = allowed.into()));
        };
        Ok(space.place(&self.scene, &action.resolve(space, "action")?))
    }
}

/// Why each action cannot be placed in the scene, `None` if it can. Nothing is simulated.
pub fn placement_errors(
    scene: &Scene,
    actions: &[Action],
    limits: &RequestLimits,
    budget: &dyn Budget,
) -> Result<Vec<Option<String>>> {
    limits.check_count("actions", actions.len())?;
    let Some(space) = &scene.action else {
        let allowed = "an action space, which says what an action sets in the scene";
        return Err(Error::input("scene.action", "missing", allowed));
    };
    let resolved = |(i, a): (usize, &Action)| a.resolve(space, &format!("actions[{i}]"));
    let actions: Vec<ValidAction> = actions.iter().enumerate().map(resolved).collect::<Result<_>>()?;
    let why = |action: &ValidAction| {
        budget.check()?;
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
    use crate::budget::Unlimited;
    use crate::session::Catalogue;

    fn bowling(action: Option<Vec<f64>>) -> AdhocSimulation {
        AdhocSimulation {
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
    fn simulates_with_the_requested_sampling() {
        let solving = Catalogue::new().task("bowling:000").unwrap().certificate.unwrap().action;
        let done = bowling(Some(solving.clone())).run(&RequestLimits::STANDARD, &Unlimited).unwrap();
        let trajectory = done.result.unwrap();
        assert_eq!(done.engine, "lanes");
        assert!((trajectory.times[1] - 4.0 / 240.0).abs() < 1e-12, "{:?}", &trajectory.times[..2]);
        assert!(trajectory.events.iter().any(|c| c.between.contains(&"red".to_string())));
        let unplaced = bowling(None).run(&RequestLimits::STANDARD, &Unlimited).err().unwrap().to_string();
        assert!(unplaced.contains("scene.bodies[2].position"), "{unplaced}");
    }

    #[test]
    fn placement_errors_agree_with_rollouts() {
        let sketch = bowling(None);
        let shares = [0.25, 0.5, 0.75];
        let vector = |i: usize| Action::Vector(vec![shares[i % 3], shares[i / 3], 0.5]);
        let actions: Vec<Action> = (0..9).map(vector).collect();
        let found = placement_errors(&sketch.scene, &actions, &RequestLimits::STANDARD, &Unlimited).unwrap();
        assert!(found.iter().any(Option::is_none) && found.iter().any(Option::is_some), "{found:?}");
        for (action, obstacle) in actions.into_iter().zip(found) {
            let tried = AdhocSimulation { action: Some(action), ..bowling(None) };
            let result = tried.run(&RequestLimits::STANDARD, &Unlimited).unwrap().result;
            assert_eq!(result.err(), obstacle);
        }
    }
}
