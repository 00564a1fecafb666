//! Samples a family's candidates: named parameters with ranges, derived values, and requirements.
//!
//! Parameters that all have finitely many values form a grid, the first varying slowest, shuffled by the
//! seed. If a parameter has a continuous range, candidates are sampled independently. Draws that violate a
//! requirement are rejected.

use rand::RngExt;
use rand::seq::SliceRandom;

use crate::error::{Error, Result};
use crate::rng;
use crate::task::expression::Expression;

/// The sampling distribution of a family's candidates.
#[derive(Debug, Default)]
pub struct CandidateSampler {
    /// Sampled parameters, in this order.
    pub parameters: Vec<SampledParameter>,
    /// Derived values: each an expression of the parameters and of the values before it.
    pub values: Vec<Expression>,
    /// Requirements with their texts: expressions of parameters and values that must be true.
    pub require: Vec<(String, Expression)>,
    /// Maximum number of candidates.
    pub count: Option<usize>,
}

/// A sampled parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct SampledParameter {
    /// Its name in expressions.
    pub name: String,
    /// Its values.
    pub range: ParameterRange,
}

/// The values of a parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum ParameterRange {
    /// Uniform over these values.
    Among(Vec<f64>),
    /// Uniform between the bounds.
    Between(f64, f64),
}

/// The accepted candidates and the counts of rejected draws.
#[derive(Clone, Debug, PartialEq)]
pub struct CandidateDraws {
    /// Parameter values of each candidate.
    pub candidates: Vec<Vec<f64>>,
    /// Number of draws evaluated.
    pub evaluated: usize,
    /// Number of draws for which a derived value is not finite.
    pub undefined: usize,
    /// For each requirement: draws that met all previous requirements but not this one.
    pub unmet: Vec<usize>,
}

/// Maximum number of grid points, and of candidates.
pub const MAX_CANDIDATES: usize = 100_000;
/// Maximum number of operations over all draws: about a second.
const MAX_OPERATIONS: usize = 50_000_000;
/// Default number of candidates if a parameter has a continuous range.
const DEFAULT_CANDIDATES: usize = 500;
/// Maximum number of draws per requested candidate.
const MAX_DRAWS_PER_CANDIDATE: usize = 400;

impl CandidateSampler {
    /// The candidates for a seed; an error if there is none. `family` names the random stream.
    pub fn draws(&self, family: &str, seed: u64) -> Result<CandidateDraws> {
        let mut found = CandidateDraws {
            candidates: Vec::new(),
            evaluated: 0,
            undefined: 0,
            unmet: vec![0; self.require.len()],
        };
        let mut stream = rng::stream(seed, &format!("{family} candidates"));
        let mut all = Vec::new();
        let affordable = MAX_OPERATIONS / self.size();
        let grid: Option<Vec<&[f64]>> = self.parameters.iter().map(|p| p.range.among()).collect();
        if let Some(grid) = grid {
            let points: usize = grid.iter().map(|values| values.len()).product();
            if points > affordable {
                let value = format!("a grid of {points} points");
                let allowed = format!("at most {affordable} points, given the operations per point");
                return Err(Error::input("candidates.parameters", value, allowed));
            }
            for index in 0..points {
                point(&grid, index, &mut all);
                self.evaluate(&mut all, &mut found);
            }
            found.candidates.shuffle(&mut stream);
            found.candidates.truncate(self.count.unwrap_or(usize::MAX));
        } else {
            let wanted = self.count.unwrap_or(DEFAULT_CANDIDATES);
            while found.candidates.len() < wanted
                && found.evaluated < affordable.min(wanted * MAX_DRAWS_PER_CANDIDATE)
            {
                all.clear();
                all.extend(self.parameters.iter().map(|p| p.range.at(stream.random())));
                self.evaluate(&mut all, &mut found);
            }
        }
        if found.candidates.is_empty() { Err(self.refusal(&found)) } else { Ok(found) }
    }

    /// The parameters with all derived values; `None` if one of them is not finite.
    pub fn complete(&self, parameters: &[f64]) -> Option<Vec<f64>> {
        let mut all = parameters.to_vec();
        self.append_values(&mut all).then_some(all)
    }

    /// Appends the derived values; whether all of them are finite.
    fn append_values(&self, all: &mut Vec<f64>) -> bool {
        self.values.iter().all(|value| {
            all.push(value.value(all));
            all.last().is_some_and(|v| v.is_finite())
        })
    }

    /// Number of operations per draw.
    fn size(&self) -> usize {
        let expressions = self.values.iter().chain(self.require.iter().map(|(_, e)| e));
        1 + self.parameters.len() + expressions.map(Expression::size).sum::<usize>()
    }

