//! A scene as SVG: y upwards, one scale for both axes, bodies in colour, statics in grey.

use std::fmt::Write;

use super::svg::{colour, darker, escape, is_light, points, px};
use super::theme::light;
use super::viewport::Viewport;
use crate::task::geometry::{Aabb, Convex};
use crate::task::scene::Goal;
use crate::task::solid::Solid;
use crate::task::{Scene, scene::Body};

/// How pictures of scenes look.
#[derive(Clone, Debug, PartialEq)]
pub struct Style {
    /// Width of the picture, px; clamped to 16 to 4096.
    pub width: u32,
    /// Writes each body's name beside it (text is not drawn in PNG).
    pub names: bool,
    /// Maximal number of frames of a filmstrip; clamped to 1 to 64.
    pub frames: usize,
}

impl Default for Style {
    fn default() -> Self {
        Style { width: 640, names: false, frames: 8 }
    }
}

impl Style {
    pub(super) fn width_px(&self) -> f64 {
        f64::from(self.width.clamp(16, 4096))
    }
}

/// Draws a scene; bodies without a position are left out.
pub fn scene_svg(scene: &Scene, style: &Style) -> String {
    let (view, body) = scene_elements(scene, style);
    document(view.width, view.height, &title(scene), &body)
}

/// Draws the part of a scene in a box: [left, bottom, right, top], m.
pub fn scene_svg_within(scene: &Scene, bounds: Aabb, style: &Style) -> String {
    let view = Viewport::of_box(bounds, style.width_px());
    let mut body = String::new();
    draw_statics(&mut body, scene, &view);
    draw_bodies(&mut body, scene, &view);
    document(view.width, view.height, &title(scene), &body)
}

/// The viewport of [`scene_svg`], and its SVG elements.
pub(super) fn scene_elements(scene: &Scene, style: &Style) -> (Viewport, String) {
    let view = Viewport::new(scene, None, style.width_px());
    let mut body = String::new();
    draw_statics(&mut body, scene, &view);
    draw_bodies(&mut body, scene, &view);
    if style.names {
        draw_names(&mut body, scene, &view);
    }
    (view, body)
}

/// How a body is drawn.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum BodyStyle {
    /// In full colour.
    Solid,
    /// An earlier pose: outline and faint fill.
    Ghost,
}

/// A whole SVG document around `body`.
pub(super) fn document(width: f64, height: f64, title: &str, body: &str) -> String {
    let (w, h) = (px(width), px(height));
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" \
         role=\"img\">\n<title>{}</title>\n<rect width=\"{w}\" height=\"{h}\" fill=\"{}\"/>\n{body}</svg>\n",
        escape(title),
        light("scene")
    )
}

/// The picture's title for screen readers.
pub(super) fn title(scene: &Scene) -> String {
    if scene.name.is_empty() { "scene".into() } else { scene.name.clone() }
}

/// Statics, the goal's region and the bounds an action must keep to.
pub(super) fn draw_statics(out: &mut String, scene: &Scene, view: &Viewport) {
    let green = light("goal");
    for fixed in &scene.statics {
        let _ = write!(out, "<g><title>{}</title>", escape(&fixed.name));
        let wanted = goal_names(scene).contains(&fixed.name.as_str());
        let fill = light("static");
        let (stroke, pen) = if wanted { (light("ink"), 2.5) } else { (light("static-edge"), 0.8) };
        let paint = format!("fill=\"{fill}\" stroke=\"{stroke}\" stroke-width=\"{}\"", px(view.pen(pen)));
        draw_solid(out, &fixed.placed(), view, &paint, fill);
        out.push_str("</g>\n");
    }
    if let Some((normal, offset)) = scene.goal.as_ref().and_then(Goal::line) {
        // The half plane above the line.
        let above = Solid::HalfPlane { normal: normal.map(|v| -v), offset: -offset };
        let dash = px(view.pen(5.0));
        let paint = format!(
            "fill=\"{green}\" fill-opacity=\"0.12\" stroke=\"{green}\" stroke-width=\"{}\" \
             stroke-dasharray=\"{dash} {dash}\"",
            px(view.pen(1.5))
        );
        out.push_str("<g><title>goal</title>");
        draw_solid(out, &above, view, &paint, green);
        out.push_str("</g>\n");
    }
    if let Some(Goal::Inside { region, .. }) = &scene.goal {
        let corners: Vec<[f64; 2]> = region.iter().map(|p| view.at(*p)).collect();
        let dash = px(view.pen(5.0));
        let _ = writeln!(
            out,
            "<polygon points=\"{}\" fill=\"{green}\" fill-opacity=\"0.22\" stroke=\"{green}\" \
             stroke-width=\"{}\" stroke-dasharray=\"{dash} {dash}\"><title>goal</title></polygon>",
            points(&corners),
            px(view.pen(1.5))
        );
    }
}

