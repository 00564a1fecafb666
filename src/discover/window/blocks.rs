//! Averages of neighbouring observations of a long flight or roll, so that the cost of a diagnosis does not grow with the rate at
//! which a camera sees.
//!
//! A block of m observations becomes one at their mean time, with their mean position and a weight of m. A path hardly bends
//! within a block: a block spans a five-hundredth of the flight, and the mean of a parabola is off by less than a millionth of
//! its height. The first and the last observation stay, since a path starts and ends with them. The squared deviations
//! within blocks, which no model explains, are added to the squared residuals (sufficiency of the block means: Searle, Linear
//! Models (1971), chapter 9).

use super::kind::{Averaged, Kind, Point, Window};

/// Observations of a segment up to which none are averaged; blocks of a longer one.
pub const MAX_POINTS: usize = 500;

/// Averages the observations of a long flight or roll.
pub fn average(window: &mut Window) {
    let n = window.points.len();
    if !matches!(window.kind, Kind::Flight | Kind::Roll) || n <= MAX_POINTS {
        return;
    }
    let Some(smooth) = &mut window.smooth else { return };
    let size = (n - 2).div_ceil(MAX_POINTS - 2);
    let inner = (1..n - 1).step_by(size).map(|from| from..(from + size).min(n - 1));
    let blocks: Vec<_> = std::iter::once(0..1).chain(inner).chain(std::iter::once(n - 1..n)).collect();
    let square = |block: &std::ops::Range<usize>| {
        let counted = || block.clone().filter(|i| window.points[*i].weight > 0.0);
        let along = |residual: &[f64]| {
            let mean = mean(counted().map(|i| residual[i])).unwrap_or(0.0);
            counted().map(|i| (residual[i] - mean).powi(2)).sum::<f64>()
        };
        smooth.residual.iter().map(|r| along(r)).sum::<f64>()
    };
    let square = blocks.iter().map(square).sum();
    let points: Vec<Point> = blocks.into_iter().map(|block| block_mean(&window.points[block])).collect();
    window.averaged = Averaged { count: n - points.len(), square };
    window.points = points;
    (smooth.residual, smooth.kept) = (Default::default(), Vec::new());
}

/// The mean of those observations that count; of all, with weight 0, where none does.
fn block_mean(points: &[Point]) -> Point {
    let count = points.iter().filter(|p| p.weight > 0.0).count();
    let counted = || points.iter().filter(|p| p.weight > 0.0 || count == 0);
    let of = |value: &dyn Fn(&Point) -> f64| mean(counted().map(value)).unwrap_or(f64::NAN);
    Point {
        body: points[0].body,
        time: of(&|p| p.time),
        seen: [of(&|p| p.seen[0]), of(&|p| p.seen[1])],
        weight: count as f64,
    }
}

/// Mean of some values, exactly theirs where they are all the same; `None` of nothing.
fn mean(values: impl Iterator<Item = f64> + Clone) -> Option<f64> {
    let first = values.clone().next()?;
    let (sum, count) = values.fold((0.0, 0usize), |(sum, count), v| (sum + (v - first), count + 1));
    Some(first + sum / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::fit::Fitter;
    use crate::discover::fixture::{seen, term};
    use crate::discover::model::{self, Data, Layout, State};
    use crate::discover::noise::Noise;
    use crate::discover::smooth::{Row, smooth};
    use crate::discover::window::cut;
    use crate::progress::NoProgress;
    use crate::rng;
    use crate::task::Scene;
    use crate::task::ball::BallScene;
    use crate::world::Engine;
    use rand_distr::{Distribution, StandardNormal};

    fn flight(n: usize) -> Window {
        let rows: Vec<Row> = (0..n)
            .map(|i| {
                let t = 1.2 * i as f64 / (n - 1) as f64;
                let noise = |k: usize| 1e-3 * libm::sin((i * i + k) as f64);
                (t, [3.0 * t + noise(0), 2.0])
            })
            .collect();
        let points = rows.iter().map(|(time, seen)| Point { body: 0, time: *time, seen: *seen, weight: 1.0 });
        let window = Window::new(Kind::Flight, Scene::empty(), 0.0, points.collect());
        Window { smooth: Some(smooth(&rows)), ..window }
    }

    #[test]
    fn a_short_flight_stays_as_it_is() {
        let mut window = flight(MAX_POINTS);
        average(&mut window);
        assert_eq!((window.points.len(), window.averaged.count), (MAX_POINTS, 0));
    }

    /// Weights and squares are those of all observations but the outliers, and ends stay.
    #[test]
    fn blocks_keep_what_was_observed() {
        let mut window = flight(3001);
        let rejected = [700, 701, 1500];
        rejected.iter().for_each(|i| window.points[*i].weight = 0.0);
        let before = window.clone();
        average(&mut window);
        assert!(window.points.len() <= MAX_POINTS && window.averaged.count == 3001 - window.points.len());
        assert_eq!(window.points.iter().map(|p| p.weight).sum::<f64>(), 2998.0);
        assert!(window.points.windows(2).all(|p| p[0].time < p[1].time));
        let ends = |w: &Window| [w.points[0], w.points[w.points.len() - 1]].map(|p| (p.time, p.seen));
        assert_eq!(ends(&window), ends(&before));
        assert!(
            window.points.iter().all(|p| p.seen[1] == 2.0),
            "along an axis in which nothing moves nothing does"
        );
        // About the line that the observations are on.
        let off = |p: &Point| p.weight * (p.seen[0] - 3.0 * p.time).powi(2);
        let square = |w: &Window| w.points.iter().map(off).sum::<f64>();
        let all = square(&window) + window.averaged.square;
        assert!((all / square(&before) - 1.0).abs() < 0.01, "{all} of {}", square(&before));
    }

    /// Flights with a drag and correlated noise of a millimetre.
    fn flights() -> Vec<Window> {
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
        let trials = seen(&(0..4).map(&mut throw).collect::<Vec<_>>());
        cut(&scene.build("ball", 1.0).unwrap(), &trials, &[0; 4], 8, &NoProgress).unwrap()
    }

    /// A drag, its error, its evidence and the squares that it leaves are those of all observations.
    #[test]
    fn blocks_say_what_all_observations_say() {
        let all = flights();
        let mut blocks = all.clone();
        blocks.iter_mut().for_each(average);
        assert!(all.iter().zip(&blocks).all(|(a, b)| 2 * b.points.len() < a.points.len()));
        let [a, b] = [all, blocks].map(|windows| {
            let data = Data::new(&windows, &[0; 4], vec![1e-3; windows.len()], Engine::Auto);
            let fitter = Fitter::new(&data, &Noise { sd: 1e-3, rho: 0.5, freedom: 1e4 });
            let layout = Layout::new(&[], vec![term("linear_drag")], 1);
            let starts = windows.iter().map(|w| w.nuisances.clone()).collect();
            let start = State::new(layout.start(&[0.0; 3]), starts);
            let fit = fitter.fit(layout, start, 12).unwrap().unwrap();
            [fit.state.values[0], fit.half_width(0), fit.log_evidence, model::total(&fit.pass)]
        });
        assert!((a[0] - 0.4).abs() < a[1], "{a:?}");
        assert!((a[0] - b[0]).abs() < 0.05 * a[1] && (a[1] / b[1] - 1.0).abs() < 0.02, "{a:?} {b:?}");
        assert!((a[2] - b[2]).abs() < 0.5 && (a[3] / b[3] - 1.0).abs() < 2e-3, "{a:?} {b:?}");
    }
}
