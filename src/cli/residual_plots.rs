//! Plots of the evidence of a diagnosis: residuals before and after the extension, missing accelerations, and impacts.

use iplw::inference::report::plot_tables::autocorrelation;
use iplw::inference::{BounceRecord, Evidence, EvidencePoint, ImpactRecord, MissingAcceleration};
use iplw::picture::plot::{Arrows, Series, lines, quiver, scatter, scatter_with};

/// File name, caption and SVG.
pub type PlotFile = (String, String, String);

/// Maximal number of points in a plot.
const MAX_POINTS: usize = 1500;
/// Maximal number of points of a curve of means, and minimal number of observations for each.
const MAX_BINS: usize = 24;
const MIN_POINTS_PER_BIN: usize = 12;
/// Cells of the force field along x and y.
const FIELD_CELLS: [usize; 2] = [10, 7];
/// Approach speed relative to the largest below which an impact is not shown.
const MIN_APPROACH_SHARE: f64 = 0.05;
/// Maximal number of settings in a plot.
const MAX_SETTINGS: usize = 8;

/// Every plot that the evidence has data for.
pub fn plots(evidence: &Evidence) -> Vec<PlotFile> {
    if evidence.points.is_empty() {
        return Vec::new();
    }
    let mut out = residuals(evidence);
    out.push(autocorrelations(evidence));
    out.push(by_setting(evidence));
    out.extend(acceleration_plots(&evidence.accelerations));
    out.extend(impact_plots(&evidence.bounces));
    out
}

fn plot_file(name: &str, caption: &str, svg: String) -> PlotFile {
    (name.into(), caption.into(), svg)
}

fn series(name: &str, points: Vec<(f64, f64)>) -> Series {
    Series { name: name.into(), points, band: None }
}

/// At most [`MAX_POINTS`] points, evenly spaced.
fn thin(evidence: &Evidence) -> Vec<&EvidencePoint> {
    evidence.points.iter().step_by(evidence.points.len().div_ceil(MAX_POINTS)).collect()
}

fn speed(p: &EvidencePoint) -> f64 {
    p.velocity[0].hypot(p.velocity[1])
}

fn residuals(evidence: &Evidence) -> Vec<PlotFile> {
    type PointQuantity = fn(&EvidencePoint) -> f64;
    let over: [(&str, &str, PointQuantity); 6] = [
        ("time", "t, s", |p| p.time),
        ("x", "x, m", |p| p.position[0]),
        ("y", "y, m", |p| p.position[1]),
        ("speed", "speed, m/s", speed),
        ("vx", "vx, m/s", |p| p.velocity[0]),
        ("vy", "vy, m/s", |p| p.velocity[1]),
    ];
    let thin = thin(evidence);
    let mut out = Vec::new();
    for (name, label, of) in over {
        for (axis, letter) in ["x", "y"].iter().enumerate() {
            let cloud = |name: &str, pick: fn(&EvidencePoint) -> [f64; 2]| {
                series(name, thin.iter().map(|p| (of(p), pick(p)[axis])).collect())
            };
            let both = [cloud("base model", |p| p.before), cloud("extended model", |p| p.after)];
            let impacts = evidence.points.iter().map(|p| (of(p), p.before[axis] - p.after[axis]));
            let curve = series("difference made by the extension, mean", means(impacts.collect()));
            let curves = if curve.points.iter().any(|p| p.1 != 0.0) { vec![curve] } else { Vec::new() };
            let title = format!("Residual in {letter} over {name}");
            let svg =
                scatter_with(&title, label, &format!("observed - simulated {letter}, m"), &both, &curves);
            out.push((format!("residual_{letter}_over_{name}"), title, svg));
        }
    }
    out
}

/// Means over bins along x with about equal counts.
fn means(mut points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    points.retain(|p| p.0.is_finite() && p.1.is_finite());
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let count = (points.len() / MIN_POINTS_PER_BIN).clamp(1, MAX_BINS);
    let mean = |k: usize| {
        let bin = &points[k * points.len() / count..(k + 1) * points.len() / count];
        let sum = bin.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
        (sum.0 / bin.len() as f64, sum.1 / bin.len() as f64)
    };
    if points.is_empty() { Vec::new() } else { (0..count).map(mean).collect() }
}

fn autocorrelations(evidence: &Evidence) -> PlotFile {
    let by_lag = |name: &str, pick: fn(&EvidencePoint) -> [f64; 2]| {
        let values = autocorrelation(evidence, pick).into_iter().enumerate();
        series(name, values.map(|(lag, v)| (lag as f64, v)).collect())
    };
    let both = [by_lag("base model", |p| p.before), by_lag("extended model", |p| p.after)];
    let title = "Autocorrelation of residuals";
    let caption = "Autocorrelation of residuals: white noise has none beyond lag 0";
    plot_file("autocorrelation", caption, lines(title, "lag, observations", "correlation", &both))
}

fn by_setting(evidence: &Evidence) -> PlotFile {
    let thin = thin(evidence);
    let of = |(k, name): (usize, &String)| {
        let own = thin.iter().filter(|p| p.setting == k);
        let points = own.map(|p| (speed(p), p.before[0].hypot(p.before[1]))).collect();
        series(if name.is_empty() { "all" } else { name }, points)
    };
    let all: Vec<Series> = evidence.settings.iter().enumerate().take(MAX_SETTINGS).map(of).collect();
    let title = "Size of the base model's residual over speed, by setting";
    plot_file("by_setting", title, scatter(title, "speed, m/s", "residual, m", &all))
}

