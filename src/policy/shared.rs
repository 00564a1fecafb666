//! The features that all families share: what a policy of many families, or of odd shapes, sees.
//!
//! - *Scene features*: the goal's kind; for each of the first objects its place and size as [`super::features`] has them, how
//!   it is turned and how long (its second moments), how full its box is and where in it its mass lies (a jar from a
//!   block, the right way up or not), whether it is a disc, of several pieces, movable, and what it is to the goal; and what
//!   lies below the goal's body.
//! - *Action features*: the raw components; for everything the action places its room, velocity and form, its place relative
//!   to the goal's two things and to the nearest others, and what lies below it at its left end, middle and right end.
//!
//! The goal's two things come first (the movable one, and of two movable ones the left one, as "a"), then what moves, then what
//! does not, from near to far of "a". If "b" lies to the left of "a" all is seen in a mirror, so that it always lies ahead.
//!
//! Source: PHYRE's DQN sees seven colours, which are what an object is to the goal and whether it moves (Bakhtin et al.
//! 2019, section 4.1); object features do as well as images there (OGRE's and later agents).
//!
//! Differences from the source: numbers instead of an image, a bounded number of objects. Range [-1, 1] as in `features`.

use super::features::{level, soft, unit};
use super::placed::Placed;
use super::thing::{Thing, area, length};
use crate::task::action::Quantity;
use crate::task::geometry::Bounds;
use crate::task::scene::Goal;
use crate::task::solid::{Pieces, Solid};
use crate::task::{Scene, Task, ValidAction};

/// Version of the features.
pub const VERSION: &str = "shared-1";

/// Objects of which a scene's features tell. PHYRE's templates have at most ten.
const SLOTS: usize = 10;
/// Objects beside the goal's to which an action's features relate.
const NEAR: usize = 4;
/// Numbers about one object among the scene's features.
const OBJECT: usize = 19;
/// Numbers about how something lies relative to an object.
const RELATION: usize = 21;
/// Numbers about what lies below a point.
const BELOW: usize = 5;

/// What of a task stays the same for all of its actions.
#[derive(Clone, Debug)]
pub struct Shared {
    /// The scene's box, m.
    frame: Bounds,
    /// The goal's two things first, if they stand in the scene.
    objects: Vec<Thing>,
    /// Where "a" and "b" are among the objects; absent what the action places.
    goal: [Option<usize>; 2],
    /// 1, or -1 if all is seen in a mirror.
    ahead: f64,
    /// Names of what the action places, in the order of the action's components.
    targets: Vec<String>,
    scene: Scene,
}

