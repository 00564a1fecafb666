//! `iplw.scene/1`: bodies, statics, goal and what may be placed, as plain data.
//!
//! SI units, y up, angles counter-clockwise. [`Scene::from_json`] parses and validates; a `Scene` built in code
//! is checked by [`Scene::validate`]. Nothing here moves: that is `world/`.

use std::collections::{BTreeMap, HashSet};

use serde::{Deserialize, Serialize};

use super::action::ActionSpace;
use super::geometry::{self, Convex, gap};
use crate::error::{Error, Result, within};

/// The value of a scene's `format` field.
pub const FORMAT: &str = "iplw.scene/1";

/// A 2D scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Always [`FORMAT`].
    pub format: String,
    /// Free text.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// Acceleration, m/s^2.
    #[serde(default = "earth")]
    pub gravity: [f64; 2],
    /// Movable bodies; all share the task's latent factors unless `carriers` says otherwise.
    pub bodies: Vec<Body>,
    /// Things that never move.
    #[serde(default)]
    pub statics: Vec<Static>,
    /// Effects beyond gravity and contact; names and parameters as `world::effect` registers them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effects: Vec<EffectTerm>,
    /// Kept share of velocity per second, (0, 1]; shorthand for the effect `linear_drag`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub damping: Option<f64>,
    /// s
    #[serde(default = "default_time_step")]
    pub time_step: f64,
    /// Number of time steps of a full rollout.
    #[serde(default = "default_steps")]
    pub steps: u32,
    /// A state is observed at the start, every this many steps, and at the end.
    #[serde(default = "default_observe_every")]
    pub observe_every: u32,
    /// What is asked of the scene, if anything.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal: Option<Goal>,
    /// `false` lets a rollout run on after the goal is reached.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop: Option<bool>,
    /// What an action sets; makes the scene a task of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action: Option<ActionSpace>,
    /// Names of bodies and statics that carry the latent factors; all movable bodies if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub carriers: Option<Vec<String>>,
    /// Latent factors to estimate from trials.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub calibrate: Vec<String>,
    /// Quantities that may differ between settings of measured trials.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub per_setting: Vec<String>,
    /// Body fields overridden by setting name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub settings: BTreeMap<String, Setting>,
}

/// A movable body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// Unique among bodies and statics.
    pub name: String,
    /// Shape in the body's frame.
    pub shape: Shape,
    /// kg; instead of `density`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    /// kg/m^2; 1.0 if neither this nor `mass` is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    /// Coefficient of this surface; a contact's is the product of both.
    #[serde(default = "default_coefficient")]
    pub friction: f64,
    /// Coefficient of this surface; a contact's is the product of both.
    #[serde(default = "default_coefficient")]
    pub restitution: f64,
    /// m; needed for a rollout unless an action or a trial gives it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<[f64; 2]>,
    /// rad
    #[serde(default)]
    pub angle: f64,
    /// m/s
    #[serde(default)]
    pub velocity: [f64; 2],
    /// rad/s
    #[serde(default)]
    pub angular_velocity: f64,
}

/// A thing that never moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Static {
    /// Unique among bodies and statics.
    pub name: String,
    /// Shape in its own frame.
    pub shape: Shape,
    /// Coefficient of this surface.
    #[serde(default = "neutral_coefficient")]
    pub friction: f64,
    /// Coefficient of this surface.
    #[serde(default = "neutral_coefficient")]
    pub restitution: f64,
    /// m
    #[serde(default)]
    pub position: [f64; 2],
    /// rad
    #[serde(default)]
    pub angle: f64,
}

/// A shape; lengths in m, frame of its owner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A disc about the origin.
    Disc { radius: f64 },
    /// An axis-aligned box about the origin.
    Box { half_width: f64, half_height: f64 },
    /// Convex, counter-clockwise.
    Polygon { vertices: Vec<[f64; 2]> },
    /// A line with rounded ends.
    Segment {
        from: [f64; 2],
        to: [f64; 2],
        #[serde(default)]
        radius: f64,
    },
    /// Everything below the line `normal . p = offset`; statics only.
    Halfspace { normal: [f64; 2], offset: f64 },
}

