//! Likelihoods of measured trials: preparation, evaluation at points, and starting points of chains.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::array::{Array, ArrayData};
use super::binary_arrays::BinaryArrays;
use crate::commands::{PosteriorRequest, TrialFiles};
use crate::error::{Error, Result, check_count};
use crate::json::JsonObject;
use crate::reality::TrackParseOptions;
use crate::task::Scene;
use crate::task::ball::BallScene;
use crate::world::ParameterVector;

/// Measured trials, their simulation, and the parameters of a point: latents and effect parameters.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LikelihoodIn {
    /// An `iplw.scene/1` document; its `calibrate` lists the latents to include in a point.
    #[schema(value_type = Option<Object>)]
    pub scene: Option<JsonObject<Scene>>,
    /// A single ball, instead of a scene.
    #[schema(value_type = Option<BallScene>)]
    pub ball: Option<JsonObject<BallScene>>,
    /// Trials as CSV, as for a diagnosis.
    pub trials: Option<TrialFiles>,
    /// Units and options for reading the trials.
    #[schema(value_type = Option<TrackParseOptions>)]
    pub reading: Option<JsonObject<TrackParseOptions>>,
    /// Id of an estimation, to use its trials so far.
    pub job: Option<String>,
    /// Effects whose parameters are part of a point. Default: none.
    pub effects: Option<Vec<String>>,
    /// Latents to include, instead of the scene's `calibrate`.
    pub calibrate: Option<Vec<String>>,
    /// Mean and standard deviation by latent. Default: 1 and 0.5; restitution 0.5 and 0.25.
    pub prior: Option<BTreeMap<String, [f64; 2]>>,
    /// Whether to account for model discrepancy shared by the trials. Default: true.
    pub discrepancy: Option<bool>,
    /// Seed of the fit.
    pub seed: Option<u64>,
}

impl LikelihoodIn {
    /// The request for the posterior with this likelihood.
    pub fn into_posterior(self) -> PosteriorRequest {
        PosteriorRequest {
            scene: self.scene,
            ball: self.ball,
            trials: self.trials,
            reading: self.reading,
            job: self.job,
            sets: Some(vec![self.effects.unwrap_or_default()]),
            calibrate: self.calibrate,
            prior: self.prior.into_iter().flatten().collect(),
            discrepancy: self.discrepancy,
            seed: self.seed,
            ..PosteriorRequest::default()
        }
    }
}

/// Points to evaluate.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PointsIn {
    /// Values of each parameter by name, one per point; at most 4096 points.
    pub columns: BTreeMap<String, Vec<f64>>,
    /// Evaluates only the prior, without simulation.
    #[serde(default)]
    pub prior_only: bool,
}

/// Maximum number of points in a request.
const MAX_POINTS: usize = 4096;

impl PointsIn {
    /// The points, with parameters in the order of `names`.
    pub fn points(mut self, names: &[String]) -> Result<Vec<ParameterVector>> {
        if let Some(other) = self.columns.keys().find(|n| !names.contains(n)) {
            let allowed = format!("columns {}", names.join(", "));
            return Err(Error::input(format!("columns.{other}"), "unknown", allowed));
        }
        let mut points: Option<Vec<ParameterVector>> = None;
        for name in names {
            let field = format!("columns.{name}");
            let Some(column) = self.columns.remove(name) else {
                return Err(Error::input(field, "missing", format!("columns {}", names.join(", "))));
            };
            let n = column.len();
            if n > MAX_POINTS {
                let advice = "send several requests";
                return Err(Error::TooLarge {
                    what: "points",
                    asked: n as u64,
                    limit: MAX_POINTS as u64,
                    advice,
                });
            }
            let points = points.get_or_insert_with(|| vec![ParameterVector::new(); n]);
            if n != points.len() {
                let allowed = format!("{}, as many as {} has", points.len(), names[0]);
                return Err(Error::input(field, format!("{n} values"), allowed));
            }
            points.iter_mut().zip(column).for_each(|(p, v)| p.push(v));
        }
        Ok(points.unwrap_or_default())
    }
}

