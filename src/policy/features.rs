//! Features of a task and an action: the inputs of a policy, with the same meaning for tasks of every family and for arbitrary shapes.
//!
//! All features are dimensionless and in [-1, 1]: lengths as shares of the scene's size or of the sum of two objects' sizes (`squash`
//! where there is no bound), speeds as shares of that of a fall through the scene's height, yes and no as 1 and -1, 0 if absent.
//! They depend on the scene and the action alone, not on latent factors, so that they are equal in all worlds.
//!
//! | scene features | shape |
//! |---|---|
//! | the goal is contact, is a region; "a" and "b" are in the scene | (4,) |
//! | objects | (`MAX_OBJECTS`, `OBJECT_FEATURES`) |
//! | support below the rear end, centre and front end of the goal's body | (3, `SUPPORT_FEATURES`) |
//!
//! Of an object: whether it is present; centre, half extents, aspect and size; orientation and elongation (second moments), centre
//! of mass in the bounding box and filled share of it; whether it is a disc, a compound, movable, "a", "b"; velocity.
//!
//! | action features | shape |
//! |---|---|
//! | the action's components | (components,) |
//! | for each object that the action places: frame of reference | (2,) |
//! | ... distance and sizes of "a" and "b", room behind and beyond them | (`PAIR_FEATURES`,) |
//! | ... collision with "a": speed of the fall, share of the mass, impact | (`IMPACT_FEATURES`,) |
//! | ... position, size, clearance, fall time; form; velocity | (15,) |
//! | ... position relative to "a", "b" and the nearest others, and their properties | (2 + `NEIGHBOURS`, `RELATION_FEATURES`) |
//! | ... support | (3, `SUPPORT_FEATURES`) |
//! | ... position relative to each further object that the action places | (.., `RELATION_FEATURES`) |
//! | ... if the action sets a velocity: whether the ballistic trajectory reaches "a" and "b", and how high above them | (2, 2) |
//!
//! Order of objects: first the goal's two objects "a" and "b" ("a" is the movable one or, of two movable ones, the left one), then
//! movable objects, then fixed ones, by distance from "a". If "b" lies to the left of "a", x is mirrored, so that "b" always lies
//! ahead. For an object that the action places, "a" is the horizontally nearer one if both or neither are movable: the object to be
//! pushed. This maps the four cases (left or right object, pushed left or right) to the same features; the frame of reference
//! distinguishes them.
//!
//! Source: Semage et al. use images; PHYRE (Bakhtin et al. 2019) shows that a DQN on object features performs as well, and
//! distinguishes seven colours, which encode an object's role in the goal and whether it moves (section 4.1).
//!
//! Differences from the source: a feature vector instead of an image, a bounded number of objects.

use super::action_target::ActionTarget;
use super::goal_frame::{GoalFrame, objects_by_role};
use super::object_geometry::{ObjectGeometry, length};
use crate::task::action::ActionQuantity;
use crate::task::geometry::Aabb;
use crate::task::scene::Goal;
use crate::task::{Scene, Task, ValidAction};

/// Maximum number of objects in the scene features. PHYRE's templates have at most ten.
const MAX_OBJECTS: usize = 10;
/// Number of nearest objects, in addition to the goal's, in the action features.
const NEIGHBOURS: usize = 4;
/// Scene features per object.
const OBJECT_FEATURES: usize = 19;
/// Features of a position relative to an object.
const RELATION_FEATURES: usize = 21;
/// Features of the support below a point.
const SUPPORT_FEATURES: usize = 5;
/// Features of the goal's two objects relative to each other.
const PAIR_FEATURES: usize = 9;
/// Features of a collision with the goal's body.
const IMPACT_FEATURES: usize = 4;

