//! Links in space, as robot files describe them, in the world's axes and in the configuration of the file.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use crate::task::joint::Control;

/// A mechanism in space.
#[derive(Default)]
pub struct SpatialModel {
    pub name: String,
    /// Parents first.
    pub links: Vec<SpatialLink>,
    pub motors: Vec<SpatialMotor>,
    /// m/s^2
    pub gravity: Vector3<f64>,
    /// s
    pub time_step: f64,
    pub left_out: Vec<String>,
}

/// A link; without a joint it is fixed to its parent.
pub struct SpatialLink {
    pub name: String,
    /// The world if `None`.
    pub parent: Option<usize>,
    pub joint: Option<SpatialJoint>,
    pub inertia: SpatialInertia,
    /// A line with a thickness, for pictures.
    pub outline: Option<LinkOutline>,
}

/// Mass (kg), centre of mass (m) and inertia about it (kg m^2).
#[derive(Clone, Copy)]
pub struct SpatialInertia {
    pub mass: f64,
    pub centre: Vector3<f64>,
    pub tensor: Matrix3<f64>,
}

/// Ends (m) and radius (m) of a link's outline.
#[derive(Clone, Copy)]
pub struct LinkOutline {
    pub ends: [Vector3<f64>; 2],
    pub radius: f64,
}

/// A hinge or slide.
pub struct SpatialJoint {
    pub name: String,
    pub is_slide: bool,
    /// m
    pub anchor: Vector3<f64>,
    /// Of unit length.
    pub axis: Vector3<f64>,
    /// Viscous and dry friction.
    pub damping: f64,
    pub friction: f64,
    pub armature: f64,
    pub stiffness: f64,
    pub rest: f64,
    /// Lowest and highest position, rad or m.
    pub limits: Option<[f64; 2]>,
}

/// A motor on a joint.
pub struct SpatialMotor {
    pub joint: String,
    pub control: Control,
    pub stiffness: f64,
    pub damping: f64,
    pub max_torque: Option<f64>,
}

impl SpatialInertia {
    pub fn none() -> SpatialInertia {
        SpatialInertia { mass: 0.0, centre: Vector3::zeros(), tensor: Matrix3::zeros() }
    }

    /// Both together.
    pub fn with(&self, other: &SpatialInertia) -> SpatialInertia {
        let mass = self.mass + other.mass;
        if mass <= 0.0 {
            return *self;
        }
        let centre = (self.centre * self.mass + other.centre * other.mass) / mass;
        let about = |part: &SpatialInertia| {
            let off = part.centre - centre;
            part.tensor + (Matrix3::identity() * off.norm_squared() - off * off.transpose()) * part.mass
        };
        SpatialInertia { mass, centre, tensor: about(self) + about(other) }
    }
}

/// A solid of uniform density in its own axes: volume (m^3), and inertia by mass about its centre (m^2).
pub struct SolidMoments {
    pub volume: f64,
    pub by_mass: Vector3<f64>,
}

impl SolidMoments {
    pub fn sphere(r: f64) -> SolidMoments {
        SolidMoments { volume: 4.0 / 3.0 * PI * r * r * r, by_mass: Vector3::repeat(0.4 * r * r) }
    }

    /// Half the edges.
    pub fn cuboid(half: Vector3<f64>) -> SolidMoments {
        let square = half.component_mul(&half) / 3.0;
        let by_mass = Vector3::new(square.y + square.z, square.x + square.z, square.x + square.y);
        SolidMoments { volume: 8.0 * half.x * half.y * half.z, by_mass }
    }

    /// Along z.
    pub fn cylinder(r: f64, length: f64) -> SolidMoments {
        let across = 0.25 * r * r + length * length / 12.0;
        SolidMoments { volume: PI * r * r * length, by_mass: Vector3::new(across, across, 0.5 * r * r) }
    }

    /// A cylinder along z with half a sphere at each end.
    pub fn capsule(r: f64, length: f64) -> SolidMoments {
        let (tube, ball) = (SolidMoments::cylinder(r, length), SolidMoments::sphere(r));
        let volume = tube.volume + ball.volume;
        let ends = 0.4 * r * r + 0.25 * length * length + 0.375 * length * r;
        let ends = Vector3::new(ends, ends, 0.4 * r * r);
        SolidMoments { by_mass: (tube.by_mass * tube.volume + ends * ball.volume) / volume, volume }
    }
}