/// Draws the bodies with a position there.
pub(super) fn draw_bodies(out: &mut String, scene: &Scene, view: &Viewport) {
    for (i, b) in scene.bodies.iter().enumerate() {
        if let Some(position) = b.position {
            draw_body(out, scene, i, position, b.angle, view, BodyStyle::Solid);
        }
    }
}

/// Draws body `index` with its frame's origin at `position` (m), rotated by `angle` (rad).
pub(super) fn draw_body(
    out: &mut String,
    scene: &Scene,
    index: usize,
    position: [f64; 2],
    angle: f64,
    view: &Viewport,
    look: BodyStyle,
) {
    let Some(body) = scene.bodies.get(index) else { return };
    let fill = body_colour(scene, index);
    let wanted = goal_names(scene).contains(&body.name.as_str());
    let (stroke, pen) = match (look, wanted) {
        (BodyStyle::Solid, true) => (light("ink").to_string(), 2.5),
        (BodyStyle::Solid, false) => (darker(fill), 1.2),
        (BodyStyle::Ghost, _) => (fill.to_string(), 1.2),
    };
    let opacity = if look == BodyStyle::Ghost { " fill-opacity=\"0.15\"" } else { "" };
    let paint =
        format!("fill=\"{fill}\"{opacity} stroke=\"{stroke}\" stroke-width=\"{}\"", px(view.pen(pen)));
    let _ = write!(out, "<g><title>{}</title>", escape(&body.name));
    draw_solid(out, &body.shape.solid().placed(position, angle), view, &paint, fill);
    if let Some(radius) = angle_mark_length(body, view) {
        let (sin, cos) = libm::sincos(angle);
        let (from, to) =
            (view.at(position), view.at([position[0] + radius * cos, position[1] + radius * sin]));
        let ink = match look {
            BodyStyle::Ghost => fill,
            BodyStyle::Solid if is_light(fill) => "#333333",
            BodyStyle::Solid => "#FFFFFF",
        };
        let _ = write!(
            out,
            "<line x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\" stroke=\"{ink}\" stroke-width=\"{}\" \
             stroke-linecap=\"round\"/>",
            px(from[0]),
            px(from[1]),
            px(to[0]),
            px(to[1]),
            px(view.pen(1.6).min(radius * view.scale / 3.0))
        );
    }
    out.push_str("</g>\n");
}

/// Colour of body `index`; bodies without a colour word in their name take colours from the palette in order.
pub(super) fn body_colour(scene: &Scene, index: usize) -> &'static str {
    let plain = |b: &Body| colour(&b.name, 0) != colour(&b.name, 1);
    let before = scene.bodies[..index].iter().filter(|b| plain(b)).count();
    colour(&scene.bodies[index].name, before)
}

/// Names of the bodies and statics of the goal.
pub(super) fn goal_names(scene: &Scene) -> Vec<&str> {
    scene.goal.as_ref().map_or(Vec::new(), Goal::names)
}

/// Length of the line that shows a disc's angle, m; none if it would be too small.
fn angle_mark_length(body: &Body, view: &Viewport) -> Option<f64> {
    let radius = body.shape.disc_radius().filter(|radius| radius * view.scale > 2.5);
    radius.map(|radius| radius * 0.82)
}

/// Draws the visible part of a solid in the world frame.
fn draw_solid(out: &mut String, solid: &Solid, view: &Viewport, paint: &str, fill: &str) {
    match solid {
        Solid::Bounded(pieces) => pieces.0.iter().for_each(|c| draw_piece(out, c, view, paint, fill)),
        Solid::HalfPlane { normal, offset } => {
            let seen = view.half_plane(*normal, *offset);
            if seen.len() > 2 {
                let _ = write!(out, "<polygon points=\"{}\" {paint}/>", points(&seen));
            }
        }
    }
}

