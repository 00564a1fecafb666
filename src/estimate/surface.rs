//! Performance surfaces: how well a policy trained at given latents does in a related, known environment.
//!
//! P(theta) is the jump-start performance (AUCCESS, [0, 1]) of what is learned in a simulation with latents theta and
//! tried in an environment whose physics is known and is not the simulation's. Its slope says which latents the task
//! needs (partial grounding), before the real world is touched.
//!
//! Source: Semage et al., section on partial grounding and algorithm 2. Differences from the source: P is known at a
//! few design points and a Gaussian process ([`super::gp`]) fills the rest in, with its uncertainty, where the source
//! computes a dense grid and takes finite differences. How a point's performance is found is `experiment::surface`.
//!
//! A [`Surface`] is plain data; [`Predictor`] is it ready to answer.

use serde::{Deserialize, Serialize};

use super::gp::{Belief, Gp, Hyper};
use crate::error::{Error, Result, within};
use crate::explore::Importance;
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::world::latent::{FACTORS, factor_index};
use rand::RngExt;

/// Value of [`Surface::format`].
pub const FORMAT: &str = "iplw.surface/1";

/// Performance over latents, as points and what is fitted to them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Surface {
    /// Always [`FORMAT`].
    pub format: String,
    /// Version of the program that made it.
    pub program: String,
    /// Name of the task family.
    pub family: String,
    /// How performance was found.
    pub route: Route,
    /// The related environments; a point's performance is the mean over them.
    pub related: Vec<Related>,
    /// What was varied, each over a range.
    pub axes: Vec<Axis>,
    /// Latents where they are not varied: density (kg/m^2), friction, restitution.
    pub base: [f64; 3],
    /// Tasks that counted: those that something solves in a related environment.
    pub tasks: usize,
    pub points: Vec<Point>,
    /// Fitted to the points; length scales are in shares of the axes' ranges.
    pub surrogate: Hyper,
    pub seed: u64,
}

/// How a point's performance is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Route {
    /// Actions that the simulation says solve are tried first, in random order: no learning.
    Ideal,
    /// A DQN is trained in the simulation (the source's way).
    Dqn,
}

/// An environment whose physics is known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Related {
    /// Density (kg/m^2), friction, restitution.
    pub latents: [f64; 3],
    /// Effects that the simulation does not have.
    pub effects: Vec<EffectTerm>,
}

/// A latent factor and the range over which it is varied.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// Name of the factor.
    pub factor: String,
    pub low: f64,
    pub high: f64,
}

/// The performance at one place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// Density (kg/m^2), friction, restitution.
    pub latents: [f64; 3],
    /// Mean over the related environments, [0, 1].
    pub performance: f64,
    /// In each of them.
    pub each: Vec<f64>,
}

/// A surface ready to answer.
pub struct Predictor<'a> {
    surface: &'a Surface,
    gp: Gp,
}

/// How much performance depends on one latent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sensitivity {
    /// Name of the factor.
    pub factor: String,
    /// Mean magnitude of the partial derivative, AUCCESS per unit of the factor.
    pub slope: f64,
    /// Mean standard deviation of the partial derivative at a place: there, a slope below it is not known to be one.
    /// The mean over places is known better.
    pub sd: f64,
    /// The slope times the prior's standard deviation: AUCCESS at stake in not knowing the latent.
    pub stake: f64,
}

/// Standard deviations of the prior on either side of its mean that a surface covers.
const REACH: f64 = 2.0;

impl Point {
    /// The point whose performance is the mean of `each`.
    pub fn mean(latents: [f64; 3], each: Vec<f64>) -> Point {
        Point { latents, performance: each.iter().sum::<f64>() / each.len() as f64, each }
    }
}

impl Axis {
    /// The factor over its prior's mean and [`REACH`] deviations on either side, within what a world accepts.
    pub fn of_prior(factor: &str, prior: [(f64, f64); 3]) -> Result<Axis> {
        let i = factor_index(factor)?;
        let [least, most] = FACTORS[i].bounds;
        let (mean, sd) = prior[i];
        let low = (mean - REACH * sd).max(if i == 0 { 0.1 * mean } else { least });
        Ok(Axis { factor: FACTORS[i].name.into(), low, high: (mean + REACH * sd).min(most) })
    }

