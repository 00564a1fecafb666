//! Observation vectors in [0, 1]: positions and sizes of a task's objects.
//!
//! Each movable body positioned by the scene (not by the action) contributes x and y as fractions of the scene's bounds and
//! its radius as a fraction of the larger side. So does each static within the bounds that the action does not place
//! (basketball's basket, but not a wall). All tasks of a family share the features: those of an object that a task lacks are
//! zero. After a step they describe the final state.

use crate::task::action::ActionQuantity;
use crate::task::geometry::Aabb;
use crate::task::{ActionSpace, Scene};
use crate::trajectory::Trajectory;

/// Names of the objects that the observations of some scenes contain, in the order of their first appearance.
pub fn object_names<'a>(scenes: impl Iterator<Item = &'a Scene>) -> Vec<String> {
    let mut names = Vec::new();
    for object in scenes.flat_map(observed_objects) {
        if !names.contains(&object.name) {
            names.push(object.name);
        }
    }
    names
}

/// Names of an observation's features, three per object.
pub fn feature_names(objects: &[String]) -> Vec<String> {
    objects.iter().flat_map(|name| ["x", "y", "radius"].map(|q| format!("{name}.{q}"))).collect()
}

/// The static part of a scene's observation: which objects it contains and how they are scaled.
pub struct ObservationLayout {
    /// Positions are fractions of this box, m.
    bounds: Aabb,
    /// `None` for an object that the scene lacks.
    objects: Vec<Option<ObservedObject>>,
}

impl ObservationLayout {
    /// The layout of a scene with the features of `objects`.
    pub fn of(scene: &Scene, objects: &[String]) -> ObservationLayout {
        let mut own = observed_objects(scene);
        let mut take = |name: &String| own.iter().position(|o| o.name == *name).map(|i| own.swap_remove(i));
        ObservationLayout { bounds: scene_bounds(scene), objects: objects.iter().map(&mut take).collect() }
    }

    /// The observation of the layout's scene, or of the final state of a rollout. (n_features,) in [0, 1].
    pub fn observe(&self, after: Option<&Trajectory>) -> Vec<f64> {
        let bounds = self.bounds;
        let (width, height) = (bounds[2] - bounds[0], bounds[3] - bounds[1]);
        let share = |v: f64, low: f64, size: f64| {
            let s = (v - low) / size;
            if s.is_finite() { s.clamp(0.0, 1.0) } else { 0.5 }
        };
        let mut features = Vec::with_capacity(3 * self.objects.len());
        for object in &self.objects {
            let Some(object) = object else {
                features.extend([0.0; 3]);
                continue;
            };
            let track = after.and_then(|t| t.track(&object.name));
            let [x, y] = track.and_then(|t| Some([*t.x.last()?, *t.y.last()?])).unwrap_or(object.position);
            features.extend([
                share(x, bounds[0], width),
                share(y, bounds[1], height),
                share(object.radius, 0.0, width.max(height)),
            ]);
        }
        features
    }
}

/// An observed object.
struct ObservedObject {
    name: String,
    /// m
    position: [f64; 2],
    /// Disc radius, or half the larger side of the bounding box, m.
    radius: f64,
}

