//! What launches have in common that a model lacks, integrated out: a force field of unknown kind and strength.
//!
//! The field is a sum of functions (`field`) of everything, of place, of velocity, of the clock or of place and heading, its
//! coefficients normal with a common standard deviation t, m/s^2. For each kind and each of some t, and without any field, the
//! coefficients are integrated out about their most likely values (Laplace's method): with Z the parts' derivatives by them and w the
//! parts' weights at the fit,
//!
//! log p(r | t) = sum_p log student(|r_p - Z_p a|^2) - |a|^2 / (2 t^2) - log det(I + t^2 A) / 2,  a = (A + I / t^2)^-1 sum_p w_p Z_p' r_p,
//!
//! A = sum_p w_p Z_p' Z_p. No field is as believable as all fields together, each kind as the others, each strength as the others. A
//! simulation that leaves nothing out loses little by that; one that does is not as sure as it would be.
//!
//! Source: Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425; Tierney and Kadane, J. Am. Stat. Assoc. 81 (1986) 82.
//!
//! Differences from the source: functions of fixed widths in place of a Gaussian process; the directions that all parts together tell
//! least of are left out, so that drawn fields are nothing along them, and are surer of themselves there than they have reason to be; left out are kinds and strengths of which the fit says that they are out of the question.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::whitened::Whitened;
use crate::discover::field::Over;
use crate::discover::gaussian::FREEDOM;
use crate::estimate::sampler::{log_sum_exp, one_of};
use crate::rng::Stream;

/// Standard deviations of coefficients, m/s^2.
const STRENGTHS: [f64; 5] = [0.05, 0.2, 0.6, 2.0, 6.0];
/// Most directions of a kind that are kept.
const DIRECTIONS: usize = 40;
/// Information of a direction, beside what the strongest field's coefficients are believed to be, below which it says nothing.
const TELLS: f64 = 1e-2;
/// Rounds in which weights and field are found in turn.
const ROUNDS: usize = 3;
/// Nats that a field is worse at the fit than the best beyond which it is out of the question.
const HOPELESS: f64 = 25.0;

/// A kind of shared field and the standard deviation of its coefficients (of one that was followed their root mean square over draws), m/s^2; none of
/// strength 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Field {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub over: Option<Over>,
    pub strength: f64,
}

/// Which of all functions each kind of field has.
pub type Kinds = Vec<(Over, Range<usize>)>;

/// Shared fields that may be there.
pub struct Discrepancy {
    kinds: Vec<Kind>,
    /// Fields that are tried: index of the kind, strength and log prior probability.
    tried: Vec<(usize, f64, f64)>,
    /// Log prior probability of none.
    none: f64,
}

/// A kind of field, in the directions that data tell of.
struct Kind {
    over: Over,
    /// Which of all functions are its own.
    range: Range<usize>,
    /// The directions, by function of the range.
    turn: DMatrix<f64>,
    /// Information of each direction at the fit.
    information: DVector<f64>,
    /// By part: weight, and derivatives by the directions.
    parts: Vec<(f64, DMatrix<f64>)>,
}

impl Discrepancy {
    /// Of parts with derivatives by all functions; `kinds`: which of those each kind has.
    pub fn new(parts: &[Whitened], kinds: &[(Over, Range<usize>)]) -> Discrepancy {
        let none = if kinds.is_empty() { 0.0 } else { libm::log(0.5) };
        let kinds: Vec<Kind> =
            kinds.iter().map(|(over, range)| Kind::new(parts, *over, range, None)).collect();
        let left: Vec<DVector<f64>> = parts.iter().map(|p| p.left.clone()).collect();
        let each = libm::log(0.5 / (kinds.len() * STRENGTHS.len()).max(1) as f64);
        let all = (0..kinds.len()).flat_map(|k| STRENGTHS.map(|s| (k, s, each)));
        let mut found = Discrepancy { tried: all.collect(), kinds, none };
        let densities = found.log_likelihoods(parts, &left);
        let best = densities.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mut worth = densities.iter().skip(1).map(|d| best - d < HOPELESS);
        found.tried.retain(|_| worth.next().unwrap_or(false));
        found
    }