/// Features of a task that are shared by all of its actions.
#[derive(Clone, Debug)]
pub struct FeatureExtractor {
    /// Bounding box of the scene, m.
    frame: Aabb,
    /// Objects of the scene, with the goal's two objects first if they are in the scene.
    objects: Vec<ObjectGeometry>,
    goal: GoalFrame,
    /// Names of the objects that the action places, in the order of the action's components.
    targets: Vec<String>,
    /// Whether the action sets a velocity.
    launched: bool,
    scene: Scene,
}

impl FeatureExtractor {
    /// Features of a task's scene.
    pub fn new(task: &Task) -> FeatureExtractor {
        let (scene, space) = (&task.scene, task.actions());
        let frame = space.bounds.unwrap_or_else(|| scene.extent());
        let mut targets: Vec<String> = Vec::new();
        for component in &space.components {
            if !targets.contains(&component.target) {
                targets.push(component.target.clone());
            }
        }
        let (objects, goal) = objects_by_role(scene, &targets, frame);
        let launched =
            space.components.iter().any(|c| matches!(c.set, ActionQuantity::Vx | ActionQuantity::Vy));
        FeatureExtractor { frame, objects, goal, targets, launched, scene: scene.clone() }
    }

    /// Dimensions of the scene and action features of a task.
    pub fn dimensions(task: &Task) -> [usize; 2] {
        let features = FeatureExtractor::new(task);
        let middle = task.actions().validate(&vec![0.5; task.actions().dimension()]);
        [features.scene().len(), middle.map_or(0, |a| features.action(&a).len())]
    }

    /// (n_scene,) geometry of the objects and their roles in the goal.
    pub fn scene(&self) -> Vec<f32> {
        let mut out = Vec::with_capacity(MAX_OBJECTS * OBJECT_FEATURES + 3 * SUPPORT_FEATURES + 4);
        out.push(indicator(matches!(self.scene.goal, Some(Goal::Contact { .. }))));
        out.push(indicator(matches!(self.scene.goal, Some(Goal::Inside { .. }))));
        out.extend(self.goal.roles.map(|role| indicator(role.is_some())));
        let [width, height] = self.size();
        for slot in 0..MAX_OBJECTS {
            let Some(thing) = self.objects.get(slot) else {
                out.resize(out.len() + OBJECT_FEATURES, 0.0);
                continue;
            };
            let [x, y] = self.relative_position(thing.centre, self.goal.ahead);
            out.extend([
                1.0,
                x,
                y,
                clamp_to_unit(8.0 * thing.half[0] / width),
                clamp_to_unit(8.0 * thing.half[1] / height),
            ]);
            out.extend([
                squash(thing.half[0] / thing.half[1].max(1e-9) - 1.0),
                squash(8.0 * thing.size() / width),
            ]);
            out.extend(form_features(thing, self.goal.ahead));
            out.extend([indicator(thing.disc), indicator(thing.several), indicator(thing.movable)]);
            out.extend(self.goal.roles.map(|role| indicator(role == Some(slot))));
            out.extend(self.velocity_features(thing, self.goal.ahead));
        }
        match self.goal.roles[0] {
            Some(a) if self.objects[a].movable => {
                self.support_features(&self.objects[a], self.goal, &mut out)
            }
            _ => out.resize(out.len() + 3 * SUPPORT_FEATURES, 0.0),
        }
        out
    }

