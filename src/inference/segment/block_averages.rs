//! Averages of neighbouring observations of long flights and rolling segments, so that the cost of a diagnosis
//! does not grow with the frame rate.
//!
//! A block of m observations becomes one at their mean time with a weight of m. Its position is the smoothing polynomial there
//! plus the mean deviation from it: the mean position itself would be off by the bend of the trajectory within the block. The
//! first and the last observation stay, since a trajectory starts and ends with them. The squared deviations within blocks, which
//! no model explains, are added to the squared residuals (sufficiency of the block means: Searle, Linear Models (1971), chapter
//! 9).

use super::definition::{Observation, Segment, SegmentKind, WithinBlockVariation};

/// Maximum number of observations of a segment; longer ones are averaged in as many blocks.
pub const MAX_OBSERVATIONS: usize = 100;

/// Averages the observations of a long flight or rolling segment.
pub fn average_blocks(segment: &mut Segment) {
    let n = segment.observations.len();
    if !matches!(segment.kind, SegmentKind::Flight | SegmentKind::Rolling) || n <= MAX_OBSERVATIONS {
        return;
    }
    let Some(smooth) = &mut segment.smooth else { return };
    let size = (n - 2).div_ceil(MAX_OBSERVATIONS - 2);
    let inner = (1..n - 1).step_by(size).map(|from| from..(from + size).min(n - 1));
    let blocks: Vec<_> = std::iter::once(0..1).chain(inner).chain(std::iter::once(n - 1..n)).collect();
    let square = |block: &std::ops::Range<usize>| {
        let counted = || block.clone().filter(|i| segment.observations[*i].weight > 0.0);
        let along = |residual: &[f64]| {
            let mean = mean(counted().map(|i| residual[i])).unwrap_or(0.0);
            counted().map(|i| (residual[i] - mean).powi(2)).sum::<f64>()
        };
        smooth.residual.iter().map(|r| along(r)).sum::<f64>()
    };
    let square = blocks.iter().map(square).sum();
    let start = segment.start;
    let value = |axis: usize, time: f64| smooth.value(axis, start + time);
    let points: Vec<Observation> =
        blocks.into_iter().map(|block| block_mean(&segment.observations[block], value)).collect();
    segment.within_blocks = WithinBlockVariation { merged_count: n - points.len(), sum_of_squares: square };
    segment.observations = points;
    (smooth.residual, smooth.is_inlier) = (Default::default(), Vec::new());
}

/// Mean of the used observations; of all, with weight 0, if none is used. `smooth`: smooth position along an axis at a time.
fn block_mean(points: &[Observation], smooth: impl Fn(usize, f64) -> f64) -> Observation {
    let count = points.iter().filter(|p| p.weight > 0.0).count();
    let counted = || points.iter().filter(|p| p.weight > 0.0 || count == 0);
    let of = |value: &dyn Fn(&Observation) -> f64| mean(counted().map(value)).unwrap_or(f64::NAN);
    let time = of(&|p| p.time);
    let position =
        |axis: usize| of(&|p| p.position[axis]) + (smooth(axis, time) - of(&|p| smooth(axis, p.time)));
    Observation { body: points[0].body, time, position: [position(0), position(1)], weight: count as f64 }
}

