//! What is left of windows under variance components as they may be, one draw of them: coordinates in which the parts of launches are
//! simple, and how what windows show leads there.

use nalgebra::{DMatrix, DVector};

use super::discrepancy::Discrepancy;
use super::unnamed::Lacks;
use super::whitened::{Whitened, whiten};
use crate::discover::gaussian::Components;
use crate::discover::launch::Part;

/// The likelihood under some components.
pub struct Under {
    pub parts: Vec<Whitened>,
    /// By window that depends on the values: by how much its part's whitened residual grows with what was seen less what is shown, 1/m.
    pub maps: Vec<DMatrix<f64>>,
    pub discrepancy: Discrepancy,
    /// What is added to its log likelihoods: how likely the fit's own components make what is seen there less how likely these do.
    pub log_weight: f64,
}

/// A window's place among the coordinates of a part.
pub struct Place {
    pub part: usize,
    pub row: usize,
    /// By how much the part's coordinates grow with what was seen, 1/m; see [`launch::by_position`](crate::discover::launch::by_position).
    pub by_position: DMatrix<f64>,
}

impl Under {
    /// Parts under components, and windows at their places; `before`: the same under other components, of whose fields these are. `None` where
    /// the covariance fails.
    pub fn new(
        parts: &[Part],
        places: &[Place],
        components: &Components,
        slots: usize,
        (lacks, before): (&Lacks, Option<&Under>),
    ) -> Option<Under> {
        let whole = parts.iter().map(|p| whiten(p, components, slots)).collect::<Option<Vec<_>>>()?;
        let (parts, roots): (Vec<Whitened>, Vec<DMatrix<f64>>) = whole.into_iter().unzip();
        let map = |place: &Place| {
            let mut whole = DMatrix::zeros(parts[place.part].left.len(), place.by_position.ncols());
            whole.rows_mut(place.row, place.by_position.nrows()).copy_from(&place.by_position);
            roots[place.part].solve_lower_triangular(&whole)
        };
        let maps = places.iter().map(map).collect::<Option<Vec<_>>>()?;
        let discrepancy = match before {
            Some(before) => before.discrepancy.under(&parts),
            None => lacks.discrepancy(&parts),
        };
        let mut found = Under { parts, maps, discrepancy, log_weight: 0.0 };
        if let Some(before) = before {
            found.log_weight = before.at_fit() - found.at_fit();
        }
        Some(found)
    }

    /// Without what is needed no more once fields are made of it: derivatives of parts.
    pub fn ready(mut self) -> Under {
        for part in &mut self.parts {
            (part.slots, part.field) = (DMatrix::zeros(0, 0), DMatrix::zeros(0, 0));
        }
        self
    }

    /// Log likelihood at the fit, nothing lacking.
    fn at_fit(&self) -> f64 {
        self.parts.iter().map(|part| part.log_density(part.left.norm_squared())).sum()
    }

    /// What the fit leaves of every part.
    pub fn left(&self) -> Vec<DVector<f64>> {
        self.parts.iter().map(|p| p.left.clone()).collect()
    }

    /// Log likelihoods of what parts leave beside every shared field.
    pub fn log_likelihoods(&self, left: &[DVector<f64>]) -> Vec<f64> {
        let mut out = self.discrepancy.log_likelihoods(&self.parts, left);
        out.iter_mut().for_each(|l| *l += self.log_weight);
        out
    }