/// What is asked of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Goal {
    /// Two bodies touch for a while on end.
    Contact {
        bodies: [String; 2],
        /// s
        #[serde(default)]
        hold_s: f64,
        /// Gap up to which two surfaces count as touching, m.
        #[serde(default = "default_tolerance")]
        tolerance: f64,
        /// `false` lets a rollout run on after the goal is reached.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        stop: Option<bool>,
    },
    /// A body's centre is within a polygon for a while on end.
    Inside {
        body: String,
        region: Vec<[f64; 2]>,
        /// s
        #[serde(default)]
        hold_s: f64,
        /// `false` lets a rollout run on after the goal is reached.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        stop: Option<bool>,
    },
}

/// An effect by name, with its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectTerm {
    /// Name in the effect registry.
    pub name: String,
    /// Parameter values in the registry's units.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
}

/// What a setting changes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setting {
    /// Overrides by body name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub bodies: BTreeMap<String, BodyOverride>,
    /// Overrides by name of a static.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub statics: BTreeMap<String, StaticOverride>,
}

/// Fields of a static that a setting may override.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StaticOverride {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<Shape>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle: Option<f64>,
}

/// Body fields a setting may override.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BodyOverride {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<Shape>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angular_velocity: Option<f64>,
}

/// Largest length or coordinate accepted, m.
pub(super) const FAR: f64 = 1e5;
/// Smallest length accepted, m: smaller ones vanish when squared or beside [`FAR`].
const NEAR: f64 = 1e-6;
/// Largest speed accepted, m/s (the general engine's cap is 400 m/s).
const FAST: f64 = 400.0;
/// Masses accepted, kg: those whose inverses, and those of the moments of inertia, an f32 still holds.
const MASSES: [f64; 2] = [1e-12, 1e9];
/// Densities accepted, kg/m^2: the same for the smallest and largest of bodies.
const DENSITIES: [f64; 2] = [1e-6, 1e9];
/// Time steps accepted, s.
const TIME_STEPS: [f64; 2] = [1e-6, 0.1];
/// Overlap up to this share of the smaller body is put down to measurement, not refused.
const OVERLAP_SHARE: f64 = 0.05;

impl Scene {
    /// Parses and validates a scene; errors name the field's path.
    pub fn from_json(text: &str) -> Result<Scene> {
        let scene: Scene = crate::json::parse(text)?;
        scene.validate()?;
        Ok(scene)
    }

    /// A scene with defaults and nothing in it, to be filled; not valid as it is.
    pub fn empty() -> Scene {
        Scene {
            format: FORMAT.into(),
            name: String::new(),
            gravity: earth(),
            bodies: Vec::new(),
            statics: Vec::new(),
            effects: Vec::new(),
            damping: None,
            time_step: default_time_step(),
            steps: default_steps(),
            observe_every: default_observe_every(),
            goal: None,
            stop: None,
            action: None,
            carriers: None,
            calibrate: Vec::new(),
            per_setting: Vec::new(),
            settings: BTreeMap::new(),
        }
    }

