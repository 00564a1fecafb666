//! Evidence of a diagnosis for plots: residuals before and after, missing accelerations and bounces.

use crate::error::Result;
use crate::inference::dynamics::Impact;
use crate::inference::mixed_model::fitted_model::ModelView;
use crate::inference::model::{self, SegmentData};
use crate::inference::segment::{Observation, Segment, SegmentKind};
use crate::inference::statistics::slope;

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
    /// Index of the segment.
    pub segment: usize,
    /// Index into the segment's bodies.
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
    pub predictive_sd: [[f64; 2]; 2],
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
const MIN_PIECE_OBSERVATIONS: usize = 7;
const MAX_PIECES: usize = 4;

/// Standard deviations of a model's residuals by segment and observation, m.
pub type ResidualSds = Vec<Vec<[f64; 2]>>;

/// Evidence from segments for a base and an extended model; `bands`: predictive standard deviations of either.
pub fn evidence(
    data: &SegmentData,
    [base, model]: [ModelView; 2],
    bands: [Option<ResidualSds>; 2],
    names: &[String],
) -> Result<Evidence> {
    let band = |k: usize, w: usize, i: usize| match &bands[k] {
        Some(bands) => bands[w][i],
        None => [f64::NAN; 2],
    };
    let paths = model::segment_states(data, model.layout, model.state)?;
    let mut out = Evidence { settings: names.to_vec(), ..Evidence::default() };
    for (w, segment) in data.segments.iter().enumerate() {
        data.progress.check_stop()?;
        if segment.kind.is_impact() {
            out.bounces.extend(bounce_record(segment, w, base, model));
            continue;
        }
        let point = |i: usize| {
            let pair = |r: &[f64]| [r[2 * i], r[2 * i + 1]];
            let point = EvidencePoint {
                trial: segment.trial,
                segment: w,
                body: segment.observations[i].body,
                setting: segment.setting,
                time: segment.start + segment.observations[i].time,
                position: segment.observations[i].position,
                velocity: [paths[w][i][2], paths[w][i][3]],
                before: pair(&base.evaluation.residuals[w]),
                after: pair(&model.evaluation.residuals[w]),
                predictive_sd: [band(0, w, i), band(1, w, i)],
            };
            let known = point.before.iter().chain(&point.after).all(|v| v.is_finite());
            known.then_some((i, point))
        };
        let points: Vec<(usize, EvidencePoint)> = (0..segment.observations.len()).filter_map(point).collect();
        if segment.kind == SegmentKind::Flight && points.len() >= MIN_PIECE_OBSERVATIONS {
            let of = |f: &ModelView| model::accelerations(segment, f.layout, &f.state.values, &paths[w]);
            let (with, without) = (of(&model), of(&base));
            let added: Vec<[f64; 2]> =
                points.iter().map(|(i, _)| [0, 1].map(|k| with[*i][k] - without[*i][k])).collect();
            let only: Vec<EvidencePoint> = points.iter().map(|p| p.1).collect();
            let count = (points.len() / MIN_PIECE_OBSERVATIONS).min(MAX_PIECES);
            for k in 0..count {
                let piece = k * points.len() / count..(k + 1) * points.len() / count;
                out.accelerations.push(missing_acceleration(&only[piece.clone()], &added[piece]));
            }
        }
        out.points.extend(points.into_iter().map(|p| p.1));
    }
    Ok(out)
}

/// Constant acceleration that best fits the residuals of a piece, with free initial position and velocity.
fn missing_acceleration(piece: &[EvidencePoint], added: &[[f64; 2]]) -> MissingAcceleration {
    let n = piece.len() as f64;
    let mean = |f: &dyn Fn(&EvidencePoint) -> f64| piece.iter().map(f).sum::<f64>() / n;
    let middle = mean(&|p| p.time);
    let [second, third, fourth] = [2, 3, 4].map(|k| mean(&|p| (p.time - middle).powi(k)));
    // t^2 / 2 without its constant and linear parts.
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
fn bounce_record(segment: &Segment, w: usize, base: ModelView, model: ModelView) -> Option<BounceRecord> {
    let [nx, ny] = segment.surface.as_ref()?.normal;
    let of = |f: &ModelView| model::impact(segment, w, f.layout, f.state);
    let (base, extended) = (of(&base)?, of(&model)?);
    let drift =
        |after: bool| residual_velocity(segment, &model.evaluation.residuals[w], extended.time, after);
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
    Some(BounceRecord { setting: segment.setting, observed, base: met(&base), extended: met(&extended) })
}

/// Slope of the residuals before or after a time since the segment's start, m/s; `None` with observations at
/// fewer than two times.
fn residual_velocity(segment: &Segment, residual: &[f64], time: f64, after: bool) -> Option<[f64; 2]> {
    let along = |axis: usize| {
        let row = |(i, p): (usize, &Observation)| (p.time, residual[2 * i + axis]);
        let candidate = |(t, r): &(f64, f64)| (*t > time) == after && r.is_finite();
        let rows: Vec<(f64, f64)> =
            segment.observations.iter().enumerate().map(row).filter(candidate).collect();
        slope(&rows)
    };
    Some([along(0)?, along(1)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Recovers an acceleration of (3, -2) from unevenly spaced times.
    #[test]
    fn missing_acceleration_is_recovered() {
        let piece: Vec<EvidencePoint> = (0..9)
            .map(|i| {
                let t = 5.0 + 0.1 * f64::from(i) + 0.02 * f64::from(i % 3);
                EvidencePoint {
                    trial: 0,
                    segment: 0,
                    body: 0,
                    setting: 0,
                    time: t,
                    position: [t, 1.0],
                    velocity: [3.0, 4.0],
                    before: [0.7 + 0.2 * t + 1.5 * t * t, 0.1 - t - t * t],
                    after: [0.0; 2],
                    predictive_sd: [[0.0; 2]; 2],
                }
            })
            .collect();
        let added: Vec<[f64; 2]> = piece.iter().map(|p| [p.time, 0.0]).collect();
        let acceleration = missing_acceleration(&piece, &added);
        assert!(
            (acceleration.observed[0] - 3.0).abs() < 1e-9 && (acceleration.observed[1] + 2.0).abs() < 1e-9,
            "{acceleration:?}"
        );
        assert!(
            (acceleration.modelled[0] - acceleration.position[0]).abs() < 1e-12 && acceleration.speed == 5.0
        );
    }
}