    /// The same fields, where parts have other covariances.
    pub fn under(&self, parts: &[Whitened]) -> Discrepancy {
        let anew = |kind: &Kind| {
            let found = Kind::new(parts, kind.over, &kind.range, Some(&kind.turn));
            Kind { turn: &kind.turn * &found.turn, ..found }
        };
        Discrepancy {
            kinds: self.kinds.iter().map(anew).collect(),
            tried: self.tried.clone(),
            none: self.none,
        }
    }

    /// Numbers that it holds.
    pub fn numbers(&self) -> usize {
        self.kinds.iter().flat_map(|k| &k.parts).map(|(_, columns)| columns.len()).sum()
    }

    /// Fields that are tried, none first.
    pub fn fields(&self) -> Vec<Field> {
        let of = |(k, strength, _): &(usize, f64, f64)| Field {
            over: Some(self.kinds[*k].over),
            strength: *strength,
        };
        [Field { over: None, strength: 0.0 }].into_iter().chain(self.tried.iter().map(of)).collect()
    }

    /// Log likelihood of what parts leave beside every field, its prior probability in it; infinitely little where a path diverged.
    pub fn log_likelihoods(&self, parts: &[Whitened], left: &[DVector<f64>]) -> Vec<f64> {
        let density = |(part, left): (&Whitened, &DVector<f64>)| part.log_density(left.norm_squared());
        let mut out = vec![self.none + parts.iter().zip(left).map(density).sum::<f64>()];
        let mut asked: Vec<Option<DVector<f64>>> = vec![None; self.kinds.len()];
        for (k, strength, believed) in &self.tried {
            let kind = &self.kinds[*k];
            let asked = asked[*k].get_or_insert_with(|| kind.asked(left));
            out.push(believed + kind.log_likelihood(parts, left, asked, *strength));
        }
        out
    }

    /// A field as it may be, of what parts leave at a point: its kind, by its number, and the coefficient of each of its functions, m/s^2; nothing where there is none. Drawn by the fields' probabilities there, then about the most likely
    /// coefficients; directions that nothing tells of stay nothing. `by_field`: log likelihoods at the point.
    pub fn drawn(
        &self,
        left: &[DVector<f64>],
        by_field: &[f64],
        stream: &mut Stream,
    ) -> Option<(usize, DVector<f64>)> {
        let (kind, strength, _) = *self.tried.get(one_of(by_field, stream)?.checked_sub(1)?)?;
        let own = &self.kinds[kind];
        let mut along = own.field(&own.asked(left), strength);
        for (k, a) in along.iter_mut().enumerate() {
            let z: f64 = StandardNormal.sample(stream);
            *a += z * strength / (1.0 + strength.powi(2) * own.information[k]).sqrt();
        }
        Some((kind, &own.turn * along))
    }

    /// Probability of every field over points that were drawn from the posterior.
    pub fn probabilities(&self, by_point: &[Vec<f64>]) -> Vec<f64> {
        let mut out = vec![0.0; 1 + self.tried.len()];
        for of in by_point {
            let all = log_sum_exp(of.iter().copied());
            out.iter_mut().zip(of).for_each(|(sum, l)| *sum += libm::exp(l - all) / by_point.len() as f64);
        }
        out
    }
}

impl Kind {
    /// Of some of all functions, or of what they come to along some directions of theirs.
    fn new(parts: &[Whitened], over: Over, range: &Range<usize>, along: Option<&DMatrix<f64>>) -> Kind {
        let by = |part: &Whitened| {
            let own = part.field.columns(range.start, range.len());
            along.map_or_else(|| own.into_owned(), |turn| own * turn)
        };
        let columns: Vec<DMatrix<f64>> = parts.iter().map(by).collect();
        let mut weights = vec![1.0; parts.len()];
        let mut found = Kind::turned(&columns, &weights, over, range);
        let own: Vec<DVector<f64>> = parts.iter().map(|p| p.left.clone()).collect();
        for _ in 0..ROUNDS {
            let asked = found.asked(&own);
            let density = |s: &f64| found.log_likelihood(parts, &own, &asked, *s);
            let best = STRENGTHS
                .into_iter()
                .max_by(|a, b| density(a).total_cmp(&density(b)))
                .unwrap_or(STRENGTHS[0]);
            let field = found.field(&asked, best);
            for ((weight, (_, columns)), left) in weights.iter_mut().zip(&found.parts).zip(&own) {
                let n = left.len() as f64;
                let square = (left - columns * &field).norm_squared();
                *weight = (FREEDOM + n) / (FREEDOM + square);
            }
            found = Kind::turned(&columns, &weights, over, range);
        }
        found
    }

