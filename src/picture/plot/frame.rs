//! Common parts of plots: size, title, legend, axes, error bars.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::scale::{label_width, tick, token_colour};
use crate::picture::svg::{cleaned, escape};
use crate::picture::theme::light;

/// Size of a plot, px.
pub(super) const PLOT_SIZE_PX: (u32, u32) = (720, 440);
/// Size of a panel of several plots, px.
pub const PANEL_SIZE_PX: (u32, u32) = (500, 300);
/// Supersampling: plotters rounds to whole pixels, so plots are drawn this many times as large and scaled down.
pub(super) const SUPERSAMPLING: u32 = 4;
/// Colour of text and axes.
pub(super) fn ink() -> RGBColor {
    token_colour("ink")
}

pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub(super) type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
pub(super) type DrawResult = Result<(), Box<dyn std::error::Error>>;

/// A plot with title, legend and the contents that `draw` adds.
pub(super) fn plot_svg(
    title: &str,
    legend: &[(String, RGBColor)],
    draw: impl FnOnce(&Area) -> DrawResult,
) -> String {
    plot_svg_sized(PLOT_SIZE_PX, title, legend, draw)
}

/// A plot of a given size, px.
pub(super) fn plot_svg_sized(
    size: (u32, u32),
    title: &str,
    legend: &[(String, RGBColor)],
    draw: impl FnOnce(&Area) -> DrawResult,
) -> String {
    let mut svg = String::new();
    let drawn = (|| -> DrawResult {
        let root = SVGBackend::with_string(&mut svg, (size.0 * SUPERSAMPLING, size.1 * SUPERSAMPLING))
            .into_drawing_area();
        root.fill(&token_colour("scene"))?;
        let heading = text(16).pos(pos(HPos::Left, VPos::Center));
        root.draw_text(
            &truncate(title, (size.0 * 84 / PLOT_SIZE_PX.0) as usize),
            &heading,
            (subpixels(14) as i32, subpixels(18) as i32),
        )?;
        let bottom = draw_legend(&root, legend, 32, size.0)?;
        let (_, under) = root.split_vertically(subpixels(bottom));
        draw(&under)?;
        root.present()?;
        Ok(())
    })();
    match drawn {
        Ok(()) => scale_to_size(&svg, size, title),
        // A range that plotters can't divide.
        Err(e) => notice(title, &format!("this plot could not be drawn: {e}")),
    }
}

/// Draws the legend in rows from `top` px down; returns where the plot may begin, px.
pub(super) fn draw_legend(
    root: &Area,
    legend: &[(String, RGBColor)],
    top: u32,
    width: u32,
) -> Result<u32, Box<dyn std::error::Error>> {
    let named: Vec<(String, RGBColor)> =
        legend.iter().filter(|(n, _)| !n.is_empty()).map(|(n, c)| (truncate(n, 60), *c)).collect();
    let (mut x, mut y) = (16, top);
    for (name, colour) in &named {
        let wide = 22 + (name.chars().count() as f64 * 12.0 * 0.54) as u32 + 16;
        if x > 16 && x + wide > width {
            (x, y) = (16, y + 18);
        }
        let (left, middle) = (subpixels(x) as i32, subpixels(y + 8) as i32);
        let half = subpixels(5) as i32;
        root.draw(&Rectangle::new(
            [(left, middle - half), (left + 2 * half, middle + half)],
            colour.filled(),
        ))?;
        let style = text(12).pos(pos(HPos::Left, VPos::Center));
        root.draw_text(name, &style, (left + subpixels(16) as i32, middle))?;
        x += wide;
    }
    Ok(if named.is_empty() { top } else { y + 20 })
}

/// Scales the drawing to its nominal size; it shrinks on narrow screens.
pub(super) fn scale_to_size(svg: &str, size: (u32, u32), title: &str) -> String {
    let inside = svg.split_once('>').map_or("", |(_, rest)| rest).trim_start();
    let inside = inside.trim_end().strip_suffix("</svg>").unwrap_or(inside);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" viewBox=\"0 0 {} {}\" \
         role=\"img\">\n<title>{}</title>\n{inside}</svg>\n",
        size.0,
        size.1,
        size.0 * SUPERSAMPLING,
        size.1 * SUPERSAMPLING,
        escape(title)
    )
}

