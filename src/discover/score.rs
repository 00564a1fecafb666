//! One number for every model: the log predictive density of each launch, told from the others.
//!
//! A launch is Gaussian with the covariance that `launch` describes, given a scale of its own; the scale integrated out, it
//! is a multivariate Student t. Sizes come from the other launches by generalised least squares under weak priors, with
//! their uncertainty integrated out; components (how large the slow misfit is, how far sizes differ) by marginal likelihood.
//! A launch may be spoilt: then it is the base model's, whatever the candidate says.
//!
//! Sources: mixed-effects models (Pinheiro and Bates, Mixed-Effects Models in S and S-PLUS, 2000), predictive densities of
//! held-out groups (Vehtari, Gelman and Gabry, Stat. Comput. 27 (2017) 1413).

use nalgebra::{DMatrix, DVector};

use super::launch::{Block, Own, Part, pushes};

/// Degrees of freedom of a launch's scale: one launch in a hundred is three times as wide as the usual one.
pub const FREEDOM: f64 = 4.0;
/// Probability that a launch is no launch of the model's law.
pub const SPOILT: f64 = 0.05;
/// Fewest and most folds: each leaves out a share of the launches.
const FOLDS: usize = 10;
/// Steps of the components' logarithms: of a first search, and about what is nearly right.
pub const WIDE: [f64; 3] = [1.4, 0.5, 0.2];
pub const NEAR: [f64; 1] = [0.4];
/// Priors of the components' logarithms: centre, standard deviation. Slow misfit of the size of the noise; pushes by launch of
/// a third of what effects declare; contacts that err by a hundredth of the speed of approach.
const SLOW: [f64; 2] = [0.0, 2.0];
const PUSH: [f64; 2] = [-1.2, 1.2];
const LEAP: [f64; 2] = [-4.6, 1.0];
/// The same of a size's spread, its centre as a share of what is plausible.
const SPREAD: [f64; 2] = [0.05, 1.5];

/// Variance components: standard deviations.
#[derive(Clone, Debug)]
pub struct Components {
    /// Of the slow misfit, in units of the noise.
    pub slow: f64,
    /// Of pushes by launch, in what effects declare.
    pub push: Vec<f64>,
    /// Of a contact's leaps, in the speed of approach.
    pub leap: f64,
    /// Of each slot's value from launch to launch; 0 for those that do not differ.
    pub spread: Vec<f64>,
}

/// What is believed of the slots before anything is seen.
#[derive(Clone, Debug)]
pub struct Prior {
    /// Precision of the slots, and how far their centres are from where the model stands.
    pub precision: DMatrix<f64>,
    pub off: DVector<f64>,
    /// What is plausible of each slot that may differ from launch to launch; 0 of others.
    pub plausible: Vec<f64>,
}

/// A part under some components: everything that densities need.
#[derive(Clone, Debug)]
pub struct Told {
    pub launch: usize,
    /// Z'C^-1 Z, Z'C^-1 z, z'C^-1 z.
    pub gram: DMatrix<f64>,
    pub score: DVector<f64>,
    pub square: f64,
    /// Logarithm of the covariance's determinant, and the number of coordinates.
    pub log_det: f64,
    pub count: f64,
}

/// What all launches say of the slots: the step from where the model stands, and its covariance.
pub struct Pooled {
    pub step: DVector<f64>,
    pub covariance: DMatrix<f64>,
}

impl Components {
    /// Where a fit starts.
    pub fn start(prior: &Prior) -> Components {
        let spread = prior.plausible.iter().map(|p| SPREAD[0] * p).collect();
        Components { slow: 1.0, leap: 0.01, push: pushes().iter().map(|_| 0.3).collect(), spread }
    }

    fn of(&self, kind: Own) -> f64 {
        match kind {
            Own::Push(place) => self.push[place],
            Own::Leap => self.leap,
            Own::Renewed => 1.0,
        }
    }

    fn logs(&self) -> Vec<f64> {
        let own = [self.slow, self.leap];
        own.iter().chain(&self.push).chain(self.spread.iter().filter(|s| **s > 0.0)).map(|v| v.ln()).collect()
    }

