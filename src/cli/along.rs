//! Plots of launches before and after with the bands that models have for them, and of the field of what is left.

use iplw::discover::report::{Diagnosis, FieldLeft, Path};
use iplw::picture::plot::{Arrows, Series, field, scatter_with};

use super::evidence::Plot;

/// Standard deviations to either side that a band is drawn over.
const BAND: f64 = 2.0;
/// Square of a push over its standard deviations, along x and along y, from which the data tell it: 95 % of chi squared of 2.
const TOLD: f64 = 5.99;

/// Paths and residuals of the launch that is usual among predictions and of the one furthest off.
pub fn paths(d: &Diagnosis) -> Vec<Plot> {
    let mut of: Vec<(f64, usize)> =
        d.predictive.iter().flat_map(|p| &p.launches).map(|l| (l.p, l.trial)).collect();
    of.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let chosen = [("usual", of.get(of.len() / 2)), ("furthest", of.first())];
    let drawn = chosen.into_iter().filter_map(|(name, launch)| {
        let (_, trial) = launch?;
        let path = d.paths.launches.iter().find(|l| l.trial == *trial && !l.rows.is_empty())?;
        Some(launch_plots(name, path, d.paths.columns))
    });
    drawn.flatten().collect()
}

/// One launch: its path in the plane, and its residuals along x and y over time.
fn launch_plots(which: &str, path: &Path, columns: &[&str]) -> Vec<Plot> {
    let column = |name: &str| -> Vec<f64> {
        let at = columns.iter().position(|c| *c == name);
        let value =
            |row: &Vec<Option<f64>>| at.and_then(|i| row.get(i).copied().flatten()).unwrap_or(f64::NAN);
        // Where many bodies move, the first.
        let body = columns.iter().position(|c| *c == "body");
        let first = |row: &&Vec<Option<f64>>| body.is_none_or(|b| row[b] == path.rows[0][b]);
        path.rows.iter().filter(first).map(value).collect()
    };
    let pairs =
        |x: &[f64], y: &[f64]| -> Vec<(f64, f64)> { x.iter().copied().zip(y.iter().copied()).collect() };
    let around = |at: &[f64], sd: &[f64]| -> Vec<(f64, f64)> {
        at.iter().zip(sd).map(|(v, s)| (v - BAND * s, v + BAND * s)).collect()
    };
    let (t, x, y) = (column("t"), column("x"), column("y"));
    let along = |side: &str, name: &str| {
        let own = |axis: &str| column(&format!("{side}_{axis}"));
        let minus =
            |seen: &[f64], off: &[f64]| -> Vec<f64> { seen.iter().zip(off).map(|(a, b)| a - b).collect() };
        let (px, py) = (minus(&x, &own("x")), minus(&y, &own("y")));
        let band = Some(around(&py, &column(&format!("sd_{side}_y"))));
        Series { name: format!("{name}, its height's band"), points: pairs(&px, &py), band }
    };
    let both = [("before", "base model"), ("after", "extended model")];
    let seen = Series { name: "seen".into(), points: pairs(&x, &y), band: None };
    let title = format!("The {which} launch (trial {}): path before and after", path.trial);
    let caption =
        format!("{title}; bands of {BAND} standard deviations of what is predicted of an observation");
    let curves = both.map(|(side, name)| along(side, name));
    let mut out =
        vec![(format!("path_{which}"), caption, scatter_with(&title, "x, m", "y, m", &[seen], &curves))];
    for axis in ["x", "y"] {
        let clouds = both.map(|(side, name)| Series {
            name: name.into(),
            points: pairs(&t, &column(&format!("{side}_{axis}"))),
            band: None,
        });
        let curves = both.map(|(side, name)| {
            let (zero, sd) = (vec![0.0; t.len()], column(&format!("sd_{side}_{axis}")));
            Series {
                name: format!("{name}, predicted"),
                points: pairs(&t, &zero),
                band: Some(around(&zero, &sd)),
            }
        });
        let title = format!("The {which} launch (trial {}): residual in {axis}", path.trial);
        let caption =
            format!("{title}, with bands of {BAND} standard deviations of what each model predicts");
        let svg = scatter_with(&title, "t, s", &format!("seen - simulated {axis}, m"), &clouds, &curves);
        out.push((format!("path_{which}_{axis}"), caption, svg));
    }
    out
}

/// The field of what is left, with arrows where the data tell it; none where they tell nothing.
pub fn left(found: &FieldLeft) -> Option<Plot> {
    let told = |r: &[f64; 6]| (r[2] / r[4]).powi(2) + (r[3] / r[5]).powi(2) > TOLD;
    let push = |r: &[f64; 6]| ([r[0], r[1]], if told(r) { [r[2], r[3]] } else { [0.0; 2] });
    let arrows: Vec<_> = found.rows.iter().map(push).collect();
    if arrows.iter().all(|a| a.1 == [0.0; 2]) {
        return None;
    }
    let title = "What pushes beside the reported model";
    let caption = "What pushes beside the reported model, by a force field that launches share, per mass: mean over the flights in each \
                   cell, with an arrow where it differs from nothing by more than chance";
    let arrows = [Arrows { name: "left".into(), arrows }];
    Some(("field_left".into(), caption.into(), field(title, "x, m", "y, m", "m/s^2", &arrows)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrows_stand_where_something_is_told() {
        let row = |ax: f64| [1.0, 2.0, ax, 0.0, 0.1, 0.1];
        let of = |rows: Vec<[f64; 6]>| {
            left(&FieldLeft { columns: &["x", "y", "ax", "ay", "sd_ax", "sd_ay"], rows })
        };
        assert!(of(vec![row(0.05), row(-0.1)]).is_none());
        assert!(of(vec![row(0.05), row(-1.0)]).is_some_and(|p| p.2.contains("longest arrow 1 m/s^2")));
    }

    #[test]
    fn a_launch_is_drawn_with_its_bands() {
        let columns = ["t", "body", "x", "y", "before_x", "before_y", "after_x", "after_y", "sd_after_y"];
        let row = |i: usize| columns.iter().map(|_| Some(i as f64)).collect();
        let plots = launch_plots("usual", &Path { trial: 4, rows: (0..5).map(row).collect() }, &columns);
        let names: Vec<&str> = plots.iter().map(|p| p.0.as_str()).collect();
        assert_eq!(names, ["path_usual", "path_usual_x", "path_usual_y"]);
        assert!(plots.iter().all(|p| p.1.contains("trial 4") && p.2.contains("<svg")));
    }
}