    /// Columns turned to directions in which information is diagonal.
    fn turned(by: &[DMatrix<f64>], weights: &[f64], over: Over, range: &Range<usize>) -> Kind {
        let count = by.first().map_or(0, DMatrix::ncols);
        let mut gram = DMatrix::zeros(count, count);
        for (own, weight) in by.iter().zip(weights) {
            gram += own.tr_mul(own) * *weight;
        }
        let eigen = gram.symmetric_eigen();
        let strongest = STRENGTHS[STRENGTHS.len() - 1];
        let tells = |k: &usize| eigen.eigenvalues[*k] * strongest.powi(2) > TELLS;
        let mut order: Vec<usize> = (0..count).filter(tells).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]).then(a.cmp(b)));
        order.truncate(DIRECTIONS);
        let turn = eigen.eigenvectors.select_columns(&order);
        let turned = |(own, weight): (&DMatrix<f64>, &f64)| (*weight, own * &turn);
        Kind {
            over,
            range: range.clone(),
            information: DVector::from_fn(order.len(), |k, _| eigen.eigenvalues[order[k]]),
            parts: by.iter().zip(weights).map(turned).collect(),
            turn,
        }
    }

    /// What all parts together ask of the field.
    fn asked(&self, left: &[DVector<f64>]) -> DVector<f64> {
        let mut asked = DVector::zeros(self.information.len());
        for ((weight, columns), left) in self.parts.iter().zip(left) {
            asked.gemv_tr(*weight, columns, left, 1.0);
        }
        asked
    }

    /// The most likely field of a strength.
    fn field(&self, asked: &DVector<f64>, strength: f64) -> DVector<f64> {
        let variance = strength.powi(2);
        let room = |k: usize| 1.0 + variance * self.information[k];
        DVector::from_fn(asked.len(), |k, _| variance * asked[k] / room(k))
    }

    fn log_likelihood(
        &self,
        parts: &[Whitened],
        left: &[DVector<f64>],
        asked: &DVector<f64>,
        strength: f64,
    ) -> f64 {
        let field = self.field(asked, strength);
        let mut own = -0.5 * field.norm_squared() / strength.powi(2);
        for ((part, left), (_, columns)) in parts.iter().zip(left).zip(&self.parts) {
            let mut rest = left.clone();
            rest.gemv(-1.0, columns, &field, 1.0);
            own += part.log_density(rest.norm_squared());
        }
        let room = |i: &f64| libm::log1p(strength.powi(2) * i);
        own - 0.5 * self.information.iter().map(room).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parts of six coordinates and one function of the field, `amount` of which is in what is left.
    fn parts(amount: f64) -> Vec<Whitened> {
        let wave = |k: usize| libm::sin(1.7 * k as f64 + 0.4);
        let part = |p: usize| {
            let field = DMatrix::from_fn(6, 1, |i, _| 3.0 * wave(7 * p + i));
            let noise = DVector::from_fn(6, |i, _| 1.3 * wave(311 * p + 17 * i * i));
            Whitened {
                left: noise + field.column(0) * amount,
                slots: DMatrix::zeros(6, 0),
                field,
                log_det: 0.0,
            }
        };
        (0..20).map(part).collect()
    }

    fn lefts(parts: &[Whitened]) -> Vec<DVector<f64>> {
        parts.iter().map(|p| p.left.clone()).collect()
    }

    fn found(parts: &[Whitened]) -> Discrepancy {
        Discrepancy::new(parts, &[(Over::Place, 0..1)])
    }

    /// Where nothing is left out none is the likeliest, where much is, none is impossible.
    #[test]
    fn a_field_is_told_by_what_is_left() {
        let of = |amount: f64| {
            let parts = parts(amount);
            let found = found(&parts);
            let all = found.log_likelihoods(&parts, &lefts(&parts));
            (found.fields(), found.probabilities(&[all]))
        };
        let (fields, nothing) = of(0.0);
        assert!(nothing[0] > 0.5 && fields[0] == Field { over: None, strength: 0.0 }, "{nothing:?}");
        let (fields, much) = of(2.0);
        let most = (0..much.len()).max_by(|a, b| much[*a].total_cmp(&much[*b])).unwrap();
        assert!(much[0] < 1e-6 && fields[most].strength >= 0.6, "{much:?}");
        assert!((much.iter().sum::<f64>() - 1.0).abs() < 1e-9);
    }

    /// The integral by Laplace's method against one by a sum over a grid, of one function.
    #[test]
    fn what_is_integrated_out_is_the_integral() {
        for amount in [0.0, 0.6] {
            let parts = parts(amount);
            let found = found(&parts);
            let all = found.log_likelihoods(&parts, &lefts(&parts));
            for (field, density) in found.fields().iter().zip(&all).skip(1) {
                let n = 4001;
                let at = |i: usize| field.strength * 8.0 * (2.0 * i as f64 / (n - 1) as f64 - 1.0);
                let of = |a: f64| {
                    let own = parts.iter().map(|p| p.log_density((&p.left - &p.field * a).norm_squared()));
                    let normal =
                        -0.5 * (a / field.strength).powi(2) - libm::log(field.strength * 2.506_628_274_631);
                    own.sum::<f64>() + normal
                };
                let logs: Vec<f64> = (0..n).map(|i| of(at(i))).collect();
                let wanted = log_sum_exp(logs.iter().copied()) + libm::log(at(1) - at(0)) + libm::log(0.1);
                assert!((density - wanted).abs() < 0.12, "{field:?}: {density} for {wanted}");
            }
        }
    }

    /// Coefficients are drawn about what is in what is left, as widely as a grid says; where there is none for sure none is drawn.
    #[test]
    fn fields_are_drawn_as_they_may_be() {
        let parts = parts(2.0);
        let found = found(&parts);
        let left = lefts(&parts);
        let by_field = found.log_likelihoods(&parts, &left);
        let mut stream = crate::rng::stream(4, "test");
        let drawn: Vec<f64> = (0..4000)
            .map(|_| found.drawn(&left, &by_field, &mut stream).expect("none is impossible").1[0])
            .collect();
        let n = 4001;
        let at = |i: usize| 1.0 + 2.0 * i as f64 / (n - 1) as f64;
        let of = |a: f64| {
            let own =
                parts.iter().map(|p| p.log_density((&p.left - &p.field * a).norm_squared())).sum::<f64>();
            let believed = STRENGTHS.map(|s| -0.5 * (a / s).powi(2) - libm::log(s));
            own + log_sum_exp(believed)
        };
        let logs: Vec<f64> = (0..n).map(|i| of(at(i))).collect();
        let all = log_sum_exp(logs.iter().copied());
        let moment = |power: i32, about: f64| {
            let of = |i: usize| libm::exp(logs[i] - all) * (at(i) - about).powi(power);
            (0..n).map(of).sum::<f64>()
        };
        let mean = moment(1, 0.0);
        let sd = moment(2, mean).sqrt();
        let own = drawn.iter().sum::<f64>() / drawn.len() as f64;
        let spread = (drawn.iter().map(|a| (a - own).powi(2)).sum::<f64>() / drawn.len() as f64).sqrt();
        assert!((own - mean).abs() < 0.3 * sd, "{own} for {mean} +- {sd}");
        assert!((spread / sd - 1.0).abs() < 0.2, "{spread} for {sd}");
        let never = vec![f64::NEG_INFINITY; by_field.len() - 1];
        let none: Vec<f64> = [0.0].into_iter().chain(never).collect();
        assert_eq!(found.drawn(&left, &none, &mut stream), None);
    }

    #[test]
    fn without_functions_there_is_no_field() {
        let parts = parts(1.0);
        let found = Discrepancy::new(&parts, &[]);
        let all = found.log_likelihoods(&parts, &lefts(&parts));
        let own: f64 = parts.iter().map(|p| p.log_density(p.left.norm_squared())).sum();
        assert_eq!(all, [own]);
    }
}
