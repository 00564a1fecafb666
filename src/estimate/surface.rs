//! Performance surface: performance, in a related known environment, of a policy trained at given latents.
//!
//! P(theta) is the jump-start performance (AUCCESS, [0, 1]) of a policy learned in a simulation with latents
//! theta and tested in an environment with known physics that differs from the simulation. Its gradient shows
//! which latents the task needs (partial grounding), before any real trial.
//!
//! Source: Semage et al., section on partial grounding and algorithm 2.
//!
//! Differences from the source: P is evaluated at a few design points and interpolated by a Gaussian process
//! ([`super::gp`]) with its uncertainty; the source computes a dense grid and finite differences.
//! `experiment::surface` computes the performance of a point.
//!
//! A [`PerformanceSurface`] is plain data; a [`SurfacePredictor`] evaluates it.

use serde::{Deserialize, Serialize};

use super::gp::{GaussianProcess, GpHyperparameters, GpPrediction};
use crate::error::{Error, Result, check_format, check_range};
use crate::explore::Importance;
use crate::names::names;
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::world::latent::{FACTORS, factor_index};
use rand::RngExt;

/// Value of [`Surface::format`].
pub const FORMAT: &str = "iplw.surface/1";

/// Performance over latents: design points and the fitted surrogate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerformanceSurface {
    /// Always [`FORMAT`].
    pub format: String,
    /// Version of the program that computed it.
    pub program: String,
    /// Name of the task family.
    pub family: String,
    /// Method that computed the performance.
    pub route: EvaluationMethod,
    /// The related environments; a point's performance is the mean over them.
    pub related: Vec<RelatedEnvironment>,
    /// The varied factors and their ranges.
    pub axes: Vec<SurfaceAxis>,
    /// Values of latents that are not varied: density (kg/m^2), friction, restitution.
    pub base: [f64; 3],
    /// Number of tasks that count: those with a solution in a related environment.
    pub tasks: usize,
    pub points: Vec<SurfacePoint>,
    /// Hyperparameters of the Gaussian process; length scales are in shares of the axes' ranges.
    pub surrogate: GpHyperparameters,
    pub seed: u64,
}

/// Method that computes the performance of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EvaluationMethod {
    /// Actions that solve the task in simulation are tried first, in random order; no learning.
    Ideal,
    /// A DQN is trained in simulation, as in the source.
    Dqn,
}

/// A related environment with known physics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RelatedEnvironment {
    /// Density (kg/m^2), friction, restitution.
    pub latents: [f64; 3],
    /// Effects that the simulation lacks.
    pub effects: Vec<EffectTerm>,
}

/// A latent factor and the range over which it is varied.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceAxis {
    /// Name of the factor.
    pub factor: String,
    pub low: f64,
    pub high: f64,
}

/// Performance at one design point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfacePoint {
    /// Density (kg/m^2), friction, restitution.
    pub latents: [f64; 3],
    /// Mean over the related environments, [0, 1].
    pub performance: f64,
    /// Performance in each related environment.
    pub each: Vec<f64>,
}

/// A surface with its factorised surrogate.
pub struct SurfacePredictor<'a> {
    surface: &'a PerformanceSurface,
    gp: GaussianProcess,
}

/// Dependence of performance on one latent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LatentSensitivity {
    /// Name of the factor.
    pub factor: String,
    /// Mean magnitude of the partial derivative, AUCCESS per unit of the factor.
    pub slope: f64,
    /// Mean pointwise standard deviation of the partial derivative. A slope below it is not significant at a
    /// single point; the mean over points is more precise.
    pub sd: f64,
    /// Slope times the prior's standard deviation: AUCCESS at stake in not knowing the latent.
    pub stake: f64,
}

/// Half width of an axis in prior standard deviations.
const AXIS_HALF_WIDTH_SD: f64 = 2.0;

impl SurfacePoint {
    /// A point whose performance is the mean of `each`.
    pub fn mean(latents: [f64; 3], each: Vec<f64>) -> SurfacePoint {
        SurfacePoint { latents, performance: each.iter().sum::<f64>() / each.len() as f64, each }
    }
}

