//! What a policy thinks of a scene: its predicted chance of success over where an action places something.

use std::fmt::Write;

use super::film::draw_trails;
use super::plot::heat_colour;
use super::scene::{Look, Style, View, document, draw_body, draw_statics, title};
use super::svg::px;
use crate::task::Scene;
use crate::trajectory::Trajectory;

/// Cells across the picture.
const COLUMNS: f64 = 56.0;

/// The scene under a map of chances, with a trial over it.
///
/// `chances` are (place in m, chance in [0, 1]); a cell shows the best of those that fall into it, from dark
/// (none) to yellow (sure). `placed` is the scene with the chosen action carried out, `film` what became of it.
pub fn chances_svg(
    chances: &[([f64; 2], f64)],
    placed: &Scene,
    film: Option<&Trajectory>,
    style: &Style,
) -> String {
    let view = View::new(placed, film, f64::from(style.width.clamp(16, 4096)));
    let size = view.width / COLUMNS;
    let mut cells: std::collections::BTreeMap<(i64, i64), f64> = std::collections::BTreeMap::new();
    for (place, chance) in chances {
        let [x, y] = view.at(*place);
        let best = cells.entry(((x / size).floor() as i64, (y / size).floor() as i64)).or_insert(0.0);
        *best = best.max(*chance);
    }
    let mut body = String::new();
    for ((column, row), chance) in &cells {
        let _ = writeln!(
            body,
            "<rect x=\"{}\" y=\"{}\" width=\"{s}\" height=\"{s}\" fill=\"{}\" fill-opacity=\"0.75\"/>",
            px(*column as f64 * size),
            px(*row as f64 * size),
            heat_colour(*chance),
            s = px(size * 1.02),
        );
    }
    draw_statics(&mut body, placed, &view);
    if let Some(film) = film {
        draw_trails(&mut body, placed, film, &view);
    }
    for (i, b) in placed.bodies.iter().enumerate() {
        if let Some(position) = b.position {
            draw_body(&mut body, placed, i, position, b.angle, &view, Look::Solid);
        }
    }
    document(view.width, view.height, &title(placed), &body)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::scene::tests::{check_svg, hall};

    #[test]
    fn cells_show_the_best_chance_at_their_place() {
        let scene = hall();
        let map = |chance| {
            let points = [([5.0, 5.0], 0.1), ([5.01, 5.0], chance), ([1.0, 1.0], 0.0)];
            chances_svg(&points, &scene, None, &Style::default())
        };
        let (sure, unsure) = (map(1.0), map(0.0));
        check_svg(&sure);
        assert_eq!(sure.matches("fill-opacity=\"0.75\"").count(), 2);
        assert!(sure.contains(&heat_colour(1.0)) && !unsure.contains(&heat_colour(1.0)));
        assert!(unsure.contains(&heat_colour(0.1)), "the better of two");
    }
}
