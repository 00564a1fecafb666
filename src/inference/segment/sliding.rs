//! Whether a body that a surface supports slides rather than rolls.

use nalgebra::{DMatrix, DVector};

use super::definition::Surface;
use crate::inference::data::smoothing::TimedPosition;
use crate::task::Scene;

/// Log likelihood ratio of a change of acceleration, nats: far above chance with any place of the change.
const MIN_LOG_LIKELIHOOD_RATIO: f64 = 15.0;
/// A body that ends with less than this share of its first speed comes to rest: rolling resistance does that, too.
const MIN_FINAL_SPEED: f64 = 0.2;
/// Observations on each side of a change.
const MIN_SIDE: usize = 4;

/// The beginning of a slide.
pub struct Slide {
    /// Along (ny, -nx), m/s.
    pub speed: f64,
    /// Of the body's side of the contact, m/s; 0 if it is pulled into slipping.
    pub slip: f64,
}

/// The slide of a body along a surface; `None` if it rolls. A block slides. A disc slides if the slope is too steep for the
/// scene's friction, or if it decelerates at first and less from some time on.
pub fn slide(rows: &[TimedPosition], surface: &Surface, scene: &Scene) -> Option<Slide> {
    let n = surface.normal;
    let start = rows[0].0;
    let way: Vec<(f64, f64)> = rows.iter().map(|(t, p)| (t - start, p[0] * n[1] - p[1] * n[0])).collect();
    let whole = fit(&way, None)?;
    let [gx, gy] = scene.gravity;
    let (along, load) = (gx * n[1] - gy * n[0], -(gx * n[0] + gy * n[1]));
    let [a, b] = [0, 1].map(|k| [surface.friction[k], surface.restitution[k]]);
    let [friction, _] = scene.contact_rules.unwrap_or_default().of_contact(a, b);
    let cut = (MIN_SIDE..way.len().saturating_sub(MIN_SIDE))
        .filter_map(|i| fit(&way, Some(way[i].0)))
        .min_by(|a, b| a.square.total_cmp(&b.square))
        .filter(|cut| {
            let ratio = 0.5 * way.len() as f64 * (whole.square / cut.square.max(f64::MIN_POSITIVE)).ln();
            ratio > MIN_LOG_LIKELIHOOD_RATIO && cut.accelerations[0].abs() > cut.accelerations[1].abs()
        });
    if surface.inertia.is_infinite() {
        return Some(Slide { speed: cut.map_or(whole.speed, |c| c.speed), slip: 0.0 });
    }
    if along.abs() > friction * load * (1.0 + surface.inertia.recip()) {
        return Some(Slide { speed: whole.speed, slip: 0.0 });
    }
    let cut = cut.filter(|cut| cut.final_speed.abs() > MIN_FINAL_SPEED * cut.speed.abs())?;
    let slip = -(cut.accelerations[0] - cut.accelerations[1]) * (1.0 + surface.inertia.recip()) * cut.time;
    Some(Slide { speed: cut.speed, slip })
}

/// Parabolas through positions (s, m), with one acceleration before and another after a time.
struct ParabolaFit {
    square: f64,
    time: f64,
    speed: f64,
    final_speed: f64,
    accelerations: [f64; 2],
}

fn fit(way: &[(f64, f64)], change: Option<f64>) -> Option<ParabolaFit> {
    let count = if change.is_some() { 4 } else { 3 };
    let time = change.unwrap_or(f64::INFINITY);
    let basis = DMatrix::from_fn(way.len(), count, |i, k| match k {
        3 => 0.5 * (way[i].0 - time).max(0.0).powi(2),
        2 => 0.5 * way[i].0 * way[i].0,
        _ => way[i].0.powi(k as i32),
    });
    let y = DVector::from_fn(way.len(), |i, _| way[i].1);
    let beta = basis.clone().svd(true, true).solve(&y, 1e-12).ok()?;
    let square = (&y - &basis * &beta).norm_squared();
    let (last, more) = (way[way.len() - 1].0, beta.get(3).copied().unwrap_or(0.0));
    let final_speed = beta[1] + beta[2] * last + more * (last - time).max(0.0);
    Some(ParabolaFit { square, time, speed: beta[1], final_speed, accelerations: [beta[2], beta[2] + more] })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(inertia: f64) -> Surface {
        Surface {
            static_index: 0,
            normal: [0.0, 1.0],
            level: 0.0,
            friction: [0.2, 1.0],
            restitution: [0.0; 2],
            carries_latents: [true, false],
            radius: 0.03,
            inertia,
            corner: None,
            angle_prior_sd: 0.0,
            spin_prior_sd: 300.0,
        }
    }

    /// A way observed 120 times a second with a noise of half a millimetre.
    fn rows(way: impl Fn(f64) -> f64) -> Vec<TimedPosition> {
        let noise = |i: u32| 7e-4 * libm::sin(f64::from(i * i + 3 * i));
        (0..120).map(|i| (f64::from(i) / 120.0, [way(f64::from(i) / 120.0) + noise(i), 0.03])).collect()
    }

    /// From 2 m/s with friction 0.2 the slide lasts 0.34 s; the slip is the speed.
    #[test]
    fn a_slide_ends_where_the_deceleration_does() {
        let scene = Scene { gravity: [0.0, -9.81], ..Scene::empty() };
        let end = 2.0 / (3.0 * 0.2 * 9.81);
        let way = |t: f64| {
            let slid = t.min(end);
            2.0 * slid - 0.5 * 0.2 * 9.81 * slid * slid + 4.0 / 3.0 * (t - slid)
        };
        let Slide { speed, slip } = slide(&rows(way), &surface(0.5), &scene).expect("it slides");
        assert!((speed - 2.0).abs() < 0.05 && (slip - 2.0).abs() < 0.4, "{speed} {slip}");
        assert!(slide(&rows(|t| 1.0 * t - 0.05 * t * t), &surface(0.5), &scene).is_none(), "it rolls");
        let rest = |t: f64| 0.3 * t.min(0.6) - 0.25 * t.min(0.6).powi(2);
        assert!(slide(&rows(rest), &surface(0.5), &scene).is_none(), "it rolls to rest");
        assert!(slide(&rows(rest), &surface(f64::INFINITY), &scene).is_some(), "a block cannot roll");
    }

    /// A disc slips on a slope steeper than three times its friction.
    #[test]
    fn discs_slip_on_steep_slopes() {
        for (gravity, slips) in [([5.0, -8.0], true), ([4.0, -9.0], false)] {
            let scene = Scene { gravity, ..Scene::empty() };
            assert_eq!(slide(&rows(|t| t * t), &surface(0.5), &scene).is_some(), slips);
        }
    }
}
