//! Bars in groups.

use std::ops::Range;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use super::frame::{
    Area, Chart, DrawResult, empty, error_bar, ink, plot_svg, pos, subpixels, text, truncate,
};
use super::scale::{finite_pair, is_drawable, label_width, range, series_colour, tick, token_colour};
use crate::picture::svg::cleaned;

/// Bars under a common label.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BarGroup {
    /// Shown under the bars.
    pub name: String,
    /// The bars; those of the same name have the same colour in all groups.
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

/// Groups of bars from zero, with error bars.
pub fn bars(title: &str, y_label: &str, groups: &[BarGroup]) -> String {
    let all = || groups.iter().flat_map(|g| &g.bars).filter(|b| is_drawable(b.value));
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
        names.iter().enumerate().map(|(i, n)| (n.to_string(), series_colour(i))).collect();
    let shown = if names.len() > 1 { legend.clone() } else { Vec::new() };
    plot_svg(title, &shown, |area| {
        let mut chart = frame(area, groups.len().max(1), &y, y_label)?;
        for (g, group) in groups.iter().enumerate() {
            let colour = |name: &str| legend.iter().find(|(n, _)| n == name).map_or(ink(), |(_, c)| *c);
            draw_group(&mut chart, g, group, &colour)?;
        }
        let count = groups.len().max(1) as f64;
        let ground = PathElement::new(vec![(0.0, 0.0), (count, 0.0)], ink().stroke_width(subpixels(1)));
        chart.draw_series([ground])?;
        write_names(area, &chart, groups, y.start)
    })
}

/// Axes for `count` groups, with ticks and grid lines for the heights only.
fn frame<'a, 'b>(
    area: &'a Area<'b>,
    count: usize,
    y: &Range<f64>,
    y_label: &str,
) -> Result<Chart<'a, 'b>, Box<dyn std::error::Error>> {
    let mut chart = ChartBuilder::on(area)
        .margin(subpixels(8))
        .margin_top(subpixels(4))
        .set_label_area_size(LabelAreaPosition::Left, subpixels(label_width(y, 6)))
        .set_label_area_size(LabelAreaPosition::Bottom, subpixels(36))
        .build_cartesian_2d(0.0..count as f64, y.clone())?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .disable_x_axis()
        .bold_line_style(ShapeStyle::from(&token_colour("line")).stroke_width(subpixels(1)))
        .set_all_tick_mark_size(subpixels(4))
        .light_line_style(TRANSPARENT)
        .axis_style(ShapeStyle::from(&ink()).stroke_width(subpixels(1)))
        .y_labels(6)
        .y_label_formatter(&|v: &f64| tick(*v))
        .label_style(text(12))
        .y_desc(truncate(y_label, 60))
        .axis_desc_style(text(13))
        .draw()?;
    Ok(chart)
}

/// Draws the bars of group `g` with their error bars.
fn draw_group(
    chart: &mut Chart,
    g: usize,
    group: &BarGroup,
    colour: &dyn Fn(&str) -> RGBColor,
) -> DrawResult {
    let width = 0.8 / group.bars.len().max(1) as f64;
    for (i, bar) in group.bars.iter().enumerate().filter(|(_, b)| is_drawable(b.value)) {
        let left = g as f64 + 0.1 + i as f64 * width;
        let inset = width * 0.06;
        chart.draw_series([Rectangle::new(
            [(left + inset, 0.0), (left + width - inset, bar.value)],
            colour(&bar.name).filled(),
        )])?;
        if let Some((low, high)) = finite_pair(bar.interval) {
            error_bar(chart, left + width / 2.0, low, high, ink())?;
        }
    }
    Ok(())
}

/// Draws the groups' names under the plot, whose lower edge is at `bottom`.
fn write_names(area: &Area, chart: &Chart, groups: &[BarGroup], bottom: f64) -> DrawResult {
    let (plot_width, _) = chart.plotting_area().dim_in_pixel();
    let count = groups.len().max(1) as f64;
    let most = ((f64::from(plot_width) / count) / (f64::from(subpixels(12)) * 0.56)) as usize;
    let (left, top) = area.get_base_pixel();
    for (g, group) in groups.iter().enumerate() {
        let (x, y) = chart.backend_coord(&(g as f64 + 0.5, bottom));
        let style = text(12).pos(pos(HPos::Center, VPos::Top));
        for (row, part) in wrap(&group.name, most.max(3)).iter().enumerate() {
            let down = (subpixels(6) + subpixels(15) * row as u32) as i32;
            area.draw_text(part, &style, (x - left, y - top + down))?;
        }
    }
    Ok(())
}

/// Wraps text into up to two lines of at most `most` characters, at a space if possible.
fn wrap(text: &str, most: usize) -> Vec<String> {
    let text = &cleaned(text);
    if text.chars().count() <= most {
        return vec![text.to_string()];
    }
    let end = text.char_indices().nth(most + 1).map_or(text.len(), |(i, _)| i);
    match text[..end].rfind(' ').filter(|i| *i > 0) {
        Some(i) => vec![text[..i].to_string(), truncate(text[i..].trim_start(), most)],
        None => vec![truncate(text, most)],
    }
}
