//! Compound shapes: several convex shapes that make one rigid object.
//!
//! The mass of overlapping pieces counts twice, as in Box2D and Pymunk.

use serde::{Deserialize, Serialize};

use super::rectangle::Rectangle;
use super::shape_geometry::{Moments, ShapeGeometry};
use crate::error::{Error, Result, check_range};
use crate::task::limits::{MAX_LENGTH_M, check_vector};
use crate::task::solid::{ConvexPieces, Solid};

/// Several convex shapes that make one rigid object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Compound<S> {
    /// At least one.
    pub pieces: Vec<CompoundPiece<S>>,
}

/// A convex shape at a pose in the compound's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompoundPiece<S> {
    /// Convex and bounded.
    #[serde(flatten)]
    pub shape: S,
    /// m
    #[serde(default)]
    pub position: [f64; 2],
    /// rad
    #[serde(default)]
    pub angle: f64,
}

/// Maximum number of pieces: engines visit each pair of pieces of two objects.
const MAX_PIECES: usize = 32;

impl<S: AsRef<dyn ShapeGeometry>> CompoundPiece<S> {
    fn validate(&self, movable: bool) -> Result<()> {
        check_vector("position", self.position, MAX_LENGTH_M)?;
        check_range("angle", self.angle, -1e6, 1e6)?;
        let shape = self.shape.as_ref();
        shape.validate(movable)?;
        match shape.solid() {
            Solid::Bounded(ConvexPieces(pieces)) if pieces.len() == 1 => Ok(()),
            _ => Err(Error::input("type", "not a single bounded piece", "a bounded convex shape")),
        }
    }

    fn moments(&self) -> Moments {
        let own = self.shape.as_ref().moments();
        let (sin, cos) = libm::sincos(self.angle);
        let ([x, y], [dx, dy]) = (own.centre, self.position);
        Moments { centre: [dx + cos * x - sin * y, dy + sin * x + cos * y], ..own }
    }
}

impl<S: AsRef<dyn ShapeGeometry> + From<Rectangle>> ShapeGeometry for Compound<S> {
    fn validate(&self, movable: bool) -> Result<()> {
        let n = self.pieces.len();
        if !(1..=MAX_PIECES).contains(&n) {
            return Err(Error::input("pieces", format!("{n} pieces"), format!("1 to {MAX_PIECES} pieces")));
        }
        let mut pieces = self.pieces.iter().enumerate();
        pieces.try_for_each(|(i, p)| p.validate(movable).map_err(|e| e.in_field(&format!("pieces[{i}]"))))
    }

    fn corner_count(&self) -> usize {
        self.pieces.iter().map(|p| p.shape.as_ref().corner_count()).sum()
    }

    fn solid(&self) -> Solid {
        let bounded = |p: &CompoundPiece<S>| match p.shape.as_ref().solid().placed(p.position, p.angle) {
            Solid::Bounded(ConvexPieces(pieces)) => pieces,
            Solid::HalfPlane { .. } => Vec::new(),
        };
        Solid::Bounded(ConvexPieces(self.pieces.iter().flat_map(bounded).collect()))
    }

    /// Parallel-axis theorem over the pieces.
    fn moments(&self) -> Moments {
        let parts: Vec<Moments> = self.pieces.iter().map(CompoundPiece::moments).collect();
        let area: f64 = parts.iter().map(|p| p.area).sum();
        let centre: [f64; 2] = [0, 1].map(|k| parts.iter().map(|p| p.area * p.centre[k]).sum::<f64>() / area);
        let about = |p: &Moments| {
            let away = (p.centre[0] - centre[0]).powi(2) + (p.centre[1] - centre[1]).powi(2);
            p.area * (p.second + away)
        };
        Moments { area, centre, second: parts.iter().map(about).sum::<f64>() / area }
    }

    /// An L of a horizontal and a vertical box, the latter rotated.
    fn sample() -> Compound<S> {
        let piece = |half_width, half_height, position, angle| CompoundPiece {
            shape: Rectangle { half_width, half_height }.into(),
            position,
            angle,
        };
        let turned = std::f64::consts::FRAC_PI_2;
        Compound { pieces: vec![piece(0.6, 0.1, [0.0, -0.3], 0.0), piece(0.3, 0.1, [0.5, 0.1], turned)] }
    }
}

#[cfg(test)]
mod tests {
    use crate::task::scene::Shape;

    #[test]
    fn parses_pieces_and_rejects_invalid_ones_by_path() {
        let check = |pieces: &str, wanted: std::result::Result<usize, &str>| {
            let json = format!(r#"{{"type": "compound", "pieces": [{pieces}]}}"#);
            let said = serde_json::from_str::<Shape>(&json).map_err(|e| e.to_string()).and_then(|shape| {
                shape.validate(true).map_err(|e| e.to_string())?;
                Ok(shape.pieces().map_or(0, |p| p.0.len()))
            });
            match (said, wanted) {
                (Ok(count), Ok(wanted)) => assert_eq!(count, wanted),
                (Err(said), Err(wanted)) => assert!(said.contains(wanted), "{said}"),
                (said, wanted) => panic!("{pieces}: {said:?}, not {wanted:?}"),
            }
        };
        let disc = r#"{"type": "disc", "radius": 1}"#;
        check(&format!(r#"{disc}, {{"type": "disc", "radius": 1, "position": [1, 2], "angle": 3}}"#), Ok(2));
        check("", Err("1 to 32 pieces"));
        check(&format!(r#"{disc}, {{"type": "disc", "radius": -1}}"#), Err("`shape.pieces[1].radius`"));
        check(r#"{"type": "disc", "radius": 1, "odd": 2}"#, Err("odd"));
        check(r#"{"type": "halfspace", "normal": [0, 1], "offset": 0}"#, Err("`shape.pieces[0].type`"));
        check(
            &format!(r#"{{"type": "compound", "pieces": [{disc}, {disc}]}}"#),
            Err("a bounded convex shape"),
        );
    }
}