    /// Index into [`FACTORS`].
    pub fn index(&self) -> usize {
        FACTORS.iter().position(|f| f.name == self.factor).unwrap_or(0)
    }

    fn validate(&self) -> Result<()> {
        let i = factor_index(&self.factor)?;
        let [least, most] = FACTORS[i].bounds;
        within("low", self.low, least, most)?;
        within("high", self.high, least, most)?;
        if self.low >= self.high {
            return Err(Error::input("high", self.high, format!("more than low, {}", self.low)));
        }
        Ok(())
    }
}

/// `count` latents that fill the box of the axes evenly: a Halton sequence, shifted by the seed.
pub fn design(axes: &[Axis], base: [f64; 3], count: usize, seed: u64) -> Vec<[f64; 3]> {
    let mut stream = rng::stream(seed, "surface design");
    let shifts: Vec<f64> = axes.iter().map(|_| stream.random()).collect();
    let unit = |k: usize, i: usize| (halton(k as u64 + 1, [2, 3, 5][i % 3]) + shifts[i]).fract();
    (0..count).map(|k| place(axes, base, |i| unit(k, i))).collect()
}

/// All latents of a grid with `side` values an axis, ends included.
pub fn grid(axes: &[Axis], base: [f64; 3], side: usize) -> Vec<[f64; 3]> {
    let step = |k: usize| k as f64 / (side - 1).max(1) as f64;
    (0..side.pow(axes.len() as u32))
        .map(|n| place(axes, base, |i| step(n / side.pow(i as u32) % side)))
        .collect()
}

fn place(axes: &[Axis], base: [f64; 3], unit: impl Fn(usize) -> f64) -> [f64; 3] {
    let mut latents = base;
    for (i, axis) in axes.iter().enumerate() {
        latents[axis.index()] = axis.low + unit(i) * (axis.high - axis.low);
    }
    latents
}

/// The k-th number of the van der Corput sequence in a base, [0, 1).
fn halton(mut k: u64, base: u64) -> f64 {
    let (mut value, mut digit) = (0.0, 1.0);
    while k > 0 {
        digit /= base as f64;
        value += digit * (k % base) as f64;
        k /= base;
    }
    value
}

impl Surface {
    /// The surface with its surrogate fitted to its points.
    pub fn fitted(mut self) -> Result<Surface> {
        let inputs: Vec<Vec<f64>> = self.points.iter().map(|p| self.unit(p.latents)).collect();
        let values: Vec<f64> = self.points.iter().map(|p| p.performance).collect();
        self.surrogate = Hyper::fit(&inputs, &values)?;
        self.validate()?;
        Ok(self)
    }

    /// Reads what [`Surface::to_json`] wrote.
    pub fn from_json(text: &str) -> Result<Surface> {
        let surface: Surface = crate::json::parse(text)?;
        surface.validate()?;
        Ok(surface)
    }