    /// (n_action,) components of the action, and relations of the placed objects to the scene.
    pub fn action(&self, action: &ValidAction) -> Vec<f32> {
        let mut out = Vec::with_capacity(192);
        let components = &self.scene.action.as_ref().map_or(&[][..], |s| &s.components);
        for (component, v) in components.iter().zip(action.values()) {
            let mirrored = matches!(
                component.set,
                ActionQuantity::X | ActionQuantity::Vx | ActionQuantity::Angle | ActionQuantity::Omega
            );
            let side = if mirrored { self.goal.ahead } else { 1.0 };
            out.push(clamp_to_unit(side * (2.0 * v - 1.0)));
        }
        let targets = self.placed_targets(action);
        for (i, target) in targets.iter().enumerate() {
            let goal = self.goal_frame(target);
            out.extend([goal.ahead == self.goal.ahead, goal.roles != self.goal.roles].map(indicator));
            self.pair_features(goal, &mut out);
            self.impact_features(target, goal, &mut out);
            self.clearance_features(target, goal.ahead, &mut out);
            out.extend(form_features(target, goal.ahead));
            out.extend(self.velocity_features(target, goal.ahead));
            for role in goal.roles {
                let object = role.map(|k| with_gap(target, &self.objects[k]));
                self.relation_features(target, object, goal.ahead, &mut out);
            }
            let mut others: Vec<(f64, &ObjectGeometry)> =
                self.other_objects().map(|o| with_gap(target, o)).collect();
            others.sort_by(|x, y| x.0.total_cmp(&y.0));
            for k in 0..NEIGHBOURS {
                self.relation_features(target, others.get(k).copied(), goal.ahead, &mut out);
            }
            self.support_features(target, goal, &mut out);
            for other in &targets[i + 1..] {
                self.relation_features(target, Some(with_gap(target, other)), goal.ahead, &mut out);
            }
            if self.launched {
                out.extend(goal.roles.map(|role| self.flight_features(target, role)).as_flattened());
            }
        }
        out
    }

    fn other_objects(&self) -> impl Iterator<Item = &ObjectGeometry> {
        let own = |k: &usize| !self.goal.roles.contains(&Some(*k));
        (0..self.objects.len()).filter(own).map(|k| &self.objects[k])
    }

    /// Geometry of the objects that the action places.
    fn placed_targets(&self, action: &ValidAction) -> Vec<ObjectGeometry> {
        let place = |name: &String| {
            let placed = ActionTarget::new(&self.scene, name, action);
            let area = placed.shape.moments().area;
            ObjectGeometry::new(placed.solid(), placed.position, placed.velocity, placed.movable, area)
        };
        self.targets.iter().map(place).collect()
    }

    /// The goal's frame for a placed object.
    fn goal_frame(&self, target: &ObjectGeometry) -> GoalFrame {
        let [Some(a), Some(b)] = self.goal.roles else { return self.goal };
        let (x, y) = (&self.objects[a], &self.objects[b]);
        let across = |o: &ObjectGeometry| {
            (target.centre[0] - o.centre[0]).abs() / (target.size() + o.size()).max(1e-9)
        };
        if x.movable == y.movable && across(y) < across(x) {
            GoalFrame::new([Some(b), Some(a)], &self.objects)
        } else {
            self.goal
        }
    }

    /// The goal's two objects: distance, sizes, and the room behind "a" and beyond "b".
    fn pair_features(&self, goal: GoalFrame, out: &mut Vec<f32>) {
        let [Some(a), Some(b)] = goal.roles.map(|role| role.map(|k| &self.objects[k])) else {
            out.resize(out.len() + PAIR_FEATURES, 0.0);
            return;
        };
        let width = self.size()[0];
        let reach = (a.size() + b.size()).max(1e-9);
        let distance = (b.centre[0] - a.centre[0]) * goal.ahead;
        out.extend([clamp_to_unit(distance / width), squash(distance / reach)]);
        out.push(clamp_to_unit((a.size() - b.size()) / reach));
        for (thing, side) in [(a, -goal.ahead), (b, goal.ahead)] {
            let edge = thing.centre[0] + side * thing.half[0];
            let room = if side > 0.0 { self.frame[2] - edge } else { edge - self.frame[0] };
            out.push(squash(room / (2.0 * thing.size().max(1e-9))));
            out.push(clamp_to_unit(2.0 * room / width));
        }
        out.extend([a, b].map(|thing| clamp_to_unit(8.0 * thing.size() / width)));
    }

