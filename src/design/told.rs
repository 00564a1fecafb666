//! How likely what one world shows is in another.
//!
//! What worlds show differs along few directions beyond the noise: their principal components. In those, world j's density is Student's
//! about what it shows, with the camera's noise and what a trembling hand makes of it, widened to a kernel so that a world between
//! two draws is as likely as they are. Kernels are shrunk towards their group's mean by as much as they are widened, so that a group
//! as a whole is as wide as its draws (West 1993).
//!
//! Where a world is a point of its numbers (latents, effects' parameters), what can be told of them is what follows them smoothly: a
//! group's worlds are fitted by a smooth function of their numbers (`smooth`), and what that leaves, each world foretold from the others, is
//! noise as much as the camera's.
//!
//! Differences from the source: kernels' covariance is that within groups, the same for all of them, and their width Silverman's (1986,
//! equation 4.14). Of the density of what a world shows, that world is left out altogether: as a kernel, and from its group's mean and
//! the covariance; and there are no more directions than a group's draws can tell the shape of. Else groups that are alike would be told
//! apart by whose worlds they were shaped after.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};
use rand_distr::{Distribution, StandardNormal};

use super::shown::Shown;
use super::smooth;
use crate::error::{Error, Result};
use crate::estimate::sampler::log_sum_exp;
use crate::rng::Stream;

/// Most principal components, fewest, and draws of the smallest group for each.
const MOST: usize = 16;
const LEAST: usize = 2;
const DRAWS: usize = 5;
/// Share of the mean variance that is added to every direction, or a covariance could be none by rounding.
const RIDGE: f64 = 1e-9;
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

impl Alike<'_> {
    /// Directions of which so many worlds tell the shape.
    fn directions(&self) -> usize {
        let mut counts = vec![0; self.groups.iter().max().map_or(0, |g| g + 1)];
        self.groups.iter().for_each(|g| counts[*g] += 1);
        let fewest = counts.into_iter().filter(|c| *c > 0).min().unwrap_or(0);
        (fewest / DRAWS).clamp(LEAST, MOST)
    }
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
    pub fn new(shown: &Shown, alike: Alike, noise: f64, stream: &mut Stream) -> Seen {
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
        let basis = principal(&mean, alike.directions());
        let of = |j: usize| noise_of(&basis, &shown.spread[j], &trembled[j], &scale, noise);
        Seen { places: basis.tr_mul(&mean), seen: basis.tr_mul(&held), noises: (0..worlds).map(of).collect() }
    }

    /// Both experiments, done one after the other.
    pub fn and(&self, other: &Seen, alike: Alike) -> Seen {
        let below = |a: &DMatrix<f64>, b: &DMatrix<f64>| {
            let mut both = DMatrix::zeros(a.nrows() + b.nrows(), a.ncols());
            both.rows_mut(0, a.nrows()).copy_from(a);
            both.rows_mut(a.nrows(), b.nrows()).copy_from(b);
            both
        };
        let places = below(&self.places, &other.places);
        let basis = principal(&places, alike.directions());
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

    /// Densities between worlds; an error where they have none.
    pub fn told(&self, alike: Alike) -> Result<Told> {
        let worlds = self.places.ncols();
        let mut told = Told::nothing(worlds);
        if self.places.nrows() == 0 {
            return Ok(told);
        }
        let groups = Groups::new(&self.places, alike.groups);
        let follow = follow(&self.places, &self.noises, alike);
        for i in 0..worlds {
            let own = positive(&self.noises[i] + &follow.left[i])?;
            told.own[i] = log_density(&own, &(self.seen.column(i) - follow.foretold.column(i)));
        }
        // Kernels, or every group as one: whichever foretells worlds from the others of their group better.
        let (kernels, whole) = (self.components(&groups, false)?, self.components(&groups, true)?);
        told.components =
            if foretells(&kernels, &groups) > foretells(&whole, &groups) { kernels } else { whole };
        Ok(told)
    }

    /// (worlds, worlds): log density of what world i shows in the kernel of world j, or in its group as a whole; of the same world 0.
    fn components(&self, groups: &Groups, whole: bool) -> Result<DMatrix<f64>> {
        let (directions, worlds) = self.places.shape();
        let mut found = DMatrix::zeros(worlds, worlds);
        for i in 0..worlds {
            let within = groups.covariance_without(&self.places, i);
            for j in (0..worlds).filter(|j| *j != i) {
                let group = groups.of[j];
                let width = if whole { 1.0 } else { groups.width(group, directions) };
                let mean = groups.mean_without(&self.places, group, i);
                let place = &mean + (self.places.column(j) - &mean) * (1.0 - width * width).sqrt();
                let kernel = positive(&self.noises[j] + &within * (width * width))?;
                found[(i, j)] = log_density(&kernel, &(self.seen.column(i) - place));
            }
        }
        Ok(found)
    }
}

/// How likely what worlds show is, each told from the others of its group (likelihood cross-validation: Duin, IEEE Trans. Comput. 25
/// (1976) 1175).
fn foretells(components: &DMatrix<f64>, groups: &Groups) -> f64 {
    let of = |i: usize| {
        let others = (0..groups.of.len()).filter(|j| *j != i && groups.of[*j] == groups.of[i]);
        log_sum_exp(others.map(|j| components[(i, j)]).collect::<Vec<_>>())
    };
    (0..groups.of.len()).map(of).filter(|v| v.is_finite()).sum()
}

