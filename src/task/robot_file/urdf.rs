//! URDF: `<link>` and `<joint>` by name, poses relative to the parent.
//!
//! Joints get motors that command torques up to the effort limit.

use std::collections::HashMap;

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};
use roxmltree::Node;

use super::attributes::{children, direction, number, vector};
use super::spatial::{LinkOutline, SpatialInertia, SpatialJoint, SpatialLink, SpatialModel, SpatialMotor};
use crate::error::{Error, Result};
use crate::task::joint::Control;

/// A URDF file has no time step: 2 ms, MuJoCo's default.
const TIME_STEP: f64 = 0.002;

/// Reads a `<robot>`.
pub fn read(root: Node) -> Result<SpatialModel> {
    let mut model = SpatialModel {
        name: root.attribute("name").unwrap_or("robot").into(),
        gravity: Vector3::new(0.0, 0.0, -9.81),
        time_step: TIME_STEP,
        ..SpatialModel::default()
    };
    let links: HashMap<&str, Node> =
        children(root, "link").filter_map(|link| Some((link.attribute("name")?, link))).collect();
    let joints: Vec<Node> = children(root, "joint").collect();
    let mut bases: Vec<&str> = children(root, "link")
        .filter_map(|link| link.attribute("name"))
        .filter(|name| !joints.iter().any(|joint| end_of(*joint, "child") == Some(*name)))
        .collect();
    if bases.len() != 1 {
        bases.sort_unstable();
        let value = format!("{} links without a parent: {}", bases.len(), bases.join(", "));
        return Err(Error::input("robot", value, "one base link"));
    }
    model.left_out.push(format!("The base {} is fixed to the world.", bases[0]));
    let mut waiting = vec![(bases[0], None::<(usize, Node)>, Isometry3::identity())];
    while let Some((name, by, frame)) = waiting.pop() {
        let node = links.get(name).ok_or_else(|| Error::input("link", name, "a link of the robot"))?;
        if model.links.iter().any(|link| link.name == name) {
            return Err(Error::input("link", name, "a tree: a link has one parent"));
        }
        let joint = by.map(|(_, joint)| read_joint(joint, &frame, &mut model)).transpose()?.flatten();
        let index = model.links.len();
        model.links.push(SpatialLink {
            name: name.into(),
            parent: by.map(|(parent, _)| parent),
            joint,
            inertia: inertia(*node, &frame)?,
            outline: outline(*node, &frame)?,
        });
        for joint in joints.iter().filter(|joint| end_of(**joint, "parent") == Some(name)) {
            let Some(child) = end_of(*joint, "child") else { continue };
            waiting.push((child, Some((index, *joint)), frame * origin(*joint)?));
        }
    }
    for tag in ["transmission", "gazebo", "mimic"] {
        if root.descendants().any(|node| node.has_tag_name(tag)) {
            model.left_out.push(format!("<{tag}> elements are left out."));
        }
    }
    Ok(model)
}

/// Name of a joint's parent or child.
fn end_of<'a>(joint: Node<'a, '_>, tag: &'static str) -> Option<&'a str> {
    children(joint, tag).next()?.attribute("link")
}

/// The pose in `<origin>`.
fn origin(node: Node) -> Result<Isometry3<f64>> {
    let Some(own) = children(node, "origin").next() else { return Ok(Isometry3::identity()) };
    let of =
        |name: &str| own.attribute(name).map_or(Ok(Vector3::zeros()), |text| vector("origin", name, text));
    let (at, turn) = (of("xyz")?, of("rpy")?);
    Ok(Isometry3::from_parts(
        Translation3::from(at),
        UnitQuaternion::from_euler_angles(turn.x, turn.y, turn.z),
    ))
}

