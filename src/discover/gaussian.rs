//! A part of a launch as the Gaussian that it is: what it says of the slots under some variance components.
//!
//! Products of everything that a part has are taken once for a size of the slow misfit; what else has a variance is of low rank
//! beside that (Woodbury's identity, a column at a time). The scale of a part integrated out, its density is a multivariate Student t.

use nalgebra::{DMatrix, DVector};

use super::columns::RandomEffect;
use super::launch::{Group, SegmentBlock};
use super::selection::FixedEffectsPrior;

/// Degrees of freedom of a launch's scale: one launch in a hundred is three times as wide as the usual one.
pub const SCALE_DOF: f64 = 4.0;

/// Variance components: standard deviations.
#[derive(Clone, Debug, PartialEq)]
pub struct VarianceComponents {
    /// Of the slow misfit, in units of the noise.
    pub discrepancy: f64,
    /// Of pushes by launch, in what effects declare.
    pub accelerations: Vec<f64>,
    /// Of a contact's leaps, in the speed of approach.
    pub impact: f64,
    /// Of the strength of effects of several amplitudes, as a share of it; 0 where a model has none.
    pub scale: f64,
}

/// A part under some components: everything that densities need.
#[derive(Clone, Debug)]
pub struct GroupStatistics {
    pub trial: usize,
    /// Z'C^-1 Z, Z'C^-1 z, z'C^-1 z.
    pub gram: DMatrix<f64>,
    pub score: DVector<f64>,
    pub square: f64,
    /// Logarithm of the covariance's determinant, and the number of coordinates.
    pub log_det: f64,
    pub count: f64,
    /// Square below which a smaller one is no better: what engines may differ by is a bound and no noise, and they differ alike
    /// wherever they do, so that what is left of it adds up over launches to nothing. 0 where noise was measured.
    pub misfit_tolerance: f64,
}

/// What all launches say of the slots: the step from where the model stands, and its covariance.
pub struct GlsEstimate {
    pub step: DVector<f64>,
    pub covariance: DMatrix<f64>,
}

impl VarianceComponents {
    /// Of something that has a variance of its own.
    pub fn sd_of(&self, kind: RandomEffect) -> f64 {
        match kind {
            RandomEffect::Acceleration(place) => self.accelerations[place],
            RandomEffect::ImpactNoise => self.impact,
            RandomEffect::ContactReset(_) => 1.0,
            RandomEffect::Scale => self.scale,
        }
    }
}

/// A part's products under white noise and slow misfit of some size, by block: of its columns, its launch's pushes, what is
/// left of it, and what has variances of its own; the logarithm of the covariance's determinant.
pub struct CrossProducts {
    blocks: Vec<(DMatrix<f64>, f64)>,
    count: f64,
}

impl CrossProducts {
    /// With the slow misfit `slow` in units of the noise, and some of the part's columns.
    pub fn of(part: &Group, columns: &[usize], slow: f64) -> CrossProducts {
        CrossProducts {
            blocks: part.blocks.iter().map(|b| block_products(b, columns, slow)).collect(),
            count: part.blocks.iter().map(|b| b.residual.len() as f64).sum(),
        }
    }

    /// What the part says of the columns under components whose slow misfit this is; `None` where its covariance cannot be taken
    /// apart.
    pub fn statistics(
        &self,
        part: &Group,
        columns: &[usize],
        components: &VarianceComponents,
    ) -> Option<GroupStatistics> {
        self.with_segment_effects(part, components)?.statistics(part, columns, components)
    }

