//! Where measured trials come from: a hidden world, or recorded files.
//!
//! Hidden latents and effects are private to this room. An estimator sees a [`Reality`] only through
//! [`Reality::measure`], and every valid attempt is counted.

pub mod certify;
mod columns;
mod header;
mod hidden;
mod reading;
mod recorded;
mod rows;
mod suspicion;
mod tracked;
mod tracks;

pub use hidden::{HiddenConfig, HiddenWorld, Truth, measure_each, standard};
pub use reading::Reading;
pub use recorded::{decode, read_trials, trials_from_csv, trials_to_csv, written};
pub use tracks::{File, Gathered, Of, gather};

use crate::error::{Error, Result};
use crate::task::scene::{BodyOverride, Setting, StaticOverride};
use crate::task::{Scene, Task, ValidAction};
use crate::trajectory::Trajectory;

/// A world that can be acted in and observed, at a price.
pub trait Reality: Send {
    /// Carries out `actions` on `task` and observes. Invalid actions come back as such, cost nothing and are
    /// not counted; if the valid ones exceed the budget, nothing is carried out and the error says so.
    fn measure(&mut self, task: &Task, actions: &[ValidAction]) -> Result<Vec<Attempt>>;

    /// Valid attempts so far.
    fn interactions(&self) -> u64;

    /// Most valid attempts allowed.
    fn budget(&self) -> Option<u64>;
}

/// What became of an action in the real world.
#[derive(Clone, Debug)]
pub struct Attempt {
    /// The scene the action was carried out in, or why it could not be placed.
    pub placement: std::result::Result<Box<Scene>, String>,
    /// What was observed; `None` if the action was not valid.
    pub trajectory: Option<Trajectory>,
}

/// One measured trial: where it started from and what was observed.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Free text.
    pub name: String,
    /// Free text; the key into the scene's settings.
    pub setting: Option<String>,
    /// The scene as it stood at the start: everything placed.
    pub scene: Scene,
    /// What was observed; missing values are NaN.
    pub observed: Trajectory,
}

impl Attempt {
    /// The attempt as a trial, if it was valid.
    pub fn into_trial(self, name: String) -> Option<Trial> {
        let scene = *self.placement.ok()?;
        Some(Trial { name, setting: None, scene, observed: self.trajectory? })
    }
}

/// `base` with a setting for every trial, by its name, and the trials each in its setting: what can be written as a
/// scene and a trials file. Errors where two trials have one name.
pub fn settled(base: &Scene, trials: Vec<Trial>) -> Result<(Scene, Vec<Trial>)> {
    let mut scene = Scene { settings: Default::default(), ..base.clone() };
    for trial in &trials {
        let other = scene.settings.insert(trial.name.clone(), setting_between(base, &trial.scene));
        if other.is_some() {
            let allowed = "a name of its own for every trial: its setting goes by it";
            return Err(Error::input("trials", format!("{:?} twice", trial.name), allowed));
        }
    }
    scene.validate()?;
    let named = trials.into_iter().map(|trial| Trial { setting: Some(trial.name.clone()), ..trial });
    Ok((scene, named.collect()))
}

/// What a setting must override to turn `base` into `varied` (the same scene with other things placed): shapes,
/// places and velocities; never coefficients or masses, which are physics.
pub fn setting_between(base: &Scene, varied: &Scene) -> Setting {
    let bodies = varied.bodies.iter().filter_map(|b| {
        let from = base.body(&b.name)?;
        let over = BodyOverride {
            shape: (b.shape != from.shape).then(|| b.shape.clone()),
            position: b.position.filter(|_| b.position != from.position),
            angle: (b.angle != from.angle).then_some(b.angle),
            velocity: (b.velocity != from.velocity).then_some(b.velocity),
            angular_velocity: (b.angular_velocity != from.angular_velocity).then_some(b.angular_velocity),
            ..BodyOverride::default()
        };
        (over != BodyOverride::default()).then(|| (b.name.clone(), over))
    });
    let statics = varied.statics.iter().filter_map(|s| {
        let from = base.statics.iter().find(|f| f.name == s.name)?;
        let over = StaticOverride {
            shape: (s.shape != from.shape).then(|| s.shape.clone()),
            position: (s.position != from.position).then_some(s.position),
            angle: (s.angle != from.angle).then_some(s.angle),
        };
        (over != StaticOverride::default()).then(|| (s.name.clone(), over))
    });
    Setting { bodies: bodies.collect(), statics: statics.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::family;

    #[test]
    fn trials_are_told_from_each_other_by_their_names() {
        let scene = family("bowling").unwrap().tasks()[0].scene.clone();
        let named = |name: &str| Trial {
            name: name.into(),
            setting: None,
            scene: scene.clone(),
            observed: Trajectory::default(),
        };
        assert!(settled(&scene, vec![named("a"), named("b")]).is_ok());
        let twice = settled(&scene, vec![named("a"), named("a")]).unwrap_err().to_string();
        assert!(twice.contains("\"a\" twice"), "{twice}");
    }
}
