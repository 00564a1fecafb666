//! The objects of a scene in the order of their roles in the goal, and the frame of reference of the goal's two objects.

use super::object_geometry::{ObjectGeometry, area};
use crate::task::Scene;
use crate::task::geometry::Aabb;
use crate::task::scene::Goal;
use crate::task::solid::{ConvexPieces, Solid};

/// Objects of the scene without the action's targets, and the goal's frame. The goal's two objects come first if they are in the scene,
/// then movable objects, then fixed ones, by distance from the first.
pub fn objects_by_role(scene: &Scene, targets: &[String], frame: Aabb) -> (Vec<ObjectGeometry>, GoalFrame) {
    let (names, region) = goal_objects(scene, frame);
    let named = standing_objects(scene, targets, &names, frame);
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
    let roles = [a.as_ref().map(|_| 0), b.as_ref().map(|_| usize::from(a.is_some()))];
    let aimed = |name: &String| names.iter().flatten().any(|n| n == name);
    let mut rest: Vec<ObjectGeometry> =
        named.into_iter().filter(|(n, _)| !aimed(n)).map(|(_, t)| t).collect();
    if let Some(near) = a.as_ref().or(b.as_ref()) {
        rest.sort_by(|x, y| {
            near.solid.signed_distance(&x.solid).total_cmp(&near.solid.signed_distance(&y.solid))
        });
    }
    rest.sort_by_key(|thing| !thing.movable);
    let objects: Vec<ObjectGeometry> = a.into_iter().chain(b).chain(rest).collect();
    let goal = GoalFrame::new(roles, &objects);
    (objects, goal)
}

/// Roles of the goal's objects, and the direction from one to the other.
#[derive(Clone, Copy, Debug)]
pub struct GoalFrame {
    /// Indices of "a" and "b" in the extractor's objects; `None` for an object that the action places.
    pub roles: [Option<usize>; 2],
    /// 1, or -1 if x is mirrored.
    pub ahead: f64,
}

impl GoalFrame {
    /// The frame of two objects with these indices.
    pub fn new(roles: [Option<usize>; 2], objects: &[ObjectGeometry]) -> GoalFrame {
        let across = roles.map(|role| role.map(|k| objects[k].centre[0]));
        let ahead = if let [Some(a), Some(b)] = across
            && b < a
        {
            -1.0
        } else {
            1.0
        };
        GoalFrame { roles, ahead }
    }
}

/// Height of a half-plane's boundary at the sides of the frame.
fn boundary_height(([nx, ny], offset): ([f64; 2], f64), frame: Aabb) -> Solid {
    let at = |x: f64| [x, (offset - nx * x) / ny];
    Solid::Bounded(ConvexPieces::one(vec![at(frame[0]), at(frame[2])], 0.0))
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
