//! Task and action as numbers: what stands in the scene, what the action sets, and how the two relate.
//!
//! - *Scene features*: centre and half extents of every object (movable bodies that the scene itself places,
//!   bounded statics inside the scene, the goal's region), as shares of the scene's size.
//! - *Action features*: the raw components, and for every thing the action places its room to the borders, its
//!   fall time, and its place *relative* to every object: offsets over the sum of sizes, gap, hit angle.
//!   Relative features carry over between tasks, which absolute ones do not. If the goal wants two objects to
//!   touch, the view turns so that the one about to be pushed comes first and the other lies ahead.
//!
//! Source: Semage et al. use images; PHYRE (Bakhtin et al. 2019) shows that a DQN on object features does as
//! well. Everything here is computed from the scene alone: no latent factor enters, so a policy's inputs do
//! not change between worlds. Range: squashed to [-1, 1] (`soft`, clamps), so that no scene,
//! however large, gives an input that is not.

use super::placed::Placed;
use crate::task::action::Quantity;
use crate::task::geometry::Bounds;
use crate::task::scene::Goal;
use crate::task::solid::{Pieces, Solid};
use crate::task::{Scene, Task, ValidAction};

/// Version of the features; a policy runs only on the one it was trained on.
pub const VERSION: &str = "1";

/// Most objects that are looked at; a scene's bodies come first, then statics.
const MOST_OBJECTS: usize = 12;

/// What of a task stays the same for all of its actions.
#[derive(Clone, Debug)]
pub struct Features {
    /// The scene's box, m.
    frame: Bounds,
    objects: Vec<Thing>,
    /// The two objects that the goal wants to touch, the left one first.
    pair: Option<[usize; 2]>,
    /// Names of what the action places, in the order of the action's components.
    targets: Vec<String>,
    /// Whether the action sets a velocity.
    launched: bool,
    scene: Scene,
}

/// Something with a place.
#[derive(Clone, Debug)]
struct Thing {
    /// Middle of the bounding box, m.
    centre: [f64; 2],
    /// Half extents of the bounding box, m.
    half: [f64; 2],
    /// m/s
    velocity: [f64; 2],
    solid: Solid,
}

/// Scene features of a task.
pub fn scene_features(task: &Task) -> Vec<f32> {
    Features::new(task).scene()
}

/// Action features of one action; use [`Features`] for many.
pub fn action_features(task: &Task, action: &ValidAction) -> Vec<f32> {
    Features::new(task).action(action)
}

/// Numbers of scene and of action features of a task.
pub fn dimensions(task: &Task) -> [usize; 2] {
    let features = Features::new(task);
    let middle = vec![0.5; task.actions().dimension()];
    let action = task.actions().validate(&middle).map(|a| features.action(&a).len());
    [features.scene().len(), action.unwrap_or(0)]
}