/// Log densities at each point.
#[derive(Serialize, ToSchema)]
pub struct LogDensities {
    /// Natural logarithm of the likelihood; `null` (minus infinity in a binary array) where it or the prior is zero. Absent
    /// with `prior_only`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Option<f64>>>)]
    pub log_likelihood: Option<Array>,
    /// Natural logarithm of the prior density; `null` (minus infinity in a binary array) where it is zero.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Vec<Option<f64>>, required = true)]
    pub log_prior: Option<Array>,
}

impl LogDensities {
    /// From values per point.
    pub fn new(log_prior: Vec<f64>, log_likelihood: Option<Vec<f64>>) -> LogDensities {
        let array = |values: Vec<f64>| Array::line(ArrayData::F8(values));
        LogDensities { log_likelihood: log_likelihood.map(array), log_prior: Some(array(log_prior)) }
    }
}

impl BinaryArrays for LogDensities {
    fn take_arrays(&mut self) -> Vec<(&'static str, Array)> {
        let all = [("log_likelihood", self.log_likelihood.take()), ("log_prior", self.log_prior.take())];
        all.into_iter().filter_map(|(name, array)| Some((name, array?))).collect()
    }
}

/// Request for starting points of Markov chains.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ChainStartsIn {
    #[schema(minimum = 1, maximum = 4096)]
    pub count: u64,
    pub seed: Option<u64>,
}

impl ChainStartsIn {
    /// The number of points, validated.
    pub fn count(&self) -> Result<usize> {
        check_count("count", self.count, 1, MAX_POINTS as u64).map(|()| self.count as usize)
    }
}

/// Starting points of Markov chains.
#[derive(Serialize, ToSchema)]
pub struct ChainStarts {
    /// Values of each parameter by name.
    pub columns: BTreeMap<String, Vec<f64>>,
}

impl ChainStarts {
    /// From points with parameters in the order of `names`.
    pub fn new(names: Vec<String>, points: &[ParameterVector]) -> ChainStarts {
        let column = |(k, name): (usize, String)| (name, points.iter().map(|p| p[k]).collect());
        ChainStarts { columns: names.into_iter().enumerate().map(column).collect() }
    }
}

impl BinaryArrays for ChainStarts {}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(columns: &[(&str, usize)]) -> Result<Vec<ParameterVector>> {
        let column = |(name, n): &(&str, usize)| (name.to_string(), (0..*n).map(|i| i as f64).collect());
        let names = ["b".to_string(), "a.c".to_string()];
        PointsIn { columns: columns.iter().map(column).collect(), prior_only: false }.points(&names)
    }

    #[test]
    fn converts_columns_to_points_in_name_order() {
        let columns = [("a.c".to_string(), vec![1.0, 2.0]), ("b".to_string(), vec![3.0, 4.0])].into();
        let names = ["b".to_string(), "a.c".to_string()];
        assert_eq!(PointsIn { columns, prior_only: false }.points(&names).unwrap(), [[3.0, 1.0], [4.0, 2.0]]);
        assert!(points(&[("b", 0), ("a.c", 0)]).unwrap().is_empty());
    }

    #[test]
    fn rejects_missing_uneven_and_unknown_columns() {
        let refused = |columns: &[(&str, usize)], name: &str| {
            let error = points(columns).unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        };
        refused(&[("b", 1)], "columns.a.c");
        refused(&[("b", 1), ("a.c", 2)], "columns.a.c");
        refused(&[("b", 1), ("a.c", 1), ("d", 1)], "columns.d");
        refused(&[("b", 4097), ("a.c", 4097)], "4097");
        assert!(ChainStartsIn { count: 0, seed: None }.count().is_err());
    }
}
