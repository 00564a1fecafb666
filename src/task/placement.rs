//! Applies actions to scenes: validates action components, sets quantities and detects overlaps.

use super::action::{ActionComponent, ActionQuantity, ActionSpace, ValidAction};
use super::limits::{MAX_LENGTH_M, MAX_SPEED_M_S, MAX_SPIN_RAD_S};
use super::scene::Scene;
use super::shape::{Disc, Shape};
use super::solid::Solid;
use crate::error::{Error, Result, check_range};

/// The result of applying an action.
#[derive(Clone, Debug, PartialEq)]
pub enum Placement {
    /// The scene with the action applied, ready for a rollout.
    Valid(Box<Scene>),
    /// The action cannot be placed, with the reason.
    Invalid(String),
}

impl ActionSpace {
    /// Applies the action to `scene` (whose own action space this is).
    pub fn place(&self, scene: &Scene, action: &ValidAction) -> Placement {
        let mut placed = scene.clone();
        for (component, v) in self.components.iter().zip(action.values()) {
            write(component, &mut placed, component.value(*v));
        }
        match obstacle(self, &placed) {
            Some(reason) => Placement::Invalid(reason),
            None => Placement::Valid(Box::new(placed)),
        }
    }
}

/// Checks an action space against the scene it belongs to.
pub fn validate(space: &ActionSpace, scene: &Scene) -> Result<()> {
    space.validate_dimension()?;
    for (i, component) in space.components.iter().enumerate() {
        validate_component(component, scene).map_err(|e| e.in_field(&format!("components[{i}]")))?;
    }
    space.validate_extent()
}

/// The reason why a placed object cannot stand at its position, if any.
fn obstacle(space: &ActionSpace, placed: &Scene) -> Option<String> {
    let mut targets: Vec<&str> = space.components.iter().map(|c| c.target.as_str()).collect();
    targets.sort_unstable();
    targets.dedup();
    let bodies = placed.bodies.iter().filter_map(|b| Some((b.name.as_str(), Solid::Bounded(b.placed()?))));
    let statics = placed.statics.iter().map(|s| (s.name.as_str(), s.placed()));
    let all: Vec<(&str, Solid)> = bodies.chain(statics).collect();
    // Bounded objects are reported first.
    let (bounded, endless): (Vec<_>, Vec<_>) = all.iter().partition(|(_, s)| s.bounds().is_some());
    targets.into_iter().find_map(|target| {
        let (_, own) = all.iter().find(|(name, _)| *name == target)?;
        if let (Some(b), Some(s)) = (space.bounds, own.bounds())
            && (s[0] < b[0] || s[1] < b[1] || s[2] > b[2] || s[3] > b[3])
        {
            return Some(format!("{target} leaves the scene"));
        }
        // Objects may stand partly inside a half space; a placed half space must only be clear of
        // movable bodies.
        let ground = own.bounds().is_none();
        let is_obstacle = |name: &str| name != target && (!ground || placed.body(name).is_some());
        let mut others = bounded.iter().chain(&endless).filter(|(name, _)| is_obstacle(name));
        let (other, _) = others.find(|(_, other)| own.signed_distance(other) < 0.0)?;
        Some(format!("{target} overlaps {other}"))
    })
}

fn write(component: &ActionComponent, scene: &mut Scene, value: f64) {
    if let Some(body) = scene.bodies.iter_mut().find(|b| b.name == component.target) {
        let position = body.position.get_or_insert([0.0, 0.0]);
        match component.set {
            ActionQuantity::X => position[0] = value,
            ActionQuantity::Y => position[1] = value,
            ActionQuantity::Radius => body.shape = Disc { radius: value }.into(),
            ActionQuantity::Angle => body.angle = value,
            ActionQuantity::Vx => body.velocity[0] = value,
            ActionQuantity::Vy => body.velocity[1] = value,
            ActionQuantity::Omega => body.angular_velocity = value,
        }
    } else if let Some(fixed) = scene.statics.iter_mut().find(|s| s.name == component.target) {
        match component.set {
            ActionQuantity::X => fixed.position[0] = value,
            ActionQuantity::Y => fixed.position[1] = value,
            ActionQuantity::Radius => fixed.shape = Disc { radius: value }.into(),
            ActionQuantity::Angle => fixed.angle = value,
            // Refused by `validate`: a static has no velocity.
            ActionQuantity::Vx | ActionQuantity::Vy | ActionQuantity::Omega => {}
        }
    }
}

