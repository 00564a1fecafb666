//! The library of candidates: every row of the effect registry, with places to start its search from.
//!
//! Effects join as candidates by standing in the registry, all but the one in which laws without a name are written. What is said here by name are better starts for those
//! whose parameters cannot be found by going downhill from nothing (where a patch lies, how long a gust's period is);
//! an effect without such advice starts from its neutral values and from small steps off them.

use std::f64::consts::PI;

use super::model::Term;
use super::window::{Kind, Window};
use crate::task::Scene;
use crate::task::scene::EffectTerm;
use crate::world::effect::{Effect, Parameter, REGISTRY, monomial};

/// What the data span: for starts.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    /// x_min, y_min, x_max, y_max of observed positions, m
    pub area: [f64; 4],
    /// Latest time on a trial's clock, s
    pub duration: f64,
    /// Typical speed, m/s
    pub speed: f64,
    /// Usual time between observations, s
    pub interval: f64,
    /// Whether anything touches anything.
    pub contacts: bool,
    /// Whether any stretch starts where the scene says, and not where something was seen or may be.
    pub runs: bool,
}

/// Where to start fitting each candidate: for every effect at least one start.
pub fn candidates(scene: &Scene, span: &Span) -> Vec<(&'static Effect, Vec<Term>)> {
    REGISTRY
        .iter()
        .copied()
        .filter(|e| e.name != monomial::EFFECT.name)
        .filter(|e| match e.acts_on {
            "contact" => span.contacts,
            // A free start takes up whatever a placement does, and one that was seen holds it.
            "action" => span.runs,
            _ => true,
        })
        .map(|e| {
            let per_setting = scene.per_setting.iter().any(|n| n == e.name);
            let terms = starts(e, span)
                .into_iter()
                .map(|start| Term {
                    effect: e,
                    per_setting,
                    start,
                    free: vec![true; e.parameters.len()],
                    difference: None,
                })
                .collect();
            (e, terms)
        })
        .collect()
}

/// The effect as the engine should be told in a window that starts at `clock` s on the trial's clock.
pub fn at_clock(effect: &Effect, values: &[f64], clock: f64) -> EffectTerm {
    let mut term = EffectTerm {
        name: effect.name.to_string(),
        parameters: effect.parameters.iter().zip(values).map(|(p, v)| (p.name.to_string(), *v)).collect(),
    };
    if clock != 0.0
        && let (Some(period), Some(phase)) =
            (term.parameters.get("period").copied(), term.parameters.get("phase").copied())
    {
        let turned = (phase + 2.0 * PI * clock / period).rem_euclid(2.0 * PI);
        term.parameters.insert("phase".into(), turned);
    }
    term
}

/// Difference for derivatives with respect to a parameter: far above rounding, far below what changes a path's shape;
/// for edges in space wide enough that some path crosses what is between.
pub fn difference(effect: &Effect, parameter: &Parameter) -> f64 {
    match parameter.unit {
        "m" if effect.acts_on == "region" => 0.03,
        "m/s^2" | "m/s" => 1e-2,
        "s" => 1e-4,
        _ => 2e-3,
    }
}

/// What an amplitude of a unit usually is in scenes of some metres, where one says nothing about it.
pub fn usual(unit: &str) -> f64 {
    match unit {
        "m/s^2" | "m/s" => 1.0,
        "1/s" => 0.5,
        "1/m" | "s/m" => 0.03,
        _ => 0.1,
    }
}

/// Values that a search may try: a sensor that is off by more than a fifth (or a fifth of a second or radian) is not an
/// error to discover but another sensor.
pub fn bounds(effect: &Effect, parameter: &Parameter) -> [f64; 2] {
    let [low, high] = parameter.bounds;
    if effect.acts_on == "sensor" {
        return [low.max(parameter.neutral - 0.2), high.min(parameter.neutral + 0.2)];
    }
    [low, high]
}

