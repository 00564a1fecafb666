//! Family-specific features of a task and an action: objects of the scene, components of the action, and relations between them.
//!
//! - *Scene features*: centre and half extents of every object (movable bodies that the scene itself places,
//!   bounded statics inside the scene, the goal's region), as shares of the scene's size.
//! - *Action features*: the raw components and, for every object that the action places, its clearance to the borders, its
//!   fall time, and its position *relative* to every object: offsets over the sum of sizes, gap, impact angle.
//!   Relative features transfer between tasks, absolute ones do not. If the goal is contact between two objects, the frame is oriented
//!   so that the object to be pushed comes first and the other lies ahead.
//!
//! Source: Semage et al. use images; PHYRE (Bakhtin et al. 2019) shows that a DQN on object features performs as well. All features
//! depend on the scene alone, not on latent factors, so a policy's inputs are the same in all worlds. Range: [-1, 1] for scenes of any
//! size (`squash`, `clamp_to_unit`).

use super::action_target::ActionTarget;
use crate::task::action::ActionQuantity;
use crate::task::geometry::Aabb;
use crate::task::scene::Goal;
use crate::task::solid::{ConvexPieces, Solid};
use crate::task::{Scene, Task, ValidAction};

/// Version of the features; a policy needs the version that it was trained with.
pub const VERSION: &str = "1";

/// Maximum number of objects: first the scene's bodies, then its statics.
const MAX_OBJECTS: usize = 12;

/// Features of a task that are shared by all of its actions.
#[derive(Clone, Debug)]
pub struct FamilyFeatures {
    /// Bounding box of the scene, m.
    frame: Aabb,
    objects: Vec<FamilyObject>,
    /// The two objects that must touch, the left one first.
    pair: Option<[usize; 2]>,
    /// Names of the objects that the action places, in the order of the action's components.
    targets: Vec<String>,
    /// Whether the action sets a velocity.
    launched: bool,
    scene: Scene,
}

/// Geometry of an object: bounding box and velocity.
#[derive(Clone, Debug)]
struct FamilyObject {
    /// Centre of the bounding box, m.
    centre: [f64; 2],
    /// Half extents of the bounding box, m.
    half: [f64; 2],
    /// m/s
    velocity: [f64; 2],
    solid: Solid,
}

/// Scene features of a task.
pub fn scene_features(task: &Task) -> Vec<f32> {
    FamilyFeatures::new(task).scene()
}

/// Action features of one action; use [`FamilyFeatures`] for many.
pub fn action_features(task: &Task, action: &ValidAction) -> Vec<f32> {
    FamilyFeatures::new(task).action(action)
}

/// Dimensions of the scene and action features of a task.
pub fn dimensions(task: &Task) -> [usize; 2] {
    let features = FamilyFeatures::new(task);
    let middle = vec![0.5; task.actions().dimension()];
    let action = task.actions().validate(&middle).map(|a| features.action(&a).len());
    [features.scene().len(), action.unwrap_or(0)]
}

