//! Scenes and trajectories for an agent: pictures, short tables, and text with units.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::error::Result;
use crate::picture::{Style, filmstrip_svg, svg_to_png};
use crate::serve::problem::{HandlerResult, Problem};
use crate::serve::wire::BodyTrack;
use crate::task::action::{ActionComponent, ActionQuantity};
use crate::task::scene::{Goal, GoalPoint, Shape};
use crate::task::{Placement, Scene};
use crate::trajectory::{Track, Trajectory};

/// The trajectory of a simulated or measured rollout, as parsed from a response.
#[derive(Deserialize)]
pub struct RolloutTrajectory {
    pub reason: Option<String>,
    pub solved: Option<bool>,
    /// s
    #[serde(default)]
    pub t: Vec<f64>,
    #[serde(default)]
    pub bodies: BTreeMap<String, BodyTrack>,
}

/// The path of a body: rows `[t, x, y]` in s, m and m (y up), evenly over the rollout including both ends.
pub type SampledPath = Vec<[f64; 3]>;

/// Rows of a path: enough to show the motion, few enough to read.
const PATH_ROWS: usize = 13;
/// Width of pictures, px.
pub const PICTURE_WIDTH_PX: u32 = 640;

impl RolloutTrajectory {
    /// Sampled paths by body name.
    pub fn paths(&self) -> BTreeMap<String, SampledPath> {
        let n = self.t.len();
        let rows = PATH_ROWS.min(n);
        let at = |k: usize| if rows < 2 { 0 } else { k * (n - 1) / (rows - 1) };
        let path = |body: &BodyTrack| -> SampledPath {
            let row = |k: usize| [milli(self.t[at(k)]), milli(body.x[at(k)]), milli(body.y[at(k)])];
            (0..rows).map(row).collect()
        };
        self.bodies.iter().map(|(name, body)| (name.clone(), path(body))).collect()
    }

    /// The outcome as text.
    pub fn summary(&self) -> String {
        match (&self.reason, self.solved) {
            (Some(reason), _) => format!("cannot be placed: {reason}"),
            (None, Some(true)) => format!("solved after {:.2} s", self.t.last().unwrap_or(&0.0)),
            (None, Some(false)) => "not solved".into(),
            (None, None) => format!("{:.2} s", self.t.last().unwrap_or(&0.0)),
        }
    }

    /// Frames of the rollout side by side, PNG; `action`, if any, is placed in `scene`.
    pub async fn filmstrip(self, scene: Scene, action: Option<Vec<f64>>) -> HandlerResult<Vec<u8>> {
        let draw = move || -> Result<Vec<u8>> {
            let placed = match (&scene.action, action) {
                (Some(space), Some(action)) => match space.place(&scene, &space.validate(&action)?) {
                    Placement::Valid(placed) => *placed,
                    Placement::Invalid(_) => scene,
                },
                _ => scene,
            };
            let style = Style { width: PICTURE_WIDTH_PX, ..Style::default() };
            svg_to_png(&filmstrip_svg(&placed, &self.trajectory(), &style), PICTURE_WIDTH_PX)
        };
        let drawn = tokio::task::spawn_blocking(draw).await.map_err(|_| Problem::internal())?;
        Ok(drawn?)
    }

    fn trajectory(self) -> Trajectory {
        let track = |(name, b): (String, BodyTrack)| Track {
            name,
            x: b.x,
            y: b.y,
            angle: b.angle,
            ..Track::default()
        };
        Trajectory {
            times: self.t,
            bodies: self.bodies.into_iter().map(track).collect(),
            ..Trajectory::default()
        }
    }
}