/// The acceleration that the base model lacks, over speed and over the plane.
fn acceleration_plots(pushes: &[MissingAcceleration]) -> Vec<PlotFile> {
    if pushes.is_empty() {
        return Vec::new();
    }
    let stride = pushes.len().div_ceil(MAX_POINTS);
    let of = |axis: usize| pushes.iter().step_by(stride).map(move |p| (p.speed, p.observed[axis])).collect();
    let over_speed = [series("ax", of(0)), series("ay", of(1))];
    let found = |axis: usize| means(pushes.iter().map(|p| (p.speed, p.modelled[axis])).collect());
    let any = pushes.iter().any(|p| p.modelled != [0.0; 2]);
    let curves = match any {
        true => {
            vec![series("ax by the extension, mean", found(0)), series("ay by the extension, mean", found(1))]
        }
        false => Vec::new(),
    };
    let title = "Residual acceleration of flight segments over speed";
    let svg = scatter_with(title, "speed, m/s", "acceleration, m/s^2", &over_speed, &curves);
    let mut arrows = vec![Arrows {
        name: "missing in the base model".into(),
        arrows: cell_medians(pushes, |p| p.observed),
    }];
    if any {
        arrows.push(Arrows {
            name: "added by the extension".into(),
            arrows: cell_medians(pushes, |p| p.modelled),
        });
    }
    let name = "Residual force field";
    let caption = "Residual force per mass: median along each axis of the flight segments in each cell";
    vec![
        plot_file("acceleration", title, svg),
        plot_file("field", caption, quiver(name, "x, m", "y, m", "m/s^2", &arrows)),
    ]
}

/// Mean position and median acceleration of each cell that isn't empty.
fn cell_medians(
    pushes: &[MissingAcceleration],
    pick: fn(&MissingAcceleration) -> [f64; 2],
) -> Vec<([f64; 2], [f64; 2])> {
    let span = [0, 1].map(|k| {
        let all = || pushes.iter().map(|p| p.position[k]);
        [all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max)]
    });
    let cell = |p: &MissingAcceleration| {
        [0, 1].map(|k| {
            let share = (p.position[k] - span[k][0]) / (span[k][1] - span[k][0]).max(1e-12);
            ((share * FIELD_CELLS[k] as f64) as usize).min(FIELD_CELLS[k] - 1)
        })
    };
    let mut filled = vec![Vec::new(); FIELD_CELLS[0] * FIELD_CELLS[1]];
    for p in pushes {
        let [i, j] = cell(p);
        filled[j * FIELD_CELLS[0] + i].push(p);
    }
    let middle = |own: &[&MissingAcceleration], of: &dyn Fn(&MissingAcceleration) -> f64| {
        let mut values: Vec<f64> = own.iter().map(|p| of(p)).collect();
        values.sort_by(f64::total_cmp);
        0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2])
    };
    let arrow = |own: &Vec<&MissingAcceleration>| {
        let mean = |k: usize| own.iter().map(|p| p.position[k]).sum::<f64>() / own.len() as f64;
        ([mean(0), mean(1)], [middle(own, &|p| pick(p)[0]), middle(own, &|p| pick(p)[1])])
    };
    filled.iter().filter(|own| !own.is_empty()).map(arrow).collect()
}

fn impact_plots(bounces: &[BounceRecord]) -> Vec<PlotFile> {
    let largest = bounces.iter().map(|b| b.observed.approach_speed).fold(0.0, f64::max);
    // Slow impacts are dominated by noise.
    let impacts: Vec<&BounceRecord> = bounces
        .iter()
        .filter(|b| {
            [b.observed, b.base, b.extended].iter().all(|m| m.approach_speed > MIN_APPROACH_SHARE * largest)
        })
        .collect();
    if impacts.is_empty() {
        return Vec::new();
    }
    let three = |at: fn(&ImpactRecord) -> (f64, f64)| {
        [
            series("observed", impacts.iter().map(|b| at(&b.observed)).collect()),
            series("base model", impacts.iter().map(|b| at(&b.base)).collect()),
            series("extended model", impacts.iter().map(|b| at(&b.extended)).collect()),
        ]
    };
    let drawn = |name: &str, title: &str, x: &str, y: &str, at: fn(&ImpactRecord) -> (f64, f64)| {
        let caption = format!("{title}, from the observations around each impact and from both models");
        (name.to_string(), caption, scatter(title, x, y, &three(at)))
    };
    let (impact, impulse) = ("impact speed, m/s", "impulse over mass, m/s");
    vec![
        drawn("impulse", "Impulse along the normal over the speed of impact", impact, impulse, |m| {
            (m.approach_speed, m.impulse[0])
        }),
        drawn("impulse_along", "Impulse along the surface over the slip before", "slip, m/s", impulse, |m| {
            (m.slip_speed, m.impulse[1])
        }),
        drawn(
            "restitution",
            "Restitution over the speed of impact",
            impact,
            "rebound over impact speed",
            |m| (m.approach_speed, m.impulse[0] / m.approach_speed - 1.0),
        ),
    ]
}