impl FamilyFeatures {
    /// Features of a task's scene.
    pub fn new(task: &Task) -> FamilyFeatures {
        let (scene, space) = (&task.scene, task.actions());
        let frame = space.bounds.unwrap_or_else(|| scene.extent());
        let mut targets: Vec<String> = Vec::new();
        for component in &space.components {
            if !targets.contains(&component.target) {
                targets.push(component.target.clone());
            }
        }
        let mut named: Vec<(&str, FamilyObject)> = Vec::new();
        for body in scene.bodies.iter().filter(|b| !targets.contains(&b.name)) {
            if let (Some(position), Some(placed)) = (body.position, body.placed()) {
                let thing = FamilyObject::new(Solid::Bounded(placed), position, body.velocity);
                named.push((&body.name, thing));
            }
        }
        for fixed in scene.statics.iter().filter(|s| !targets.contains(&s.name)) {
            let solid = fixed.placed();
            let ground = solid.bounds().is_none();
            let thing = FamilyObject::new(solid, fixed.position, [0.0; 2]);
            // A wall's centre lies on or beyond the border; a half-plane has no centre and is a border itself.
            let [x, y] = thing.centre;
            if !ground && x > frame[0] && x < frame[2] && y > frame[1] && y < frame[3] {
                named.push((&fixed.name, thing));
            }
        }
        if let Some(Goal::Inside { region, .. }) = &scene.goal {
            let region = Solid::Bounded(ConvexPieces::one(region.clone(), 0.0));
            named.insert(0, ("", FamilyObject::new(region, [0.0; 2], [0.0; 2])));
        }
        if let Some(line) = scene.goal.as_ref().and_then(|goal| goal.line()) {
            named.insert(0, ("", FamilyObject::new(boundary_height(line, frame), [0.0; 2], [0.0; 2])));
        }
        named.truncate(MAX_OBJECTS);
        let mut pair = None;
        if let Some(Goal::Contact { bodies: [a, b], .. } | Goal::Apart { bodies: [a, b], .. }) = &scene.goal {
            let index = |name: &str| named.iter().position(|(n, _)| *n == name);
            if let (Some(i), Some(j)) = (index(a), index(b)) {
                // The goal is symmetric: the left one comes first.
                let swapped = named[j].1.centre[0] < named[i].1.centre[0];
                pair = Some(if swapped { [j, i] } else { [i, j] });
            }
        }
        let objects = named.into_iter().map(|(_, thing)| thing).collect();
        let launched =
            space.components.iter().any(|c| matches!(c.set, ActionQuantity::Vx | ActionQuantity::Vy));
        FamilyFeatures { frame, objects, pair, targets, launched, scene: scene.clone() }
    }

    /// (n_scene,) positions and sizes of the objects.
    pub fn scene(&self) -> Vec<f32> {
        let mut out = Vec::new();
        let [width, height] = self.size();
        for object in &self.objects {
            out.push(clamp_to_unit(2.0 * (object.centre[0] - self.frame[0]) / width - 1.0));
            out.push(clamp_to_unit(2.0 * (object.centre[1] - self.frame[1]) / height - 1.0));
            out.push(clamp_to_unit(8.0 * object.half[0] / width));
            out.push(clamp_to_unit(8.0 * object.half[1] / height));
        }
        if let Some([i, j]) = self.pair {
            let (left, right) = (&self.objects[i], &self.objects[j]);
            let reach = (left.size() + right.size()).max(1e-9);
            let dx = right.centre[0] - left.centre[0];
            out.push(clamp_to_unit(dx / width));
            out.push(squash(dx / reach));
            out.push(clamp_to_unit((left.size() - right.size()) / reach));
        }
        // The network needs at least one input, even for an empty scene.
        if out.is_empty() {
            out.push(1.0);
        }
        out
    }

    /// (n_action,) components of the action and relations of the placed objects to the others.
    pub fn action(&self, action: &ValidAction) -> Vec<f32> {
        let mut out = Vec::with_capacity(64);
        out.extend(action.values().iter().map(|v| clamp_to_unit(2.0 * v - 1.0)));
        let targets = self.placed_targets(action);
        for (i, target) in targets.iter().enumerate() {
            match self.pair {
                Some(pair) => self.ballistic_features(target, pair, &mut out),
                None => self.clearance_features(target, 1.0, &mut out),
            }
            let in_pair = |k: usize| self.pair.is_some_and(|pair| pair.contains(&k));
            for (_, object) in self.objects.iter().enumerate().filter(|(k, _)| !in_pair(*k)) {
                self.relation_features(target, object, 1.0, &mut out);
            }
            for other in &targets[i + 1..] {
                self.relation_features(target, other, 1.0, &mut out);
            }
        }
        out
    }

    /// Geometry of the objects that the action places.
    fn placed_targets(&self, action: &ValidAction) -> Vec<FamilyObject> {
        let place = |name: &String| {
            let placed = ActionTarget::new(&self.scene, name, action);
            FamilyObject::new(placed.solid(), placed.position, placed.velocity)
        };
        self.targets.iter().map(place).collect()
    }

