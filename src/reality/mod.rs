//! Sources of measured trials: a hidden world, or recorded files.
//!
//! Hidden latents and effects are private to this module. An estimator accesses a [`Reality`] only through
//! [`Reality::measure`], and every valid attempt is counted. Files are parsed from text; the caller reads them.

pub mod certify;
mod hidden;
mod joint_trials;
pub mod joint_worlds;
mod text_encoding;
mod track_files;
mod trials_csv;

pub use hidden::{HiddenConfig, HiddenWorld, Truth, measure_each, real_world, standard};
pub use joint_trials::{JointTrial, commands_from_csv, joint_trials_from_csv};
pub use text_encoding::decode;
pub use track_files::{LoadedTrials, Subject, TrackFile, TrackParseOptions, load_tracks};
pub use trials_csv::{read_trials_csv, trials_from_csv, trials_to_csv, write_trials_csv};

use crate::error::{Error, Result};
use crate::task::scene::{BodyOverride, Setting, StaticOverride};
use crate::task::{Scene, Task, ValidAction};
use crate::trajectory::Trajectory;

/// A real world: actions can be carried out and observed, and every valid attempt is counted.
pub trait Reality: Send {
    /// Carries out `actions` on `task` and observes them. Invalid actions are returned as such and not counted. If the valid ones
    /// exceed the budget, none is carried out and the result is an error.
    fn measure(&mut self, task: &Task, actions: &[ValidAction]) -> Result<Vec<Attempt>>;

    /// Number of valid attempts so far.
    fn interactions(&self) -> u64;

    /// Maximum number of valid attempts; unlimited if `None`.
    fn budget(&self) -> Option<u64>;
}

/// Result of an action in the real world.
#[derive(Clone, Debug)]
pub struct Attempt {
    /// Scene with the action carried out, or the reason why it cannot be placed.
    pub placement: std::result::Result<Box<Scene>, String>,
    /// Observed trajectory; `None` if the action is invalid.
    pub trajectory: Option<Trajectory>,
}

/// One measured trial: the initial scene and the observed trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Name of the trial (free text).
    pub name: String,
    /// Name of the setting (free text), the key into the scene's settings.
    pub setting: Option<String>,
    /// Scene at the start, with all objects placed.
    pub scene: Scene,
    /// Observed trajectory; missing values are NaN.
    pub observed: Trajectory,
}

impl Attempt {
    /// The attempt as a trial, if it is valid.
    pub fn into_trial(self, name: String) -> Option<Trial> {
        let scene = *self.placement.ok()?;
        Some(Trial { name, setting: None, scene, observed: self.trajectory? })
    }
}

/// Returns `base` with one setting per trial, named after the trial, and the trials in their settings, for writing a scene and a
/// trials file. Errors if two trials have the same name.
pub fn with_trial_settings(base: &Scene, trials: Vec<Trial>) -> Result<(Scene, Vec<Trial>)> {
    let mut scene = Scene { settings: Default::default(), ..base.clone() };
    for trial in &trials {
        let other = scene.settings.insert(trial.name.clone(), setting_between(base, &trial.scene));
        if other.is_some() {
            let allowed = "unique trial names, since each setting is named after its trial";
            return Err(Error::input("trials", format!("{:?} twice", trial.name), allowed));
        }
    }
    scene.validate()?;
    let named = trials.into_iter().map(|trial| Trial { setting: Some(trial.name.clone()), ..trial });
    Ok((scene, named.collect()))
}

/// The setting that turns `base` into `varied` (the same scene with objects placed differently): shapes, positions and velocities, but
/// not coefficients or masses, which are physics.
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
    fn rejects_duplicate_trial_names() {
        let scene = family("bowling").unwrap().tasks()[0].scene.clone();
        let named = |name: &str| Trial {
            name: name.into(),
            setting: None,
            scene: scene.clone(),
            observed: Trajectory::default(),
        };
        assert!(with_trial_settings(&scene, vec![named("a"), named("b")]).is_ok());
        let twice = with_trial_settings(&scene, vec![named("a"), named("a")]).unwrap_err().to_string();
        assert!(twice.contains("\"a\" twice"), "{twice}");
    }
}
