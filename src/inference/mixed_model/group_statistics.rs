//! Sufficient statistics of a group of observations under given variance components.
//!
//! Cross products are computed once for each value of the discrepancy component; random effects of low rank
//! enter by rank-one updates (Sherman and Morrison). With the scale of a group integrated out its density is
//! a multivariate Student t.

use nalgebra::{DMatrix, DVector};

use crate::error::Result;
use crate::inference::mixed_model::groups::{Group, SegmentBlock};
use crate::inference::mixed_model::random_design::RandomEffect;
use crate::inference::selection::FixedEffectsPrior;
use crate::progress::Progress;

/// Degrees of freedom of a trial's scale: one trial in a hundred is three times as wide as usual.
pub const SCALE_DOF: f64 = 4.0;

/// Variance components: standard deviations.
#[derive(Clone, Debug, PartialEq)]
pub struct VarianceComponents {
    /// Trial discrepancy, in units of the noise.
    pub discrepancy: f64,
    /// Random accelerations, in declared standard deviations.
    pub accelerations: Vec<f64>,
    /// Impact errors, as a share of the approach speed.
    pub impact: f64,
    /// Scale of effects, relative; 0 in models without effects.
    pub scale: f64,
}

/// Sufficient statistics of a group under given components.
#[derive(Clone, Debug)]
pub struct GroupStatistics {
    pub trial: usize,
    /// X'V^-1 X, X'V^-1 r, r'V^-1 r.
    pub gram: DMatrix<f64>,
    pub score: DVector<f64>,
    pub square: f64,
    /// Log determinant of the covariance V, and number of coordinates.
    pub log_det: f64,
    pub count: f64,
    /// Tolerance of the square: differences between engines are systematic and bounded, so that a smaller
    /// square is no evidence. 0 for measured data.
    pub misfit_tolerance: f64,
}

/// Generalised least-squares estimate: step from the linearization point, and its covariance.
pub struct GlsEstimate {
    pub step: DVector<f64>,
    pub covariance: DMatrix<f64>,
}

impl VarianceComponents {
    /// Standard deviation of a random effect.
    pub fn sd_of(&self, kind: RandomEffect) -> f64 {
        match kind {
            RandomEffect::Acceleration(place) => self.accelerations[place],
            RandomEffect::ImpactNoise => self.impact,
            RandomEffect::ContactReset(_) => 1.0,
            RandomEffect::Scale => self.scale,
        }
    }
}

/// Cross products of a group's columns under noise and discrepancy, by segment: parameters, group-level
/// effects, residual, and segment-level effects; with the log determinant.
pub struct CrossProducts {
    blocks: Vec<(DMatrix<f64>, f64)>,
    count: f64,
}

impl CrossProducts {
    /// For the discrepancy `slow` in units of the noise, and a selection of columns.
    pub fn of(group: &Group, columns: &[usize], slow: f64) -> CrossProducts {
        CrossProducts {
            blocks: group.blocks.iter().map(|b| block_products(b, columns, slow)).collect(),
            count: group.blocks.iter().map(|b| b.count() as f64).sum(),
        }
    }

    /// Statistics of the selected columns; `None` if the covariance is singular.
    pub fn statistics(
        &self,
        group: &Group,
        columns: &[usize],
        components: &VarianceComponents,
    ) -> Option<GroupStatistics> {
        self.with_segment_effects(group, components)?.statistics(group, columns, components)
    }

    /// Adds the variances of segment-level effects.
    pub fn with_segment_effects(
        &self,
        group: &Group,
        components: &VarianceComponents,
    ) -> Option<GroupProducts> {
        let n = self.blocks.first()?.0.ncols() - group.blocks.first()?.z_segment.ncols();
        let mut out = GroupProducts { products: DMatrix::zeros(n, n), log_det: 0.0, count: self.count };
        for (block, (products, log_det)) in group.blocks.iter().zip(&self.blocks) {
            out.log_det += log_det;
            if block.z_segment_effects.is_empty() {
                out.products += products;
                continue;
            }
            let mut products = products.clone();
            for (k, kind) in block.z_segment_effects.iter().enumerate() {
                out.log_det += rank_one_update(&mut products, n + k, components.sd_of(*kind))?;
            }
            out.products += products.view((0, 0), (n, n));
        }
        Some(out)
    }
}

/// Cross products of a group, summed over segments.
#[derive(Clone)]
pub struct GroupProducts {
    products: DMatrix<f64>,
    log_det: f64,
    count: f64,
}