    /// A placed object relative to the two that must touch, in a frame in which the horizontally nearer one (to be pushed) comes first
    /// and the other lies ahead. This maps the four cases (left or right object, pushed left or right) to the same features; two
    /// flags distinguish them.
    fn ballistic_features(&self, target: &FamilyObject, [i, j]: [usize; 2], out: &mut Vec<f32>) {
        let [width, height] = self.size();
        let across = |k: usize| {
            let object = &self.objects[k];
            (target.centre[0] - object.centre[0]).abs() / (target.size() + object.size()).max(1e-9)
        };
        let swap = across(j) < across(i);
        let (pushed, other) = if swap { (j, i) } else { (i, j) };
        let (pushed, other) = (&self.objects[pushed], &self.objects[other]);
        let ahead = if other.centre[0] < pushed.centre[0] { -1.0 } else { 1.0 };
        out.push(ahead as f32);
        out.push(if swap { 1.0 } else { -1.0 });
        self.clearance_features(target, ahead, out);
        self.relation_features(target, pushed, ahead, out);
        self.relation_features(target, other, ahead, out);
        let reach = (pushed.size() + other.size()).max(1e-9);
        let distance = (other.centre[0] - pushed.centre[0]) * ahead;
        out.push(clamp_to_unit(distance / width));
        out.push(squash(distance / reach));
        out.push(clamp_to_unit((pushed.size() - other.size()) / reach));
        out.push(squash(self.margin(pushed, -ahead) / (2.0 * pushed.size().max(1e-9))));
        out.push(clamp_to_unit(2.0 * self.margin(pushed, -ahead) / width));
        out.push(squash(self.margin(other, ahead) / (2.0 * other.size().max(1e-9))));
        out.push(clamp_to_unit(2.0 * self.margin(other, ahead) / width));
        out.push(clamp_to_unit(8.0 * pushed.size() / width));
        out.push(clamp_to_unit(8.0 * other.size() / width));
        // The lower object comes to rest first; the upper one falls on it from this height and is deflected, or deflects it, by the impact
        // angle. The mass share (area as mass) determines which one moves.
        let reach = (target.size() + pushed.size()).max(1e-9);
        let hit = ((pushed.centre[0] - target.centre[0]) * ahead / reach).clamp(-1.0, 1.0);
        let top = (1.0 - hit * hit).sqrt();
        let (upper, lower) =
            if target.centre[1] > pushed.centre[1] { (target, pushed) } else { (pushed, target) };
        let floor = self.frame[1] + lower.half[1];
        let drop = ((upper.centre[1] - floor - reach * top) / height).clamp(0.0, 1.0).sqrt();
        let share = target.size().powi(2) / (target.size().powi(2) + pushed.size().powi(2)).max(1e-18);
        let meets = if hit.abs() < 1.0 { 1.0 } else { 0.0 };
        out.push(clamp_to_unit(meets * drop));
        out.push(clamp_to_unit(share));
        out.push(clamp_to_unit(2.0 * hit * top * drop));
        out.push(clamp_to_unit(2.0 * hit * top * drop * share));
    }

    /// Clearance around a placed object, and its fall time; `ahead` is the direction (+-1) called ahead.
    fn clearance_features(&self, target: &FamilyObject, ahead: f64, out: &mut Vec<f32>) {
        let [width, height] = self.size();
        let size = target.size().max(1e-9);
        let below = target.bottom() - self.frame[1];
        let above = self.frame[3] - target.centre[1] - target.half[1];
        out.push(clamp_to_unit(8.0 * target.size() / width));
        out.push(squash(self.margin(target, -ahead) / (2.0 * size)));
        out.push(squash(self.margin(target, ahead) / (2.0 * size)));
        out.push(squash(below / (2.0 * size)));
        out.push(clamp_to_unit((below / height).max(0.0).sqrt()));
        out.push(clamp_to_unit((above / height).max(0.0).sqrt()));
    }

    /// Clearance between an object and the scene's border to the right (`side` 1) or left (-1), m.
    fn margin(&self, thing: &FamilyObject, side: f64) -> f64 {
        let edge = thing.centre[0] + side * thing.half[0];
        if side > 0.0 { self.frame[2] - edge } else { edge - self.frame[0] }
    }

