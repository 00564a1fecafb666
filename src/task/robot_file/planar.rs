//! A mechanism in space as a planar scene, if it moves in one plane.
//!
//! The plane is across the hinges' common axis; upwards is against gravity. Positive turns are about the first hinge's axis.

use nalgebra::Vector3;

use super::spatial::{SpatialInertia, SpatialJoint, SpatialLink, SpatialModel};
use crate::error::{Error, Result};
use crate::task::body::{Body, Inertia};
use crate::task::joint::{DEFAULT_STOP_DAMPING, Joint, JointKind, JointLimits, Motor, Spring};
use crate::task::scene::{EffectTerm, JOINT_FORMAT, Scene};
use crate::task::shape::{Disc, Rectangle, Shape};

/// Largest sine of the angle between an axis and the plane's normal (hinges), or the plane (slides).
const MAX_TILT: f64 = 1e-4;
/// Radius of a link without an outline, m.
const DEFAULT_RADIUS: f64 = 0.02;

/// A scene from a robot file.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedMechanism {
    pub scene: Scene,
    /// Parts of the file that the scene does not have, one sentence each.
    pub left_out: Vec<String>,
}

/// Axes of the plane: to the right, upwards and towards the viewer.
struct Plane {
    x: Vector3<f64>,
    y: Vector3<f64>,
    normal: Vector3<f64>,
}

impl Plane {
    fn of(model: &SpatialModel) -> Result<Plane> {
        let joints = || model.links.iter().filter_map(|link| link.joint.as_ref());
        let hinge = joints().find(|joint| !joint.is_slide).map(|joint| joint.axis);
        let slide = joints().find(|joint| joint.is_slide).map(|joint| joint.axis);
        let across = |axis: Vector3<f64>| {
            let normal = axis.cross(&-model.gravity);
            if normal.norm() > 1e-9 { normal.normalize() } else { perpendicular(axis) }
        };
        let normal = hinge.or(slide.map(across)).ok_or_else(|| {
            Error::input("file", "no hinge or slide", "a mechanism with at least one hinge or slide joint")
        })?;
        let up = -model.gravity + normal * model.gravity.dot(&normal);
        let y = if up.norm() > 1e-9 { up.normalize() } else { perpendicular(normal) };
        Ok(Plane { x: y.cross(&normal), y, normal })
    }

    fn point(&self, p: Vector3<f64>) -> [f64; 2] {
        [tidy(p.dot(&self.x)), tidy(p.dot(&self.y))]
    }

    /// The sign of a joint's positions in the plane; an error if it leaves the plane.
    fn sign(&self, joint: &SpatialJoint) -> Result<f64> {
        let along = joint.axis.dot(&self.normal);
        let tilt = if joint.is_slide { along.abs() } else { joint.axis.cross(&self.normal).norm() };
        if tilt > MAX_TILT {
            let value = format!("{} leaves the plane of the first hinge", joint.name);
            return Err(Error::input("joint", value, "hinges with parallel axes, and slides across them"));
        }
        Ok(if joint.is_slide || along > 0.0 { 1.0 } else { -1.0 })
    }
}

/// A unit vector across another one.
fn perpendicular(v: Vector3<f64>) -> Vector3<f64> {
    let axis = if v.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    v.cross(&axis).normalize()
}

/// Without the rounding of rotations.
fn tidy(x: f64) -> f64 {
    let rounded = (x * 1e12).round() / 1e12;
    if rounded == 0.0 { 0.0 } else { rounded }
}