/// Whether a parameter only shapes its effect, which vanishes by others: it is not what a test of the effect tests.
pub fn shapes(parameter: &Parameter) -> bool {
    ["period", "phase", "x0", "y0", "x_min", "x_max", "y_min", "y_max", "ux", "uy"].contains(&parameter.name)
}

/// Starting values, best guesses first.
fn starts(effect: &Effect, span: &Span) -> Vec<Vec<f64>> {
    let neutral: Vec<f64> = effect.parameters.iter().map(|p| p.neutral).collect();
    let [x0, y0, x1, y1] = span.area;
    let (width, height) = (x1 - x0, y1 - y0);
    let at = |sx: f64, sy: f64| [x0 + sx * width, y0 + sy * height];
    match effect.name {
        "moving_air" => {
            let (u, k) = (0.5 * span.speed, 0.02 / (span.speed * span.duration).max(1e-9));
            vec![vec![u, 0.0, k], vec![-u, 0.0, k], vec![0.0, u, k], vec![0.0, -u, k]]
        }
        "gust" => {
            let mut out = Vec::new();
            for share in [0.25, 0.4, 0.65, 1.0, 1.6, 2.5] {
                let period = (share * span.duration).max(4.0 * span.interval);
                for phase in [0.0, PI / 2.0] {
                    out.push(vec![0.01, 0.01, period, phase]);
                }
            }
            out
        }
        "position_field" => {
            let a = 1e-2;
            [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
                .iter()
                .map(|s| {
                    let [x, y] = at(s[0], s[1]);
                    vec![a, a, x, y]
                })
                .collect()
        }
        "sticky_patch" => {
            let mut out = Vec::new();
            let cuts = [0.0, 0.25, 0.5, 0.75, 1.0];
            for i in 0..cuts.len() {
                for j in i + 1..cuts.len() {
                    if (i, j) != (0, 4) {
                        let (a, b) = (at(cuts[i], 0.0)[0], at(cuts[j], 0.0)[0]);
                        out.push(vec![a, b, y0 - height.max(0.1), y1 + height.max(0.1), 0.05]);
                    }
                }
            }
            // On the floor, where the data reach down to it.
            for (i, j) in [(0, 2), (1, 3), (2, 4)] {
                let (a, b) = (at(cuts[i], 0.0)[0], at(cuts[j], 0.0)[0]);
                out.push(vec![a, b, y0 - height.max(0.1), y0 + 0.3 * height, 0.05]);
            }
            for (low, high) in [(-0.5, 0.33), (-0.5, 0.6), (0.4, 1.5)] {
                out.push(vec![x0 - width, x1 + width, y0 + low * height, y0 + high * height, 0.05]);
            }
            out
        }
        _ => vec![neutral],
    }
}

/// What a recording spans.
pub fn span(windows: &[Window]) -> Span {
    let mut area = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let (mut duration, mut path, mut time, mut count) = (0.0f64, 0.0, 0.0, 0usize);
    for w in windows {
        for p in w.points.iter().filter(|p| p.weight > 0.0) {
            area = [
                area[0].min(p.seen[0]),
                area[1].min(p.seen[1]),
                area[2].max(p.seen[0]),
                area[3].max(p.seen[1]),
            ];
        }
        let last = w.points.last().map_or(0.0, |p| p.time);
        duration = duration.max(w.start + last);
        let bodies = w.scene.bodies.len();
        for (a, b) in w.points.iter().zip(w.points.iter().skip(bodies)).filter(|(a, b)| a.body == b.body) {
            path += (b.seen[0] - a.seen[0]).hypot(b.seen[1] - a.seen[1]);
            time += b.time - a.time;
            count += 1;
        }
    }
    Span {
        area,
        duration,
        speed: if time > 0.0 { path / time } else { 1.0 },
        interval: time / count.max(1) as f64,
        contacts: windows.iter().any(|w| w.kind != Kind::Flight),
        runs: windows.iter().any(|w| w.kind == Kind::Run),
    }
}