    /// Collision of a placed object with "a", if either falls on the other: speed of the fall, the placed object's share of the mass
    /// (area as mass), and deflection by the impact angle, without and with that share.
    fn impact_features(&self, target: &ObjectGeometry, goal: GoalFrame, out: &mut Vec<f32>) {
        let Some(pushed) = goal.roles[0].map(|a| &self.objects[a]) else {
            out.resize(out.len() + IMPACT_FEATURES, 0.0);
            return;
        };
        let reach = (target.size() + pushed.size()).max(1e-9);
        let hit = ((pushed.centre[0] - target.centre[0]) * goal.ahead / reach).clamp(-1.0, 1.0);
        let top = (1.0 - hit * hit).sqrt();
        // The lower object comes to rest first; the upper one falls on it.
        let (upper, lower) =
            if target.centre[1] > pushed.centre[1] { (target, pushed) } else { (pushed, target) };
        let floor = self.frame[1] + lower.half[1];
        let drop = ((upper.centre[1] - floor - reach * top) / self.size()[1]).clamp(0.0, 1.0).sqrt();
        let share = target.size().powi(2) / (target.size().powi(2) + pushed.size().powi(2)).max(1e-18);
        let meets = if hit.abs() < 1.0 { drop } else { 0.0 };
        let deflection = 2.0 * hit * top * drop;
        out.extend([meets, share, deflection, deflection * share].map(clamp_to_unit));
    }

    /// Velocity relative to that of a fall through the scene's height.
    fn velocity_features(&self, thing: &ObjectGeometry, ahead: f64) -> [f32; 2] {
        let [gx, gy] = self.scene.gravity;
        let fall = (2.0 * length(gx, gy) * self.size()[1]).sqrt().max(1e-9);
        [squash(ahead * thing.velocity[0] / fall), squash(thing.velocity[1] / fall)]
    }

    /// Position as a share of the scene's half size, mirrored if necessary.
    fn relative_position(&self, [x, y]: [f64; 2], ahead: f64) -> [f32; 2] {
        let [width, height] = self.size();
        let across = 2.0 * (x - self.frame[0]) / width - 1.0;
        [clamp_to_unit(ahead * across), clamp_to_unit(2.0 * (y - self.frame[1]) / height - 1.0)]
    }

    /// Position, size and clearance of a placed object, and its fall time.
    fn clearance_features(&self, target: &ObjectGeometry, ahead: f64, out: &mut Vec<f32>) {
        let [width, height] = self.size();
        let size = target.size().max(1e-9);
        let [left, right] = [
            target.centre[0] - target.half[0] - self.frame[0],
            self.frame[2] - target.centre[0] - target.half[0],
        ];
        let (behind, before) = if ahead > 0.0 { (left, right) } else { (right, left) };
        let under = target.bottom() - self.frame[1];
        let over = self.frame[3] - target.centre[1] - target.half[1];
        out.extend(self.relative_position(target.centre, ahead));
        out.push(clamp_to_unit(8.0 * size / width));
        out.extend([behind, before, under].map(|room| squash(room / (2.0 * size))));
        out.extend([under, over].map(|room| clamp_to_unit((room / height).max(0.0).sqrt())));
    }

