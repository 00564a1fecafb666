//! Where draws begin: near a fit, with a share from the prior, so that nothing the prior allows is out of reach, and a share that is
//! near the fit but for one number: a long even stretch of one number (a floor rough enough to stick is as good as a rougher one)
//! would be missed otherwise, since a draw of all numbers from the prior hardly ever meets the others. Once points are known that are
//! likely, most of what is near is near them.

use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::moments;
use super::prior::Prior;
use crate::rng::Stream;
use crate::world::Sample;

/// A multivariate Student t.
#[derive(Clone, Debug)]
pub struct Student {
    centre: DVector<f64>,
    /// Lower Cholesky factor of the scale matrix.
    root: DMatrix<f64>,
    log_scale: f64,
}

/// A mixture of a wide Student t about a fit (or about several), the same with one number from the prior, and the prior.
#[derive(Clone, Debug)]
pub struct Reference {
    fits: Vec<Near>,
    prior: Prior,
}

/// What is near a fit.
#[derive(Clone, Debug)]
struct Near {
    /// Its share among all fits.
    share: f64,
    near: Student,
    /// By number: the others' density near the fit. Nothing where there is but one number.
    others: Vec<Student>,
}

/// Degrees of freedom: tails that no posterior's are wider than, as far as they matter.
const FREEDOM: f64 = 5.0;
/// Share of draws from the prior; and of those near the fit but for one number.
const ANYWHERE: f64 = 0.1;
const BUT_ONE: f64 = 0.2;
/// Share of a fit beside points that are likely: they may be of one hollow among several.
const BESIDE: f64 = 0.2;
/// Least scale along a direction, as a share of the prior's width: a fit may be surer than it has reason to.
const LEAST: f64 = 1e-9;

impl Student {
    /// About a centre with a covariance as its scale matrix; directions without any get next to none. `unit`: a width of each
    /// number by which small is told.
    pub fn new(centre: DVector<f64>, scale: &DMatrix<f64>, unit: &[f64]) -> Student {
        let d = centre.len();
        let mut own = 0.5 * (scale + scale.transpose());
        for (i, unit) in unit.iter().enumerate() {
            own[(i, i)] += (LEAST * unit).powi(2);
        }
        let diagonal = || DMatrix::from_diagonal(&own.diagonal().map(|v| v.max(f64::MIN_POSITIVE).sqrt()));
        let root = own.clone().cholesky().map_or_else(diagonal, |c| c.l());
        let log_scale = root.diagonal().iter().map(|v| libm::log(*v)).sum::<f64>();
        let pi = std::f64::consts::PI;
        let half = 0.5 * (FREEDOM + d as f64);
        let constant =
            libm::lgamma(half) - libm::lgamma(0.5 * FREEDOM) - 0.5 * d as f64 * libm::log(FREEDOM * pi);
        Student { centre, root, log_scale: constant - log_scale }
    }

    /// Lower factor of the scale matrix.
    pub fn root(&self) -> &DMatrix<f64> {
        &self.root
    }

    pub fn draw(&self, stream: &mut Stream) -> Sample {
        let z = DVector::from_fn(self.centre.len(), |_, _| StandardNormal.sample(stream));
        // Chi squared of five degrees, as a sum of squares.
        let squares: f64 = (0..FREEDOM as usize)
            .map(|_| {
                let z: f64 = StandardNormal.sample(stream);
                z * z
            })
            .sum();
        let x = &self.centre + &self.root * z * (FREEDOM / squares).sqrt();
        x.as_slice().to_vec()
    }

    pub fn log_density(&self, point: &[f64]) -> f64 {
        let off = DVector::from_fn(self.centre.len(), |i, _| point[i] - self.centre[i]);
        let Some(white) = self.root.solve_lower_triangular(&off) else { return f64::NEG_INFINITY };
        let half = 0.5 * (FREEDOM + self.centre.len() as f64);
        self.log_scale - half * libm::log1p(white.norm_squared() / FREEDOM)
    }
}

