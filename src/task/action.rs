//! Action spaces: a vector in the unit cube that sets named quantities of a scene, and its discretisation.
//!
//! An action outside the unit cube is invalid input. An action inside it that cannot be placed (overlap, out
//! of bounds) is an outcome: see [`placement`](super::placement).

use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::geometry::Aabb;
use super::limits::MAX_LENGTH_M;
use crate::error::{Error, Result, check_range};
use crate::rng::Stream;

/// The quantities that an action sets, and the discretised set of actions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActionSpace {
    /// One entry per component of the action vector, in order.
    pub components: Vec<ActionComponent>,
    /// Box that must contain every placed object, m; unbounded if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<Aabb>,
    /// The discretised actions.
    #[serde(default)]
    pub discrete: Discretisation,
}

/// One component: `low + action * (high - low)` is written to a quantity of a body or static.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActionComponent {
    /// Name of the body or static.
    pub target: String,
    /// Which quantity.
    pub set: ActionQuantity,
    /// Value at action 0, SI.
    pub low: f64,
    /// Value at action 1, SI.
    pub high: f64,
}

/// A quantity that an action may set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActionQuantity {
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
pub enum Discretisation {
    /// The first `count` points of the additive recurrence R_d (Roberts 2018), which fills the cube evenly
    /// and gives every action its own coordinates.
    Sequence { count: usize },
    /// Cell centres of a grid, the last component varying fastest.
    Grid { counts: Vec<usize> },
}

/// An action known to lie in the unit cube of the right dimension.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ValidAction(Vec<f64>);

/// Maximum number of discrete actions of a task.
const MAX_ACTIONS: usize = 1_000_000;
/// Maximum number of components of an action vector.
const MAX_COMPONENTS: usize = 16;

impl ActionSpace {
    /// Number of components.
    pub fn dimension(&self) -> usize {
        self.components.len()
    }

    /// Number of discrete actions.
    pub fn count(&self) -> usize {
        match &self.discrete {
            Discretisation::Sequence { count } => *count,
            Discretisation::Grid { counts } => counts.iter().product(),
        }
    }

    /// Whether an action sets the pose or size of the object `name`.
    pub fn places(&self, name: &str) -> bool {
        let sets_pose = |q: ActionQuantity| {
            matches!(
                q,
                ActionQuantity::X | ActionQuantity::Y | ActionQuantity::Radius | ActionQuantity::Angle
            )
        };
        self.components.iter().any(|c| c.target == name && sets_pose(c.set))
    }

    /// Checks length and range of an action vector from outside.
    pub fn validate(&self, action: &[f64]) -> Result<ValidAction> {
        if action.len() != self.dimension() {
            let allowed = format!("{} numbers in [0, 1], one for each component", self.dimension());
            return Err(Error::input("action", format!("{} numbers", action.len()), allowed));
        }
        for (i, v) in action.iter().enumerate() {
            check_range(&format!("action[{i}]"), *v, 0.0, 1.0)?;
        }
        Ok(ValidAction(action.to_vec()))
    }

    /// The discrete action at `index`.
    pub fn at(&self, index: usize) -> Result<ValidAction> {
        let count = self.count();
        if index >= count {
            return Err(Error::input("action", index, format!("an index from 0 to {}", count - 1)));
        }
        Ok(ValidAction(match &self.discrete {
            Discretisation::Sequence { .. } => recurrence(self.dimension(), index),
            Discretisation::Grid { counts } => {
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

    /// Checks the number of components. The components themselves need the scene: see
    /// [`placement`](super::placement).
    pub(super) fn validate_dimension(&self) -> Result<()> {
        if (1..=MAX_COMPONENTS).contains(&self.dimension()) {
            return Ok(());
        }
        let value = format!("{} components", self.dimension());
        Err(Error::input("components", value, format!("1 to {MAX_COMPONENTS} components")))
    }

    /// Checks the bounds and the discretisation.
    pub(super) fn validate_extent(&self) -> Result<()> {
        for (i, v) in self.bounds.iter().flatten().enumerate() {
            check_range(&format!("bounds[{i}]"), *v, -MAX_LENGTH_M, MAX_LENGTH_M)?;
        }
        if let Some(b) = self.bounds
            && !(b[0] < b[2] && b[1] < b[3])
        {
            let allowed = "[x_min, y_min, x_max, y_max] with min below max";
            return Err(Error::input("bounds", format!("{b:?}"), allowed));
        }
        if let Discretisation::Grid { counts } = &self.discrete
            && counts.len() != self.dimension()
        {
            let value = format!("{} counts", counts.len());
            return Err(Error::input("discrete.counts", value, format!("{} counts", self.dimension())));
        }
        let count = match &self.discrete {
            Discretisation::Sequence { count } => Some(*count),
            Discretisation::Grid { counts } => counts.iter().try_fold(1usize, |n, c| n.checked_mul(*c)),
        };
        match count {
            Some(1..=MAX_ACTIONS) => Ok(()),
            _ => Err(Error::input(
                "discrete",
                "no action, or too many actions",
                format!("1 to {MAX_ACTIONS} actions"),
            )),
        }
    }
}

impl Default for Discretisation {
    fn default() -> Self {
        Discretisation::Sequence { count: 10_000 }
    }
}

impl ValidAction {
    /// The components, each in [0, 1].
    pub fn values(&self) -> &[f64] {
        &self.0
    }

    /// The action with uniform actuation noise: every component perturbed by up to `size` in either
    /// direction, clamped to [0, 1].
    pub fn perturbed(&self, size: f64, stream: &mut Stream) -> ValidAction {
        let mut perturb = |v: &f64| (v + size * (2.0 * stream.random::<f64>() - 1.0)).clamp(0.0, 1.0);
        ValidAction(self.0.iter().map(&mut perturb).collect())
    }
}

impl ActionComponent {
    /// The value that the action component `v` in [0, 1] sets, SI.
    pub fn value(&self, v: f64) -> f64 {
        self.low + v * (self.high - self.low)
    }
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
    fn grid_varies_last_component_fastest() {
        let space = ActionSpace {
            components: Vec::new(),
            bounds: None,
            discrete: Discretisation::Grid { counts: vec![2, 4] },
        };
        assert_eq!(space.count(), 8);
        assert_eq!(space.at(5).unwrap().values(), [0.75, 0.375]);
        assert!(space.at(8).is_err());
    }
}