    /// The scene as pretty JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a scene is always representable as JSON")
    }

    /// Checks every value and reference; the first problem is the error.
    pub fn validate(&self) -> Result<()> {
        if self.format != FORMAT {
            return Err(Error::input("format", format!("{:?}", self.format), format!("{FORMAT:?}")));
        }
        vector("gravity", self.gravity, 1e4)?;
        if self.bodies.is_empty() || self.bodies.len() > 64 {
            return Err(Error::input("bodies", format!("{} bodies", self.bodies.len()), "1 to 64 bodies"));
        }
        if self.statics.len() > 256 {
            return Err(Error::input(
                "statics",
                format!("{} statics", self.statics.len()),
                "at most 256 statics",
            ));
        }
        let mut names = HashSet::new();
        for (i, body) in self.bodies.iter().enumerate() {
            body.validate().map_err(|e| e.under(&format!("bodies[{i}]")))?;
            unique(&mut names, &format!("bodies[{i}].name"), &body.name)?;
        }
        for (i, fixed) in self.statics.iter().enumerate() {
            fixed.validate().map_err(|e| e.under(&format!("statics[{i}]")))?;
            unique(&mut names, &format!("statics[{i}].name"), &fixed.name)?;
        }
        within("time_step", self.time_step, TIME_STEPS[0], TIME_STEPS[1])?;
        within("steps", f64::from(self.steps), 1.0, 1e6)?;
        within("observe_every", f64::from(self.observe_every), 1.0, 1e6)?;
        if let Some(damping) = self.damping
            && !(damping > 0.0 && damping <= 1.0)
        {
            return Err(Error::input("damping", damping, "a kept share of velocity per second in (0, 1]"));
        }
        self.goal.iter().try_for_each(|goal| self.validate_goal(goal).map_err(|e| e.under("goal")))?;
        for (i, name) in self.carriers.iter().flatten().enumerate() {
            self.named(&format!("carriers[{i}]"), name, true)?;
        }
        for (name, setting) in &self.settings {
            for body in setting.bodies.keys() {
                self.named(&format!("settings.{name}.bodies"), body, false)?;
            }
            let known: Vec<&String> = self.statics.iter().map(|s| &s.name).collect();
            if let Some(unknown) = setting.statics.keys().find(|n| !known.contains(n)) {
                let known = known.iter().map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
                let field = format!("settings.{name}.statics");
                return Err(Error::input(field, format!("{unknown:?}"), format!("one of {known}")));
            }
            let varied = self.in_setting(name)?;
            for fixed in &varied.statics {
                let place = format!("settings.{name}.statics.{}", fixed.name);
                fixed.validate().map_err(|e| e.under(&place))?;
            }
            for (i, body) in varied.bodies.iter().enumerate() {
                let place = format!("settings.{name}.bodies.{}", self.bodies[i].name);
                body.validate().map_err(|e| e.under(&place))?;
            }
        }
        if let Some(space) = &self.action {
            space.validate_for(self).map_err(|e| e.under("action"))?;
        }
        self.validate_apart()
    }

    /// The body named `name`.
    pub fn body(&self, name: &str) -> Option<&Body> {
        self.bodies.iter().find(|b| b.name == name)
    }

    /// Whether `name` carries the latent factors.
    pub fn carries_latents(&self, name: &str) -> bool {
        match &self.carriers {
            Some(names) => names.iter().any(|n| n == name),
            None => self.body(name).is_some(),
        }
    }

    /// Whether a rollout ends when the goal is reached.
    pub fn stops_at_goal(&self) -> bool {
        let own = match &self.goal {
            Some(Goal::Contact { stop, .. } | Goal::Inside { stop, .. }) => *stop,
            None => Some(false),
        };
        own != Some(false) && self.stop != Some(false)
    }

    /// The scene with a setting's overrides applied.
    pub fn in_setting(&self, setting: &str) -> Result<Scene> {
        let Some(overrides) = self.settings.get(setting) else {
            return Ok(self.clone());
        };
        let mut scene = self.clone();
        for body in &mut scene.bodies {
            if let Some(o) = overrides.bodies.get(&body.name) {
                o.apply(body);
            }
        }
        for fixed in &mut scene.statics {
            if let Some(o) = overrides.statics.get(&fixed.name) {
                fixed.shape = o.shape.clone().unwrap_or_else(|| fixed.shape.clone());
                fixed.position = o.position.unwrap_or(fixed.position);
                fixed.angle = o.angle.unwrap_or(fixed.angle);
            }
        }
        Ok(scene)
    }

    /// Axis-aligned box around everything bounded, widened by 2 %; for drawing.
    pub fn extent(&self) -> geometry::Bounds {
        let shapes = self.bodies.iter().filter_map(|b| Some(b.shape.convex()?.placed(b.position?, b.angle)));
        let fixed = self.statics.iter().filter_map(|s| Some(s.shape.convex()?.placed(s.position, s.angle)));
        let mut b: Option<geometry::Bounds> = self.action.as_ref().and_then(|a| a.bounds);
        for shape in shapes.chain(fixed) {
            let s = shape.bounds();
            b = Some(b.map_or(s, |b| [b[0].min(s[0]), b[1].min(s[1]), b[2].max(s[2]), b[3].max(s[3])]));
        }
        let b = b.unwrap_or([-1.0, -1.0, 1.0, 1.0]);
        let pad = 0.02 * (b[2] - b[0]).max(b[3] - b[1]).max(1e-3);
        [b[0] - pad, b[1] - pad, b[2] + pad, b[3] + pad]
    }

    /// Errors unless `name` is a body (or a static, if `statics` is set).
    pub(crate) fn named(&self, field: &str, name: &str, statics: bool) -> Result<()> {
        let bodies = self.bodies.iter().map(|b| &b.name);
        let fixed = self.statics.iter().map(|s| &s.name).filter(|_| statics);
        let known: Vec<&String> = bodies.chain(fixed).collect();
        if known.iter().any(|k| *k == name) {
            return Ok(());
        }
        let known = known.iter().map(|k| format!("{k:?}")).collect::<Vec<_>>().join(", ");
        Err(Error::input(field, format!("{name:?}"), format!("one of {known}")))
    }

    fn validate_goal(&self, goal: &Goal) -> Result<()> {
        let longest = f64::from(self.steps) * self.time_step;
        match goal {
            Goal::Contact { bodies, hold_s, tolerance, .. } => {
                self.named("bodies[0]", &bodies[0], true)?;
                self.named("bodies[1]", &bodies[1], true)?;
                if bodies[0] == bodies[1] {
                    return Err(Error::input("bodies", format!("{bodies:?}"), "two different names"));
                }
                within("tolerance", *tolerance, 0.0, FAR)?;
                within("hold_s", *hold_s, 0.0, longest)?;
            }
            Goal::Inside { body, region, hold_s, .. } => {
                self.named("body", body, false)?;
                if region.len() < 3 {
                    return Err(Error::input(
                        "region",
                        format!("{} points", region.len()),
                        "3 or more corner points",
                    ));
                }
                for (i, p) in region.iter().enumerate() {
                    vector(&format!("region[{i}]"), *p, FAR)?;
                }
                if geometry::signed_area(region).abs() < 1e-12 {
                    return Err(Error::input("region", "without area", "corners of a polygon with area"));
                }
                within("hold_s", *hold_s, 0.0, longest)?;
            }
        }
        Ok(())
    }

    /// Bodies with a given position must not overlap each other or a static. What an action places is judged
    /// when it is placed.
    fn validate_apart(&self) -> Result<()> {
        let placed_by_action = |name: &str| self.action.as_ref().is_some_and(|a| a.places(name));
        let shapes: Vec<(usize, &Body, Convex)> = self
            .bodies
            .iter()
            .enumerate()
            .filter(|(_, b)| !placed_by_action(&b.name))
            .filter_map(|(i, b)| Some((i, b, b.shape.convex()?.placed(b.position?, b.angle))))
            .collect();
        for (n, (i, body, shape)) in shapes.iter().enumerate() {
            let give = -OVERLAP_SHARE * smallest_extent(shape);
            for (_, other, other_shape) in &shapes[..n] {
                if gap(shape, other_shape) < give.max(-OVERLAP_SHARE * smallest_extent(other_shape)) {
                    let place = format!("bodies[{i}].position");
                    let value = format!(
                        "{:?} ({:?} overlaps {:?})",
                        body.position.unwrap_or_default(),
                        body.name,
                        other.name
                    );
                    return Err(Error::input(place, value, "a place clear of all other bodies and statics"));
                }
            }
            for fixed in self.statics.iter().filter(|s| !placed_by_action(&s.name)) {
                if fixed.gap_to(shape) < give {
                    let place = format!("bodies[{i}].position");
                    let value = format!(
                        "{:?} ({:?} overlaps {:?})",
                        body.position.unwrap_or_default(),
                        body.name,
                        fixed.name
                    );
                    return Err(Error::input(place, value, "a place clear of all other bodies and statics"));
                }
            }
        }
        Ok(())
    }
}

