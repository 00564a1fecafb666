//! Does what a model leaves still act in the same way in trial after trial?
//!
//! Every way in which something could be added to a fitted model is a direction in the residuals: an effect of the
//! library at one of its starts, or a field of pushes over place, velocity or time that no library holds. A direction's
//! score in a trial is its product with the residual, made orthogonal to what the fit could take up itself (Neyman's
//! orthogonal score). If nothing of the kind acts, a trial's scores are as likely with either sign, whatever the noise
//! within the trial is: correlated, rounded, of any size. So the trials' signs are drawn anew many times, and the
//! largest standardised score of all directions is compared with what those draws give. That answers for all directions
//! at once (Westfall and Young 1993) and takes nothing for granted but that trials are independent.
//!
//! Sources: score tests with signs drawn by cluster (Liu 1988; Cameron, Gelbach and Miller, Rev. Econ. Stat. 90 (2008)
//! 414; Hagemann, J. Econometrics 2017); the cube root that makes quadratic forms nearly normal (Wilson and Hilferty,
//! PNAS 17 (1931) 684).
//!
//! Differences from the sources: below [`FEW`] trials signs are drawn for x and y apart, which takes their noise for
//! independent; otherwise so few draws differ that nothing could be found.

use nalgebra::{DMatrix, DVector};
use rand::RngExt;

use super::judge::Fitted;
use super::model::{self, Data, Extra};
use super::stats::{f_above, inverse, median, solve};
use super::window::Kind;
use crate::error::Result;
use crate::rng;

/// Draws of signs: p is known to 0.001.
const DRAWS: usize = 999;
/// Trials below which the signs of x and y are drawn apart.
const FEW: usize = 10;
/// Most settings for which a direction is split.
const SPLIT: usize = 4;
/// How much clearer a group must be by Hotelling's test, which has fewer trials' signs to go by and takes more for
/// granted.
const STRICTER: f64 = 5.0;
/// Share of a direction's information that must be beyond what the model takes up itself.
const NEW: f64 = 1e-5;

/// A way of adding: directions that go together.
pub struct Group {
    pub extras: Vec<Extra>,
    /// Whether every setting has its own.
    pub per_setting: bool,
}

/// What the residuals say of a group.
pub struct Told {
    /// Squares (units of the noise) that adding it would take away.
    pub drop: f64,
    /// The same, less what chance alone takes.
    pub sure: f64,
    /// Estimated size along each direction; the mean of settings.
    pub sizes: Vec<f64>,
    /// p of this group alone, by its draws.
    pub p: f64,
    /// The same by Hotelling's test of the trials' scores, which takes their means for nearly normal.
    pub normal_p: f64,
}

/// What the residuals say.
pub struct Tested {
    /// p of nothing being left, all groups and fields together: by signs, or by Hotelling's test of the clearest group at
    /// [`STRICTER`] times its level.
    pub p: f64,
    /// By group.
    pub groups: Vec<Told>,
    /// By field.
    pub fields: Vec<Told>,
}

/// A group's or a field's scores, by cluster, such that their sum's square is the statistic.
struct Scored {
    /// (clusters, directions)
    rows: DMatrix<f64>,
    /// How much noise a cluster's row is expected to hold; empty for fields.
    shares: Vec<f64>,
    /// Effective number of directions.
    freedom: f64,
    sizes: Vec<f64>,
}