impl Reference {
    /// About a fit with a covariance, made `wider` times as wide; no direction is wider than what is believed of it.
    pub fn new(fit: &[f64], covariance: &DMatrix<f64>, wider: f64, prior: &Prior) -> Reference {
        let unit: Vec<f64> = prior.marginals().iter().map(|m| m.centre()[1]).collect();
        // Where the data say less than the prior, the prior decides: harmonic sums keep what is known jointly.
        let believed = DMatrix::from_diagonal(&DVector::from_fn(fit.len(), |i, _| unit[i].powi(-2)));
        let told = covariance.clone().try_inverse();
        let both = told.and_then(|told| (told + &believed).try_inverse());
        let scale = both.unwrap_or_else(|| {
            let own = |i: usize| (covariance[(i, i)].recip() + unit[i].powi(-2)).recip();
            DMatrix::from_diagonal(&DVector::from_fn(fit.len(), |i, _| own(i)))
        });
        let (centre, scale) = (DVector::from_column_slice(fit), scale * wider.powi(2));
        let near = Student::new(centre.clone(), &scale, &unit);
        // As it is drawn from, should its covariance have had to be made one.
        let scale = near.root() * near.root().transpose();
        let without = |i: usize| {
            let unit: Vec<f64> = unit.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, u)| *u).collect();
            let scale = scale.clone().remove_row(i).remove_column(i);
            Student::new(centre.clone().remove_row(i), &scale, &unit)
        };
        let others = if fit.len() > 1 { (0..fit.len()).map(without).collect() } else { Vec::new() };
        Reference { fits: vec![Near { share: 1.0, near, others }], prior: prior.clone() }
    }

    /// About points, as they stand to each other.
    pub fn about(points: &[Sample], wider: f64, prior: &Prior) -> Reference {
        let (mean, covariance) = moments(points, &vec![1.0 / points.len() as f64; points.len()]);
        Reference::new(mean.as_slice(), &covariance, wider, prior)
    }

    /// About the same fit, and mostly about points that are likely.
    pub fn beside(self, points: &[Sample], wider: f64) -> Reference {
        let about = Reference::about(points, wider, &self.prior);
        let shared = |fits: Vec<Near>, all: f64| {
            fits.into_iter().map(move |fit| Near { share: all * fit.share, ..fit })
        };
        let fits = shared(self.fits, BESIDE).chain(shared(about.fits, 1.0 - BESIDE)).collect();
        Reference { fits, ..about }
    }

    /// Share of draws about fits, and of those but for each number.
    fn shares(&self) -> [f64; 2] {
        let numbers = self.fits.first().map_or(0, |fit| fit.others.len());
        let but_one = if numbers == 0 { 0.0 } else { BUT_ONE };
        [1.0 - ANYWHERE - but_one, but_one / numbers.max(1) as f64]
    }

    pub fn draw(&self, stream: &mut Stream) -> Sample {
        let u: f64 = stream.random();
        if u < ANYWHERE {
            return self.prior.draw(stream);
        }
        let [near, but_one] = self.shares();
        let mut out = self.fit(stream).near.draw(stream);
        if u >= ANYWHERE + near {
            let number = (((u - ANYWHERE - near) / but_one) as usize).min(out.len() - 1);
            out[number] = self.prior.marginals()[number].quantile(stream.random());
        }
        out
    }

    /// One of the fits by their shares.
    fn fit(&self, stream: &mut Stream) -> &Near {
        let shares: Vec<f64> = self.fits.iter().map(|fit| libm::log(fit.share)).collect();
        &self.fits[super::one_of(&shares, stream).unwrap_or(0)]
    }

    pub fn log_density(&self, point: &[f64]) -> f64 {
        let [near, but_one] = self.shares();
        let over = |of: &dyn Fn(&Near) -> f64| {
            super::log_sum_exp(self.fits.iter().map(|fit| libm::log(fit.share) + of(fit)).collect::<Vec<_>>())
        };
        let mut all = vec![
            libm::log(near) + over(&|fit| fit.near.log_density(point)),
            libm::log(ANYWHERE) + self.prior.log_density(point),
        ];
        for i in 0..self.fits[0].others.len() {
            let rest: Sample = point.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, x)| *x).collect();
            let own = self.prior.log_density_of(i, point[i]);
            all.push(libm::log(but_one) + own + over(&|fit| fit.others[i].log_density(&rest)));
        }
        super::log_sum_exp(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sampler::Marginal;
    use crate::rng;

    /// What is drawn is drawn as its density says: the mean of one over the density is the area, where it is bounded; of numbers whose
    /// widths and priors differ, of one alone, and of a covariance that is none.
    #[test]
    fn a_density_is_of_its_draws() {
        let uniform = |low, high| Marginal::Uniform { low, high };
        let normal = Marginal::Normal { mean: 0.2, sd: 0.8, low: 0.0, high: 3.0 };
        let all = [uniform(-1.0, 2.0), normal, uniform(0.0, 4.0)];
        let tilted = [0.04, 0.03, 0.0, 0.03, 0.05, 0.02, 0.0, 0.02, 0.5];
        let none = [0.04, 0.3, 0.0, 0.3, 0.05, 0.02, 0.0, 0.02, 0.5];
        for (d, covariance) in [(3, tilted), (3, none), (1, tilted)] {
            let prior = Prior::new(all[..d].to_vec()).unwrap();
            let covariance = DMatrix::from_row_slice(3, 3, &covariance).view((0, 0), (d, d)).into_owned();
            let reference = Reference::new(&[0.5, 0.4, 3.0][..d], &covariance, 1.5, &prior);
            let wanted: f64 = all[..d].iter().map(|m| m.bounds()[1] - m.bounds()[0]).product();
            let near = [[0.3, 0.1, 1.0], [0.9, 0.3, 2.0], [0.6, 0.7, 1.5], [0.7, 0.2, 1.0]];
            let points = near.map(|p| p[..d].to_vec());
            for reference in [reference.clone(), reference.beside(&points, 1.5)] {
                let [area, within] = area(&reference, &prior);
                assert!((area / wanted - 1.0).abs() < 0.06, "{area} for an area of {wanted}");
                assert!(within > 0.7, "{within}");
            }
        }
    }

    /// The area within the prior's bounds by a reference's draws, and their share that lies there.
    fn area(reference: &Reference, prior: &Prior) -> [f64; 2] {
        let mut stream = rng::stream(9, "reference");
        let n = 40_000;
        let (mut within, mut area) = (0.0, 0.0);
        for _ in 0..n {
            let x = reference.draw(&mut stream);
            if prior.allows(&x) {
                within += 1.0;
                area += (-reference.log_density(&x)).exp();
            }
        }
        [area / n as f64, within / n as f64]
    }

    /// What the data say nothing of is as wide as it is believed to be.
    #[test]
    fn nothing_is_wider_than_believed() {
        let prior =
            Prior::new(vec![Marginal::Normal { mean: 1.0, sd: 0.5, low: 0.0, high: 9.0 }; 2]).unwrap();
        let covariance = DMatrix::from_row_slice(2, 2, &[1e8, 0.0, 0.0, 1e-6]);
        let reference = Reference::new(&[1.0, 1.0], &covariance, 1.0, &prior);
        let root = &reference.fits[0].near.root;
        assert!((root[(0, 0)] - 0.5).abs() < 1e-3 && (root[(1, 1)] - 1e-3).abs() < 1e-5, "{root}");
    }
}
