//! The scene of one ball that flies and, if there is a floor, bounces: what a film of a ball is held against.

use super::limits::{FAR, MASSES, NEAR};
use super::scene::{Body, Scene, Static};
use super::shape::{Disc, Halfspace};
use crate::error::{Error, Result, within};

/// A ball and where it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Ball {
    /// m
    pub radius: f64,
    /// kg; nothing that moves a ball through the air or off a floor depends on it.
    pub mass: Option<f64>,
    /// m/s^2, downwards.
    pub gravity: f64,
    /// Height of the floor's surface, m.
    pub floor: Option<f64>,
}

/// m/s^2, standard gravity to three digits.
pub const GRAVITY: f64 = 9.81;
/// kg/m^3: nothing is denser (osmium: 22,590).
const DENSEST: f64 = 23_000.0;
/// Coefficients with which the search for those of the ball begins; the floor's are 1.
const FRICTION: f64 = 0.5;
const RESTITUTION: f64 = 0.8;
/// Most observations of a rollout, more or less.
const OBSERVATIONS: f64 = 400.0;

impl Ball {
    /// The scene: friction and restitution are estimated where there is a floor. `seconds`: how long a rollout of it
    /// takes.
    pub fn scene(&self, name: &str, seconds: f64) -> Result<Scene> {
        within("radius", self.radius, NEAR, FAR)?;
        within("gravity", self.gravity, 0.0, 1e3)?;
        if let Some(mass) = self.mass {
            within("mass", mass, MASSES[0], MASSES[1])?;
            let most = DENSEST * 4.0 / 3.0 * std::f64::consts::PI * self.radius.powi(3);
            if mass > most {
                let allowed = format!(
                    "kg, at most {most:.2e}: no ball of radius {} m is heavier; was it grams, or the diameter in mm?",
                    self.radius
                );
                return Err(Error::input("mass", mass, allowed));
            }
        }
        let mut scene = Scene { gravity: [0.0, -self.gravity], ..Scene::empty() };
        scene.name = "one ball".into();
        scene.bodies.push(Body {
            name: name.into(),
            shape: Disc { radius: self.radius }.into(),
            mass: self.mass,
            density: None,
            friction: FRICTION,
            restitution: RESTITUTION,
            position: None,
            angle: 0.0,
            velocity: [0.0; 2],
            angular_velocity: 0.0,
        });
        if let Some(height) = self.floor {
            within("floor", height, -FAR, FAR)?;
            scene.statics.push(Static {
                name: if name == "floor" { "ground" } else { "floor" }.into(),
                shape: Halfspace { normal: [0.0, 1.0], offset: height }.into(),
                friction: 1.0,
                restitution: 1.0,
                position: [0.0; 2],
                angle: 0.0,
            });
            scene.calibrate = vec!["restitution".into(), "friction".into()];
        }
        let steps = (seconds / scene.time_step).ceil().clamp(1.0, 1e6);
        scene.observe_every = (steps / OBSERVATIONS).ceil().max(1.0) as u32;
        scene.steps = steps as u32;
        scene.validate()?;
        Ok(scene)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BALL: Ball = Ball { radius: 0.02, mass: Some(0.0027), gravity: GRAVITY, floor: None };

    #[test]
    fn a_floor_makes_the_scene_calibrate_what_bounces_tell() {
        let air = BALL.scene("ball", 1.0).unwrap();
        assert_eq!((air.bodies.len(), air.statics.len(), air.calibrate.len()), (1, 0, 0));
        assert_eq!((air.gravity, air.steps), ([0.0, -9.81], 240));
        let room = Ball { floor: Some(-0.3), ..BALL }.scene("floor", 2.0).unwrap();
        assert_eq!((room.statics[0].name.as_str(), room.calibrate.len()), ("ground", 2));
        assert_eq!(Scene::from_json(&room.to_json()).unwrap(), room);
    }

    #[test]
    fn what_no_ball_can_be_is_refused_by_name() {
        for (ball, wanted) in [
            (Ball { radius: 0.0, ..BALL }, "`radius` is 0"),
            (Ball { mass: Some(2.7), ..BALL }, "`mass` is 2.7; allowed: kg, at most 7.71e-1"),
            (Ball { gravity: -9.81, ..BALL }, "`gravity` is -9.81"),
            (Ball { floor: Some(f64::NAN), ..BALL }, "`floor` is NaN"),
        ] {
            let error = ball.scene("ball", 1.0).expect_err(wanted).to_string();
            assert!(error.contains(wanted), "{error}");
        }
    }
}