impl GroupProducts {
    fn statistics(
        self,
        group: &Group,
        columns: &[usize],
        components: &VarianceComponents,
    ) -> Option<GroupStatistics> {
        let GroupProducts { products, log_det, count } =
            self.with_group_effects(group, columns, components)?;
        let (parameters, left) = (columns.len(), products.ncols() - 1);
        Some(GroupStatistics {
            trial: group.trial,
            gram: products.view((0, 0), (parameters, parameters)).into_owned(),
            score: products.view((0, left), (parameters, 1)).column(0).into_owned(),
            square: products[(left, left)],
            log_det,
            count,
            misfit_tolerance: if group.has_random_effects { 0.0 } else { count },
        })
    }

    /// Log density of a group at the linearization point.
    pub fn log_density(&self, group: &Group, components: &VarianceComponents) -> Option<f64> {
        let GroupProducts { products, log_det, count } =
            self.clone().with_group_effects(group, &[], components)?;
        let left = products.ncols() - 1;
        Some(student_log_density(products[(left, left)], log_det, count))
    }

    /// Adds the variances of group-level effects.
    fn with_group_effects(
        mut self,
        group: &Group,
        columns: &[usize],
        components: &VarianceComponents,
    ) -> Option<GroupProducts> {
        let first = columns.len();
        for k in (first..self.products.ncols() - 1).filter(|_| group.has_random_effects) {
            let scale = components.sd_of(group.blocks[0].z_group_effects[k - first]);
            self.log_det += rank_one_update(&mut self.products, k, scale)?;
        }
        Some(self)
    }
}

fn block_products(block: &SegmentBlock, columns: &[usize], slow: f64) -> (DMatrix<f64>, f64) {
    let (parameters, q) = (columns.len(), columns.len() + block.z_group.ncols());
    let all = DMatrix::from_fn(block.residual.len(), q + 1 + block.z_segment.ncols(), |i, k| match k {
        _ if k < parameters => block.jacobian[(i, columns[k])],
        _ if k < q => block.z_group[(i, k - parameters)],
        _ if k == q => block.residual[i],
        _ => block.z_segment[(i, k - q - 1)],
    });
    block.products(&all, slow)
}

/// Adds a random effect of standard deviation `scale` along one column to the covariance (Sherman-Morrison):
/// updates the products and returns the increase of the log determinant.
fn rank_one_update(products: &mut DMatrix<f64>, place: usize, scale: f64) -> Option<f64> {
    if scale == 0.0 {
        return Some(0.0);
    }
    let own: Vec<f64> = products.column(place).iter().map(|p| scale * p).collect();
    let grows = 1.0 + scale * own[place];
    if !grows.is_finite() || grows <= 0.0 {
        return None;
    }
    for (column, along) in products.as_mut_slice().chunks_exact_mut(own.len()).zip(&own) {
        let share = along / grows;
        column.iter_mut().zip(&own).for_each(|(product, own)| *product -= share * own);
    }
    Some(grows.ln())
}

/// Statistics of all groups; `None` if a covariance is singular.
pub fn group_statistics(
    groups: &[Group],
    components: &VarianceComponents,
    progress: &dyn Progress,
) -> Result<Option<Vec<GroupStatistics>>> {
    let columns: Vec<usize> = (0..groups.first().map_or(0, |p| p.blocks[0].jacobian.ncols())).collect();
    let one = |group: &Group| {
        progress.check_stop()?;
        let products = CrossProducts::of(group, &columns, components.discrepancy);
        Ok(products.statistics(group, &columns, components))
    };
    groups.iter().map(one).collect()
}

/// Log density of a multivariate Student t with squared distance `square` in `count` coordinates.
pub fn student_log_density(square: f64, log_det: f64, count: f64) -> f64 {
    let half = 0.5 * (SCALE_DOF + count);
    libm::lgamma(half)
        - libm::lgamma(0.5 * SCALE_DOF)
        - 0.5 * count * (SCALE_DOF * std::f64::consts::PI).ln()
        - 0.5 * log_det
        - half * (square.max(0.0) / SCALE_DOF).ln_1p()
}

impl GroupStatistics {
    /// Square after a step of the parameters.
    pub fn square_after(&self, step: &DVector<f64>) -> f64 {
        self.square + (&self.gram * step - &self.score * 2.0).dot(step)
    }

    /// Weight of the group, its scale integrated out, after a step of the parameters.
    pub fn weight_after(&self, step: &DVector<f64>) -> f64 {
        self.weight_at(self.square_after(step))
    }

    /// Weight of the group where its square is `square`.
    pub fn weight_at(&self, square: f64) -> f64 {
        (SCALE_DOF + self.count) / (SCALE_DOF + square.max(0.0))
    }

    /// Log density after a step of the parameters.
    pub fn log_density_after(&self, step: &DVector<f64>) -> f64 {
        student_log_density(self.square_after(step), self.log_det, self.count)
    }

