//! A contact sheet: many scenes side by side, each with a line of text below it.

use std::fmt::Write;

use super::scene::{Style, document, inner};
use super::svg::{escape, px};
use crate::task::Scene;

/// Cells of a row.
const COLUMNS: usize = 10;
/// Width of a cell's picture, px.
const CELL: u32 = 160;
/// Between cells, px.
const GAP: f64 = 10.0;
/// Height of the text, px.
const TEXT: f64 = 12.0;

/// The scenes in rows of ten, each above its caption.
pub fn sheet_svg(title: &str, cells: &[(String, Scene)]) -> String {
    let style = Style { width: CELL, ..Style::default() };
    let pictures: Vec<_> = cells.iter().map(|(caption, scene)| (caption, inner(scene, &style))).collect();
    let mut body = String::new();
    let mut top = GAP;
    for row in pictures.chunks(COLUMNS) {
        let tallest = row.iter().map(|(_, (view, _))| view.height).fold(0.0, f64::max);
        for (column, (caption, (view, picture))) in row.iter().enumerate() {
            let left = GAP + column as f64 * (f64::from(CELL) + GAP);
            let (x, y, w, h) = (px(left), px(top), px(view.width), px(view.height));
            let _ = write!(
                body,
                "<svg x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\">\n{picture}</svg>\n\
                 <text x=\"{x}\" y=\"{}\" font-family=\"sans-serif\" font-size=\"{TEXT}\" fill=\"#333333\">{}</text>\n",
                px(top + tallest + 1.2 * TEXT),
                escape(caption)
            );
        }
        top += tallest + 2.0 * TEXT + GAP;
    }
    let columns = cells.len().clamp(1, COLUMNS) as f64;
    document(GAP + columns * (f64::from(CELL) + GAP), top, title, &body)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::svg_to_png;
    use crate::task::family;

    #[test]
    fn a_cell_for_each_scene_in_rows_and_names_are_escaped() {
        let scene = family("bowling").unwrap().candidates(0).next().unwrap();
        let cells: Vec<(String, Scene)> = (0..12).map(|i| (format!("<{i}>"), scene.clone())).collect();
        let svg = sheet_svg("a & b", &cells);
        assert_eq!(svg.matches("<svg ").count(), 13);
        assert!(svg.contains("&lt;11&gt;") && svg.contains("a &amp; b") && !svg.contains("<11>"));
        assert!(svg_to_png(&svg, 400).is_ok());
        assert!(svg_to_png(&sheet_svg("none", &[]), 100).is_ok());
    }
}
