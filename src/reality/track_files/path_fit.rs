//! Least-squares fits of paths in the plane: polynomials of time, and two parabolas joined at a knot.

/// Sums of a least-squares fit of both coordinates to `K` functions of time.
#[derive(Clone)]
pub struct PathFit<const K: usize> {
    /// Sums of products of two functions, of a function and a coordinate, and of squared coordinates.
    products: [[f64; K]; K],
    moments: [[f64; 2]; K],
    squares: f64,
}

impl<const K: usize> PathFit<K> {
    /// A fit of no points.
    pub fn empty() -> PathFit<K> {
        PathFit { products: [[0.0; K]; K], moments: [[0.0; 2]; K], squares: 0.0 }
    }

    /// Adds a position, m, at which the functions have these values.
    pub fn add(&mut self, functions: [f64; K], position: [f64; 2]) {
        for (i, f) in functions.into_iter().enumerate() {
            (0..K).for_each(|k| self.products[i][k] += f * functions[k]);
            (0..2).for_each(|axis| self.moments[i][axis] += f * position[axis]);
        }
        self.squares += position[0] * position[0] + position[1] * position[1];
    }

    /// Residual sum of squares of both coordinates, m^2; `None` where the points do not determine the fit.
    pub fn square(&self) -> Option<f64> {
        let (mut factor, mut whitened) = ([[0.0; K]; K], [[0.0; 2]; K]);
        let mut explained = 0.0;
        for i in 0..K {
            for k in 0..=i {
                let rest: f64 =
                    self.products[i][k] - (0..k).map(|j| factor[i][j] * factor[k][j]).sum::<f64>();
                if k < i {
                    factor[i][k] = rest / factor[k][k];
                } else if rest > MIN_PIVOT * self.products[i][i] {
                    factor[i][i] = rest.sqrt();
                } else {
                    return None;
                }
            }
            whitened[i] = [0, 1].map(|axis| {
                let known: f64 = (0..i).map(|j| factor[i][j] * whitened[j][axis]).sum();
                (self.moments[i][axis] - known) / factor[i][i]
            });
            explained += whitened[i].iter().map(|w| w * w).sum::<f64>();
        }
        let square = self.squares - explained;
        square.is_finite().then_some(square.max(0.0))
    }
}

/// Smallest share of a function that is linearly independent of those before it.
const MIN_PIVOT: f64 = 1e-10;

/// A time within a window, from -1 to 1, and a position, m, about the window's centre.
pub type WindowPoint = (f64, [f64; 2]);

/// Residual sum of squares of the best polynomial of degree four, m^2.
pub fn quartic_square(points: impl Iterator<Item = WindowPoint>) -> Option<f64> {
    let mut fit = PathFit::<5>::empty();
    points.for_each(|(u, position)| fit.add([1.0, u, u * u, u * u * u, u * u * u * u], position));
    fit.square()
}

/// Smallest residual sum of squares, m^2, of two parabolas that join at a time in a range with one position and one velocity: a motion
/// whose acceleration changes abruptly once, as where friction has stopped a body.
pub fn smooth_join_square(points: impl Iterator<Item = WindowPoint> + Clone, range: [f64; 2]) -> Option<f64> {
    let square = |knot: f64| {
        let mut fit = PathFit::<4>::empty();
        points.clone().for_each(|(u, position)| {
            let beyond = (u - knot).max(0.0);
            fit.add([1.0, u, u * u, beyond * beyond], position);
        });
        fit.square()
    };
    best_knot(square, range)
}

/// Smallest residual sum of squares, m^2, of two parabolas that join at a time in a range with one position, but velocities of their own.
pub fn sharp_join_square(points: impl Iterator<Item = WindowPoint> + Clone, range: [f64; 2]) -> Option<f64> {
    let square = |knot: f64| {
        let mut fit = PathFit::<5>::empty();
        points.clone().for_each(|(u, position)| {
            let beyond = (u - knot).max(0.0);
            fit.add([1.0, u, u * u, beyond, beyond * beyond], position);
        });
        fit.square()
    };
    best_knot(square, range)
}

/// Number of intervals between knots of a first grid, and of halvings of its step.
const GRID: usize = 10;
const HALVINGS: usize = 9;

/// The smallest value of a function of a knot in a range.
fn best_knot(square: impl Fn(f64) -> Option<f64>, range: [f64; 2]) -> Option<f64> {
    let mut step = (range[1] - range[0]) / GRID as f64;
    let grid = (0..=GRID).map(|k| range[0] + k as f64 * step);
    let mut best = grid.filter_map(|knot| Some((square(knot)?, knot))).min_by(|a, b| a.0.total_cmp(&b.0))?;
    for _ in 0..HALVINGS {
        step /= 2.0;
        for knot in [best.1 - step, best.1 + step].map(|knot| knot.clamp(range[0], range[1])) {
            if let Some(square) = square(knot).filter(|s| *s < best.0) {
                best = (square, knot);
            }
        }
    }
    Some(best.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slide that stops joins smoothly, one that is struck sharply; neither is a polynomial.
    #[test]
    fn joins_differ_in_velocity() {
        let path = |position: fn(f64) -> f64| {
            let times = (0..=20).map(|i| f64::from(i) / 10.0 - 1.0);
            times.map(move |u| (u, [position(u), -2.0 * position(u)]))
        };
        let stop = path(|u| -(0.25 - u).max(0.0).powi(2));
        assert!(smooth_join_square(stop.clone(), [-1.0, 1.0]).unwrap() < 1e-8);
        assert!(quartic_square(stop).unwrap() > 1e-3);
        let stroke = path(|u| if u < 0.03 { 0.1 * u * u } else { 0.1 * u * u + u - 0.03 });
        assert!(sharp_join_square(stroke.clone(), [0.0, 0.1]).unwrap() < 1e-8);
        assert!(smooth_join_square(stroke.clone(), [-1.0, 1.0]).unwrap() > 1e-2);
        assert!(quartic_square(stroke).unwrap() > 1e-2);
        assert_eq!(PathFit::<3>::empty().square(), None);
    }
}
