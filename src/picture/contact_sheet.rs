//! A contact sheet: a grid of scenes with captions.

use std::fmt::Write;

use super::scene::{Style, document, scene_elements};
use super::svg::{escape, px};
use super::theme::light;
use crate::task::Scene;

/// Number of columns.
const COLUMNS: usize = 10;
/// Width of a cell's picture, px.
const CELL_WIDTH_PX: u32 = 160;
/// Gap between cells, px.
const GAP_PX: f64 = 10.0;
/// Height of the text, px.
const TEXT_HEIGHT_PX: f64 = 12.0;

/// The scenes in rows of ten, each above its caption.
pub fn contact_sheet_svg(title: &str, cells: &[(String, Scene)]) -> String {
    let style = Style { width: CELL_WIDTH_PX, ..Style::default() };
    let pictures: Vec<_> =
        cells.iter().map(|(caption, scene)| (caption, scene_elements(scene, &style))).collect();
    let mut body = String::new();
    let mut top = GAP_PX;
    for row in pictures.chunks(COLUMNS) {
        let tallest = row.iter().map(|(_, (view, _))| view.height).fold(0.0, f64::max);
        for (column, (caption, (view, picture))) in row.iter().enumerate() {
            let left = GAP_PX + column as f64 * (f64::from(CELL_WIDTH_PX) + GAP_PX);
            let (x, y, w, h) = (px(left), px(top), px(view.width), px(view.height));
            let _ = write!(
                body,
                "<svg x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\">\n{picture}</svg>\n\
                 <text x=\"{x}\" y=\"{}\" font-family=\"sans-serif\" font-size=\"{TEXT_HEIGHT_PX}\" fill=\"{}\">{}</text>\n",
                px(top + tallest + 1.2 * TEXT_HEIGHT_PX),
                light("ink"),
                escape(caption)
            );
        }
        top += tallest + 2.0 * TEXT_HEIGHT_PX + GAP_PX;
    }
    let columns = cells.len().clamp(1, COLUMNS) as f64;
    document(GAP_PX + columns * (f64::from(CELL_WIDTH_PX) + GAP_PX), top, title, &body)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::svg_to_png;
    use crate::task::family;

    #[test]
    fn draws_a_cell_for_each_scene_and_escapes_names() {
        let scene = family("bowling").unwrap().candidates(0).next().unwrap();
        let cells: Vec<(String, Scene)> = (0..12).map(|i| (format!("<{i}>"), scene.clone())).collect();
        let svg = contact_sheet_svg("a & b", &cells);
        assert_eq!(svg.matches("<svg ").count(), 13);
        assert!(svg.contains("&lt;11&gt;") && svg.contains("a &amp; b") && !svg.contains("<11>"));
        assert!(svg_to_png(&svg, 400).is_ok());
        assert!(svg_to_png(&contact_sheet_svg("none", &[]), 100).is_ok());
    }
}
