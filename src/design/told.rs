//! How likely what one world shows is in another.
//!
//! What worlds show differs along few directions beyond the noise: their principal components. In those, world j's density is normal
//! about what it shows, with the camera's noise and what a trembling hand makes of it, widened to a kernel so that a world between
//! two draws is as likely as they are. Kernels are shrunk towards their group's mean by as much as they are widened, so that a group
//! as a whole is as wide as its draws (West 1993).
//!
//! Where a world is a point of its numbers (latents, effects' parameters), what can be told of them is what follows them smoothly: a
//! group's worlds are fitted by a smooth function of their numbers (`smooth`), and what that leaves, each world foretold from the others, is
//! noise as much as the camera's.
//!
//! Differences from the source: kernels' covariance is the group's in all principal components, and its width Silverman's
//! (1986, equation 4.14) for as many dimensions. Densities are Student's, so that one world that went another way does not decide.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};
use rand_distr::{Distribution, StandardNormal};

use super::shown::Shown;
use super::smooth;
use crate::rng::Stream;

/// Most principal components.
const MOST: usize = 16;
/// Variance of a component, as a share of the noise's, below which it tells nothing.
const SLIGHT: f64 = 0.02;
/// Degrees of freedom of densities.
const FREEDOM: f64 = 8.0;

/// What a candidate shows of worlds in the directions along which they differ, in units of the noise.
#[derive(Clone, Debug)]
pub struct Seen {
    /// (directions, worlds): mean over copies.
    places: DMatrix<f64>,
    /// (directions, worlds): a copy that had no say in it, as the camera sees it.
    seen: DMatrix<f64>,
    /// By world, the covariance of what camera and hand do.
    noises: Vec<DMatrix<f64>>,
}

/// Log densities between worlds.
#[derive(Clone, Debug)]
pub struct Told {
    /// (worlds, worlds): of what world i shows, in the kernel of world j.
    components: DMatrix<f64>,
    /// Of what world i shows, where its numbers say that it should be.
    own: Vec<f64>,
}

/// Worlds that are alike but for their numbers.
#[derive(Clone, Copy)]
pub struct Alike<'a> {
    /// By world, the number of its group.
    pub groups: &'a [usize],
    /// By world, its numbers; as many in every world of a group.
    pub numbers: &'a [Vec<f64>],
}

impl Told {
    fn nothing(worlds: usize) -> Told {
        Told { components: DMatrix::zeros(worlds, worlds), own: vec![0.0; worlds] }
    }

    pub fn worlds(&self) -> usize {
        self.own.len()
    }

    /// Log density of what world `i` shows, in the kernel of world `j`.
    pub fn component(&self, i: usize, j: usize) -> f64 {
        self.components[(i, j)]
    }

    /// Log density of what world `i` shows, where its numbers say that it should be.
    pub fn own(&self, i: usize) -> f64 {
        self.own[i]
    }
}

impl Seen {
    /// Of what is shown; `noise`: of a coordinate, m.
    pub fn new(shown: &Shown, noise: f64, stream: &mut Stream) -> Seen {
        let (n, worlds) = shown.mean.shape();
        let trembled: Vec<DVector<f64>> = shown.spread.iter().map(variances).collect();
        let scale = scales(&trembled, noise, n);
        let centre = shown.mean.column_mean();
        let white = |m: &DMatrix<f64>| DMatrix::from_fn(n, worlds, |t, j| (m[(t, j)] - centre[t]) / scale[t]);
        let mean = white(&shown.mean);
        let mut held = white(&shown.held);
        for mut column in held.column_iter_mut() {
            for (t, value) in column.iter_mut().enumerate() {
                let sample: f64 = StandardNormal.sample(stream);
                *value += sample * noise / scale[t];
            }
        }
        let basis = principal(&mean);
        let of = |j: usize| noise_of(&basis, &shown.spread[j], &trembled[j], &scale, noise);
        Seen { places: basis.tr_mul(&mean), seen: basis.tr_mul(&held), noises: (0..worlds).map(of).collect() }
    }