/// Rounds to a thousandth.
fn milli(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

/// An action as text, rounded to a thousandth.
pub fn format_action(action: &[f64]) -> String {
    let numbers: Vec<String> = action.iter().map(|v| milli(*v).to_string()).collect();
    format!("[{}]", numbers.join(", "))
}

/// The objects of a scene as text, one line each.
pub fn describe_scene(scene: &Scene) -> Vec<String> {
    let at = |p: [f64; 2]| format!("at ({:.2}, {:.2}) m", p[0], p[1]);
    let bodies = scene.bodies.iter().map(|b| match b.position {
        Some(p) => format!("{}: {}, {}", b.name, shape(&b.shape), at(p)),
        None => format!("{}: {}, placed by the action", b.name, shape(&b.shape)),
    });
    let statics = scene.statics.iter().map(|s| {
        let turned = if s.angle == 0.0 { String::new() } else { format!(", turned by {:.2} rad", s.angle) };
        format!("{} (fixed): {}, {}{turned}", s.name, shape(&s.shape), at(s.position))
    });
    bodies.chain(statics).collect()
}

fn shape(shape: &Shape) -> String {
    let value = serde_json::to_value(shape).unwrap_or_default();
    let number = |name: &str| value.get(name).and_then(serde_json::Value::as_f64).unwrap_or(0.0);
    match value.get("type").and_then(serde_json::Value::as_str).unwrap_or("thing") {
        "disc" => format!("disc of radius {:.2} m", number("radius")),
        "box" => {
            format!("box {:.2} m wide, {:.2} m high", 2.0 * number("half_width"), 2.0 * number("half_height"))
        }
        other => other.into(),
    }
}

/// The goal as text.
pub fn describe_goal(goal: &Goal) -> String {
    let hold = |s: f64| if s > 0.0 { format!(" for {s} s") } else { String::new() };
    match goal {
        Goal::Contact { bodies: [one, other], hold_s, .. } => {
            format!("{one} and {other} touch{}", hold(*hold_s))
        }
        Goal::Apart { bodies: [one, other], after_touch, hold_s, .. } => {
            let after = if *after_touch { " after they have touched" } else { "" };
            format!("{one} and {other} do not touch{}{after}", hold(*hold_s))
        }
        Goal::Above { body, height, line, point, hold_s, .. } => {
            let what = if *point == GoalPoint::Centre { "the centre of " } else { "all of " };
            let place = match (height, line) {
                (Some(height), _) => format!("y = {height:.2} m"),
                (_, Some([[ax, ay], [bx, by]])) => {
                    format!("the line through ({ax:.2}, {ay:.2}) and ({bx:.2}, {by:.2}) m")
                }
                (None, None) => "a line".into(),
            };
            format!("{what}{body} is above {place}{}", hold(*hold_s))
        }
        Goal::Inside { body, region, hold_s, .. } => {
            let corners: Vec<String> = region.iter().map(|[x, y]| format!("({x:.2}, {y:.2})")).collect();
            format!("the centre of {body} is inside the polygon {} m{}", corners.join(" "), hold(*hold_s))
        }
    }
}

/// An action component as text.
pub fn describe_component(index: usize, component: &ActionComponent) -> String {
    let (name, unit) = match component.set {
        ActionQuantity::X => ("x", "m"),
        ActionQuantity::Y => ("y", "m"),
        ActionQuantity::Radius => ("radius", "m"),
        ActionQuantity::Angle => ("angle", "rad"),
        ActionQuantity::Vx => ("vx", "m/s"),
        ActionQuantity::Vy => ("vy", "m/s"),
        ActionQuantity::Omega => ("omega", "rad/s"),
    };
    let ActionComponent { target, low, high, .. } = component;
    format!("action[{index}]: {name} of {target}, {low:.2} {unit} at 0 to {high:.2} {unit} at 1")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_have_few_rows_and_include_both_ends() {
        for n in [0, 1, 2, 12, 13, 14, 500] {
            let t: Vec<f64> = (0..n).map(|i| i as f64 * 0.01).collect();
            let body = BodyTrack { x: t.clone(), y: t.clone(), angle: t.clone() };
            let bodies = BTreeMap::from([("red".to_string(), body)]);
            let rolled = RolloutTrajectory { reason: None, solved: None, t: t.clone(), bodies };
            let rows = &rolled.paths()["red"];
            assert_eq!(rows.len(), n.min(PATH_ROWS));
            assert_eq!(rows.first().map(|r| r[0]), t.first().map(|t| milli(*t)));
            assert_eq!(rows.last().map(|r| r[1]), t.last().map(|t| milli(*t)));
            assert!(rows.windows(2).all(|w| w[0][0] < w[1][0]), "{n}");
        }
    }
}
