//! Figures of the evidence: residuals over time, missing accelerations, and impacts.

use super::document::DiagnosisDocument;
use super::figure::ReportFigure;
use super::trials::ReportedTrials;
use crate::inference::report::plot_tables::PlotTable;
use crate::picture::plot::{Arrows, PANEL_SIZE_PX, Series, XyPlot, panels, quiver};
use crate::picture::theme::Meaning;

/// Half width of a predictive band in standard deviations.
const BAND_SD: f64 = 2.0;
/// 95 % quantile of the chi-squared distribution with 2 degrees of freedom: significance of an acceleration.
const CHI_SQUARED_2_95: f64 = 5.99;
/// Cells of the force field along x and y.
const FIELD_CELLS: [usize; 2] = [10, 7];
/// Approach speed relative to the largest below which noise dominates an impact, and it is not shown.
const MIN_APPROACH_SHARE: f64 = 0.05;

/// The two models and the prefixes of their columns.
const MODELS: [(&str, &str, Meaning); 2] = [
    ("before", "simulation before", Meaning::Simulated),
    ("after", "extended simulation", Meaning::Extended),
];

/// Residuals of all trials over time, and of two trials with predictive bands.
pub fn residuals(document: &DiagnosisDocument, trials: &ReportedTrials) -> Option<ReportFigure> {
    let points = &document.evidence.points;
    if points.rows.is_empty() {
        return None;
    }
    let models = if document.is_extended() { &MODELS[..] } else { &MODELS[..1] };
    let time = points.column("t");
    let all = ["x", "y"].map(|axis| {
        let series = models.iter().map(|(side, name, meaning)| Series {
            name: name.to_string(),
            points: pairs(&time, &points.column(&format!("{side}_{axis}"))),
            meaning: Some(*meaning),
            ..Series::default()
        });
        residual_plot(&format!("All trials, {axis}"), axis, series.collect(), Vec::new())
    });
    let mut plots = all.to_vec();
    for (role, trial) in trials.examples() {
        let path = trials.trajectory(trial);
        for (k, axis) in ["x", "y"].into_iter().enumerate() {
            let coordinate = |values: &[[f64; 2]]| values.iter().map(|v| v[k]).collect::<Vec<f64>>();
            let clouds = models.iter().enumerate().map(|(m, (_, name, meaning))| Series {
                name: name.to_string(),
                points: pairs(&path.times, &coordinate(&path.residuals[m])),
                meaning: Some(*meaning),
                ..Series::default()
            });
            let bands = models.iter().enumerate().map(|(m, (_, _, meaning))| Series {
                name: String::new(),
                points: path.times.iter().map(|t| (*t, 0.0)).collect(),
                band: Some(coordinate(&path.sds[m]).iter().map(|sd| (-BAND_SD * sd, BAND_SD * sd)).collect()),
                meaning: Some(*meaning),
            });
            let title = format!("{role}, {axis}: {}", trials.name(trial.trial));
            plots.push(residual_plot(&title, axis, clouds.collect(), bands.collect()));
        }
    }
    Some(ReportFigure {
        name: "residuals",
        caption: format!(
            "Measured minus simulated position over time. Noise alone scatters around zero without a pattern. Bands: {BAND_SD} standard \
             deviations of the prediction of an observation."
        ),
        svg: panels("Residuals over time", &plots, 2),
    })
}

fn residual_plot(title: &str, axis: &str, points: Vec<Series>, curves: Vec<Series>) -> String {
    let plot = XyPlot {
        title: title.into(),
        x_label: "t, s".into(),
        y_label: format!("measured \u{2212} simulated {axis}, m"),
        points,
        curves,
        size: PANEL_SIZE_PX,
    };
    plot.svg()
}

/// Acceleration that the base model lacks and that the extension adds, over the plane; and what the reported model lacks.
pub fn missing_acceleration(document: &DiagnosisDocument) -> Option<ReportFigure> {
    let pushes = &document.evidence.pushes;
    let mut plots = Vec::new();
    if !pushes.rows.is_empty() {
        let arrows = |name: &str, prefix: &str, meaning| Arrows {
            name: name.into(),
            arrows: cell_medians(pushes, [format!("{prefix}ax"), format!("{prefix}ay")]),
            meaning: Some(meaning),
        };
        let mut series = vec![arrows("missing in the simulation", "", Meaning::Measured)];
        if document.is_extended() {
            series.push(arrows("added by the extension", "found_", Meaning::Extended));
        }
        plots.push(quiver("Acceleration", ["x, m", "y, m"], "m/s\u{b2}", &series, PANEL_SIZE_PX));
    }
    let field = document.diagnosis.field.as_ref();
    let is_significant = |r: &[f64; 6]| (r[2] / r[4]).powi(2) + (r[3] / r[5]).powi(2) > CHI_SQUARED_2_95;
    let mut remark = "";
    if let Some(field) = field {
        if field.rows.iter().any(is_significant) {
            let push = |r: &[f64; 6]| ([r[0], r[1]], if is_significant(r) { [r[2], r[3]] } else { [0.0; 2] });
            let rest = Arrows {
                name: "missing in the reported model".into(),
                arrows: field.rows.iter().map(push).collect(),
                meaning: Some(Meaning::Measured),
            };
            let title = "Common acceleration without explanation";
            plots.push(quiver(title, ["x, m", "y, m"], "m/s\u{b2}", &[rest], PANEL_SIZE_PX));
            remark = " Second panel: acceleration that all trials share and the reported model lacks, where it is significant.";
        } else {
            remark = " No further common acceleration is significant.";
        }
    }
    (!plots.is_empty()).then(|| ReportFigure {
        name: "missing_acceleration",
        caption: format!(
            "Force per mass that the simulation lacks, by place: the median over the parts of flights in each cell.{remark}"
        ),
        svg: panels("Missing acceleration", &plots, 2),
    })
}

