//! Heat maps with colour scales, contour lines, dots and marks.

use std::ops::Range;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use super::frame::{
    Area, Chart, DrawResult, PLOT_SIZE_PX, empty, finish_axes, ink, plot_svg_sized, pos, subpixels, text,
    truncate,
};
use super::scale::{extend, heat, is_drawable, label_width, range, tick};

/// Values over a plane.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heatmap {
    /// Shown above the plot where several stand side by side.
    pub title: String,
    /// Shown under the plot.
    pub x_label: String,
    /// Shown beside the plot.
    pub y_label: String,
    /// Shown beside the colour scale.
    pub value_label: String,
    /// (columns,) rising centres of the cells.
    pub x: Vec<f64>,
    /// (rows,) rising centres of the cells.
    pub y: Vec<f64>,
    /// (rows, columns) values; values that aren't finite are grey.
    pub values: Vec<Vec<f64>>,
    /// Named points to mark, such as the truth or the estimate.
    pub marks: Vec<(f64, f64, String)>,
    /// Unnamed points, drawn small, such as design points.
    pub dots: Vec<(f64, f64)>,
    /// Number of contour lines.
    pub contours: usize,
}

/// Coloured cells with a scale beside them.
pub fn heatmap(title: &str, map: &Heatmap) -> String {
    heatmaps(title, std::slice::from_ref(map))
}

/// Heat maps side by side, each with its own scale. Marks of the same index have the same colour, and the legend shows the first map's.
pub fn heatmaps(title: &str, maps: &[Heatmap]) -> String {
    if maps.is_empty() || maps.iter().any(|m| !m.is_drawable()) {
        return empty(title);
    }
    let legend: Vec<(String, RGBColor)> = maps[0]
        .marks
        .iter()
        .enumerate()
        .map(|(i, m)| (m.2.clone(), MARK_COLOURS[i % MARK_COLOURS.len()]))
        .collect();
    let size =
        if maps.len() > 1 { (maps.len() as u32 * PANEL_SIZE_PX.0, PANEL_SIZE_PX.1) } else { PLOT_SIZE_PX };
    plot_svg_sized(size, title, &legend, |area| {
        for (panel, map) in area.split_evenly((1, maps.len())).iter().zip(maps) {
            let inside = if maps.len() > 1 {
                let style = text(13).pos(pos(HPos::Left, VPos::Center));
                panel.draw_text(
                    &truncate(&map.title, 50),
                    &style,
                    (subpixels(16) as i32, subpixels(10) as i32),
                )?;
                panel.margin(subpixels(18), 0, 0, 0)
            } else {
                panel.clone()
            };
            draw_heatmap(&inside, map)?;
        }
        Ok(())
    })
}

/// Width and height of each of several heat maps, px.
const PANEL_SIZE_PX: (u32, u32) = (520, 460);

impl Heatmap {
    fn range(&self) -> Option<(f64, f64)> {
        range(self.values.iter().flatten().copied().filter(|v| is_drawable(*v)))
    }

    fn is_drawable(&self) -> bool {
        self.values.len() == self.y.len()
            && self.values.iter().all(|row| row.len() == self.x.len())
            && self.x.iter().chain(&self.y).all(|v| is_drawable(*v))
            && self.range().is_some()
    }
}

