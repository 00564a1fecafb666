//! Free motions of a body before and after an impact, extrapolated to it.

use std::array::from_fn;

use crate::inference::data::smoothing::TimedPosition;
use crate::line_fit::LineFit;
use crate::task::scene::Body;

/// Number of observations next to the impact from which each motion is extrapolated to it, and the minimum number of angles.
const EXTRAPOLATED: usize = 6;
const MIN_ANGLES: usize = 4;
/// Least standard deviation of an angle at an impact, rad: of calibration and shape.
const MIN_ANGLE_SD: f64 = 1e-3;
/// Largest mismatch of the motions before and after the impact where they cross: in standard errors, and in sizes of the smaller
/// body. Two impacts in quick succession do not cross.
const MAX_MISMATCH_SD: f64 = 3.5;
const MAX_MISMATCH: f64 = 0.01;
const CROSSING_ITERATIONS: usize = 4;

/// Observations of a body around an impact.
pub struct AroundImpact<'a> {
    pub body: &'a Body,
    /// m/s^2
    pub gravity: [f64; 2],
    /// Typical interval between rows, s.
    pub typical_interval: f64,
    /// Before and after it.
    pub rows: [&'a [TimedPosition]; 2],
    /// Those between, during which the body was near what it hits.
    pub between: &'a [TimedPosition],
    /// Observed angles of `rows`, without jumps by whole turns: s, rad.
    pub angles: Vec<(f64, f64)>,
}

impl AroundImpact<'_> {
    /// Whether the body is a disc, whose angle does not matter.
    pub fn is_round(&self) -> bool {
        self.body.shape.disc_radius().is_some()
    }

    /// Half the body's size, m.
    pub fn size(&self) -> Option<f64> {
        Some(self.body.shape.pieces()?.half_size())
    }
}

/// Free motions before and after an impact: lines through the positions less the fall (m) and through the angles (rad).
pub struct ImpactMotion {
    sides: [[FreeCoordinate; 3]; 2],
    /// Variances of the observations, m^2 and rad^2.
    noise: [f64; 3],
}

/// A line through points by least squares, and an acceleration.
struct FreeCoordinate {
    line: LineFit,
    acceleration: f64,
    /// Mean time of the points, s, from which the line and the acceleration count.
    reference: f64,
    count: f64,
}

impl ImpactMotion {
    /// `None` if a body that is no disc has too few angles.
    pub fn of(around: &AroundImpact) -> Option<ImpactMotion> {
        let [before, after] = around.rows;
        let before = &before[before.len().saturating_sub(EXTRAPOLATED)..];
        let after = &after[..after.len().min(EXTRAPOLATED)];
        let rows = [before, after];
        let within = |side: usize| -> Vec<(f64, f64)> {
            let [first, last] = [rows[side].first(), rows[side].last()].map(|r| r.map_or(f64::NAN, |r| r.0));
            around.angles.iter().filter(|(t, _)| (first..=last).contains(t)).copied().collect()
        };
        let turns = match around.is_round() {
            true => [0, 1].map(|_| vec![(-1.0, 0.0), (1.0, 0.0)]),
            false => [0, 1].map(within),
        };
        if !around.is_round() && turns.iter().any(|t| t.len() < MIN_ANGLES) {
            return None;
        }
        let axis = |side: usize, axis: usize| {
            let points: Vec<(f64, f64)> = rows[side].iter().map(|(t, p)| (*t, p[axis])).collect();
            FreeCoordinate::through(&points, around.gravity[axis])
        };
        let sides =
            [0, 1].map(|side| [axis(side, 0), axis(side, 1), FreeCoordinate::through(&turns[side], 0.0)]);
        let variance = |k: usize| {
            let freedom = sides[0][k].count + sides[1][k].count - 4.0;
            (sides[0][k].line.square + sides[1][k].line.square) / freedom.max(1.0)
        };
        // Both axes are measured alike.
        let place = 0.5 * (variance(0) + variance(1));
        Some(ImpactMotion { noise: [place, place, variance(2)], sides })
    }

    /// x, y (m) and angle (rad) at a time by the motion before (0) or after (1) the impact.
    fn at(&self, side: usize, time: f64) -> [f64; 3] {
        from_fn(|k| self.sides[side][k].at(time))
    }

    /// Change of the rates of x, y (m/s) and the angle (rad/s) by the impact at a time.
    pub fn kick(&self, time: f64) -> [f64; 3] {
        let [before, after] = &self.sides;
        from_fn(|k| after[k].rate(time) - before[k].rate(time))
    }

    /// Position (m), angle (rad) and its standard deviation at the time of the impact.
    pub fn pose(&self, time: f64) -> ([f64; 2], f64, f64) {
        let [own, other] = [0, 1].map(|side| self.sides[side][2].leverage(time));
        let share = other / (own + other);
        let [before, after] = [0, 1].map(|side| self.at(side, time));
        let sd = (self.noise[2] * own * share).sqrt();
        ([before[0], before[1]], share * before[2] + (1.0 - share) * after[2], sd.max(MIN_ANGLE_SD))
    }

    /// Rate of the angle before the impact, rad/s.
    pub fn spin(&self) -> f64 {
        self.sides[0][2].line.slope
    }