/// Tests groups, and fields if asked to.
pub fn test(data: &Data, fit: &Fitted, groups: Vec<Group>, fields: bool, seed: u64) -> Result<Tested> {
    let mut spans = Vec::with_capacity(groups.len());
    let mut extras = Vec::new();
    for group in groups {
        spans.push((extras.len(), group.extras.len(), group.per_setting));
        extras.extend(group.extras);
    }
    let looks = model::looks(data, &fit.layout, &fit.state, &extras)?;
    let q = fit.layout.slots.len();
    let apart = data.trials < FEW;
    let clusters = if apart { 2 * data.trials } else { data.trials };
    let cluster = |w: usize, row: usize| {
        let trial = data.windows[w].trial;
        if apart { 2 * trial + row % 2 } else { trial }
    };
    let mut own = DMatrix::zeros(q, q);
    let mut own_scores = DMatrix::zeros(clusters, q);
    for (w, look) in looks.iter().enumerate() {
        let j = look.columns.columns(0, q);
        own += j.tr_mul(&j);
        for row in 0..look.residual.len() {
            for k in 0..q {
                own_scores[(cluster(w, row), k)] += j[(row, k)] * look.residual[row];
            }
        }
    }
    for (k, slot) in fit.layout.slots.iter().enumerate() {
        own[(k, k)] += slot.ridge();
    }
    let own_inverse = inverse(&own);
    // Scores and information of columns given by window, made orthogonal to the fit's own.
    let orthogonal = |columns: &dyn Fn(usize) -> DMatrix<f64>, count: usize, by_cluster: bool| {
        let mut scores = DMatrix::zeros(clusters, count);
        let mut shares = vec![DMatrix::zeros(count, count); if by_cluster { clusters } else { 0 }];
        let (mut gram, mut cross) = (DMatrix::zeros(count, count), DMatrix::zeros(q, count));
        for (w, look) in looks.iter().enumerate() {
            let c = columns(w);
            if c.nrows() == 0 {
                continue;
            }
            gram += c.tr_mul(&c);
            cross += look.columns.columns(0, q).tr_mul(&c);
            for row in 0..look.residual.len() {
                let r = look.residual[row];
                let to = cluster(w, row);
                if by_cluster {
                    for (i, j) in (0..count).flat_map(|i| (0..count).map(move |j| (i, j))) {
                        shares[to][(i, j)] += c[(row, i)] * c[(row, j)];
                    }
                }
                if r != 0.0 {
                    for k in 0..count {
                        scores[(to, k)] += c[(row, k)] * r;
                    }
                }
            }
        }
        let taken = &own_inverse * &cross;
        scores -= &own_scores * &taken;
        let all = gram.diagonal();
        gram -= cross.tr_mul(&taken);
        (scores, gram, all, shares)
    };
    let settings = data.setting_count();
    let mut scored = Vec::new();
    for (first, count, per_setting) in spans {
        let parts = if per_setting && settings <= SPLIT { settings } else { 1 };
        let columns = |w: usize| {
            let from = looks[w].columns.columns(q + first, count);
            if parts == 1 {
                return from.into_owned();
            }
            let mut out = DMatrix::zeros(from.nrows(), count * parts);
            out.columns_mut(data.windows[w].setting * count, count).copy_from(&from);
            out
        };
        let (scores, gram, all, shares) = orthogonal(&columns, count * parts, true);
        scored.push(fisher(scores, gram, &all, &shares, count));
    }
    let count = scored.len();
    if fields {
        let paths = model::paths(data, &fit.layout, &fit.state)?;
        for field in fields_over(data, &paths) {
            let columns = |w: usize| {
                let (look, window) = (&looks[w], &data.windows[w]);
                if !matches!(window.kind, Kind::Flight | Kind::Roll) {
                    return DMatrix::zeros(0, field.features());
                }
                let own = field.responses(window, &paths[w]);
                let mut c = own.resize_vertically(look.residual.len(), 0.0);
                for row in 0..c.nrows() {
                    c.row_mut(row).scale_mut(look.weights[row / 2]);
                }
                let by = &look.project * &c;
                c - &look.start * by
            };
            let (scores, gram, ..) = orthogonal(&columns, field.features(), false);
            scored.push(shrunk(scores, gram));
        }
    }
    let mut told = judge(scored, clusters, seed);
    let fields = told.1.split_off(count);
    Ok(Tested { p: told.0, groups: told.1, fields })
}