impl Shared {
    /// Reads a task's scene.
    pub fn new(task: &Task) -> Shared {
        let (scene, space) = (&task.scene, task.actions());
        let frame = space.bounds.unwrap_or_else(|| scene.extent());
        let mut targets: Vec<String> = Vec::new();
        for component in &space.components {
            if !targets.contains(&component.target) {
                targets.push(component.target.clone());
            }
        }
        let (names, region) = aims(scene, frame);
        let named = standing(scene, &targets, &names, frame);
        let find = |name: &Option<String>| {
            name.as_ref().and_then(|n| named.iter().find(|(k, _)| k == n)).map(|(_, thing)| thing.clone())
        };
        let [mut a, mut b] = [find(&names[0]), region.or_else(|| find(&names[1]))];
        let turned = match (&a, &b) {
            (Some(x), Some(y)) if names[1].is_some() => match (x.movable, y.movable) {
                (true, true) => y.centre[0] < x.centre[0],
                (x, y) => y && !x,
            },
            // What the action places is the one that moves.
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
        let mut rest: Vec<Thing> = named.into_iter().filter(|(n, _)| !aimed(n)).map(|(_, t)| t).collect();
        if let Some(near) = a.as_ref().or(b.as_ref()) {
            rest.sort_by(|x, y| near.solid.gap(&x.solid).total_cmp(&near.solid.gap(&y.solid)));
        }
        rest.sort_by_key(|thing| !thing.movable);
        let objects = a.into_iter().chain(b).chain(rest).collect();
        Shared { frame, objects, goal, ahead, targets, scene: scene.clone() }
    }

    /// (n_scene,) what stands where, and what it is to the goal.
    pub fn scene(&self) -> Vec<f32> {
        let mut out = Vec::with_capacity(SLOTS * OBJECT + 3 * BELOW + 4);
        out.push(sign(matches!(self.scene.goal, Some(Goal::Contact { .. }))));
        out.push(sign(matches!(self.scene.goal, Some(Goal::Inside { .. }))));
        out.extend(self.goal.map(|place| sign(place.is_some())));
        let [width, height] = self.size();
        for slot in 0..SLOTS {
            let Some(thing) = self.objects.get(slot) else {
                out.resize(out.len() + OBJECT, 0.0);
                continue;
            };
            let [x, y] = self.share(thing.centre);
            out.extend([1.0, x, y, unit(8.0 * thing.half[0] / width), unit(8.0 * thing.half[1] / height)]);
            out.extend([
                soft(thing.half[0] / thing.half[1].max(1e-9) - 1.0),
                soft(8.0 * thing.size() / width),
            ]);
            out.extend(self.form(thing));
            out.extend([sign(thing.disc), sign(thing.several), sign(thing.movable)]);
            out.extend(self.goal.map(|place| sign(place == Some(slot))));
            out.extend(self.speed(thing));
        }
        match self.goal[0] {
            Some(a) if self.objects[a].movable => self.below(&self.objects[a], &mut out),
            _ => out.resize(out.len() + 3 * BELOW, 0.0),
        }
        out
    }

    /// (n_action,) what the action sets and how that lies in the scene.
    pub fn action(&self, action: &ValidAction) -> Vec<f32> {
        let mut out = Vec::with_capacity(192);
        let components = &self.scene.action.as_ref().map_or(&[][..], |s| &s.components);
        for (component, v) in components.iter().zip(action.values()) {
            let mirrored =
                matches!(component.set, Quantity::X | Quantity::Vx | Quantity::Angle | Quantity::Omega);
            let side = if mirrored { self.ahead } else { 1.0 };
            out.push(unit(side * (2.0 * v - 1.0)));
        }
        let targets = self.placed(action);
        for (i, target) in targets.iter().enumerate() {
            self.room(target, &mut out);
            out.extend(self.form(target));
            out.extend(self.speed(target));
            for place in self.goal {
                self.relation(target, place.map(|k| &self.objects[k]), &mut out);
            }
            let mut others: Vec<(f64, &Thing)> =
                self.others().map(|o| (target.solid.gap(&o.solid), o)).collect();
            others.sort_by(|x, y| x.0.total_cmp(&y.0));
            for k in 0..NEAR {
                self.relation(target, others.get(k).map(|(_, o)| *o), &mut out);
            }
            self.below(target, &mut out);
            for other in &targets[i + 1..] {
                self.relation(target, Some(other), &mut out);
            }
        }
        out
    }

    fn others(&self) -> impl Iterator<Item = &Thing> {
        let own = |k: &usize| !self.goal.contains(&Some(*k));
        (0..self.objects.len()).filter(own).map(|k| &self.objects[k])
    }

    /// What the action places, as it would stand.
    fn placed(&self, action: &ValidAction) -> Vec<Thing> {
        let place = |name: &String| {
            let placed = Placed::new(&self.scene, name, action);
            let area = placed.shape.moments().area;
            Thing::new(placed.solid(), placed.position, placed.velocity, placed.movable, area)
        };
        self.targets.iter().map(place).collect()
    }

    /// How a thing is turned, leans and fills its box, as it is seen.
    fn form(&self, thing: &Thing) -> [f32; 5] {
        let [cos, sin] = thing.turned;
        let [x, y] = thing.lean;
        [unit(cos), unit(self.ahead * sin), unit(self.ahead * x), unit(y), unit(thing.full)]
    }

    /// Its velocity as a share of what a fall through the scene gives.
    fn speed(&self, thing: &Thing) -> [f32; 2] {
        let [gx, gy] = self.scene.gravity;
        let fall = (2.0 * length(gx, gy) * self.size()[1]).sqrt().max(1e-9);
        [soft(self.ahead * thing.velocity[0] / fall), soft(thing.velocity[1] / fall)]
    }

    /// A place as a share of the scene's half size, as it is seen.
    fn share(&self, [x, y]: [f64; 2]) -> [f32; 2] {
        let [width, height] = self.size();
        let across = 2.0 * (x - self.frame[0]) / width - 1.0;
        [unit(self.ahead * across), unit(2.0 * (y - self.frame[1]) / height - 1.0)]
    }

    /// Place, size and room around a placed thing, and how long it may fall.
    fn room(&self, target: &Thing, out: &mut Vec<f32>) {
        let [width, height] = self.size();
        let size = target.size().max(1e-9);
        let [left, right] = [
            target.centre[0] - target.half[0] - self.frame[0],
            self.frame[2] - target.centre[0] - target.half[0],
        ];
        let (behind, before) = if self.ahead > 0.0 { (left, right) } else { (right, left) };
        let under = target.bottom() - self.frame[1];
        let over = self.frame[3] - target.centre[1] - target.half[1];
        out.extend(self.share(target.centre));
        out.push(unit(8.0 * size / width));
        out.extend([behind, before, under].map(|room| soft(room / (2.0 * size))));
        out.extend([under, over].map(|room| unit((room / height).max(0.0).sqrt())));
    }

    /// How a placed thing lies relative to an object, and what that is; all 0 if there is none.
    fn relation(&self, target: &Thing, object: Option<&Thing>, out: &mut Vec<f32>) {
        let Some(object) = object else {
            out.resize(out.len() + RELATION, 0.0);
            return;
        };
        let [width, height] = self.size();
        let reach = (target.size() + object.size()).max(1e-9);
        let dx = (target.centre[0] - object.centre[0]) * self.ahead;
        let dy = target.centre[1] - object.centre[1];
        let apart = length(dx, dy).max(1e-9);
        let gap = target.solid.gap(&object.solid);
        // Where a thing that falls straight down would meet the other, as a share of how wide both are.
        let wide = (target.half[0] + object.half[0]).max(1e-9);
        let hit = (dx / wide).clamp(-1.0, 1.0);
        let top = (1.0 - hit * hit).sqrt();
        let fall = |thing: &Thing| ((thing.bottom() - self.frame[1]) / height).max(0.0).sqrt();
        out.extend([
            1.0,
            unit(2.0 * dx / width),
            unit(2.0 * dy / height),
            soft(dx / reach),
            soft(dy / reach),
        ]);
        out.extend([soft(gap / reach), unit(8.0 * gap / width), unit(dx / apart), unit(dy / apart)]);
        out.extend([unit(hit), unit(top), unit((target.size() - object.size()) / reach)]);
        out.extend([unit(fall(target) - fall(object)), unit(8.0 * object.half[0] / width)]);
        out.extend([unit(8.0 * object.half[1] / height), sign(object.disc), sign(object.movable)]);
        let form = self.form(object);
        out.extend([form[0], form[1], form[2], form[3]]);
    }

    /// What lies below a thing at its rear end, its middle and its front end: how far, what it is, how steep.
    fn below(&self, thing: &Thing, out: &mut Vec<f32>) {
        let height = self.size()[1];
        let step = 0.02 * thing.half[0].max(1e-6);
        for share in [-0.9, 0.0, 0.9] {
            let x = thing.centre[0] + self.ahead * share * thing.half[0];
            let under = |object: &Thing| object.top(x, thing.centre[1]).filter(|y| *y < thing.centre[1]);
            let first = self.objects.iter().enumerate().filter_map(|(k, o)| Some((k, o, under(o)?)));
            match first.max_by(|p, q| p.2.total_cmp(&q.2)) {
                Some((k, object, y)) => {
                    let beside = object.top(x + self.ahead * step, thing.centre[1]).unwrap_or(y);
                    out.push(unit(((thing.bottom() - y) / height).max(0.0).sqrt()));
                    out.push(soft((beside - y) / step));
                    out.extend(self.goal.map(|place| sign(place == Some(k))));
                    out.push(sign(object.movable));
                }
                None => {
                    let floor = (thing.bottom() - self.frame[1]) / height;
                    out.extend([unit(floor.max(0.0).sqrt()), 0.0, -1.0, -1.0, -1.0]);
                }
            }
        }
    }

    fn size(&self) -> [f64; 2] {
        [(self.frame[2] - self.frame[0]).max(1e-9), (self.frame[3] - self.frame[1]).max(1e-9)]
    }
}

/// What the goal names, and the region that it wants something in, or the line that it wants something above.
fn aims(scene: &Scene, frame: Bounds) -> ([Option<String>; 2], Option<Thing>) {
    let thing = |solid: Solid, area: f64| Some(Thing::new(solid, [0.0; 2], [0.0; 2], false, area));
    match &scene.goal {
        Some(Goal::Contact { bodies: [a, b], .. } | Goal::Apart { bodies: [a, b], .. }) => {
            ([Some(a.clone()), Some(b.clone())], None)
        }
        Some(Goal::Inside { body, region, .. }) => {
            let solid = Solid::Bounded(Pieces::one(region.clone(), 0.0));
            ([Some(body.clone()), None], thing(solid, area(region)))
        }
        Some(goal @ Goal::Above { body, .. }) => {
            ([Some(body.clone()), None], goal.line().and_then(|line| thing(level(line, frame), 0.0)))
        }
        None => ([None, None], None),
    }
}

/// What stands in the scene by itself, with its name: within the frame, or if the goal is about it.
fn standing(
    scene: &Scene,
    targets: &[String],
    aims: &[Option<String>; 2],
    frame: Bounds,
) -> Vec<(String, Thing)> {
    let mut named = Vec::new();
    for body in scene.bodies.iter().filter(|b| !targets.contains(&b.name)) {
        if let (Some(position), Some(placed)) = (body.position, body.placed()) {
            let area = body.shape.moments().area;
            let thing = Thing::new(Solid::Bounded(placed), position, body.velocity, true, area);
            named.push((body.name.clone(), thing));
        }
    }
    for fixed in scene.statics.iter().filter(|s| !targets.contains(&s.name)) {
        let solid = fixed.placed();
        let inside = solid.bounds().is_some_and(|b| {
            // Walls, floor and ceiling lie at the border: the room around a thing tells of them.
            let edge = 0.005 * (frame[2] - frame[0]).max(frame[3] - frame[1]);
            b[0] < frame[2] - edge
                && b[2] > frame[0] + edge
                && b[1] < frame[3] - edge
                && b[3] > frame[1] + edge
        });
        if inside || aims.iter().flatten().any(|n| *n == fixed.name) {
            let area = if solid.bounds().is_some() { fixed.shape.moments().area } else { 0.0 };
            named.push((fixed.name.clone(), Thing::new(solid, fixed.position, [0.0; 2], false, area)));
        }
    }
    named
}

fn sign(yes: bool) -> f32 {
    if yes { 1.0 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::toy;
    use crate::task::scene::{Shape, Static};
    use crate::task::{custom, families};

    fn check(task: &Task) -> [usize; 2] {
        let (look, space) = (Shared::new(task), task.actions());
        let in_range = |v: &[f32]| v.iter().all(|v| (-1.0..=1.0).contains(v));
        let scene = look.scene();
        assert_eq!(scene.len(), 4 + SLOTS * OBJECT + 3 * BELOW, "{}", task.id);
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
    fn tasks_of_all_families_give_as_many_numbers_in_range() {
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

    /// A policy is not blind to what is turned, upside down, movable or of another kind.
    #[test]
    fn shapes_that_differ_look_different() {
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
        .map(|task| (Shared::new(&task).scene(), task));
        for (i, (a, one)) in looks.iter().enumerate() {
            for (b, other) in &looks[i + 1..] {
                let far = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(far > 0.05, "{:?} {:?}", one.scene.statics, other.scene.statics);
            }
        }
    }

    /// Seen in a mirror nothing differs, as "b" lies ahead of "a" either way.
    #[test]
    fn mirrored_scenes_look_the_same() {
        let task = thing(BAR, 0.5, false);
        let mut mirrored = task.clone();
        for body in &mut mirrored.scene.bodies {
            body.position = body.position.map(|[x, y]| [10.0 - x, y]);
        }
        for fixed in &mut mirrored.scene.statics {
            fixed.position[0] = 10.0 - fixed.position[0];
            fixed.angle = -fixed.angle;
        }
        // Both balls move: the left one is "a" in either scene, so the mirror swaps them. Fixed, blue is "b" in both.
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
        let (one, other) = (Shared::new(&task), Shared::new(&mirrored));
        assert!(one.ahead != other.ahead && close(&one.scene(), &other.scene()));
        for i in 0..100 {
            let action = task.actions().at(i).unwrap();
            let v = action.values();
            let turned = task.actions().validate(&[1.0 - v[0], v[1], v[2]]).unwrap();
            assert!(close(&one.action(&action), &other.action(&turned)), "{i}");
        }
    }
}