    /// With variances of what every window has of its own: leaps, what contacts renew, and the pushes that they do.
    pub fn with_segment_effects(
        &self,
        part: &Group,
        components: &VarianceComponents,
    ) -> Option<GroupProducts> {
        let n = self.blocks.first()?.0.ncols() - part.blocks.first()?.z_segment.ncols();
        let mut out = GroupProducts { products: DMatrix::zeros(n, n), log_det: 0.0, count: self.count };
        for (block, (products, log_det)) in part.blocks.iter().zip(&self.blocks) {
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

/// A part's products, all its windows together: of its columns, of what its launch has alike, and of what is left of it.
#[derive(Clone)]
pub struct GroupProducts {
    products: DMatrix<f64>,
    log_det: f64,
    count: f64,
}

impl GroupProducts {
    fn statistics(
        self,
        part: &Group,
        columns: &[usize],
        components: &VarianceComponents,
    ) -> Option<GroupStatistics> {
        let GroupProducts { products, log_det, count } =
            self.with_group_effects(part, columns, components)?;
        let (slots, left) = (columns.len(), products.ncols() - 1);
        Some(GroupStatistics {
            trial: part.trial,
            gram: products.view((0, 0), (slots, slots)).into_owned(),
            score: products.view((0, left), (slots, 1)).column(0).into_owned(),
            square: products[(left, left)],
            log_det,
            count,
            misfit_tolerance: if part.has_random_effects { 0.0 } else { count },
        })
    }

    /// The part's log density where the model stands.
    pub fn log_density(&self, part: &Group, components: &VarianceComponents) -> Option<f64> {
        let GroupProducts { products, log_det, count } =
            self.clone().with_group_effects(part, &[], components)?;
        let left = products.ncols() - 1;
        Some(student_log_density(products[(left, left)], log_det, count))
    }

    /// With variances of what differs from launch to launch: C + Z T^2 Z' with what Z'C^-1 Z is already.
    fn with_group_effects(
        mut self,
        part: &Group,
        columns: &[usize],
        components: &VarianceComponents,
    ) -> Option<GroupProducts> {
        let first = columns.len();
        for k in (first..self.products.ncols() - 1).filter(|_| part.has_random_effects) {
            let scale = components.sd_of(part.blocks[0].z_group_effects[k - first]);
            self.log_det += rank_one_update(&mut self.products, k, scale)?;
        }
        Some(self)
    }
}

fn block_products(block: &SegmentBlock, columns: &[usize], slow: f64) -> (DMatrix<f64>, f64) {
    let (slots, q) = (columns.len(), columns.len() + block.z_group.ncols());
    let mut log_det = block.log_det_noise;
    let root = block.gp_variance.map(|s| {
        let all = 1.0 + slow.powi(2) * s;
        log_det += all.ln();
        all.sqrt().recip()
    });
    let all = DMatrix::from_fn(block.residual.len(), q + 1 + block.z_segment.ncols(), |i, k| {
        root[i]
            * match k {
                _ if k < slots => block.jacobian[(i, columns[k])],
                _ if k < q => block.z_group[(i, k - slots)],
                _ if k == q => block.residual[i],
                _ => block.z_segment[(i, k - q - 1)],
            }
    });
    (all.tr_mul(&all), log_det)
}

/// Gives one of the columns of which `products` are a variance of its own, of standard deviation `scale` (Sherman and Morrison's
/// identity): what the products become, and by how much the logarithm of the covariance's determinant grows.
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

/// All parts under components.
pub fn group_statistics(parts: &[Group], components: &VarianceComponents) -> Option<Vec<GroupStatistics>> {
    let columns: Vec<usize> = (0..parts.first().map_or(0, |p| p.blocks[0].jacobian.ncols())).collect();
    parts
        .iter()
        .map(|p| CrossProducts::of(p, &columns, components.discrepancy).statistics(p, &columns, components))
        .collect()
}

/// Logarithm of the Student density of a square among `count` coordinates.
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
        let own =
            |(column, s): (&[f64], &f64)| s * column.iter().zip(step.iter()).map(|(g, t)| g * t).sum::<f64>();
        let n = step.len().max(1);
        let quadratic: f64 = self.gram.as_slice().chunks_exact(n).zip(step.iter()).map(own).sum();
        self.square - 2.0 * self.score.dot(step) + quadratic
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

    /// Log density where the square is `square`; squares below the tolerance are no better.
    pub fn log_density_at(&self, square: f64) -> f64 {
        student_log_density(square.max(self.misfit_tolerance), self.log_det, self.count)
    }

    /// The statistics of the first `count` parameters, the others fixed where the model stands.
    pub fn first_parameters(&self, count: usize) -> GroupStatistics {
        self.parameter_range(0, count)
    }

    /// The statistics of the parameters after the first `count`, which are fixed where the model stands.
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

    /// Log density with the slots known as `others` say.
    pub fn log_predictive_density(&self, others: &GlsEstimate) -> f64 {
        let density = |(square, log_det): (f64, f64)| {
            student_log_density(square.max(self.misfit_tolerance), log_det, self.count)
        };
        self.predictive_distance(others).map_or(f64::NEG_INFINITY, density)
    }

    /// Square of how far the part is from what `others` predict, under its predictive covariance, and that covariance's log
    /// determinant; `None` where it cannot be taken apart.
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

/// What some parts say of the slots together: generalised least squares, each part weighing as its scale lets it.
pub fn gls<'a>(
    told: impl Iterator<Item = &'a GroupStatistics> + Clone,
    prior: &FixedEffectsPrior,
) -> Option<GlsEstimate> {
    let q = prior.mean_offset.len();
    let mut step = DVector::zeros(q);
    let mut covariance = DMatrix::zeros(q, q);
    for _ in 0..4 {
        let mut gram = prior.precision.clone();
        let mut score = &prior.precision * &prior.mean_offset;
        for t in told.clone() {
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

    /// Two windows of a launch: six coordinates each, two slots, a push and a strength alike in both and a push of its own.
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
                log_det_noise: 0.3,
            }
        };
        Group { trial: 0, blocks: vec![block(1), block(2)], has_random_effects: true }
    }

    fn components_of_it() -> VarianceComponents {
        VarianceComponents { discrepancy: 1.3, impact: 0.01, scale: 0.25, accelerations: vec![0.7, 0.4] }
    }

    /// Of what starts from states seen whole a smaller square than is allowed predicts no better; of what was measured it does.
    #[test]
    fn less_than_is_allowed_tells_nothing() {
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
            let part = Group { has_random_effects: differs, ..part() };
            group_statistics(&[part], &components_of_it()).unwrap()[0].misfit_tolerance
        };
        assert_eq!([allowed(true), allowed(false)], [0.0, 12.0]);
    }

