//! Outlines of bodies and statics: convex pieces in the world frame.
//!
//! Used only in scenes with bodies that are not discs. A body's pieces are transformed once per step, when an
//! object is near.

use super::simd::{Register, V, Wide};
use super::sincos::sincos;
use super::static_piece::{StaticPiece, pieces};
use crate::task::geometry::Convex;
use crate::world::compile::{BodyModel, RolloutModel};
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
pub fn of(model: &RolloutModel) -> (Vec<BodyFrame>, Vec<PieceOutline>) {
    let (mut frames, mut outlines) = (Vec::new(), Vec::new());
    if model.bodies.iter().all(|b| b.shape.disc_radius().is_some()) {
        return (frames, outlines);
    }
    for (i, body) in model.bodies.iter().enumerate() {
        let from = outlines.len();
        outlines.extend(body.shape.0.iter().map(|piece| PieceOutline::empty(i, piece.points.len(), true)));
        frames.push(BodyFrame::empty(body.shape.disc_radius().is_some(), [from, outlines.len()]));
    }
    let count = model.bodies.len();
    outlines.extend(pieces(model).map(|(s, piece)| PieceOutline::empty(count + s, piece.corners(), false)));
    (frames, outlines)
}

/// Loads a rollout's shapes into a lane.
pub fn fill(frames: &mut [BodyFrame], outlines: &mut [PieceOutline], lane: usize, model: &RolloutModel) {
    for (frame, body) in frames.iter_mut().zip(&model.bodies) {
        fill_body(frame, outlines, lane, body);
    }
    fill_statics(frames, outlines, lane, model);
}

/// Loads a body's shape into a lane.
pub fn fill_body(frame: &mut BodyFrame, outlines: &mut [PieceOutline], lane: usize, body: &BodyModel) {
    frame.fill(lane, body);
    let [from, to] = frame.outlines;
    for (outline, piece) in outlines[from..to].iter_mut().zip(&body.shape.0) {
        let about_centre = piece.points.iter().map(|p| [p[0] - body.centre[0], p[1] - body.centre[1]]);
        outline.fill(lane, &Convex { points: about_centre.collect(), radius: piece.radius });
    }
}

/// Loads the shapes of all statics into a lane.
fn fill_statics(frames: &[BodyFrame], outlines: &mut [PieceOutline], lane: usize, model: &RolloutModel) {
    let fixed = frames.last().map_or(0, |f| f.outlines[1]);
    for (outline, (_, piece)) in outlines[fixed..].iter_mut().zip(pieces(model)) {
        outline.radius[lane] = 0.0;
        match (piece, &mut outline.core) {
            (StaticPiece::HalfPlane { normal, offset: own }, OutlineCore::Plane { nx, ny, offset }) => {
                (nx[lane], ny[lane], offset[lane]) = (normal[0], normal[1], own);
            }
            (StaticPiece::Convex(piece), _) => outline.fill(lane, piece),
            // Lanes of a batch have one topology: see `topology`.
            (StaticPiece::HalfPlane { .. }, _) => {
                unreachable!("rollouts of one batch have the same topology")
            }
        }
    }
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

    fn fill(&mut self, lane: usize, body: &BodyModel) {
        let reach = |piece: &Convex| {
            let far = |p: &[f64; 2]| libm::hypot(p[0] - body.centre[0], p[1] - body.centre[1]);
            piece.points.iter().map(far).fold(0.0, f64::max) + piece.radius
        };
        self.inv_inertia[lane] = 1.0 / body.inertia;
        self.bias_omega[lane] = 0.0;
        self.extent[lane] = if self.disc { 0.0 } else { body.shape.0.iter().map(reach).fold(0.0, f64::max) };
        (self.centre_x[lane], self.centre_y[lane]) = (body.centre[0], body.centre[1]);
        self.turned = -1.0;
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
    fn empty(owner: usize, corners: usize, moves: bool) -> PieceOutline {
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

    /// Pieces of a body are loaded relative to its centre of mass, those of a static at their position.
    fn fill(&mut self, lane: usize, piece: &Convex) {
        self.radius[lane] = piece.radius;
        let (middle, inner) = disc_within(piece);
        (self.middle[0][lane], self.middle[1][lane], self.inner[lane]) = (middle[0], middle[1], inner);
        let OutlineCore::Corners { here, own } = &mut self.core else { return };
        let n = piece.points.len();
        for (i, corner) in if own.is_empty() { here } else { own }.iter_mut().enumerate() {
            let (p, q) = (piece.points[i], piece.points[(i + 1) % n]);
            (corner.x[lane], corner.y[lane]) = (p[0], p[1]);
            let (dx, dy) = (q[0] - p[0], q[1] - p[1]);
            let length = (dx * dx + dy * dy).sqrt();
            let normal = if length > 0.0 { [dy / length, -dx / length] } else { [0.0; 2] };
            (corner.nx[lane], corner.ny[lane]) = (normal[0], normal[1]);
        }
    }
}

/// Centre and radius, m, of a disc inside a piece: about the mean of its corners, up to the nearest edge.
pub fn disc_within(piece: &Convex) -> ([f64; 2], f64) {
    let n = piece.points.len();
    let middle = [0, 1].map(|k| piece.points.iter().map(|p| p[k]).sum::<f64>() / n as f64);
    if n < 3 {
        return (middle, piece.radius);
    }
    let height = |i: usize| {
        let (p, q) = (piece.points[i], piece.points[(i + 1) % n]);
        let (dx, dy) = (q[0] - p[0], q[1] - p[1]);
        (dx * (middle[1] - p[1]) - dy * (middle[0] - p[0])) / (dx * dx + dy * dy).sqrt()
    };
    (middle, piece.radius + (0..n).map(height).fold(f64::INFINITY, f64::min).max(0.0))
}

/// The outline of a single piece in every lane.
#[cfg(test)]
pub fn single(piece: &Convex) -> PieceOutline {
    let mut outline = PieceOutline::empty(0, piece.points.len(), false);
    (0..crate::world::effect::LANES).for_each(|lane| outline.fill(lane, piece));
    outline
}
