//! Which numbers a family's candidates have: named parameters with their ranges, what follows from them, and what must hold.
//!
//! Parameters that all have finitely many values make a grid, the first varying slowest, shuffled by the seed. With a range
//! among them, candidates are drawn one by one. Either way what does not meet every requirement is no candidate.

use rand::RngExt;
use rand::seq::SliceRandom;

use super::expression::Expression;
use crate::error::{Error, Result};
use crate::rng;

/// How numbers are drawn.
#[derive(Debug, Default)]
pub struct Recipe {
    /// Drawn, in this order.
    pub parameters: Vec<Parameter>,
    /// What follows: each over the parameters and the values before it.
    pub values: Vec<Expression>,
    /// What must hold, with its text: over parameters and values.
    pub require: Vec<(String, Expression)>,
    /// Most candidates.
    pub count: Option<usize>,
}

/// A number that is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// As expressions call it.
    pub name: String,
    /// What it may be.
    pub range: Range,
}

/// What a parameter may be.
#[derive(Clone, Debug, PartialEq)]
pub enum Range {
    /// One of these.
    Among(Vec<f64>),
    /// Anything between, evenly.
    Between(f64, f64),
}

/// The numbers of every candidate, and why others are none.
#[derive(Clone, Debug, PartialEq)]
pub struct Draws {
    /// The parameters of each.
    pub candidates: Vec<Vec<f64>>,
    /// Draws that were looked at.
    pub tried: usize,
    /// Draws for which a value has no finite number.
    pub undefined: usize,
    /// Draws that met every requirement before this one but not this one, by requirement.
    pub unmet: Vec<usize>,
}

/// Most points of a grid, and most candidates.
pub const MOST_POINTS: usize = 100_000;
/// Most numbers, names and operations that are computed for all draws together: about a second.
const MOST_WORK: usize = 50_000_000;
/// Candidates that are drawn from ranges if nothing is said.
const USUAL: usize = 500;
/// Draws for each candidate that is wanted before it is given up.
const PATIENCE: usize = 400;

impl Recipe {
    /// The candidates for a seed; an error if there is none. `family` names the random stream.
    pub fn draws(&self, family: &str, seed: u64) -> Result<Draws> {
        let mut found =
            Draws { candidates: Vec::new(), tried: 0, undefined: 0, unmet: vec![0; self.require.len()] };
        let mut stream = rng::stream(seed, &format!("{family} candidates"));
        let mut all = Vec::new();
        let affordable = MOST_WORK / self.size();
        let grid: Option<Vec<&[f64]>> = self.parameters.iter().map(|p| p.range.among()).collect();
        if let Some(grid) = grid {
            let points: usize = grid.iter().map(|values| values.len()).product();
            if points > affordable {
                let value = format!("a grid of {points} points");
                let allowed = format!("at most {affordable} with so much to compute for each");
                return Err(Error::input("candidates.parameters", value, allowed));
            }
            for index in 0..points {
                point(&grid, index, &mut all);
                self.judge(&mut all, &mut found);
            }
            found.candidates.shuffle(&mut stream);
            found.candidates.truncate(self.count.unwrap_or(usize::MAX));
        } else {
            let wanted = self.count.unwrap_or(USUAL);
            while found.candidates.len() < wanted && found.tried < affordable.min(wanted * PATIENCE) {
                all.clear();
                all.extend(self.parameters.iter().map(|p| p.range.at(stream.random())));
                self.judge(&mut all, &mut found);
            }
        }
        if found.candidates.is_empty() { Err(self.refusal(&found)) } else { Ok(found) }
    }

    /// The parameters with all that follows from them; `None` where something has no finite number.
    pub fn complete(&self, parameters: &[f64]) -> Option<Vec<f64>> {
        let mut all = parameters.to_vec();
        self.follow(&mut all).then_some(all)
    }

    /// Adds what follows from the parameters; whether all of it is finite.
    fn follow(&self, all: &mut Vec<f64>) -> bool {
        self.values.iter().all(|value| {
            all.push(value.value(all));
            all.last().is_some_and(|v| v.is_finite())
        })
    }