pub(super) fn empty(title: &str) -> String {
    notice(title, "no data to plot")
}

/// An empty plot with a sentence in it.
pub(super) fn notice(title: &str, sentence: &str) -> String {
    let (w, h) = PLOT_SIZE_PX;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" \
         role=\"img\">\n<title>{t}</title>\n<rect width=\"{w}\" height=\"{h}\" fill=\"{scene}\"/>\n\
         <rect x=\"14\" y=\"34\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"{line}\"/>\n\
         <text x=\"14\" y=\"23\" font-family=\"sans-serif\" font-size=\"16\" fill=\"{ink}\">{t}</text>\n\
         <text x=\"{}\" y=\"{}\" text-anchor=\"middle\" font-family=\"sans-serif\" font-size=\"14\" \
         fill=\"{soft}\">{}</text>\n</svg>\n",
        w - 28,
        h - 48,
        w / 2,
        h / 2,
        escape(sentence),
        t = escape(&truncate(title, 84)),
        scene = light("scene"),
        line = light("line"),
        ink = light("ink"),
        soft = light("soft"),
    )
}

/// Axes with their labels, and a grid.
pub(super) fn chart_with_grid<'a, 'b>(
    area: &'a Area<'b>,
    x: &Range<f64>,
    y: &Range<f64>,
    x_label: &str,
    y_label: &str,
) -> Result<Chart<'a, 'b>, Box<dyn std::error::Error>> {
    let mut chart = ChartBuilder::on(area)
        .margin(subpixels(8))
        .margin_top(subpixels(4))
        .margin_right(subpixels(20))
        .set_label_area_size(LabelAreaPosition::Left, subpixels(label_width(y, 6)))
        .set_label_area_size(LabelAreaPosition::Bottom, subpixels(44))
        .build_cartesian_2d(x.clone(), y.clone())?;
    let mut mesh = chart.configure_mesh();
    mesh.bold_line_style(ShapeStyle::from(&token_colour("line")).stroke_width(subpixels(1)))
        .light_line_style(TRANSPARENT);
    finish_axes(&mut mesh, x_label, y_label)?;
    drop(mesh);
    Ok(chart)
}

pub(super) fn finish_axes(
    mesh: &mut plotters::chart::MeshStyle<RangedCoordf64, RangedCoordf64, SVGBackend>,
    x_label: &str,
    y_label: &str,
) -> DrawResult {
    mesh.axis_style(ShapeStyle::from(&ink()).stroke_width(subpixels(1)))
        .set_all_tick_mark_size(subpixels(4))
        .x_labels(8)
        .y_labels(6)
        .x_label_formatter(&|v: &f64| tick(*v))
        .y_label_formatter(&|v: &f64| tick(*v))
        .label_style(text(12))
        .x_desc(truncate(x_label, 90))
        .y_desc(truncate(y_label, 60))
        .axis_desc_style(text(13))
        .draw()?;
    Ok(())
}

pub(super) fn error_bar(chart: &mut Chart, x: f64, low: f64, high: f64, colour: RGBColor) -> DrawResult {
    let style = colour.stroke_width(subpixels(1) + subpixels(1) / 2);
    let (range, (width, _)) = (chart.x_range(), chart.plotting_area().dim_in_pixel());
    let cap = (range.end - range.start) * f64::from(subpixels(4)) / f64::from(width.max(1));
    chart.draw_series([
        PathElement::new(vec![(x, low), (x, high)], style),
        PathElement::new(vec![(x - cap, low), (x + cap, low)], style),
        PathElement::new(vec![(x - cap, high), (x + cap, high)], style),
    ])?;
    Ok(())
}

pub(super) fn subpixels(px: u32) -> u32 {
    px * SUPERSAMPLING
}

/// Text of `px` height; plotters draws a font of size s at s / 1.24.
pub(super) fn text(px: u32) -> TextStyle<'static> {
    ("sans-serif", f64::from(subpixels(px)) * 1.24).into_font().color(&ink())
}

pub(super) fn pos(h: HPos, v: VPos) -> Pos {
    Pos::new(h, v)
}

pub(super) fn truncate(text: &str, most: usize) -> String {
    let text = &cleaned(text);
    if text.chars().count() <= most {
        return text.to_string();
    }
    text.chars().take(most.saturating_sub(1)).chain(['\u{2026}']).collect()
}