impl SurfaceAxis {
    /// Axis of a factor: prior mean plus and minus [`AXIS_HALF_WIDTH_SD`] standard deviations, within the
    /// factor's bounds.
    pub fn from_prior(factor: &str, prior: [(f64, f64); 3]) -> Result<SurfaceAxis> {
        let i = factor_index(factor)?;
        let [least, most] = FACTORS[i].bounds;
        let (mean, sd) = prior[i];
        let low = (mean - AXIS_HALF_WIDTH_SD * sd).max(if i == 0 { 0.1 * mean } else { least });
        Ok(SurfaceAxis {
            factor: FACTORS[i].name.into(),
            low,
            high: (mean + AXIS_HALF_WIDTH_SD * sd).min(most),
        })
    }

    /// Index into [`FACTORS`].
    pub fn index(&self) -> usize {
        FACTORS.iter().position(|f| f.name == self.factor).unwrap_or(0)
    }

    fn validate(&self) -> Result<()> {
        let i = factor_index(&self.factor)?;
        let [least, most] = FACTORS[i].bounds;
        check_range("low", self.low, least, most)?;
        check_range("high", self.high, least, most)?;
        if self.low >= self.high {
            return Err(Error::input("high", self.high, format!("more than low, {}", self.low)));
        }
        Ok(())
    }
}

/// `count` quasi-random points in the box of the axes: a Halton sequence with a seeded shift.
pub fn halton_design(axes: &[SurfaceAxis], base: [f64; 3], count: usize, seed: u64) -> Vec<[f64; 3]> {
    let mut stream = rng::stream(seed, "surface design");
    let shifts: Vec<f64> = axes.iter().map(|_| stream.random()).collect();
    let unit = |k: usize, i: usize| (van_der_corput(k as u64 + 1, [2, 3, 5][i % 3]) + shifts[i]).fract();
    (0..count).map(|k| point_in_box(axes, base, |i| unit(k, i))).collect()
}

/// Full grid with `side` values per axis, ends included.
pub fn grid(axes: &[SurfaceAxis], base: [f64; 3], side: usize) -> Vec<[f64; 3]> {
    let step = |k: usize| k as f64 / (side - 1).max(1) as f64;
    (0..side.pow(axes.len() as u32))
        .map(|n| point_in_box(axes, base, |i| step(n / side.pow(i as u32) % side)))
        .collect()
}

fn point_in_box(axes: &[SurfaceAxis], base: [f64; 3], unit: impl Fn(usize) -> f64) -> [f64; 3] {
    let mut latents = base;
    for (i, axis) in axes.iter().enumerate() {
        latents[axis.index()] = axis.low + unit(i) * (axis.high - axis.low);
    }
    latents
}

/// The k-th number of the van der Corput sequence in a base, [0, 1).
fn van_der_corput(mut k: u64, base: u64) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0);
    while k > 0 {
        digit /= base as f64;
        value += digit * (k % base) as f64;
        k /= base;
    }
    value
}

impl PerformanceSurface {
    /// Fits the surrogate to the points.
    pub fn fit(mut self) -> Result<PerformanceSurface> {
        let inputs: Vec<Vec<f64>> = self.points.iter().map(|p| self.normalise(p.latents)).collect();
        let values: Vec<f64> = self.points.iter().map(|p| p.performance).collect();
        self.surrogate = GpHyperparameters::fit(&inputs, &values)?;
        self.validate()?;
        Ok(self)
    }

    /// Reads a surface from JSON.
    pub fn from_json(text: &str) -> Result<PerformanceSurface> {
        let surface: PerformanceSurface = crate::json::parse(text)?;
        surface.validate()?;
        Ok(surface)
    }