    fn evaluate(&self, all: &mut Vec<f64>, found: &mut CandidateDraws) {
        found.evaluated += 1;
        if !self.append_values(all) {
            found.undefined += 1;
            return;
        }
        // NaN counts as false.
        let holds = |e: &Expression| !matches!(e.value(all), v if v == 0.0 || v.is_nan());
        match self.require.iter().position(|(_, e)| !holds(e)) {
            Some(unmet) => found.unmet[unmet] += 1,
            None => found.candidates.push(all[..self.parameters.len()].to_vec()),
        }
    }

    /// Names the requirement that rejected most draws.
    fn refusal(&self, found: &CandidateDraws) -> Error {
        let worst = (0..self.require.len()).max_by_key(|i| found.unmet[*i]);
        match worst.filter(|i| found.unmet[*i] >= found.undefined) {
            Some(i) => {
                let allowed =
                    format!("something that draws meet: {} of {} did not", found.unmet[i], found.evaluated);
                Error::input(format!("candidates.require[{i}]"), format!("{:?}", self.require[i].0), allowed)
            }
            None => {
                let value =
                    format!("without a finite number in {} of {} draws", found.undefined, found.evaluated);
                Error::input("candidates.values", value, "expressions that have one")
            }
        }
    }
}

impl ParameterRange {
    fn among(&self) -> Option<&[f64]> {
        match self {
            ParameterRange::Among(values) => Some(values),
            ParameterRange::Between(..) => None,
        }
    }

    /// The value at quantile `u` in [0, 1).
    fn at(&self, u: f64) -> f64 {
        match self {
            ParameterRange::Among(values) => {
                values[((u * values.len() as f64) as usize).min(values.len() - 1)]
            }
            ParameterRange::Between(low, high) => low + u * (high - low),
        }
    }
}

/// Point `index` of the grid, the last parameter varying fastest.
fn point(grid: &[&[f64]], mut index: usize, found: &mut Vec<f64>) {
    found.clear();
    found.resize(grid.len(), 0.0);
    for (slot, values) in found.iter_mut().zip(grid).rev() {
        *slot = values[index % values.len()];
        index /= values.len();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recipe(ranges: Vec<ParameterRange>, require: &str) -> CandidateSampler {
        let names = ["a", "b"].map(String::from);
        let parameters =
            names.iter().zip(ranges).map(|(n, range)| SampledParameter { name: n.clone(), range });
        let rule = Expression::parse("require", require, &names).unwrap();
        CandidateSampler {
            parameters: parameters.collect(),
            require: vec![(require.into(), rule)],
            ..CandidateSampler::default()
        }
    }

    #[test]
    fn shuffles_grids_and_samples_ranges() {
        let among = || ParameterRange::Among(vec![0.0, 1.0, 2.0]);
        let mut all = recipe(vec![among(), among()], "b > a").draws("f", 1).unwrap();
        assert_eq!((all.evaluated, all.unmet.as_slice()), (9, [6].as_slice()));
        assert_ne!(all, recipe(vec![among(), among()], "b > a").draws("f", 2).unwrap());
        all.candidates.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(all.candidates, [[0.0, 1.0], [0.0, 2.0], [1.0, 2.0]]);

        let mut drawn = recipe(vec![among(), ParameterRange::Between(-1.0, 3.0)], "b > a");
        drawn.count = Some(50);
        let found = drawn.draws("f", 1).unwrap();
        assert_eq!(found, drawn.draws("f", 1).unwrap());
        assert!(found.candidates.len() == 50 && found.evaluated > 50);
        assert!(found.candidates.iter().all(|c| c[1] > c[0] && c[1] < 3.0 && c[0].fract() == 0.0));
    }

    #[test]
    fn names_requirement_that_no_draw_meets() {
        let never =
            recipe(vec![ParameterRange::Between(0.0, 1.0), ParameterRange::Between(0.0, 1.0)], "a + b > 3");
        let error = never.draws("f", 0).unwrap_err().to_string();
        assert!(error.contains("`candidates.require[0]` is \"a + b > 3\""), "{error}");
        let mut undefined =
            recipe(vec![ParameterRange::Among(vec![0.0]), ParameterRange::Among(vec![1.0])], "a < 1");
        undefined.values.push(Expression::parse("v", "b / a", &["a", "b"].map(String::from)).unwrap());
        let error = undefined.draws("f", 0).unwrap_err().to_string();
        assert!(error.contains("`candidates.values` is without a finite number in 1 of 1"), "{error}");
    }
}