/// Rao's score statistic.
fn fisher(
    scores: DMatrix<f64>,
    gram: DMatrix<f64>,
    all: &DVector<f64>,
    by_cluster: &[DMatrix<f64>],
    count: usize,
) -> Scored {
    let n = gram.nrows();
    let fresh: Vec<usize> =
        (0..n).filter(|k| gram[(*k, *k)] > NEW * all[*k] && gram[(*k, *k)] > 1e-12).collect();
    let m = DMatrix::from_fn(fresh.len(), fresh.len(), |i, j| gram[(fresh[i], fresh[j])]);
    let s = DMatrix::from_fn(scores.nrows(), fresh.len(), |i, j| scores[(i, fresh[j])]);
    let total = DVector::from_fn(fresh.len(), |j, _| s.column(j).sum());
    let steps = solve(&m, &total);
    let mut sizes = vec![0.0; count];
    let parts = (n / count.max(1)).max(1) as f64;
    for (k, step) in fresh.iter().zip(steps.iter()) {
        sizes[k % count] += step / parts;
    }
    let (rows, freedom) = half(&s, &m, 0.0);
    let information = inverse(&m);
    let share = |own: &DMatrix<f64>| {
        let own = DMatrix::from_fn(fresh.len(), fresh.len(), |i, j| own[(fresh[i], fresh[j])]);
        (&information * own).trace() / fresh.len().max(1) as f64
    };
    Scored { rows, shares: by_cluster.iter().map(share).collect(), freedom, sizes }
}

/// The statistic of a random field: what the data tell well counts, what they hardly tell is held back.
fn shrunk(scores: DMatrix<f64>, gram: DMatrix<f64>) -> Scored {
    let ridge = 0.3 * gram.trace() / gram.nrows().max(1) as f64;
    let (rows, freedom) = half(&scores, &gram, ridge);
    Scored { rows, shares: Vec::new(), freedom, sizes: Vec::new() }
}

/// Scores times (gram + ridge)^(-1/2), and the effective number of directions.
fn half(scores: &DMatrix<f64>, gram: &DMatrix<f64>, ridge: f64) -> (DMatrix<f64>, f64) {
    let n = gram.nrows();
    if n == 0 || !gram.iter().chain(scores.iter()).all(|v| v.is_finite()) {
        return (DMatrix::zeros(scores.nrows(), 0), 0.0);
    }
    let eigen = gram.clone().symmetric_eigen();
    let most = eigen.eigenvalues.max();
    let mut rows = scores * &eigen.eigenvectors;
    let (mut one, mut two) = (0.0, 0.0);
    for (k, value) in eigen.eigenvalues.iter().enumerate() {
        let by = if *value > 1e-9 * most { 1.0 / (value + ridge) } else { 0.0 };
        rows.column_mut(k).scale_mut(by.sqrt());
        let share = by * value.max(0.0);
        one += share;
        two += share * share;
    }
    (rows, if two > 0.0 { one * one / two } else { 0.0 })
}