/// Mean of values, exact if they are all equal; `None` without values.
fn mean(values: impl Iterator<Item = f64> + Clone) -> Option<f64> {
    let first = values.clone().next()?;
    let (sum, count) = values.fold((0.0, 0usize), |(sum, count), v| (sum + (v - first), count + 1));
    Some(first + sum / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::data::noise::Noise;
    use crate::inference::data::smoothing::{TimedPosition, fit_polynomials};
    use crate::inference::mixed_model::model_fit::ModelFitter;
    use crate::inference::model::{self, FitState, ParameterLayout, SegmentData};
    use crate::inference::segment::segment_trials;
    use crate::inference::testing::segments::{observed_trials, term};
    use crate::progress::NoProgress;
    use crate::rng;
    use crate::task::Scene;
    use crate::task::ball::BallScene;
    use crate::world::Engine;
    use rand_distr::{Distribution, StandardNormal};

    fn flight(n: usize) -> Segment {
        let rows: Vec<TimedPosition> = (0..n)
            .map(|i| {
                let t = 1.2 * i as f64 / (n - 1) as f64;
                let noise = |k: usize| 1e-3 * libm::sin((i * i + k) as f64);
                (t, [3.0 * t + noise(0), 2.0])
            })
            .collect();
        let points = rows.iter().map(|(time, position)| Observation {
            body: 0,
            time: *time,
            position: *position,
            weight: 1.0,
        });
        let segment = Segment::new(SegmentKind::Flight, Scene::empty(), 0.0, points.collect());
        Segment { smooth: Some(fit_polynomials(&rows, &NoProgress).unwrap()), ..segment }
    }

    #[test]
    fn short_flights_are_not_averaged() {
        let mut segment = flight(MAX_OBSERVATIONS);
        average_blocks(&mut segment);
        assert_eq!((segment.observations.len(), segment.within_blocks.merged_count), (MAX_OBSERVATIONS, 0));
    }

    /// Total weight and squares are those of the inliers, and both ends stay.
    #[test]
    fn blocks_preserve_weights_and_squares() {
        let mut segment = flight(3001);
        let rejected = [700, 701, 1500];
        rejected.iter().for_each(|i| segment.observations[*i].weight = 0.0);
        let before = segment.clone();
        average_blocks(&mut segment);
        assert!(
            segment.observations.len() <= MAX_OBSERVATIONS
                && segment.within_blocks.merged_count == 3001 - segment.observations.len()
        );
        assert_eq!(segment.observations.iter().map(|p| p.weight).sum::<f64>(), 2998.0);
        assert!(segment.observations.windows(2).all(|p| p[0].time < p[1].time));
        let ends = |w: &Segment| {
            [w.observations[0], w.observations[w.observations.len() - 1]].map(|p| (p.time, p.position))
        };
        assert_eq!(ends(&segment), ends(&before));
        assert!(
            segment.observations.iter().all(|p| p.position[1] == 2.0),
            "a constant coordinate stays constant"
        );
        // About the true line.
        let off = |p: &Observation| p.weight * (p.position[0] - 3.0 * p.time).powi(2);
        let square = |w: &Segment| w.observations.iter().map(off).sum::<f64>();
        let all = square(&segment) + segment.within_blocks.sum_of_squares;
        assert!((all / square(&before) - 1.0).abs() < 0.01, "{all} of {}", square(&before));
    }

    /// Means of an exact parabola are on it, although it falls by 3 mm within a block.
    #[test]
    fn blocks_follow_the_bend_of_the_trajectory() {
        let height = |t: f64| 2.0 + 3.0 * t - 4.9 * t * t;
        let rows: Vec<TimedPosition> =
            (0..1001).map(|i| 2e-3 * f64::from(i)).map(|t| (t, [t, height(t)])).collect();
        let mut segment = flight(1001);
        segment.observations.iter_mut().zip(&rows).for_each(|(p, row)| (p.time, p.position) = *row);
        segment.smooth = Some(fit_polynomials(&rows, &NoProgress).unwrap());
        average_blocks(&mut segment);
        assert!(segment.observations.len() <= MAX_OBSERVATIONS);
        let off =
            segment.observations.iter().map(|p| (p.position[1] - height(p.time)).abs()).fold(0.0, f64::max);
        assert!(off < 1e-9, "{off} m");
    }

    /// Flights with drag and a correlated noise of 1 mm.
    fn flights() -> Vec<Segment> {
        let mut stream = rng::stream(1, "blocks");
        let rho: f64 = 0.5;
        let scene = BallScene { radius: 0.05, mass: None, gravity: Some(9.81), floor: None };
        let mut throw = |k: u32| {
            let mut off = [0.0; 2];
            let mut row = |i: u32| {
                for off in &mut off {
                    let draw: f64 = StandardNormal.sample(&mut stream);
                    *off = rho * *off + 1e-3 * (1.0 - rho * rho).sqrt() * draw;
                }
                let (rate, t) = (0.4, f64::from(i) / 1500.0);
                let along = (1.0 - libm::exp(-rate * t)) / rate;
                let fallen = 9.81 * (t - along) / rate;
                [t, (3.0 + f64::from(k)) * along + off[0], 2.0 + 4.0 * along - fallen + off[1]]
            };
            (0..1501).map(&mut row).collect::<Vec<_>>()
        };
        let trials = observed_trials(&(0..4).map(&mut throw).collect::<Vec<_>>());
        segment_trials(&scene.build("ball", 1.0).unwrap(), &trials, &[0; 4], 8, &NoProgress).unwrap().segments
    }

    /// Estimate, error, evidence and residual squares of a drag are those of all observations.
    #[test]
    fn blocks_are_sufficient() {
        let all = flights();
        let mut blocks = all.clone();
        blocks.iter_mut().for_each(average_blocks);
        assert!(all.iter().zip(&blocks).all(|(a, b)| 2 * b.observations.len() < a.observations.len()));
        let [a, b] = [all, blocks].map(|segments| {
            let data = SegmentData::new(&segments, &[0; 4], vec![1e-3; segments.len()], Engine::Auto);
            let fitter = ModelFitter::new(&data, &Noise { sd: 1e-3, rho: 0.5, degrees_of_freedom: 1e4 });
            let layout = ParameterLayout::new(&[], vec![term("linear_drag")], 1);
            let starts = segments.iter().map(|w| w.nuisances.clone()).collect();
            let start = FitState::new(layout.initial_values(&[0.0; 3]), starts);
            let fit = fitter.fit(layout, start, 12).unwrap().unwrap();
            [
                fit.state.values[0],
                fit.ci_half_width(0),
                fit.log_evidence,
                model::total_square(&fit.evaluation),
            ]
        });
        assert!((a[0] - 0.4).abs() < a[1], "{a:?}");
        assert!((a[0] - b[0]).abs() < 0.05 * a[1] && (a[1] / b[1] - 1.0).abs() < 0.02, "{a:?} {b:?}");
        assert!((a[2] - b[2]).abs() < 0.5 && (a[3] / b[3] - 1.0).abs() < 2e-3, "{a:?} {b:?}");
    }
}
