//! A scene's joints as a tree of links.

use crate::error::{Error, Result};
use crate::task::Scene;
use crate::task::joint::{Joint, JointKind, JointLimits, Motor, Spring};

/// A tree of links, parents first. All frames have the world's directions in the scene's configuration.
#[derive(Clone, Debug)]
pub struct Tree {
    /// Names of the joints.
    pub names: Vec<String>,
    pub kinds: Vec<JointKind>,
    /// Index of the link that each hangs on; the world if `None`.
    pub parents: Vec<Option<usize>>,
    pub links: Vec<Link>,
    pub motors: Vec<Option<Motor>>,
    pub springs: Vec<Option<Spring>>,
    pub stops: Vec<Option<JointStop>>,
    /// m/s^2
    pub gravity: [f64; 2],
    /// s
    pub time_step: f64,
    /// Initial positions and velocities of the joints.
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
}

/// Stops of a joint: see [`JointLimits`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointStop {
    /// rad
    pub low: f64,
    pub high: f64,
    /// N m/rad
    pub stiffness: f64,
    /// s/rad
    pub damping: f64,
}

/// Phase of all that hangs on a joint, as one rigid body on a stop of default stiffness, in a time step, rad.
const STOP_PHASE: f64 = 0.2;

impl JointStop {
    /// The stop of joint `j` of links with these joints and parents.
    fn new(
        limits: &JointLimits,
        j: usize,
        joints: &[&Joint],
        parents: &[Option<usize>],
        links: &[Link],
        time_step: f64,
    ) -> JointStop {
        let hangs_on = |k: usize| std::iter::successors(Some(k), |k| parents[*k]).any(|k| k == j);
        let inertia = |k: usize| {
            let link = &links[k];
            let [x, y] = [0, 1].map(|i| joints[k].anchor[i] + link.centre[i] - joints[j].anchor[i]);
            match joints[j].kind {
                JointKind::Revolute => link.inertia + link.mass * (x * x + y * y),
                JointKind::Prismatic => link.mass,
            }
        };
        let whole = (0..links.len()).filter(|k| hangs_on(*k)).map(inertia).sum::<f64>() + links[j].armature;
        let JointLimits { low, high, stiffness, damping } = *limits;
        let stiffness = stiffness.unwrap_or(whole * (STOP_PHASE / time_step).powi(2));
        JointStop { low, high, stiffness, damping }
    }
}

/// Geometry and inertia of a link. Its frame has its origin in its joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// Joint in the parent's frame at position 0, m.
    pub offset: [f64; 2],
    /// Direction of a prismatic joint in the parent's frame; 0 for a revolute joint.
    pub axis: [f64; 2],
    /// Centre of mass and the point that is farthest from the joint, m.
    pub centre: [f64; 2],
    pub tip: [f64; 2],
    /// kg
    pub mass: f64,
    /// About the centre of mass, kg m^2.
    pub inertia: f64,
    /// Inertia of what moves with the joint alone: kg m^2, or kg.
    pub armature: f64,
}

impl Tree {
    /// The tree of a valid scene; an error if a body hangs on no joint, or if there are statics.
    pub fn of(scene: &Scene) -> Result<Tree> {
        if let Some(free) = scene.bodies.iter().position(|b| !scene.joints.iter().any(|j| j.body == b.name)) {
            let value = format!("{:?} hangs on no joint", scene.bodies[free].name);
            return Err(Error::input(format!("bodies[{free}]"), value, "bodies that hang on joints"));
        }
        if !scene.statics.is_empty() {
            let allowed = "no statics: mechanisms are simulated without contacts";
            return Err(Error::input("statics", format!("{} statics", scene.statics.len()), allowed));
        }
        let ordered = parents_first(&scene.joints);
        let index = |body: &String| ordered.iter().position(|j| j.body == *body);
        let anchor = |parent: Option<usize>| parent.map_or([0.0; 2], |p| ordered[p].anchor);
        let parents: Vec<Option<usize>> = ordered.iter().map(|j| j.parent.as_ref().and_then(index)).collect();
        let links = ordered.iter().zip(&parents).map(|(joint, parent)| link(scene, joint, anchor(*parent)));
        let links = links.collect::<Result<Vec<Link>>>()?;
        let stop = |(j, joint): (usize, &&Joint)| {
            let limits = joint.limits.as_ref()?;
            Some(JointStop::new(limits, j, &ordered, &parents, &links, scene.time_step))
        };
        Ok(Tree {
            stops: ordered.iter().enumerate().map(stop).collect(),
            links,
            names: ordered.iter().map(|j| j.name.clone()).collect(),
            kinds: ordered.iter().map(|j| j.kind).collect(),
            motors: ordered
                .iter()
                .map(|j| scene.motors.iter().find(|m| m.joint == j.name).cloned())
                .collect(),
            springs: ordered.iter().map(|j| j.spring).collect(),
            parents,
            gravity: scene.gravity,
            time_step: scene.time_step,
            position: ordered.iter().map(|j| j.position).collect(),
            velocity: ordered.iter().map(|j| j.velocity).collect(),
        })
    }

