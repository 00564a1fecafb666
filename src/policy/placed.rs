//! What an action places, as it would stand: read by both kinds of features.

use crate::task::ValidAction;
use crate::task::action::Quantity;
use crate::task::scene::{Scene, Shape};
use crate::task::shape::Disc;
use crate::task::solid::Solid;

/// A target of an action with what the action sets of it.
pub(super) struct Placed {
    pub shape: Shape,
    /// m
    pub position: [f64; 2],
    /// rad
    pub angle: f64,
    /// m/s
    pub velocity: [f64; 2],
    /// Whether it is a body.
    pub movable: bool,
}

impl Placed {
    /// The target called `name` in a scene, placed by an action; a point where the scene has none.
    pub fn new(scene: &Scene, name: &str, action: &ValidAction) -> Placed {
        let body = scene.body(name);
        let fixed = scene.statics.iter().find(|s| s.name == name);
        let (shape, position, angle, velocity) = match (body, fixed) {
            (Some(b), _) => (b.shape.clone(), b.position.unwrap_or([0.0; 2]), b.angle, b.velocity),
            (None, Some(s)) => (s.shape.clone(), s.position, s.angle, [0.0; 2]),
            (None, None) => (Disc { radius: 0.0 }.into(), [0.0; 2], 0.0, [0.0; 2]),
        };
        let mut placed = Placed { shape, position, angle, velocity, movable: body.is_some() };
        let components = scene.action.iter().flat_map(|s| &s.components).zip(action.values());
        for (component, v) in components.filter(|(c, _)| c.target == name) {
            let value = component.value(*v);
            match component.set {
                Quantity::X => placed.position[0] = value,
                Quantity::Y => placed.position[1] = value,
                Quantity::Radius => placed.shape = Disc { radius: value }.into(),
                Quantity::Angle => placed.angle = value,
                Quantity::Vx => placed.velocity[0] = value,
                Quantity::Vy => placed.velocity[1] = value,
                // Its raw component says all there is to say.
                Quantity::Omega => {}
            }
        }
        placed
    }

    /// What it takes up.
    pub fn solid(&self) -> Solid {
        self.shape.solid().placed(self.position, self.angle)
    }
}
