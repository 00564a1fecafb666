//! Lines with bands and points with error bars.

use plotters::element::DashedPathElement;
use plotters::prelude::*;

use super::frame::{
    Chart, DrawResult, PLOT_SIZE_PX, chart_with_grid, empty, error_bar, plot_svg_sized, subpixels,
};
use super::scale::{extend, finite_pair, is_drawable, range, series_colour, token_colour};
use crate::picture::theme::Meaning;

/// One line or cloud of points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Shown in the legend.
    pub name: String,
    /// (x, y) in the units of the axes.
    pub points: Vec<(f64, f64)>,
    /// (low, high) around each point's y, say a 95 % interval; one for each point.
    pub band: Option<Vec<(f64, f64)>>,
    /// Whose motion it shows, which determines its colour; without one, the palette's next colour.
    pub meaning: Option<Meaning>,
}

/// A plot of points and curves over common axes.
#[derive(Clone, Debug, PartialEq)]
pub struct XyPlot {
    pub title: String,
    /// Quantity and unit.
    pub x_label: String,
    pub y_label: String,
    /// Drawn as points, bands as error bars.
    pub points: Vec<Series>,
    /// Drawn as lines, bands as areas; lines of the base simulation are dashed.
    pub curves: Vec<Series>,
    /// px
    pub size: (u32, u32),
}

impl Default for XyPlot {
    fn default() -> Self {
        let text = String::new;
        XyPlot {
            title: text(),
            x_label: text(),
            y_label: text(),
            points: Vec::new(),
            curves: Vec::new(),
            size: PLOT_SIZE_PX,
        }
    }
}

/// Lines through points, each with its band.
pub fn lines(title: &str, x_label: &str, y_label: &str, series: &[Series]) -> String {
    scatter_with(title, x_label, y_label, &[], series)
}

/// Points; a band is drawn as an error bar on each.
pub fn scatter(title: &str, x_label: &str, y_label: &str, series: &[Series]) -> String {
    scatter_with(title, x_label, y_label, series, &[])
}

/// Points with lines through them or over them; bands as in [`scatter`] and [`lines`].
pub fn scatter_with(
    title: &str,
    x_label: &str,
    y_label: &str,
    series: &[Series],
    curves: &[Series],
) -> String {
    let plot = XyPlot {
        title: title.into(),
        x_label: x_label.into(),
        y_label: y_label.into(),
        points: series.to_vec(),
        curves: curves.to_vec(),
        ..XyPlot::default()
    };
    plot.svg()
}

impl XyPlot {
    /// The plot as SVG.
    pub fn svg(&self) -> String {
        let (clouds, title) = (self.points.len(), &self.title);
        let clean: Vec<Series> = self.points.iter().chain(&self.curves).map(finite_only).collect();
        let joined = |i: usize| i >= clouds;
        let xs = clean.iter().flat_map(|s| s.points.iter().map(|p| p.0));
        let ys = clean.iter().flat_map(|s| {
            let bands = s.band.iter().flatten().flat_map(|b| [b.0, b.1]);
            s.points.iter().map(|p| p.1).chain(bands.collect::<Vec<_>>())
        });
        let (Some(x), Some(y)) = (range(xs), range(ys)) else {
            return empty(title);
        };
        let (x, y) = (extend(x, if clouds == 0 { 0.0 } else { 0.04 }), extend(y, 0.05));
        let colours = colours(&clean);
        let named = clean.iter().zip(&colours).map(|(s, c)| (s.name.clone(), *c));
        let legend = if clean.len() > 1 { named.collect() } else { Vec::new() };
        plot_svg_sized(self.size, title, &legend, |area| {
            let mut chart = chart_with_grid(area, &x, &y, &self.x_label, &self.y_label)?;
            for (i, s) in clean.iter().enumerate() {
                draw_band(&mut chart, s, colours[i], joined(i))?;
            }
            for (i, s) in clean.iter().enumerate() {
                if joined(i) {
                    draw_curve(&mut chart, s, colours[i])?;
                }
                if !joined(i) || (clouds == 0 && s.points.len() <= 30) {
                    draw_points(&mut chart, s, colours[i])?;
                }
            }
            Ok(())
        })
    }
}

/// The colour of each series.
fn colours(series: &[Series]) -> Vec<RGBColor> {
    let colour = |(i, s): (usize, &Series)| match s.meaning {
        Some(meaning) => token_colour(meaning.token()),
        None => series_colour(i),
    };
    series.iter().enumerate().map(colour).collect()
}

fn draw_curve(chart: &mut Chart, s: &Series, colour: RGBColor) -> DrawResult {
    let style = colour.stroke_width(subpixels(2));
    if s.meaning == Some(Meaning::Simulated) {
        let (dash, gap) = (subpixels(7), subpixels(4));
        chart.draw_series([DashedPathElement::new(s.points.clone(), dash, gap, style)])?;
    } else {
        chart.draw_series([PathElement::new(s.points.clone(), style)])?;
    }
    Ok(())
}

fn draw_points(chart: &mut Chart, s: &Series, colour: RGBColor) -> DrawResult {
    let (size, style) = (subpixels(3), colour.mix(0.85).filled());
    chart.draw_series(s.points.iter().map(|p| Circle::new(*p, size, style)))?;
    Ok(())
}

fn draw_band(chart: &mut Chart, s: &Series, colour: RGBColor, joined: bool) -> DrawResult {
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

fn finite_only(s: &Series) -> Series {
    let kept: Vec<usize> =
        (0..s.points.len()).filter(|i| is_drawable(s.points[*i].0) && is_drawable(s.points[*i].1)).collect();
    // A missing band has no width.
    let around = |b: &Vec<(f64, f64)>, i: usize| {
        finite_pair(b.get(i).copied()).unwrap_or((s.points[i].1, s.points[i].1))
    };
    Series {
        name: s.name.clone(),
        points: kept.iter().map(|i| s.points[*i]).collect(),
        band: s.band.as_ref().map(|b| kept.iter().map(|i| around(b, *i)).collect()),
        meaning: s.meaning,
    }
}
