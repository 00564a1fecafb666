//! Observation vectors in [0, 1]: where the things of a task stand.
//!
//! For every movable body that the scene (not the action) positions: x and y as shares of the scene's bounds
//! and its radius as a share of the larger side. Likewise for every static within the bounds that is neither
//! outside them (a wall) nor placed by the action: basketball's basket. All tasks of a family have the same
//! features, and after a step the same features tell the final state.

use crate::task::action::Quantity;
use crate::task::geometry::Bounds;
use crate::task::{ActionSpace, Scene};
use crate::trajectory::Trajectory;

/// Names of the features of a scene's observation, three for each thing observed.
pub fn names(scene: &Scene) -> Vec<String> {
    let things = observed(scene);
    things.iter().flat_map(|t| ["x", "y", "radius"].map(|q| format!("{}.{q}", t.name))).collect()
}

/// The observation of a scene as it stands, or of where its bodies ended up after a rollout.
/// (n_features,) in [0, 1].
pub fn observe(scene: &Scene, after: Option<&Trajectory>) -> Vec<f64> {
    Layout::of(scene).observe(after)
}

/// What of an observation a scene decides before anything moves.
pub struct Layout {
    /// The box positions are shares of.
    bounds: Bounds,
    things: Vec<Thing>,
}

impl Layout {
    /// That of a scene.
    pub fn of(scene: &Scene) -> Layout {
        Layout { bounds: frame(scene), things: observed(scene) }
    }

    /// [`observe`] for its scene.
    pub fn observe(&self, after: Option<&Trajectory>) -> Vec<f64> {
        let bounds = self.bounds;
        let (width, height) = (bounds[2] - bounds[0], bounds[3] - bounds[1]);
        let share = |v: f64, low: f64, size: f64| {
            let s = (v - low) / size;
            if s.is_finite() { s.clamp(0.0, 1.0) } else { 0.5 }
        };
        let mut features = Vec::with_capacity(3 * self.things.len());
        for thing in &self.things {
            let track = after.and_then(|t| t.track(&thing.name));
            let [x, y] = track.and_then(|t| Some([*t.x.last()?, *t.y.last()?])).unwrap_or(thing.position);
            features.extend([
                share(x, bounds[0], width),
                share(y, bounds[1], height),
                share(thing.radius, 0.0, width.max(height)),
            ]);
        }
        features
    }
}

/// One thing observed.
struct Thing {
    name: String,
    /// m
    position: [f64; 2],
    /// Disc radius, or half the larger side of the box around it, m.
    radius: f64,
}

/// What is observed of a scene; never empty, since a scene has a body.
fn observed(scene: &Scene) -> Vec<Thing> {
    let bounds = frame(scene);
    let free = |name: &str| !scene.action.as_ref().is_some_and(|a| decides(a, name));
    let bodies = scene.bodies.iter().filter(|b| free(&b.name)).filter_map(|b| {
        let position = b.position?;
        Some(Thing { name: b.name.clone(), position, radius: b.shape.pieces()?.half_size() })
    });
    let statics = scene.statics.iter().filter(|s| free(&s.name)).filter_map(|s| {
        // What has no bounds is within none.
        let b = s.placed().bounds()?;
        let inside = b[0] >= bounds[0] && b[1] >= bounds[1] && b[2] <= bounds[2] && b[3] <= bounds[3];
        let radius = s.shape.disc_radius().unwrap_or_else(|| (b[2] - b[0]).max(b[3] - b[1]) / 2.0);
        inside.then(|| Thing {
            name: s.name.clone(),
            position: [(b[0] + b[2]) / 2.0, (b[1] + b[3]) / 2.0],
            radius,
        })
    });
    let mut things: Vec<Thing> = bodies.chain(statics).collect();
    if things.is_empty() {
        // Nothing but what the action places: then its body, from the middle of the scene.
        let body = &scene.bodies[0];
        let middle = [(bounds[0] + bounds[2]) / 2.0, (bounds[1] + bounds[3]) / 2.0];
        things.push(Thing {
            name: body.name.clone(),
            position: body.position.unwrap_or(middle),
            radius: body.shape.pieces().map_or(0.0, |p| p.half_size()),
        });
    }
    things
}

/// Whether an action decides where `name` stands or how large it is.
fn decides(space: &ActionSpace, name: &str) -> bool {
    let of_place = |q| matches!(q, Quantity::X | Quantity::Y | Quantity::Radius);
    space.components.iter().any(|c| c.target == name && of_place(c.set))
}

/// The box positions are shares of.
fn frame(scene: &Scene) -> Bounds {
    scene.action.as_ref().and_then(|a| a.bounds).unwrap_or_else(|| scene.extent())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::Catalogue;

    #[test]
    fn families_have_one_layout_and_stay_within_the_unit_box() {
        for (family, tasks) in Catalogue::new().families() {
            let layout = names(&tasks[0].scene);
            for task in tasks {
                assert_eq!(names(&task.scene), layout, "{}", family.name);
                let seen = observe(&task.scene, None);
                assert_eq!(seen.len(), layout.len());
                assert!(seen.iter().all(|v| (0.0..=1.0).contains(v)), "{} {seen:?}", task.id);
            }
        }
    }

    #[test]
    fn bowling_tells_its_two_balls_and_basketball_its_basket() {
        let catalogue = Catalogue::new();
        let names = |family: &str| names(&catalogue.family(family).unwrap().tasks[0].scene);
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
        let seen = observe(&scene, None);
        for (value, expected) in seen.iter().zip([0.5, 0.25, 0.1]) {
            assert!((value - expected).abs() < 1e-12, "{seen:?}");
        }
    }
}