/// Compares with draws of signs: p of all, and each alone.
fn judge(scored: Vec<Scored>, clusters: usize, seed: u64) -> (f64, Vec<Told>) {
    let mut stream = rng::stream(seed, "signs");
    let draws: Vec<Vec<f64>> = (0..DRAWS)
        .map(|_| (0..clusters).map(|_| if stream.random::<bool>() { 1.0 } else { -1.0 }).collect())
        .collect();
    let mut most_drawn = vec![f64::NEG_INFINITY; DRAWS];
    let mut most = f64::NEG_INFINITY;
    let (mut clearest, mut number) = (1.0f64, 0.0);
    let mut told = Vec::new();
    for s in scored {
        let (drop, chance) = (s.rows.row_sum().norm_squared(), s.rows.norm_squared());
        if s.freedom == 0.0 || chance <= 0.0 {
            told.push(Told { drop: 0.0, sure: 0.0, sizes: s.sizes, p: 1.0, normal_p: 1.0 });
            continue;
        }
        let rows = evened(s.rows, &s.shares);
        let normal_p = if s.shares.is_empty() { 1.0 } else { hotelling(&rows) };
        clearest = clearest.min(normal_p);
        number += f64::from(u8::from(!s.shares.is_empty()));
        let rows = bounded(rows);
        let expected = rows.norm_squared();
        let spread = 2.0 / (9.0 * s.freedom);
        let height = |square: f64| ((square / expected).cbrt() - (1.0 - spread)) / spread.sqrt();
        let n = rows.ncols();
        // By cluster, so that a draw runs along memory.
        let flat: Vec<f64> =
            (0..clusters).flat_map(|c| (0..n).map(move |k| (c, k))).map(|i| rows[i]).collect();
        let mut sum = vec![0.0; n];
        let mut square = |signs: Option<&Vec<f64>>| {
            sum.fill(0.0);
            for (c, row) in flat.chunks_exact(n).enumerate() {
                let sign = signs.map_or(1.0, |s| s[c]);
                sum.iter_mut().zip(row).for_each(|(t, v)| *t += sign * v);
            }
            sum.iter().map(|v| v * v).sum::<f64>()
        };
        let here = height(square(None));
        most = most.max(here);
        let mut above = 0;
        for (draw, most) in draws.iter().zip(&mut most_drawn) {
            let there = height(square(Some(draw)));
            *most = most.max(there);
            above += usize::from(there >= here - 1e-9);
        }
        let p = (1 + above) as f64 / (1 + DRAWS) as f64;
        told.push(Told { drop, sure: drop - chance, sizes: s.sizes, p, normal_p });
    }
    let above = most_drawn.iter().filter(|m| **m >= most - 1e-9).count();
    let by_signs = if most.is_finite() { (1 + above) as f64 / (1 + DRAWS) as f64 } else { 1.0 };
    (by_signs.min(STRICTER * number * clearest), told)
}

/// Rows of clusters that say much and of those that say little, brought to the same noise.
fn evened(mut rows: DMatrix<f64>, shares: &[f64]) -> DMatrix<f64> {
    let most = shares.iter().copied().fold(0.0, f64::max);
    for (k, share) in shares.iter().enumerate() {
        // What says next to nothing has no noise to be brought to.
        rows.row_mut(k).scale_mut(if *share > 1e-4 * most { 1.0 / share.sqrt() } else { 0.0 });
    }
    rows
}

/// p of the rows' mean being nothing.
fn hotelling(rows: &DMatrix<f64>) -> f64 {
    let told: Vec<usize> = (0..rows.nrows()).filter(|k| rows.row(*k).norm_squared() > 0.0).collect();
    let (n, p) = (told.len() as f64, rows.ncols() as f64);
    if n < p + 3.0 {
        return 1.0;
    }
    let mean = DVector::from_fn(rows.ncols(), |j, _| told.iter().map(|k| rows[(*k, j)]).sum::<f64>() / n);
    let mut spread = DMatrix::zeros(rows.ncols(), rows.ncols());
    for k in &told {
        let off = DVector::from_fn(rows.ncols(), |j, _| rows[(*k, j)] - mean[j]);
        spread += &off * off.transpose();
    }
    spread /= n - 1.0;
    let square = n * mean.dot(&(inverse(&spread) * &mean));
    f_above(square * (n - p) / (p * (n - 1.0)), p, n - p)
}

/// No trial says more than the usual one: where an effect is strong a few trials hold most of it, and their signs alone
/// would decide the draws. Odd in the scores, so that draws of signs stay as good as before.
fn bounded(mut rows: DMatrix<f64>) -> DMatrix<f64> {
    let sizes: Vec<f64> = rows.row_iter().map(|r| r.norm()).collect();
    let usual = median(&sizes.iter().copied().filter(|s| *s > 0.0).collect::<Vec<_>>());
    for (k, size) in sizes.iter().enumerate().filter(|(_, s)| **s > usual) {
        rows.row_mut(k).scale_mut(usual / size);
    }
    rows
}