    /// Whether the motions meet at a time within their errors, and the body followed them. `size`: of the smaller body, m.
    fn meets(&self, around: &AroundImpact, time: f64, size: f64) -> bool {
        let [before, after] = [0, 1].map(|side| self.at(side, time));
        let within = |k: usize, difference: f64, leverage: f64| {
            let unit = if k == 2 { size } else { 1.0 };
            let sd = (self.noise[k] * leverage).sqrt();
            unit * difference.abs() <= MAX_MISMATCH_SD * unit * sd + MAX_MISMATCH * size
        };
        let meet = |k: usize| {
            let leverage = self.sides.iter().map(|side| side[k].leverage(time)).sum();
            within(k, after[k] - before[k], leverage)
        };
        let follows = |(t, position): &TimedPosition| {
            let side = usize::from(*t > time);
            let expected = self.at(side, *t);
            (0..2).all(|k| within(k, position[k] - expected[k], 1.0 + self.sides[side][k].leverage(*t)))
        };
        (0..3).all(meet) && around.between.iter().all(follows)
    }
}

/// Time at which the motions before and after an impact cross, s; `None` if they do not between the observations, or miss each
/// other or the rows between, as after two impacts in quick succession. `size`: of the smaller body, m.
pub fn crossing(motions: &[ImpactMotion], around: &[AroundImpact], size: f64) -> Option<f64> {
    let last = around.iter().filter_map(|a| a.rows[0].last().map(|r| r.0)).reduce(f64::min)?;
    let first = around.iter().filter_map(|a| a.rows[1].first().map(|r| r.0)).reduce(f64::max)?;
    let interval = around.iter().map(|a| a.typical_interval).fold(0.0, f64::max);
    let mut time = 0.5 * (last + first);
    for _ in 0..CROSSING_ITERATIONS {
        let (mut along, mut square) = (0.0, 0.0);
        for motion in motions {
            let ([before, after], kick) = ([0, 1].map(|side| motion.at(side, time)), motion.kick(time));
            for k in 0..3 {
                let weight = if k == 2 { size * size } else { 1.0 };
                along += weight * (after[k] - before[k]) * kick[k];
                square += weight * kick[k] * kick[k];
            }
        }
        time -= along / square;
    }
    let crosses = (last - interval..=first + interval).contains(&time)
        && motions.iter().zip(around).all(|(motion, around)| motion.meets(around, time, size));
    crosses.then_some(time)
}

impl FreeCoordinate {
    fn through(points: &[(f64, f64)], acceleration: f64) -> FreeCoordinate {
        let count = points.len() as f64;
        let reference = points.iter().map(|p| p.0).sum::<f64>() / count;
        let straight =
            |(t, y): &(f64, f64)| (t - reference, y - 0.5 * acceleration * (t - reference).powi(2));
        let line = LineFit::new(&points.iter().map(straight).collect::<Vec<_>>());
        FreeCoordinate { line, acceleration, reference, count }
    }

    fn at(&self, time: f64) -> f64 {
        let t = time - self.reference;
        self.line.intercept + t * (self.line.slope + 0.5 * self.acceleration * t)
    }

    fn rate(&self, time: f64) -> f64 {
        self.line.slope + self.acceleration * (time - self.reference)
    }

    /// Variance of `at` for observations of unit variance.
    fn leverage(&self, time: f64) -> f64 {
        1.0 / self.count + (time - self.reference).powi(2) * self.line.slope_variance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::Scene;

    /// Observations of a box every 10 ms that flies, is hit at some times (s), and spins; those within 25 ms of the first impact
    /// are between. The time of the crossing.
    fn crossed(impacts: &[f64]) -> Option<f64> {
        let scene = Scene::from_json(
            r#"{"format": "iplw.scene/1", "gravity": [0, -9.81], "time_step": 0.005,
                "bodies": [{"name": "box", "shape": {"type": "box", "half_width": 0.04, "half_height": 0.025}}]}"#,
        )
        .unwrap();
        let (mut rows, mut angles): (Vec<TimedPosition>, Vec<(f64, f64)>) = (Vec::new(), Vec::new());
        for i in 0..40 {
            let t = 0.01 * f64::from(i);
            let hits = impacts.iter().map(|hit| (t - hit).max(0.0)).sum::<f64>();
            let noise = |k: i32, size: f64| size * libm::sin(f64::from(k + 3 * i * i));
            let (x, y) = (t + 0.4 * hits + noise(1, 3e-4), 2.0 * hits - t - 4.905 * t * t + noise(2, 3e-4));
            rows.push((t, [x, y]));
            angles.push((t, 6.0 * t - 9.0 * hits + noise(5, 5e-3)));
        }
        let [before, after] = [-0.025, 0.025].map(|d| rows.partition_point(|r| r.0 < impacts[0] + d));
        let around = AroundImpact {
            body: &scene.bodies[0],
            gravity: scene.gravity,
            typical_interval: 0.01,
            rows: [&rows[before - 12..before], &rows[after..after + 12]],
            between: &rows[before..after],
            angles,
        };
        let motion = ImpactMotion::of(&around).unwrap();
        crossing(&[motion], &[around], 0.04)
    }

    /// The motions cross at one impact, between pictures; after two within 22 ms they do not.
    #[test]
    fn motions_cross_at_one_impact() {
        let time = crossed(&[0.2037]).expect("one impact");
        assert!((time - 0.2037).abs() < 1e-3, "{time}");
        assert_eq!(crossed(&[0.195, 0.217]), None);
    }
}