    /// Numbers that it holds.
    pub fn numbers(&self) -> usize {
        let parts = self.parts.iter().map(|p| p.left.len());
        parts.chain(self.maps.iter().map(DMatrix::len)).sum::<usize>() + self.discrepancy.numbers()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::components;
    use crate::discover::gaussian::Prior;
    use crate::discover::launch::Block;
    use crate::estimate::sampler::log_sum_exp;
    use crate::rng;

    fn parts() -> Vec<Part> {
        let block = |window: usize| Block {
            window,
            left: DVector::from_fn(5, |i, _| 2.0 * wave(i + 9 * window)),
            slow: DVector::from_fn(5, |i, _| 1.0 / (1 + i) as f64),
            columns: DMatrix::from_fn(5, 1, |i, _| wave(3 * i + window)),
            alike: DMatrix::zeros(5, 0),
            alike_of: Vec::new(),
            own: DMatrix::zeros(5, 0),
            kinds: Vec::new(),
            log_white: 0.0,
        };
        let part = |launch: usize| Part {
            launch,
            blocks: vec![block(2 * launch), block(2 * launch + 1)],
            differs: true,
        };
        (0..3).map(part).collect()
    }

    fn wave(k: usize) -> f64 {
        libm::sin(1.7 * k as f64 + 0.3)
    }

    fn with(slow: f64) -> Components {
        Components { slow, push: Vec::new(), leap: 0.01, strength: 0.0, spread: vec![0.0] }
    }

    /// The second window of the first part.
    fn place() -> Place {
        Place { part: 0, row: 5, by_position: DMatrix::from_fn(5, 3, |i, k| wave(7 * i + k)) }
    }

    fn under(slow: f64, before: Option<&Under>) -> Under {
        Under::new(&parts(), &[place()], &with(slow), 1, (&Lacks::Nothing, before)).unwrap()
    }

    /// A window that shows otherwise moves its own rows alone, whitened.
    #[test]
    fn windows_move_their_own_rows() {
        let (first, other) = (under(0.0, None), under(2.0, None));
        // Without misfit the parts are white as they are.
        assert!((first.maps[0].rows(5, 5) - place().by_position).norm() < 1e-12);
        assert_eq!(first.maps[0].rows(0, 5).norm(), 0.0);
        assert!(other.maps[0].norm() < first.maps[0].norm());
    }

    /// The mean over components drawn at the fit, away from it, is the integral over them, both relative to the fit.
    #[test]
    fn the_mean_over_draws_is_the_integral() {
        let (parts, prior) = (parts(), prior());
        let mut likely = components::Likelihood::new(&parts, &with(1.0));
        let drawn = likely.drawn(&prior, 1500, &mut rng::stream(5, "test"));
        let first = under(1.0, None);
        let off = DVector::from_column_slice(&[1.5, -0.8, 0.9]);
        let at = |under: &Under, share: f64| {
            let mut left = under.left();
            left[0] += &under.maps[0] * &off * share;
            under.log_likelihoods(&left)[0]
        };
        let mean = |share: f64| {
            let all: Vec<f64> = drawn.iter().map(|c| at(&under(c.slow, Some(&first)), share)).collect();
            log_sum_exp(all.iter().copied()) - libm::log(all.len() as f64)
        };
        let integral = |share: f64| {
            let grid = (0..400).map(|i| -8.0 + 0.04 * f64::from(i));
            // Logarithms of slow misfit are believed normal about 0 with a deviation of 2.
            let of = |l: f64| at(&under(libm::exp(l), None), share) - 0.5 * (l / 2.0).powi(2);
            log_sum_exp(grid.map(of).collect::<Vec<_>>())
        };
        let plugged = at(&first, 1.0) - at(&first, 0.0);
        let (found, wanted) = (mean(1.0) - mean(0.0), integral(1.0) - integral(0.0));
        assert!((mean(0.0) - at(&first, 0.0)).abs() < 1e-9, "at the fit all are as likely");
        assert!((found - wanted).abs() < 0.03, "{found} for {wanted}, {plugged} at the fit");
        assert!((plugged - wanted).abs() > 0.05, "{plugged} at the fit for {wanted}");
    }

    fn prior() -> Prior {
        Prior {
            precision: DMatrix::identity(1, 1),
            off: DVector::zeros(1),
            plausible: vec![0.0],
            reason: vec![0.0],
            by_setting: vec![false],
        }
    }
}
