//! Imports PHYRE's single-ball tasks as scenes.
//!
//! Source: PHYRE (Bakhtin et al. 2019) and its program (facebookresearch/phyre, Apache-2.0:
//! `action_mappers.py`, `geometry.h`, `task_utils.h`, `task_validation.cpp`, `thrift_box2d_conversion.cpp`):
//! - 256 by 256 pixels of 1/6 m; density 0.25, friction 0.5, restitution 0.2, gravity -9.8 m/s^2; Box2D's
//!   contact rules.
//! - 1000 steps of 1/60 s; a contact held for 180 steps solves.
//! - An action's ball has its centre at 255 px times the first two numbers and a radius of 2 to 32 px. The
//!   centre is truncated to whole pixels and the radius rounded; an eighth of the stable solutions solve only
//!   with that rounding. The ball must lie within the scene.
//! - Two balls touch within 0.1 px; other bodies touch where Box2D has a contact: within the polygon skins of
//!   0.01 m each.
//!
//! Differences from the source: only imported solutions are rounded to pixels, not our own actions. There is
//! no angular damping (0.01 per second there), and polygon skins exert no force. Statics are listed from the
//! last to the first: our solver visits a body's contacts in the order of the list, Box2D the newest first,
//! and the last contact visited decides how a disc in a notch responds to a hit.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::action::{ActionComponent, ActionQuantity, ActionSpace, Discretisation};
use super::custom;
use super::scene::{Body, ContactRules, Goal, Scene, Static};
use super::shape::{Compound, CompoundPiece, Disc, Polygon, Shape};
use crate::error::{Error, Result, check_range};
use crate::json;

/// Density (kg/m^2), friction and restitution of every object, and the velocity kept per second.
pub const PHYSICS: [f64; 4] = [0.25, FRICTION, RESTITUTION, 1.0];

const FRICTION: f64 = 0.5;
const RESTITUTION: f64 = 0.2;
const PIXELS_PER_METRE: f64 = 6.0;
const SIDE_PX: f64 = 256.0;
/// Radius range of the placed ball, px.
const RADIUS_RANGE_PX: [f64; 2] = [2.0, 32.0];
/// Gap within which two balls count as touching, m.
const BALL_CONTACT_GAP_M: f64 = 0.1 / PIXELS_PER_METRE;
/// Skin of a polygon in Box2D, m.
const POLYGON_SKIN_M: f64 = 0.01;
const ROLLOUT_STEPS: u32 = 1000;
/// Number of actions in PHYRE's own cache.
const N_ACTIONS: usize = 100_000;
/// Name of the ball that an action places.
const BALL: &str = "red";
/// Maximum number of tasks in a file.
const MAX_TASKS: usize = 100_000;

/// The tasks of a file, in order of their ids: `TEMPLATE:TASK`.
pub struct PhyreTasks(BTreeMap<String, PhyreTask>);

/// A task converted to a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct PhyreScene {
    /// With goal and action space.
    pub scene: Scene,
    /// Actions that solve the task in PHYRE and are robust to small perturbations; rounded to pixels.
    pub solutions: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PhyreTask {
    bodies: Vec<PhyreObject>,
    goal: PhyreGoal,
    #[serde(default)]
    solutions: Vec<[f64; 3]>,
    /// Ignored.
    #[serde(default, rename = "phantom")]
    _phantom: Option<IgnoredAny>,
    #[serde(default)]
    tier: Option<String>,
    #[serde(default, rename = "random_actions")]
    _random_actions: Option<IgnoredAny>,
}