    fn with(&self, logs: &[f64]) -> Components {
        let mut rest = logs.iter().map(|l| l.exp());
        let mut next = || rest.next().unwrap_or(0.0);
        Components {
            slow: next(),
            leap: next(),
            push: self.push.iter().map(|_| next()).collect(),
            spread: self.spread.iter().map(|s| if *s > 0.0 { next() } else { 0.0 }).collect(),
        }
    }

    fn log_prior(&self, logs: &[f64], prior: &Prior) -> f64 {
        let spreads = prior.plausible.iter().filter(|p| **p > 0.0).map(|p| [(SPREAD[0] * p).ln(), SPREAD[1]]);
        let all = [SLOW, LEAP].into_iter().chain(self.push.iter().map(|_| PUSH)).chain(spreads);
        -0.5 * logs.iter().zip(all).map(|(l, [centre, sd])| ((l - centre) / sd).powi(2)).sum::<f64>()
    }
}

/// Products of a block's columns, its launch's pushes and what is left of it, under its own covariance: Z'C^-1 Z, Z'C^-1 z,
/// z'C^-1 z; the covariance's log determinant. `None` where it cannot be taken apart.
fn of_block(block: &Block, columns: &[usize], components: &Components) -> Option<(DMatrix<f64>, f64)> {
    let (m, own) = (block.left.len(), block.kinds.len());
    let (slots, q) = (columns.len(), columns.len() + block.alike.ncols());
    let variance = components.slow.powi(2);
    let mut log_det = block.log_white;
    let root = block.slow.map(|s| {
        let all = 1.0 + variance * s;
        log_det += all.ln();
        all.sqrt().recip()
    });
    let seen = DMatrix::from_fn(m, q + 1, |i, k| {
        root[i]
            * match k {
                _ if k < slots => block.columns[(i, columns[k])],
                _ if k < q => block.alike[(i, k - slots)],
                _ => block.left[i],
            }
    });
    let mut gram = seen.tr_mul(&seen);
    if own > 0 {
        let scales: Vec<f64> = block.kinds.iter().map(|k| components.of(*k)).collect();
        let beside = DMatrix::from_fn(m, own, |i, k| root[i] * scales[k] * block.own[(i, k)]);
        let mut inner = beside.tr_mul(&beside);
        (0..own).for_each(|k| inner[(k, k)] += 1.0);
        let within = inner.cholesky()?;
        log_det += 2.0 * within.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let along = within.l().solve_lower_triangular(&beside.tr_mul(&seen))?;
        gram -= along.tr_mul(&along);
    }
    Some((gram, log_det))
}

/// What a part says of some columns under components; `None` where its covariance cannot be taken apart.
fn of_part(part: &Part, columns: &[usize], components: &Components) -> Option<Told> {
    let slots = columns.len();
    let q = slots + part.blocks.first().map_or(0, |b| b.alike.ncols());
    let mut all = DMatrix::zeros(q + 1, q + 1);
    let (mut log_det, mut count) = (0.0, 0.0);
    for block in &part.blocks {
        let (gram, own) = of_block(block, columns, components)?;
        all += gram;
        log_det += own;
        count += block.left.len() as f64;
    }
    // Sizes that differ by launch: C + Z T^2 Z' with what Z'C^-1 Z is already.
    let spread = |k: &usize| match columns.get(*k) {
        Some(column) => components.spread.get(*column).copied().unwrap_or(0.0),
        None => components.push[part.blocks[0].alike_of[*k - slots]],
    };
    let wide: Vec<usize> = (0..q).filter(|k| part.differs && spread(k) > 0.0).collect();
    if !wide.is_empty() {
        let n = wide.len();
        let scaled = DMatrix::from_fn(n, q + 1, |i, j| spread(&wide[i]) * all[(wide[i], j)]);
        let inner = DMatrix::from_fn(n, n, |i, j| {
            f64::from(i == j) + spread(&wide[i]) * all[(wide[i], wide[j])] * spread(&wide[j])
        });
        let within = inner.cholesky()?;
        log_det += 2.0 * within.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let along = within.l().solve_lower_triangular(&scaled)?;
        all -= along.tr_mul(&along);
    }
    Some(Told {
        launch: part.launch,
        gram: all.view((0, 0), (slots, slots)).into_owned(),
        score: DVector::from_fn(slots, |k, _| all[(k, q)]),
        square: all[(q, q)],
        log_det,
        count,
    })
}

