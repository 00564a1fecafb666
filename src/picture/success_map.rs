//! Map of predicted success probability over the positions where actions place a body.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::animation::draw_trails;
use super::plot::heat_colour;
use super::scene::{Style, document, draw_bodies, draw_statics, title};
use super::svg::px;
use super::viewport::Viewport;
use crate::task::Scene;
use crate::trajectory::Trajectory;

/// Maximal number of cells across the picture; fewer where the positions are further apart.
const MAX_COLUMNS: f64 = 56.0;

/// The scene under a map of success probabilities, with a trajectory over it.
///
/// `chances` are (position in m, probability in [0, 1]); a cell shows its maximum, from dark (0) to yellow (1). `placed` is the scene
/// with the chosen action, `film` its trajectory.
pub fn success_map_svg(
    chances: &[([f64; 2], f64)],
    placed: &Scene,
    film: Option<&Trajectory>,
    style: &Style,
) -> String {
    let view = Viewport::new(placed, film, style.width_px());
    let places: Vec<[f64; 2]> = chances.iter().map(|(place, _)| view.at(*place)).collect();
    let size = [0, 1]
        .map(|k| median_gap(places.iter().map(|p| p[k])))
        .into_iter()
        .fold(view.width / MAX_COLUMNS, f64::max);
    // Cells are centred on positions, so that no position of a grid falls on a border.
    let first = places.first().copied().unwrap_or_default();
    let mut cells: BTreeMap<[i64; 2], f64> = BTreeMap::new();
    for (place, (_, chance)) in places.iter().zip(chances) {
        let best = cells.entry([0, 1].map(|k| ((place[k] - first[k]) / size).round() as i64)).or_insert(0.0);
        *best = best.max(*chance);
    }
    let corner = |k: usize, cell: i64| first[k] + (cell as f64 - 0.5) * size;
    let mut body = String::new();
    for ([column, row], chance) in &cells {
        let _ = writeln!(
            body,
            "<rect x=\"{}\" y=\"{}\" width=\"{s}\" height=\"{s}\" fill=\"{}\" fill-opacity=\"0.75\"/>",
            px(corner(0, *column)),
            px(corner(1, *row)),
            heat_colour(*chance),
            s = px(size * 1.02),
        );
    }
    draw_statics(&mut body, placed, &view);
    if let Some(film) = film {
        draw_trails(&mut body, placed, film, &view);
    }
    draw_bodies(&mut body, placed, &view);
    document(view.width, view.height, &title(placed), &body)
}

/// Median distance between distinct neighbouring values.
fn median_gap(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let mut gaps: Vec<f64> = values.windows(2).map(|w| w[1] - w[0]).filter(|gap| *gap > 1e-6).collect();
    gaps.sort_by(f64::total_cmp);
    gaps.get(gaps.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::scene::tests::{check_svg, hall};

    #[test]
    fn cells_show_the_maximum() {
        let scene = hall();
        let map = |chance| {
            let points = [([5.0, 5.0], 0.1), ([5.01, 5.0], chance), ([1.0, 1.0], 0.0)];
            success_map_svg(&points, &scene, None, &Style::default())
        };
        let (sure, unsure) = (map(1.0), map(0.0));
        check_svg(&sure);
        assert_eq!(sure.matches("fill-opacity=\"0.75\"").count(), 2);
        assert!(sure.contains(&heat_colour(1.0)) && !unsure.contains(&heat_colour(1.0)));
        assert!(unsure.contains(&heat_colour(0.1)), "the better of two");
    }

    /// A grid coarser than the picture's cells has one cell for each position, without gaps.
    #[test]
    fn a_coarse_grid_leaves_no_holes() {
        let (scene, style) = (hall(), Style::default());
        let points: Vec<([f64; 2], f64)> = (0..6)
            .flat_map(|i| (0..6).map(move |j| ([1.0 + 0.7 * f64::from(i), 1.0 + 0.7 * f64::from(j)], 0.5)))
            .collect();
        let svg = success_map_svg(&points, &scene, None, &style);
        let number = |line: &str, name: &str| -> f64 {
            line.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
        };
        let cells: Vec<&str> = svg.lines().filter(|l| l.contains("fill-opacity=\"0.75\"")).collect();
        assert_eq!(cells.len(), 36);
        let mut lefts: Vec<f64> = cells.iter().map(|l| number(l, "x")).collect();
        lefts.sort_by(f64::total_cmp);
        lefts.dedup();
        let width = number(cells[0], "width");
        assert_eq!(lefts.len(), 6);
        assert!(lefts.windows(2).all(|w| w[1] - w[0] <= width), "{lefts:?}, {width}");
    }
}