impl Body {
    /// Mass (kg) and moment of inertia about the centroid (kg m^2) at `density` if given, else the body's own.
    pub fn mass_properties(&self, density: Option<f64>) -> (f64, f64) {
        let (area, second_moment) = self.shape.area_moments();
        let mass = match (density, self.mass, self.density) {
            (Some(density), _, _) => density * area,
            (None, Some(mass), _) => mass,
            (None, None, own) => own.unwrap_or(1.0) * area,
        };
        (mass, mass * second_moment)
    }

    fn validate(&self) -> Result<()> {
        self.shape.validate(true)?;
        if self.mass.is_some() && self.density.is_some() {
            return Err(Error::input("mass", "given beside `density`", "one of `mass` and `density`"));
        }
        for (field, value, [low, high]) in [("mass", self.mass, MASSES), ("density", self.density, DENSITIES)]
        {
            value.map_or(Ok(0.0), |v| within(field, v, low, high))?;
        }
        within("friction", self.friction, 0.0, 100.0)?;
        within("restitution", self.restitution, 0.0, 1.0)?;
        if let Some(p) = self.position {
            vector("position", p, FAR)?;
        }
        within("angle", self.angle, -1e6, 1e6)?;
        vector("velocity", self.velocity, FAST)?;
        within("angular_velocity", self.angular_velocity, -1e4, 1e4)?;
        Ok(())
    }
}