fn read_joint(node: Node, frame: &Isometry3<f64>, model: &mut SpatialModel) -> Result<Option<SpatialJoint>> {
    let name = node.attribute("name").unwrap_or("joint").to_string();
    let is_slide = match node.attribute("type") {
        Some("fixed") => return Ok(None),
        Some("revolute" | "continuous") => false,
        Some("prismatic") => true,
        other => {
            let allowed = "revolute, continuous, prismatic or fixed";
            return Err(Error::input(format!("joint {name}.type"), format!("{other:?}"), allowed));
        }
    };
    let attribute = |tag: &'static str, key: &str| -> Result<f64> {
        let found = children(node, tag).next().and_then(|own| own.attribute(key));
        found.map_or(Ok(0.0), |text| number(&name, key, text))
    };
    let axis = match children(node, "axis").next().and_then(|own| own.attribute("xyz")) {
        Some(text) => direction(&name, "axis", text)?,
        None => Vector3::x(),
    };
    let ends = [attribute("limit", "lower")?, attribute("limit", "upper")?];
    let is_limited = node.attribute("type") != Some("continuous") && ends[0] < ends[1];
    let effort = attribute("limit", "effort")?;
    model.motors.push(SpatialMotor {
        joint: name.clone(),
        control: Control::Torque,
        stiffness: 0.0,
        damping: 0.0,
        max_torque: (effort > 0.0).then_some(effort),
    });
    Ok(Some(SpatialJoint {
        is_slide,
        anchor: frame.translation.vector,
        axis: frame.rotation * axis,
        damping: attribute("dynamics", "damping")?,
        friction: attribute("dynamics", "friction")?,
        armature: 0.0,
        stiffness: 0.0,
        rest: 0.0,
        limits: is_limited.then_some(ends),
        name,
    }))
}

fn inertia(link: Node, frame: &Isometry3<f64>) -> Result<SpatialInertia> {
    let Some(own) = children(link, "inertial").next() else { return Ok(SpatialInertia::none()) };
    let name = link.attribute("name").unwrap_or("link");
    let at = frame * origin(own)?;
    let value = |tag: &'static str, key: &str| -> Result<f64> {
        let found = children(own, tag).next().and_then(|node| node.attribute(key));
        found.map_or(Ok(0.0), |text| number(name, key, text))
    };
    let [xx, yy, zz] = [value("inertia", "ixx")?, value("inertia", "iyy")?, value("inertia", "izz")?];
    let [xy, xz, yz] = [value("inertia", "ixy")?, value("inertia", "ixz")?, value("inertia", "iyz")?];
    let turn = at.rotation.to_rotation_matrix();
    let local = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    Ok(SpatialInertia {
        mass: value("mass", "value")?,
        centre: at.translation.vector,
        tensor: turn * local * turn.transpose(),
    })
}

/// A cylinder, box or sphere of the link.
fn outline(link: Node, frame: &Isometry3<f64>) -> Result<Option<LinkOutline>> {
    for part in children(link, "collision").chain(children(link, "visual")) {
        let at = frame * origin(part)?;
        let Some(shape) = children(part, "geometry").next().and_then(|own| own.first_element_child()) else {
            continue;
        };
        let value = |key: &str| shape.attribute(key).map_or(Ok(0.0), |text| number("geometry", key, text));
        let (along, radius) = match shape.tag_name().name() {
            "cylinder" | "capsule" => (Vector3::z() * (0.5 * value("length")?), value("radius")?),
            "sphere" => (Vector3::zeros(), value("radius")?),
            "box" => longest(vector("geometry", "size", shape.attribute("size").unwrap_or(""))? * 0.5),
            _ => continue,
        };
        let ends = [-along, along].map(|end| at.translation.vector + at.rotation * end);
        return Ok((radius > 0.0).then_some(LinkOutline { ends, radius }));
    }
    Ok(None)
}

/// The longest half edge of a box, and the middle one as a radius.
pub fn longest(half: Vector3<f64>) -> (Vector3<f64>, f64) {
    let axis = half.imax();
    let mut along = Vector3::zeros();
    along[axis] = half[axis];
    let others = [half[(axis + 1) % 3], half[(axis + 2) % 3]];
    (along, others[0].max(others[1]).min(half[axis]))
}