/// A covariance as its factor.
fn positive(mut covariance: DMatrix<f64>) -> Result<Cholesky<f64, Dyn>> {
    let ridge = RIDGE * covariance.trace() / covariance.nrows() as f64;
    (0..covariance.nrows()).for_each(|r| covariance[(r, r)] += ridge);
    let failed =
        || Error::Failed("what worlds show has no covariance: more noise, or a larger `perturb`".into());
    Cholesky::new(covariance).ok_or_else(failed)
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
fn principal(white: &DMatrix<f64>, most: usize) -> DMatrix<f64> {
    let degrees = (white.ncols() - 1).max(1) as f64;
    let eigen = SymmetricEigen::new(white.tr_mul(white));
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    order.retain(|k| eigen.eigenvalues[*k] / degrees > SLIGHT);
    order.truncate(most);
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

/// Groups of worlds by where they are and how they spread.
struct Groups<'a> {
    of: &'a [usize],
    counts: Vec<f64>,
    means: Vec<DVector<f64>>,
    /// Sum over worlds of the outer product of what parts each from its group's mean.
    scatter: DMatrix<f64>,
}

impl Groups<'_> {
    fn new<'a>(places: &DMatrix<f64>, of: &'a [usize]) -> Groups<'a> {
        let dimensions = places.nrows();
        let count = of.iter().max().map_or(0, |g| g + 1);
        let (mut counts, mut means) = (vec![0.0; count], vec![DVector::zeros(dimensions); count]);
        for (j, group) in of.iter().enumerate() {
            counts[*group] += 1.0;
            means[*group] += places.column(j);
        }
        means.iter_mut().zip(&counts).for_each(|(mean, n)| *mean /= f64::max(*n, 1.0));
        let scatter =
            of.iter().enumerate().fold(DMatrix::zeros(dimensions, dimensions), |sum, (j, group)| {
                let apart = places.column(j) - &means[*group];
                sum + &apart * apart.transpose()
            });
        Groups { of, counts, means, scatter }
    }

    /// Mean of a group without a world.
    fn mean_without(&self, places: &DMatrix<f64>, group: usize, i: usize) -> DVector<f64> {
        let n = self.counts[group];
        match self.of[i] == group && n > 1.0 {
            true => (&self.means[group] * n - places.column(i)) / (n - 1.0),
            false => self.means[group].clone(),
        }
    }

    /// Covariance within groups without a world.
    fn covariance_without(&self, places: &DMatrix<f64>, i: usize) -> DMatrix<f64> {
        let group = self.of[i];
        let n = self.counts[group];
        let apart = places.column(i) - &self.means[group];
        let share = if n > 1.0 { n / (n - 1.0) } else { 0.0 };
        let groups = self.counts.iter().filter(|c| **c > 0.0).count() as f64;
        let degrees = (self.of.len() as f64 - 1.0 - groups).max(1.0);
        (&self.scatter - &apart * apart.transpose() * share) / degrees
    }

    /// Width of a group's kernels, of the standard deviation within groups.
    fn width(&self, group: usize, dimensions: usize) -> f64 {
        let d = dimensions as f64;
        libm::pow(4.0 / (d + 2.0) / self.counts[group].max(1.0), 1.0 / (d + 4.0)).min(1.0)
    }
}

/// Where worlds' numbers say that they should be.
struct Follow {
    /// (directions, worlds): each foretold from the others of its group.
    foretold: DMatrix<f64>,
    /// By world, the covariance of what that leaves of the others of its group.
    left: Vec<DMatrix<f64>>,
}

fn follow(places: &DMatrix<f64>, noises: &[DMatrix<f64>], alike: Alike) -> Follow {
    let dimensions = places.nrows();
    let count = alike.groups.iter().max().map_or(0, |g| g + 1);
    let nothing = DMatrix::zeros(dimensions, dimensions);
    let mut found = Follow { foretold: places.clone(), left: vec![nothing.clone(); alike.groups.len()] };
    for group in 0..count {
        let own: Vec<usize> = (0..alike.groups.len()).filter(|j| alike.groups[*j] == group).collect();
        let numbers: Vec<&[f64]> = own.iter().map(|j| alike.numbers[*j].as_slice()).collect();
        let targets = DMatrix::from_fn(own.len(), dimensions, |i, r| places[(r, own[i])]);
        let noise: Vec<f64> = (0..dimensions)
            .map(|r| own.iter().map(|j| noises[*j][(r, r)]).sum::<f64>() / own.len().max(1) as f64)
            .collect();
        let apart = smooth::left_out(&numbers, &targets, &noise);
        let outer = |i: usize| apart.row(i).transpose() * apart.row(i);
        let all = (0..own.len()).fold(nothing.clone(), |sum, i| sum + outer(i));
        for (i, j) in own.iter().enumerate() {
            found.foretold.set_column(*j, &(places.column(*j) - apart.row(i).transpose()));
            found.left[*j] = (&all - outer(i)) / (own.len() as f64 - 1.0).max(1.0);
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