/// Lengths in px, angle in rad.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PhyreObject {
    x: f64,
    y: f64,
    #[serde(default)]
    angle: f64,
    dynamic: bool,
    #[serde(default)]
    kind: Option<String>,
    shapes: Vec<PhyreShape>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum PhyreShape {
    Circle(f64),
    Polygon(Vec<[f64; 2]>),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PhyreGoal {
    body1: usize,
    body2: usize,
    relation: Vec<String>,
}

impl PhyreTasks {
    /// Parses a file; errors name task and field.
    pub fn from_json(text: &str) -> Result<PhyreTasks> {
        let all: BTreeMap<String, PhyreTask> = json::parse(text)?;
        check_range("tasks", all.len() as f64, 1.0, MAX_TASKS as f64)?;
        for (id, task) in &all {
            let parts: Vec<&str> = id.split(':').collect();
            let plain = |part: &&str| {
                (1..=20).contains(&part.len())
                    && part.bytes().all(|b| b.is_ascii_digit() || b.is_ascii_lowercase())
            };
            if parts.len() != 2 || !parts.iter().all(plain) {
                let allowed = "a task's id as TEMPLATE:TASK, 00000:003 say";
                return Err(Error::input("", format!("{id:?}"), allowed));
            }
            task.check().map_err(|e| e.in_field(&format!("[{id:?}]")))?;
        }
        Ok(PhyreTasks(all))
    }

    /// Templates, in order.
    pub fn templates(&self) -> Vec<&str> {
        let mut all: Vec<&str> = self.0.keys().filter_map(|id| id.split(':').next()).collect();
        all.dedup();
        all
    }

    /// The tasks of a template, in order: each as a scene, or the reason why it cannot be converted.
    pub fn scenes(&self, template: &str) -> Vec<(&str, Result<PhyreScene>)> {
        let own = |id: &str| id.split(':').next() == Some(template);
        let of = self.0.iter().filter(|(id, _)| own(id));
        of.map(|(id, task)| (id.as_str(), task.to_scene(id).map_err(|e| e.in_field(&format!("[{id:?}]")))))
            .collect()
    }
}

impl PhyreTask {
    fn check(&self) -> Result<()> {
        for (field, index) in [("goal.body1", self.goal.body1), ("goal.body2", self.goal.body2)] {
            if index >= self.bodies.len() {
                let allowed = format!("the index of one of {} bodies", self.bodies.len());
                return Err(Error::input(field, index, allowed));
            }
        }
        if self.goal.relation.iter().any(|r| r != "touching") || self.goal.relation.len() != 1 {
            let value = format!("{:?}", self.goal.relation);
            return Err(Error::input("goal.relation", value, "[\"touching\"]"));
        }
        if let Some(tier) = self.tier.as_deref().filter(|t| !t.eq_ignore_ascii_case("ball")) {
            let allowed = "\"BALL\": tasks in which one ball is placed";
            return Err(Error::input("tier", format!("{tier:?}"), allowed));
        }
        for (i, body) in self.bodies.iter().enumerate() {
            if body.shapes.is_empty() {
                return Err(Error::input(format!("bodies[{i}].shapes"), "[]", "one shape or more"));
            }
        }
        for (i, action) in self.solutions.iter().enumerate() {
            for (k, v) in action.iter().enumerate() {
                check_range(&format!("solutions[{i}][{k}]"), *v, 0.0, 1.0)?;
            }
        }
        Ok(())
    }

    fn to_scene(&self, id: &str) -> Result<PhyreScene> {
        let names: Vec<String> = self.bodies.iter().enumerate().map(|(i, b)| b.name(i)).collect();
        let pair = [self.goal.body1, self.goal.body2];
        let skinned = pair.iter().filter(|i| !self.bodies[**i].is_ball()).count();
        let tolerance = if skinned == 0 { BALL_CONTACT_GAP_M } else { POLYGON_SKIN_M * skinned as f64 };
        let things = || self.bodies.iter().zip(&names);
        let mut bodies: Vec<Body> =
            things().filter(|(b, _)| b.dynamic).map(|(b, name)| b.body(name)).collect();
        bodies.push(ball());
        let scene = Scene {
            name: id.into(),
            bodies,
            statics: things().rev().filter(|(b, _)| !b.dynamic).map(|(b, name)| b.fixed(name)).collect(),
            contact_rules: Some(ContactRules::BOX2D),
            time_step: 1.0 / 60.0,
            steps: ROLLOUT_STEPS,
            observe_every: 20,
            goal: Some(Goal::Contact {
                bodies: pair.map(|i| names[i].clone()),
                hold_s: 3.0,
                tolerance,
                stop: None,
            }),
            action: Some(space()),
            ..Scene::empty()
        };
        let solutions = self.solutions.iter().map(|a| on_pixels(*a)).collect();
        Ok(PhyreScene { scene: custom(scene)?.scene, solutions })
    }
}

impl PhyreObject {
    /// Name of the object, unique by its index.
    fn name(&self, index: usize) -> String {
        format!("{}{index}", self.kind.as_deref().filter(|k| !k.is_empty()).unwrap_or("wall"))
    }

    fn is_ball(&self) -> bool {
        matches!(self.shapes.first(), Some(PhyreShape::Circle(_)))
    }

    fn shape(&self) -> Shape {
        let mut pieces: Vec<Shape> = self.shapes.iter().map(PhyreShape::shape).collect();
        if pieces.len() == 1 {
            return pieces.remove(0);
        }
        let piece = |shape| CompoundPiece { shape, position: [0.0, 0.0], angle: 0.0 };
        Compound { pieces: pieces.into_iter().map(piece).collect() }.into()
    }

    fn position(&self) -> [f64; 2] {
        [self.x / PIXELS_PER_METRE, self.y / PIXELS_PER_METRE]
    }

    fn body(&self, name: &str) -> Body {
        Body { angle: self.angle, position: Some(self.position()), ..moving(name, self.shape()) }
    }

    fn fixed(&self, name: &str) -> Static {
        Static {
            name: name.into(),
            shape: self.shape(),
            friction: FRICTION,
            restitution: RESTITUTION,
            position: self.position(),
            angle: self.angle,
        }
    }
}

impl PhyreShape {
    fn shape(&self) -> Shape {
        let metres = |[x, y]: &[f64; 2]| [x / PIXELS_PER_METRE, y / PIXELS_PER_METRE];
        match self {
            PhyreShape::Circle(radius) => Disc { radius: radius / PIXELS_PER_METRE }.into(),
            PhyreShape::Polygon(corners) => Polygon { vertices: corners.iter().map(metres).collect() }.into(),
        }
    }
}

fn ball() -> Body {
    moving(BALL, Disc { radius: RADIUS_RANGE_PX[0] / PIXELS_PER_METRE }.into())
}

fn moving(name: &str, shape: Shape) -> Body {
    Body {
        name: name.into(),
        shape,
        mass: None,
        density: Some(PHYSICS[0]),
        friction: FRICTION,
        restitution: RESTITUTION,
        position: None,
        angle: 0.0,
        velocity: [0.0, 0.0],
        angular_velocity: 0.0,
        inertia: None,
    }
}

/// Action space of the placed ball: position and radius.
fn space() -> ActionSpace {
    let component = |set, [low, high]: [f64; 2]| {
        let metres = |pixels: f64| pixels / PIXELS_PER_METRE;
        ActionComponent { target: BALL.into(), set, low: metres(low), high: metres(high) }
    };
    let across = [0.0, SIDE_PX - 1.0];
    let side = SIDE_PX / PIXELS_PER_METRE;
    ActionSpace {
        components: vec![
            component(ActionQuantity::X, across),
            component(ActionQuantity::Y, across),
            component(ActionQuantity::Radius, RADIUS_RANGE_PX),
        ],
        bounds: Some([0.0, 0.0, side, side]),
        discrete: Discretisation::Sequence { count: N_ACTIONS },
    }
}

/// The action rounded to whole pixels as PHYRE does.
fn on_pixels([x, y, r]: [f64; 3]) -> Vec<f64> {
    let cut = |v: f64| (v * (SIDE_PX - 1.0)).floor() / (SIDE_PX - 1.0);
    let [low, high] = RADIUS_RANGE_PX;
    vec![cut(x), cut(y), ((low + r * (high - low)).round() - low) / (high - low)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two balls above a floor.
    const TEXT: &str = r#"{"00000:003": {"tier": "BALL", "phantom": false,
        "bodies": [
          {"x": 128, "y": -2.5, "angle": 0.0, "dynamic": false, "kind": null,
           "shapes": [{"polygon": [[128, 2.5], [-128, 2.5], [-128, -2.5], [128, -2.5]]}]},
          {"x": 60, "y": 12, "angle": 0.5, "dynamic": true, "kind": "ball", "shapes": [{"circle": 12}]},
          {"x": 120, "y": 12, "angle": 0.0, "dynamic": true, "kind": "jar", "shapes": [
            {"polygon": [[-12, -12], [12, -12], [12, -6], [-12, -6]]},
            {"polygon": [[-12, -6], [-6, -6], [-6, 12], [-12, 12]]}]}],
        "goal": {"relation": ["touching"], "body1": 1, "body2": 2},
        "solutions": [[0.5, 0.25, 0.51]], "random_actions": {"-1": 1}}}"#;

    #[test]
    fn converts_pixels_and_contact_rules() {
        let tasks = PhyreTasks::from_json(TEXT).unwrap();
        assert_eq!(tasks.templates(), ["00000"]);
        let said = tasks.scenes("00000");
        let (id, Ok(said)) = &said[0] else { panic!("{:?}", said[0]) };
        let scene = &said.scene;
        assert_eq!((*id, scene.name.as_str()), ("00000:003", "00000:003"));
        let names: Vec<&str> = scene.bodies.iter().map(|b| b.name.as_str()).collect();
        assert_eq!(names, ["ball1", "jar2", "red"]);
        assert_eq!(scene.bodies[0].position, Some([10.0, 2.0]));
        assert_eq!((scene.bodies[0].angle, scene.bodies[0].shape.disc_radius()), (0.5, Some(2.0)));
        assert!(matches!(&scene.bodies[1].shape, Shape::Compound(c) if c.pieces.len() == 2));
        assert_eq!(scene.contact_rules, Some(ContactRules::BOX2D));
        let Some(Goal::Contact { hold_s, tolerance, .. }) = &scene.goal else { panic!("{:?}", scene.goal) };
        assert_eq!((*hold_s, *tolerance), (3.0, POLYGON_SKIN_M));
        // 127.5 px and 63.75 px are cut, 17.3 px are rounded.
        let space = scene.action.as_ref().unwrap();
        let action = space.validate(&said.solutions[0]).unwrap();
        let pixels: Vec<f64> =
            space.components.iter().zip(action.values()).map(|(c, v)| 6.0 * c.value(*v)).collect();
        let near = |found: f64, wanted: f64| (found - wanted).abs() < 1e-9;
        assert!(near(pixels[0], 127.0) && near(pixels[1], 63.0) && near(pixels[2], 17.0), "{pixels:?}");
    }

    #[test]
    fn errors_name_task_field_and_value() {
        let check = |from: &str, to: &str, wanted: &[&str]| {
            assert!(TEXT.contains(from), "{from}");
            let read = PhyreTasks::from_json(&TEXT.replace(from, to));
            let error = match read {
                Err(error) => error,
                Ok(tasks) => tasks.scenes("00000").remove(0).1.unwrap_err(),
            };
            let error = error.to_string();
            assert!(wanted.iter().all(|w| error.contains(w)), "{error}");
        };
        check("00000:003", "00000", &["\"00000\"", "TEMPLATE:TASK"]);
        check("\"body2\": 2", "\"body2\": 3", &["00000:003", "goal.body2", "3", "one of 3 bodies"]);
        check("touching", "not_touching", &["00000:003", "goal.relation", "not_touching"]);
        check("BALL", "TWO_BALLS", &["00000:003", "tier", "TWO_BALLS"]);
        check("0.51", "1.51", &["00000:003", "solutions[0][2]", "1.51"]);
        check("[{\"circle\": 12}]", "[]", &["00000:003", "bodies[1].shapes"]);
        check("\"circle\": 12", "\"circle\": \"a\"", &["00000:003", "bodies[1].shapes[0]"]);
        check("\"circle\": 12", "\"circle\": -12", &["00000:003", "bodies[0].shape.radius", "-2"]);
        check("\"dynamic\": true, ", "", &["00000:003", "dynamic"]);
        check("\"y\": 12, \"angle\": 0.5", "\"y\": 1", &["00000:003", "overlaps"]);
    }
}