    /// Both experiments, done one after the other.
    pub fn and(&self, other: &Seen) -> Seen {
        let below = |a: &DMatrix<f64>, b: &DMatrix<f64>| {
            let mut both = DMatrix::zeros(a.nrows() + b.nrows(), a.ncols());
            both.rows_mut(0, a.nrows()).copy_from(a);
            both.rows_mut(a.nrows(), b.nrows()).copy_from(b);
            both
        };
        let places = below(&self.places, &other.places);
        let basis = principal(&places);
        let of = |(a, b): (&DMatrix<f64>, &DMatrix<f64>)| {
            let n = a.nrows();
            let (first, second) = (basis.rows(0, n), basis.rows(n, b.nrows()));
            first.tr_mul(&(a * first)) + second.tr_mul(&(b * second))
        };
        Seen {
            seen: basis.tr_mul(&below(&self.seen, &other.seen)),
            noises: self.noises.iter().zip(&other.noises).map(of).collect(),
            places: basis.tr_mul(&places),
        }
    }

    /// What each world shows, seen once, (directions, worlds).
    pub fn once(&self) -> &DMatrix<f64> {
        &self.seen
    }

    /// Densities between worlds.
    pub fn told(&self, alike: Alike) -> Told {
        let worlds = self.places.ncols();
        let mut told = Told::nothing(worlds);
        if self.places.nrows() == 0 {
            return told;
        }
        let kernels = kernels(&self.places, alike.groups);
        let follow = follow(&self.places, &self.noises, alike);
        for j in 0..worlds {
            let group = alike.groups[j];
            let Kernel { shrunk, mean, covariance } = &kernels[group];
            let place = mean + (self.places.column(j) - mean) * *shrunk;
            let (Some(own), Some(kernel)) = (
                Cholesky::new(&self.noises[j] + &follow.left[group]),
                Cholesky::new(&self.noises[j] + covariance),
            ) else {
                return Told::nothing(worlds);
            };
            told.own[j] = log_density(&own, &(self.seen.column(j) - follow.foretold.column(j)));
            for i in 0..worlds {
                told.components[(i, j)] = log_density(&kernel, &(self.seen.column(i) - &place));
            }
        }
        told
    }
}

/// By coordinate, the variance over copies, m^2.
fn variances(spread: &DMatrix<f64>) -> DVector<f64> {
    DVector::from_iterator(spread.nrows(), spread.row_iter().map(|r| r.norm_squared()))
}

/// By coordinate, the deviation that is to be expected of it: noise, and the median of what hands make of it, m.
fn scales(trembled: &[DVector<f64>], noise: f64, n: usize) -> Vec<f64> {
    let of = |t: usize| {
        let mut all: Vec<f64> = trembled.iter().map(|v| v[t]).collect();
        all.sort_by(f64::total_cmp);
        (noise * noise + all[all.len() / 2]).sqrt()
    };
    (0..n).map(of).collect()
}

/// Directions along which worlds differ by more than the noise, (n, directions).
fn principal(white: &DMatrix<f64>) -> DMatrix<f64> {
    let degrees = (white.ncols() - 1).max(1) as f64;
    let eigen = SymmetricEigen::new(white.tr_mul(white));
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    order.retain(|k| eigen.eigenvalues[*k] / degrees > SLIGHT);
    order.truncate(MOST);
    let columns: Vec<DVector<f64>> =
        order.iter().map(|k| white * eigen.eigenvectors.column(*k) / eigen.eigenvalues[*k].sqrt()).collect();
    if columns.is_empty() { DMatrix::zeros(white.nrows(), 0) } else { DMatrix::from_columns(&columns) }
}

