//! Generic features, shared by all task families: for policies of several families, or for arbitrary shapes.
//!
//! - *Scene features*: the goal's kind; for each of the first objects its position and size as in [`super::family_features`], its
//!   orientation and elongation (second moments), the filled share of its bounding box and the centre of mass in it (which
//!   distinguish a jar from a block, and its orientation), whether it is a disc, compound or movable, and its role in the goal; and
//!   the support below the goal's body.
//! - *Action features*: the raw components; for every object that the action places its clearance, velocity and shape, its position
//!   relative to the goal's two objects and to the nearest others, and the support below its left end, centre and right end.
//!
//! Order of objects: first the goal's two objects "a" and "b" ("a" is the movable one or, of two movable ones, the left one), then
//! movable objects, then fixed ones, by distance from "a". If "b" lies to the left of "a", the scene is mirrored, so that "b" always
//! lies ahead.
//!
//! Source: PHYRE's DQN distinguishes seven colours, which encode an object's role in the goal and whether it moves (Bakhtin et al.
//! 2019, section 4.1); object features perform as well as images there (OGRE and later agents).
//!
//! Differences from the source: a feature vector instead of an image, a bounded number of objects. Range [-1, 1], as in
//! `family_features`.

use super::action_target::ActionTarget;
use super::family_features::{boundary_height, clamp_to_unit, squash};
use super::object_geometry::{ObjectGeometry, area, length};
use crate::task::action::ActionQuantity;
use crate::task::geometry::Aabb;
use crate::task::scene::Goal;
use crate::task::solid::{ConvexPieces, Solid};
use crate::task::{Scene, Task, ValidAction};

/// Version of the features.
pub const VERSION: &str = "shared-1";

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

/// Features of a task that are shared by all of its actions.
#[derive(Clone, Debug)]
pub struct GenericFeatures {
    /// Bounding box of the scene, m.
    frame: Aabb,
    /// Objects of the scene, with the goal's two objects first if they are in the scene.
    objects: Vec<ObjectGeometry>,
    /// Indices of "a" and "b" in `objects`; `None` for an object that the action places.
    goal: [Option<usize>; 2],
    /// 1, or -1 if the scene is mirrored.
    ahead: f64,
    /// Names of the objects that the action places, in the order of the action's components.
    targets: Vec<String>,
    scene: Scene,
}

impl GenericFeatures {
    /// Features of a task's scene.
    pub fn new(task: &Task) -> GenericFeatures {
        let (scene, space) = (&task.scene, task.actions());
        let frame = space.bounds.unwrap_or_else(|| scene.extent());
        let mut targets: Vec<String> = Vec::new();
        for component in &space.components {
            if !targets.contains(&component.target) {
                targets.push(component.target.clone());
            }
        }
        let (names, region) = goal_objects(scene, frame);
        let named = standing_objects(scene, &targets, &names, frame);
        let find = |name: &Option<String>| {
            name.as_ref().and_then(|n| named.iter().find(|(k, _)| k == n)).map(|(_, thing)| thing.clone())
        };
        let [mut a, mut b] = [find(&names[0]), region.or_else(|| find(&names[1]))];
        let turned = match (&a, &b) {
            (Some(x), Some(y)) if names[1].is_some() => match (x.movable, y.movable) {
                (true, true) => y.centre[0] < x.centre[0],
                (x, y) => y && !x,
            },
            // The object that the action places is the movable one.
            (Some(_), None) => names[1].is_some(),
            _ => false,
        };
        if turned {
            std::mem::swap(&mut a, &mut b);
        }
        let ahead = match (&a, &b) {
            (Some(a), Some(b)) if b.centre[0] < a.centre[0] => -1.0,
            _ => 1.0,
        };
        let goal = [a.as_ref().map(|_| 0), b.as_ref().map(|_| usize::from(a.is_some()))];
        let aimed = |name: &String| names.iter().flatten().any(|n| n == name);
        let mut rest: Vec<ObjectGeometry> =
            named.into_iter().filter(|(n, _)| !aimed(n)).map(|(_, t)| t).collect();
        if let Some(near) = a.as_ref().or(b.as_ref()) {
            rest.sort_by(|x, y| {
                near.solid.signed_distance(&x.solid).total_cmp(&near.solid.signed_distance(&y.solid))
            });
        }
        rest.sort_by_key(|thing| !thing.movable);
        let objects = a.into_iter().chain(b).chain(rest).collect();
        GenericFeatures { frame, objects, goal, ahead, targets, scene: scene.clone() }
    }