impl Features {
    /// Reads a task's scene.
    pub fn new(task: &Task) -> Features {
        let (scene, space) = (&task.scene, task.actions());
        let frame = space.bounds.unwrap_or_else(|| scene.extent());
        let mut targets: Vec<String> = Vec::new();
        for component in &space.components {
            if !targets.contains(&component.target) {
                targets.push(component.target.clone());
            }
        }
        let mut named: Vec<(&str, Thing)> = Vec::new();
        for body in scene.bodies.iter().filter(|b| !targets.contains(&b.name)) {
            if let (Some(position), Some(placed)) = (body.position, body.placed()) {
                let thing = Thing::new(Solid::Bounded(placed), position, body.velocity);
                named.push((&body.name, thing));
            }
        }
        for fixed in scene.statics.iter().filter(|s| !targets.contains(&s.name)) {
            let solid = fixed.placed();
            let ground = solid.bounds().is_none();
            let thing = Thing::new(solid, fixed.position, [0.0; 2]);
            // A wall's middle lies on or beyond the border; ground, which has no middle, is a border itself.
            let [x, y] = thing.centre;
            if !ground && x > frame[0] && x < frame[2] && y > frame[1] && y < frame[3] {
                named.push((&fixed.name, thing));
            }
        }
        if let Some(Goal::Inside { region, .. }) = &scene.goal {
            let region = Solid::Bounded(Pieces::one(region.clone(), 0.0));
            named.insert(0, ("", Thing::new(region, [0.0; 2], [0.0; 2])));
        }
        if let Some(line) = scene.goal.as_ref().and_then(|goal| goal.line()) {
            named.insert(0, ("", Thing::new(level(line, frame), [0.0; 2], [0.0; 2])));
        }
        named.truncate(MOST_OBJECTS);
        let mut pair = None;
        if let Some(Goal::Contact { bodies: [a, b], .. } | Goal::Apart { bodies: [a, b], .. }) = &scene.goal {
            let index = |name: &str| named.iter().position(|(n, _)| *n == name);
            if let (Some(i), Some(j)) = (index(a), index(b)) {
                // The goal does not care which is which: the left one first.
                let swapped = named[j].1.centre[0] < named[i].1.centre[0];
                pair = Some(if swapped { [j, i] } else { [i, j] });
            }
        }
        let objects = named.into_iter().map(|(_, thing)| thing).collect();
        let launched = space.components.iter().any(|c| matches!(c.set, Quantity::Vx | Quantity::Vy));
        Features { frame, objects, pair, targets, launched, scene: scene.clone() }
    }

    /// (n_scene,) where and how large the objects are.
    pub fn scene(&self) -> Vec<f32> {
        let mut out = Vec::new();
        let [width, height] = self.size();
        for object in &self.objects {
            out.push(unit(2.0 * (object.centre[0] - self.frame[0]) / width - 1.0));
            out.push(unit(2.0 * (object.centre[1] - self.frame[1]) / height - 1.0));
            out.push(unit(8.0 * object.half[0] / width));
            out.push(unit(8.0 * object.half[1] / height));
        }
        if let Some([i, j]) = self.pair {
            let (left, right) = (&self.objects[i], &self.objects[j]);
            let reach = (left.size() + right.size()).max(1e-9);
            let dx = right.centre[0] - left.centre[0];
            out.push(unit(dx / width));
            out.push(soft(dx / reach));
            out.push(unit((left.size() - right.size()) / reach));
        }
        // A network needs something to read, even in an empty scene.
        if out.is_empty() {
            out.push(1.0);
        }
        out
    }

    /// (n_action,) what the action sets and how that relates to the objects.
    pub fn action(&self, action: &ValidAction) -> Vec<f32> {
        let mut out = Vec::with_capacity(64);
        out.extend(action.values().iter().map(|v| unit(2.0 * v - 1.0)));
        let targets = self.placed(action);
        for (i, target) in targets.iter().enumerate() {
            match self.pair {
                Some(pair) => self.aimed(target, pair, &mut out),
                None => self.room(target, 1.0, &mut out),
            }
            let in_pair = |k: usize| self.pair.is_some_and(|pair| pair.contains(&k));
            for (_, object) in self.objects.iter().enumerate().filter(|(k, _)| !in_pair(*k)) {
                self.relation(target, object, 1.0, &mut out);
            }
            for other in &targets[i + 1..] {
                self.relation(target, other, 1.0, &mut out);
            }
        }
        out
    }

    /// What the action places, as it would stand.
    fn placed(&self, action: &ValidAction) -> Vec<Thing> {
        let place = |name: &String| {
            let placed = Placed::new(&self.scene, name, action);
            Thing::new(placed.solid(), placed.position, placed.velocity)
        };
        self.targets.iter().map(place).collect()
    }