    /// Position of a placed object relative to another, given with their signed distance (m), and properties of that one; all 0 if
    /// there is none.
    fn relation_features(
        &self,
        target: &ObjectGeometry,
        object: Option<(f64, &ObjectGeometry)>,
        ahead: f64,
        out: &mut Vec<f32>,
    ) {
        let Some((gap, object)) = object else {
            out.resize(out.len() + RELATION_FEATURES, 0.0);
            return;
        };
        let [width, height] = self.size();
        let reach = (target.size() + object.size()).max(1e-9);
        let dx = (target.centre[0] - object.centre[0]) * ahead;
        let dy = target.centre[1] - object.centre[1];
        let apart = length(dx, dy).max(1e-9);
        // Impact point of a vertical fall on the other object, relative to the sum of the half widths.
        let wide = (target.half[0] + object.half[0]).max(1e-9);
        let hit = (dx / wide).clamp(-1.0, 1.0);
        let top = (1.0 - hit * hit).sqrt();
        let fall = |thing: &ObjectGeometry| ((thing.bottom() - self.frame[1]) / height).max(0.0).sqrt();
        out.extend([
            1.0,
            clamp_to_unit(2.0 * dx / width),
            clamp_to_unit(2.0 * dy / height),
            squash(dx / reach),
            squash(dy / reach),
        ]);
        out.extend([
            squash(gap / reach),
            clamp_to_unit(8.0 * gap / width),
            clamp_to_unit(dx / apart),
            clamp_to_unit(dy / apart),
        ]);
        out.extend([
            clamp_to_unit(hit),
            clamp_to_unit(top),
            clamp_to_unit((target.size() - object.size()) / reach),
        ]);
        out.extend([clamp_to_unit(fall(target) - fall(object)), clamp_to_unit(8.0 * object.half[0] / width)]);
        out.extend([
            clamp_to_unit(8.0 * object.half[1] / height),
            indicator(object.disc),
            indicator(object.movable),
        ]);
        let form = form_features(object, ahead);
        out.extend([form[0], form[1], form[2], form[3]]);
    }

    /// Whether the ballistic trajectory of a placed object reaches another, and its height above that one.
    fn flight_features(&self, target: &ObjectGeometry, role: Option<usize>) -> [f32; 2] {
        let Some(object) = role.map(|k| &self.objects[k]) else { return [0.0; 2] };
        let [dx, dy] = [0, 1].map(|k| target.centre[k] - object.centre[k]);
        let [vx, vy] = [0, 1].map(|k| target.velocity[k] - object.velocity[k]);
        let ([gx, gy], time) = (self.scene.gravity, -dx / vx);
        if !(time.is_finite() && time >= 0.0) {
            return [-1.0, 0.0];
        }
        let high = dy + vy * time + 0.5 * gy * time * time;
        let reach = (target.size() + object.size()).max(1e-9);
        [1.0, if gx == 0.0 { squash(high / reach) } else { 0.0 }]
    }

    /// Support below an object at its rear end, centre and front end: distance, slope and kind.
    fn support_features(&self, thing: &ObjectGeometry, goal: GoalFrame, out: &mut Vec<f32>) {
        let height = self.size()[1];
        let step = 0.02 * thing.half[0].max(1e-6);
        for share in [-0.9, 0.0, 0.9] {
            let x = thing.centre[0] + goal.ahead * share * thing.half[0];
            let under =
                |object: &ObjectGeometry| object.top(x, thing.centre[1]).filter(|y| *y < thing.centre[1]);
            let first = self.objects.iter().enumerate().filter_map(|(k, o)| Some((k, o, under(o)?)));
            match first.max_by(|p, q| p.2.total_cmp(&q.2)) {
                Some((k, object, y)) => {
                    let beside = object.top(x + goal.ahead * step, thing.centre[1]).unwrap_or(y);
                    out.push(clamp_to_unit(((thing.bottom() - y) / height).max(0.0).sqrt()));
                    out.push(squash((beside - y) / step));
                    out.extend(goal.roles.map(|role| indicator(role == Some(k))));
                    out.push(indicator(object.movable));
                }
                None => {
                    let floor = (thing.bottom() - self.frame[1]) / height;
                    out.extend([clamp_to_unit(floor.max(0.0).sqrt()), 0.0, -1.0, -1.0, -1.0]);
                }
            }
        }
    }

    fn size(&self) -> [f64; 2] {
        [(self.frame[2] - self.frame[0]).max(1e-9), (self.frame[3] - self.frame[1]).max(1e-9)]
    }
}

/// Orientation, centre of mass and filled share of the bounding box, mirrored if `ahead` is -1.
fn form_features(thing: &ObjectGeometry, ahead: f64) -> [f32; 5] {
    let ([cos, sin], [x, y]) = (thing.turned, thing.lean);
    [cos, ahead * sin, ahead * x, y, thing.full].map(clamp_to_unit)
}

