//! Requests for performance surfaces.

use serde::Deserialize;
use utoipa::ToSchema;

use crate::error::{Error, Result, check_count};
use crate::estimate::surface::{EvaluationMethod, SurfaceAxis};
use crate::experiment::surface::{MAX_LABELS, SurfaceConfig};
use crate::task::{DEFAULT_FAMILY, Family};

/// A performance surface to compute.
#[derive(Clone, Deserialize, ToSchema, clap::Args)]
#[serde(deny_unknown_fields)]
#[schema(as = SurfaceIn)]
pub struct SurfaceRequest {
    /// A family.
    #[arg(long, default_value = DEFAULT_FAMILY, help = "Family (see `iplw tasks`)")]
    pub task: String,
    /// `ideal` (default): tries actions that solve the simulation, without learning; `dqn`: trains a policy at every point.
    #[arg(long)]
    pub route: Option<String>,
    /// Number of design points, 3 to 5000. Default: 40.
    #[arg(long)]
    pub points: Option<u64>,
    /// Actions sampled per task (`ideal`) or labelled per training task (`dqn`). Default: the family's.
    #[arg(long)]
    pub actions: Option<u64>,
    /// Factors to vary: two or three of `density`, `friction`, `restitution`. Default: friction and restitution.
    #[arg(long, value_delimiter = ',')]
    pub factors: Option<Vec<String>>,
    #[arg(long, help = "Random seed [default: 0]")]
    pub seed: Option<u64>,
}

impl SurfaceRequest {
    /// The configuration of the computation for the request's family.
    pub fn config(&self, family: &Family) -> Result<SurfaceConfig> {
        let route = self.route.as_deref().map_or(Ok(EvaluationMethod::Ideal), EvaluationMethod::from_name);
        let mut config = SurfaceConfig::new(family, route.map_err(|e| e.unknown_in("route"))?)?;
        if let Some(factors) = &self.factors {
            let axis = |name: &String| SurfaceAxis::from_prior(name.trim(), family.prior);
            let axes = factors.iter().map(axis).collect::<Result<Vec<_>>>();
            config.axes = axes.map_err(|e| e.unknown_in("factors"))?;
            let mut names: Vec<&str> = config.axes.iter().map(|a| a.factor.as_str()).collect();
            names.sort_unstable();
            names.dedup();
            if names.is_empty() || names.len() < factors.len() {
                let allowed = "some of density, friction, restitution, each once";
                return Err(Error::input("factors", format!("{factors:?}"), allowed));
            }
        }
        config.points = self.points.map_or(config.points, |n| n as usize);
        if let Some(actions) = self.actions {
            match config.route {
                EvaluationMethod::Ideal => config.actions = actions as usize,
                EvaluationMethod::Dqn => {
                    check_count("actions", Some(actions), 1, MAX_LABELS)?;
                    config.labels = actions as usize;
                }
            }
        }
        config.seed = self.seed.unwrap_or(0);
        config.validate()?;
        Ok(config)
    }
}