/// The objects that a scene's observation contains; never empty, since a scene has a body.
fn observed_objects(scene: &Scene) -> Vec<ObservedObject> {
    let bounds = scene_bounds(scene);
    let free = |name: &str| !scene.action.as_ref().is_some_and(|a| is_set_by_action(a, name));
    let bodies = scene.bodies.iter().filter(|b| free(&b.name)).filter_map(|b| {
        let position = b.position?;
        Some(ObservedObject { name: b.name.clone(), position, radius: b.shape.pieces()?.half_size() })
    });
    let statics = scene.statics.iter().filter(|s| free(&s.name)).filter_map(|s| {
        // Unbounded shapes are skipped.
        let b = s.placed().bounds()?;
        let inside = b[0] >= bounds[0] && b[1] >= bounds[1] && b[2] <= bounds[2] && b[3] <= bounds[3];
        let radius = s.shape.disc_radius().unwrap_or_else(|| (b[2] - b[0]).max(b[3] - b[1]) / 2.0);
        inside.then(|| ObservedObject {
            name: s.name.clone(),
            position: [(b[0] + b[2]) / 2.0, (b[1] + b[3]) / 2.0],
            radius,
        })
    });
    let mut objects: Vec<ObservedObject> = bodies.chain(statics).collect();
    if objects.is_empty() {
        // The action places everything: observe the first body, from the middle of the scene.
        let body = &scene.bodies[0];
        let middle = [(bounds[0] + bounds[2]) / 2.0, (bounds[1] + bounds[3]) / 2.0];
        objects.push(ObservedObject {
            name: body.name.clone(),
            position: body.position.unwrap_or(middle),
            radius: body.shape.pieces().map_or(0.0, |p| p.half_size()),
        });
    }
    objects
}

/// Whether the action sets the position or size of `name`.
fn is_set_by_action(space: &ActionSpace, name: &str) -> bool {
    let of_place = |q| matches!(q, ActionQuantity::X | ActionQuantity::Y | ActionQuantity::Radius);
    space.components.iter().any(|c| c.target == name && of_place(c.set))
}

/// Positions are fractions of this box, m.
fn scene_bounds(scene: &Scene) -> Aabb {
    scene.action.as_ref().and_then(|a| a.bounds).unwrap_or_else(|| scene.extent())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::Catalogue;

    fn observe(scene: &Scene) -> Vec<f64> {
        ObservationLayout::of(scene, &object_names([scene].into_iter())).observe(None)
    }

    #[test]
    fn observations_are_within_the_unit_box() {
        for (family, tasks) in Catalogue::new().families() {
            for task in tasks {
                let seen = observe(&task.scene);
                assert!(seen.iter().all(|v| (0.0..=1.0).contains(v)), "{} {seen:?}", family.name);
            }
        }
    }

    /// Scenes with other objects share their features; those of missing objects are zero.
    #[test]
    fn missing_objects_are_zero() {
        let catalogue = Catalogue::new();
        let tasks = catalogue.family("bowling").unwrap();
        let whole = tasks.tasks[0].scene.clone();
        let mut part = whole.clone();
        part.bodies.retain(|b| b.name != "green");
        let objects = object_names([&part, &whole].into_iter());
        assert_eq!(objects, ["blue", "green"]);
        let [all, some] = [&whole, &part].map(|s| ObservationLayout::of(s, &objects).observe(None));
        assert_eq!((all.len(), &all[..3]), (6, &some[..3]));
        assert!(some[3..] == [0.0; 3] && all[3..].iter().all(|v| *v > 0.0), "{some:?} {all:?}");
    }

    #[test]
    fn observes_balls_in_bowling_and_the_basket_in_basketball() {
        let catalogue = Catalogue::new();
        let names = |family: &str| catalogue.family(family).unwrap().feature_names();
        let balls = ["green.x", "green.y", "green.radius", "blue.x", "blue.y", "blue.radius"];
        assert_eq!(names("bowling"), balls);
        assert!(names("basketball").iter().all(|n| n.starts_with("basket_")), "{:?}", names("basketball"));
    }

    #[test]
    fn a_ball_in_the_middle_is_at_one_half() {
        let catalogue = Catalogue::new();
        let mut scene = catalogue.family("bowling").unwrap().tasks[0].scene.clone();
        let bounds = scene.action.as_ref().unwrap().bounds.unwrap();
        scene.bodies[0].position = Some([bounds[2] / 2.0, bounds[3] / 4.0]);
        scene.bodies[0].shape = crate::task::shape::Disc { radius: bounds[2] / 10.0 }.into();
        let seen = observe(&scene);
        for (value, expected) in seen.iter().zip([0.5, 0.25, 0.1]) {
            assert!((value - expected).abs() < 1e-12, "{seen:?}");
        }
    }
}
