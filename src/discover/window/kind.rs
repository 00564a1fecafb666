//! What a window is.

use crate::discover::smooth::Smooth;
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::trajectory::{Track, Trajectory};
use crate::world::effect::{self, ActiveEffect};
use crate::world::{Latents, Rollout};

/// What a window shows, and what of its start is a nuisance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One body between contacts: its x, y, vx, vy. Nothing else is in the scene, so that no perturbed start can hit
    /// anything.
    Flight,
    /// A few observations before and after one bounce on a static: x, y, vx, vy, omega, and where along its normal the
    /// surface really is (tables are level to millimetres at best).
    Contact,
    /// A disc on a straight static: its way and speed along it, its real height and slope.
    Roll,
    /// The beginning of a trial whose start is known exactly, up to the time at which the start's smallest error would show:
    /// nothing.
    Run,
    /// From one observation of everything, velocities and spins too, to the next: nothing.
    Leap,
    /// A few observations of all bodies of a trial whose start is known, simulated with everything that can touch: x, y, vx,
    /// vy, omega of each. Short enough that one collision does not hide what came before it.
    Shot,
}

impl Kind {
    /// Whether a world's engine simulates it, with all that can touch.
    pub fn simulated(self) -> bool {
        matches!(self, Kind::Run | Kind::Leap | Kind::Shot)
    }

    /// Whether it starts where everything is known: any physics can be tried on it, without a start to be found along.
    pub fn starts_known(self) -> bool {
        matches!(self, Kind::Run | Kind::Leap)
    }

    /// Whether chance in a collision can take it another way than simulated, whatever the model.
    pub fn strays(self) -> bool {
        matches!(self, Kind::Leap | Kind::Shot)
    }
}

/// Fewest observations of a flight: 4 nuisances for 2n coordinates must leave something to test.
pub const FLIGHT: usize = 7;

/// Whether there are stretches that start where everything is known.
pub fn known(windows: &[Window]) -> bool {
    windows.iter().any(|w| w.kind.starts_known())
}

/// Whether there are stretches that start from what was seen whole.
pub fn leaping(windows: &[Window]) -> bool {
    windows.iter().any(|w| w.kind == Kind::Leap)
}

/// Whether there are stretches whose starts are found along: collisions can lead those astray, far above any floor.
pub fn shooting(windows: &[Window]) -> bool {
    windows.iter().any(|w| w.kind == Kind::Shot)
}

/// A piece of a trial.
#[derive(Clone)]
pub struct Window {
    /// Index of the trial.
    pub trial: usize,
    /// Index of the setting.
    pub setting: usize,
    pub kind: Kind,
    /// What is simulated.
    pub scene: Scene,
    /// Clock time at the start, s.
    pub start: f64,
    /// Whether it starts from a whole state in the middle of a trial, in which contacts have lasted for some time.
    pub amid: bool,
    /// In order of time.
    pub points: Vec<Point>,
    /// Initial values of the nuisances, as [`Kind`] says.
    pub nuisances: Vec<f64>,
    /// What is touched in a contact or roll.
    pub surface: Option<Surface>,
    /// The scene's own effects.
    pub own: Vec<ActiveEffect>,
    /// The data's own smooth, for the noise floor.
    pub smooth: Option<Smooth>,
    /// Observations that points are the means of.
    pub averaged: Averaged,
}

/// One observed position.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Index into the window's bodies.
    pub body: usize,
    /// s since the window's start
    pub time: f64,
    /// m
    pub seen: [f64; 2],
    /// Number of observations that it is the mean of: 1, or 0 for an outlier, but in long flights.
    pub weight: f64,
}

/// The straight piece of a static that a disc bounces off or rolls along.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Index of the static.
    pub fixed: usize,
    /// Away from the static.
    pub normal: [f64; 2],
    /// The disc's centre is at `normal . p = level` when it touches, m.
    pub level: f64,
    /// Coefficients of the body and of the static, and whether each carries the latents.
    pub friction: [f64; 2],
    pub restitution: [f64; 2],
    pub carries: [bool; 2],
    /// m
    pub radius: f64,
    /// Moment of inertia over mass and radius squared.
    pub inertia: f64,
    /// By how much the spin may differ from where it starts, rad/s: little where it was seen.
    pub spin: f64,
}

/// Observations that were averaged in a segment.
#[derive(Clone, Copy, Debug, Default)]
pub struct Averaged {
    /// Observations beyond one a block.
    pub count: usize,
    /// Sum of squared deviations from the blocks' means, of both coordinates, m^2.
    pub square: f64,
}

impl Window {
    /// A window of a scene (which was checked before it came here) without nuisances, surface and smooth, of the first trial.
    pub fn new(kind: Kind, scene: Scene, start: f64, points: Vec<Point>) -> Window {
        let own = effect::scene_effects(&scene).unwrap_or_default();
        let nuisances = Vec::new();
        let (trial, setting, amid, surface, smooth) = (0, 0, false, None, None);
        let averaged = Averaged::default();
        Window { trial, setting, kind, scene, start, amid, points, nuisances, surface, own, smooth, averaged }
    }

    /// How an engine rolls a scene of the window out: in the middle of a trial, contacts have lasted before.
    pub fn rollout<'a>(
        &self,
        scene: &'a Scene,
        (effects, latents): &'a (Vec<EffectTerm>, Latents),
    ) -> Rollout<'a> {
        Rollout {
            latents: *latents,
            effects,
            stop_at_goal: false,
            contacts_established: self.amid,
            ..Rollout::of(scene)
        }
    }

    /// Index of the observation that the window starts from, if it starts from one.
    pub fn first(&self, observed: &Trajectory) -> Option<usize> {
        observed.times.iter().position(|t| *t == self.start)
    }
}

/// A body's position at an observation, m, if it was seen there.
pub fn seen(track: &Track, i: usize) -> Option<[f64; 2]> {
    (track.x[i].is_finite() && track.y[i].is_finite()).then(|| [track.x[i], track.y[i]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::scene::EffectTerm;

    /// A scene's damping acts in windows as the effect that it is, beside its other effects.
    #[test]
    fn damping_is_an_effect_of_the_scenes_own() {
        let wind = EffectTerm { name: "wind".into(), parameters: [("ax".to_string(), 1.0)].into() };
        let own = |damping: f64| {
            let scene = Scene { damping: Some(damping), effects: vec![wind.clone()], ..Scene::empty() };
            let own = Window::new(Kind::Flight, scene, 0.0, Vec::new()).own;
            own.iter().map(|a| a.effect.name).collect::<Vec<_>>()
        };
        assert_eq!(own(0.8), ["linear_drag", "wind"]);
        assert_eq!(own(1.0), ["wind"], "a body that keeps all of its speed is not damped");
    }
}
