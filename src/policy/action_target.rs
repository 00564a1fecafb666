//! Objects that an action places, with the action applied.

use crate::task::ValidAction;
use crate::task::action::ActionQuantity;
use crate::task::scene::{Scene, Shape};
use crate::task::shape::Disc;
use crate::task::solid::Solid;

/// Target of an action, with the action's components applied.
pub(super) struct ActionTarget {
    pub shape: Shape,
    /// m
    pub position: [f64; 2],
    /// rad
    pub angle: f64,
    /// m/s
    pub velocity: [f64; 2],
    /// Whether the target is a body (not a static).
    pub movable: bool,
}

impl ActionTarget {
    /// The target called `name`, placed by an action; a point if the scene has no such object.
    pub fn new(scene: &Scene, name: &str, action: &ValidAction) -> ActionTarget {
        let body = scene.body(name);
        let fixed = scene.statics.iter().find(|s| s.name == name);
        let (shape, position, angle, velocity) = match (body, fixed) {
            (Some(b), _) => (b.shape.clone(), b.position.unwrap_or([0.0; 2]), b.angle, b.velocity),
            (None, Some(s)) => (s.shape.clone(), s.position, s.angle, [0.0; 2]),
            (None, None) => (Disc { radius: 0.0 }.into(), [0.0; 2], 0.0, [0.0; 2]),
        };
        let mut placed = ActionTarget { shape, position, angle, velocity, movable: body.is_some() };
        let components = scene.action.iter().flat_map(|s| &s.components).zip(action.values());
        for (component, v) in components.filter(|(c, _)| c.target == name) {
            let value = component.value(*v);
            match component.set {
                ActionQuantity::X => placed.position[0] = value,
                ActionQuantity::Y => placed.position[1] = value,
                ActionQuantity::Radius => placed.shape = Disc { radius: value }.into(),
                ActionQuantity::Angle => placed.angle = value,
                ActionQuantity::Vx => placed.velocity[0] = value,
                ActionQuantity::Vy => placed.velocity[1] = value,
                // Represented by its raw component.
                ActionQuantity::Omega => {}
            }
        }
        placed
    }

    /// Placed solid.
    pub fn solid(&self) -> Solid {
        self.shape.solid().placed(self.position, self.angle)
    }
}
