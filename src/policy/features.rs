//! Task and action as numbers: what stands in the scene, what the action sets, and how the two relate.
//!
//! - *Scene features*: centre and half extents of every object (movable bodies that the scene itself places,
//!   bounded statics inside the scene, the goal's region), as shares of the scene's size.
//! - *Action features*: the raw components, and for every thing the action places its room to the borders, its
//!   fall time, and its place *relative* to every object: offsets over the sum of sizes, gap, hit angle.
//!   Relative features carry over between tasks, which absolute ones do not.
//!
//! Source: Semage et al. use images; PHYRE (Bakhtin et al. 2019) shows that a DQN on object features does as
//! well. Everything here is computed from geometry alone: no latent factor and no physics enters, so a policy
//! does not change its inputs between worlds. Range: squashed to [-1, 1] (`soft`, clamps), so that no scene,
//! however large, gives an input that is not.

use crate::task::geometry::{Bounds, Convex, gap};
use crate::task::scene::{Goal, Shape};
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
    /// Names of what the action places, in the order of the action's components.
    targets: Vec<String>,
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
    shape: Convex,
    /// Where the thing that the goal wants it to meet lies, if the goal names it: index among the objects.
    partner: Option<usize>,
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
            if let (Some(position), Some(shape)) = (body.position, body.shape.convex()) {
                named.push((&body.name, Thing::new(shape.placed(position, body.angle), body.velocity)));
            }
        }
        for fixed in scene.statics.iter().filter(|s| !targets.contains(&s.name)) {
            if let Some(shape) = fixed.shape.convex() {
                let thing = Thing::new(shape.placed(fixed.position, fixed.angle), [0.0; 2]);
                // A wall's middle lies on or beyond the border.
                let [x, y] = thing.centre;
                if x > frame[0] && x < frame[2] && y > frame[1] && y < frame[3] {
                    named.push((&fixed.name, thing));
                }
            }
        }
        if let Some(Goal::Inside { region, .. }) = &scene.goal {
            named.insert(0, ("", Thing::new(Convex { points: region.clone(), radius: 0.0 }, [0.0; 2])));
        }
        named.truncate(MOST_OBJECTS);
        if let Some(Goal::Contact { bodies: [a, b], .. }) = &scene.goal {
            let index = |name: &str| named.iter().position(|(n, _)| *n == name);
            if let (Some(i), Some(j)) = (index(a), index(b)) {
                named[i].1.partner = Some(j);
                named[j].1.partner = Some(i);
            }
        }
        let objects = named.into_iter().map(|(_, thing)| thing).collect();
        Features { frame, objects, targets, scene: scene.clone() }
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
        for (i, object) in self.objects.iter().enumerate() {
            if let Some(partner) = object.partner.filter(|p| *p > i).map(|p| &self.objects[p]) {
                let reach = object.size() + partner.size();
                let dx = partner.centre[0] - object.centre[0];
                out.push(unit(dx / width));
                out.push(soft(dx / reach));
                out.push(unit((object.size() - partner.size()) / reach));
            }
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
            self.room(target, &mut out);
            for object in &self.objects {
                self.relation(target, object, &mut out);
            }
            for other in &targets[i + 1..] {
                self.relation(target, other, &mut out);
            }
        }
        out
    }

    /// What the action places, as it would stand.
    fn placed(&self, action: &ValidAction) -> Vec<Thing> {
        let space = self.scene.action.as_ref();
        let place = |name: &String| {
            let body = self.scene.body(name);
            let fixed = self.scene.statics.iter().find(|s| s.name == *name);
            let (mut shape, mut position, mut angle, mut velocity) = match (body, fixed) {
                (Some(b), _) => (b.shape.clone(), b.position.unwrap_or([0.0; 2]), b.angle, b.velocity),
                (None, Some(s)) => (s.shape.clone(), s.position, s.angle, [0.0; 2]),
                (None, None) => (Shape::Disc { radius: 0.0 }, [0.0; 2], 0.0, [0.0; 2]),
            };
            let components = space.iter().flat_map(|s| &s.components).zip(action.values());
            for (component, v) in components.filter(|(c, _)| c.target == *name) {
                use crate::task::action::Quantity::*;
                let value = component.low + v * (component.high - component.low);
                match component.set {
                    X => position[0] = value,
                    Y => position[1] = value,
                    Radius => shape = Shape::Disc { radius: value },
                    Angle => angle = value,
                    Vx => velocity[0] = value,
                    Vy => velocity[1] = value,
                    // Its raw component says all there is to say.
                    Omega => {}
                }
            }
            let core = shape.convex().unwrap_or(Convex { points: vec![[0.0; 2]], radius: 0.0 });
            Thing::new(core.placed(position, angle), velocity)
        };
        self.targets.iter().map(place).collect()
    }

    /// Room around a placed thing, and how long it falls.
    fn room(&self, target: &Thing, out: &mut Vec<f32>) {
        let [x0, y0, x1, y1] = self.frame;
        let [width, height] = self.size();
        let size = target.size().max(1e-9);
        let (left, right) = (target.left() - x0, x1 - target.right());
        let (below, above) = (target.bottom() - y0, y1 - target.centre[1] - target.half[1]);
        out.push(unit(8.0 * target.size() / width));
        out.push(soft(left / (2.0 * size)));
        out.push(soft(right / (2.0 * size)));
        out.push(soft(below / (2.0 * size)));
        out.push(unit((below / height).max(0.0).sqrt()));
        out.push(unit((above / height).max(0.0).sqrt()));
    }

    /// How a placed thing lies relative to another.
    fn relation(&self, target: &Thing, object: &Thing, out: &mut Vec<f32>) {
        let [width, height] = self.size();
        let reach = (target.size() + object.size()).max(1e-9);
        let [dx, dy] = [target.centre[0] - object.centre[0], target.centre[1] - object.centre[1]];
        let apart = (dx * dx + dy * dy).sqrt().max(1e-9);
        let between = gap(&target.shape, &object.shape);
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
        if let Some(partner) = object.partner.map(|p| &self.objects[p]) {
            let to_partner = partner.centre[0] - object.centre[0];
            let toward = if to_partner < 0.0 { -1.0 } else { 1.0 };
            out.push(unit(-toward * hit));
            out.push(soft(dx / to_partner.abs().max(1e-9) * toward));
        }
    }

    fn size(&self) -> [f64; 2] {
        [(self.frame[2] - self.frame[0]).max(1e-9), (self.frame[3] - self.frame[1]).max(1e-9)]
    }
}

impl Thing {
    fn new(shape: Convex, velocity: [f64; 2]) -> Thing {
        let b = shape.bounds();
        Thing {
            centre: [(b[0] + b[2]) / 2.0, (b[1] + b[3]) / 2.0],
            half: [(b[2] - b[0]) / 2.0, (b[3] - b[1]) / 2.0],
            velocity,
            shape,
            partner: None,
        }
    }
    /// A disc's radius; for others the mean of the half extents.
    fn size(&self) -> f64 {
        (self.half[0] + self.half[1]) / 2.0
    }
    fn left(&self) -> f64 {
        self.centre[0] - self.half[0]
    }
    fn right(&self) -> f64 {
        self.centre[0] + self.half[0]
    }
    fn bottom(&self) -> f64 {
        self.centre[1] - self.half[1]
    }
}

/// Clamped to [-1, 1]; 0 for what is not a number.
fn unit(v: f64) -> f32 {
    if v.is_nan() { 0.0 } else { v.clamp(-1.0, 1.0) as f32 }
}

/// v / (1 + |v|): finest around 0, never beyond 1.
fn soft(v: f64) -> f32 {
    unit(v / (1.0 + v.abs()))
}
