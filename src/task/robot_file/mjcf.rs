//! MJCF, MuJoCo's files: bodies in bodies, defaults by class, poses relative to the parent.
//!
//! Several joints of one body become joints of links of their own, the inner ones of negligible mass.

use std::collections::HashMap;

use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use roxmltree::Node;

use super::attributes::{children, direction, number, numbers, vector};
use super::spatial::{
    LinkOutline, SolidMoments, SpatialInertia, SpatialJoint, SpatialLink, SpatialModel, SpatialMotor,
};
use super::urdf::longest;
use crate::error::{Error, Result};
use crate::task::joint::Control;

/// Mass (kg) and inertia (kg m^2) of a link between two joints of one body.
const BETWEEN: f64 = 1e-6;
/// Density of a geom without mass, kg/m^3: MuJoCo's default.
const DENSITY: f64 = 1000.0;
/// Maximum depth of bodies.
const MAX_DEPTH: usize = 64;
/// Top-level elements that do not change the motion of a mechanism without contacts.
const WITHOUT_EFFECT: [&str; 9] =
    ["asset", "compiler", "custom", "default", "keyframe", "sensor", "size", "statistic", "visual"];

/// Attributes by class and element.
type Defaults<'a> = HashMap<String, HashMap<String, HashMap<&'a str, &'a str>>>;

/// Reader of a file.
struct MjcfReader<'a> {
    defaults: Defaults<'a>,
    /// rad per unit of an angle
    angle: f64,
    euler: String,
    model: SpatialModel,
    unnamed: usize,
}

/// An element with the attributes of its class.
struct Element<'a> {
    tag: String,
    attributes: HashMap<&'a str, &'a str>,
}

impl Element<'_> {
    fn text(&self, key: &str) -> Option<&str> {
        self.attributes.get(key).copied()
    }

    fn number(&self, key: &str, otherwise: f64) -> Result<f64> {
        self.text(key).map_or(Ok(otherwise), |text| number(&self.tag, key, text))
    }

    fn vector(&self, key: &str) -> Result<Option<Vector3<f64>>> {
        self.text(key).map(|text| vector(&self.tag, key, text)).transpose()
    }

    fn numbers(&self, key: &str) -> Result<Vec<f64>> {
        self.text(key).map_or(Ok(Vec::new()), |text| numbers(&self.tag, key, text))
    }
}

/// Reads a `<mujoco>`.
pub fn read(root: Node) -> Result<SpatialModel> {
    let compiler = children(root, "compiler").next();
    let compiled = |key: &str| compiler.and_then(|c| c.attribute(key));
    let mut defaults = Defaults::new();
    for node in children(root, "default") {
        read_defaults(node, "main", &HashMap::new(), &mut defaults, 0)?;
    }
    let mut reader = MjcfReader {
        defaults,
        angle: if compiled("angle") == Some("radian") { 1.0 } else { 1f64.to_radians() },
        euler: compiled("eulerseq").unwrap_or("xyz").into(),
        model: SpatialModel {
            name: root.attribute("model").unwrap_or("mechanism").into(),
            gravity: Vector3::new(0.0, 0.0, -9.81),
            time_step: 0.002,
            ..SpatialModel::default()
        },
        unnamed: 0,
    };
    for option in children(root, "option") {
        if let Some(text) = option.attribute("gravity") {
            reader.model.gravity = vector("option", "gravity", text)?;
        }
        if let Some(text) = option.attribute("timestep") {
            reader.model.time_step = number("option", "timestep", text)?;
        }
    }
    for world in children(root, "worldbody") {
        if children(world, "geom").next().is_some() {
            reader.model.left_out.push("Geoms of the world are left out: there are no contacts.".into());
        }
        for body in children(world, "body") {
            reader.body(body, None, &Isometry3::identity(), "main", 0)?;
        }
    }
    for actuators in children(root, "actuator") {
        for node in actuators.children().filter(Node::is_element) {
            reader.motor(node)?;
        }
    }
    for node in root.children().filter(Node::is_element) {
        let tag = node.tag_name().name();
        let is_known = WITHOUT_EFFECT.contains(&tag) || ["option", "worldbody", "actuator"].contains(&tag);
        if !is_known {
            reader.model.left_out.push(format!("<{tag}> is left out."));
        }
    }
    Ok(reader.model)
}

