//! Plots of what a diagnosis rests on: residuals with what the found effects do to them, the field that is missing, and
//! what contacts gave.

use iplw::discover::drawn::autocorrelation;
use iplw::discover::{Bounce, Evidence, EvidencePoint, Met, Push};
use iplw::picture::plot::{Arrows, Series, field, lines, scatter, scatter_with};

/// File name, caption and picture.
pub type Plot = (String, String, String);

/// Most points in a plot; more only make it heavy.
const MOST_POINTS: usize = 1500;
/// Points that a curve of means has at most, and observations that one mean is of at least.
const BINS: usize = 24;
const LEAST: usize = 12;
/// Cells of the field along x and y.
const CELLS: [usize; 2] = [10, 7];
/// Speed of approach, as a share of the largest, below which a bounce is not shown.
const FAINT: f64 = 0.05;
/// Most settings that a plot tells apart.
const SETTINGS: usize = 8;

/// Every plot that the evidence has data for.
pub fn plots(evidence: &Evidence) -> Vec<Plot> {
    if evidence.points.is_empty() {
        return Vec::new();
    }
    let mut out = residuals(evidence);
    out.push(autocorrelations(evidence));
    out.push(by_setting(evidence));
    out.extend(pushes(&evidence.pushes));
    out.extend(bounces(&evidence.bounces));
    out
}

fn plot(name: &str, caption: &str, svg: String) -> Plot {
    (name.into(), caption.into(), svg)
}

fn series(name: &str, points: Vec<(f64, f64)>) -> Series {
    Series { name: name.into(), points, band: None }
}

/// Few enough points, evenly taken.
fn thin(evidence: &Evidence) -> Vec<&EvidencePoint> {
    evidence.points.iter().step_by(evidence.points.len().div_ceil(MOST_POINTS)).collect()
}

fn speed(p: &EvidencePoint) -> f64 {
    p.velocity[0].hypot(p.velocity[1])
}

fn residuals(evidence: &Evidence) -> Vec<Plot> {
    type Of = fn(&EvidencePoint) -> f64;
    let over: [(&str, &str, Of); 6] = [
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
            let told = evidence.points.iter().map(|p| (of(p), p.before[axis] - p.after[axis]));
            let curve = series("what the extension makes of it, mean", means(told.collect()));
            let curves = if curve.points.iter().any(|p| p.1 != 0.0) { vec![curve] } else { Vec::new() };
            let title = format!("Residual in {letter} over {name}");
            let svg = scatter_with(&title, label, &format!("seen - simulated {letter}, m"), &both, &curves);
            out.push((format!("residual_{letter}_over_{name}"), title, svg));
        }
    }
    out
}

/// Means of neighbours along x, about as many in each.
fn means(mut points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    points.retain(|p| p.0.is_finite() && p.1.is_finite());
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let count = (points.len() / LEAST).clamp(1, BINS);
    let mean = |k: usize| {
        let bin = &points[k * points.len() / count..(k + 1) * points.len() / count];
        let sum = bin.iter().fold((0.0, 0.0), |s, p| (s.0 + p.0, s.1 + p.1));
        (sum.0 / bin.len() as f64, sum.1 / bin.len() as f64)
    };
    if points.is_empty() { Vec::new() } else { (0..count).map(mean).collect() }
}

fn autocorrelations(evidence: &Evidence) -> Plot {
    let by_lag = |name: &str, pick: fn(&EvidencePoint) -> [f64; 2]| {
        let values = autocorrelation(evidence, pick).into_iter().enumerate();
        series(name, values.map(|(lag, v)| (lag as f64, v)).collect())
    };
    let both = [by_lag("base model", |p| p.before), by_lag("extended model", |p| p.after)];
    let title = "Autocorrelation of residuals";
    let caption = "Autocorrelation of residuals: white noise has none beyond lag 0";
    plot("autocorrelation", caption, lines(title, "lag, observations", "correlation", &both))
}

fn by_setting(evidence: &Evidence) -> Plot {
    let thin = thin(evidence);
    let of = |(k, name): (usize, &String)| {
        let own = thin.iter().filter(|p| p.setting == k);
        let points = own.map(|p| (speed(p), p.before[0].hypot(p.before[1]))).collect();
        series(if name.is_empty() { "all" } else { name }, points)
    };
    let all: Vec<Series> = evidence.settings.iter().enumerate().take(SETTINGS).map(of).collect();
    let title = "Size of the base model's residual over speed, by setting";
    plot("by_setting", title, scatter(title, "speed, m/s", "residual, m", &all))
}

