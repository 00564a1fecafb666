//! The scene of one ball that flies and bounces off an optional floor: the simulation of a tracked ball.

use serde::Deserialize;
use utoipa::ToSchema;

pub use super::constants::STANDARD_GRAVITY_M_S2;
use super::limits::{MASS_RANGE_KG, MAX_LENGTH_M, MIN_LENGTH_M};
use super::scene::{Body, Scene, Static};
use super::shape::{Disc, Halfspace};
use crate::error::{Error, Result, check_range};

/// A ball and optionally a floor.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema, clap::Args)]
#[serde(deny_unknown_fields)]
#[schema(as = BallIn)]
#[group(requires = "radius")]
pub struct BallScene {
    /// m
    #[arg(long, value_name = "M", allow_negative_numbers = true, required = false)]
    #[arg(help = "Radius of the ball, m")]
    pub radius: f64,
    /// kg
    #[arg(long, value_name = "KG", allow_negative_numbers = true)]
    #[arg(help = "Mass of the ball, kg; has no influence on its flight or its bounces")]
    pub mass: Option<f64>,
    /// m/s^2, downwards. Default: 9.81.
    #[arg(long, value_name = "G", allow_negative_numbers = true)]
    #[arg(help = "Gravity, m/s^2, downwards [default: 9.81]")]
    pub gravity: Option<f64>,
    /// Height of the floor's surface, m.
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    #[arg(help = "Height of the floor, m, if the ball bounces; restitution and friction are estimated, too")]
    pub floor: Option<f64>,
}

/// Upper bound of the ball's density, kg/m^3 (the densest element, osmium, has 22,590).
const MAX_DENSITY_KG_M3: f64 = 23_000.0;
/// Initial coefficients of the ball, from which the estimate starts; the floor's coefficients are 1.
const FRICTION: f64 = 0.5;
const RESTITUTION: f64 = 0.8;
/// Target number of observations of a rollout.
const TARGET_OBSERVATIONS: f64 = 400.0;

impl BallScene {
    /// Builds the scene. Friction and restitution are to be estimated if there is a floor. `seconds` is
    /// the duration of a rollout.
    pub fn build(&self, name: &str, seconds: f64) -> Result<Scene> {
        check_range("radius", self.radius, MIN_LENGTH_M, MAX_LENGTH_M)?;
        let gravity = self.gravity.unwrap_or(STANDARD_GRAVITY_M_S2);
        check_range("gravity", gravity, 0.0, 1e3)?;
        if let Some(mass) = self.mass {
            check_range("mass", mass, MASS_RANGE_KG[0], MASS_RANGE_KG[1])?;
            let most = MAX_DENSITY_KG_M3 * 4.0 / 3.0 * std::f64::consts::PI * self.radius.powi(3);
            if mass > most {
                let allowed = format!(
                    "kg, at most {most:.2e} for a ball of radius {} m; is the mass in grams, or the radius a diameter in mm?",
                    self.radius
                );
                return Err(Error::input("mass", mass, allowed));
            }
        }
        let mut scene = Scene { gravity: [0.0, -gravity], ..Scene::empty() };
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
            inertia: None,
        });
        if let Some(height) = self.floor {
            check_range("floor", height, -MAX_LENGTH_M, MAX_LENGTH_M)?;
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
        scene.observe_every = (steps / TARGET_OBSERVATIONS).ceil().max(1.0) as u32;
        scene.steps = steps as u32;
        scene.validate()?;
        Ok(scene)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BALL: BallScene = BallScene { radius: 0.02, mass: Some(0.0027), gravity: None, floor: None };

    #[test]
    fn floor_adds_friction_and_restitution_to_estimate() {
        let air = BALL.build("ball", 1.0).unwrap();
        assert_eq!((air.bodies.len(), air.statics.len(), air.calibrate.len()), (1, 0, 0));
        assert_eq!((air.gravity, air.steps), ([0.0, -9.81], 240));
        let room = BallScene { floor: Some(-0.3), ..BALL }.build("floor", 2.0).unwrap();
        assert_eq!((room.statics[0].name.as_str(), room.calibrate.len()), ("ground", 2));
        assert_eq!(Scene::from_json(&room.to_json()).unwrap(), room);
    }

    #[test]
    fn rejects_implausible_values_by_name() {
        for (ball, wanted) in [
            (BallScene { radius: 0.0, ..BALL }, "`radius` is 0"),
            (BallScene { mass: Some(2.7), ..BALL }, "`mass` is 2.7; allowed: kg, at most 7.71e-1"),
            (BallScene { gravity: Some(-9.81), ..BALL }, "`gravity` is -9.81"),
            (BallScene { floor: Some(f64::NAN), ..BALL }, "`floor` is NaN"),
        ] {
            let error = ball.build("ball", 1.0).expect_err(wanted).to_string();
            assert!(error.contains(wanted), "{error}");
        }
    }
}
