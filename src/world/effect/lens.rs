//! Lens distortion: measured positions are moved away from the image centre by k times the cube of their distance.
//!
//! Source: the first radial term of Brown's model (Hartley and Zisserman, Multiple View Geometry, section 7.4); k < 0 is barrel
//! distortion, as of wide-angle lenses.
//!
//! Differences from the source: the centre is given in the scene's coordinates.

use super::{
    Constants, Effect, EffectKind, Measurement, SearchStrategy, Sensor, ShapeParameter, amplitude, effect,
    parameter, shape,
};

/// The effect's row in the registry.
pub static EFFECT: Effect = Effect {
    name: "lens",
    summary: "Lens distortion: the picture bulges towards its edges.",
    signature: "Straight lines are bent near the edges of the picture, for every motion alike and at rest; the centre is unchanged. \
        The diagnosis does not name it: distortion of a few thousandths belongs to every recording, and is part of the discrepancy \
        that all trials share.",
    equation: "measured = centre + (1 + k r^2) (true - centre), r = |true - centre|, centre = (x, y)",
    parameters: &[
        parameter("k", "1/m^2", [-10.0, 10.0], amplitude(0.01, 0.01, 1e-4)),
        parameter("x", "m", [-1e5, 1e5], shape(ShapeParameter::Place, 10.0, 0.03)),
        parameter("y", "m", [-1e5, 1e5], shape(ShapeParameter::Place, 10.0, 0.03)),
    ],
    instrument_check: Some("photograph a chessboard"),
    search: SearchStrategy::Excluded,
    ..effect(EffectKind::Sensor(&Lens))
};

struct Lens;

impl Sensor for Lens {
    fn measure(&self, constants: &Constants, state: Measurement) -> Measurement {
        let [k, cx, cy] = [constants[0], constants[1], constants[2]];
        let (x, y) = (state.x - cx, state.y - cy);
        let scale = 1.0 + k * (x * x + y * y);
        let turned = 2.0 * k * (x * state.vx + y * state.vy);
        Measurement {
            x: cx + scale * x,
            y: cy + scale * y,
            vx: scale * state.vx + turned * x,
            vy: scale * state.vy + turned * y,
            ..state
        }
    }
}
