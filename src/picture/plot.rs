//! Plots as SVG, by plotters: lines with bands, bars, points, heat maps, arrows; readable on white, colours of Okabe
//! and Ito (2008) and a heat scale that is safe for the colour-blind too.
//!
//! Points that are not finite are left out; a plot without any says so. The same data gives the same bytes:
//! text is placed by counting characters, never by asking which fonts a machine has.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::svg::{PALETTE, channels, cleaned, decimals, escape};

mod field;

pub use field::{Arrows, field};

/// One line or cloud of points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Shown in the legend.
    pub name: String,
    /// (x, y) in the units of the axes.
    pub points: Vec<(f64, f64)>,
    /// (low, high) around each point's y, say a 95 % interval; one for each point.
    pub band: Option<Vec<(f64, f64)>>,
}

/// Bars that stand together under one label.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Group {
    /// Shown under the bars.
    pub name: String,
    /// One bar for each entry; entries of the same name have the same colour in all groups.
    pub bars: Vec<Bar>,
}

/// One bar.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bar {
    /// Shown in the legend.
    pub name: String,
    /// Height.
    pub value: f64,
    /// (low, high), drawn as an error bar.
    pub interval: Option<(f64, f64)>,
}

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
    /// (rows, columns) values; what is not finite stays grey.
    pub values: Vec<Vec<f64>>,
    /// Points to mark, with a name: the truth, the estimate.
    pub marks: Vec<(f64, f64, String)>,
    /// Places without a name, drawn small: where the values come from.
    pub dots: Vec<(f64, f64)>,
    /// Lines of equal value to draw; none if 0.
    pub contours: usize,
}

/// Lines through points, each with its band.
pub fn lines(title: &str, x_label: &str, y_label: &str, series: &[Series]) -> String {
    xy_plot(title, x_label, y_label, &[], series)
}

/// Points; a band is drawn as an error bar on each.
pub fn scatter(title: &str, x_label: &str, y_label: &str, series: &[Series]) -> String {
    xy_plot(title, x_label, y_label, series, &[])
}

/// Points with lines through them or over them; bands as in [`scatter`] and [`lines`].
pub fn scatter_with(
    title: &str,
    x_label: &str,
    y_label: &str,
    series: &[Series],
    curves: &[Series],
) -> String {
    xy_plot(title, x_label, y_label, series, curves)
}

/// Groups of bars from zero, with error bars.
pub fn bars(title: &str, y_label: &str, groups: &[Group]) -> String {
    let all = || groups.iter().flat_map(|g| &g.bars).filter(|b| drawable(b.value));
    let mut names: Vec<&str> = Vec::new();
    for bar in groups.iter().flat_map(|g| &g.bars) {
        if !names.contains(&bar.name.as_str()) {
            names.push(&bar.name);
        }
    }
    let heights = all().flat_map(|b| {
        let (low, high) = finite_pair(b.interval).unwrap_or((b.value, b.value));
        [b.value, low, high]
    });
    let Some((low, high)) = range(heights.chain([0.0])).filter(|_| all().next().is_some()) else {
        return empty(title);
    };
    let pad = (high - low) * 0.05;
    let y = (if low < 0.0 { low - pad } else { 0.0 })..(if high > 0.0 { high + pad } else { 0.0 });
    let legend: Vec<(String, RGBColor)> =
        names.iter().enumerate().map(|(i, n)| (n.to_string(), paint(i))).collect();
    let shown = if names.len() > 1 { legend.clone() } else { Vec::new() };
    picture(title, &shown, |area| {
        let count = groups.len().max(1);
        let mut chart = ChartBuilder::on(area)
            .margin(units(8))
            .margin_top(units(4))
            .set_label_area_size(LabelAreaPosition::Left, units(label_room(&y, 6)))
            .set_label_area_size(LabelAreaPosition::Bottom, units(36))
            .build_cartesian_2d(0.0..count as f64, y.clone())?;
        chart
            .configure_mesh()
            .disable_x_mesh()
            .disable_x_axis()
            .bold_line_style(ShapeStyle::from(&GRID).stroke_width(units(1)))
            .set_all_tick_mark_size(units(4))
            .light_line_style(TRANSPARENT)
            .axis_style(ShapeStyle::from(&INK).stroke_width(units(1)))
            .y_labels(6)
            .y_label_formatter(&|v: &f64| tick(*v))
            .label_style(text(12))
            .y_desc(shortened(y_label, 60))
            .axis_desc_style(text(13))
            .draw()?;
        for (g, group) in groups.iter().enumerate() {
            let width = 0.8 / group.bars.len().max(1) as f64;
            for (i, bar) in group.bars.iter().enumerate().filter(|(_, b)| drawable(b.value)) {
                let colour = legend.iter().find(|(n, _)| *n == bar.name).map_or(INK, |(_, c)| *c);
                let left = g as f64 + 0.1 + i as f64 * width;
                let inset = width * 0.06;
                chart.draw_series([Rectangle::new(
                    [(left + inset, 0.0), (left + width - inset, bar.value)],
                    colour.filled(),
                )])?;
                if let Some((low, high)) = finite_pair(bar.interval) {
                    error_bar(&mut chart, left + width / 2.0, low, high, INK)?;
                }
            }
        }
        chart.draw_series([PathElement::new(
            vec![(0.0, 0.0), (count as f64, 0.0)],
            INK.stroke_width(units(1)),
        )])?;
        let (plot_width, _) = chart.plotting_area().dim_in_pixel();
        let most = ((f64::from(plot_width) / count as f64) / (f64::from(units(12)) * 0.56)) as usize;
        let (left, top) = area.get_base_pixel();
        for (g, group) in groups.iter().enumerate() {
            let (x, y) = chart.backend_coord(&(g as f64 + 0.5, y.start));
            let style = text(12).pos(pos(HPos::Center, VPos::Top)).color(&INK);
            for (row, part) in broken(&group.name, most.max(3)).iter().enumerate() {
                let down = (units(6) + units(15) * row as u32) as i32;
                area.draw_text(part, &style, (x - left, y - top + down))?;
            }
        }
        Ok(())
    })
}

