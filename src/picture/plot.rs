//! Plots as SVG, by plotters: lines with bands, bars, points, heat maps, arrows; readable on white, colours of Okabe
//! and Ito (2008) and a heat scale that is safe for the colour-blind too.
//!
//! Points that aren't finite are left out; a plot without points shows a notice. The same data gives the same bytes: text is placed by
//! counting characters, independently of the machine's fonts.

mod bars;
mod frame;
mod heatmap;
mod lines;
mod panels;
mod quiver;
mod scale;

pub use bars::{Bar, BarGroup, bars};
pub use frame::PANEL_SIZE_PX;
pub use heatmap::{Heatmap, heatmap, heatmaps};
pub use lines::{Series, XyPlot, lines, scatter, scatter_with};
pub use panels::panels;
pub use quiver::{Arrows, quiver};
pub(super) use scale::heat_colour;

#[cfg(test)]
mod tests {
    use plotters::prelude::RGBColor;
    use resvg::usvg::roxmltree::Document;

    use super::scale::series_colour;
    use super::*;
    use crate::picture::scene::tests::check_svg;

    fn series(name: &str, points: &[(f64, f64)]) -> Series {
        Series { name: name.into(), points: points.to_vec(), ..Series::default() }
    }
    fn group(name: &str, values: &[f64]) -> BarGroup {
        let bar = |(i, v): (usize, &f64)| Bar {
            name: format!("b{i}"),
            value: *v,
            interval: Some((v - 1.0, v + 1.0)),
        };
        BarGroup { name: name.into(), bars: values.iter().enumerate().map(bar).collect() }
    }
    fn square(values: Vec<Vec<f64>>) -> Heatmap {
        let centres = |n: usize| (0..n).map(|i| i as f64).collect();
        let columns = values.first().map_or(0, Vec::len);
        Heatmap { x: centres(columns), y: centres(values.len()), values, ..Heatmap::default() }
    }

    #[test]
    fn heat_maps_side_by_side_have_their_own_titles_and_scales() {
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
        // One dot each, of two circles; dots outside of the map are left out.
        assert_eq!(drawn.matches("<circle").count(), 4);
        let broken = Heatmap { values: vec![], ..map("broken") };
        assert!(heatmaps("none", &[map("left"), broken]).contains("no data to plot"));
        assert!(heatmaps("none", &[]).contains("no data to plot"));
    }

    #[test]
    fn empty_plots_show_a_notice() {
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
    fn leaves_out_values_that_are_not_finite() {
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
    fn bar_heights_are_proportional_to_values() {
        let svg = bars("t", "y", &[group("g", &[1.0, 3.0])]);
        let document = Document::parse(&svg).unwrap();
        let height = |fill: RGBColor| -> f64 {
            let fill = format!("#{:02X}{:02X}{:02X}", fill.0, fill.1, fill.2);
            let found =
                document.descendants().filter(|n| n.has_tag_name(("http://www.w3.org/2000/svg", "rect")));
            let tall = found.filter(|n| n.attribute("fill") == Some(&fill));
            tall.map(|n| n.attribute("height").unwrap().parse::<f64>().unwrap()).fold(0.0, f64::max)
        };
        let ratio = height(series_colour(1)) / height(series_colour(0));
        assert!((ratio - 3.0).abs() < 0.02, "{ratio}");
    }

    #[test]
    fn escapes_text_and_is_deterministic() {
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
    fn draws_ranges_of_any_size() {
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
}
