//! What would be left if only noise were, and how far a fit is above it.

use super::fit::Fitted;
use super::noise::{Noise, Slow, expected_squares};
use super::stats::{f_above, mean_error, median, t_above};
use super::window::{self, Kind, Window};

/// Share of the trials, the furthest off, that have no say in what slow residuals leave.
const ODD: f64 = 0.1;
/// Excess of the middle trial, as a share of the floor, below which the excess of all is that of a few.
const USUAL: f64 = 0.15;

/// Expected sum of squares by trial, and its variance, if only noise were left; units of the noise.
pub struct Expected {
    pub mean: Vec<f64>,
    /// Sum of squares that contact windows leave in all trials, if contacts are as good as the usual one.
    pub contacts: f64,
    pub variance: Vec<f64>,
    /// Number of coordinates by trial.
    pub coordinates: Vec<f64>,
    /// Relative error of the noise's own variance.
    pub floor_error: f64,
    /// Slow parts of flights' residuals, by window, and the scale of those, m.
    slow: Vec<Option<(Slow, f64)>>,
}

impl Expected {
    /// Sum over trials, contacts and all.
    pub fn total(&self) -> f64 {
        self.mean.iter().sum::<f64>() + self.contacts
    }

    /// [`Expected::misfit`] of a fit, by its flights and runs: what a contact leaves is not what noise leaves.
    pub fn misfit_of(&self, fit: &Fitted, windows: &[Window]) -> (f64, f64) {
        let mut squares = vec![0.0; self.mean.len()];
        for (w, window) in windows.iter().enumerate().filter(|(_, w)| w.kind != Kind::Contact) {
            squares[window.trial] += fit.pass.squares[w];
        }
        self.misfit(&squares)
    }

    /// How far the middle trial's flights and runs are above the floor, as a share of it.
    pub fn middle_excess(&self, fit: &Fitted, windows: &[Window]) -> f64 {
        let mut squares = vec![0.0; self.mean.len()];
        for (w, window) in windows.iter().enumerate().filter(|(_, w)| w.kind != Kind::Contact) {
            squares[window.trial] += fit.pass.squares[w];
        }
        let shares: Vec<f64> = squares.iter().zip(&self.mean).map(|(s, m)| (s - m) / m.max(1.0)).collect();
        median(&shares).max(0.0)
    }

    /// Excess over the floor as a share of it; the same in its standard deviations if the noise is what it is taken for;
    /// p by trial.
    pub fn above(&self, fit: &Fitted, windows: &[Window]) -> (f64, f64, f64) {
        let (excess, p) = self.misfit_of(fit, windows);
        let all: f64 = self.mean.iter().sum();
        let deviation = (self.variance.iter().sum::<f64>() + (all * self.floor_error).powi(2)).sqrt();
        // One trial with a missed outlier must not speak for all, unless nothing can be an outlier.
        let usual =
            if window::leaping(windows) || self.middle_excess(fit, windows) > USUAL { excess } else { 0.0 };
        (usual, usual * all / deviation.max(1e-9), p)
    }

    /// Squares that flights' slow parts hold above what noise leaves there, and p of there being none: against the noise
    /// that fast parts show, not against other trials. What acts at one place or time in few trials shows here and not in
    /// what trials have in common. The trials that are furthest off do not count: they may have something of their own.
    pub fn slow_misfit(&self, fit: &Fitted, windows: &[Window], unit: f64) -> (f64, f64) {
        let trials = self.mean.len();
        // squares, mean, variance by trial
        let mut sums = vec![[0.0; 3]; trials];
        for (w, window) in windows.iter().enumerate() {
            if let Some((slow, sd)) = &self.slow[w] {
                let own = &mut sums[window.trial];
                own[0] += slow.square(&fit.pass.residuals[w]) / (sd * sd);
                own[1] += slow.mean;
                own[2] += slow.variance;
            }
        }
        sums.retain(|s| s[1] > 0.0);
        sums.sort_by(|a, b| (a[0] / a[1]).total_cmp(&(b[0] / b[1])));
        let all: f64 = sums.iter().map(|s| s[1]).sum();
        sums.truncate(sums.len() - (sums.len() as f64 * ODD).ceil() as usize);
        let total = |k: usize| sums.iter().map(|s| s[k]).sum::<f64>();
        let taken = fit.layout.slots.len() as f64 * unit * total(1) / all.max(1e-9);
        let mean = total(1) - taken;
        if mean <= 0.0 {
            return (0.0, 1.0);
        }
        let freedom = 2.0 * total(1).powi(2) / total(2).max(1e-9);
        let p = f_above(total(0) / mean, freedom, 2.0 / self.floor_error.powi(2));
        ((total(0) - mean).max(0.0), p)
    }

    /// Excess over the floor as a share of it, and the one-sided p, by trial, of the hypothesis that there is none.
    fn misfit(&self, squares: &[f64]) -> (f64, f64) {
        let excess: Vec<f64> = squares.iter().zip(&self.mean).map(|(s, m)| s - m).collect();
        let g = excess.len() as f64;
        let (mean, error) = mean_error(&excess);
        let expected_error = self.variance.iter().sum::<f64>().sqrt() / g;
        let all = self.mean.iter().sum::<f64>();
        let floor = all / g * self.floor_error;
        let se = (error.max(expected_error).powi(2) + floor * floor).sqrt();
        (mean * g / all.max(1e-9), t_above(mean / se.max(1e-12), g - 1.0))
    }
}

fn slow(window: &Window, rho: f64) -> Option<Slow> {
    let smooth = window.smooth.as_ref().filter(|_| window.kind == Kind::Flight)?;
    let times: Vec<f64> = window.points.iter().map(|p| p.time).collect();
    let weights: Vec<f64> = window.points.iter().map(|p| p.weight).collect();
    Slow::new(&times, &weights, smooth.axes, rho.max(0.0))
}

pub fn expected(windows: &[Window], sd: &[f64], trials: usize, noise: &Noise) -> Expected {
    let mut out = Expected {
        mean: vec![0.0; trials],
        contacts: 0.0,
        variance: vec![0.0; trials],
        coordinates: vec![0.0; trials],
        floor_error: noise.floor_error(),
        slow: windows.iter().zip(sd).map(|(w, sd)| Some((slow(w, noise.rho)?, *sd))).collect(),
    };
    for (w, _) in windows.iter().zip(sd).filter(|(_, sd)| sd.is_finite()) {
        let n = w.points.iter().filter(|p| p.weight > 0.0).count() as f64;
        let axes = w.smooth.as_ref().map_or(2.0, |s| s.axes);
        let (mean, variance) = match w.kind {
            Kind::Flight | Kind::Roll => {
                let times: Vec<f64> = w.points.iter().map(|p| p.time).collect();
                let weights: Vec<f64> = w.points.iter().map(|p| p.weight).collect();
                expected_squares(&times, &weights, axes, noise.rho)
            }
            Kind::Contact => {
                out.contacts += 2.0 * n - 5.0;
                out.coordinates[w.trial] += 2.0 * n;
                continue;
            }
            Kind::Run | Kind::Leap | Kind::Shot => {
                let left = (2.0 * n - w.nuisances.len() as f64).max(1.0);
                (left, 2.0 * left)
            }
        };
        out.mean[w.trial] += mean.max(0.0);
        out.variance[w.trial] += variance;
        out.coordinates[w.trial] += axes * n;
    }
    out
}