/// Coloured cells with a scale beside them.
pub fn heatmap(title: &str, map: &Heatmap) -> String {
    heatmaps(title, std::slice::from_ref(map))
}

/// Heat maps side by side, each with a scale of its own; marks of the same place in the list have the same colour,
/// and their names are those of the first map.
pub fn heatmaps(title: &str, maps: &[Heatmap]) -> String {
    if maps.is_empty() || maps.iter().any(|m| !m.is_drawable()) {
        return empty(title);
    }
    let legend: Vec<(String, RGBColor)> =
        maps[0].marks.iter().enumerate().map(|(i, m)| (m.2.clone(), MARKS[i % MARKS.len()])).collect();
    let size = if maps.len() > 1 { (maps.len() as u32 * PANEL.0, PANEL.1) } else { SIZE };
    picture_sized(size, title, &legend, |area| {
        for (panel, map) in area.split_evenly((1, maps.len())).iter().zip(maps) {
            let inside = if maps.len() > 1 {
                let style = text(13).pos(pos(HPos::Left, VPos::Center)).color(&INK);
                panel.draw_text(&shortened(&map.title, 50), &style, (units(16) as i32, units(10) as i32))?;
                panel.margin(units(18), 0, 0, 0)
            } else {
                panel.clone()
            };
            draw_heatmap(&inside, map)?;
        }
        Ok(())
    })
}

/// Width and height of each of several heat maps, px.
const PANEL: (u32, u32) = (520, 460);

impl Heatmap {
    fn range(&self) -> Option<(f64, f64)> {
        range(self.values.iter().flatten().copied().filter(|v| drawable(*v)))
    }

    fn is_drawable(&self) -> bool {
        self.values.len() == self.y.len()
            && self.values.iter().all(|row| row.len() == self.x.len())
            && self.x.iter().chain(&self.y).all(|v| drawable(*v))
            && self.range().is_some()
    }
}