/// Covariance in principal components of what is seen of a world: camera and hand.
///
/// What copies differ by counts twice, once as far as they differ together and once coordinate by coordinate: so few copies do not
/// know all directions in which a hand may tremble.
fn noise_of(
    basis: &DMatrix<f64>,
    spread: &DMatrix<f64>,
    trembled: &DVector<f64>,
    scale: &[f64],
    noise: f64,
) -> DMatrix<f64> {
    let alone = DMatrix::from_fn(basis.nrows(), basis.ncols(), |t, r| {
        basis[(t, r)] * (noise * noise + trembled[t]).sqrt() / scale[t]
    });
    let white = DMatrix::from_fn(spread.nrows(), spread.ncols(), |t, k| spread[(t, k)] / scale[t]);
    let together = basis.tr_mul(&white);
    alone.tr_mul(&alone) + &together * together.transpose()
}

/// What the draws of a group are widened by.
struct Kernel {
    /// How far draws stay from the group's mean, in [0, 1].
    shrunk: f64,
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

fn kernels(places: &DMatrix<f64>, groups: &[usize]) -> Vec<Kernel> {
    let dimensions = places.nrows();
    let count = groups.iter().max().map_or(0, |g| g + 1);
    let of = |group: usize| {
        let own: Vec<DVector<f64>> = (0..places.ncols())
            .filter(|j| groups[*j] == group)
            .map(|j| places.column(j).into_owned())
            .collect();
        let n = own.len().max(1) as f64;
        let mean = own.iter().fold(DVector::zeros(dimensions), |sum, p| sum + p) / n;
        let scatter = own.iter().fold(DMatrix::zeros(dimensions, dimensions), |sum, p| {
            let apart = p - &mean;
            sum + &apart * apart.transpose()
        });
        let d = dimensions as f64;
        let width = libm::pow(4.0 / (d + 2.0) / n, 1.0 / (d + 4.0)).min(1.0);
        let covariance = scatter * (width * width / (n - 1.0).max(1.0));
        Kernel { shrunk: (1.0 - width * width).sqrt(), mean, covariance }
    };
    (0..count).map(of).collect()
}

/// Where worlds' numbers say that they should be.
struct Follow {
    /// (components, worlds): each foretold from the others of its group.
    foretold: DMatrix<f64>,
    /// By group, the covariance of what that leaves.
    left: Vec<DMatrix<f64>>,
}

fn follow(places: &DMatrix<f64>, noises: &[DMatrix<f64>], alike: Alike) -> Follow {
    let dimensions = places.nrows();
    let count = alike.groups.iter().max().map_or(0, |g| g + 1);
    let mut found =
        Follow { foretold: places.clone(), left: vec![DMatrix::zeros(dimensions, dimensions); count] };
    for group in 0..count {
        let own: Vec<usize> = (0..alike.groups.len()).filter(|j| alike.groups[*j] == group).collect();
        let numbers: Vec<&[f64]> = own.iter().map(|j| alike.numbers[*j].as_slice()).collect();
        let targets = DMatrix::from_fn(own.len(), dimensions, |i, r| places[(r, own[i])]);
        let noise: Vec<f64> = (0..dimensions)
            .map(|r| own.iter().map(|j| noises[*j][(r, r)]).sum::<f64>() / own.len().max(1) as f64)
            .collect();
        let apart = smooth::left_out(&numbers, &targets, &noise);
        for (i, j) in own.iter().enumerate() {
            let apart = apart.row(i).transpose();
            found.foretold.set_column(*j, &(places.column(*j) - &apart));
            found.left[group] += &apart * apart.transpose() / own.len() as f64;
        }
    }
    found
}

/// Student's density with [`FREEDOM`] degrees, without what is the same for every covariance.
fn log_density(covariance: &Cholesky<f64, Dyn>, apart: &DVector<f64>) -> f64 {
    let l = covariance.l_dirty();
    let log_det: f64 = l.diagonal().iter().map(|v| libm::log(*v)).sum();
    let white = l.solve_lower_triangular(apart).map_or(f64::INFINITY, |w| w.norm_squared());
    -log_det - 0.5 * (FREEDOM + apart.len() as f64) * libm::log1p(white / FREEDOM)
}