    /// For a file.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("numbers and names are always representable") + "\n"
    }

    /// Errors name what is wrong.
    pub fn validate(&self) -> Result<()> {
        if self.format != FORMAT {
            return Err(Error::input("format", format!("{:?}", self.format), format!("{FORMAT:?}")));
        }
        if self.axes.is_empty() || self.axes.len() > FACTORS.len() {
            return Err(Error::input("axes", self.axes.len(), "1 to 3 factors"));
        }
        for (i, axis) in self.axes.iter().enumerate() {
            axis.validate().map_err(|e| e.under(&format!("axes[{i}]")))?;
            if self.axes[..i].iter().any(|a| a.factor == axis.factor) {
                let field = format!("axes[{i}].factor");
                return Err(Error::input(field, format!("{:?}", axis.factor), "each factor once"));
            }
        }
        within("points", self.points.len() as f64, 3.0, 5000.0)?;
        for (i, point) in self.points.iter().enumerate() {
            within(&format!("points[{i}].performance"), point.performance, 0.0, 1.0)?;
            for (factor, v) in FACTORS.iter().zip(point.latents) {
                let field = format!("points[{i}].latents.{}", factor.name);
                within(&field, v, factor.bounds[0], factor.bounds[1])?;
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
            within(&format!("surrogate.{name}"), v, if name == "mean" { 0.0 } else { 1e-12 }, 1e6)?;
        }
        self.predictor().map(|_| ())
    }

    /// Ready to answer; work of the cube of the number of points.
    pub fn predictor(&self) -> Result<Predictor<'_>> {
        let inputs = self.points.iter().map(|p| self.unit(p.latents)).collect();
        let values: Vec<f64> = self.points.iter().map(|p| p.performance).collect();
        Ok(Predictor { surface: self, gp: Gp::new(inputs, &values, self.surrogate.clone())? })
    }

    /// How much performance depends on each axis' factor, averaged over what a prior holds likely.
    pub fn sensitivities(&self, prior: [(f64, f64); 3]) -> Result<Vec<Sensitivity>> {
        let predictor = self.predictor()?;
        // The box is the prior's within two deviations; points of an even grid are weighed by the prior.
        let side = [65, 17, 9][(self.axes.len() - 1).min(2)];
        let at: Vec<([f64; 3], f64)> = grid(&self.axes, self.base, side)
            .into_iter()
            .map(|l| {
                let z2 = |a: &Axis| ((l[a.index()] - prior[a.index()].0) / prior[a.index()].1).powi(2);
                (l, libm::exp(-0.5 * self.axes.iter().map(z2).sum::<f64>()))
            })
            .collect();
        let total: f64 = at.iter().map(|(_, w)| w).sum();
        let slopes: Vec<([Belief; 3], f64)> =
            at.iter().map(|(l, w)| (predictor.gradient(*l), w / total)).collect();
        Ok(self
            .axes
            .iter()
            .map(|axis| {
                let i = axis.index();
                let slope = slopes.iter().map(|(g, w)| w * g[i].mean.abs()).sum::<f64>();
                let sd = slopes.iter().map(|(g, w)| w * g[i].sd).sum();
                Sensitivity { factor: axis.factor.clone(), slope, sd, stake: slope * prior[i].1 }
            })
            .collect())
    }

    /// Latents as shares of the axes' ranges, moved to the nearest within.
    fn unit(&self, latents: [f64; 3]) -> Vec<f64> {
        let share = |a: &Axis| ((latents[a.index()] - a.low) / (a.high - a.low)).clamp(0.0, 1.0);
        self.axes.iter().map(share).collect()
    }
}

impl Predictor<'_> {
    /// Performance at `latents`; outside the axes' ranges that of the nearest place within.
    pub fn at(&self, latents: [f64; 3]) -> Belief {
        self.gp.at(&self.surface.unit(latents))
    }

    /// Partial derivatives by density (per kg/m^2), friction and restitution; 0 for a factor that was not varied.
    pub fn gradient(&self, latents: [f64; 3]) -> [Belief; 3] {
        let mut found = [Belief { mean: 0.0, sd: 0.0 }; 3];
        let slopes = self.gp.gradient(&self.surface.unit(latents));
        for (axis, slope) in self.surface.axes.iter().zip(slopes) {
            let range = axis.high - axis.low;
            found[axis.index()] = Belief { mean: slope.mean / range, sd: slope.sd / range };
        }
        found
    }
}

impl Importance for Surface {
    fn gradient(&self, latents: [f64; 3]) -> [f64; 3] {
        // A surface that was checked has a predictor; one put together by hand may not.
        self.predictor().map_or([f64::NAN; 3], |p| p.gradient(latents).map(|b| b.mean))
    }
}