    /// Origin (m) and angle (rad) of each link's frame at joint positions.
    pub fn frames(&self, q: &[f64]) -> Vec<([f64; 2], f64)> {
        let mut out: Vec<([f64; 2], f64)> = Vec::with_capacity(self.links.len());
        for (j, link) in self.links.iter().enumerate() {
            let (origin, angle) = self.parents[j].map_or(([0.0; 2], 0.0), |p| out[p]);
            let (along, turn) = match self.kinds[j] {
                JointKind::Revolute => (0.0, q[j]),
                JointKind::Prismatic => (q[j], 0.0),
            };
            let [x, y] = [0, 1].map(|k| link.offset[k] + along * link.axis[k]);
            let (sin, cos) = libm::sincos(angle);
            out.push(([origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y], angle + turn));
        }
        out
    }

    /// The scene with its bodies where joint positions put them.
    pub fn posed(&self, scene: &Scene, q: &[f64]) -> Scene {
        let mut out = scene.clone();
        for ((origin, angle), name) in self.frames(q).into_iter().zip(&self.names) {
            let Some(joint) = scene.joints.iter().find(|joint| joint.name == *name) else { continue };
            let Some(body) = out.bodies.iter_mut().find(|body| body.name == joint.body) else { continue };
            let (sin, cos) = libm::sincos(angle);
            body.position = body.position.map(|[x, y]| {
                let [x, y] = [x - joint.anchor[0], y - joint.anchor[1]];
                [origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y]
            });
            body.angle += angle;
        }
        out
    }

    /// A box that the mechanism does not leave, with some room for joints that slide on the world: [left, bottom, right, top], m.
    pub fn reach(&self) -> [f64; 4] {
        const SLIDE: f64 = 2.4;
        let mut radii: Vec<f64> = Vec::with_capacity(self.links.len());
        let mut bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for (j, link) in self.links.iter().enumerate() {
            let tip = link.tip[0].hypot(link.tip[1]);
            let own = match self.parents[j] {
                Some(parent) => radii[parent] + link.offset[0].hypot(link.offset[1]),
                None => 0.0,
            };
            radii.push(own);
            let root = std::iter::successors(Some(j), |j| self.parents[*j]).last().unwrap_or(j);
            let base = &self.links[root];
            for k in 0..2 {
                let room = own + tip + SLIDE * base.axis[k].abs();
                bounds[k] = bounds[k].min(base.offset[k] - room);
                bounds[k + 2] = bounds[k + 2].max(base.offset[k] + room);
            }
        }
        bounds
    }

    /// Index of the joint named `name`.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }
}

/// The joints, each after the joint of its parent.
fn parents_first(joints: &[Joint]) -> Vec<&Joint> {
    let mut ordered: Vec<&Joint> = Vec::new();
    while ordered.len() < joints.len() {
        let known =
            |joint: &&Joint| joint.parent.as_ref().is_none_or(|p| ordered.iter().any(|j| j.body == *p));
        let next = joints.iter().filter(|j| !ordered.iter().any(|o| o.name == j.name)).find(known);
        // A parent without a joint is reported by `Tree::of`; validation has excluded cycles.
        let Some(next) = next else { break };
        ordered.push(next);
    }
    ordered
}

/// The link of a joint; `parent`: anchor of its parent's joint, m.
fn link(scene: &Scene, joint: &Joint, parent: [f64; 2]) -> Result<Link> {
    let missing = || Error::input("joints", joint.body.as_str(), "bodies with a position");
    let body = scene.body(&joint.body).ok_or_else(missing)?;
    let (mass, inertia) = body.mass_properties(None);
    let solid = body.placed().ok_or_else(missing)?;
    let from_joint = |[x, y]: [f64; 2]| [x - joint.anchor[0], y - joint.anchor[1]];
    let position = body.position.ok_or_else(missing)?;
    let [cx, cy] = body.shape.moments().centre;
    let (sin, cos) = libm::sincos(body.angle);
    let centre = from_joint([position[0] + cos * cx - sin * cy, position[1] + sin * cx + cos * cy]);
    let corners = solid.0.iter().flat_map(|piece| &piece.points).map(|p| from_joint(*p));
    let tip = corners.max_by(|a, b| a[0].hypot(a[1]).total_cmp(&b[0].hypot(b[1]))).unwrap_or(centre);
    let unit = |[x, y]: [f64; 2]| [x / x.hypot(y), y / x.hypot(y)];
    Ok(Link {
        offset: [joint.anchor[0] - parent[0], joint.anchor[1] - parent[1]],
        axis: joint.axis.map_or([0.0; 2], unit),
        centre,
        tip,
        mass,
        inertia,
        armature: joint.armature,
    })
}
