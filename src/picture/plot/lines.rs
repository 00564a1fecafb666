//! Lines with bands and points with error bars.

use plotters::prelude::*;

use super::frame::{Chart, DrawResult, chart_with_grid, empty, error_bar, plot_svg, subpixels};
use super::scale::{extend, finite_pair, is_drawable, legend, range, series_colour};

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
    let (x, y) = (extend(x, if clouds.is_empty() { 0.0 } else { 0.04 }), extend(y, 0.05));
    let shown = if clean.len() > 1 { legend(clean.iter().map(|s| &s.name)) } else { Vec::new() };
    plot_svg(title, &shown, |area| {
        let mut chart = chart_with_grid(area, &x, &y, x_label, y_label)?;
        for (i, s) in clean.iter().enumerate() {
            draw_band(&mut chart, s, series_colour(i), joined(i))?;
        }
        for (i, s) in clean.iter().enumerate() {
            let colour = series_colour(i);
            if joined(i) {
                chart.draw_series([PathElement::new(s.points.clone(), colour.stroke_width(subpixels(2)))])?;
            }
            if !joined(i) || (clouds.is_empty() && s.points.len() <= 30) {
                let size = subpixels(3);
                chart
                    .draw_series(s.points.iter().map(|p| Circle::new(*p, size, colour.mix(0.85).filled())))?;
            }
        }
        Ok(())
    })
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
    }
}
