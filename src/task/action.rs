//! Actions: a vector in the unit cube that sets named quantities of a scene, and the discrete set of them.
//!
//! An action outside the unit cube is bad input. An action inside it that cannot be placed (overlap, out of
//! bounds) is an outcome: [`Placement::Invalid`].

use serde::{Deserialize, Serialize};

use super::geometry::{Bounds, Convex, gap};
use super::scene::{FAR, Scene, Shape};
use crate::error::{Error, Result, within};

/// What an action sets, and which actions the discrete set holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActionSpace {
    /// One entry per component of the action vector, in order.
    pub components: Vec<Component>,
    /// Box that everything placed must lie in, m; unbounded if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<Bounds>,
    /// The discretised actions.
    #[serde(default)]
    pub discrete: Discrete,
}

/// One component: `low + action * (high - low)` is written to a quantity of a body or static.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Component {
    /// Name of the body or static.
    pub target: String,
    /// Which quantity.
    pub set: Quantity,
    /// Value at action 0, SI.
    pub low: f64,
    /// Value at action 1, SI.
    pub high: f64,
}

/// A quantity that an action may set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// m
    X,
    /// m
    Y,
    /// Disc radius, m.
    Radius,
    /// rad
    Angle,
    /// m/s; bodies only.
    Vx,
    /// m/s; bodies only.
    Vy,
    /// rad/s; bodies only.
    Omega,
}

/// How the unit cube is discretised.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Discrete {
    /// The first `count` points of the additive recurrence R_d (Roberts 2018), which fills the cube evenly
    /// and gives every action its own coordinates.
    Sequence { count: usize },
    /// Cell centres of a grid, the last component varying fastest.
    Grid { counts: Vec<usize> },
}

/// An action known to lie in the unit cube of the right dimension.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ValidAction(Vec<f64>);

/// What became of an action.
#[derive(Clone, Debug, PartialEq)]
pub enum Placement {
    /// The scene with the action carried out, ready to roll.
    Valid(Box<Scene>),
    /// The action cannot be placed; why, in words.
    Invalid(String),
}

/// Most discrete actions a task may have.
const MOST_ACTIONS: usize = 1_000_000;
/// Most components of an action vector.
const MOST_COMPONENTS: usize = 16;

impl ActionSpace {
    /// Number of components.
    pub fn dimension(&self) -> usize {
        self.components.len()
    }

    /// Number of discrete actions.
    pub fn count(&self) -> usize {
        match &self.discrete {
            Discrete::Sequence { count } => *count,
            Discrete::Grid { counts } => counts.iter().product(),
        }
    }

    /// Whether an action decides where `name` stands.
    pub fn places(&self, name: &str) -> bool {
        let where_it_stands =
            |q: Quantity| matches!(q, Quantity::X | Quantity::Y | Quantity::Radius | Quantity::Angle);
        self.components.iter().any(|c| c.target == name && where_it_stands(c.set))
    }

    /// Checks length and range of an action vector from outside.
    pub fn validate(&self, action: &[f64]) -> Result<ValidAction> {
        if action.len() != self.dimension() {
            let allowed = format!("{} numbers in [0, 1], one for each component", self.dimension());
            return Err(Error::input("action", format!("{} numbers", action.len()), allowed));
        }
        for (i, v) in action.iter().enumerate() {
            within(&format!("action[{i}]"), *v, 0.0, 1.0)?;
        }
        Ok(ValidAction(action.to_vec()))
    }

    /// The discrete action number `index`.
    pub fn at(&self, index: usize) -> Result<ValidAction> {
        let count = self.count();
        if index >= count {
            return Err(Error::input("action", index, format!("an index from 0 to {}", count - 1)));
        }
        Ok(ValidAction(match &self.discrete {
            Discrete::Sequence { .. } => recurrence(self.dimension(), index),
            Discrete::Grid { counts } => {
                let mut rest = index;
                let mut action = vec![0.0; counts.len()];
                for (slot, n) in action.iter_mut().zip(counts).rev() {
                    *slot = ((rest % n) as f64 + 0.5) / *n as f64;
                    rest /= n;
                }
                action
            }
        }))
    }

