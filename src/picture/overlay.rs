//! Measured trajectories over those of two simulations, in the scene: panels side by side at one scale for both axes.

use std::fmt::Write;

use super::scene::{document, draw_statics};
use super::svg::{decimals, escape, points, px};
use super::theme::{Meaning, light};
use super::viewport::Viewport;
use crate::task::Scene;

/// A trial with its trajectories; each is a list of pieces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OverlayPanel {
    /// Shown above the panel.
    pub title: String,
    /// Measured positions, m.
    pub measured: Vec<[f64; 2]>,
    /// Pieces of the trajectory by the base simulation, m.
    pub simulated: Vec<Vec<[f64; 2]>>,
    /// Pieces of the trajectory by the extended simulation, m.
    pub extended: Vec<Vec<[f64; 2]>>,
}

/// Width of a panel, px.
const PANEL_WIDTH_PX: f64 = 460.0;
/// Ratio of a panel's height to its width.
const PANEL_ASPECT_RATIO: f64 = 0.95;
/// Space around the trajectories, relative to their size.
const MARGIN_SHARE: f64 = 0.06;
/// Gap between panels, and height of a title, px.
const GAP_PX: f64 = 16.0;
const TITLE_HEIGHT_PX: f64 = 30.0;
/// Length of the scale bar relative to the panel's width, at most.
const MAX_SCALE_BAR_SHARE: f64 = 0.3;

/// The panels in a row; the statics of `scene` lie under them. Panels without points are left out.
pub fn overlay_svg(scene: &Scene, panels: &[OverlayPanel]) -> String {
    let mut body = String::new();
    let height = PANEL_ASPECT_RATIO * PANEL_WIDTH_PX;
    let visible = panels.iter().filter_map(|p| Some((p, bounds(p)?)));
    let mut count = 0;
    for (panel, bounds) in visible {
        let x = count as f64 * (PANEL_WIDTH_PX + GAP_PX);
        let view = Viewport {
            bounds,
            width: PANEL_WIDTH_PX,
            height,
            scale: PANEL_WIDTH_PX / (bounds[2] - bounds[0]),
        };
        let (w, h) = (px(view.width), px(view.height));
        let _ = writeln!(
            body,
            "<text x=\"{}\" y=\"{}\" font-family=\"sans-serif\" font-size=\"15\" font-weight=\"600\" fill=\"{}\">{}</text>\n\
             <svg x=\"{}\" y=\"{TITLE_HEIGHT_PX}\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\">",
            px(x + 4.0),
            px(0.68 * TITLE_HEIGHT_PX),
            light("ink"),
            escape(&panel.title),
            px(x)
        );
        draw_statics(&mut body, scene, &view);
        draw_panel(&mut body, panel, &view);
        body.push_str("</svg>\n");
        count += 1;
    }
    let width = (count.max(1)) as f64 * (PANEL_WIDTH_PX + GAP_PX) - GAP_PX;
    document(width, height + TITLE_HEIGHT_PX, "measured and simulated trajectories", &body)
}

/// The visible box around a panel's points, of the panel's aspect ratio.
fn bounds(panel: &OverlayPanel) -> Option<[f64; 4]> {
    let pieces = panel.simulated.iter().chain(&panel.extended).flatten();
    let all: Vec<&[f64; 2]> =
        panel.measured.iter().chain(pieces).filter(|p| p.iter().all(|v| v.is_finite())).collect();
    let end = |k: usize, of: fn(f64, f64) -> f64, start: f64| all.iter().map(|p| p[k]).fold(start, of);
    let low = [0, 1].map(|k| end(k, f64::min, f64::INFINITY));
    let high = [0, 1].map(|k| end(k, f64::max, f64::NEG_INFINITY));
    if all.is_empty() {
        return None;
    }
    let (w, h) = (high[0] - low[0], high[1] - low[1]);
    let room = 1.0 + 2.0 * MARGIN_SHARE;
    let width = (room * w).max(room * h / PANEL_ASPECT_RATIO).max(1e-6);
    let half = [0.5 * width, 0.5 * width * PANEL_ASPECT_RATIO];
    let centre = [0, 1].map(|k| 0.5 * (low[k] + high[k]));
    Some([centre[0] - half[0], centre[1] - half[1], centre[0] + half[0], centre[1] + half[1]])
}