/// The acceleration that the base model lacks: over speed, and over the plane.
fn pushes(pushes: &[Push]) -> Vec<Plot> {
    if pushes.is_empty() {
        return Vec::new();
    }
    let stride = pushes.len().div_ceil(MOST_POINTS);
    let of = |axis: usize| pushes.iter().step_by(stride).map(move |p| (p.speed, p.seen[axis])).collect();
    let over_speed = [series("ax", of(0)), series("ay", of(1))];
    let found = |axis: usize| means(pushes.iter().map(|p| (p.speed, p.found[axis])).collect());
    let any = pushes.iter().any(|p| p.found != [0.0; 2]);
    let curves = match any {
        true => {
            vec![series("ax by the extension, mean", found(0)), series("ay by the extension, mean", found(1))]
        }
        false => Vec::new(),
    };
    let title = "Residual acceleration of pieces of flight over their speed";
    let svg = scatter_with(title, "speed, m/s", "acceleration, m/s^2", &over_speed, &curves);
    let mut arrows =
        vec![Arrows { name: "what the base model lacks".into(), arrows: cells(pushes, |p| p.seen) }];
    if any {
        arrows.push(Arrows { name: "what the extension adds".into(), arrows: cells(pushes, |p| p.found) });
    }
    let name = "Residual force field";
    let caption =
        "Residual force field, per mass: the median along each axis of the pieces of flight in each cell";
    vec![
        plot("acceleration", title, svg),
        plot("field", caption, field(name, "x, m", "y, m", "m/s^2", &arrows)),
    ]
}

/// For each cell with anything in it the mean place and the median push.
fn cells(pushes: &[Push], pick: fn(&Push) -> [f64; 2]) -> Vec<([f64; 2], [f64; 2])> {
    let span = [0, 1].map(|k| {
        let all = || pushes.iter().map(|p| p.position[k]);
        [all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max)]
    });
    let cell = |p: &Push| {
        [0, 1].map(|k| {
            let share = (p.position[k] - span[k][0]) / (span[k][1] - span[k][0]).max(1e-12);
            ((share * CELLS[k] as f64) as usize).min(CELLS[k] - 1)
        })
    };
    let mut filled = vec![Vec::new(); CELLS[0] * CELLS[1]];
    for p in pushes {
        let [i, j] = cell(p);
        filled[j * CELLS[0] + i].push(p);
    }
    let middle = |own: &[&Push], of: &dyn Fn(&Push) -> f64| {
        let mut values: Vec<f64> = own.iter().map(|p| of(p)).collect();
        values.sort_by(f64::total_cmp);
        0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2])
    };
    let arrow = |own: &Vec<&Push>| {
        let mean = |k: usize| own.iter().map(|p| p.position[k]).sum::<f64>() / own.len() as f64;
        ([mean(0), mean(1)], [middle(own, &|p| pick(p)[0]), middle(own, &|p| pick(p)[1])])
    };
    filled.iter().filter(|own| !own.is_empty()).map(arrow).collect()
}

fn bounces(bounces: &[Bounce]) -> Vec<Plot> {
    let largest = bounces.iter().map(|b| b.seen.approach).fold(0.0, f64::max);
    // What hardly approaches says nothing.
    let told: Vec<&Bounce> = bounces
        .iter()
        .filter(|b| [b.seen, b.base, b.extended].iter().all(|m| m.approach > FAINT * largest))
        .collect();
    if told.is_empty() {
        return Vec::new();
    }
    let three = |at: fn(&Met) -> (f64, f64)| {
        [
            series("seen", told.iter().map(|b| at(&b.seen)).collect()),
            series("base model", told.iter().map(|b| at(&b.base)).collect()),
            series("extended model", told.iter().map(|b| at(&b.extended)).collect()),
        ]
    };
    let drawn = |name: &str, title: &str, x: &str, y: &str, at: fn(&Met) -> (f64, f64)| {
        let caption = format!("{title}, by the observations around each bounce and by both models");
        (name.to_string(), caption, scatter(title, x, y, &three(at)))
    };
    let (impact, impulse) = ("impact speed, m/s", "impulse over mass, m/s");
    vec![
        drawn("impulse", "Impulse along the normal over the speed of impact", impact, impulse, |m| {
            (m.approach, m.impulse[0])
        }),
        drawn("impulse_along", "Impulse along the surface over the slip before", "slip, m/s", impulse, |m| {
            (m.slip, m.impulse[1])
        }),
        drawn(
            "restitution",
            "Restitution over the speed of impact",
            impact,
            "rebound over impact speed",
            |m| (m.approach, m.impulse[0] / m.approach - 1.0),
        ),
    ]
}