/// All parts under components.
pub fn all_told(parts: &[Part], components: &Components) -> Option<Vec<Told>> {
    let columns: Vec<usize> = (0..parts.first().map_or(0, |p| p.blocks[0].columns.ncols())).collect();
    parts.iter().map(|p| of_part(p, &columns, components)).collect()
}

/// Logarithm of the Student density of a square among `count` coordinates.
fn student(square: f64, log_det: f64, count: f64) -> f64 {
    let half = 0.5 * (FREEDOM + count);
    libm::lgamma(half)
        - libm::lgamma(0.5 * FREEDOM)
        - 0.5 * count * (FREEDOM * std::f64::consts::PI).ln()
        - 0.5 * log_det
        - half * (square.max(0.0) / FREEDOM).ln_1p()
}

impl Told {
    fn square_at(&self, step: &DVector<f64>) -> f64 {
        self.square - 2.0 * self.score.dot(step) + step.dot(&(&self.gram * step))
    }

    /// How much the part counts for, its scale being its own.
    pub fn weight(&self, step: &DVector<f64>) -> f64 {
        (FREEDOM + self.count) / (FREEDOM + self.square_at(step).max(0.0))
    }

    /// Log density with the slots `step` away.
    pub fn density(&self, step: &DVector<f64>) -> f64 {
        student(self.square_at(step), self.log_det, self.count)
    }

    /// Log density with the slots known as `others` say.
    pub fn predicted(&self, others: &Pooled) -> f64 {
        let density = |(square, log_det)| student(square, log_det, self.count);
        self.predictive(others).map_or(f64::NEG_INFINITY, density)
    }

    /// Square of how far the part is from what `others` predict, under its predictive covariance, and that covariance's log
    /// determinant; `None` where it cannot be taken apart.
    pub fn predictive(&self, others: &Pooled) -> Option<(f64, f64)> {
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
        Some((self.square_at(&others.step) - taken, self.log_det + log_det))
    }
}

/// What some parts say of the slots together: generalised least squares, each part weighing as its scale lets it.
pub fn pooled<'a>(told: impl Iterator<Item = &'a Told> + Clone, prior: &Prior) -> Option<Pooled> {
    let q = prior.off.len();
    let mut step = DVector::zeros(q);
    let mut covariance = DMatrix::zeros(q, q);
    for _ in 0..4 {
        let mut gram = prior.precision.clone();
        let mut score = &prior.precision * &prior.off;
        for t in told.clone() {
            let weight = t.weight(&step);
            gram += &t.gram * weight;
            score.axpy(weight, &t.score, 1.0);
        }
        let factor = gram.cholesky()?;
        step = factor.solve(&score);
        covariance = factor.inverse();
    }
    Some(Pooled { step, covariance })
}

/// Components that make the parts most likely, from some start.
pub fn components(parts: &[&Part], from: &Components, prior: &Prior, widths: &[f64]) -> Components {
    // Where the model stands no size moves: only those that differ by launch matter.
    let wide: Vec<usize> = (0..from.spread.len()).filter(|k| from.spread[*k] > 0.0).collect();
    let quality = |logs: &[f64]| {
        let c = from.with(logs);
        let density = |p: &&Part| match of_part(p, &wide, &c) {
            Some(t) => student(t.square, t.log_det, t.count),
            None => f64::NEG_INFINITY,
        };
        parts.iter().map(density).sum::<f64>() + from.log_prior(logs, prior)
    };
    let mut logs = from.logs();
    let mut best = quality(&logs);
    for width in widths.iter().copied() {
        for _ in 0..6 {
            let before = best;
            for k in 0..logs.len() {
                for way in [width, -width] {
                    let mut moved = logs.clone();
                    moved[k] += way;
                    let value = quality(&moved);
                    if value > best {
                        (best, logs) = (value, moved);
                        break;
                    }
                }
            }
            if best - before < 0.05 {
                break;
            }
        }
    }
    from.with(&logs)
}