    /// Writes the surface as JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("numbers and names are always representable") + "\n"
    }

    /// Errors name the invalid field.
    pub fn validate(&self) -> Result<()> {
        check_format(&self.format, FORMAT)?;
        if self.axes.is_empty() || self.axes.len() > FACTORS.len() {
            return Err(Error::input("axes", self.axes.len(), "1 to 3 factors"));
        }
        for (i, axis) in self.axes.iter().enumerate() {
            axis.validate().map_err(|e| e.in_field(&format!("axes[{i}]")))?;
            if self.axes[..i].iter().any(|a| a.factor == axis.factor) {
                let field = format!("axes[{i}].factor");
                return Err(Error::input(field, format!("{:?}", axis.factor), "each factor once"));
            }
        }
        check_range("points", self.points.len() as f64, 3.0, 5000.0)?;
        for (i, point) in self.points.iter().enumerate() {
            check_range(&format!("points[{i}].performance"), point.performance, 0.0, 1.0)?;
            for (factor, v) in FACTORS.iter().zip(point.latents) {
                let field = format!("points[{i}].latents.{}", factor.name);
                check_range(&field, v, factor.bounds[0], factor.bounds[1])?;
            }
        }
        let scales = &self.surrogate.length_scales;
        if scales.len() != self.axes.len() {
            return Err(Error::input("surrogate.length_scales", scales.len(), "one for each axis"));
        }
        for (name, v) in scales.iter().map(|l| ("length_scales", *l)).chain([
            ("signal", self.surrogate.signal),
            ("noise", self.surrogate.noise),
            ("mean", self.surrogate.mean.abs()),
        ]) {
            check_range(&format!("surrogate.{name}"), v, if name == "mean" { 0.0 } else { 1e-12 }, 1e6)?;
        }
        self.predictor().map(|_| ())
    }

    /// Factorises the surrogate; cost is cubic in the number of points.
    pub fn predictor(&self) -> Result<SurfacePredictor<'_>> {
        let inputs = self.points.iter().map(|p| self.normalise(p.latents)).collect();
        let values: Vec<f64> = self.points.iter().map(|p| p.performance).collect();
        Ok(SurfacePredictor {
            surface: self,
            gp: GaussianProcess::new(inputs, &values, self.surrogate.clone())?,
        })
    }

    /// Dependence of performance on each axis' factor, averaged over a prior.
    pub fn sensitivities(&self, prior: [(f64, f64); 3]) -> Result<Vec<LatentSensitivity>> {
        let predictor = self.predictor()?;
        // Grid points within two prior standard deviations, weighted by the prior density.
        let side = [65, 17, 9][(self.axes.len() - 1).min(2)];
        let at: Vec<([f64; 3], f64)> = grid(&self.axes, self.base, side)
            .into_iter()
            .map(|l| {
                let z2 = |a: &SurfaceAxis| ((l[a.index()] - prior[a.index()].0) / prior[a.index()].1).powi(2);
                (l, libm::exp(-0.5 * self.axes.iter().map(z2).sum::<f64>()))
            })
            .collect();
        let total: f64 = at.iter().map(|(_, w)| w).sum();
        let slopes: Vec<([GpPrediction; 3], f64)> =
            at.iter().map(|(l, w)| (predictor.gradient(*l), w / total)).collect();
        Ok(self
            .axes
            .iter()
            .map(|axis| {
                let i = axis.index();
                let slope = slopes.iter().map(|(g, w)| w * g[i].mean.abs()).sum::<f64>();
                let sd = slopes.iter().map(|(g, w)| w * g[i].sd).sum();
                LatentSensitivity { factor: axis.factor.clone(), slope, sd, stake: slope * prior[i].1 }
            })
            .collect())
    }

    /// Latents as shares of the axes' ranges, clamped to [0, 1].
    fn normalise(&self, latents: [f64; 3]) -> Vec<f64> {
        let share = |a: &SurfaceAxis| ((latents[a.index()] - a.low) / (a.high - a.low)).clamp(0.0, 1.0);
        self.axes.iter().map(share).collect()
    }
}

impl SurfacePredictor<'_> {
    /// Performance at `latents`; outside the ranges that of the nearest point inside.
    pub fn predict(&self, latents: [f64; 3]) -> GpPrediction {
        self.gp.at(&self.surface.normalise(latents))
    }

    /// Partial derivatives by density (per kg/m^2), friction and restitution; 0 for a factor that was not varied.
    pub fn gradient(&self, latents: [f64; 3]) -> [GpPrediction; 3] {
        let mut found = [GpPrediction { mean: 0.0, sd: 0.0 }; 3];
        let slopes = self.gp.gradient(&self.surface.normalise(latents));
        for (axis, slope) in self.surface.axes.iter().zip(slopes) {
            let range = axis.high - axis.low;
            found[axis.index()] = GpPrediction { mean: slope.mean / range, sd: slope.sd / range };
        }
        found
    }
}

impl Importance for PerformanceSurface {
    fn gradient(&self, latents: [f64; 3]) -> [f64; 3] {
        // A validated surface has a predictor; an unchecked one may not.
        self.predictor().map_or([f64::NAN; 3], |p| p.gradient(latents).map(|b| b.mean))
    }
}

names!(EvaluationMethod: Ideal = "ideal", Dqn = "dqn");