/// The planar scene of a model.
pub fn scene(model: SpatialModel) -> Result<ImportedMechanism> {
    let plane = Plane::of(&model)?;
    let mut out = Scene {
        format: JOINT_FORMAT.into(),
        name: model.name.clone(),
        gravity: plane.point(model.gravity),
        time_step: model.time_step,
        ..Scene::empty()
    };
    let mut left_out = model.left_out.clone();
    let inertias = moved_inertias(&model);
    for (i, link) in model.links.iter().enumerate() {
        let Some(joint) = &link.joint else { continue };
        let sign = plane.sign(joint)?;
        if sign < 0.0 {
            left_out.push(format!(
                "Positions and torques of {} have the opposite sign: its axis points away.",
                joint.name
            ));
        }
        if inertias[i].mass <= 0.0 {
            let allowed = "a mass of every link that moves";
            return Err(Error::input(format!("link {}", link.name), "no mass", allowed));
        }
        out.bodies.push(body(&plane, link, &inertias[i]));
        let parent = std::iter::successors(link.parent, |p| model.links[*p].parent)
            .find(|p| model.links[*p].joint.is_some())
            .map(|p| model.links[p].name.clone());
        out.joints.push(planar_joint(&plane, link, joint, parent, sign));
    }
    for motor in &model.motors {
        out.motors.push(Motor {
            joint: motor.joint.clone(),
            control: motor.control,
            stiffness: motor.stiffness,
            damping: motor.damping,
            max_torque: motor.max_torque.unwrap_or(1e6),
        });
    }
    out.validate()?;
    Ok(ImportedMechanism { scene: out, left_out })
}

/// Inertia of each link with those that are fixed to it.
fn moved_inertias(model: &SpatialModel) -> Vec<SpatialInertia> {
    let mut out: Vec<SpatialInertia> = model.links.iter().map(|link| link.inertia).collect();
    for (i, link) in model.links.iter().enumerate().rev() {
        if let (None, Some(parent)) = (&link.joint, link.parent) {
            out[parent] = out[parent].with(&out[i]);
        }
    }
    out
}

fn body(plane: &Plane, link: &SpatialLink, inertia: &SpatialInertia) -> Body {
    let (shape, angle) = match &link.outline {
        Some(outline) => {
            let [a, b] = outline.ends.map(|end| plane.point(end));
            let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
            let half = 0.5 * dx.hypot(dy);
            match half > 1e-6 {
                true => (
                    Shape::Box(Rectangle { half_width: outline.radius, half_height: half }),
                    tidy(libm::atan2(-dx, dy)),
                ),
                false => (Shape::Disc(Disc { radius: outline.radius }), 0.0),
            }
        }
        None => (Shape::Disc(Disc { radius: DEFAULT_RADIUS }), 0.0),
    };
    Body {
        name: link.name.clone(),
        shape,
        mass: Some(inertia.mass),
        density: None,
        inertia: Some(Inertia::Value(plane.normal.dot(&(inertia.tensor * plane.normal)))),
        friction: 0.5,
        restitution: 0.5,
        position: Some(plane.point(inertia.centre)),
        angle,
        velocity: [0.0; 2],
        angular_velocity: 0.0,
    }
}

fn planar_joint(
    plane: &Plane,
    link: &SpatialLink,
    joint: &SpatialJoint,
    parent: Option<String>,
    sign: f64,
) -> Joint {
    let mut effects = Vec::new();
    if joint.damping > 0.0 {
        effects.push(EffectTerm::new("viscous_friction", &[("b", joint.damping)]));
    }
    if joint.friction > 0.0 {
        effects.push(EffectTerm::new("coulomb_friction", &[("torque", joint.friction)]));
    }
    Joint {
        name: joint.name.clone(),
        kind: if joint.is_slide { JointKind::Prismatic } else { JointKind::Revolute },
        body: link.name.clone(),
        parent,
        anchor: plane.point(joint.anchor),
        axis: joint.is_slide.then(|| plane.point(joint.axis)),
        position: 0.0,
        velocity: 0.0,
        armature: joint.armature,
        limits: joint.limits.map(|[low, high]| {
            let [low, high] = if sign > 0.0 { [low, high] } else { [-high, -low] };
            JointLimits { low, high, stiffness: None, damping: DEFAULT_STOP_DAMPING }
        }),
        spring: (joint.stiffness > 0.0).then_some(Spring {
            stiffness: joint.stiffness,
            damping: 0.0,
            rest: sign * joint.rest,
        }),
        effects,
    }
}
