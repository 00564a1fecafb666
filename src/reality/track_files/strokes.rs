//! Strokes in films from above: a puck or ball on a table that is struck again and again, by something that is not in the scene.
//!
//! Between two strokes a body slides or rolls freely. Over a short window its path is close to a parabola, or to two that join with one
//! velocity where its acceleration changes: where friction has stopped it, or sliding has turned into rolling. A stroke changes the
//! velocity itself: two parabolas that join with velocities of their own fit significantly better than with one velocity, and better than
//! a polynomial of as many coefficients, which fits a bent path. Any abrupt change of velocity is a stroke, also an impact on a cushion.

use std::ops::Range;

use super::path_fit::{PathFit, WindowPoint, quartic_square, sharp_join_square, smooth_join_square};
use super::track_rows::TrialPoints;
use super::unit_checks::range;
use crate::budget::{Budget, checked};
use crate::error::Result;

/// Numbers of points on each side of a possible stroke: few for strokes in quick succession, many for noise at many pictures a second.
const WINDOW_POINTS: [usize; 8] = [5, 8, 12, 17, 24, 34, 48, 68];
/// Largest duration of the points on one side, s, and a number of points that may last longer.
const MAX_SIDE_S: f64 = 0.3;
const MAX_SLOW_POINTS: usize = 12;
/// Least number of points of a parabola.
const MIN_SIDE_POINTS: usize = 5;
/// Largest number of points within a stroke, as a share of those on each side.
const MAX_STROKE_SHARE: f64 = 0.5;
/// Minimum significance of a stroke, standard errors.
const MIN_SIGNIFICANCE: f64 = 8.0;
/// Squared deviation, in noise variances, of a point that belongs to a stroke rather than to the motion before or after it.
const STROKE_DEVIATION: f64 = 9.0;
/// Number of points left out on each side of a stroke, which it may have begun to move.
const MARGIN_POINTS: usize = 1;
/// Least number of points of a stretch of free motion, as a segment of a diagnosis needs.
const MIN_STRETCH_POINTS: usize = 7;
/// Largest deviation of a point of a body at rest, standard deviations of the noise, and number of such points that stay in a stretch.
const MAX_REST_DEVIATION: f64 = 5.0;
const MAX_REST_POINTS: usize = 3;
/// Deviation of an outlier from its neighbours, standard deviations of the noise.
const MAX_DEVIATION: f64 = 8.0;
/// Least noise, relative to the range of positions: a tenth of a pixel in a thousand.
const MIN_RELATIVE_NOISE: f64 = 1e-4;
/// Rounding error of a difference of positions, relative to their range.
const ROUNDING_ERROR: f64 = 1e-9;

/// Times, s, of the stretches of free motion of a film that shows strokes; empty if it shows none. The points within a stroke are in
/// none of them, nor is a body at rest, but for a few points at the end of a stretch. Ends early with `budget`.
pub fn free_stretches(trial: &TrialPoints, budget: &dyn Budget) -> Result<Vec<Range<f64>>> {
    let points: Vec<[f64; 3]> =
        trial.points.iter().filter(|p| p.iter().all(|v| v.is_finite())).copied().collect();
    let noise = noise(&points);
    let points = without_outliers(&points, noise);
    let strokes = strokes(&points, noise, budget)?;
    if strokes.is_empty() {
        return Ok(Vec::new());
    }
    let starts = std::iter::once(0).chain(strokes.iter().map(|s| s.end + MARGIN_POINTS));
    let ends = strokes.iter().map(|s| s.start.saturating_sub(MARGIN_POINTS)).chain([points.len()]);
    let stretch = |(start, end): (usize, usize)| {
        let moving = count_before_rest(points.get(start..end)?, noise);
        let end = points.get(start + moving).map_or(f64::INFINITY, |next| next[0]);
        (moving >= MIN_STRETCH_POINTS).then(|| points[start][0]..end)
    };
    Ok(starts.zip(ends).filter_map(stretch).collect())
}

/// A possible stroke.
struct StrokeCandidate {
    /// Indices of the points within it; empty if it is between two points.
    stroke: Range<usize>,
    /// Indices of the points that show it.
    window: Range<usize>,
    /// Standard errors.
    significance: f64,
}