    /// A placed thing relative to the two that should meet: seen from the one it is about to push (the nearer
    /// across), with the other ahead. The four cases (left or right one pushed, to the left or to the right)
    /// thereby look alike; two flags tell them apart where that matters.
    fn aimed(&self, target: &Thing, [i, j]: [usize; 2], out: &mut Vec<f32>) {
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
        self.room(target, ahead, out);
        self.relation(target, pushed, ahead, out);
        self.relation(target, other, ahead, out);
        let reach = (pushed.size() + other.size()).max(1e-9);
        let distance = (other.centre[0] - pushed.centre[0]) * ahead;
        out.push(unit(distance / width));
        out.push(soft(distance / reach));
        out.push(unit((pushed.size() - other.size()) / reach));
        out.push(soft(self.margin(pushed, -ahead) / (2.0 * pushed.size().max(1e-9))));
        out.push(unit(2.0 * self.margin(pushed, -ahead) / width));
        out.push(soft(self.margin(other, ahead) / (2.0 * other.size().max(1e-9))));
        out.push(unit(2.0 * self.margin(other, ahead) / width));
        out.push(unit(8.0 * pushed.size() / width));
        out.push(unit(8.0 * other.size() / width));
        // Whichever is lower comes to rest first; the upper falls on it from this height and is deflected, or
        // deflects, by the hit angle. The share of the heavier decides who gives way (areas as masses).
        let reach = (target.size() + pushed.size()).max(1e-9);
        let hit = ((pushed.centre[0] - target.centre[0]) * ahead / reach).clamp(-1.0, 1.0);
        let top = (1.0 - hit * hit).sqrt();
        let (upper, lower) =
            if target.centre[1] > pushed.centre[1] { (target, pushed) } else { (pushed, target) };
        let floor = self.frame[1] + lower.half[1];
        let drop = ((upper.centre[1] - floor - reach * top) / height).clamp(0.0, 1.0).sqrt();
        let share = target.size().powi(2) / (target.size().powi(2) + pushed.size().powi(2)).max(1e-18);
        let meets = if hit.abs() < 1.0 { 1.0 } else { 0.0 };
        out.push(unit(meets * drop));
        out.push(unit(share));
        out.push(unit(2.0 * hit * top * drop));
        out.push(unit(2.0 * hit * top * drop * share));
    }

    /// Room around a placed thing, and how long it falls; `ahead` is the direction (+-1) called ahead.
    fn room(&self, target: &Thing, ahead: f64, out: &mut Vec<f32>) {
        let [width, height] = self.size();
        let size = target.size().max(1e-9);
        let below = target.bottom() - self.frame[1];
        let above = self.frame[3] - target.centre[1] - target.half[1];
        out.push(unit(8.0 * target.size() / width));
        out.push(soft(self.margin(target, -ahead) / (2.0 * size)));
        out.push(soft(self.margin(target, ahead) / (2.0 * size)));
        out.push(soft(below / (2.0 * size)));
        out.push(unit((below / height).max(0.0).sqrt()));
        out.push(unit((above / height).max(0.0).sqrt()));
    }

    /// Room between a thing and the scene's border to the right (`side` 1) or left (-1), m.
    fn margin(&self, thing: &Thing, side: f64) -> f64 {
        let edge = thing.centre[0] + side * thing.half[0];
        if side > 0.0 { self.frame[2] - edge } else { edge - self.frame[0] }
    }

    /// How a placed thing lies relative to another; `ahead` is the direction (+-1) in which x counts.
    fn relation(&self, target: &Thing, object: &Thing, ahead: f64, out: &mut Vec<f32>) {
        let [width, height] = self.size();
        let reach = (target.size() + object.size()).max(1e-9);
        let dx = (target.centre[0] - object.centre[0]) * ahead;
        let dy = target.centre[1] - object.centre[1];
        let apart = (dx * dx + dy * dy).sqrt().max(1e-9);
        let between = target.solid.gap(&object.solid);
        let (over, up) = (dx / reach, dy / reach);
        // Where a thing falling straight down would meet the other: sine and cosine from its top.
        let hit = over.clamp(-1.0, 1.0);
        let top = (1.0 - hit * hit).sqrt();
        let above = up.clamp(-1.0, 1.0);
        out.push(unit(2.0 * dx / width));
        out.push(unit(2.0 * dy / height));
        out.push(soft(over));
        out.push(soft(up));
        out.push(soft(between / reach));
        out.push(unit(dx / apart));
        out.push(unit(dy / apart));
        out.push(unit(hit));
        out.push(unit(top));
        out.push(unit(hit * above));
        out.push(unit(top * above));
        out.push(unit((target.size() - object.size()) / reach));
        // Falling side by side, which lands first and how much later the other.
        let fall = |thing: &Thing| ((thing.bottom() - self.frame[1]) / height).max(0.0).sqrt();
        out.push(unit(fall(target) - fall(object)));
        if self.launched {
            // How far above the object a free flight passes; 0 if it never gets there.
            let relative = [0, 1].map(|k| target.velocity[k] - object.velocity[k]);
            let time = -dx * ahead / relative[0];
            let [gx, gy] = self.scene.gravity;
            let (time, arrives) = if time.is_finite() && time >= 0.0 { (time, 1.0) } else { (0.0, -1.0) };
            let high = dy + relative[1] * time + 0.5 * gy * time * time;
            out.push(arrives as f32);
            out.push(if arrives > 0.0 && gx == 0.0 { soft(high / reach) } else { 0.0 });
        }
    }

