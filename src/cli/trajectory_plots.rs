//! Plots of trajectories before and after the extension, with predictive bands, and of the residual force field.

use iplw::inference::report::{Diagnosis, ResidualField, TrialResiduals};
use iplw::picture::plot::{Arrows, Series, quiver, scatter_with};

use super::residual_plots::PlotFile;

/// Half width of a band in standard deviations.
const BAND_SD: f64 = 2.0;
/// 95 % quantile of the chi-squared distribution with 2 degrees of freedom: significance of an acceleration.
const CHI_SQUARED_2_95: f64 = 5.99;

/// Trajectories and residuals of the trial with the median p-value and of the one with the smallest.
pub fn trajectory_figures(d: &Diagnosis) -> Vec<PlotFile> {
    let mut of: Vec<(f64, usize)> =
        d.predictive.iter().flat_map(|p| &p.launches).map(|l| (l.p, l.trial)).collect();
    of.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let chosen = [("usual", of.get(of.len() / 2)), ("furthest", of.first())];
    let drawn = chosen.into_iter().filter_map(|(name, launch)| {
        let (_, trial) = launch?;
        let path = d.paths.launches.iter().find(|l| l.trial == *trial && !l.rows.is_empty())?;
        Some(trial_figures(name, path, d.paths.columns))
    });
    drawn.flatten().collect()
}

/// One trial: its trajectory in the plane, and its residuals in x and y over time.
fn trial_figures(which: &str, path: &TrialResiduals, columns: &[&str]) -> Vec<PlotFile> {
    let column = |name: &str| -> Vec<f64> {
        let at = columns.iter().position(|c| *c == name);
        let value =
            |row: &Vec<Option<f64>>| at.and_then(|i| row.get(i).copied().flatten()).unwrap_or(f64::NAN);
        // The first body, if several move.
        let body = columns.iter().position(|c| *c == "body");
        let first = |row: &&Vec<Option<f64>>| body.is_none_or(|b| row[b] == path.rows[0][b]);
        path.rows.iter().filter(first).map(value).collect()
    };
    let pairs =
        |x: &[f64], y: &[f64]| -> Vec<(f64, f64)> { x.iter().copied().zip(y.iter().copied()).collect() };
    let around = |at: &[f64], sd: &[f64]| -> Vec<(f64, f64)> {
        at.iter().zip(sd).map(|(v, s)| (v - BAND_SD * s, v + BAND_SD * s)).collect()
    };
    let (t, x, y) = (column("t"), column("x"), column("y"));
    let series = |side: &str, name: &str| {
        let own = |axis: &str| column(&format!("{side}_{axis}"));
        let minus = |observed: &[f64], off: &[f64]| -> Vec<f64> {
            observed.iter().zip(off).map(|(a, b)| a - b).collect()
        };
        let (px, py) = (minus(&x, &own("x")), minus(&y, &own("y")));
        let band = Some(around(&py, &column(&format!("sd_{side}_y"))));
        Series { name: format!("{name}, with the band of its height"), points: pairs(&px, &py), band }
    };
    let both = [("before", "base model"), ("after", "extended model")];
    let observed = Series { name: "observed".into(), points: pairs(&x, &y), band: None };
    let title = format!("The {which} trial ({}): trajectory before and after", path.trial);
    let caption = format!("{title}; predictive bands of {BAND_SD} standard deviations of an observation");
    let curves = both.map(|(side, name)| series(side, name));
    let mut out =
        vec![(format!("path_{which}"), caption, scatter_with(&title, "x, m", "y, m", &[observed], &curves))];
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
        let title = format!("The {which} trial ({}): residual in {axis}", path.trial);
        let caption =
            format!("{title}, with predictive bands of {BAND_SD} standard deviations of each model");
        let svg = scatter_with(&title, "t, s", &format!("observed - simulated {axis}, m"), &clouds, &curves);
        out.push((format!("path_{which}_{axis}"), caption, svg));
    }
    out
}

/// The residual force field, with arrows where it is significant; `None` if it is significant nowhere.
pub fn residual_field_figure(found: &ResidualField) -> Option<PlotFile> {
    let is_significant = |r: &[f64; 6]| (r[2] / r[4]).powi(2) + (r[3] / r[5]).powi(2) > CHI_SQUARED_2_95;
    let push = |r: &[f64; 6]| ([r[0], r[1]], if is_significant(r) { [r[2], r[3]] } else { [0.0; 2] });
    let arrows: Vec<_> = found.rows.iter().map(push).collect();
    if arrows.iter().all(|a| a.1 == [0.0; 2]) {
        return None;
    }
    let title = "Residual force field";
    let caption = "Force per mass that all trials share and the reported model lacks: mean over the flights in each cell, with an arrow \
                   where it differs significantly from zero";
    let arrows = [Arrows { name: "left".into(), arrows }];
    Some(("field_left".into(), caption.into(), quiver(title, "x, m", "y, m", "m/s^2", &arrows)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_arrows_where_significant() {
        let row = |ax: f64| [1.0, 2.0, ax, 0.0, 0.1, 0.1];
        let of = |rows: Vec<[f64; 6]>| {
            residual_field_figure(&ResidualField { columns: &["x", "y", "ax", "ay", "sd_ax", "sd_ay"], rows })
        };
        assert!(of(vec![row(0.05), row(-0.1)]).is_none());
        assert!(of(vec![row(0.05), row(-1.0)]).is_some_and(|p| p.2.contains("longest arrow 1 m/s^2")));
    }

    #[test]
    fn draws_trials_with_bands() {
        let columns = ["t", "body", "x", "y", "before_x", "before_y", "after_x", "after_y", "sd_after_y"];
        let row = |i: usize| columns.iter().map(|_| Some(i as f64)).collect();
        let plots =
            trial_figures("usual", &TrialResiduals { trial: 4, rows: (0..5).map(row).collect() }, &columns);
        let names: Vec<&str> = plots.iter().map(|p| p.0.as_str()).collect();
        assert_eq!(names, ["path_usual", "path_usual_x", "path_usual_y"]);
        assert!(plots.iter().all(|p| p.1.contains("trial (4)") && p.2.contains("<svg")));
    }
}