fn draw_panel(out: &mut String, panel: &OverlayPanel, view: &Viewport) {
    let line = |out: &mut String, piece: &[[f64; 2]], meaning: Meaning, dash: &str| {
        let place: Vec<[f64; 2]> =
            piece.iter().filter(|p| p.iter().all(|v| v.is_finite())).map(|p| view.at(*p)).collect();
        let _ = writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2.2\"{dash}/>",
            points(&place),
            meaning.colour()
        );
    };
    panel.simulated.iter().for_each(|p| line(out, p, Meaning::Simulated, " stroke-dasharray=\"7 4\""));
    panel.extended.iter().for_each(|p| line(out, p, Meaning::Extended, ""));
    for at in panel.measured.iter().filter(|p| p.iter().all(|v| v.is_finite())).map(|p| view.at(*p)) {
        let _ = writeln!(
            out,
            "<circle cx=\"{}\" cy=\"{}\" r=\"2.6\" fill=\"{}\"/>",
            px(at[0]),
            px(at[1]),
            Meaning::Measured.colour()
        );
    }
    scale_bar(out, view);
    let (w, h) = (px(view.width - 1.0), px(view.height - 1.0));
    let _ = writeln!(
        out,
        "<rect x=\"0.5\" y=\"0.5\" width=\"{w}\" height=\"{h}\" fill=\"none\" stroke=\"{}\"/>",
        light("line")
    );
}

/// A bar of a round length in metres, in the lower right corner.
fn scale_bar(out: &mut String, view: &Viewport) {
    let most = MAX_SCALE_BAR_SHARE * view.width / view.scale;
    let ten = 10f64.powf(most.log10().floor());
    let length = [5.0, 2.0, 1.0].map(|m| m * ten).into_iter().find(|l| *l <= most).unwrap_or(ten);
    let text = match length {
        l if l < 0.01 => format!("{} mm", decimals(1e3 * l, 3)),
        l if l < 1.0 => format!("{} cm", decimals(1e2 * l, 3)),
        l => format!("{} m", decimals(l, 3)),
    };
    let (right, y) = (view.width - 14.0, view.height - 12.0);
    let left = right - length * view.scale;
    let _ = writeln!(
        out,
        "<line x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\" stroke=\"{ink}\" stroke-width=\"2\"/>\n\
         <text x=\"{}\" y=\"{}\" text-anchor=\"middle\" font-family=\"sans-serif\" font-size=\"14\" fill=\"{ink}\">{text}</text>",
        px(left),
        px(y),
        px(right),
        px(y),
        px(0.5 * (left + right)),
        px(y - 5.0),
        ink = light("ink")
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::scene::tests::check_svg;

    fn panel(title: &str) -> OverlayPanel {
        let curve =
            |dy: f64| (0..9).map(|i| [0.1 * f64::from(i), dy + 0.01 * f64::from(i * i)]).collect::<Vec<_>>();
        OverlayPanel {
            title: title.into(),
            measured: curve(0.0),
            simulated: vec![curve(0.02)],
            extended: vec![curve(0.001), Vec::new()],
        }
    }

    #[test]
    fn panels_show_all_three_motions_at_one_scale() {
        let svg = overlay_svg(&Scene::empty(), &[panel("throw <7>"), panel("throw 8")]);
        check_svg(&svg);
        assert_eq!(svg.matches("<circle").count(), 18);
        assert!(svg.contains("throw &lt;7&gt;") && svg.contains("20 cm"), "{svg}");
        for meaning in [Meaning::Measured, Meaning::Simulated, Meaning::Extended] {
            assert!(svg.contains(meaning.colour()));
        }
    }

    #[test]
    fn panels_without_points_are_left_out() {
        let none = OverlayPanel { measured: vec![[f64::NAN, 0.0]], ..OverlayPanel::default() };
        assert_eq!(overlay_svg(&Scene::empty(), &[none.clone(), panel("a")]).matches("<svg").count(), 2);
        check_svg(&overlay_svg(&Scene::empty(), &[none]));
    }
}