    /// Log density at a square; squares below the tolerance are no better.
    pub fn log_density_at(&self, square: f64) -> f64 {
        student_log_density(square.max(self.misfit_tolerance), self.log_det, self.count)
    }

    /// Statistics of the first `count` parameters, the others fixed at the linearization point.
    pub fn first_parameters(&self, count: usize) -> GroupStatistics {
        self.parameter_range(0, count)
    }

    /// Statistics of the parameters after the first `count`, which are fixed at the linearization point.
    pub fn after_parameters(&self, count: usize) -> GroupStatistics {
        self.parameter_range(count, self.score.len() - count)
    }

    fn parameter_range(&self, first: usize, count: usize) -> GroupStatistics {
        GroupStatistics {
            gram: self.gram.view((first, first), (count, count)).into_owned(),
            score: self.score.rows(first, count).into_owned(),
            ..self.clone()
        }
    }

    /// Log predictive density given an estimate from other trials.
    pub fn log_predictive_density(&self, others: &GlsEstimate) -> f64 {
        let density = |(square, log_det): (f64, f64)| {
            student_log_density(square.max(self.misfit_tolerance), log_det, self.count)
        };
        self.predictive_distance(others).map_or(f64::NEG_INFINITY, density)
    }

    /// Squared distance from the prediction of `others` under the predictive covariance, and its log
    /// determinant; `None` if a matrix is singular.
    pub fn predictive_distance(&self, others: &GlsEstimate) -> Option<(f64, f64)> {
        let q = self.gram.nrows();
        if q == 0 {
            return Some((self.square, self.log_det));
        }
        // I + S H, with S = L L': I + L'H L.
        let l = others.covariance.clone().cholesky()?.l();
        let mut inner = l.tr_mul(&(&self.gram * &l));
        (0..q).for_each(|k| inner[(k, k)] += 1.0);
        let inner = inner.cholesky()?;
        let rest = &self.score - &self.gram * &others.step;
        let along = l.tr_mul(&rest);
        let taken = along.dot(&inner.solve(&along));
        let log_det = 2.0 * inner.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        Some((self.square_after(&others.step) - taken, self.log_det + log_det))
    }
}

