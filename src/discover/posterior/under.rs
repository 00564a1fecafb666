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
    /// What is added to its log likelihoods: components are drawn as likely as they are at the fit, which counts once.
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
        let parts = self.parts.iter().map(|p| p.left.len() + p.slots.len() + p.field.len());
        parts.chain(self.maps.iter().map(DMatrix::len)).sum::<usize>() + self.discrepancy.numbers()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discover::launch::Block;

    /// Under any components the fit is as likely, and a window that shows otherwise moves its own rows alone, whitened.
    #[test]
    fn components_are_weighed_at_the_fit() {
        let wave = |k: usize| libm::sin(1.7 * k as f64 + 0.3);
        let block = |window: usize| Block {
            window,
            left: DVector::from_fn(5, |i, _| wave(i + 9 * window)),
            slow: DVector::from_fn(5, |i, _| 1.0 / (1 + i) as f64),
            columns: DMatrix::from_fn(5, 1, |i, _| wave(3 * i + window)),
            alike: DMatrix::zeros(5, 0),
            alike_of: Vec::new(),
            own: DMatrix::zeros(5, 0),
            kinds: Vec::new(),
            log_white: 0.0,
        };
        let parts = [Part { launch: 0, blocks: vec![block(0), block(1)], differs: true }];
        let by_position = DMatrix::from_fn(5, 3, |i, k| wave(7 * i + k));
        let place = Place { part: 0, row: 5, by_position: by_position.clone() };
        let with =
            |slow: f64| Components { slow, push: Vec::new(), leap: 0.0, strength: 0.0, spread: vec![0.0] };
        let new = |slow, before| {
            Under::new(&parts, std::slice::from_ref(&place), &with(slow), 1, (&Lacks::Nothing, before))
        };
        let first = new(0.0, None).unwrap();
        let other = new(2.0, Some(&first)).unwrap();
        let [a, b] = [&first, &other].map(|u| u.log_likelihoods(&u.left())[0]);
        assert!((a - b).abs() < 1e-12 && other.log_weight != 0.0, "{a} {b}");
        // Without misfit the parts are white as they are.
        assert!((first.maps[0].rows(5, 5) - by_position).norm() < 1e-12);
        assert_eq!(first.maps[0].rows(0, 5).norm(), 0.0);
        assert!(other.maps[0].norm() < first.maps[0].norm());
    }
}