/// Attributes of a class and of those in it, which have its own unless they set others.
fn read_defaults<'a>(
    node: Node<'a, '_>,
    class: &str,
    inherited: &HashMap<String, HashMap<&'a str, &'a str>>,
    all: &mut Defaults<'a>,
    depth: usize,
) -> Result<()> {
    if depth > MAX_DEPTH {
        return Err(Error::input(
            "default",
            "too deep",
            format!("at most {MAX_DEPTH} classes in each other"),
        ));
    }
    let mut own = inherited.clone();
    for child in node.children().filter(|c| c.is_element() && !c.has_tag_name("default")) {
        let attributes = own.entry(child.tag_name().name().to_string()).or_default();
        attributes.extend(child.attributes().map(|a| (a.name(), a.value())));
    }
    for child in children(node, "default") {
        read_defaults(child, child.attribute("class").unwrap_or("main"), &own, all, depth + 1)?;
    }
    all.insert(node.attribute("class").unwrap_or(class).to_string(), own);
    Ok(())
}

impl<'a> MjcfReader<'a> {
    /// An element with the attributes of its class.
    fn element(&self, node: Node<'a, '_>, class: &str) -> Element<'a> {
        let tag = node.tag_name().name();
        let class = node.attribute("class").unwrap_or(class);
        let inherited = self.defaults.get(class).or_else(|| self.defaults.get("main"));
        let mut attributes = inherited.and_then(|of| of.get(tag)).cloned().unwrap_or_default();
        attributes.extend(node.attributes().map(|a| (a.name(), a.value())));
        Element {
            tag: node.attribute("name").map_or_else(|| tag.into(), |name| format!("{tag} {name}")),
            attributes,
        }
    }

    /// The rotation of an element.
    fn rotation(&self, element: &Element) -> Result<UnitQuaternion<f64>> {
        if let [w, x, y, z] = element.numbers("quat")?[..] {
            return Ok(UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)));
        }
        if let [x, y, z, angle] = element.numbers("axisangle")?[..] {
            let axis = Unit::new_normalize(Vector3::new(x, y, z));
            return Ok(UnitQuaternion::from_axis_angle(&axis, angle * self.angle));
        }
        if let Some(angles) = element.vector("euler")? {
            let mut out = UnitQuaternion::identity();
            for (k, letter) in self.euler.chars().take(3).enumerate() {
                let axis = match letter.to_ascii_lowercase() {
                    'x' => Vector3::x_axis(),
                    'y' => Vector3::y_axis(),
                    _ => Vector3::z_axis(),
                };
                let turn = UnitQuaternion::from_axis_angle(&axis, angles[k] * self.angle);
                // Capital letters: axes that do not move.
                out = if letter.is_uppercase() { turn * out } else { out * turn };
            }
            return Ok(out);
        }
        if let Some(z) = element.text("zaxis") {
            let z = direction(&element.tag, "zaxis", z)?;
            let turn = Rotation3::rotation_between(&Vector3::z(), &z);
            return Ok(
                turn.map_or_else(UnitQuaternion::identity, |r| UnitQuaternion::from_rotation_matrix(&r))
            );
        }
        Ok(UnitQuaternion::identity())
    }

    fn pose(&self, element: &Element) -> Result<Isometry3<f64>> {
        let at = element.vector("pos")?.unwrap_or_else(Vector3::zeros);
        Ok(Isometry3::from_parts(Translation3::from(at), self.rotation(element)?))
    }

    fn name(&mut self, node: Node, kind: &str) -> String {
        self.unnamed += 1;
        node.attribute("name").map_or_else(|| format!("{kind}{}", self.unnamed), String::from)
    }

    fn body(
        &mut self,
        node: Node<'a, '_>,
        parent: Option<usize>,
        frame: &Isometry3<f64>,
        class: &str,
        depth: usize,
    ) -> Result<()> {
        if depth > MAX_DEPTH {
            return Err(Error::input(
                "body",
                "too deep",
                format!("at most {MAX_DEPTH} bodies in each other"),
            ));
        }
        let class = node.attribute("childclass").unwrap_or(class);
        let frame = frame * self.pose(&self.element(node, class))?;
        let name = self.name(node, "body");
        let mut joints = Vec::new();
        for joint in children(node, "joint") {
            joints.push(self.joint(joint, &frame, class)?);
        }
        if let Some(free) = children(node, "freejoint").next() {
            let value = free.attribute("name").unwrap_or("freejoint");
            return Err(Error::input(format!("body {name}"), value, "a body on hinges and slides"));
        }
        let last = joints.pop();
        let mut parent = parent;
        for (k, joint) in joints.into_iter().enumerate() {
            let (centre, tensor) = (joint.anchor, Matrix3::identity() * BETWEEN);
            self.model.links.push(SpatialLink {
                name: format!("{name}_{}", k + 1),
                parent,
                joint: Some(joint),
                inertia: SpatialInertia { mass: BETWEEN, centre, tensor },
                outline: None,
            });
            parent = Some(self.model.links.len() - 1);
        }
        let (inertia, outline) = self.solids(node, &frame, class)?;
        let index = self.model.links.len();
        self.model.links.push(SpatialLink { name, parent, joint: last, inertia, outline });
        for child in children(node, "body") {
            self.body(child, Some(index), &frame, class, depth + 1)?;
        }
        Ok(())
    }

    fn joint(&mut self, node: Node<'a, '_>, frame: &Isometry3<f64>, class: &str) -> Result<SpatialJoint> {
        let own = self.element(node, class);
        let name = self.name(node, "joint");
        let is_slide = match own.text("type").unwrap_or("hinge") {
            "hinge" => false,
            "slide" => true,
            other => {
                return Err(Error::input(
                    format!("joint {name}.type"),
                    other,
                    "hinge or slide: the plane has no others",
                ));
            }
        };
        let unit = if is_slide { 1.0 } else { self.angle };
        let reference = own.number("ref", 0.0)?;
        let limits = match own.numbers("range")?[..] {
            [low, high] if own.text("limited") != Some("false") && low < high => {
                Some([low, high].map(|end| unit * (end - reference)))
            }
            _ => None,
        };
        if reference != 0.0 {
            self.model.left_out.push(format!("Positions of {name} are relative to its `ref`."));
        }
        let axis = own.text("axis").map_or(Ok(Vector3::z()), |text| direction(&own.tag, "axis", text))?;
        let at = own.vector("pos")?.unwrap_or_else(Vector3::zeros);
        Ok(SpatialJoint {
            is_slide,
            anchor: frame.translation.vector + frame.rotation * at,
            axis: frame.rotation * axis,
            damping: own.number("damping", 0.0)?,
            friction: own.number("frictionloss", 0.0)?,
            armature: own.number("armature", 0.0)?,
            stiffness: own.number("stiffness", 0.0)?,
            rest: unit * (own.number("springref", 0.0)? - reference),
            limits,
            name,
        })
    }

    /// Inertia and outline of a body.
    fn solids(
        &mut self,
        node: Node<'a, '_>,
        frame: &Isometry3<f64>,
        class: &str,
    ) -> Result<(SpatialInertia, Option<LinkOutline>)> {
        let (mut sum, mut outline) = (SpatialInertia::none(), None);
        for geom in children(node, "geom") {
            let own = self.element(geom, class);
            let Some((inertia, drawn)) = self.geom(&own, frame)? else {
                let kind = own.text("type").unwrap_or("sphere");
                self.model.left_out.push(format!("A geom of type {kind} has no mass here."));
                continue;
            };
            sum = sum.with(&inertia);
            outline = outline.or(Some(drawn));
        }
        let Some(own) = children(node, "inertial").next() else { return Ok((sum, outline)) };
        let own = self.element(own, class);
        let at = frame * self.pose(&own)?;
        let turn = at.rotation.to_rotation_matrix();
        let local = match (own.vector("diaginertia")?, own.numbers("fullinertia")?.as_slice()) {
            (Some(diagonal), _) => Matrix3::from_diagonal(&diagonal),
            (None, [xx, yy, zz, xy, xz, yz]) => Matrix3::new(*xx, *xy, *xz, *xy, *yy, *yz, *xz, *yz, *zz),
            _ => return Err(Error::input("inertial", "no inertia", "diaginertia or fullinertia")),
        };
        let tensor = turn * local * turn.transpose();
        Ok((
            SpatialInertia { mass: own.number("mass", 0.0)?, centre: at.translation.vector, tensor },
            outline,
        ))
    }

    /// Inertia and outline of a geom; `None` for shapes that are not known.
    fn geom(&self, own: &Element, frame: &Isometry3<f64>) -> Result<Option<(SpatialInertia, LinkOutline)>> {
        let size = own.numbers("size")?;
        let at = |k: usize| size.get(k).copied().unwrap_or(0.0);
        let mut pose = self.pose(own)?;
        let mut length = 2.0 * at(1);
        if let [ax, ay, az, bx, by, bz] = own.numbers("fromto")?[..] {
            let (a, b) = (Vector3::new(ax, ay, az), Vector3::new(bx, by, bz));
            length = (b - a).norm();
            let turn = UnitQuaternion::rotation_between(&Vector3::z(), &(b - a));
            let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
            pose = Isometry3::from_parts(Translation3::from(0.5 * (a + b)), turn.unwrap_or(half_turn));
        }
        let line = (Vector3::z() * (0.5 * length), at(0));
        let (moments, (along, radius)) = match own.text("type").unwrap_or("sphere") {
            "sphere" => (SolidMoments::sphere(at(0)), (Vector3::zeros(), at(0))),
            "capsule" => (SolidMoments::capsule(at(0), length), line),
            "cylinder" => (SolidMoments::cylinder(at(0), length), line),
            "box" => {
                let half = Vector3::new(at(0), at(1), at(2));
                (SolidMoments::cuboid(half), longest(half))
            }
            _ => return Ok(None),
        };
        let mass = match own.text("mass") {
            Some(text) => number(&own.tag, "mass", text)?,
            None => own.number("density", DENSITY)? * moments.volume,
        };
        let at = frame * pose;
        let turn = at.rotation.to_rotation_matrix();
        let tensor = turn * Matrix3::from_diagonal(&(moments.by_mass * mass)) * turn.transpose();
        let ends = [-along, along].map(|end| at.translation.vector + at.rotation * end);
        let inertia = SpatialInertia { mass, centre: at.translation.vector, tensor };
        Ok(Some((inertia, LinkOutline { ends, radius: radius.max(1e-3) })))
    }

    fn motor(&mut self, node: Node<'a, '_>) -> Result<()> {
        let own = self.element(node, "main");
        let kind = node.tag_name().name();
        let control = match kind {
            "motor" => Control::Torque,
            "position" => Control::Position,
            "velocity" => Control::Velocity,
            _ => {
                self.model.left_out.push(format!("An actuator <{kind}> is left out."));
                return Ok(());
            }
        };
        let Some(joint) = own.text("joint") else {
            self.model.left_out.push(format!("An actuator <{kind}> that is not on a joint is left out."));
            return Ok(());
        };
        let gear = own.numbers("gear")?.first().copied().unwrap_or(1.0);
        if gear != 1.0 {
            self.model.left_out.push(format!(
                "Commands of {joint} are those of the joint: MuJoCo's controls times the gear, {gear}."
            ));
        }
        let largest = |range: Vec<f64>| range.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
        let force = largest(own.numbers("forcerange")?) * gear.abs();
        let range = largest(own.numbers("ctrlrange")?) * gear.abs();
        let limit = if force > 0.0 || control != Control::Torque { force } else { range };
        let (stiffness, damping) = match control {
            Control::Torque => (0.0, 0.0),
            Control::Position => (own.number("kp", 1.0)? * gear * gear, own.number("kv", 0.0)? * gear * gear),
            Control::Velocity => (0.0, own.number("kv", 1.0)? * gear * gear),
        };
        let joint = joint.to_string();
        let max_torque = (limit > 0.0).then_some(limit);
        self.model.motors.push(SpatialMotor { joint, control, stiffness, damping, max_torque });
        Ok(())
    }
}
