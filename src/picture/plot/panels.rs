//! Several plots as one picture.

use crate::picture::svg::escape;

/// Gap between panels, px.
const GAP_PX: f64 = 8.0;

/// Plots in rows of `columns`, each at its own size.
pub fn panels(title: &str, plots: &[String], columns: usize) -> String {
    let (mut body, mut top, mut width) = (String::new(), 0.0, 0.0f64);
    for row in plots.chunks(columns.max(1)) {
        let (mut left, mut height) = (0.0, 0.0f64);
        for svg in row {
            let [w, h] = size(svg);
            body += &svg.trim().replacen("<svg ", &format!("<svg x=\"{left}\" y=\"{top}\" "), 1);
            body.push('\n');
            (left, height) = (left + w + GAP_PX, height.max(h));
        }
        (width, top) = (width.max(left - GAP_PX), top + height + GAP_PX);
    }
    let height = (top - GAP_PX).max(1.0);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         role=\"img\">\n<title>{}</title>\n{body}</svg>\n",
        escape(title)
    )
}

/// Width and height of a plot, px.
fn size(svg: &str) -> [f64; 2] {
    let number = |name: &str| {
        let rest = svg.split_once(&format!(" {name}=\""))?.1;
        rest.split('"').next()?.parse().ok()
    };
    ["width", "height"].map(|name| number(name).unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::plot::{Series, lines};
    use crate::picture::scene::tests::check_svg;

    #[test]
    fn panels_lie_in_rows() {
        let plot =
            lines("a", "x", "y", &[Series { points: vec![(0.0, 0.0), (1.0, 1.0)], ..Series::default() }]);
        let svg = panels("three", &[plot.clone(), plot.clone(), plot], 2);
        check_svg(&svg);
        assert!(
            svg.contains("width=\"1448\" height=\"888\"") && svg.contains("x=\"0\" y=\"448\""),
            "{}",
            &svg[..200]
        );
    }
}
