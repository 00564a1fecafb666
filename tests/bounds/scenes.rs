//! Scenes of the largest geometric complexity.

use iplw::task::Scene;
use iplw::task::scene::{Body, Static};

/// A shape of `pieces` polygons of `corners` corners each, about 1 m wide; discs of one corner.
fn shape(pieces: usize, corners: usize) -> serde_json::Value {
    let piece = |k: usize| {
        let at = |i: usize| {
            let angle = std::f64::consts::TAU * (i as f64) / corners as f64;
            [0.5 * angle.cos(), 0.5 * angle.sin()]
        };
        let position = [1e-3 * k as f64, 0.0];
        match corners {
            1 => serde_json::json!({"type": "disc", "radius": 0.5, "position": position}),
            _ => serde_json::json!({
                "type": "polygon", "vertices": (0..corners).map(at).collect::<Vec<_>>(), "position": position}),
        }
    };
    match pieces {
        1 => {
            let mut one = piece(0);
            one.as_object_mut().unwrap().remove("position");
            one
        }
        _ => serde_json::json!({"type": "compound", "pieces": (0..pieces).map(piece).collect::<Vec<_>>()}),
    }
}

/// Objects of a scene: their number, their pieces and the corners of each piece.
pub type Objects = [usize; 3];

/// Bodies and statics in a row, `spacing` m apart; the statics are 0.97 m below.
pub fn row(bodies: Objects, statics: Objects, spacing: f64) -> Scene {
    let mut scene = Scene::empty();
    let [count, pieces, corners] = bodies;
    scene.bodies = (0..count)
        .map(|i| {
            let json = serde_json::json!({"name": format!("b{i}"), "shape": shape(pieces, corners),
                "position": [spacing * i as f64, 0.0]});
            serde_json::from_value::<Body>(json).unwrap()
        })
        .collect();
    let [count, pieces, corners] = statics;
    scene.statics = (0..count)
        .map(|i| {
            let json = serde_json::json!({"name": format!("s{i}"), "shape": shape(pieces, corners),
                "position": [spacing * i as f64, -0.97]});
            serde_json::from_value::<Static>(json).unwrap()
        })
        .collect();
    scene.steps = 20;
    scene
}