/// Groups of launches that are held out together: every setting is spread over all of them.
pub fn folds(settings: &[usize]) -> Vec<usize> {
    let count = FOLDS.min(settings.len()).max(1);
    let mut seen = vec![0usize; settings.iter().max().map_or(0, |m| m + 1)];
    let mut first = 0;
    let mut out = Vec::with_capacity(settings.len());
    for setting in settings {
        if seen[*setting] == 0 {
            seen[*setting] = first + 1;
            first += 1;
        }
        out.push((seen[*setting] - 1) % count);
        seen[*setting] += 1;
    }
    out
}

/// Log predictive density of every launch, its slots and components told from other folds.
pub fn held_out(parts: &[Part], prior: &Prior, known: &Components, folds: &[usize]) -> Option<Vec<f64>> {
    let mut out = vec![0.0; folds.len()];
    each_held_out(parts, prior, known, folds, |t, others| out[t.launch] += t.predicted(others))?;
    Some(out)
}

/// Hands over what every part says, with what other folds say of the slots; components are those folds' own.
pub fn each_held_out(
    parts: &[Part],
    prior: &Prior,
    known: &Components,
    folds: &[usize],
    mut of: impl FnMut(&Told, &Pooled),
) -> Option<()> {
    for fold in 0..folds.iter().max().map_or(0, |m| m + 1) {
        let others: Vec<&Part> = parts.iter().filter(|p| folds[p.launch] != fold).collect();
        let own = components(&others, known, prior, &NEAR);
        let all = all_told(parts, &own)?;
        let others = pooled(all.iter().filter(|t| folds[t.launch] != fold), prior)?;
        all.iter().filter(|t| folds[t.launch] == fold).for_each(|t| of(t, &others));
    }
    Some(())
}

/// The same with components that are given, and what is left of launches that are held out: squares, in units of the noise.
pub fn held_out_with(
    parts: &[Part],
    prior: &Prior,
    given: &Components,
    folds: &[usize],
) -> Option<(Vec<f64>, Vec<f64>)> {
    let (mut scores, mut squares) = (vec![0.0; folds.len()], vec![0.0; folds.len()]);
    let all = all_told(parts, given)?;
    for fold in 0..folds.iter().max().map_or(0, |m| m + 1) {
        let others = pooled(all.iter().filter(|t| folds[t.launch] != fold), prior)?;
        for (part, t) in parts.iter().zip(&all).filter(|(p, _)| folds[p.launch] == fold) {
            scores[t.launch] += t.predicted(&others);
            squares[t.launch] += part.square_at(&others.step);
        }
    }
    Some((scores, squares))
}