impl Static {
    /// Signed distance to a placed shape, m.
    pub fn gap_to(&self, other: &Convex) -> f64 {
        match (&self.shape, self.shape.convex()) {
            (Shape::Halfspace { normal, offset }, _) => {
                let below = |p: &[f64; 2]| {
                    normal[0] * (p[0] - self.position[0]) + normal[1] * (p[1] - self.position[1]) - offset
                };
                other.points.iter().map(below).fold(f64::INFINITY, f64::min) - other.radius
            }
            (_, Some(own)) => gap(&own.placed(self.position, self.angle), other),
            (_, None) => f64::INFINITY,
        }
    }

    fn validate(&self) -> Result<()> {
        self.shape.validate(false)?;
        within("friction", self.friction, 0.0, 100.0)?;
        within("restitution", self.restitution, 0.0, 1.0)?;
        vector("position", self.position, FAR)?;
        within("angle", self.angle, -1e6, 1e6)?;
        if matches!(self.shape, Shape::Halfspace { .. }) && self.angle != 0.0 {
            return Err(Error::input("angle", self.angle, "0 for a halfspace; turn its `normal` instead"));
        }
        Ok(())
    }
}

impl Shape {
    /// The shape as convex core and radius; `None` for a halfspace.
    pub fn convex(&self) -> Option<Convex> {
        Some(match self {
            Shape::Disc { radius } => Convex { points: vec![[0.0, 0.0]], radius: *radius },
            Shape::Box { half_width: w, half_height: h } => {
                Convex { points: vec![[-w, -h], [*w, -h], [*w, *h], [-w, *h]], radius: 0.0 }
            }
            Shape::Polygon { vertices } => Convex { points: vertices.clone(), radius: 0.0 },
            Shape::Segment { from, to, radius } => Convex { points: vec![*from, *to], radius: *radius },
            Shape::Halfspace { .. } => return None,
        })
    }

    /// Area (m^2) and second moment per area about the centroid (m^2).
    fn area_moments(&self) -> (f64, f64) {
        match self {
            Shape::Disc { radius } => (std::f64::consts::PI * radius * radius, radius * radius / 2.0),
            Shape::Box { half_width: w, half_height: h } => (4.0 * w * h, (w * w + h * h) / 3.0),
            Shape::Polygon { vertices } => polygon_moments(vertices),
            Shape::Segment { from, to, radius: r } => {
                let length = ((to[0] - from[0]).powi(2) + (to[1] - from[1]).powi(2)).sqrt();
                let (ends, middle) = (std::f64::consts::PI * r * r, 2.0 * r * length);
                // Rectangle plus two half discs, each half disc's centroid at 4 r / 3 pi beyond the end.
                let reach = length / 2.0 + 4.0 * r / (3.0 * std::f64::consts::PI);
                let half_disc = r * r / 2.0 - (4.0 * r / (3.0 * std::f64::consts::PI)).powi(2);
                let rectangle = (length * length + 4.0 * r * r) / 12.0;
                let area = ends + middle;
                (area, (middle * rectangle + ends * (half_disc + reach * reach)) / area)
            }
            Shape::Halfspace { .. } => (f64::INFINITY, 0.0),
        }
    }

    fn validate(&self, movable: bool) -> Result<()> {
        let length = |field: &str, v: f64| within(&format!("shape.{field}"), v, NEAR, FAR).map(drop);
        match self {
            Shape::Disc { radius } => length("radius", *radius),
            Shape::Box { half_width, half_height } => {
                length("half_width", *half_width)?;
                length("half_height", *half_height)
            }
            Shape::Polygon { vertices } => validate_polygon(vertices),
            Shape::Segment { from, to, radius } => {
                vector("shape.from", *from, FAR)?;
                vector("shape.to", *to, FAR)?;
                if ((to[0] - from[0]).powi(2) + (to[1] - from[1]).powi(2)).sqrt() < NEAR {
                    let allowed = format!("a point {NEAR} m or more from `from`");
                    return Err(Error::input("shape.to", format!("{to:?}"), allowed));
                }
                if movable {
                    length("radius", *radius)
                } else {
                    within("shape.radius", *radius, 0.0, FAR).map(drop)
                }
            }
            Shape::Halfspace { .. } if movable => Err(Error::input(
                "shape.type",
                "\"halfspace\"",
                "disc, box, polygon or segment for a movable body",
            )),
            Shape::Halfspace { normal, offset } => {
                vector("shape.normal", *normal, 1.1)?;
                let size = (normal[0].powi(2) + normal[1].powi(2)).sqrt();
                if (size - 1.0).abs() > 1e-3 {
                    return Err(Error::input("shape.normal", format!("{normal:?}"), "a vector of length 1"));
                }
                within("shape.offset", *offset, -FAR, FAR).map(drop)
            }
        }
    }
}

