//! Actions in a scene: what may be set in it, carrying an action out, and what stands in its way.

use super::action::{ActionSpace, Component, Quantity, ValidAction};
use super::limits::{FAR, FAST, FAST_SPIN};
use super::scene::Scene;
use super::shape::{Disc, Shape};
use super::solid::Solid;
use crate::error::{Error, Result, within};

/// What became of an action.
#[derive(Clone, Debug, PartialEq)]
pub enum Placement {
    /// The scene with the action carried out, ready to roll.
    Valid(Box<Scene>),
    /// The action cannot be placed; why, in words.
    Invalid(String),
}

impl ActionSpace {
    /// Carries the action out on `scene` (whose own action space this is).
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
        validate_component(component, scene).map_err(|e| e.under(&format!("components[{i}]")))?;
    }
    space.validate_extent()
}

/// Why what was placed cannot stand where it is, if so.
fn obstacle(space: &ActionSpace, placed: &Scene) -> Option<String> {
    let mut targets: Vec<&str> = space.components.iter().map(|c| c.target.as_str()).collect();
    targets.sort_unstable();
    targets.dedup();
    let bodies = placed.bodies.iter().filter_map(|b| Some((b.name.as_str(), Solid::Bounded(b.placed()?))));
    let statics = placed.statics.iter().map(|s| (s.name.as_str(), s.placed()));
    let all: Vec<(&str, Solid)> = bodies.chain(statics).collect();
    // What is bounded is named first.
    let (bounded, endless): (Vec<_>, Vec<_>) = all.iter().partition(|(_, s)| s.bounds().is_some());
    targets.into_iter().find_map(|target| {
        let (_, own) = all.iter().find(|(name, _)| *name == target)?;
        if let (Some(b), Some(s)) = (space.bounds, own.bounds())
            && (s[0] < b[0] || s[1] < b[1] || s[2] > b[2] || s[3] > b[3])
        {
            return Some(format!("{target} leaves the scene"));
        }
        // Ground is there for things to stand in: only what moves must be clear of ground that is placed.
        let ground = own.bounds().is_none();
        let in_its_way = |name: &str| name != target && (!ground || placed.body(name).is_some());
        let mut others = bounded.iter().chain(&endless).filter(|(name, _)| in_its_way(name));
        let (other, _) = others.find(|(_, other)| own.gap(other) < 0.0)?;
        Some(format!("{target} overlaps {other}"))
    })
}

fn write(component: &Component, scene: &mut Scene, value: f64) {
    if let Some(body) = scene.bodies.iter_mut().find(|b| b.name == component.target) {
        let position = body.position.get_or_insert([0.0, 0.0]);
        match component.set {
            Quantity::X => position[0] = value,
            Quantity::Y => position[1] = value,
            Quantity::Radius => body.shape = Disc { radius: value }.into(),
            Quantity::Angle => body.angle = value,
            Quantity::Vx => body.velocity[0] = value,
            Quantity::Vy => body.velocity[1] = value,
            Quantity::Omega => body.angular_velocity = value,
        }
    } else if let Some(fixed) = scene.statics.iter_mut().find(|s| s.name == component.target) {
        match component.set {
            Quantity::X => fixed.position[0] = value,
            Quantity::Y => fixed.position[1] = value,
            Quantity::Radius => fixed.shape = Disc { radius: value }.into(),
            Quantity::Angle => fixed.angle = value,
            // Refused by `validate`: a static has no velocity.
            Quantity::Vx | Quantity::Vy | Quantity::Omega => {}
        }
    }
}

fn validate_component(component: &Component, scene: &Scene) -> Result<()> {
    scene.named("target", &component.target, true)?;
    let limit = match component.set {
        Quantity::Vx | Quantity::Vy => FAST,
        Quantity::Omega => FAST_SPIN,
        Quantity::X | Quantity::Y | Quantity::Radius | Quantity::Angle => FAR,
    };
    within("low", component.low, -limit, limit)?;
    within("high", component.high, component.low, limit)?;
    let body = scene.body(&component.target);
    let moving = matches!(component.set, Quantity::Vx | Quantity::Vy | Quantity::Omega);
    if moving && body.is_none() {
        return Err(Error::input(
            "set",
            format!("{:?}", component.set),
            "x, y, radius or angle for a static",
        ));
    }
    if component.set == Quantity::Radius {
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

    /// Two balls are placed by one action: neither may be in the other's way, whichever comes first.
    #[test]
    fn two_balls_that_are_placed_may_not_overlap() {
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

    /// The floor (a halfspace, first in order of name) is placed, and so is the post, on which the ball stands.
    #[test]
    fn overlaps_are_looked_for_beyond_a_halfspace_target() {
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
        // The posts of a scene may stand in its floor, what is placed on it may not.
        check([0.0, 0.9], None);
        check([0.0, 0.5], Some("post overlaps ball"));
        check([0.0, 0.0], Some("post overlaps wall"));
        check([0.9, 0.9], Some("floor overlaps ball"));
        check([0.9, 0.5], Some("floor overlaps ball"));
    }
}