fn draw_piece(out: &mut String, piece: &Convex, view: &Viewport, paint: &str, fill: &str) {
    let corners: Vec<[f64; 2]> = piece.points.iter().map(|p| view.at(*p)).collect();
    let _ = match (corners.as_slice(), piece.radius * view.scale) {
        ([c], r) => write!(
            out,
            "<circle cx=\"{}\" cy=\"{}\" r=\"{}\" {paint}/>",
            px(c[0]),
            px(c[1]),
            px(r.max(MIN_DISC_RADIUS_PX))
        ),
        ([a, b], r) if r > view.pen(1.0) => {
            let along = [b[0] - a[0], b[1] - a[1]];
            let length = (along[0] * along[0] + along[1] * along[1]).sqrt().max(1e-9);
            let side = [-along[1] / length * r, along[0] / length * r];
            let corners = [
                [a[0] - side[0], a[1] - side[1]],
                [b[0] - side[0], b[1] - side[1]],
                [b[0] + side[0], b[1] + side[1]],
                [a[0] + side[0], a[1] + side[1]],
            ]
            .map(|p| format!("{} {}", px(p[0]), px(p[1])));
            let [p, q, s, t] = corners;
            write!(out, "<path d=\"M{p}L{q}A{r} {r} 0 0 1 {s}L{t}A{r} {r} 0 0 1 {p}Z\" {paint}/>", r = px(r))
        }
        // A segment thinner than a pen is drawn with a pen.
        ([a, b], _) => write!(
            out,
            "<line x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\" stroke=\"{}\" stroke-width=\"{}\" \
             stroke-linecap=\"round\"/>",
            px(a[0]),
            px(a[1]),
            px(b[0]),
            px(b[1]),
            darker(fill),
            px(view.pen(2.0))
        ),
        (corners, _) => {
            write!(out, "<polygon points=\"{}\" {paint} stroke-linejoin=\"round\"/>", points(corners))
        }
    };
}

/// Minimal drawn radius of a disc, px, which keeps a ball in a large scene visible.
const MIN_DISC_RADIUS_PX: f64 = 1.5;