fn validate_component(component: &ActionComponent, scene: &Scene) -> Result<()> {
    scene.check_name("target", &component.target, true)?;
    let limit = match component.set {
        ActionQuantity::Vx | ActionQuantity::Vy => MAX_SPEED_M_S,
        ActionQuantity::Omega => MAX_SPIN_RAD_S,
        ActionQuantity::X | ActionQuantity::Y | ActionQuantity::Radius | ActionQuantity::Angle => {
            MAX_LENGTH_M
        }
    };
    check_range("low", component.low, -limit, limit)?;
    check_range("high", component.high, component.low, limit)?;
    let body = scene.body(&component.target);
    let moving = matches!(component.set, ActionQuantity::Vx | ActionQuantity::Vy | ActionQuantity::Omega);
    if moving && body.is_none() {
        let allowed = "x, y, radius or angle for a static";
        return Err(Error::input("set", format!("{:?}", component.set), allowed));
    }
    if component.set == ActionQuantity::Radius {
        let shape = body
            .map(|b| &b.shape)
            .or_else(|| scene.statics.iter().find(|s| s.name == component.target).map(|s| &s.shape));
        if shape.and_then(Shape::disc_radius).is_none() {
            return Err(Error::input("set", "radius", "x, y or angle, unless the target is a disc"));
        }
        if component.low <= 0.0 {
            return Err(Error::input("low", component.low, "a radius above 0 m"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two balls placed by one action must not overlap, in either order.
    #[test]
    fn rejects_overlap_of_two_placed_balls() {
        let component = |target: &str, set: &str, low: f64, high: f64| {
            format!(r#"{{"target": "{target}", "set": "{set}", "low": {low}, "high": {high}}}"#)
        };
        let of = |name: &str| {
            [("x", -5.0, 5.0), ("y", -5.0, 5.0), ("radius", 0.5, 1.5)]
                .map(|(q, l, h)| component(name, q, l, h))
        };
        let components = [of("red"), of("blue")].concat().join(", ");
        let text = format!(
            r#"{{"format": "iplw.scene/1",
            "bodies": [{{"name": "red", "shape": {{"type": "disc", "radius": 1}}}},
                       {{"name": "blue", "shape": {{"type": "disc", "radius": 1}}}}],
            "statics": [{{"name": "post", "shape": {{"type": "disc", "radius": 1}}, "position": [0, -3]}}],
            "action": {{"bounds": [-5, -5, 5, 5], "components": [{components}]}}}}"#
        );
        let scene = Scene::from_json(&text).unwrap();
        let space = scene.action.as_ref().unwrap();
        let check = |red: [f64; 3], blue: [f64; 3], wanted: Option<&str>| {
            let share = |[x, y, r]: [f64; 3]| [(x + 5.0) / 10.0, (y + 5.0) / 10.0, r - 0.5];
            let action = [share(red), share(blue)].concat();
            let said = match space.place(&scene, &space.validate(&action).unwrap()) {
                Placement::Valid(placed) => {
                    assert_eq!(
                        placed.bodies[1].position.map(|p| p.map(|v| (v * 100.0).round())),
                        Some([blue[0] * 100.0, blue[1] * 100.0])
                    );
                    None
                }
                Placement::Invalid(reason) => Some(reason),
            };
            assert_eq!(said.as_deref(), wanted, "{red:?}, {blue:?}");
        };
        check([-1.0, 1.0, 0.75], [1.0, 1.0, 1.0], None);
        check([-1.0, 1.0, 0.75], [1.0, 1.0, 1.5], Some("blue overlaps red"));
        check([1.0, 1.0, 1.0], [1.0, 1.0, 0.5], Some("blue overlaps red"));
        check([-1.0, 1.0, 0.75], [0.0, -2.0, 0.5], Some("blue overlaps post"));
        check([0.5, -2.0, 0.75], [3.0, 1.0, 0.5], Some("red overlaps post"));
        check([-4.5, 1.0, 0.75], [3.0, 1.0, 0.5], Some("red leaves the scene"));
    }

    /// The floor (a halfspace, first in order of name) and the post under the ball are both placed.
    #[test]
    fn rejects_overlaps_behind_a_halfspace_target() {
        let text = r#"{"format": "iplw.scene/1",
            "bodies": [{"name": "ball", "shape": {"type": "disc", "radius": 0.5}, "position": [0, 2]}],
            "statics": [
              {"name": "floor", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}},
              {"name": "post", "shape": {"type": "box", "half_width": 0.2, "half_height": 1}, "position": [5, 1]},
              {"name": "wall", "shape": {"type": "halfspace", "normal": [1, 0], "offset": -9}}],
            "action": {"components": [
              {"target": "floor", "set": "y", "low": 0, "high": 2},
              {"target": "post", "set": "x", "low": -10, "high": 10}]}}"#;
        let scene = Scene::from_json(text).unwrap();
        let space = scene.action.as_ref().unwrap();
        let check = |action: [f64; 2], wanted: Option<&str>| {
            let said = match space.place(&scene, &space.validate(&action).unwrap()) {
                Placement::Valid(_) => None,
                Placement::Invalid(reason) => Some(reason),
            };
            assert_eq!(said.as_deref(), wanted, "{action:?}");
        };
        // A post may start inside the floor of its scene, but a placed object must not overlap
        // another.
        check([0.0, 0.9], None);
        check([0.0, 0.5], Some("post overlaps ball"));
        check([0.0, 0.0], Some("post overlaps wall"));
        check([0.9, 0.9], Some("floor overlaps ball"));
        check([0.9, 0.5], Some("floor overlaps ball"));
    }
}