/// Mean position and median acceleration of each cell of the plane.
fn cell_medians(pushes: &PlotTable, acceleration: [String; 2]) -> Vec<([f64; 2], [f64; 2])> {
    let of = |name: &str| pushes.column(name);
    let (x, y, ax, ay) = (of("x"), of("y"), of(&acceleration[0]), of(&acceleration[1]));
    let rows: Vec<[f64; 4]> = (0..x.len())
        .map(|i| [x[i], y[i], ax[i], ay[i]])
        .filter(|r| r.iter().all(|v| v.is_finite()))
        .collect();
    let end = |k: usize, of: fn(f64, f64) -> f64| rows.iter().map(|r| r[k]).reduce(of).unwrap_or(0.0);
    let (low, high) = ([0, 1].map(|k| end(k, f64::min)), [0, 1].map(|k| end(k, f64::max)));
    let mut cells: Vec<Vec<[f64; 4]>> = vec![Vec::new(); FIELD_CELLS[0] * FIELD_CELLS[1]];
    for row in rows {
        let [i, j] = [0, 1].map(|k| {
            let share = (row[k] - low[k]) / (high[k] - low[k]).max(1e-12);
            ((share * FIELD_CELLS[k] as f64) as usize).min(FIELD_CELLS[k] - 1)
        });
        cells[j * FIELD_CELLS[0] + i].push(row);
    }
    let median = |own: &[[f64; 4]], k: usize| {
        let mut values: Vec<f64> = own.iter().map(|r| r[k]).collect();
        values.sort_by(f64::total_cmp);
        0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2])
    };
    let arrow = |own: &Vec<[f64; 4]>| {
        let mean = |k: usize| own.iter().map(|r| r[k]).sum::<f64>() / own.len() as f64;
        ([mean(0), mean(1)], [median(own, 2), median(own, 3)])
    };
    cells.iter().filter(|own| !own.is_empty()).map(arrow).collect()
}

/// Impulses and restitution of impacts: as observed and by both models.
pub fn impacts(document: &DiagnosisDocument) -> Option<ReportFigure> {
    let bounces = &document.evidence.bounces;
    let sides = [
        ("seen", "measured", Meaning::Measured),
        ("base", "simulation before", Meaning::Simulated),
        ("extended", "extended simulation", Meaning::Extended),
    ];
    let sides = if document.is_extended() { &sides[..] } else { &sides[..2] };
    let quantities =
        |side: &str| ["approach", "slip", "normal", "along"].map(|q| bounces.column(&format!("{side}_{q}")));
    let impacts: Vec<[Vec<f64>; 4]> = sides.iter().map(|(side, ..)| quantities(side)).collect();
    let speeds = impacts.iter().flat_map(|[approach, ..]| approach).copied().filter(|v| v.is_finite());
    let largest = speeds.fold(0.0, f64::max);
    let is_fast =
        |i: &usize| impacts.iter().all(|[approach, ..]| approach[*i] > MIN_APPROACH_SHARE * largest);
    let rows: Vec<usize> = (0..bounces.rows.len()).filter(is_fast).collect();
    if rows.is_empty() {
        return None;
    }
    let plot = |title: &str, x_label: &str, y_label: &str, point: fn([f64; 4]) -> (f64, f64)| {
        let series = |((_, name, meaning), own): (&(&str, &str, Meaning), &[Vec<f64>; 4])| Series {
            name: name.to_string(),
            points: rows.iter().map(|i| point([0, 1, 2, 3].map(|q| own[q][*i]))).collect(),
            meaning: Some(*meaning),
            ..Series::default()
        };
        let plot = XyPlot {
            title: title.into(),
            x_label: x_label.into(),
            y_label: y_label.into(),
            points: sides.iter().zip(&impacts).map(series).collect(),
            size: PANEL_SIZE_PX,
            ..XyPlot::default()
        };
        plot.svg()
    };
    let (speed, slip, impulse) =
        ("speed of impact, m/s", "slip before impact, m/s", "impulse over mass, m/s");
    let plots = [
        plot("Rebound over approach", speed, "restitution", |[approach, _, normal, _]| {
            (approach, normal / approach - 1.0)
        }),
        plot("Impulse along the normal", speed, impulse, |[approach, _, normal, _]| (approach, normal)),
        plot("Impulse along the surface", slip, impulse, |[_, slip, _, tangential]| (slip, tangential)),
    ];
    Some(ReportFigure {
        name: "impacts",
        caption: "Every impact as the observations around it give it, and as both simulations have it. A restitution that falls with the \
                  speed, or an impulse along the surface that no friction explains, shows here."
            .into(),
        svg: panels("Impacts", &plots, 2),
    })
}

fn pairs(x: &[f64], y: &[f64]) -> Vec<(f64, f64)> {
    x.iter().copied().zip(y.iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_have_mean_positions_and_median_accelerations() {
        let columns = ["x", "y", "ax", "ay"].map(String::from).to_vec();
        let row = |x: f64, ax: f64| vec![Some(x), Some(0.0), Some(ax), Some(0.0)];
        let rows = vec![row(0.0, 1.0), row(0.01, 3.0), row(0.02, 100.0), row(1.0, -2.0), vec![None; 4]];
        let table = PlotTable { columns, rows };
        let cells = cell_medians(&table, ["ax".into(), "ay".into()]);
        assert_eq!(cells.len(), 2);
        assert!((cells[0].0[0] - 0.01).abs() < 1e-12 && cells[0].1 == [3.0, 0.0], "{cells:?}");
    }
}