    /// (n_scene,) geometry of the objects and their roles in the goal.
    pub fn scene(&self) -> Vec<f32> {
        let mut out = Vec::with_capacity(MAX_OBJECTS * OBJECT_FEATURES + 3 * SUPPORT_FEATURES + 4);
        out.push(indicator(matches!(self.scene.goal, Some(Goal::Contact { .. }))));
        out.push(indicator(matches!(self.scene.goal, Some(Goal::Inside { .. }))));
        out.extend(self.goal.map(|place| indicator(place.is_some())));
        let [width, height] = self.size();
        for slot in 0..MAX_OBJECTS {
            let Some(thing) = self.objects.get(slot) else {
                out.resize(out.len() + OBJECT_FEATURES, 0.0);
                continue;
            };
            let [x, y] = self.relative_position(thing.centre);
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
            out.extend(self.form_features(thing));
            out.extend([indicator(thing.disc), indicator(thing.several), indicator(thing.movable)]);
            out.extend(self.goal.map(|place| indicator(place == Some(slot))));
            out.extend(self.velocity_features(thing));
        }
        match self.goal[0] {
            Some(a) if self.objects[a].movable => self.support_features(&self.objects[a], &mut out),
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
            let side = if mirrored { self.ahead } else { 1.0 };
            out.push(clamp_to_unit(side * (2.0 * v - 1.0)));
        }
        let targets = self.placed_targets(action);
        for (i, target) in targets.iter().enumerate() {
            self.clearance_features(target, &mut out);
            out.extend(self.form_features(target));
            out.extend(self.velocity_features(target));
            for place in self.goal {
                self.relation_features(target, place.map(|k| &self.objects[k]), &mut out);
            }
            let mut others: Vec<(f64, &ObjectGeometry)> =
                self.other_objects().map(|o| (target.solid.signed_distance(&o.solid), o)).collect();
            others.sort_by(|x, y| x.0.total_cmp(&y.0));
            for k in 0..NEIGHBOURS {
                self.relation_features(target, others.get(k).map(|(_, o)| *o), &mut out);
            }
            self.support_features(target, &mut out);
            for other in &targets[i + 1..] {
                self.relation_features(target, Some(other), &mut out);
            }
        }
        out
    }