impl Route {
    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Route::Ideal => "ideal",
            Route::Dqn => "dqn",
        }
    }

    /// The route named `name`.
    pub fn from_name(name: &str) -> Result<Route> {
        let all = [Route::Ideal, Route::Dqn];
        all.into_iter().find(|r| r.name() == name).ok_or_else(|| Error::NotFound {
            kind: "route",
            id: name.to_string(),
            known: all.map(|r| r.name().to_string()).to_vec(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRIOR: [(f64, f64); 3] = [(1.0, 0.5), (1.0, 0.5), (0.5, 0.25)];

    fn axes() -> Vec<Axis> {
        ["friction", "restitution"].map(|f| Axis::of_prior(f, PRIOR).unwrap()).to_vec()
    }

    /// Performance falls off from friction 1, restitution 0.5, ten times as fast along restitution.
    fn hill() -> Surface {
        let base = [1.0, 1.0, 0.5];
        let points = design(&axes(), base, 40, 1).into_iter().map(|latents| {
            let drop = 0.05 * (latents[1] - 1.0).powi(2) + 0.5 * (latents[2] - 0.5).powi(2);
            Point::mean(latents, vec![0.9 - drop])
        });
        Surface {
            format: FORMAT.into(),
            program: "test".into(),
            family: "bowling".into(),
            route: Route::Ideal,
            related: vec![],
            axes: axes(),
            base,
            tasks: 1,
            points: points.collect(),
            surrogate: Hyper { length_scales: vec![], mean: 0.0, signal: 1.0, noise: 1.0 },
            seed: 1,
        }
        .fitted()
        .unwrap()
    }

    #[test]
    fn slopes_are_per_unit_of_the_factor() {
        let surface = hill();
        let [density, friction, restitution] = Importance::gradient(&surface, [3.0, 1.6, 0.8]);
        assert_eq!(density, 0.0, "density was not varied");
        assert!((friction + 0.06).abs() < 0.02, "{friction}");
        assert!((restitution + 0.3).abs() < 0.03, "{restitution}");
        let there = surface.predictor().unwrap().at([1.0, 1.0, 0.5]);
        assert!((there.mean - 0.9).abs() < 0.01 && there.sd < 0.02, "{there:?}");
        // Beyond the ranges nothing is made up: the border's answer.
        let predictor = surface.predictor().unwrap();
        assert_eq!(predictor.at([1.0, 9.0, 0.5]), predictor.at([1.0, 2.0, 0.5]));
        let felt = surface.sensitivities(PRIOR).unwrap();
        assert_eq!(felt[1].factor, "restitution");
        assert!(felt[1].slope / felt[0].slope > 3.5 && felt[1].slope > felt[1].sd, "{felt:?}");
        assert!((felt[0].stake - 0.5 * felt[0].slope).abs() < 1e-12);
    }

    #[test]
    fn it_comes_back_from_a_file_to_the_bit_and_nonsense_is_refused_by_name() {
        let surface = hill();
        let text = surface.to_json();
        assert_eq!(Surface::from_json(&text).unwrap(), surface);
        let refused = |from: &str, to: &str, field: &str| {
            assert!(text.contains(from), "{from}");
            match Surface::from_json(&text.replacen(from, to, 1)) {
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
    fn designs_fill_the_box() {
        let base = [0.3, 9.0, 9.0];
        let check = |all: Vec<[f64; 3]>| {
            for l in &all {
                assert!(l[0] == 0.3 && (0.0..=2.0).contains(&l[1]) && (0.0..=1.0).contains(&l[2]), "{l:?}");
            }
            // Every quarter of the box has its share.
            for (f, r) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let there = all.iter().filter(|l| ((l[1] >= 1.0) as i32, (l[2] >= 0.5) as i32) == (f, r));
                let share = there.count() as f64 / all.len() as f64;
                assert!((share - 0.25).abs() < 0.08, "{share}");
            }
        };
        check(design(&axes(), base, 40, 5));
        check(grid(&axes(), base, 8));
        assert_eq!(grid(&axes(), base, 8).len(), 64);
        assert_ne!(design(&axes(), base, 4, 5), design(&axes(), base, 4, 6));
        assert_eq!(design(&axes(), base, 4, 5), design(&axes(), base, 8, 5)[..4]);
    }
}
