//! The visible part of the world of a picture.

use crate::task::Scene;
use crate::task::geometry::{Aabb, union_box};
use crate::task::scene::Goal;
use crate::task::solid::Solid;
use crate::trajectory::Trajectory;

/// The visible part of the world, and its mapping to the picture.
#[derive(Clone, Debug)]
pub struct Viewport {
    /// Visible box in the world, m.
    pub bounds: Aabb,
    /// px
    pub width: f64,
    /// px
    pub height: f64,
    /// px per m
    pub scale: f64,
}

/// Maximal ratio of height to width; the maximal ratio of width to height is twice this.
const MAX_ASPECT_RATIO: f64 = 1.6;
/// Maximal extension of the viewport for statics, on every side, relative to the size of the moving part; larger statics are cut off.
const MAX_STATIC_EXTENSION: f64 = 0.75;

impl Viewport {
    /// A viewport `width` px wide of bodies, goal, action bounds, all positions of `film`, and the statics unless they are much
    /// larger.
    pub fn new(scene: &Scene, film: Option<&Trajectory>, width: f64) -> Viewport {
        let mut b = content_bounds(scene, film);
        let size = (b[2] - b[0]).max(b[3] - b[1]);
        let reach = MAX_STATIC_EXTENSION * size;
        let (low, high) = ([b[0] - reach, b[1] - reach], [b[2] + reach, b[3] + reach]);
        let within = |p: [f64; 2]| (0..2).all(|k| (low[k]..=high[k]).contains(&p[k]));
        let moving = b;
        let centre = [(moving[0] + moving[2]) / 2.0, (moving[1] + moving[3]) / 2.0];
        for fixed in &scene.statics {
            match fixed.placed() {
                Solid::Bounded(pieces) => {
                    let s = pieces.bounds();
                    let p = [centre[0].clamp(s[0], s[2]), centre[1].clamp(s[1], s[3])];
                    if within([s[0], s[1]]) && within([s[2], s[3]]) {
                        b = union_box(b, s);
                    } else if within(p) {
                        b = union_box(b, [p[0], p[1], p[0], p[1]]);
                    }
                }
                Solid::HalfPlane { normal, offset } => {
                    let p = nearest_on_line(normal, offset, [centre[0], moving[1]]);
                    if within(p) {
                        b = union_box(b, [p[0], p[1], p[0], p[1]]);
                    }
                }
            }
        }
        let (mut w, mut h) = ((b[2] - b[0]).max(1e-9), (b[3] - b[1]).max(1e-9));
        let pad = 0.03 * w.max(h);
        (w, h) = (w + 2.0 * pad, h + 2.0 * pad);
        let (w, h) = (w.max(h / MAX_ASPECT_RATIO), h.max(w / (2.0 * MAX_ASPECT_RATIO)));
        let centre = [(b[0] + b[2]) / 2.0, (b[1] + b[3]) / 2.0];
        let bounds = [centre[0] - w / 2.0, centre[1] - h / 2.0, centre[0] + w / 2.0, centre[1] + h / 2.0];
        let scale = width / w;
        Viewport { bounds, width, height: (h * scale).round().max(1.0), scale }
    }

    /// A viewport `width` px wide of a box in the world.
    pub fn of_box(bounds: Aabb, width: f64) -> Viewport {
        let scale = width / (bounds[2] - bounds[0]);
        Viewport { bounds, width, height: ((bounds[3] - bounds[1]) * scale).round().max(1.0), scale }
    }

    /// Maps a point of the world to px.
    pub fn at(&self, p: [f64; 2]) -> [f64; 2] {
        [(p[0] - self.bounds[0]) * self.scale, (self.bounds[3] - p[1]) * self.scale]
    }

    /// Line width that corresponds to `share` px in a picture 640 px wide, px.
    pub fn pen(&self, share: f64) -> f64 {
        share * (self.width / 640.0).clamp(0.55, 3.0)
    }

    /// The visible part of a half plane, px.
    pub fn half_plane(&self, normal: [f64; 2], offset: f64) -> Vec<[f64; 2]> {
        let above = |p: [f64; 2]| normal[0] * p[0] + normal[1] * p[1] - offset;
        // Slightly larger than the picture, so that only the surface has an outline.
        let pad = 0.02 * (self.bounds[2] - self.bounds[0]);
        let b = self.bounds;
        let corners = [
            [b[0] - pad, b[1] - pad],
            [b[2] + pad, b[1] - pad],
            [b[2] + pad, b[3] + pad],
            [b[0] - pad, b[3] + pad],
        ];
        let mut seen = Vec::new();
        for i in 0..4 {
            let (p, q) = (corners[i], corners[(i + 1) % 4]);
            let (dp, dq) = (above(p), above(q));
            if dp <= 0.0 {
                seen.push(self.at(p));
            }
            if (dp < 0.0) != (dq < 0.0) && dp != dq {
                let t = dp / (dp - dq);
                seen.push(self.at([p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]));
            }
        }
        seen
    }
}

fn nearest_on_line(normal: [f64; 2], offset: f64, p: [f64; 2]) -> [f64; 2] {
    let above = normal[0] * p[0] + normal[1] * p[1] - offset;
    [p[0] - above * normal[0], p[1] - above * normal[1]]
}

/// Bounding box of bodies, goal, action bounds and all positions of `film`, m.
fn content_bounds(scene: &Scene, film: Option<&Trajectory>) -> Aabb {
    let mut found: Option<Aabb> = scene.action.as_ref().and_then(|a| a.bounds);
    let mut add = |s: Aabb| {
        if s.iter().all(|v| v.is_finite()) {
            found = Some(found.map_or(s, |b| union_box(b, s)));
        }
    };
    for b in &scene.bodies {
        let Some(pieces) = b.shape.pieces() else { continue };
        if let Some(placed) = b.placed() {
            add(placed.bounds());
        }
        if let Some(track) = film.and_then(|f| f.track(&b.name)) {
            let r = pieces.bounds();
            let reach = r.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            for (x, y) in track.x.iter().zip(&track.y) {
                add([x - reach, y - reach, x + reach, y + reach]);
            }
        }
    }
    if let Some(Goal::Inside { region, .. }) = &scene.goal {
        region.iter().for_each(|p| add([p[0], p[1], p[0], p[1]]));
    }
    if let Some(goal) = &scene.goal
        && let Some(([nx, ny], offset)) = goal.line()
    {
        // The line at the body's x.
        let body = goal.names().first().and_then(|name| scene.body(name));
        let x = body.and_then(|b| b.position).map_or(0.0, |p| p[0]);
        let y = (offset - nx * x) / ny;
        add([x, y, x, y]);
    }
    found.unwrap_or_else(|| scene.extent())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::scene::tests::hall;
    use crate::task::families;

    #[test]
    fn viewport_ignores_the_length_of_floors() {
        let with_floor = |half: f64| {
            let mut s = hall();
            s.statics.truncate(0);
            let text = format!(
                r#"{{"name": "f", "shape": {{"type": "segment", "from": [-{half}, 0], "to": [{half}, 0]}}}}"#
            );
            s.statics.push(serde_json::from_str(&text).unwrap());
            Viewport::new(&s, None, 400.0)
        };
        let view = with_floor(1e4);
        assert!(view.bounds[2] - view.bounds[0] < 20.0 && view.bounds[1] < 0.0, "{view:?}");
        // A wall of usual size is visible as a whole.
        let walled = Viewport::new(&families()[0].candidates(0).next().unwrap(), None, 400.0);
        assert!(walled.bounds[0] < -0.8 && walled.bounds[2] > 43.4, "{walled:?}");
    }
}