/// Generalised least squares with Student weights.
pub fn gls<'a>(
    statistics: impl Iterator<Item = &'a GroupStatistics> + Clone,
    prior: &FixedEffectsPrior,
) -> Option<GlsEstimate> {
    let q = prior.mean_offset.len();
    let mut step = DVector::zeros(q);
    let mut covariance = DMatrix::zeros(q, q);
    for _ in 0..4 {
        let mut gram = prior.precision.clone();
        let mut score = &prior.precision * &prior.mean_offset;
        for t in statistics.clone() {
            let weight = t.weight_after(&step);
            gram += &t.gram * weight;
            score.axpy(weight, &t.score, 1.0);
        }
        let factor = gram.cholesky()?;
        step = factor.solve(&score);
        covariance = factor.inverse();
    }
    Some(GlsEstimate { step, covariance })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::NoProgress;

    /// Two segments of a trial with six coordinates each, two parameters, two group-level and one
    /// segment-level effect.
    fn part() -> Group {
        let block = |seed: usize| {
            let wave = |k: usize| libm::sin(1.7 * (k + 13 * seed) as f64);
            SegmentBlock {
                segment: seed,
                residual: DVector::from_fn(6, |i, _| 2.0 * wave(i)),
                gp_variance: DVector::from_fn(6, |i, _| 1.0 / (1 + i) as f64),
                jacobian: DMatrix::from_fn(6, 2, |i, k| wave(31 + 7 * i + k)),
                z_group: DMatrix::from_fn(6, 2, |i, k| wave(90 + 17 * k + i)),
                z_group_effects: vec![RandomEffect::Acceleration(1), RandomEffect::Scale],
                z_segment: DMatrix::from_fn(6, 1, |i, _| wave(120 + i)),
                z_segment_effects: vec![RandomEffect::Acceleration(0)],
                nuisances: DMatrix::zeros(6, 0),
                log_det_noise: 0.3,
            }
        };
        Group { trial: 0, blocks: vec![block(1), block(2)], has_random_effects: true }
    }

    fn components_of_it() -> VarianceComponents {
        VarianceComponents { discrepancy: 1.3, impact: 0.01, scale: 0.25, accelerations: vec![0.7, 0.4] }
    }

    /// The tolerance limits the density of engine-simulated groups only.
    #[test]
    fn squares_below_the_tolerance_are_no_evidence() {
        let none = GlsEstimate { step: DVector::zeros(0), covariance: DMatrix::zeros(0, 0) };
        let predicted = |square: f64, allowed: f64| {
            let (gram, score) = (DMatrix::zeros(0, 0), DVector::zeros(0));
            GroupStatistics {
                trial: 0,
                gram,
                score,
                square,
                log_det: 0.0,
                count: 12.0,
                misfit_tolerance: allowed,
            }
            .log_predictive_density(&none)
        };
        assert_eq!(predicted(0.1, 12.0), predicted(12.0, 12.0));
        assert!(predicted(13.0, 12.0) < predicted(12.0, 12.0) && predicted(12.0, 0.0) < predicted(0.1, 0.0));
        let allowed = |differs: bool| {
            let group = Group { has_random_effects: differs, ..part() };
            group_statistics(&[group], &components_of_it(), &NoProgress).unwrap().unwrap()[0].misfit_tolerance
        };
        assert_eq!([allowed(true), allowed(false)], [0.0, 12.0]);
    }

    /// The explicit Gaussian: (covariance, columns, residual).
    fn whole(group: &Group, c: &VarianceComponents) -> (DMatrix<f64>, DMatrix<f64>, DVector<f64>) {
        let [a, b] = &group.blocks[..] else { unreachable!("two windows") };
        let rows = |f: &dyn Fn(&SegmentBlock) -> DMatrix<f64>| {
            let (x, y) = (f(a), f(b));
            DMatrix::from_fn(12, x.ncols(), |i, k| if i < 6 { x[(i, k)] } else { y[(i - 6, k)] })
        };
        let columns = rows(&|p| p.jacobian.clone());
        let left = rows(&|p| DMatrix::from_column_slice(6, 1, p.residual.as_slice())).column(0).into_owned();
        let alike = rows(&|p| p.z_group.clone());
        let alike = alike * DMatrix::from_diagonal(&DVector::from_vec(vec![c.accelerations[1], c.scale]));
        let mut all = &alike * alike.transpose();
        for (b, block) in group.blocks.iter().enumerate() {
            let own = &block.z_segment * c.accelerations[0];
            let diagonal =
                DMatrix::from_diagonal(&block.gp_variance.map(|s| 1.0 + c.discrepancy * c.discrepancy * s));
            let mut view = all.view_mut((6 * b, 6 * b), (6, 6));
            view += diagonal + &own * own.transpose();
        }
        (all, columns, left)
    }

    #[test]
    fn group_statistics_match_the_explicit_gaussian() {
        let (group, c) = (part(), components_of_it());
        let statistics =
            group_statistics(std::slice::from_ref(&group), &c, &NoProgress).unwrap().unwrap().remove(0);
        let (covariance, columns, left) = whole(&group, &c);
        let inverse = covariance.clone().try_inverse().unwrap();
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{a} for {b}");
        close(statistics.square, left.dot(&(&inverse * &left)));
        close(statistics.log_det, covariance.determinant().ln() + 0.6);
        for k in 0..2 {
            close(statistics.score[k], columns.column(k).dot(&(&inverse * &left)));
            for l in 0..2 {
                close(statistics.gram[(k, l)], columns.column(k).dot(&(&inverse * columns.column(l))));
            }
        }
        // Predictive density: parameter uncertainty adds to the covariance.
        let others = GlsEstimate {
            step: DVector::from_vec(vec![0.2, -0.4]),
            covariance: DMatrix::from_row_slice(2, 2, &[0.3, 0.1, 0.1, 0.2]),
        };
        let wide = &covariance + &columns * &others.covariance * columns.transpose();
        let off = &left - &columns * &others.step;
        let square = off.dot(&(wide.clone().try_inverse().unwrap() * &off));
        close(
            statistics.log_predictive_density(&others),
            student_log_density(square, wide.determinant().ln() + 0.6, 12.0),
        );
    }

    /// An outlying trial has bounded influence.
    #[test]
    fn an_outlying_trial_has_bounded_influence() {
        let mut spoilt = part();
        spoilt.blocks.iter_mut().for_each(|b| b.residual *= 1000.0);
        let c = components_of_it();
        let prior = FixedEffectsPrior {
            precision: DMatrix::identity(2, 2),
            mean_offset: DVector::zeros(2),
            log_weight: 0.0,
        };
        let of = |groups: &[Group]| {
            gls(group_statistics(groups, &c, &NoProgress).unwrap().unwrap().iter(), &prior).unwrap().step
        };
        let usual: Vec<Group> = vec![part(); 10];
        let all: Vec<Group> = usual.iter().cloned().chain([spoilt]).collect();
        assert!((of(&usual) - of(&all)).norm() < 0.2, "{} {}", of(&usual), of(&all));
    }
}
