//! Loads outlines into lanes.

use super::super::outline::{BodyFrame, OutlineCore, PieceOutline};
use super::super::static_piece::{StaticPiece, pieces};
use crate::task::geometry::Convex;
use crate::world::compile::{BodyModel, RolloutModel};

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

impl BodyFrame {
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
}

impl PieceOutline {
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