/// The cells, lines, dots and marks of one map, and its scale.
fn draw_heatmap(area: &Area, map: &Heatmap) -> DrawResult {
    let Some((low, high)) = map.range() else { return Ok(()) };
    let (xs, ys) = (cell_edges(&map.x), cell_edges(&map.y));
    let (x, y) = (xs[0]..xs[xs.len() - 1], ys[0]..ys[ys.len() - 1]);
    let colours = extend((low, high), 0.0);
    let ticks = levels(low, high, map.contours);
    let (width, _) = area.dim_in_pixel();
    let (plot, scale) = area.split_horizontally(width - subpixels(104));
    let mut chart = ChartBuilder::on(&plot)
        .margin(subpixels(8))
        .margin_top(subpixels(4))
        .set_label_area_size(LabelAreaPosition::Left, subpixels(label_width(&y, 6)))
        .set_label_area_size(LabelAreaPosition::Bottom, subpixels(44))
        .build_cartesian_2d(x, y)?;
    let mut mesh = chart.configure_mesh();
    mesh.disable_mesh();
    finish_axes(&mut mesh, &map.x_label, &map.y_label)?;
    draw_cells(&mut chart, map, [&xs, &ys], &colours)?;
    for level in &ticks {
        for line in contour(map, *level) {
            chart.draw_series([PathElement::new(line.to_vec(), level_style())])?;
        }
    }
    draw_places(&mut chart, map)?;
    draw_scale(&scale, map, &colours, &ticks)
}

/// Style of contour lines.
fn level_style() -> ShapeStyle {
    WHITE.mix(0.75).stroke_width(subpixels(1))
}

/// The cells, between their `edges` along x and y.
fn draw_cells(chart: &mut Chart, map: &Heatmap, [xs, ys]: [&[f64]; 2], colours: &Range<f64>) -> DrawResult {
    let share = |v: f64| (v - colours.start) / (colours.end - colours.start);
    for (row, values) in map.values.iter().enumerate() {
        for (column, v) in values.iter().enumerate() {
            let colour = if is_drawable(*v) { heat(share(*v)) } else { RGBColor(205, 205, 205) };
            // Each cell extends under its right and upper neighbours, which are drawn later, to avoid seams.
            let far = [
                (xs[column + 1] + xs[(column + 2).min(map.x.len())]) / 2.0,
                (ys[row + 1] + ys[(row + 2).min(map.y.len())]) / 2.0,
            ];
            chart
                .draw_series([Rectangle::new([(xs[column], ys[row]), (far[0], far[1])], colour.filled())])?;
        }
    }
    Ok(())
}

/// The dots and marks that lie in the plot.
fn draw_places(chart: &mut Chart, map: &Heatmap) -> DrawResult {
    let (x, y) = (chart.x_range(), chart.y_range());
    let disc =
        |at: (f64, f64), size: u32, colour: RGBColor| Circle::new(at, subpixels(size), colour.filled());
    for dot in map.dots.iter().filter(|p| x.contains(&p.0) && y.contains(&p.1)) {
        chart.draw_series([disc(*dot, 3, WHITE), disc(*dot, 2, ink())])?;
    }
    for (i, (mx, my, _)) in map.marks.iter().enumerate() {
        if x.contains(mx) && y.contains(my) {
            chart.draw_series([
                disc((*mx, *my), 7, WHITE),
                disc((*mx, *my), 5, MARK_COLOURS[i % MARK_COLOURS.len()]),
            ])?;
        }
    }
    Ok(())
}

/// Draws the colour scale of a map.
fn draw_scale(area: &Area, map: &Heatmap, colours: &Range<f64>, ticks: &[f64]) -> DrawResult {
    const STEPS: u32 = 64;
    let mut bar = ChartBuilder::on(area)
        .margin(subpixels(8))
        .margin_top(subpixels(4))
        .margin_bottom(subpixels(52))
        .set_label_area_size(LabelAreaPosition::Right, subpixels(66))
        .build_cartesian_2d(0.0..1.0, colours.clone())?;
    for k in 0..STEPS {
        let from = f64::from(k) / f64::from(STEPS);
        let bottom = colours.start + from * (colours.end - colours.start);
        let shade = heat(from + 0.5 / f64::from(STEPS)).filled();
        bar.draw_series([Rectangle::new([(0.0, bottom), (1.0, colours.end)], shade)])?;
    }
    for level in ticks {
        bar.draw_series([PathElement::new(vec![(0.0, *level), (1.0, *level)], level_style())])?;
    }
    bar.configure_mesh()
        .disable_mesh()
        .disable_x_axis()
        .axis_style(ShapeStyle::from(&ink()).stroke_width(subpixels(1)))
        .set_all_tick_mark_size(subpixels(4))
        .y_labels(6)
        .y_label_formatter(&|v: &f64| tick(*v))
        .label_style(text(12))
        .y_desc(truncate(&map.value_label, 60))
        .axis_desc_style(text(13))
        .draw()?;
    Ok(())
}

