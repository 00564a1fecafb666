//! Evidence of a diagnosis for plots: residuals before and after, missing accelerations and bounces.

use super::fit::Shown;
use super::model::{self, Data};
use super::path::Impact;
use super::stats::slope;
use super::window::{Kind, Point, Window};
use crate::error::Result;

/// Residuals, missing accelerations and bounces.
#[derive(Clone, Debug, Default)]
pub struct Evidence {
    pub points: Vec<EvidencePoint>,
    pub accelerations: Vec<MissingAcceleration>,
    pub bounces: Vec<BounceRecord>,
    /// Names of the settings, in the order of their indices.
    pub settings: Vec<String>,
}

/// An observation with the residuals of both models; unused observations are omitted.
#[derive(Clone, Copy, Debug)]
pub struct EvidencePoint {
    /// Index of the trial.
    pub trial: usize,
    /// Index of the window.
    pub window: usize,
    /// Index into the window's bodies.
    pub body: usize,
    /// Index into [`Evidence::settings`].
    pub setting: usize,
    /// s on the trial's clock
    pub time: f64,
    /// Observed position, m.
    pub position: [f64; 2],
    /// Velocity by the extended model, m/s.
    pub velocity: [f64; 2],
    /// Observed minus simulated position by the base model, m.
    pub before: [f64; 2],
    /// Observed minus simulated position by the extended model, m.
    pub after: [f64; 2],
    /// Predictive standard deviations of `before` and `after`, m; NaN if unknown.
    pub bands: [[f64; 2]; 2],
}

/// Part of a flight and the acceleration that the base model lacks along it.
#[derive(Clone, Copy, Debug)]
pub struct MissingAcceleration {
    /// Mean position, m.
    pub position: [f64; 2],
    /// Mean speed, m/s.
    pub speed: f64,
    /// Acceleration from the base model's residuals, m/s^2.
    pub observed: [f64; 2],
    /// Mean acceleration by the effects that the extended model adds, m/s^2.
    pub modelled: [f64; 2],
}

/// A bounce on a static body.
#[derive(Clone, Copy, Debug)]
pub struct BounceRecord {
    pub setting: usize,
    /// From the surrounding observations.
    pub observed: ImpactRecord,
    pub base: ImpactRecord,
    pub extended: ImpactRecord,
}

/// Kinematics of an impact.
#[derive(Clone, Copy, Debug)]
pub struct ImpactRecord {
    /// Normal approach speed, m/s.
    pub approach_speed: f64,
    /// Tangential slip speed of the rim before impact, m/s.
    pub slip_speed: f64,
    /// Impulse over mass along the normal and along the surface, m/s.
    pub impulse: [f64; 2],
}

/// Minimum number of observations per part of a flight, and maximum number of parts.
const PIECE: usize = 7;
const PIECES: usize = 4;

/// Standard deviations of a model's residuals, m: by window and point.
pub type Bands = Vec<Vec<[f64; 2]>>;

/// Evidence from segments for a base and an extended model; `bands`: predictive standard deviations of either.
pub fn evidence(
    data: &Data,
    [base, model]: [Shown; 2],
    bands: [Option<Bands>; 2],
    names: &[String],
) -> Result<Evidence> {
    let band = |k: usize, w: usize, i: usize| match &bands[k] {
        Some(bands) => bands[w][i],
        None => [f64::NAN; 2],
    };
    let paths = model::paths(data, model.layout, model.state)?;
    let mut out = Evidence { settings: names.to_vec(), ..Evidence::default() };
    for (w, window) in data.windows.iter().enumerate() {
        data.progress.check_stop()?;
        if window.kind == Kind::Contact {
            out.bounces.extend(bounce(window, w, base, model));
            continue;
        }
        let point = |i: usize| {
            let pair = |r: &[f64]| [r[2 * i], r[2 * i + 1]];
            let point = EvidencePoint {
                trial: window.trial,
                window: w,
                body: window.points[i].body,
                setting: window.setting,
                time: window.start + window.points[i].time,
                position: window.points[i].seen,
                velocity: [paths[w][i][2], paths[w][i][3]],
                before: pair(&base.pass.residuals[w]),
                after: pair(&model.pass.residuals[w]),
                bands: [band(0, w, i), band(1, w, i)],
            };
            let known = point.before.iter().chain(&point.after).all(|v| v.is_finite());
            known.then_some((i, point))
        };
        let points: Vec<(usize, EvidencePoint)> = (0..window.points.len()).filter_map(point).collect();
        if window.kind == Kind::Flight && points.len() >= PIECE {
            let of = |f: &Shown| model::pushes(window, f.layout, &f.state.values, &paths[w]);
            let (with, without) = (of(&model), of(&base));
            let added: Vec<[f64; 2]> =
                points.iter().map(|(i, _)| [0, 1].map(|k| with[*i][k] - without[*i][k])).collect();
            let only: Vec<EvidencePoint> = points.iter().map(|p| p.1).collect();
            let count = (points.len() / PIECE).min(PIECES);
            for k in 0..count {
                let piece = k * points.len() / count..(k + 1) * points.len() / count;
                out.accelerations.push(pushed(&only[piece.clone()], &added[piece]));
            }
        }
        out.points.extend(points.into_iter().map(|p| p.1));
    }
    Ok(out)
}

