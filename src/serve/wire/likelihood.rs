//! How likely measured trials are at points: what is prepared, what is asked, what is answered.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::array::{Array, Data};
use super::bulk::Bulk;
use super::diagnosis::{BallIn, DiagnosisIn, ReadingIn, TrialsIn};
use super::posterior::PosteriorIn;
use super::strict::Object;
use crate::discover::posterior::Wanted;
use crate::error::{Error, Result};
use crate::task::Scene;
use crate::world::Sample;

/// Measured trials, the simulation they are of, and what a point is to be of: latents and parameters of effects.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LikelihoodIn {
    /// An `iplw.scene/1` document; `calibrate` names the latents that are numbers of a point.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<Object<Scene>>,
    /// Instead of a scene, where one ball flies.
    #[schema(value_type = Option<BallIn>)]
    pub ball: Option<Object<BallIn>>,
    /// Trials as CSV, as for a diagnosis.
    #[schema(value_type = Option<TrialsIn>)]
    pub trials: Option<TrialsIn>,
    /// What the trials do not say of themselves.
    #[schema(value_type = Option<ReadingIn>)]
    pub reading: Option<Object<ReadingIn>>,
    /// Id of an estimation: its trials so far are asked.
    pub job: Option<String>,
    /// Effects by name, whose parameters are numbers of a point; without any the scene as it is.
    pub effects: Option<Vec<String>>,
    /// Latents, in place of the scene's `calibrate`.
    pub calibrate: Option<Vec<String>>,
    /// Mean and standard deviation by latent; else 1 and 0.5, for restitution 0.5 and 0.25.
    pub prior: Option<BTreeMap<String, [f64; 2]>>,
    /// Whether what trials share and the model lacks is allowed for; true if absent.
    pub discrepancy: Option<bool>,
    /// Of the fit.
    pub seed: Option<u64>,
}

impl LikelihoodIn {
    /// The trials and their scene, what is wanted, and the latents that are to be known in place of the scene's.
    pub fn parts(self) -> (DiagnosisIn, Wanted, Option<Vec<String>>) {
        let LikelihoodIn { scene, ball, trials, reading, job, effects, calibrate, prior, discrepancy, seed } =
            self;
        let sets = Some(vec![effects.unwrap_or_default()]);
        let (method, draws) = (None, None);
        PosteriorIn {
            scene,
            ball,
            trials,
            reading,
            job,
            sets,
            calibrate,
            prior,
            method,
            draws,
            discrepancy,
            seed,
        }
        .parts()
    }
}

/// Points to be asked.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PointsIn {
    /// Values of each of the numbers, by name; as many of each as there are points, 4096 at most.
    pub columns: BTreeMap<String, Vec<f64>>,
    /// Whether the prior alone is wanted, for which nothing is simulated.
    #[serde(default)]
    pub prior_only: bool,
}

/// Most points in a request.
const MOST_POINTS: usize = 4096;

impl PointsIn {
    /// The points, numbers in the order of the names.
    pub fn points(mut self, names: &[String]) -> Result<Vec<Sample>> {
        if let Some(other) = self.columns.keys().find(|n| !names.contains(n)) {
            let allowed = format!("columns {}", names.join(", "));
            return Err(Error::input(format!("columns.{other}"), "unknown", allowed));
        }
        let mut points: Option<Vec<Sample>> = None;
        for name in names {
            let field = format!("columns.{name}");
            let Some(column) = self.columns.remove(name) else {
                return Err(Error::input(field, "missing", format!("columns {}", names.join(", "))));
            };
            let n = column.len();
            if n > MOST_POINTS {
                let advice = "ask in several requests";
                return Err(Error::TooLarge {
                    what: "points",
                    asked: n as u64,
                    limit: MOST_POINTS as u64,
                    advice,
                });
            }
            let points = points.get_or_insert_with(|| vec![Sample::new(); n]);
            if n != points.len() {
                let allowed = format!("{}, as many as {} has", points.len(), names[0]);
                return Err(Error::input(field, format!("{n} values"), allowed));
            }
            points.iter_mut().zip(column).for_each(|(p, v)| p.push(v));
        }
        Ok(points.unwrap_or_default())
    }
}

