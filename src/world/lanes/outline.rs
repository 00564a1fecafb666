//! Outlines of bodies and statics: convex pieces in the world frame.
//!
//! Used only in scenes with bodies that are not discs. A body's pieces are transformed once per step, when an
//! object is near.

use super::simd::{Register, V, Wide};
use super::sincos::sincos;
use super::topology::Topology;
use crate::world::effect::MotionStateLanes;

/// A convex piece in every lane.
pub struct PieceOutline {
    /// Index of a body, or of a static after all bodies.
    pub owner: usize,
    /// Rounding radius, m.
    pub radius: V,
    pub core: OutlineCore,
    /// Inscribed disc of a body's piece: its centre relative to the body's centre of mass at angle 0, and
    /// its radius, m.
    pub middle: [V; 2],
    pub inner: V,
}

/// The core inside the rounding.
pub enum OutlineCore {
    /// Corners counter-clockwise, world frame, and for a body the same relative to its centre of mass at
    /// angle 0.
    Corners { here: Vec<Corner>, own: Vec<Corner> },
    /// The half plane below a line.
    Plane { nx: V, ny: V, offset: V },
}

/// A corner, m, with the outward unit normal of the edge that begins there; 0 for a single corner.
#[derive(Clone, Copy)]
pub struct Corner {
    pub x: V,
    pub y: V,
    pub nx: V,
    pub ny: V,
}

/// Data of a body that discs do not need.
#[derive(Clone)]
pub struct BodyFrame {
    /// Whether the body is a disc about its own origin; then only `inv_inertia` and its outline are used.
    pub disc: bool,
    /// 1/(kg m^2)
    pub inv_inertia: V,
    /// Bias angular velocity, rad/s.
    pub bias_omega: V,
    /// Rotation of the body in this step, rad.
    pub turned_by: V,
    /// Largest distance of a point of the body from its centre of mass, m.
    pub extent: V,
    /// Centre of mass, body frame, m.
    pub centre_x: V,
    pub centre_y: V,
    pub sine: V,
    pub cosine: V,
    /// Range of its outlines.
    pub outlines: [usize; 2],
    /// Tick of the last transformation of the outlines.
    pub turned: f64,
}

/// Frames of all bodies and outlines of all bodies and statics; empty if all bodies are discs.
pub fn of(topology: &Topology) -> (Vec<BodyFrame>, Vec<PieceOutline>) {
    let (mut frames, mut outlines) = (Vec::new(), Vec::new());
    let count = topology.bodies.len();
    if (0..count).all(|i| topology.is_disc(i)) {
        return (frames, outlines);
    }
    frames.reserve_exact(count);
    let pieces: usize = topology.bodies.iter().map(|corners| corners.len().max(1)).sum();
    outlines.reserve_exact(pieces + topology.statics.len());
    for (i, corners) in topology.bodies.iter().enumerate() {
        let (from, disc) = (outlines.len(), topology.is_disc(i));
        if disc {
            outlines.push(PieceOutline::empty(i, 1, true));
        }
        outlines.extend(corners.iter().map(|n| PieceOutline::empty(i, *n, true)));
        frames.push(BodyFrame::empty(disc, [from, outlines.len()]));
    }
    outlines.extend(topology.statics.iter().map(|(s, n)| PieceOutline::empty(count + s, *n, false)));
    (frames, outlines)
}

/// Transforms a body's outlines to its current pose, once per step.
#[inline(always)]
pub fn update_outlines<R: Register, const N: usize>(
    frame: &mut BodyFrame,
    outlines: &mut [PieceOutline],
    moving: &MotionStateLanes,
    angle: &V,
    tick: f64,
) {
    if frame.turned == tick {
        return;
    }
    frame.turned = tick;
    let (x, y) = (Wide::<R, N>::load(&moving.x), Wide::<R, N>::load(&moving.y));
    let [from, to] = frame.outlines;
    let disc = frame.disc;
    if !disc {
        frame.update_rotation::<R, N>(angle);
    }
    let (sine, cosine) = (Wide::<R, N>::load(&frame.sine), Wide::<R, N>::load(&frame.cosine));
    for outline in &mut outlines[from..to] {
        let OutlineCore::Corners { here, own } = &mut outline.core else { continue };
        if disc {
            x.store(&mut here[0].x);
            y.store(&mut here[0].y);
            continue;
        }
        for (to, from) in here.iter_mut().zip(own) {
            let (u, v) = (Wide::load(&from.x), Wide::load(&from.y));
            let (cx, cy) = (cosine * u - sine * v, sine * u + cosine * v);
            let (u, v) = (Wide::load(&from.nx), Wide::load(&from.ny));
            let (nx, ny) = (cosine * u - sine * v, sine * u + cosine * v);
            (x + cx).store(&mut to.x);
            (y + cy).store(&mut to.y);
            nx.store(&mut to.nx);
            ny.store(&mut to.ny);
        }
    }
}

impl BodyFrame {
    fn empty(disc: bool, outlines: [usize; 2]) -> BodyFrame {
        let none = V::all(0.0);
        BodyFrame {
            disc,
            inv_inertia: none,
            bias_omega: none,
            turned_by: none,
            extent: none,
            centre_x: none,
            centre_y: none,
            sine: none,
            cosine: V::all(1.0),
            outlines,
            turned: -1.0,
        }
    }

    /// Empties a lane.
    pub fn clear(&mut self, lane: usize) {
        (self.inv_inertia[lane], self.extent[lane], self.bias_omega[lane]) = (0.0, 0.0, 0.0);
        (self.centre_x[lane], self.centre_y[lane]) = (0.0, 0.0);
    }

    /// Vector from the frame's origin to the centre of mass in one lane, world frame, m.
    pub fn arm(&self, lane: usize, angle: f64) -> [f64; 2] {
        let [x, y] = [self.centre_x[lane], self.centre_y[lane]];
        if [x, y] == [0.0; 2] {
            return [0.0; 2];
        }
        let (sine, cosine) = libm::sincos(angle);
        [cosine * x - sine * y, sine * x + cosine * y]
    }

    /// Updates sine and cosine of the body's angle.
    #[inline(always)]
    pub fn update_rotation<R: Register, const N: usize>(&mut self, angle: &V) {
        let (sine, cosine): (Wide<R, N>, _) = sincos(Wide::load(angle));
        sine.store(&mut self.sine);
        cosine.store(&mut self.cosine);
    }
}

impl PieceOutline {
    /// Empty lanes of a piece with so many corners.
    pub fn empty(owner: usize, corners: usize, moves: bool) -> PieceOutline {
        let none = V::all(0.0);
        let core = match corners {
            0 => OutlineCore::Plane { nx: none, ny: none, offset: none },
            _ => {
                let corners = vec![Corner { x: none, y: none, nx: none, ny: none }; corners];
                OutlineCore::Corners { own: if moves { corners.clone() } else { Vec::new() }, here: corners }
            }
        };
        PieceOutline { owner, radius: none, core, middle: [none; 2], inner: none }
    }
}