/// The strokes of a film in order: the most significant ones whose windows do not contain another stroke.
fn strokes(points: &[[f64; 3]], noise: f64, budget: &dyn Budget) -> Result<Vec<Range<usize>>> {
    let mut candidates: Vec<StrokeCandidate> = Vec::new();
    let step = typical_step(points);
    let is_short = |side: &usize| *side <= MAX_SLOW_POINTS || *side as f64 * step <= MAX_SIDE_S;
    for side in WINDOW_POINTS.into_iter().filter(is_short) {
        // Windows of many points are shifted by more, so that the work does not grow with their number.
        let centres = (MIN_SIDE_POINTS..points.len()).step_by((side / 5).max(1));
        for centre in checked(centres, budget) {
            let centre = centre?;
            let window = centre.saturating_sub(side)..(centre + side).min(points.len());
            candidates.extend(candidate(points, window, side, noise));
        }
    }
    candidates.sort_by(|a, b| b.significance.total_cmp(&a.significance));
    let mut strokes: Vec<Range<usize>> = Vec::new();
    for candidate in candidates {
        let window = &candidate.window;
        if strokes.iter().all(|stroke| window.end <= stroke.start || stroke.end <= window.start) {
            strokes.push(candidate.stroke);
        }
    }
    strokes.sort_by_key(|stroke| stroke.start);
    Ok(strokes)
}

/// The stroke that a window shows, if it is significant.
fn candidate(points: &[[f64; 3]], window: Range<usize>, side: usize, noise: f64) -> Option<StrokeCandidate> {
    if window.len() < 2 * MIN_SIDE_POINTS {
        return None;
    }
    let path = centred(&points[window.clone()])?;
    let before = squares(path.iter());
    let mut after = squares(path.iter().rev());
    after.reverse();
    let variance = noise * noise;
    let stroke = locate(&before, &after, side, STROKE_DEVIATION * variance)?;
    let outside = path[..stroke.start].iter().chain(&path[stroke.end..]).copied();
    let significance = |smooth: f64, sharp: f64| {
        // Eleven coefficients are fitted.
        let freedom = 2.0 * (path.len() - stroke.len()) as f64 - 11.0;
        ((smooth - sharp).max(0.0) / variance.max(sharp / freedom)).sqrt()
    };
    // One parabola fits worse than all that follow, two that do not join better.
    let (whole, apart) = (before[path.len() - 1], before[stroke.start - 1] + after[stroke.end]);
    if significance(whole, apart) < MIN_SIGNIFICANCE {
        return None;
    }
    let sharp = sharp_join_square(outside.clone(), [path[stroke.start - 1].0, path[stroke.end].0])?;
    let smooth = quartic_square(outside.clone()).filter(|q| significance(*q, sharp) >= MIN_SIGNIFICANCE)?;
    let smooth = smooth_join_square(outside, [-1.0, 1.0])?.min(smooth);
    let significance = significance(smooth, sharp);
    if significance < MIN_SIGNIFICANCE {
        return None;
    }
    let stroke = window.start + stroke.start..window.start + stroke.end;
    Some(StrokeCandidate { stroke, window, significance })
}

/// The points within the stroke of a window, given the residual sums of squares of parabolas up to each point and from each point on, m^2,
/// and the share of a point within the stroke.
fn locate(before: &[f64], after: &[f64], side: usize, share: f64) -> Option<Range<usize>> {
    let last = before.len() - MIN_SIDE_POINTS;
    let max_points = (MAX_STROKE_SHARE * side as f64) as usize;
    let ends = |start: usize| (start..=last.min(start + max_points)).map(move |end| start..end);
    let square =
        |stroke: &Range<usize>| before[stroke.start - 1] + after[stroke.end] + share * stroke.len() as f64;
    let strokes = (MIN_SIDE_POINTS..=last).flat_map(ends).map(|stroke| (square(&stroke), stroke));
    strokes.filter(|s| s.0.is_finite()).min_by(|a, b| a.0.total_cmp(&b.0)).map(|s| s.1)
}

/// The points with times from -1 to 1, and positions about their mean; `None` unless times increase.
fn centred(points: &[[f64; 3]]) -> Option<Vec<WindowPoint>> {
    let (first, last) = (points.first()?[0], points.last()?[0]);
    let (middle, half) = (0.5 * (first + last), 0.5 * (last - first));
    let [x, y] = [1, 2].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / points.len() as f64);
    let increases = points.windows(2).all(|pair| pair[0][0] < pair[1][0]);
    (increases && half.is_finite())
        .then(|| points.iter().map(|p| ((p[0] - middle) / half, [p[1] - x, p[2] - y])).collect())
}

/// The residual sum of squares of a parabola through the points up to each one, m^2.
fn squares<'a>(path: impl Iterator<Item = &'a WindowPoint>) -> Vec<f64> {
    let mut fit = PathFit::<3>::empty();
    let square = |(u, position): &WindowPoint| {
        fit.add([1.0, *u, u * u], *position);
        fit.square().unwrap_or(f64::INFINITY)
    };
    path.map(square).collect()
}