    /// The same Gaussian written down whole: (covariance, columns, what is left).
    fn whole(part: &Group, c: &VarianceComponents) -> (DMatrix<f64>, DMatrix<f64>, DVector<f64>) {
        let [a, b] = &part.blocks[..] else { unreachable!("two windows") };
        let rows = |f: &dyn Fn(&SegmentBlock) -> DMatrix<f64>| {
            let (x, y) = (f(a), f(b));
            DMatrix::from_fn(12, x.ncols(), |i, k| if i < 6 { x[(i, k)] } else { y[(i - 6, k)] })
        };
        let columns = rows(&|p| p.jacobian.clone());
        let left = rows(&|p| DMatrix::from_column_slice(6, 1, p.residual.as_slice())).column(0).into_owned();
        let alike = rows(&|p| p.z_group.clone());
        let alike = alike * DMatrix::from_diagonal(&DVector::from_vec(vec![c.accelerations[1], c.scale]));
        let mut all = &alike * alike.transpose();
        for (b, block) in part.blocks.iter().enumerate() {
            let own = &block.z_segment * c.accelerations[0];
            let diagonal =
                DMatrix::from_diagonal(&block.gp_variance.map(|s| 1.0 + c.discrepancy * c.discrepancy * s));
            let mut view = all.view_mut((6 * b, 6 * b), (6, 6));
            view += diagonal + &own * own.transpose();
        }
        (all, columns, left)
    }

    #[test]
    fn a_part_taken_apart_is_the_gaussian_written_down_whole() {
        let (part, c) = (part(), components_of_it());
        let told = group_statistics(std::slice::from_ref(&part), &c).unwrap().remove(0);
        let (covariance, columns, left) = whole(&part, &c);
        let inverse = covariance.clone().try_inverse().unwrap();
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{a} for {b}");
        close(told.square, left.dot(&(&inverse * &left)));
        close(told.log_det, covariance.determinant().ln() + 0.6);
        for k in 0..2 {
            close(told.score[k], columns.column(k).dot(&(&inverse * &left)));
            for l in 0..2 {
                close(told.gram[(k, l)], columns.column(k).dot(&(&inverse * columns.column(l))));
            }
        }
        // What others say of the slots is one more source of spread.
        let others = GlsEstimate {
            step: DVector::from_vec(vec![0.2, -0.4]),
            covariance: DMatrix::from_row_slice(2, 2, &[0.3, 0.1, 0.1, 0.2]),
        };
        let wide = &covariance + &columns * &others.covariance * columns.transpose();
        let off = &left - &columns * &others.step;
        let square = off.dot(&(wide.clone().try_inverse().unwrap() * &off));
        close(
            told.log_predictive_density(&others),
            student_log_density(square, wide.determinant().ln() + 0.6, 12.0),
        );
    }

    /// A launch a thousand times as far off as the others costs its logarithm, and moves what is told of the slots little.
    #[test]
    fn a_spoilt_launch_has_bounded_say() {
        let mut spoilt = part();
        spoilt.blocks.iter_mut().for_each(|b| b.residual *= 1000.0);
        let c = components_of_it();
        let prior = FixedEffectsPrior {
            precision: DMatrix::identity(2, 2),
            mean_offset: DVector::zeros(2),
            log_weight: 0.0,
        };
        let of = |parts: &[Group]| gls(group_statistics(parts, &c).unwrap().iter(), &prior).unwrap().step;
        let usual: Vec<Group> = vec![part(); 10];
        let all: Vec<Group> = usual.iter().cloned().chain([spoilt]).collect();
        assert!((of(&usual) - of(&all)).norm() < 0.2, "{} {}", of(&usual), of(&all));
    }
}