    /// Position of a placed object relative to another; `ahead` is the direction (+-1) in which x is positive.
    fn relation_features(
        &self,
        target: &FamilyObject,
        object: &FamilyObject,
        ahead: f64,
        out: &mut Vec<f32>,
    ) {
        let [width, height] = self.size();
        let reach = (target.size() + object.size()).max(1e-9);
        let dx = (target.centre[0] - object.centre[0]) * ahead;
        let dy = target.centre[1] - object.centre[1];
        let apart = (dx * dx + dy * dy).sqrt().max(1e-9);
        let between = target.solid.signed_distance(&object.solid);
        let (over, up) = (dx / reach, dy / reach);
        // Impact point of a vertical fall on the other object: sine and cosine from its top.
        let hit = over.clamp(-1.0, 1.0);
        let top = (1.0 - hit * hit).sqrt();
        let above = up.clamp(-1.0, 1.0);
        out.push(clamp_to_unit(2.0 * dx / width));
        out.push(clamp_to_unit(2.0 * dy / height));
        out.push(squash(over));
        out.push(squash(up));
        out.push(squash(between / reach));
        out.push(clamp_to_unit(dx / apart));
        out.push(clamp_to_unit(dy / apart));
        out.push(clamp_to_unit(hit));
        out.push(clamp_to_unit(top));
        out.push(clamp_to_unit(hit * above));
        out.push(clamp_to_unit(top * above));
        out.push(clamp_to_unit((target.size() - object.size()) / reach));
        // Difference between the fall times of both objects.
        let fall = |thing: &FamilyObject| ((thing.bottom() - self.frame[1]) / height).max(0.0).sqrt();
        out.push(clamp_to_unit(fall(target) - fall(object)));
        if self.launched {
            // Height of the ballistic trajectory above the object; 0 if it does not reach the object.
            let relative = [0, 1].map(|k| target.velocity[k] - object.velocity[k]);
            let time = -dx * ahead / relative[0];
            let [gx, gy] = self.scene.gravity;
            let (time, arrives) = if time.is_finite() && time >= 0.0 { (time, 1.0) } else { (0.0, -1.0) };
            let high = dy + relative[1] * time + 0.5 * gy * time * time;
            out.push(arrives as f32);
            out.push(if arrives > 0.0 && gx == 0.0 { squash(high / reach) } else { 0.0 });
        }
    }

    fn size(&self) -> [f64; 2] {
        [(self.frame[2] - self.frame[0]).max(1e-9), (self.frame[3] - self.frame[1]).max(1e-9)]
    }
}

/// Height of a half-plane's boundary at the sides of the frame.
pub(super) fn boundary_height(([nx, ny], offset): ([f64; 2], f64), frame: Aabb) -> Solid {
    let at = |x: f64| [x, (offset - nx * x) / ny];
    Solid::Bounded(ConvexPieces::one(vec![at(frame[0]), at(frame[2])], 0.0))
}

impl FamilyObject {
    /// `position` is used if the solid has no bounds.
    fn new(solid: Solid, position: [f64; 2], velocity: [f64; 2]) -> FamilyObject {
        let [x, y] = position;
        let b = solid.bounds().unwrap_or([x, y, x, y]);
        FamilyObject {
            centre: [(b[0] + b[2]) / 2.0, (b[1] + b[3]) / 2.0],
            half: [(b[2] - b[0]) / 2.0, (b[3] - b[1]) / 2.0],
            velocity,
            solid,
        }
    }
    /// Radius of a disc; mean half extent of other shapes.
    fn size(&self) -> f64 {
        (self.half[0] + self.half[1]) / 2.0
    }
    fn bottom(&self) -> f64 {
        self.centre[1] - self.half[1]
    }
}

/// Clamps to [-1, 1]; NaN becomes 0.
pub(super) fn clamp_to_unit(v: f64) -> f32 {
    if v.is_nan() { 0.0 } else { v.clamp(-1.0, 1.0) as f32 }
}