/// About `count` round values between `low` and `high`.
fn levels(low: f64, high: f64, count: usize) -> Vec<f64> {
    if count == 0 || high <= low {
        return Vec::new();
    }
    let raw = (high - low) / count as f64;
    let ten = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * ten).find(|s| *s >= raw).unwrap_or(raw);
    let first = (low / step).floor() as i64 + 1;
    (first..).map(|k| k as f64 * step).take_while(|v| *v < high).take(50).collect()
}

/// Pieces of a contour line: marching squares between the cells' centres, saddles resolved in one way.
fn contour(map: &Heatmap, level: f64) -> Vec<[(f64, f64); 2]> {
    let mut pieces = Vec::new();
    for r in 0..map.y.len().saturating_sub(1) {
        for c in 0..map.x.len().saturating_sub(1) {
            let corners = [(r, c), (r, c + 1), (r + 1, c + 1), (r + 1, c)];
            let values = corners.map(|(r, c)| map.values[r][c]);
            if values.iter().any(|v| !is_drawable(*v)) {
                continue;
            }
            let mut crossed = Vec::with_capacity(4);
            for k in 0..4 {
                let (a, b) = (values[k], values[(k + 1) % 4]);
                if (a < level) != (b < level) {
                    let share = (level - a) / (b - a);
                    let at = |k: usize| (map.x[corners[k].1], map.y[corners[k].0]);
                    let (p, q) = (at(k), at((k + 1) % 4));
                    crossed.push((p.0 + share * (q.0 - p.0), p.1 + share * (q.1 - p.1)));
                }
            }
            pieces.extend(crossed.chunks_exact(2).map(|pair| [pair[0], pair[1]]));
        }
    }
    pieces
}

/// Colours of marks, visible on every shade of a heat map.
const MARK_COLOURS: [RGBColor; 4] = [
    RGBColor(0xD5, 0x1F, 0x3A),
    RGBColor(0x00, 0x72, 0xB2),
    RGBColor(0x11, 0x11, 0x11),
    RGBColor(0xCC, 0x79, 0xA7),
];

/// Edges of cells with the given centres.
fn cell_edges(centres: &[f64]) -> Vec<f64> {
    let n = centres.len();
    if n == 1 {
        let half = (centres[0].abs() * 0.05).max(0.5);
        return vec![centres[0] - half, centres[0] + half];
    }
    let middle = |i: usize| (centres[i - 1] + centres[i]) / 2.0;
    let mut edges = vec![centres[0] - (centres[1] - centres[0]) / 2.0];
    edges.extend((1..n).map(middle));
    edges.push(centres[n - 1] + (centres[n - 1] - centres[n - 2]) / 2.0);
    edges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contours_of_a_plane_are_exact() {
        let axis: Vec<f64> = (0..9).map(|i| f64::from(i) / 8.0).collect();
        let plane = |x: f64, y: f64| 0.3 * x + 0.8 * y;
        let map = Heatmap {
            values: axis.iter().map(|y| axis.iter().map(|x| plane(*x, *y)).collect()).collect(),
            x: axis.clone(),
            y: axis,
            ..Heatmap::default()
        };
        let levels = levels(0.0, 1.1, 5);
        assert!(levels.iter().zip([0.5, 1.0]).all(|(a, b)| (a - b).abs() < 1e-12) && levels.len() == 2);
        let pieces = contour(&map, 0.5);
        assert!(pieces.len() >= 8, "{}", pieces.len());
        for (x, y) in pieces.into_iter().flatten() {
            assert!((plane(x, y) - 0.5).abs() < 1e-9);
        }
        assert!(contour(&map, 2.0).is_empty());
    }
}
