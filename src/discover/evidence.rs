//! What a diagnosis rests on, point by point, for pictures: residuals before and after, the pushes that they show, and
//! what contacts gave.

use super::judge::Fitted;
use super::model::{self, Data, Layout};
use super::path::Impact;
use super::window::{Kind, Window};
use crate::error::Result;

/// Residuals point by point.
#[derive(Clone, Debug, Default)]
pub struct Evidence {
    pub points: Vec<EvidencePoint>,
    pub pushes: Vec<Push>,
    pub bounces: Vec<Bounce>,
    /// Names of the settings, in the order of their indices.
    pub settings: Vec<String>,
}

/// An observation with what the models leave of it.
#[derive(Clone, Copy, Debug)]
pub struct EvidencePoint {
    /// Index of the trial.
    pub trial: usize,
    /// Index of the window.
    pub window: usize,
    /// Index into [`Evidence::settings`].
    pub setting: usize,
    /// s on the trial's clock
    pub time: f64,
    /// m
    pub position: [f64; 2],
    /// m/s, of the extended model
    pub velocity: [f64; 2],
    /// Seen - simulated, m, by the base model.
    pub before: [f64; 2],
    /// Seen - simulated, m, by the extended model.
    pub after: [f64; 2],
}

/// A piece of a path and the acceleration that the base model lacks along it.
#[derive(Clone, Copy, Debug)]
pub struct Push {
    /// Mean of the piece, m.
    pub position: [f64; 2],
    /// m/s, mean of the piece
    pub speed: f64,
    /// m/s^2, by the base model's residuals
    pub seen: [f64; 2],
    /// m/s^2, by what the extended model has and the base model has not; mean of the piece
    pub found: [f64; 2],
}

/// A bounce on a static.
#[derive(Clone, Copy, Debug)]
pub struct Bounce {
    pub setting: usize,
    /// Speed of approach along the normal, m/s.
    pub approach: f64,
    /// Speed of the disc's rim along the surface before, m/s.
    pub slip: f64,
    /// Impulse over mass along the normal and along the surface, m/s, by the observations around the bounce.
    pub seen: [f64; 2],
    /// The same by the base model.
    pub base: [f64; 2],
    /// The same by the extended model.
    pub found: [f64; 2],
}

/// Fewest observations of a piece that shows an acceleration, and the share of a window that a piece is.
const PIECE: usize = 7;
const SHARE: f64 = 0.25;

/// What the windows show of a base model and an extended one.
pub fn evidence(
    windows: &[Window],
    data: &Data,
    base: &Fitted,
    model: &Fitted,
    names: &[String],
) -> Result<Evidence> {
    let paths = model::paths(data, &model.layout, &model.state)?;
    let mut out = Evidence { settings: names.to_vec(), ..Evidence::default() };
    for (w, window) in windows.iter().enumerate() {
        if window.kind == Kind::Contact {
            out.bounces.extend(bounce(window, w, base, model));
            continue;
        }
        let points: Vec<EvidencePoint> = (0..window.points.len())
            .filter(|i| window.points[*i].weight > 0.0)
            .map(|i| {
                let pair = |r: &[f64]| [r[2 * i], r[2 * i + 1]];
                EvidencePoint {
                    trial: window.trial,
                    window: w,
                    setting: window.setting,
                    time: window.start + window.points[i].time,
                    position: window.points[i].seen,
                    velocity: [paths[w][i][2], paths[w][i][3]],
                    before: pair(&base.pass.residuals[w]),
                    after: pair(&model.pass.residuals[w]),
                }
            })
            .collect();
        if matches!(window.kind, Kind::Flight | Kind::Roll) {
            let of = |p: &EvidencePoint| {
                let state = [p.position[0], p.position[1], p.velocity[0], p.velocity[1]];
                let push =
                    |layout: &Layout, values: &[f64]| model::push(window, layout, values, p.time, state);
                let (with, without) =
                    (push(&model.layout, &model.state.values), push(&base.layout, &base.state.values));
                [with[0] - without[0], with[1] - without[1]]
            };
            let length = ((SHARE * points.len() as f64) as usize).max(PIECE);
            out.pushes.extend(points.chunks_exact(length).map(|piece| pushed(piece, of)));
        }
        out.points.extend(points);
    }
    Ok(out)
}