    fn other_objects(&self) -> impl Iterator<Item = &ObjectGeometry> {
        let own = |k: &usize| !self.goal.contains(&Some(*k));
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

    /// Orientation, centre of mass and filled share of the bounding box, mirrored if necessary.
    fn form_features(&self, thing: &ObjectGeometry) -> [f32; 5] {
        let [cos, sin] = thing.turned;
        let [x, y] = thing.lean;
        [
            clamp_to_unit(cos),
            clamp_to_unit(self.ahead * sin),
            clamp_to_unit(self.ahead * x),
            clamp_to_unit(y),
            clamp_to_unit(thing.full),
        ]
    }

    /// Velocity relative to that of a fall through the scene's height.
    fn velocity_features(&self, thing: &ObjectGeometry) -> [f32; 2] {
        let [gx, gy] = self.scene.gravity;
        let fall = (2.0 * length(gx, gy) * self.size()[1]).sqrt().max(1e-9);
        [squash(self.ahead * thing.velocity[0] / fall), squash(thing.velocity[1] / fall)]
    }

    /// Position as a share of the scene's half size, mirrored if necessary.
    fn relative_position(&self, [x, y]: [f64; 2]) -> [f32; 2] {
        let [width, height] = self.size();
        let across = 2.0 * (x - self.frame[0]) / width - 1.0;
        [clamp_to_unit(self.ahead * across), clamp_to_unit(2.0 * (y - self.frame[1]) / height - 1.0)]
    }

    /// Position, size and clearance of a placed object, and its fall time.
    fn clearance_features(&self, target: &ObjectGeometry, out: &mut Vec<f32>) {
        let [width, height] = self.size();
        let size = target.size().max(1e-9);
        let [left, right] = [
            target.centre[0] - target.half[0] - self.frame[0],
            self.frame[2] - target.centre[0] - target.half[0],
        ];
        let (behind, before) = if self.ahead > 0.0 { (left, right) } else { (right, left) };
        let under = target.bottom() - self.frame[1];
        let over = self.frame[3] - target.centre[1] - target.half[1];
        out.extend(self.relative_position(target.centre));
        out.push(clamp_to_unit(8.0 * size / width));
        out.extend([behind, before, under].map(|room| squash(room / (2.0 * size))));
        out.extend([under, over].map(|room| clamp_to_unit((room / height).max(0.0).sqrt())));
    }

    /// Position of a placed object relative to another, and properties of that one; all 0 if there is none.
    fn relation_features(
        &self,
        target: &ObjectGeometry,
        object: Option<&ObjectGeometry>,
        out: &mut Vec<f32>,
    ) {
        let Some(object) = object else {
            out.resize(out.len() + RELATION_FEATURES, 0.0);
            return;
        };
        let [width, height] = self.size();
        let reach = (target.size() + object.size()).max(1e-9);
        let dx = (target.centre[0] - object.centre[0]) * self.ahead;
        let dy = target.centre[1] - object.centre[1];
        let apart = length(dx, dy).max(1e-9);
        let gap = target.solid.signed_distance(&object.solid);
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
        let form = self.form_features(object);
        out.extend([form[0], form[1], form[2], form[3]]);
    }

    /// Support below an object at its rear end, centre and front end: distance, slope and kind.
    fn support_features(&self, thing: &ObjectGeometry, out: &mut Vec<f32>) {
        let height = self.size()[1];
        let step = 0.02 * thing.half[0].max(1e-6);
        for share in [-0.9, 0.0, 0.9] {
            let x = thing.centre[0] + self.ahead * share * thing.half[0];
            let under =
                |object: &ObjectGeometry| object.top(x, thing.centre[1]).filter(|y| *y < thing.centre[1]);
            let first = self.objects.iter().enumerate().filter_map(|(k, o)| Some((k, o, under(o)?)));
            match first.max_by(|p, q| p.2.total_cmp(&q.2)) {
                Some((k, object, y)) => {
                    let beside = object.top(x + self.ahead * step, thing.centre[1]).unwrap_or(y);
                    out.push(clamp_to_unit(((thing.bottom() - y) / height).max(0.0).sqrt()));
                    out.push(squash((beside - y) / step));
                    out.extend(self.goal.map(|place| indicator(place == Some(k))));
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

/// Objects named by the goal, and the goal's region or half-plane.
fn goal_objects(scene: &Scene, frame: Aabb) -> ([Option<String>; 2], Option<ObjectGeometry>) {
    let thing = |solid: Solid, area: f64| Some(ObjectGeometry::new(solid, [0.0; 2], [0.0; 2], false, area));
    match &scene.goal {
        Some(Goal::Contact { bodies: [a, b], .. } | Goal::Apart { bodies: [a, b], .. }) => {
            ([Some(a.clone()), Some(b.clone())], None)
        }
        Some(Goal::Inside { body, region, .. }) => {
            let solid = Solid::Bounded(ConvexPieces::one(region.clone(), 0.0));
            ([Some(body.clone()), None], thing(solid, area(region)))
        }
        Some(goal @ Goal::Above { body, .. }) => (
            [Some(body.clone()), None],
            goal.line().and_then(|line| thing(boundary_height(line, frame), 0.0)),
        ),
        None => ([None, None], None),
    }
}

/// Objects of the scene with their names, without the action's targets: those within the frame and those of the goal.
fn standing_objects(
    scene: &Scene,
    targets: &[String],
    aims: &[Option<String>; 2],
    frame: Aabb,
) -> Vec<(String, ObjectGeometry)> {
    let mut named = Vec::new();
    for body in scene.bodies.iter().filter(|b| !targets.contains(&b.name)) {
        if let (Some(position), Some(placed)) = (body.position, body.placed()) {
            let area = body.shape.moments().area;
            let thing = ObjectGeometry::new(Solid::Bounded(placed), position, body.velocity, true, area);
            named.push((body.name.clone(), thing));
        }
    }
    for fixed in scene.statics.iter().filter(|s| !targets.contains(&s.name)) {
        let solid = fixed.placed();
        let inside = solid.bounds().is_some_and(|b| {
            // Walls, floor and ceiling lie at the border and are covered by the clearance features.
            let edge = 0.005 * (frame[2] - frame[0]).max(frame[3] - frame[1]);
            b[0] < frame[2] - edge
                && b[2] > frame[0] + edge
                && b[1] < frame[3] - edge
                && b[3] > frame[1] + edge
        });
        if inside || aims.iter().flatten().any(|n| *n == fixed.name) {
            let area = if solid.bounds().is_some() { fixed.shape.moments().area } else { 0.0 };
            named.push((
                fixed.name.clone(),
                ObjectGeometry::new(solid, fixed.position, [0.0; 2], false, area),
            ));
        }
    }
    named
}

fn indicator(yes: bool) -> f32 {
    if yes { 1.0 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;
    use crate::task::scene::{Shape, Static};
    use crate::task::{custom, families};

    fn check(task: &Task) -> [usize; 2] {
        let (look, space) = (GenericFeatures::new(task), task.actions());
        let in_range = |v: &[f32]| v.iter().all(|v| (-1.0..=1.0).contains(v));
        let scene = look.scene();
        assert_eq!(scene.len(), 4 + MAX_OBJECTS * OBJECT_FEATURES + 3 * SUPPORT_FEATURES, "{}", task.id);
        assert!(in_range(&scene), "{}: {scene:?}", task.id);
        let corners = [0.0, 1.0].map(|v| space.validate(&vec![v; space.dimension()]).unwrap());
        let others = (0..50).map(|i| space.at(i * 13 % space.count()).unwrap());
        let rows: Vec<Vec<f32>> = corners.into_iter().chain(others).map(|a| look.action(&a)).collect();
        assert!(rows.iter().all(|row| row.len() == rows[0].len() && in_range(row)), "{}", task.id);
        [scene.len(), rows[0].len()]
    }

    fn thing(shape: &str, angle: f64, movable: bool) -> Task {
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
            assert_eq!(check(&thing(shape, 0.4, movable)), ball);
        }
        let thrown = r#"{"format": "iplw.scene/1", "bodies": [{"name": "ball", "shape": {"type": "disc",
            "radius": 0.1}, "position": [0, 1]}], "statics": [{"name": "floor", "shape": {"type": "halfspace",
            "normal": [0, 1], "offset": 0}}], "goal": {"type": "contact", "bodies": ["ball", "floor"]},
            "action": {"components": [{"target": "ball", "set": "vx", "low": 0, "high": 9}, {"target": "ball",
            "set": "omega", "low": 0, "high": 1}]}}"#;
        check(&custom(Scene::from_json(thrown).unwrap()).unwrap());
    }

    /// Features distinguish orientation, reflection, movability and kind of shape.
    #[test]
    fn different_shapes_have_different_features() {
        let half_turn = std::f64::consts::PI;
        let looks = [
            thing(BAR, 0.0, false),
            thing(BAR, 0.5, false),
            thing(BAR, -0.5, false),
            thing(BAR, 0.0, true),
            thing(JAR, 0.0, false),
            thing(JAR, half_turn, false),
            thing(JAR, 0.0, true),
            thing(r#"{"type": "disc", "radius": 1}"#, 0.0, false),
            thing(r#"{"type": "box", "half_width": 1, "half_height": 1}"#, 0.0, false),
            thing(r#"{"type": "polygon", "vertices": [[-1, -1], [1, -1], [-1, 1]]}"#, 0.0, false),
            thing(r#"{"type": "polygon", "vertices": [[-1, -1], [1, -1], [1, 1]]}"#, 0.0, false),
        ]
        .map(|task| (GenericFeatures::new(&task).scene(), task));
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
        let task = thing(BAR, 0.5, false);
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
        let (one, other) = (GenericFeatures::new(&task), GenericFeatures::new(&mirrored));
        assert!(one.ahead != other.ahead && close(&one.scene(), &other.scene()));
        for i in 0..100 {
            let action = task.actions().at(i).unwrap();
            let v = action.values();
            let turned = task.actions().validate(&[1.0 - v[0], v[1], v[2]]).unwrap();
            assert!(close(&one.action(&action), &other.action(&turned)), "{i}");
        }
    }
}
