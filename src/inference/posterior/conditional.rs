//! Likelihood conditional on one draw of the variance components: whitened groups and the maps from segment
//! predictions to them.

use nalgebra::{DMatrix, DVector};

use super::basis_field::DiscrepancyModel;
use super::discrepancy::FieldMixture;
use super::whitened::{WhitenedGroup, whiten};
use crate::error::Result;
use crate::inference::mixed_model::group_statistics::VarianceComponents;
use crate::inference::mixed_model::groups::Group;
use crate::progress::Progress;

/// Likelihood given variance components.
pub struct ConditionalLikelihood {
    pub groups: Vec<WhitenedGroup>,
    /// By segment: derivative of its group's whitened residual with respect to observed minus predicted
    /// positions, 1/m.
    pub maps: Vec<DMatrix<f64>>,
    pub discrepancy: FieldMixture,
    /// Log importance weight: log likelihood at the fit under the fit's components minus that under these.
    pub log_weight: f64,
}

/// A segment's rows in its group.
pub struct BlockIndex {
    pub group: usize,
    pub row: usize,
    /// Derivative of the group's coordinates with respect to observed positions, 1/m; see
    /// [`observation_jacobian`](crate::inference::mixed_model::groups::observation_jacobian).
    pub by_position: DMatrix<f64>,
}

impl ConditionalLikelihood {
    /// Conditional likelihood of groups and segments given components. `at_fit`: the conditional likelihood at
    /// the fit, whose fields are reused. `None` if a covariance fails.
    pub fn new(
        groups: &[Group],
        blocks: &[BlockIndex],
        components: &VarianceComponents,
        slots: usize,
        (discrepancy_model, at_fit): (&DiscrepancyModel, Option<&ConditionalLikelihood>),
        progress: &dyn Progress,
    ) -> Result<Option<ConditionalLikelihood>> {
        let white = |p| progress.check_stop().map(|()| whiten(p, components, slots));
        let Some(whole) = groups.iter().map(white).collect::<Result<Option<Vec<_>>>>()? else {
            return Ok(None);
        };
        let (groups, roots): (Vec<WhitenedGroup>, Vec<DMatrix<f64>>) = whole.into_iter().unzip();
        let map = |block: &BlockIndex| {
            progress.check_stop()?;
            let mut whole = DMatrix::zeros(groups[block.group].residual.len(), block.by_position.ncols());
            whole.rows_mut(block.row, block.by_position.nrows()).copy_from(&block.by_position);
            Ok(roots[block.group].solve_lower_triangular(&whole))
        };
        let Some(maps) = blocks.iter().map(map).collect::<Result<Option<Vec<_>>>>()? else {
            return Ok(None);
        };
        let discrepancy = match at_fit {
            Some(at_fit) => at_fit.discrepancy.with_groups(&groups, progress)?,
            None => discrepancy_model.discrepancy(&groups, progress)?,
        };
        let mut conditional_likelihood = ConditionalLikelihood { groups, maps, discrepancy, log_weight: 0.0 };
        if let Some(at_fit) = at_fit {
            conditional_likelihood.log_weight =
                at_fit.log_likelihood_at_fit() - conditional_likelihood.log_likelihood_at_fit();
        }
        Ok(Some(conditional_likelihood))
    }

    /// Drops the Jacobians, which are not needed once the fields are prepared.
    pub fn drop_jacobians(mut self) -> ConditionalLikelihood {
        for group in &mut self.groups {
            (group.jacobian, group.field_jacobian) = (DMatrix::zeros(0, 0), DMatrix::zeros(0, 0));
        }
        self
    }

    /// Log likelihood at the fit without a field.
    fn log_likelihood_at_fit(&self) -> f64 {
        self.groups.iter().map(|group| group.log_density(group.residual.norm_squared())).sum()
    }

    /// Residuals of every group at the fit.
    pub fn residuals(&self) -> Vec<DVector<f64>> {
        self.groups.iter().map(|p| p.residual.clone()).collect()
    }

    /// Log likelihoods of residuals under every field.
    pub fn log_likelihoods(&self, residuals: &[DVector<f64>]) -> Vec<f64> {
        let mut out = self.discrepancy.log_likelihoods(&self.groups, residuals);
        out.iter_mut().for_each(|l| *l += self.log_weight);
        out
    }