    /// Carries the action out on `scene` (whose own action space this is).
    pub fn place(&self, scene: &Scene, action: &ValidAction) -> Placement {
        let mut placed = scene.clone();
        for (component, v) in self.components.iter().zip(&action.0) {
            component.write(&mut placed, component.value(*v));
        }
        match self.collision(&placed) {
            Some(reason) => Placement::Invalid(reason),
            None => Placement::Valid(Box::new(placed)),
        }
    }

    /// Checks the space against the scene it belongs to.
    pub(super) fn validate_for(&self, scene: &Scene) -> Result<()> {
        if !(1..=MOST_COMPONENTS).contains(&self.dimension()) {
            let value = format!("{} components", self.dimension());
            return Err(Error::input("components", value, format!("1 to {MOST_COMPONENTS} components")));
        }
        for (i, c) in self.components.iter().enumerate() {
            let place = format!("components[{i}]");
            c.validate(scene).map_err(|e| e.under(&place))?;
        }
        for (i, v) in self.bounds.iter().flatten().enumerate() {
            within(&format!("bounds[{i}]"), *v, -FAR, FAR)?;
        }
        if let Some(b) = self.bounds
            && !(b[0] < b[2] && b[1] < b[3])
        {
            return Err(Error::input(
                "bounds",
                format!("{b:?}"),
                "[x_min, y_min, x_max, y_max] with min below max",
            ));
        }
        if let Discrete::Grid { counts } = &self.discrete
            && counts.len() != self.dimension()
        {
            let value = format!("{} counts", counts.len());
            return Err(Error::input("discrete.counts", value, format!("{} counts", self.dimension())));
        }
        let count = match &self.discrete {
            Discrete::Sequence { count } => Some(*count),
            Discrete::Grid { counts } => counts.iter().try_fold(1usize, |n, c| n.checked_mul(*c)),
        };
        match count {
            Some(1..=MOST_ACTIONS) => Ok(()),
            _ => Err(Error::input(
                "discrete",
                "too few or too many actions",
                format!("1 to {MOST_ACTIONS} actions"),
            )),
        }
    }

    /// Why what was placed cannot stand where it is, if so.
    fn collision(&self, placed: &Scene) -> Option<String> {
        let mut names: Vec<&str> = self.components.iter().map(|c| c.target.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        let shapes = placed_shapes(placed);
        for name in names {
            let (_, shape) = shapes.iter().find(|(n, _)| *n == name)?;
            if let Some(b) = self.bounds {
                let s = shape.bounds();
                if s[0] < b[0] || s[1] < b[1] || s[2] > b[2] || s[3] > b[3] {
                    return Some(format!("{name} leaves the scene"));
                }
            }
            if let Some((other, _)) = shapes.iter().find(|(n, other)| *n != name && gap(shape, other) < 0.0) {
                return Some(format!("{name} overlaps {other}"));
            }
            let halfspaces = placed.statics.iter().filter(|s| matches!(s.shape, Shape::Halfspace { .. }));
            if let Some(s) = halfspaces.into_iter().find(|s| s.gap_to(shape) < 0.0) {
                return Some(format!("{name} overlaps {}", s.name));
            }
        }
        None
    }
}

impl Default for Discrete {
    fn default() -> Self {
        Discrete::Sequence { count: 10_000 }
    }
}

impl ValidAction {
    /// The components, each in [0, 1].
    pub fn values(&self) -> &[f64] {
        &self.0
    }
}

impl Component {
    /// What an action's share `v` of the way from low to high sets, SI.
    pub fn value(&self, v: f64) -> f64 {
        self.low + v * (self.high - self.low)
    }