    fn size(&self) -> [f64; 2] {
        [(self.frame[2] - self.frame[0]).max(1e-9), (self.frame[3] - self.frame[1]).max(1e-9)]
    }
}

/// A line that something is to be above, from one side of the frame to the other.
pub(super) fn level(([nx, ny], offset): ([f64; 2], f64), frame: Bounds) -> Solid {
    let at = |x: f64| [x, (offset - nx * x) / ny];
    Solid::Bounded(Pieces::one(vec![at(frame[0]), at(frame[2])], 0.0))
}

impl Thing {
    /// `position`: where it stands, if it has no bounds.
    fn new(solid: Solid, position: [f64; 2], velocity: [f64; 2]) -> Thing {
        let [x, y] = position;
        let b = solid.bounds().unwrap_or([x, y, x, y]);
        Thing {
            centre: [(b[0] + b[2]) / 2.0, (b[1] + b[3]) / 2.0],
            half: [(b[2] - b[0]) / 2.0, (b[3] - b[1]) / 2.0],
            velocity,
            solid,
        }
    }
    /// A disc's radius; for others the mean of the half extents.
    fn size(&self) -> f64 {
        (self.half[0] + self.half[1]) / 2.0
    }
    fn bottom(&self) -> f64 {
        self.centre[1] - self.half[1]
    }
}

/// Clamped to [-1, 1]; 0 for what is not a number.
pub(super) fn unit(v: f64) -> f32 {
    if v.is_nan() { 0.0 } else { v.clamp(-1.0, 1.0) as f32 }
}

/// v / (1 + |v|): finest around 0, never beyond 1.
pub(super) fn soft(v: f64) -> f32 {
    unit(v / (1.0 + v.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;
    use crate::task::action::Component;
    use crate::task::scene::{Shape, Static};
    use crate::task::shape::Disc;
    use crate::task::{Split, custom, families};

    fn check(task: &Task) -> [usize; 2] {
        let features = Features::new(task);
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
    fn finite_bounded_and_of_one_size_within_a_family() {
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
    fn any_custom_scene_has_features() {
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
    fn a_flight_that_hits_is_told_by_its_feature() {
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

    /// Whatever shape an object or what the action places has, it is looked at and the numbers are in range.
    #[test]
    fn every_shape_is_looked_at() {
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
            let set = |set| Component { target: "target".into(), set, low: 1.0, high: 9.0 };
            space.components = vec![set(Quantity::X), set(Quantity::Y)];
            let look = |v: f64| {
                let action = task.actions().validate(&[0.5, v]).unwrap();
                action_features(&task, &action)
            };
            assert!(look(0.1).iter().all(|v| (-1.0..=1.0).contains(v)), "{shape:?}");
            assert_ne!(look(0.1)[2..], look(0.9)[2..], "{shape:?}");
        }
    }

    /// Everything twice as large, with all lengths in the same ratios, looks the same.
    #[test]
    fn size_does_not_matter() {
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

    /// Seen in a mirror only the raw place and the two flags differ.
    #[test]
    fn mirrored_scenes_look_alike() {
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