impl BodyOverride {
    fn apply(&self, body: &mut Body) {
        if let Some(shape) = &self.shape {
            body.shape = shape.clone();
        }
        if self.mass.is_some() || self.density.is_some() {
            (body.mass, body.density) = (self.mass, self.density);
        }
        body.friction = self.friction.unwrap_or(body.friction);
        body.restitution = self.restitution.unwrap_or(body.restitution);
        body.position = self.position.or(body.position);
        body.angle = self.angle.unwrap_or(body.angle);
        body.velocity = self.velocity.unwrap_or(body.velocity);
        body.angular_velocity = self.angular_velocity.unwrap_or(body.angular_velocity);
    }
}

fn validate_polygon(vertices: &[[f64; 2]]) -> Result<()> {
    let n = vertices.len();
    if !(3..=32).contains(&n) {
        return Err(Error::input("shape.vertices", format!("{n} vertices"), "3 to 32 vertices"));
    }
    for (i, v) in vertices.iter().enumerate() {
        vector(&format!("shape.vertices[{i}]"), *v, FAR)?;
    }
    for i in 0..n {
        let (a, b) = (vertices[i], vertices[(i + 1) % n]);
        // Every other corner, not only the next: a star turns the same way at each corner too.
        if (2..n).any(|k| geometry::signed_area(&[a, b, vertices[(i + k) % n]]) <= 1e-12) {
            let corner = (i + 1) % n;
            return Err(Error::input(
                format!("shape.vertices[{corner}]"),
                format!("{b:?}"),
                "corners of a convex polygon, counter-clockwise, no three on a line",
            ));
        }
    }
    Ok(())
}

/// Area and second moment per area about the centroid (Green's theorem over triangles from the origin).
fn polygon_moments(vertices: &[[f64; 2]]) -> (f64, f64) {
    let n = vertices.len();
    let (mut area, mut centre, mut second) = (0.0, [0.0, 0.0], 0.0);
    for i in 0..n {
        let (a, b) = (vertices[i], vertices[(i + 1) % n]);
        let triangle = geometry::signed_area(&[[0.0, 0.0], a, b]);
        area += triangle;
        centre = [centre[0] + triangle * (a[0] + b[0]) / 3.0, centre[1] + triangle * (a[1] + b[1]) / 3.0];
        let squares = |k: usize| a[k] * a[k] + a[k] * b[k] + b[k] * b[k];
        second += triangle * (squares(0) + squares(1)) / 6.0;
    }
    let centre = [centre[0] / area, centre[1] / area];
    (area, second / area - centre[0].powi(2) - centre[1].powi(2))
}

fn smallest_extent(shape: &Convex) -> f64 {
    let b = shape.bounds();
    (b[2] - b[0]).min(b[3] - b[1])
}

fn vector(field: &str, v: [f64; 2], limit: f64) -> Result<()> {
    within(&format!("{field}[0]"), v[0], -limit, limit)?;
    within(&format!("{field}[1]"), v[1], -limit, limit)?;
    Ok(())
}

fn unique(names: &mut HashSet<String>, field: &str, name: &str) -> Result<()> {
    if name.is_empty() || name.len() > 100 {
        return Err(Error::input(field, format!("{name:?}"), "a name of 1 to 100 characters"));
    }
    if names.insert(name.to_string()) {
        Ok(())
    } else {
        Err(Error::input(field, format!("{name:?}"), "a name that no other body or static has"))
    }
}

fn earth() -> [f64; 2] {
    [0.0, -9.8]
}
fn default_time_step() -> f64 {
    1.0 / 240.0
}
fn default_steps() -> u32 {
    4000
}
fn default_observe_every() -> u32 {
    60
}
fn default_coefficient() -> f64 {
    0.5
}
fn neutral_coefficient() -> f64 {
    1.0
}
fn default_tolerance() -> f64 {
    0.0167
}