/// Squashing function v / (1 + |v|).
pub(super) fn squash(v: f64) -> f32 {
    clamp_to_unit(v / (1.0 + v.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;
    use crate::task::action::ActionComponent;
    use crate::task::scene::{Shape, Static};
    use crate::task::shape::Disc;
    use crate::task::{Split, custom, families};

    fn check(task: &Task) -> [usize; 2] {
        let features = FamilyFeatures::new(task);
        let space = task.actions();
        let [n_scene, n_action] = dimensions(task);
        let in_range = |v: &[f32]| v.iter().all(|v| (-1.0..=1.0).contains(v));
        assert!(features.scene().len() == n_scene && in_range(&features.scene()), "{}", task.id);
        let corners = [0.0, 1.0].map(|v| space.validate(&vec![v; space.dimension()]).unwrap());
        let others = (0..200).map(|i| space.at(i * 13 % space.count()).unwrap());
        for action in corners.into_iter().chain(others) {
            let row = features.action(&action);
            assert!(row.len() == n_action && in_range(&row), "{}: {row:?}", task.id);
        }
        [n_scene, n_action]
    }

    #[test]
    fn features_are_bounded_with_fixed_dimension_per_family() {
        for family in families() {
            let task = |scene: &Scene| Task {
                id: "x".into(),
                family: family.name.into(),
                split: Split::Train,
                scene: scene.clone(),
                certificate: None,
            };
            let sizes: Vec<[usize; 2]> =
                family.candidates(0).step_by(97).map(|scene| check(&task(&scene))).collect();
            assert!(sizes.iter().all(|s| *s == sizes[0]), "{}", family.name);
        }
    }

    #[test]
    fn custom_scenes_have_features() {
        let thrown = r#"{"format": "iplw.scene/1", "bodies": [{"name": "ball", "shape": {"type": "disc",
            "radius": 0.1}, "position": [0, 1]}], "statics": [{"name": "floor", "shape": {"type": "halfspace",
            "normal": [0, 1], "offset": 0}}], "goal": {"type": "inside", "body": "ball",
            "region": [[3, 0], [4, 0], [4, 1]]}, "action": {"components": [
            {"target": "ball", "set": "vx", "low": 0, "high": 9}, {"target": "ball", "set": "omega", "low": 0,
            "high": 1}]}}"#;
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
            let row = action_features(&task, &task.actions().validate(&[v]).unwrap());
            row[row.len() - 1]
        };
        assert!(miss(0.5).abs() < 1e-6 && miss(0.6) > 0.1 && miss(0.4) < -0.1);
    }

    /// Features of all shapes, in the scene or placed by the action, are within range.
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
            let look = |v: f64| {
                let action = task.actions().validate(&[0.5, v]).unwrap();
                action_features(&task, &action)
            };
            assert!(look(0.1).iter().all(|v| (-1.0..=1.0).contains(v)), "{shape:?}");
            assert_ne!(look(0.1)[2..], look(0.9)[2..], "{shape:?}");
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
        assert_eq!(scene_features(&small), scene_features(&large));
        for i in 0..50 {
            let action = small.actions().at(i).unwrap();
            assert_eq!(action_features(&small, &action), action_features(&large, &action));
        }
    }

    /// Under reflection only the raw position and the two flags differ.
    #[test]
    fn features_are_mirror_symmetric() {
        let task = toy::task(0.3);
        let mut mirrored = task.clone();
        for body in &mut mirrored.scene.bodies {
            body.position = body.position.map(|[x, y]| [10.0 - x, y]);
        }
        for i in 0..200 {
            let action = task.actions().at(i).unwrap();
            let v = action.values();
            let turned = task.actions().validate(&[1.0 - v[0], v[1], v[2]]).unwrap();
            let (a, b) = (action_features(&task, &action), action_features(&mirrored, &turned));
            let differ: Vec<usize> = (0..a.len()).filter(|k| (a[*k] - b[*k]).abs() > 1e-5).collect();
            assert!(differ.iter().all(|k| [0, 3, 4].contains(k)), "{differ:?}");
        }
    }
}