/// The constant acceleration that a piece's base residuals are nearest to, its start and velocity being free.
fn pushed(piece: &[EvidencePoint], found: impl Fn(&EvidencePoint) -> [f64; 2]) -> Push {
    let n = piece.len() as f64;
    let mean = |f: &dyn Fn(&EvidencePoint) -> f64| piece.iter().map(f).sum::<f64>() / n;
    let middle = mean(&|p| p.time);
    let (second, third, fourth) = (
        mean(&|p| (p.time - middle).powi(2)),
        mean(&|p| (p.time - middle).powi(3)),
        mean(&|p| (p.time - middle).powi(4)),
    );
    // t^2 / 2 with what is constant and what is linear in time taken out.
    let curve = |p: &EvidencePoint| {
        let t = p.time - middle;
        0.5 * (t * t - second - third / second.max(1e-300) * t)
    };
    let square = 0.25 * (fourth - second * second - third * third / second.max(1e-300));
    let along = |axis: usize| mean(&|p| curve(p) * p.before[axis]) / square.max(1e-300);
    Push {
        position: [mean(&|p| p.position[0]), mean(&|p| p.position[1])],
        speed: mean(&|p| p.velocity[0].hypot(p.velocity[1])),
        seen: [along(0), along(1)],
        found: [mean(&|p| found(p)[0]), mean(&|p| found(p)[1])],
    }
}

/// What a contact gave: by the models, and by the kink that the extended model's residuals still have there.
fn bounce(window: &Window, w: usize, base: &Fitted, model: &Fitted) -> Option<Bounce> {
    let normal = window.surface.as_ref()?.normal;
    let of = |f: &Fitted| model::impact(window, w, &f.layout, &f.state);
    let (base, found) = (of(base)?, of(model)?);
    let kink = kink(window, &model.pass.residuals[w], found.time - window.start)?;
    let both = |i: &Impact| [i.normal, i.tangent];
    Some(Bounce {
        setting: window.setting,
        approach: found.approach,
        slip: found.slip,
        seen: [
            found.normal + kink[0] * normal[0] + kink[1] * normal[1],
            found.tangent - kink[0] * normal[1] + kink[1] * normal[0],
        ],
        base: both(&base),
        found: both(&found),
    })
}

/// By how much the residuals' velocity changes at a time since the window's start, m/s; `None` with fewer than two
/// observations on a side.
fn kink(window: &Window, residual: &[f64], time: f64) -> Option<[f64; 2]> {
    let slope = |axis: usize, after: bool| {
        let known =
            |i: &usize| (window.points[*i].time > time) == after && residual[2 * i + axis].is_finite();
        let rows: Vec<usize> = (0..window.points.len()).filter(known).collect();
        let n = rows.len() as f64;
        let (t, r) = (|i: usize| window.points[i].time, |i: usize| residual[2 * i + axis]);
        let mean = rows.iter().map(|i| t(*i)).sum::<f64>() / n;
        let down: f64 = rows.iter().map(|i| (t(*i) - mean).powi(2)).sum();
        let up: f64 = rows.iter().map(|i| (t(*i) - mean) * r(*i)).sum();
        (rows.len() >= 2 && down > 0.0).then(|| up / down)
    };
    Some([slope(0, true)? - slope(0, false)?, slope(1, true)? - slope(1, false)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uneven times, a start of its own, and a push of (3, -2): it is found, and nothing else.
    #[test]
    fn a_piece_shows_its_push() {
        let piece: Vec<EvidencePoint> = (0..9)
            .map(|i| {
                let t = 5.0 + 0.1 * f64::from(i) + 0.02 * f64::from(i % 3);
                EvidencePoint {
                    trial: 0,
                    window: 0,
                    setting: 0,
                    time: t,
                    position: [t, 1.0],
                    velocity: [3.0, 4.0],
                    before: [0.7 + 0.2 * t + 1.5 * t * t, 0.1 - t - t * t],
                    after: [0.0; 2],
                }
            })
            .collect();
        let push = pushed(&piece, |p| [p.time, 0.0]);
        assert!((push.seen[0] - 3.0).abs() < 1e-9 && (push.seen[1] + 2.0).abs() < 1e-9, "{push:?}");
        assert!((push.found[0] - push.position[0]).abs() < 1e-12 && push.speed == 5.0);
    }
}