    /// Number of stored floats.
    pub fn stored_floats(&self) -> usize {
        let groups = self.groups.iter().map(|p| p.residual.len());
        groups.chain(self.maps.iter().map(DMatrix::len)).sum::<usize>() + self.discrepancy.stored_floats()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sampler::log_sum_exp;
    use crate::inference::mixed_model::groups::SegmentBlock;
    use crate::inference::mixed_model::variance_components;
    use crate::progress::NoProgress;
    use crate::rng;

    fn synthetic_groups() -> Vec<Group> {
        let block = |window: usize| SegmentBlock {
            segment: window,
            residual: DVector::from_fn(5, |i, _| 2.0 * wave(i + 9 * window)),
            gp_variance: DVector::from_fn(5, |i, _| 1.0 / (1 + i) as f64),
            jacobian: DMatrix::from_fn(5, 1, |i, _| wave(3 * i + window)),
            z_group: DMatrix::zeros(5, 0),
            z_group_effects: Vec::new(),
            z_segment: DMatrix::zeros(5, 0),
            z_segment_effects: Vec::new(),
            nuisances: DMatrix::zeros(5, 0),
            log_det_noise: 0.0,
        };
        let group = |launch: usize| Group {
            trial: launch,
            blocks: vec![block(2 * launch), block(2 * launch + 1)],
            has_random_effects: true,
        };
        (0..3).map(group).collect()
    }

    fn wave(k: usize) -> f64 {
        libm::sin(1.7 * k as f64 + 0.3)
    }

    fn components_with(slow: f64) -> VarianceComponents {
        VarianceComponents { discrepancy: slow, accelerations: Vec::new(), impact: 0.01, scale: 0.0 }
    }

    /// The second segment of the first group.
    fn block_index() -> BlockIndex {
        BlockIndex { group: 0, row: 5, by_position: DMatrix::from_fn(5, 3, |i, k| wave(7 * i + k)) }
    }

    fn conditional(slow: f64, at_fit: Option<&ConditionalLikelihood>) -> ConditionalLikelihood {
        ConditionalLikelihood::new(
            &synthetic_groups(),
            &[block_index()],
            &components_with(slow),
            1,
            (&DiscrepancyModel::Absent, at_fit),
            &NoProgress,
        )
        .unwrap()
        .unwrap()
    }

    /// A changed prediction affects only the segment's own rows, whitened.
    #[test]
    fn predictions_affect_their_own_rows() {
        let (first, other) = (conditional(0.0, None), conditional(2.0, None));
        // Without discrepancy the groups are already white.
        assert!((first.maps[0].rows(5, 5) - block_index().by_position).norm() < 1e-12);
        assert_eq!(first.maps[0].rows(0, 5).norm(), 0.0);
        assert!(other.maps[0].norm() < first.maps[0].norm());
    }

    /// Away from the fit, the mean over components drawn at the fit matches the integral over them, both
    /// relative to the fit.
    #[test]
    fn mean_over_draws_matches_integral() {
        let groups = synthetic_groups();
        let mut likely = variance_components::ComponentLikelihood::new(&groups, &components_with(1.0));
        let drawn = likely.sample(1500, &mut rng::stream(5, "test"), &NoProgress).unwrap();
        let first = conditional(1.0, None);
        let off = DVector::from_column_slice(&[1.5, -0.8, 0.9]);
        let at = |under: &ConditionalLikelihood, share: f64| {
            let mut residuals = under.residuals();
            residuals[0] += &under.maps[0] * &off * share;
            under.log_likelihoods(&residuals)[0]
        };
        let mean = |share: f64| {
            let all: Vec<f64> =
                drawn.iter().map(|c| at(&conditional(c.discrepancy, Some(&first)), share)).collect();
            log_sum_exp(all.iter().copied()) - libm::log(all.len() as f64)
        };
        let integral = |share: f64| {
            let grid = (0..400).map(|i| -8.0 + 0.04 * f64::from(i));
            // The log discrepancy scale has a N(0, 2) prior.
            let of = |l: f64| at(&conditional(libm::exp(l), None), share) - 0.5 * (l / 2.0).powi(2);
            log_sum_exp(grid.map(of).collect::<Vec<_>>())
        };
        let plugged = at(&first, 1.0) - at(&first, 0.0);
        let (conditional_likelihood, wanted) = (mean(1.0) - mean(0.0), integral(1.0) - integral(0.0));
        assert!((mean(0.0) - at(&first, 0.0)).abs() < 1e-9, "all are equally likely at the fit");
        assert!(
            (conditional_likelihood - wanted).abs() < 0.03,
            "{conditional_likelihood} for {wanted}, {plugged} at the fit"
        );
        assert!((plugged - wanted).abs() > 0.05, "{plugged} at the fit for {wanted}");
    }
}