/// Pushes, each along x and along y, that are bumps over some of (t, x, y, vx, vy).
struct Field {
    /// Which coordinates the bumps are over.
    over: Vec<usize>,
    /// Centres, and the bumps' widths by coordinate.
    centres: Vec<Vec<f64>>,
    widths: Vec<f64>,
}

/// Coordinates, and bumps along each: coarse, and as fine as a path's wiggles could be told from its start.
const FIELDS: [(&[usize], &[usize]); 5] =
    [(&[1, 2], &[4, 3]), (&[1, 2], &[10, 3]), (&[3, 4], &[4, 3]), (&[0], &[6]), (&[0], &[14])];

fn fields_over(data: &Data, paths: &[Vec<[f64; 4]>]) -> Vec<Field> {
    let mut values: [Vec<f64>; 5] = Default::default();
    for (window, path) in data.windows.iter().zip(paths) {
        if !matches!(window.kind, Kind::Flight | Kind::Roll) {
            continue;
        }
        for (point, s) in window.points.iter().zip(path).filter(|(_, s)| s.iter().all(|v| v.is_finite())) {
            values[0].push(window.start + point.time);
            (0..4).for_each(|k| values[k + 1].push(s[k]));
        }
    }
    if values[0].is_empty() {
        return Vec::new();
    }
    values.iter_mut().for_each(|v| v.sort_by(f64::total_cmp));
    let at = |k: usize, share: f64| values[k][(share * (values[k].len() - 1) as f64) as usize];
    let field = |(over, counts): &(&[usize], &[usize])| {
        let mut centres: Vec<Vec<f64>> = vec![Vec::new()];
        let mut widths = Vec::new();
        for (k, count) in over.iter().zip(*counts) {
            let (low, high) = (at(*k, 0.02), at(*k, 0.98));
            let gap = (high - low).max(1e-9) / (*count - 1).max(1) as f64;
            widths.push(gap);
            centres = centres
                .iter()
                .flat_map(|c| {
                    (0..*count).map(move |i| {
                        let mut c = c.clone();
                        c.push(low + gap * i as f64);
                        c
                    })
                })
                .collect();
        }
        Field { over: over.to_vec(), centres, widths }
    };
    FIELDS.iter().map(field).collect()
}

impl Field {
    fn features(&self) -> usize {
        2 * self.centres.len()
    }

    /// Positions that the bumps' pushes would lead to along a path, by twofold integration: (two rows a point, features).
    fn responses(&self, window: &super::window::Window, path: &[[f64; 4]]) -> DMatrix<f64> {
        let n = path.len();
        let mut out = DMatrix::zeros(2 * n, self.features());
        let push = |i: usize, centre: &[f64]| {
            let all = [window.start + window.points[i].time, path[i][0], path[i][1], path[i][2], path[i][3]];
            let mut off = 0.0;
            for ((k, c), w) in self.over.iter().zip(centre).zip(&self.widths) {
                off += ((all[*k] - c) / w).powi(2);
            }
            if off < 25.0 { libm::exp(-0.5 * off) } else { 0.0 }
        };
        for (f, centre) in self.centres.iter().enumerate() {
            let (mut speed, mut place, mut last) = (0.0, 0.0, push(0, centre));
            for i in 1..n {
                let dt = window.points[i].time - window.points[i - 1].time;
                let here = push(i, centre);
                // Linear between observations.
                place += speed * dt + dt * dt * (last / 3.0 + here / 6.0);
                speed += 0.5 * dt * (last + here);
                last = here;
                out[(2 * i, 2 * f)] = place;
                out[(2 * i + 1, 2 * f + 1)] = place;
            }
        }
        out
    }
}