/// The cells, lines, dots and marks of one map, and its scale.
fn draw_heatmap(area: &Area, map: &Heatmap) -> Drawn {
    let Some((low, high)) = map.range() else { return Ok(()) };
    let (xs, ys) = (cell_edges(&map.x), cell_edges(&map.y));
    let (x, y) = (xs[0]..xs[xs.len() - 1], ys[0]..ys[ys.len() - 1]);
    let colours = widened((low, high), 0.0);
    let share = |v: f64| (v - colours.start) / (colours.end - colours.start);
    let (width, _) = area.dim_in_pixel();
    let (plot, scale) = area.split_horizontally(width - units(104));
    let mut chart = ChartBuilder::on(&plot)
        .margin(units(8))
        .margin_top(units(4))
        .set_label_area_size(LabelAreaPosition::Left, units(label_room(&y, 6)))
        .set_label_area_size(LabelAreaPosition::Bottom, units(44))
        .build_cartesian_2d(x.clone(), y.clone())?;
    let mut mesh = chart.configure_mesh();
    mesh.disable_mesh();
    finish_axes(&mut mesh, &map.x_label, &map.y_label)?;
    for (row, values) in map.values.iter().enumerate() {
        for (column, v) in values.iter().enumerate() {
            let colour = if drawable(*v) { heat(share(*v)) } else { RGBColor(205, 205, 205) };
            // Each cell reaches under its right and upper neighbours, drawn later: no seams.
            let far = [
                (xs[column + 1] + xs[(column + 2).min(map.x.len())]) / 2.0,
                (ys[row + 1] + ys[(row + 2).min(map.y.len())]) / 2.0,
            ];
            chart
                .draw_series([Rectangle::new([(xs[column], ys[row]), (far[0], far[1])], colour.filled())])?;
        }
    }
    let ticks = levels(low, high, map.contours);
    for level in &ticks {
        for line in contour(map, *level) {
            let style = WHITE.mix(0.75).stroke_width(units(1));
            chart.draw_series([PathElement::new(line.to_vec(), style)])?;
        }
    }
    let inside = |p: &&(f64, f64)| x.contains(&p.0) && y.contains(&p.1);
    for dot in map.dots.iter().filter(inside) {
        chart.draw_series([
            Circle::new(*dot, units(3), WHITE.filled()),
            Circle::new(*dot, units(2), INK.filled()),
        ])?;
    }
    for (i, (mx, my, _)) in map.marks.iter().enumerate() {
        if x.contains(mx) && y.contains(my) {
            let colour = MARKS[i % MARKS.len()];
            chart.draw_series([
                Circle::new((*mx, *my), units(7), WHITE.filled()),
                Circle::new((*mx, *my), units(5), colour.filled()),
            ])?;
        }
    }
    let mut bar = ChartBuilder::on(&scale)
        .margin(units(8))
        .margin_top(units(4))
        .margin_bottom(units(52))
        .set_label_area_size(LabelAreaPosition::Right, units(66))
        .build_cartesian_2d(0.0..1.0, colours.clone())?;
    const STEPS: u32 = 64;
    for k in 0..STEPS {
        let from = f64::from(k) / f64::from(STEPS);
        let bottom = colours.start + from * (colours.end - colours.start);
        let shade = heat(from + 0.5 / f64::from(STEPS)).filled();
        bar.draw_series([Rectangle::new([(0.0, bottom), (1.0, colours.end)], shade)])?;
    }
    for level in &ticks {
        let style = WHITE.mix(0.75).stroke_width(units(1));
        bar.draw_series([PathElement::new(vec![(0.0, *level), (1.0, *level)], style)])?;
    }
    bar.configure_mesh()
        .disable_mesh()
        .disable_x_axis()
        .axis_style(ShapeStyle::from(&INK).stroke_width(units(1)))
        .set_all_tick_mark_size(units(4))
        .y_labels(6)
        .y_label_formatter(&|v: &f64| tick(*v))
        .label_style(text(12))
        .y_desc(shortened(&map.value_label, 60))
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

/// Pieces of the line where the map has a value: marching squares between the cells' centres, saddles cut one way.
fn contour(map: &Heatmap, level: f64) -> Vec<[(f64, f64); 2]> {
    let mut pieces = Vec::new();
    for r in 0..map.y.len().saturating_sub(1) {
        for c in 0..map.x.len().saturating_sub(1) {
            let corners = [(r, c), (r, c + 1), (r + 1, c + 1), (r + 1, c)];
            let values = corners.map(|(r, c)| map.values[r][c]);
            if values.iter().any(|v| !drawable(*v)) {
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

/// Size of a plot, px.
const SIZE: (u32, u32) = (720, 440);
/// plotters counts in whole pixels: plots are drawn this many times as large and shown at their size.
const FINE: u32 = 4;
const INK: RGBColor = RGBColor(0x33, 0x37, 0x3D);
const GRID: RGBColor = RGBColor(0xE3, 0xE6, 0xEA);
/// Colours of marks on a heat map: seen on every shade of it.
const MARKS: [RGBColor; 4] = [
    RGBColor(0xD5, 0x1F, 0x3A),
    RGBColor(0x00, 0x72, 0xB2),
    RGBColor(0x11, 0x11, 0x11),
    RGBColor(0xCC, 0x79, 0xA7),
];

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn = Result<(), Box<dyn std::error::Error>>;

fn xy_plot(title: &str, x_label: &str, y_label: &str, clouds: &[Series], curves: &[Series]) -> String {
    let clean: Vec<Series> = clouds.iter().chain(curves).map(finite_only).collect();
    let joined = |i: usize| i >= clouds.len();
    let xs = clean.iter().flat_map(|s| s.points.iter().map(|p| p.0));
    let ys = clean.iter().flat_map(|s| {
        let bands = s.band.iter().flatten().flat_map(|b| [b.0, b.1]);
        s.points.iter().map(|p| p.1).chain(bands.collect::<Vec<_>>())
    });
    let (Some(x), Some(y)) = (range(xs), range(ys)) else {
        return empty(title);
    };
    let (x, y) = (widened(x, if clouds.is_empty() { 0.0 } else { 0.04 }), widened(y, 0.05));
    let legend: Vec<(String, RGBColor)> =
        clean.iter().enumerate().map(|(i, s)| (s.name.clone(), paint(i))).collect();
    let shown = if clean.len() > 1 { legend } else { Vec::new() };
    picture(title, &shown, |area| {
        let mut chart = gridded(area, &x, &y, x_label, y_label)?;
        for (i, s) in clean.iter().enumerate() {
            draw_band(&mut chart, s, paint(i), joined(i))?;
        }
        for (i, s) in clean.iter().enumerate() {
            let colour = paint(i);
            if joined(i) {
                chart.draw_series([PathElement::new(s.points.clone(), colour.stroke_width(units(2)))])?;
            }
            if !joined(i) || (clouds.is_empty() && s.points.len() <= 30) {
                let size = units(3);
                chart
                    .draw_series(s.points.iter().map(|p| Circle::new(*p, size, colour.mix(0.85).filled())))?;
            }
        }
        Ok(())
    })
}

/// Axes with their labels, and a grid.
fn gridded<'a, 'b>(
    area: &'a Area<'b>,
    x: &Range<f64>,
    y: &Range<f64>,
    x_label: &str,
    y_label: &str,
) -> Result<Chart<'a, 'b>, Box<dyn std::error::Error>> {
    let mut chart = ChartBuilder::on(area)
        .margin(units(8))
        .margin_top(units(4))
        .margin_right(units(20))
        .set_label_area_size(LabelAreaPosition::Left, units(label_room(y, 6)))
        .set_label_area_size(LabelAreaPosition::Bottom, units(44))
        .build_cartesian_2d(x.clone(), y.clone())?;
    let mut mesh = chart.configure_mesh();
    mesh.bold_line_style(ShapeStyle::from(&GRID).stroke_width(units(1))).light_line_style(TRANSPARENT);
    finish_axes(&mut mesh, x_label, y_label)?;
    drop(mesh);
    Ok(chart)
}

fn draw_band(chart: &mut Chart, s: &Series, colour: RGBColor, joined: bool) -> Drawn {
    let Some(band) = &s.band else { return Ok(()) };
    if joined {
        let low = s.points.iter().zip(band).map(|(p, b)| (p.0, b.0));
        let high = s.points.iter().zip(band).map(|(p, b)| (p.0, b.1));
        let ring: Vec<(f64, f64)> = low.chain(high.rev()).collect();
        chart.draw_series([Polygon::new(ring, colour.mix(0.2).filled())])?;
    } else {
        for (p, b) in s.points.iter().zip(band) {
            error_bar(chart, p.0, b.0, b.1, colour)?;
        }
    }
    Ok(())
}

fn error_bar(chart: &mut Chart, x: f64, low: f64, high: f64, colour: RGBColor) -> Drawn {
    let style = colour.stroke_width(units(1) + units(1) / 2);
    let (range, (width, _)) = (chart.x_range(), chart.plotting_area().dim_in_pixel());
    let cap = (range.end - range.start) * f64::from(units(4)) / f64::from(width.max(1));
    chart.draw_series([
        PathElement::new(vec![(x, low), (x, high)], style),
        PathElement::new(vec![(x - cap, low), (x + cap, low)], style),
        PathElement::new(vec![(x - cap, high), (x + cap, high)], style),
    ])?;
    Ok(())
}

fn finish_axes(
    mesh: &mut plotters::chart::MeshStyle<RangedCoordf64, RangedCoordf64, SVGBackend>,
    x_label: &str,
    y_label: &str,
) -> Drawn {
    mesh.axis_style(ShapeStyle::from(&INK).stroke_width(units(1)))
        .set_all_tick_mark_size(units(4))
        .x_labels(8)
        .y_labels(6)
        .x_label_formatter(&|v: &f64| tick(*v))
        .y_label_formatter(&|v: &f64| tick(*v))
        .label_style(text(12))
        .x_desc(shortened(x_label, 90))
        .y_desc(shortened(y_label, 60))
        .axis_desc_style(text(13))
        .draw()?;
    Ok(())
}

/// Title, legend, and what `draw` puts under them.
fn picture(title: &str, legend: &[(String, RGBColor)], draw: impl FnOnce(&Area) -> Drawn) -> String {
    picture_sized(SIZE, title, legend, draw)
}

/// [`picture`] of a size in px.
fn picture_sized(
    size: (u32, u32),
    title: &str,
    legend: &[(String, RGBColor)],
    draw: impl FnOnce(&Area) -> Drawn,
) -> String {
    let mut svg = String::new();
    let drawn = (|| -> Drawn {
        let root = SVGBackend::with_string(&mut svg, (size.0 * FINE, size.1 * FINE)).into_drawing_area();
        root.fill(&WHITE)?;
        let heading = text(16).pos(pos(HPos::Left, VPos::Center)).color(&INK);
        root.draw_text(
            &shortened(title, (size.0 * 84 / SIZE.0) as usize),
            &heading,
            (units(14) as i32, units(18) as i32),
        )?;
        let bottom = draw_legend(&root, legend, 32, size.0)?;
        let (_, under) = root.split_vertically(units(bottom));
        draw(&under)?;
        root.present()?;
        Ok(())
    })();
    match drawn {
        Ok(()) => shown_at_size(&svg, size, title),
        // A range that plotters cannot divide; said rather than hidden.
        Err(e) => notice(title, &format!("this plot could not be drawn: {e}")),
    }
}

/// Draws the legend in rows from `top` px down; returns where the plot may begin, px.
fn draw_legend(
    root: &Area,
    legend: &[(String, RGBColor)],
    top: u32,
    width: u32,
) -> Result<u32, Box<dyn std::error::Error>> {
    let named: Vec<(String, RGBColor)> =
        legend.iter().filter(|(n, _)| !n.is_empty()).map(|(n, c)| (shortened(n, 60), *c)).collect();
    let (mut x, mut y) = (16, top);
    for (name, colour) in &named {
        let wide = 22 + (name.chars().count() as f64 * 12.0 * 0.54) as u32 + 16;
        if x > 16 && x + wide > width {
            (x, y) = (16, y + 18);
        }
        let (left, middle) = (units(x) as i32, units(y + 8) as i32);
        let half = units(5) as i32;
        root.draw(&Rectangle::new(
            [(left, middle - half), (left + 2 * half, middle + half)],
            colour.filled(),
        ))?;
        let style = text(12).pos(pos(HPos::Left, VPos::Center)).color(&INK);
        root.draw_text(name, &style, (left + units(16) as i32, middle))?;
        x += wide;
    }
    Ok(if named.is_empty() { top } else { y + 20 })
}

/// The drawing at a quarter of its coordinates, scaling down on narrow screens.
fn shown_at_size(svg: &str, size: (u32, u32), title: &str) -> String {
    let inside = svg.split_once('>').map_or("", |(_, rest)| rest).trim_start();
    let inside = inside.trim_end().strip_suffix("</svg>").unwrap_or(inside);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" viewBox=\"0 0 {} {}\" \
         role=\"img\">\n<title>{}</title>\n{inside}</svg>\n",
        size.0,
        size.1,
        size.0 * FINE,
        size.1 * FINE,
        escape(title)
    )
}

fn empty(title: &str) -> String {
    notice(title, "no data to plot")
}

/// A plot's frame with a sentence in it.
fn notice(title: &str, sentence: &str) -> String {
    let (w, h) = SIZE;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" \
         role=\"img\">\n<title>{t}</title>\n<rect width=\"{w}\" height=\"{h}\" fill=\"#FFFFFF\"/>\n\
         <rect x=\"14\" y=\"34\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#C5CAD0\"/>\n\
         <text x=\"14\" y=\"23\" font-family=\"sans-serif\" font-size=\"16\" fill=\"#33373D\">{t}</text>\n\
         <text x=\"{}\" y=\"{}\" text-anchor=\"middle\" font-family=\"sans-serif\" font-size=\"14\" \
         fill=\"#666C75\">{}</text>\n</svg>\n",
        w - 28,
        h - 48,
        w / 2,
        h / 2,
        escape(sentence),
        t = escape(&shortened(title, 84)),
    )
}

fn units(px: u32) -> u32 {
    px * FINE
}

/// Text of `px` height; plotters draws a font of size s at s / 1.24.
fn text(px: u32) -> TextStyle<'static> {
    ("sans-serif", f64::from(units(px)) * 1.24).into_font().color(&INK)
}

fn pos(h: HPos, v: VPos) -> Pos {
    Pos::new(h, v)
}

/// The palette's colours, and darker each time round.
fn paint(index: usize) -> RGBColor {
    // Blue first: the best contrast for the plot of one series.
    const ORDER: [usize; 7] = [1, 0, 3, 4, 2, 5, 6];
    let round = (index / ORDER.len()) as i32;
    let shade = |c: u8| (f64::from(c) * 0.5f64.powi(round)) as u8;
    let [r, g, b] = channels(PALETTE[ORDER[index % ORDER.len()]]).map(shade);
    RGBColor(r, g, b)
}

/// The heat scale's colour for a share from 0 to 1, as `#RRGGBB`.
pub(super) fn heat_colour(share: f64) -> String {
    let RGBColor(r, g, b) = heat(share);
    format!("#{r:02X}{g:02X}{b:02X}")
}

/// Dark blue over green to yellow for 0 to 1; corner points read off the viridis map (Smith and van der Walt).
fn heat(share: f64) -> RGBColor {
    const STOPS: [[f64; 3]; 6] = [
        [68.0, 1.0, 84.0],
        [65.0, 68.0, 135.0],
        [42.0, 120.0, 142.0],
        [34.0, 168.0, 132.0],
        [122.0, 209.0, 81.0],
        [253.0, 231.0, 37.0],
    ];
    let s = share.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let k = (s as usize).min(STOPS.len() - 2);
    let mix = |c: usize| (STOPS[k][c] + (s - k as f64) * (STOPS[k + 1][c] - STOPS[k][c])).round() as u8;
    RGBColor(mix(0), mix(1), mix(2))
}

/// A number under a tick mark: short, without the noise of binary fractions.
fn tick(v: f64) -> String {
    let size = v.abs();
    if size < 1e-12 {
        "0".into()
    } else if !(1e-3..1e5).contains(&size) {
        let text = format!("{v:.2e}");
        match text.split_once('e') {
            Some((m, e)) if m.contains('.') => {
                format!("{}e{e}", m.trim_end_matches('0').trim_end_matches('.'))
            }
            _ => text,
        }
    } else if size < 0.1 {
        decimals(v, 5)
    } else if size < 100.0 {
        decimals(v, 3)
    } else {
        decimals(v, 1)
    }
}

/// Room for the numbers and the description beside an axis, px.
fn label_room(y: &std::ops::Range<f64>, ticks: usize) -> u32 {
    use plotters::coord::ranged1d::Ranged;
    let axis: RangedCoordf64 = y.clone().into();
    let longest = axis.key_points(ticks).into_iter().map(|v| tick(v).chars().count()).max().unwrap_or(4);
    34 + 7 * longest as u32
}

fn shortened(text: &str, most: usize) -> String {
    let text = &cleaned(text);
    if text.chars().count() <= most {
        return text.to_string();
    }
    text.chars().take(most.saturating_sub(1)).chain(['\u{2026}']).collect()
}

/// The text in up to two lines of at most `most` characters, broken at a space where there is one.
fn broken(text: &str, most: usize) -> Vec<String> {
    let text = &cleaned(text);
    if text.chars().count() <= most {
        return vec![text.to_string()];
    }
    let end = text.char_indices().nth(most + 1).map_or(text.len(), |(i, _)| i);
    match text[..end].rfind(' ').filter(|i| *i > 0) {
        Some(i) => vec![text[..i].to_string(), shortened(text[i..].trim_start(), most)],
        None => vec![shortened(text, most)],
    }
}

fn finite_only(s: &Series) -> Series {
    let kept: Vec<usize> =
        (0..s.points.len()).filter(|i| drawable(s.points[*i].0) && drawable(s.points[*i].1)).collect();
    // Where a band is missing it has no width.
    let around = |b: &Vec<(f64, f64)>, i: usize| {
        finite_pair(b.get(i).copied()).unwrap_or((s.points[i].1, s.points[i].1))
    };
    Series {
        name: s.name.clone(),
        points: kept.iter().map(|i| s.points[*i]).collect(),
        band: s.band.as_ref().map(|b| kept.iter().map(|i| around(b, *i)).collect()),
    }
}

/// Whether a value can stand on an axis; beyond 1e100 the arithmetic of axes overflows.
fn drawable(v: f64) -> bool {
    v.abs() <= 1e100
}

fn finite_pair(pair: Option<(f64, f64)>) -> Option<(f64, f64)> {
    pair.filter(|(low, high)| drawable(*low) && drawable(*high))
}

/// Smallest and largest of the finite values; none if there is none.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values
        .filter(|v| drawable(*v))
        .fold(None, |r, v| Some(r.map_or((v, v), |(low, high): (f64, f64)| (low.min(v), high.max(v)))))
}

/// The range with `share` of its length added at both ends, and some length in any case.
fn widened((low, high): (f64, f64), share: f64) -> std::ops::Range<f64> {
    let length = high - low;
    // Numbers that differ by less cannot be told apart on an axis.
    let least = low.abs().max(high.abs()).max(1e-9) * 1e-9;
    if length <= least {
        let pad = low.abs().max(1.0) * 0.5;
        return low - pad..high + pad;
    }
    low - share * length..high + share * length
}

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
    use crate::picture::scene::tests::check_svg;
    use resvg::usvg::roxmltree::Document;

    fn series(name: &str, points: &[(f64, f64)]) -> Series {
        Series { name: name.into(), points: points.to_vec(), band: None }
    }
    fn group(name: &str, values: &[f64]) -> Group {
        let bar = |(i, v): (usize, &f64)| Bar {
            name: format!("b{i}"),
            value: *v,
            interval: Some((v - 1.0, v + 1.0)),
        };
        Group { name: name.into(), bars: values.iter().enumerate().map(bar).collect() }
    }
    fn square(values: Vec<Vec<f64>>) -> Heatmap {
        let centres = |n: usize| (0..n).map(|i| i as f64).collect();
        let columns = values.first().map_or(0, Vec::len);
        Heatmap { x: centres(columns), y: centres(values.len()), values, ..Heatmap::default() }
    }

    #[test]
    fn many_series_have_colours_of_their_own() {
        let colours: Vec<RGBColor> = (0..20).map(paint).collect();
        for (i, one) in colours.iter().enumerate() {
            assert!(colours[i + 1..].iter().all(|other| other != one), "{i}: {one:?}");
        }
    }

    #[test]
    fn lines_of_equal_value_lie_where_the_value_is() {
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

    #[test]
    fn maps_side_by_side_have_titles_dots_and_a_scale_each() {
        let map = |title: &str| Heatmap {
            title: title.into(),
            x: vec![0.0, 1.0],
            y: vec![0.0, 1.0],
            values: vec![vec![0.0, 1.0], vec![2.0, 3.0]],
            dots: vec![(0.25, 0.5), (7.0, 7.0)],
            value_label: "height, m".into(),
            ..Heatmap::default()
        };
        let drawn = heatmaps("two", &[map("left"), map("right")]);
        assert!(drawn.contains("left") && drawn.contains("right"));
        assert_eq!(drawn.matches("height, m").count(), 2);
        // One dot each, of two circles; what lies outside is left out.
        assert_eq!(drawn.matches("<circle").count(), 4);
        let broken = Heatmap { values: vec![], ..map("broken") };
        assert!(heatmaps("none", &[map("left"), broken]).contains("no data to plot"));
        assert!(heatmaps("none", &[]).contains("no data to plot"));
    }

    #[test]
    fn plots_of_nothing_say_so() {
        let nan = f64::NAN;
        let none = [
            lines("t", "x", "y", &[]),
            lines("t", "x", "y", &[series("a", &[(nan, 1.0), (1.0, f64::INFINITY)])]),
            scatter("t", "x", "y", &[series("a", &[])]),
            bars("t", "y", &[]),
            bars("t", "y", &[group("g", &[nan, nan])]),
            heatmap("t", &Heatmap::default()),
            heatmap("t", &square(vec![vec![nan, nan]])),
            heatmap("t", &Heatmap { x: vec![1.0], ..square(vec![vec![1.0, 2.0]]) }),
        ];
        for svg in none {
            assert!(svg.contains("no data to plot"), "{svg}");
            check_svg(&svg);
        }
    }

    #[test]
    fn what_is_not_finite_is_left_out() {
        let clean = [(0.0, 1.0), (1.0, 2.0), (2.0, 0.5)];
        let dirty = [(0.0, 1.0), (0.5, f64::NAN), (1.0, 2.0), (f64::NEG_INFINITY, 1.0), (2.0, 0.5)];
        for draw in [lines, scatter] {
            let (a, b) =
                (draw("t", "x", "y", &[series("a", &clean)]), draw("t", "x", "y", &[series("a", &dirty)]));
            assert_eq!(a, b);
            check_svg(&a);
        }
        check_svg(&bars("t", "y", &[group("g", &[1.0, f64::NAN, -2.0])]));
        check_svg(&heatmap("t", &square(vec![vec![1.0, f64::NAN], vec![f64::INFINITY, 2.0]])));
    }

    #[test]
    fn bars_are_as_high_as_their_values() {
        let svg = bars("t", "y", &[group("g", &[1.0, 3.0])]);
        let document = Document::parse(&svg).unwrap();
        let height = |fill: RGBColor| -> f64 {
            let fill = format!("#{:02X}{:02X}{:02X}", fill.0, fill.1, fill.2);
            let found =
                document.descendants().filter(|n| n.has_tag_name(("http://www.w3.org/2000/svg", "rect")));
            let tall = found.filter(|n| n.attribute("fill") == Some(&fill));
            tall.map(|n| n.attribute("height").unwrap().parse::<f64>().unwrap()).fold(0.0, f64::max)
        };
        let ratio = height(paint(1)) / height(paint(0));
        assert!((ratio - 3.0).abs() < 0.02, "{ratio}");
    }

    #[test]
    fn hostile_text_is_escaped_and_bytes_repeat() {
        let bad = "</text><script>alert(\"1\")</script>&\u{0}\u{1F600}";
        let draw = || {
            [
                lines(bad, bad, bad, &[series(bad, &[(0.0, 1.0), (1.0, 2.0)]), series(bad, &[(0.0, 0.0)])]),
                bars(bad, bad, &[group(bad, &[1.0, 2.0])]),
                heatmap(
                    bad,
                    &Heatmap {
                        x_label: bad.into(),
                        value_label: bad.into(),
                        marks: vec![(0.0, 0.0, bad.into())],
                        ..square(vec![vec![1.0, 2.0]])
                    },
                ),
            ]
        };
        assert_eq!(draw(), draw());
        draw().iter().for_each(|svg| check_svg(svg));
    }

    #[test]
    fn ranges_of_any_size_are_drawn() {
        let ends = [
            (0.0, 0.0),
            (1.0, 1.0 + 1e-13),
            (1e15, 1e15 + 0.25),
            (-1e99, 1e99),
            (1e-300, 2e-300),
            (-5e-10, 5e-10),
            (1e200, 2e200),
            (-3.0, -2.999_999_9),
        ];
        for (low, high) in ends {
            for (a, b) in ends {
                let s = [series("a", &[(low, a), (high, b)])];
                check_svg(&lines("t", "x", "y", &s));
                check_svg(&scatter("t", "x", "y", &s));
            }
            check_svg(&bars("t", "y", &[group("g", &[low, high])]));
            check_svg(&heatmap("t", &square(vec![vec![low, high]])));
        }
    }

    #[test]
    fn tick_numbers_are_short() {
        let check = |v: f64, wanted: &str| assert_eq!(tick(v), wanted);
        check(0.1 + 0.2, "0.3");
        check(-0.0, "0");
        check(1500.0, "1500");
        check(2.5e-7, "2.5e-7");
        check(1e6, "1e6");
        check(0.002, "0.002");
    }
}