/// The points without single ones far from a cubic through the two on each side, by more than those next to them.
fn without_outliers(points: &[[f64; 3]], noise: f64) -> Vec<[f64; 3]> {
    let deviation = |i: usize| {
        let near = i.checked_sub(2).and_then(|first| points.get(first..i + 3));
        near.map_or(0.0, |p| {
            let between = |axis: usize| (4.0 * (p[1][axis] + p[3][axis]) - p[0][axis] - p[4][axis]) / 6.0;
            (p[2][1] - between(1)).hypot(p[2][2] - between(2))
        })
    };
    let deviations: Vec<f64> = (0..points.len()).map(deviation).collect();
    let is_outlier = |i: usize| {
        let neighbours = deviations[i.saturating_sub(1)..(i + 2).min(points.len())].iter();
        deviations[i] > MAX_DEVIATION * noise && neighbours.fold(0.0, |a: f64, d| a.max(*d)) <= deviations[i]
    };
    (0..points.len()).filter(|i| !is_outlier(*i)).map(|i| points[i]).collect()
}

/// Number of points up to those of a body at rest at their end, of which a few count.
fn count_before_rest(points: &[[f64; 3]], noise: f64) -> usize {
    let (mut count, mut sum) = (0usize, [0.0; 2]);
    for point in points.iter().rev() {
        let number = count as f64;
        let deviation = |axis: usize| (point[axis + 1] - sum[axis] / number).abs();
        let largest = MAX_REST_DEVIATION * noise * (1.0 + 1.0 / number).sqrt();
        if count > 0 && (0..2).any(|axis| deviation(axis) > largest) {
            break;
        }
        (0..2).for_each(|axis| sum[axis] += point[axis + 1]);
        count += 1;
    }
    points.len() - count.saturating_sub(MAX_REST_POINTS)
}

/// Median time between two points, s.
fn typical_step(points: &[[f64; 3]]) -> f64 {
    quantile(points.windows(2).map(|pair| pair[1][0] - pair[0][0]).collect(), 0.5)
}

/// Longest duration of the points of a third difference, s, and the share of smaller ones, which are those of free motion.
const MAX_DIFFERENCE_S: f64 = 0.3;
const FREE_SHARE: f64 = 0.25;
/// This quantile of the absolute value of a standard normal variable.
const FREE_QUANTILE: f64 = 0.3186;

/// Standard deviation of a coordinate's noise, m, if it were independent between points: from third differences, which are close to
/// zero for smooth motion, of means of neighbouring points. Noise that changes slowly has larger ones.
fn noise(points: &[[f64; 3]]) -> f64 {
    let step = typical_step(points);
    let ranges = [1, 2].map(|axis| range(points.iter().map(|p| p[axis])));
    let largest = ranges[0].max(ranges[1]);
    let (least, rounding) = (MIN_RELATIVE_NOISE * largest, ROUNDING_ERROR * largest);
    let counts = std::iter::successors(Some(1), |count| Some(2 * count)).take(10);
    let is_short = |count: &usize| *count == 1 || 4.0 * *count as f64 * step <= MAX_DIFFERENCE_S;
    counts.filter(is_short).map(|count| noise_of_means(points, count, rounding)).fold(least, f64::max)
}

/// Standard deviation of a coordinate's noise, m, from means of `count` neighbouring points. Differences within `rounding` do not count:
/// coordinates in whole pixels do not change at rest.
fn noise_of_means(points: &[[f64; 3]], count: usize, rounding: f64) -> f64 {
    let mean =
        |chunk: &[[f64; 3]]| [1, 2].map(|axis| chunk.iter().map(|p| p[axis]).sum::<f64>() / count as f64);
    let means: Vec<[f64; 2]> = points.chunks_exact(count).map(mean).collect();
    let third =
        |v: &[[f64; 2]], axis: usize| (v[3][axis] - 3.0 * v[2][axis] + 3.0 * v[1][axis] - v[0][axis]).abs();
    let thirds = means.windows(4).flat_map(|v| [third(v, 0), third(v, 1)]).filter(|d| *d > rounding);
    quantile(thirds.collect(), FREE_SHARE) / FREE_QUANTILE * (count as f64 / 20.0).sqrt()
}

/// The value below which a share of the values is; zero of none.
fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get((share * values.len() as f64) as usize).copied().unwrap_or(0.0)
}