/// How likely trials are at each point.
#[derive(Serialize, ToSchema)]
pub struct Densities {
    /// Natural logarithm of the likelihood; `null` (as an array: minus infinity) where it is zero or the prior does not allow the point.
    /// Absent where the prior alone was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Option<f64>>>)]
    pub log_likelihood: Option<Array>,
    /// Natural logarithm of the prior's density; `null` (as an array: minus infinity) where it does not allow the point.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Option<f64>>, required = true)]
    pub log_prior: Option<Array>,
}

impl Densities {
    /// By point; the likelihood if it was asked.
    pub fn new(log_prior: Vec<f64>, log_likelihood: Option<Vec<f64>>) -> Densities {
        let array = |values: Vec<f64>| Array::line(Data::F8(values));
        Densities { log_likelihood: log_likelihood.map(array), log_prior: Some(array(log_prior)) }
    }
}

impl Bulk for Densities {
    fn bulk(&mut self) -> Vec<(&'static str, Array)> {
        let all = [("log_likelihood", self.log_likelihood.take()), ("log_prior", self.log_prior.take())];
        all.into_iter().filter_map(|(name, array)| Some((name, array?))).collect()
    }
}

/// How many points are wanted to begin chains at.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StartsIn {
    #[schema(minimum = 1, maximum = 4096)]
    pub count: u64,
    pub seed: Option<u64>,
}

impl StartsIn {
    /// How many.
    pub fn count(&self) -> Result<usize> {
        if (1..=MOST_POINTS as u64).contains(&self.count) {
            return Ok(self.count as usize);
        }
        Err(Error::input("count", self.count, format!("a whole number from 1 to {MOST_POINTS}")))
    }
}

/// Points at which chains may begin.
#[derive(Serialize, ToSchema)]
pub struct Starts {
    /// Values of each of the numbers, by name.
    pub columns: BTreeMap<String, Vec<f64>>,
}

impl Starts {
    /// Of points whose numbers are in the order of the names.
    pub fn new(names: Vec<String>, points: &[Sample]) -> Starts {
        let column = |(k, name): (usize, String)| (name, points.iter().map(|p| p[k]).collect());
        Starts { columns: names.into_iter().enumerate().map(column).collect() }
    }
}

impl Bulk for Starts {}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(columns: &[(&str, usize)]) -> Result<Vec<Sample>> {
        let column = |(name, n): &(&str, usize)| (name.to_string(), (0..*n).map(|i| i as f64).collect());
        let names = ["b".to_string(), "a.c".to_string()];
        PointsIn { columns: columns.iter().map(column).collect(), prior_only: false }.points(&names)
    }

    #[test]
    fn columns_are_points_in_the_order_of_the_names() {
        let columns = [("a.c".to_string(), vec![1.0, 2.0]), ("b".to_string(), vec![3.0, 4.0])].into();
        let names = ["b".to_string(), "a.c".to_string()];
        assert_eq!(PointsIn { columns, prior_only: false }.points(&names).unwrap(), [[3.0, 1.0], [4.0, 2.0]]);
        assert!(points(&[("b", 0), ("a.c", 0)]).unwrap().is_empty());
    }

    #[test]
    fn columns_that_are_no_points_are_refused_by_name() {
        let refused = |columns: &[(&str, usize)], name: &str| {
            let error = points(columns).unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        };
        refused(&[("b", 1)], "columns.a.c");
        refused(&[("b", 1), ("a.c", 2)], "columns.a.c");
        refused(&[("b", 1), ("a.c", 1), ("d", 1)], "columns.d");
        refused(&[("b", 4097), ("a.c", 4097)], "4097");
        assert!(StartsIn { count: 0, seed: None }.count().is_err());
    }
}