/// An object with its signed distance from another, m.
fn with_gap<'o>(from: &ObjectGeometry, object: &'o ObjectGeometry) -> (f64, &'o ObjectGeometry) {
    (from.solid.signed_distance(&object.solid), object)
}

/// Clamps to [-1, 1]; NaN becomes 0.
fn clamp_to_unit(v: f64) -> f32 {
    if v.is_nan() { 0.0 } else { v.clamp(-1.0, 1.0) as f32 }
}

/// Squashing function v / (1 + |v|).
fn squash(v: f64) -> f32 {
    clamp_to_unit(v / (1.0 + v.abs()))
}

fn indicator(yes: bool) -> f32 {
    if yes { 1.0 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;
    use crate::task::action::ActionComponent;
    use crate::task::scene::{Shape, Static};
    use crate::task::shape::Disc;
    use crate::task::{custom, families};

    fn check(task: &Task) -> [usize; 2] {
        let (features, space) = (FeatureExtractor::new(task), task.actions());
        let in_range = |v: &[f32]| v.iter().all(|v| (-1.0..=1.0).contains(v));
        let scene = features.scene();
        assert_eq!(scene.len(), 4 + MAX_OBJECTS * OBJECT_FEATURES + 3 * SUPPORT_FEATURES, "{}", task.id);
        assert!(in_range(&scene), "{}: {scene:?}", task.id);
        let corners = [0.0, 1.0].map(|v| space.validate(&vec![v; space.dimension()]).unwrap());
        let others = (0..50).map(|i| space.at(i * 13 % space.count()).unwrap());
        let rows: Vec<Vec<f32>> = corners.into_iter().chain(others).map(|a| features.action(&a)).collect();
        assert!(rows.iter().all(|row| row.len() == rows[0].len() && in_range(row)), "{}", task.id);
        [scene.len(), rows[0].len()]
    }

    fn task_with(shape: &str, angle: f64, movable: bool) -> Task {
        let mut task = toy::task(0.3);
        let shape: Shape = crate::json::parse(shape).unwrap();
        if movable {
            let body = crate::task::scene::Body {
                name: "thing".into(),
                shape,
                position: Some([5.0, 5.0]),
                angle,
                ..task.scene.bodies[0].clone()
            };
            task.scene.bodies.push(body);
        } else {
            let fixed = Static {
                name: "thing".into(),
                shape,
                friction: 1.0,
                restitution: 0.5,
                position: [5.0, 5.0],
                angle,
            };
            task.scene.statics.push(fixed);
        }
        task
    }

    const JAR: &str = r#"{"type": "compound", "pieces": [
        {"type": "box", "half_width": 1, "half_height": 0.1, "position": [0, -1]},
        {"type": "box", "half_width": 0.1, "half_height": 1, "position": [-1, 0]},
        {"type": "box", "half_width": 0.1, "half_height": 1, "position": [1, 0]}]}"#;
    const BAR: &str = r#"{"type": "box", "half_width": 1, "half_height": 0.1}"#;

    #[test]
    fn features_have_fixed_dimension_and_range() {
        for family in families() {
            let sizes: Vec<[usize; 2]> = family.tasks().iter().step_by(9).map(check).collect();
            assert!(sizes.iter().all(|s| *s == sizes[0]), "{}", family.name);
        }
        let ball = check(&toy::task(0.3));
        for (shape, movable) in [(JAR, true), (JAR, false), (BAR, true), (BAR, false)] {
            assert_eq!(check(&task_with(shape, 0.4, movable)), ball);
        }
        let thrown = r#"{"format": "iplw.scene/1", "bodies": [{"name": "ball", "shape": {"type": "disc",
            "radius": 0.1}, "position": [0, 1]}], "statics": [{"name": "floor", "shape": {"type": "halfspace",
            "normal": [0, 1], "offset": 0}}], "goal": {"type": "contact", "bodies": ["ball", "floor"]},
            "action": {"components": [{"target": "ball", "set": "vx", "low": 0, "high": 9}, {"target": "ball",
            "set": "omega", "low": 0, "high": 1}]}}"#;
        let tilted = r#"{"format": "iplw.scene/1", "bodies": [{"name": "box", "shape": {"type": "box",
            "half_width": 1e-3, "half_height": 5}, "position": [0, 900]}], "statics": [{"name": "ramp",
            "shape": {"type": "polygon", "vertices": [[0, 0], [9, 0], [0, 9]]}}], "goal": {"type": "contact",
            "bodies": ["box", "ramp"]}, "action": {"components": [{"target": "ramp", "set": "angle", "low": -3,
            "high": 3}]}}"#;
        for text in [thrown, tilted] {
            check(&custom(Scene::from_json(text).unwrap()).unwrap());
        }
    }

    #[test]
    fn ballistic_feature_is_zero_for_a_hit() {
        // 1 m up, 4.9 m/s^2 / 2 ... thrown at 5 m/s it falls 1.225 m in the 0.5 s to x = 2.5.
        let text = r#"{"format": "iplw.scene/1", "gravity": [0, -9.8], "bodies": [{"name": "ball",
            "shape": {"type": "disc", "radius": 0.5}, "position": [0, 1.225]}], "goal": {"type": "inside",
            "body": "ball", "region": [[2, -0.5], [3, -0.5], [3, 0.5], [2, 0.5]]}, "action": {"components": [
            {"target": "ball", "set": "vx", "low": 0, "high": 10}]}}"#;
        let task = custom(Scene::from_json(text).unwrap()).unwrap();
        let miss = |v: f64| {
            let row = FeatureExtractor::new(&task).action(&task.actions().validate(&[v]).unwrap());
            row[row.len() - 1]
        };
        assert!(miss(0.5).abs() < 1e-6 && miss(0.6) > 0.1 && miss(0.4) < -0.1);
    }

    /// Features of all shapes placed by the action are within range and depend on its place.
    #[test]
    fn features_cover_all_shapes() {
        for shape in Shape::samples() {
            let mut task = toy::task(0.3);
            let named = |name: &str| Static {
                name: name.into(),
                shape: shape.clone(),
                friction: 1.0,
                restitution: 1.0,
                position: [5.0, 5.0],
                angle: 0.0,
            };
            task.scene.statics = vec![named("object"), named("target")];
            let space = task.scene.action.as_mut().unwrap();
            let set = |set| ActionComponent { target: "target".into(), set, low: 1.0, high: 9.0 };
            space.components = vec![set(ActionQuantity::X), set(ActionQuantity::Y)];
            check(&task);
            let row = |v| FeatureExtractor::new(&task).action(&task.actions().validate(&[0.5, v]).unwrap());
            assert_ne!(row(0.1)[2..], row(0.9)[2..], "{shape:?}");
        }
    }

    /// Features are invariant under scaling of all lengths.
    #[test]
    fn features_are_scale_invariant() {
        let small = toy::task(0.3);
        let mut large = small.clone();
        for body in &mut large.scene.bodies {
            body.position = body.position.map(|p| p.map(|v| 2.0 * v));
            let radius = body.shape.disc_radius().unwrap();
            body.shape = Disc { radius: 2.0 * radius }.into();
        }
        let space = large.scene.action.as_mut().unwrap();
        space.bounds = space.bounds.map(|b| b.map(|v| 2.0 * v));
        for c in &mut space.components {
            (c.low, c.high) = (2.0 * c.low, 2.0 * c.high);
        }
        let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        let [one, other] = [&small, &large].map(FeatureExtractor::new);
        assert!(close(&one.scene(), &other.scene()));
        for i in 0..50 {
            let action = small.actions().at(i).unwrap();
            assert!(close(&one.action(&action), &other.action(&action)), "{i}");
        }
    }

    /// Under reflection only the raw position differs, and the frame, if both balls may be pushed.
    #[test]
    fn mirrored_pushes_have_equal_features() {
        let task = toy::task(0.3);
        let mut mirrored = task.clone();
        for body in &mut mirrored.scene.bodies {
            body.position = body.position.map(|[x, y]| [10.0 - x, y]);
        }
        let [one, other] = [&task, &mirrored].map(FeatureExtractor::new);
        for i in 0..200 {
            let action = task.actions().at(i).unwrap();
            let v = action.values();
            let turned = task.actions().validate(&[1.0 - v[0], v[1], v[2]]).unwrap();
            let (a, b) = (one.action(&action), other.action(&turned));
            let differ: Vec<usize> = (0..a.len()).filter(|k| (a[*k] - b[*k]).abs() > 1e-5).collect();
            assert!(differ.iter().all(|k| [0, 3, 4].contains(k)), "{differ:?}");
        }
    }

    /// Features distinguish orientation, reflection, movability and kind of shape.
    #[test]
    fn different_shapes_have_different_features() {
        let half_turn = std::f64::consts::PI;
        let looks = [
            task_with(BAR, 0.0, false),
            task_with(BAR, 0.5, false),
            task_with(BAR, -0.5, false),
            task_with(BAR, 0.0, true),
            task_with(JAR, 0.0, false),
            task_with(JAR, half_turn, false),
            task_with(JAR, 0.0, true),
            task_with(r#"{"type": "disc", "radius": 1}"#, 0.0, false),
            task_with(r#"{"type": "box", "half_width": 1, "half_height": 1}"#, 0.0, false),
            task_with(r#"{"type": "polygon", "vertices": [[-1, -1], [1, -1], [-1, 1]]}"#, 0.0, false),
            task_with(r#"{"type": "polygon", "vertices": [[-1, -1], [1, -1], [1, 1]]}"#, 0.0, false),
        ]
        .map(|task| (FeatureExtractor::new(&task).scene(), task));
        for (i, (a, one)) in looks.iter().enumerate() {
            for (b, other) in &looks[i + 1..] {
                let far = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(far > 0.05, "{:?} {:?}", one.scene.statics, other.scene.statics);
            }
        }
    }

    /// Features are invariant under reflection, since "b" lies ahead of "a" in both scenes.
    #[test]
    fn features_are_mirror_invariant() {
        let task = task_with(BAR, 0.5, false);
        let mut mirrored = task.clone();
        for body in &mut mirrored.scene.bodies {
            body.position = body.position.map(|[x, y]| [10.0 - x, y]);
        }
        for fixed in &mut mirrored.scene.statics {
            fixed.position[0] = 10.0 - fixed.position[0];
            fixed.angle = -fixed.angle;
        }
        // If both balls are movable, the left one is "a" in either scene, so reflection swaps them. If blue is fixed, it is "b" in both.
        let fix = |task: &mut Task| {
            let blue = task.scene.bodies.remove(1);
            task.scene.statics.push(Static {
                name: blue.name,
                shape: blue.shape,
                friction: 1.0,
                restitution: 0.5,
                position: blue.position.unwrap(),
                angle: 0.0,
            });
        };
        let [mut task, mut mirrored] = [task, mirrored];
        fix(&mut task);
        fix(&mut mirrored);
        let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        let (one, other) = (FeatureExtractor::new(&task), FeatureExtractor::new(&mirrored));
        assert!(one.goal.ahead != other.goal.ahead && close(&one.scene(), &other.scene()));
        for i in 0..100 {
            let action = task.actions().at(i).unwrap();
            let v = action.values();
            let turned = task.actions().validate(&[1.0 - v[0], v[1], v[2]]).unwrap();
            assert!(close(&one.action(&action), &other.action(&turned)), "{i}");
        }
    }
}