/// Scores with launches that may be spoilt: then they are the base model's.
pub fn spared(own: &[f64], base: &[f64]) -> Vec<f64> {
    let mixed = |(own, base): (&f64, &f64)| {
        let (a, b) = ((1.0 - SPOILT).ln() + own, SPOILT.ln() + base);
        let most = a.max(b);
        most + ((a - most).exp() + (b - most).exp()).ln()
    };
    own.iter().zip(base).map(mixed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two windows of a launch: six coordinates each, two slots, a push alike in both and one of its own.
    fn part() -> Part {
        let block = |seed: usize| {
            let wave = |k: usize| libm::sin(1.7 * (k + 13 * seed) as f64);
            Block {
                left: DVector::from_fn(6, |i, _| 2.0 * wave(i)),
                slow: DVector::from_fn(6, |i, _| 1.0 / (1 + i) as f64),
                columns: DMatrix::from_fn(6, 2, |i, k| wave(31 + 7 * i + k)),
                alike: DMatrix::from_fn(6, 1, |i, _| wave(90 + i)),
                alike_of: vec![1],
                own: DMatrix::from_fn(6, 1, |i, _| wave(120 + i)),
                kinds: vec![Own::Push(0)],
                log_white: 0.3,
            }
        };
        Part { launch: 0, blocks: vec![block(1), block(2)], differs: true }
    }

    fn components_of_it() -> Components {
        Components { slow: 1.3, leap: 0.01, push: vec![0.7, 0.4], spread: vec![0.5, 0.0] }
    }

    /// The same Gaussian written down whole: (covariance, columns, what is left).
    fn whole(part: &Part, c: &Components) -> (DMatrix<f64>, DMatrix<f64>, DVector<f64>) {
        let [a, b] = &part.blocks[..] else { unreachable!("two windows") };
        let rows = |f: &dyn Fn(&Block) -> DMatrix<f64>| {
            let (x, y) = (f(a), f(b));
            DMatrix::from_fn(12, x.ncols(), |i, k| if i < 6 { x[(i, k)] } else { y[(i - 6, k)] })
        };
        let columns = rows(&|p| p.columns.clone());
        let left = rows(&|p| DMatrix::from_column_slice(6, 1, p.left.as_slice())).column(0).into_owned();
        let alike = rows(&|p| p.alike.clone()) * c.push[1];
        let spread = columns.column(0) * c.spread[0];
        let mut all = &alike * alike.transpose() + &spread * spread.transpose();
        for (b, block) in part.blocks.iter().enumerate() {
            let own = &block.own * c.push[0];
            let diagonal = DMatrix::from_diagonal(&block.slow.map(|s| 1.0 + c.slow * c.slow * s));
            let mut view = all.view_mut((6 * b, 6 * b), (6, 6));
            view += diagonal + &own * own.transpose();
        }
        (all, columns, left)
    }

    #[test]
    fn a_part_taken_apart_is_the_gaussian_written_down_whole() {
        let (part, c) = (part(), components_of_it());
        let told = of_part(&part, &[0, 1], &c).unwrap();
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
        let others = Pooled {
            step: DVector::from_vec(vec![0.2, -0.4]),
            covariance: DMatrix::from_row_slice(2, 2, &[0.3, 0.1, 0.1, 0.2]),
        };
        let wide = &covariance + &columns * &others.covariance * columns.transpose();
        let off = &left - &columns * &others.step;
        let square = off.dot(&(wide.clone().try_inverse().unwrap() * &off));
        close(told.predicted(&others), student(square, wide.determinant().ln() + 0.6, 12.0));
    }

    /// A launch a thousand times as far off as the others costs its logarithm, and moves what is told of the slots little.
    #[test]
    fn a_spoilt_launch_has_bounded_say() {
        let mut spoilt = part();
        spoilt.blocks.iter_mut().for_each(|b| b.left *= 1000.0);
        let c = Components { spread: vec![0.0; 2], ..components_of_it() };
        let prior =
            Prior { precision: DMatrix::identity(2, 2), off: DVector::zeros(2), plausible: vec![0.0; 2] };
        let of = |parts: &[Part]| pooled(all_told(parts, &c).unwrap().iter(), &prior).unwrap().step;
        let usual: Vec<Part> = vec![part(); 10];
        let all: Vec<Part> = usual.iter().cloned().chain([spoilt]).collect();
        assert!((of(&usual) - of(&all)).norm() < 0.2, "{} {}", of(&usual), of(&all));
        assert!((spared(&[-500.0], &[-40.0])[0] - (-40.0 + SPOILT.ln())).abs() < 1e-6);
    }

    #[test]
    fn every_setting_is_spread_over_the_folds() {
        let folds = folds(&[0, 0, 0, 1, 1, 1]);
        let of = |s: usize| -> Vec<usize> { folds[3 * s..3 * s + 3].to_vec() };
        for s in 0..2 {
            let mut own = of(s);
            own.dedup();
            assert_eq!(own.len(), 3);
        }
    }
}
