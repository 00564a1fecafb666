//! Straight lines through points.

/// A least-squares line.
pub struct LineFit {
    pub intercept: f64,
    pub slope: f64,
    /// Variance of the slope for points of unit variance.
    pub slope_variance: f64,
    /// Residual sum of squares.
    pub square: f64,
}

impl LineFit {
    /// The line through points (t, y).
    pub fn new(points: &[(f64, f64)]) -> LineFit {
        let n = points.len() as f64;
        let (mt, my) =
            (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
        let spread = points.iter().map(|p| (p.0 - mt).powi(2)).sum::<f64>();
        let slope = points.iter().map(|p| (p.0 - mt) * (p.1 - my)).sum::<f64>() / spread;
        let intercept = my - slope * mt;
        let square = points.iter().map(|p| (p.1 - intercept - slope * p.0).powi(2)).sum();
        LineFit { intercept, slope, slope_variance: 1.0 / spread, square }
    }
}