/// The constant acceleration that a piece's base residuals are nearest to, its start and velocity being free.
fn pushed(piece: &[EvidencePoint], added: &[[f64; 2]]) -> MissingAcceleration {
    let n = piece.len() as f64;
    let mean = |f: &dyn Fn(&EvidencePoint) -> f64| piece.iter().map(f).sum::<f64>() / n;
    let middle = mean(&|p| p.time);
    let [second, third, fourth] = [2, 3, 4].map(|k| mean(&|p| (p.time - middle).powi(k)));
    // t^2 / 2 with what is constant and what is linear in time taken out.
    let curve = |p: &EvidencePoint| {
        let t = p.time - middle;
        0.5 * (t * t - second - third / second.max(1e-300) * t)
    };
    let square = 0.25 * (fourth - second * second - third * third / second.max(1e-300));
    let along = |axis: usize| mean(&|p| curve(p) * p.before[axis]) / square.max(1e-300);
    let average = |axis: usize| added.iter().map(|a| a[axis]).sum::<f64>() / n;
    MissingAcceleration {
        position: [mean(&|p| p.position[0]), mean(&|p| p.position[1])],
        speed: mean(&|p| p.velocity[0].hypot(p.velocity[1])),
        observed: [along(0), along(1)],
        modelled: [average(0), average(1)],
    }
}

/// Impact kinematics: by the models, and by the extended model's residuals before and after.
fn bounce(window: &Window, w: usize, base: Shown, model: Shown) -> Option<BounceRecord> {
    let [nx, ny] = window.surface.as_ref()?.normal;
    let of = |f: &Shown| model::impact(window, w, f.layout, f.state);
    let (base, extended) = (of(&base)?, of(&model)?);
    let drift = |after: bool| drift(window, &model.pass.residuals[w], extended.time, after);
    let (before, after) = (drift(false)?, drift(true)?);
    let along = |v: [f64; 2]| [v[0] * nx + v[1] * ny, v[1] * nx - v[0] * ny];
    let (before, kink) = (along(before), along([after[0] - before[0], after[1] - before[1]]));
    let met = |i: &Impact| ImpactRecord {
        approach_speed: i.approach,
        slip_speed: i.slip,
        impulse: [i.normal, i.tangent],
    };
    let observed = ImpactRecord {
        approach_speed: extended.approach - before[0],
        slip_speed: extended.slip + before[1],
        impulse: [extended.normal + kink[0], extended.tangent + kink[1]],
    };
    Some(BounceRecord { setting: window.setting, observed, base: met(&base), extended: met(&extended) })
}

/// The residuals' velocity before or after a time since the window's start, m/s; `None` with observations at fewer than
/// two times there.
fn drift(window: &Window, residual: &[f64], time: f64, after: bool) -> Option<[f64; 2]> {
    let along = |axis: usize| {
        let row = |(i, p): (usize, &Point)| (p.time, residual[2 * i + axis]);
        let there = |(t, r): &(f64, f64)| (*t > time) == after && r.is_finite();
        let rows: Vec<(f64, f64)> = window.points.iter().enumerate().map(row).filter(there).collect();
        slope(&rows)
    };
    Some([along(0)?, along(1)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Recovers an acceleration of (3, -2) from unevenly spaced times.
    #[test]
    fn a_piece_shows_its_push() {
        let piece: Vec<EvidencePoint> = (0..9)
            .map(|i| {
                let t = 5.0 + 0.1 * f64::from(i) + 0.02 * f64::from(i % 3);
                EvidencePoint {
                    trial: 0,
                    window: 0,
                    body: 0,
                    setting: 0,
                    time: t,
                    position: [t, 1.0],
                    velocity: [3.0, 4.0],
                    before: [0.7 + 0.2 * t + 1.5 * t * t, 0.1 - t - t * t],
                    after: [0.0; 2],
                    bands: [[0.0; 2]; 2],
                }
            })
            .collect();
        let added: Vec<[f64; 2]> = piece.iter().map(|p| [p.time, 0.0]).collect();
        let push = pushed(&piece, &added);
        assert!((push.observed[0] - 3.0).abs() < 1e-9 && (push.observed[1] + 2.0).abs() < 1e-9, "{push:?}");
        assert!((push.modelled[0] - push.position[0]).abs() < 1e-12 && push.speed == 5.0);
    }
}
