//! Quiver plots: vectors as arrows over a plane.

use plotters::prelude::*;

use super::frame::{Chart, DrawResult, chart_with_grid, empty, ink, plot_svg_sized, subpixels};
use super::scale::{extend, is_drawable, range, series_colour, tick, token_colour};
use crate::picture::theme::Meaning;

/// Arrows of one colour.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Arrows {
    /// Shown in the legend.
    pub name: String,
    /// Origin and vector of each arrow.
    pub arrows: Vec<([f64; 2], [f64; 2])>,
    /// Whose acceleration they show, which determines their colour.
    pub meaning: Option<Meaning>,
}

/// Length of the longest arrow, px, and the padding of the x and y ranges that makes room for it.
const MAX_ARROW_LENGTH_PX: u32 = 52;
const RANGE_PADDING: [f64; 2] = [0.12, 0.25];
/// Length of an arrow's head relative to the arrow.
const HEAD_SHARE: f64 = 0.3;

/// Arrows in the vectors' directions, independently of the axes' scales; the title gives the longest vector's length in `unit`.
pub fn quiver(
    title: &str,
    [x_label, y_label]: [&str; 2],
    unit: &str,
    series: &[Arrows],
    size: (u32, u32),
) -> String {
    let fine = |(at, to): &([f64; 2], [f64; 2])| at.iter().chain(to).all(|v| is_drawable(*v));
    let clean = || series.iter().map(|s| s.arrows.iter().filter(|a| fine(a)));
    let length = |to: &[f64; 2]| to[0].hypot(to[1]);
    let longest = clean().flatten().map(|(_, to)| length(to)).fold(0.0, f64::max);
    let span = |axis: usize| range(clean().flatten().map(|(at, _)| at[axis]));
    let (Some(x), Some(y)) = (span(0), span(1)) else { return empty(title) };
    // Room for the longest arrow on every side.
    let (x, y) = (extend(x, RANGE_PADDING[0]), extend(y, RANGE_PADDING[1]));
    let colour = |i: usize| series[i].meaning.map_or(series_colour(i), |m| token_colour(m.token()));
    let legend: Vec<(String, RGBColor)> =
        series.iter().enumerate().map(|(i, s)| (s.name.clone(), colour(i))).collect();
    let title = format!("{title} (longest arrow {} {unit})", tick(longest));
    plot_svg_sized(size, &title, &legend, |area| {
        let mut chart = chart_with_grid(area, &x, &y, x_label, y_label)?;
        for (i, arrows) in clean().enumerate() {
            // Wider than the later ones, which are drawn on top.
            let width = if i + 1 < series.len() { subpixels(4) } else { subpixels(2) };
            for (at, to) in arrows.filter(|(_, to)| length(to) > 0.0) {
                arrow(&mut chart, *at, to.map(|v| v / longest), colour(i).mix(0.85).stroke_width(width))?;
            }
        }
        chart.draw_series(
            clean().flatten().map(|(at, _)| Circle::new((at[0], at[1]), subpixels(1), ink().filled())),
        )?;
        Ok(())
    })
}

/// Draws one arrow; `to` is relative to the longest.
fn arrow(chart: &mut Chart, at: [f64; 2], to: [f64; 2], style: ShapeStyle) -> DrawResult {
    let (width, height) = chart.plotting_area().dim_in_pixel();
    let scale = |range: std::ops::Range<f64>, px: u32| {
        (range.end - range.start) / f64::from(px.max(1)) * f64::from(subpixels(MAX_ARROW_LENGTH_PX))
    };
    let (sx, sy) = (scale(chart.x_range(), width), scale(chart.y_range(), height));
    let place = |along: f64, across: f64| {
        (at[0] + sx * (along * to[0] - across * to[1]), at[1] + sy * (along * to[1] + across * to[0]))
    };
    let tip = place(1.0, 0.0);
    let head = [place(1.0 - HEAD_SHARE, 0.5 * HEAD_SHARE), tip, place(1.0 - HEAD_SHARE, -0.5 * HEAD_SHARE)];
    chart.draw_series([
        PathElement::new(vec![(at[0], at[1]), tip], style),
        PathElement::new(head.to_vec(), style),
    ])?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_arrows_of_any_size() {
        let arrows = vec![([0.0, 0.0], [1.0, 0.0]), ([2.0, 1.0], [0.0, -4.0]), ([1.0, f64::NAN], [1.0, 1.0])];
        let one = Arrows { name: "seen & fitted".into(), arrows, meaning: Some(Meaning::Extended) };
        let draw = |arrows: Arrows| quiver("Push", ["x, m", "y, m"], "m/s^2", &[arrows], (720, 440));
        let svg = draw(one);
        assert!(svg.contains("longest arrow 4 m/s^2") && svg.contains("seen &amp; fitted"), "{svg}");
        assert!(!svg.contains("NaN"));
        assert!(draw(Arrows::default()).contains("no data to plot"));
        let still = Arrows { name: "still".into(), arrows: vec![([0.0; 2], [0.0; 2])], meaning: None };
        assert!(!draw(still).contains("NaN"));
    }
}