impl EvaluationMethod {
    /// The route named `name`.
    pub fn from_name(name: &str) -> Result<EvaluationMethod> {
        let known = EvaluationMethod::ALL.map(EvaluationMethod::name);
        EvaluationMethod::named(name).ok_or_else(|| Error::not_found("route", name, known))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRIOR: [(f64, f64); 3] = [(1.0, 0.5), (1.0, 0.5), (0.5, 0.25)];

    fn axes() -> Vec<SurfaceAxis> {
        ["friction", "restitution"].map(|f| SurfaceAxis::from_prior(f, PRIOR).unwrap()).to_vec()
    }

    /// Performance decreases from friction 1, restitution 0.5, ten times as fast along restitution.
    fn hill() -> PerformanceSurface {
        let base = [1.0, 1.0, 0.5];
        let points = halton_design(&axes(), base, 40, 1).into_iter().map(|latents| {
            let drop = 0.05 * (latents[1] - 1.0).powi(2) + 0.5 * (latents[2] - 0.5).powi(2);
            SurfacePoint::mean(latents, vec![0.9 - drop])
        });
        PerformanceSurface {
            format: FORMAT.into(),
            program: "test".into(),
            family: "bowling".into(),
            route: EvaluationMethod::Ideal,
            related: vec![],
            axes: axes(),
            base,
            tasks: 1,
            points: points.collect(),
            surrogate: GpHyperparameters { length_scales: vec![], mean: 0.0, signal: 1.0, noise: 1.0 },
            seed: 1,
        }
        .fit()
        .unwrap()
    }

    #[test]
    fn gradient_is_per_unit_of_the_factor() {
        let surface = hill();
        let [density, friction, restitution] = Importance::gradient(&surface, [3.0, 1.6, 0.8]);
        assert_eq!(density, 0.0, "density was not varied");
        assert!((friction + 0.06).abs() < 0.02, "{friction}");
        assert!((restitution + 0.3).abs() < 0.03, "{restitution}");
        let there = surface.predictor().unwrap().predict([1.0, 1.0, 0.5]);
        assert!((there.mean - 0.9).abs() < 0.01 && there.sd < 0.02, "{there:?}");
        // No extrapolation: outside the ranges the value at the border.
        let predictor = surface.predictor().unwrap();
        assert_eq!(predictor.predict([1.0, 9.0, 0.5]), predictor.predict([1.0, 2.0, 0.5]));
        let felt = surface.sensitivities(PRIOR).unwrap();
        assert_eq!(felt[1].factor, "restitution");
        assert!(felt[1].slope / felt[0].slope > 3.5 && felt[1].slope > felt[1].sd, "{felt:?}");
        assert!((felt[0].stake - 0.5 * felt[0].slope).abs() < 1e-12);
    }

    #[test]
    fn json_round_trip_is_exact_and_rejects_invalid_fields() {
        let surface = hill();
        let text = surface.to_json();
        assert_eq!(PerformanceSurface::from_json(&text).unwrap(), surface);
        let refused = |from: &str, to: &str, field: &str| {
            assert!(text.contains(from), "{from}");
            match PerformanceSurface::from_json(&text.replacen(from, to, 1)) {
                Err(Error::Input(i)) => assert!(i.field.contains(field), "{i}"),
                other => panic!("{from} -> {to}: {:?}", other.map(|_| "taken")),
            }
        };
        refused("iplw.surface/1", "iplw.surface/9", "format");
        refused("\"high\": 2.0", "\"high\": -1.0", "axes[0].high");
        refused("\"factor\": \"restitution\"", "\"factor\": \"friction\"", "axes[1].factor");
        refused("\"performance\": 0.", "\"performance\": 7.", "points[0].performance");
    }

    #[test]
    fn designs_cover_the_box_evenly() {
        let base = [0.3, 9.0, 9.0];
        let check = |all: Vec<[f64; 3]>| {
            for l in &all {
                assert!(l[0] == 0.3 && (0.0..=2.0).contains(&l[1]) && (0.0..=1.0).contains(&l[2]), "{l:?}");
            }
            // Every quarter of the box has its share of points.
            for (f, r) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let there = all.iter().filter(|l| ((l[1] >= 1.0) as i32, (l[2] >= 0.5) as i32) == (f, r));
                let share = there.count() as f64 / all.len() as f64;
                assert!((share - 0.25).abs() < 0.08, "{share}");
            }
        };
        check(halton_design(&axes(), base, 40, 5));
        check(grid(&axes(), base, 8));
        assert_eq!(grid(&axes(), base, 8).len(), 64);
        assert_ne!(halton_design(&axes(), base, 4, 5), halton_design(&axes(), base, 4, 6));
        assert_eq!(halton_design(&axes(), base, 4, 5), halton_design(&axes(), base, 8, 5)[..4]);
    }
}