    fn write(&self, scene: &mut Scene, value: f64) {
        if let Some(body) = scene.bodies.iter_mut().find(|b| b.name == self.target) {
            let position = body.position.get_or_insert([0.0, 0.0]);
            match self.set {
                Quantity::X => position[0] = value,
                Quantity::Y => position[1] = value,
                Quantity::Radius => body.shape = Shape::Disc { radius: value },
                Quantity::Angle => body.angle = value,
                Quantity::Vx => body.velocity[0] = value,
                Quantity::Vy => body.velocity[1] = value,
                Quantity::Omega => body.angular_velocity = value,
            }
        } else if let Some(fixed) = scene.statics.iter_mut().find(|s| s.name == self.target) {
            match self.set {
                Quantity::X => fixed.position[0] = value,
                Quantity::Y => fixed.position[1] = value,
                Quantity::Radius => fixed.shape = Shape::Disc { radius: value },
                Quantity::Angle => fixed.angle = value,
                // Refused by `validate`: a static has no velocity.
                Quantity::Vx | Quantity::Vy | Quantity::Omega => {}
            }
        }
    }

    fn validate(&self, scene: &Scene) -> Result<()> {
        scene.named("target", &self.target, true)?;
        let limit = match self.set {
            Quantity::Vx | Quantity::Vy => 400.0,
            Quantity::Omega => 1e4,
            Quantity::X | Quantity::Y | Quantity::Radius | Quantity::Angle => 1e5,
        };
        within("low", self.low, -limit, limit)?;
        within("high", self.high, self.low, limit)?;
        let body = scene.body(&self.target);
        let moving = matches!(self.set, Quantity::Vx | Quantity::Vy | Quantity::Omega);
        if moving && body.is_none() {
            return Err(Error::input("set", format!("{:?}", self.set), "x, y, radius or angle for a static"));
        }
        if self.set == Quantity::Radius {
            let shape = body
                .map(|b| &b.shape)
                .or_else(|| scene.statics.iter().find(|s| s.name == self.target).map(|s| &s.shape));
            if !matches!(shape, Some(Shape::Disc { .. })) {
                return Err(Error::input("set", "radius", "x, y or angle, unless the target is a disc"));
            }
            if self.low <= 0.0 {
                return Err(Error::input("low", self.low, "a radius above 0 m"));
            }
        }
        Ok(())
    }
}

/// All bounded shapes that have a place, by name.
fn placed_shapes(scene: &Scene) -> Vec<(&str, Convex)> {
    let bodies = scene
        .bodies
        .iter()
        .filter_map(|b| Some((b.name.as_str(), b.shape.convex()?.placed(b.position?, b.angle))));
    let statics = scene
        .statics
        .iter()
        .filter_map(|s| Some((s.name.as_str(), s.shape.convex()?.placed(s.position, s.angle))));
    bodies.chain(statics).collect()
}

/// Point `index` of the R_d sequence: fractional parts of (index + 1) / phi^(j + 1), phi^(d+1) = phi + 1.
fn recurrence(dimension: usize, index: usize) -> Vec<f64> {
    // Newton from above; only +, -, *, / so that every machine gets the same bits.
    let mut phi = 2.0f64;
    for _ in 0..60 {
        let power = (0..dimension).fold(1.0, |p, _| p * phi);
        let value = power * phi - phi - 1.0;
        phi -= value / ((dimension as f64 + 1.0) * power - 1.0);
    }
    let mut alpha = 1.0;
    (0..dimension)
        .map(|_| {
            alpha /= phi;
            (0.5 + (index as f64 + 1.0) * alpha).fract()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sequence_fills_the_cube() {
        // Every cell of a 5 x 5 x 5 grid holds close to its share of 12,500 points.
        let mut cells = [0u32; 125];
        for i in 0..12_500 {
            let p = recurrence(3, i);
            let cell = p.iter().fold(0, |c, v| c * 5 + (v * 5.0) as usize);
            cells[cell] += 1;
        }
        assert!(cells.iter().all(|n| (90..=110).contains(n)), "{cells:?}");
    }

    #[test]
    fn grid_counts_through() {
        let space = ActionSpace {
            components: Vec::new(),
            bounds: None,
            discrete: Discrete::Grid { counts: vec![2, 4] },
        };
        assert_eq!(space.count(), 8);
        assert_eq!(space.at(5).unwrap().values(), [0.75, 0.375]);
        assert!(space.at(8).is_err());
    }
}
