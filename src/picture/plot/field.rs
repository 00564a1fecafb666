//! Arrows over a plane: what pushes where.

use plotters::prelude::*;

use super::frame::{Chart, Drawn, INK, empty, gridded, picture, units};
use super::scale::{drawable, paint, range, tick, widened};

/// Arrows of one colour.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Arrows {
    /// Shown in the legend.
    pub name: String,
    /// Where each starts, and what it stands for along x and y.
    pub arrows: Vec<([f64; 2], [f64; 2])>,
}

/// Length of the longest arrow, px, and the shares of the ranges of x and y that are at least as long.
const LONGEST: u32 = 52;
const ROOM: [f64; 2] = [0.12, 0.25];
/// Length of an arrow's head over the arrow's.
const HEAD: f64 = 0.3;

/// Arrows that point where what they stand for points, whatever the axes' scales; the longest says what it is in `unit`.
pub fn field(title: &str, x_label: &str, y_label: &str, unit: &str, series: &[Arrows]) -> String {
    let fine = |(at, to): &([f64; 2], [f64; 2])| at.iter().chain(to).all(|v| drawable(*v));
    let clean = || series.iter().map(|s| s.arrows.iter().filter(|a| fine(a)));
    let length = |to: &[f64; 2]| to[0].hypot(to[1]);
    let longest = clean().flatten().map(|(_, to)| length(to)).fold(0.0, f64::max);
    let span = |axis: usize| range(clean().flatten().map(|(at, _)| at[axis]));
    let (Some(x), Some(y)) = (span(0), span(1)) else { return empty(title) };
    // Room for the longest on every side.
    let (x, y) = (widened(x, ROOM[0]), widened(y, ROOM[1]));
    let legend: Vec<(String, RGBColor)> =
        series.iter().enumerate().map(|(i, s)| (s.name.clone(), paint(i))).collect();
    let title = format!("{title} (longest arrow {} {unit})", tick(longest));
    picture(&title, &legend, |area| {
        let mut chart = gridded(area, &x, &y, x_label, y_label)?;
        for (i, arrows) in clean().enumerate() {
            // Under the later ones and still seen.
            let width = if i + 1 < series.len() { units(4) } else { units(2) };
            for (at, to) in arrows.filter(|(_, to)| length(to) > 0.0) {
                arrow(&mut chart, *at, to.map(|v| v / longest), paint(i).mix(0.85).stroke_width(width))?;
            }
        }
        chart.draw_series(
            clean().flatten().map(|(at, _)| Circle::new((at[0], at[1]), units(1), INK.filled())),
        )?;
        Ok(())
    })
}

/// One arrow; `to` is in lengths of the longest.
fn arrow(chart: &mut Chart, at: [f64; 2], to: [f64; 2], style: ShapeStyle) -> Drawn {
    let (width, height) = chart.plotting_area().dim_in_pixel();
    let scale = |range: std::ops::Range<f64>, px: u32| {
        (range.end - range.start) / f64::from(px.max(1)) * f64::from(units(LONGEST))
    };
    let (sx, sy) = (scale(chart.x_range(), width), scale(chart.y_range(), height));
    let place = |along: f64, across: f64| {
        (at[0] + sx * (along * to[0] - across * to[1]), at[1] + sy * (along * to[1] + across * to[0]))
    };
    let tip = place(1.0, 0.0);
    let head = [place(1.0 - HEAD, 0.5 * HEAD), tip, place(1.0 - HEAD, -0.5 * HEAD)];
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
    fn arrows_of_any_size_are_drawn() {
        let arrows = vec![([0.0, 0.0], [1.0, 0.0]), ([2.0, 1.0], [0.0, -4.0]), ([1.0, f64::NAN], [1.0, 1.0])];
        let one = Arrows { name: "seen & told".into(), arrows };
        let svg = field("Push", "x, m", "y, m", "m/s^2", &[one]);
        assert!(svg.contains("longest arrow 4 m/s^2") && svg.contains("seen &amp; told"), "{svg}");
        assert!(!svg.contains("NaN"));
        let none = field("Push", "x", "y", "m/s^2", &[Arrows::default()]);
        assert!(none.contains("no data to plot"));
        let still = Arrows { name: "still".into(), arrows: vec![([0.0, 0.0], [0.0, 0.0])] };
        assert!(!field("Push", "x", "y", "m/s^2", &[still]).contains("NaN"));
    }
}