fn draw_names(out: &mut String, scene: &Scene, view: &Viewport) {
    for b in &scene.bodies {
        let Some(placed) = b.placed() else { continue };
        let box_ = placed.bounds();
        let p = view.at([(box_[0] + box_[2]) / 2.0, box_[3]]);
        let size = view.pen(13.0).max(8.0);
        let _ = writeln!(
            out,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\" font-family=\"sans-serif\" font-size=\"{}\" \
             fill=\"{}\">{}</text>",
            px(p[0]),
            px((p[1] - size * 0.4).max(size)),
            px(size),
            light("ink"),
            escape(&b.name)
        );
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::picture::png::{svg_to_png, svg_to_rgb};
    use crate::task::families;
    use crate::task::shape::{Halfspace, Polygon, SegmentShape, Shape};
    use resvg::usvg::roxmltree::Document;

    /// A square scene of 10 m with a goal, one body of each shape, and names that need escaping.
    pub fn hall() -> Scene {
        let text = r##"{"format": "iplw.scene/1", "name": "<script>alert('a & b')</script>",
            "bodies": [
              {"name": "red", "shape": {"type": "disc", "radius": 1}, "position": [3, 7], "angle": 0.6},
              {"name": "\"/><script>1</script>&amp;]]>", "shape": {"type": "box", "half_width": 1, "half_height": 0.5},
               "position": [7, 7], "angle": 0.3},
              {"name": "wedge", "shape": {"type": "polygon", "vertices": [[-0.5, -0.4], [1, -0.4], [0, 0.8]]},
               "position": [2, 3], "angle": 0.2},
              {"name": "rod", "shape": {"type": "segment", "from": [-1, 0], "to": [1, 0], "radius": 0.2},
               "position": [7, 4], "angle": 1.0}],
            "statics": [
              {"name": "floor <&>", "shape": {"type": "halfspace", "normal": [0, 1], "offset": 0}},
              {"name": "left", "shape": {"type": "segment", "from": [0, 0], "to": [0, 10], "radius": 0}},
              {"name": "right", "shape": {"type": "box", "half_width": 0.2, "half_height": 5}, "position": [10, 5]}],
            "goal": {"type": "inside", "body": "red", "region": [[4, 1], [6, 1], [6, 2], [4, 2]]}}"##;
        Scene::from_json(text).unwrap()
    }

    /// The scene mirrored at x = 5 m.
    fn mirrored(scene: &Scene) -> Scene {
        let flip = |p: [f64; 2]| [10.0 - p[0], p[1]];
        let shape = |s: &Shape| match s {
            Shape::Polygon(Polygon { vertices }) => {
                Polygon { vertices: vertices.iter().rev().map(|v| [-v[0], v[1]]).collect() }.into()
            }
            Shape::Segment(SegmentShape { from, to, radius }) => {
                SegmentShape { from: [-from[0], from[1]], to: [-to[0], to[1]], radius: *radius }.into()
            }
            Shape::Halfspace(Halfspace { normal, offset }) => {
                Halfspace { normal: [-normal[0], normal[1]], offset: *offset }.into()
            }
            other => other.clone(),
        };
        let mut m = scene.clone();
        for b in &mut m.bodies {
            b.position = b.position.map(flip);
            // A disc's line points along its x axis, which the mirror reverses.
            let round = b.shape.disc_radius().is_some();
            b.angle = if round { std::f64::consts::PI - b.angle } else { -b.angle };
            b.shape = shape(&b.shape);
        }
        for s in &mut m.statics {
            s.position = flip(s.position);
            s.angle = -s.angle;
            s.shape = shape(&s.shape);
        }
        if let Some(Goal::Inside { region, .. }) = &mut m.goal {
            region.iter_mut().for_each(|p| *p = flip(*p));
        }
        m
    }

    /// Parses as XML and as SVG, and contains no element injected by a name.
    pub fn check_svg(svg: &str) {
        let document = Document::parse(svg).unwrap_or_else(|e| panic!("{e}\n{svg}"));
        assert_eq!(document.root_element().tag_name().name(), "svg");
        assert!(document.descendants().all(|n| n.tag_name().name() != "script"), "{svg}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        svg_to_png(svg, 64).unwrap();
    }

    /// The colour at a position of the world in `scene_svg`.
    fn colour_at(scene: &Scene, p: [f64; 2]) -> [u8; 3] {
        let view = Viewport::new(scene, None, 1200.0);
        let svg = scene_svg(scene, &Style { width: 1200, ..Style::default() });
        let rgb = svg_to_rgb(&svg, 1200, view.height as u32).unwrap();
        let at = view.at(p);
        let i = (at[1] as usize * 1200 + at[0] as usize) * 3;
        [rgb[i], rgb[i + 1], rgb[i + 2]]
    }

    #[test]
    fn is_well_formed_and_escapes_names() {
        for names in [false, true] {
            check_svg(&scene_svg(&hall(), &Style { names, ..Style::default() }));
        }
        for family in families() {
            check_svg(&scene_svg(&family.candidates(0).next().unwrap(), &Style::default()));
        }
        check_svg(&scene_svg(&Scene::empty(), &Style::default()));
    }

    #[test]
    fn draws_every_shape_as_body_and_as_static() {
        for shape in Shape::samples() {
            let mut scene = hall();
            scene.statics[0].shape = shape.clone();
            if shape.bounds().is_some() {
                scene.bodies[0].shape = shape.clone();
            }
            let svg = scene_svg(&scene, &Style::default());
            assert!(!svg.contains("</title></g>"), "{shape:?}: {svg}");
        }
    }

    #[test]
    fn draws_bodies_at_their_positions() {
        let scene = hall();
        let check = |p: [f64; 2], wanted: &str| {
            let wanted = crate::picture::svg::channels(wanted);
            assert_eq!(colour_at(&scene, p), wanted, "at {p:?}");
        };
        // Off the line that shows the angle, well within each shape; y is up.
        check([3.0, 6.5], "#D62F2F");
        check([3.0, 7.5], "#D62F2F");
        check([3.0, 5.8], light("scene"));
        check([7.2, 7.1], crate::picture::svg::PALETTE[0]);
        check([2.2, 3.0], crate::picture::svg::PALETTE[1]);
        check([7.0, 4.0], crate::picture::svg::PALETTE[2]);
        check([5.0, -0.15], light("static"));
        check([10.0, 8.0], light("static"));
        check([5.0, 8.0], light("scene"));
        // On the line that shows the angle.
        check([3.0 + 0.5 * 0.6f64.cos(), 7.0 + 0.5 * 0.6f64.sin()], "#FFFFFF");
    }

    #[test]
    fn mirrored_scenes_give_mirrored_pictures() {
        let (scene, width) = (hall(), 400u32);
        let draw = |s: &Scene| {
            let svg = scene_svg(s, &Style { width, ..Style::default() });
            let height = Viewport::new(s, None, f64::from(width)).height as u32;
            svg_to_rgb(&svg, width, height).unwrap()
        };
        let (one, other) = (draw(&scene), draw(&mirrored(&scene)));
        assert_eq!(one.len(), other.len());
        let w = width as usize;
        let differing_from_mirror_image = |other: &[u8]| {
            let differs = |i: &usize| {
                let j = i / w * w + (w - 1 - i % w);
                (0..3).any(|c| one[i * 3 + c].abs_diff(other[j * 3 + c]) > 64)
            };
            (0..one.len() / 3).filter(differs).count()
        };
        // Only antialiased edges may differ. The scene isn't symmetric: thousands of pixels differ from its own mirror image.
        let (differing, own) = (differing_from_mirror_image(&other), differing_from_mirror_image(&one));
        assert!(differing < 40, "{differing} pixels differ");
        assert!(own > 4000, "{own}");
    }

    #[test]
    fn is_deterministic_and_clamps_the_width() {
        let draw = |width| scene_svg(&hall(), &Style { width, ..Style::default() });
        assert_eq!(draw(640), draw(640));
        assert!(draw(0).contains("width=\"16\"") && draw(u32::MAX).contains("width=\"4096\""));
    }
}