    /// What there is to compute for a draw.
    fn size(&self) -> usize {
        let expressions = self.values.iter().chain(self.require.iter().map(|(_, e)| e));
        1 + self.parameters.len() + expressions.map(Expression::size).sum::<usize>()
    }

    fn judge(&self, all: &mut Vec<f64>, found: &mut Draws) {
        found.tried += 1;
        if !self.follow(all) {
            found.undefined += 1;
            return;
        }
        // What is not a number does not hold.
        let holds = |e: &Expression| !matches!(e.value(all), v if v == 0.0 || v.is_nan());
        match self.require.iter().position(|(_, e)| !holds(e)) {
            Some(unmet) => found.unmet[unmet] += 1,
            None => found.candidates.push(all[..self.parameters.len()].to_vec()),
        }
    }

    /// Names what most draws failed at.
    fn refusal(&self, found: &Draws) -> Error {
        let worst = (0..self.require.len()).max_by_key(|i| found.unmet[*i]);
        match worst.filter(|i| found.unmet[*i] >= found.undefined) {
            Some(i) => {
                let allowed =
                    format!("something that draws meet: {} of {} did not", found.unmet[i], found.tried);
                Error::input(format!("candidates.require[{i}]"), format!("{:?}", self.require[i].0), allowed)
            }
            None => {
                let value =
                    format!("without a finite number in {} of {} draws", found.undefined, found.tried);
                Error::input("candidates.values", value, "expressions that have one")
            }
        }
    }
}

impl Range {
    fn among(&self) -> Option<&[f64]> {
        match self {
            Range::Among(values) => Some(values),
            Range::Between(..) => None,
        }
    }

    /// The value at a share `u` in [0, 1) of the way.
    fn at(&self, u: f64) -> f64 {
        match self {
            Range::Among(values) => values[((u * values.len() as f64) as usize).min(values.len() - 1)],
            Range::Between(low, high) => low + u * (high - low),
        }
    }
}

/// A grid's point number `index`, the last parameter varying fastest.
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

    fn recipe(ranges: Vec<Range>, require: &str) -> Recipe {
        let names = ["a", "b"].map(String::from);
        let parameters = names.iter().zip(ranges).map(|(n, range)| Parameter { name: n.clone(), range });
        let rule = Expression::parse("require", require, &names).unwrap();
        Recipe {
            parameters: parameters.collect(),
            require: vec![(require.into(), rule)],
            ..Recipe::default()
        }
    }

    #[test]
    fn a_grid_is_shuffled_whole_and_ranges_are_drawn() {
        let among = || Range::Among(vec![0.0, 1.0, 2.0]);
        let mut all = recipe(vec![among(), among()], "b > a").draws("f", 1).unwrap();
        assert_eq!((all.tried, all.unmet.as_slice()), (9, [6].as_slice()));
        assert_ne!(all, recipe(vec![among(), among()], "b > a").draws("f", 2).unwrap());
        all.candidates.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(all.candidates, [[0.0, 1.0], [0.0, 2.0], [1.0, 2.0]]);

        let mut drawn = recipe(vec![among(), Range::Between(-1.0, 3.0)], "b > a");
        drawn.count = Some(50);
        let found = drawn.draws("f", 1).unwrap();
        assert_eq!(found, drawn.draws("f", 1).unwrap());
        assert!(found.candidates.len() == 50 && found.tried > 50);
        assert!(found.candidates.iter().all(|c| c[1] > c[0] && c[1] < 3.0 && c[0].fract() == 0.0));
    }

    #[test]
    fn a_requirement_that_nothing_meets_is_named() {
        let never = recipe(vec![Range::Between(0.0, 1.0), Range::Between(0.0, 1.0)], "a + b > 3");
        let error = never.draws("f", 0).unwrap_err().to_string();
        assert!(error.contains("`candidates.require[0]` is \"a + b > 3\""), "{error}");
        let mut undefined = recipe(vec![Range::Among(vec![0.0]), Range::Among(vec![1.0])], "a < 1");
        undefined.values.push(Expression::parse("v", "b / a", &["a", "b"].map(String::from)).unwrap());
        let error = undefined.draws("f", 0).unwrap_err().to_string();
        assert!(error.contains("`candidates.values` is without a finite number in 1 of 1"), "{error}");
    }
}
