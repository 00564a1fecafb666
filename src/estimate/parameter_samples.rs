//! Samples of a world's parameters: equally weighted draws of latents and effects.
//!
//! A point estimate, draws of a prior and draws of a posterior (`iplw.posterior/2`) all have this form, so
//! planning does not depend on their origin.
//!
//! Differences from standard practice: normal priors are truncated at the factors' bounds by rejection, so that
//! no draw accumulates at a bound.

use std::collections::BTreeMap;

use rand::seq::SliceRandom;
use rand_distr::{Distribution, Normal};
use serde::{Deserialize, Serialize};

use super::discrepancy_forces::DiscrepancyForces;
use crate::error::{Error, Result, check_range};
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::world::effect::ParameterRole;
use crate::world::latent::{FACTORS, clamp};
use crate::world::{EffectParameter, Latents, effect};

/// Format identifier of a posterior document.
pub const POSTERIOR_FORMAT: &str = "iplw.posterior/2";
/// The previous format, which has `unnamed` instead of `discrepancy`.
const PREVIOUS_POSTERIOR_FORMAT: &str = "iplw.posterior/1";
/// Number of draws that represent a prior; more than planning uses.
pub const PRIOR_SAMPLE_COUNT: usize = 1024;
/// Limits of a posterior document; one of this size is read in about a second.
pub const MAX_DRAWS: usize = 100_000;
const MAX_COLUMNS: usize = 64;
const MAX_EFFECTS: usize = 32;
/// Maximum number of effect terms over all draws.
const MAX_TERMS_OVER_ALL_DRAWS: usize = 400_000;
/// Rejected draws of a truncated normal before the mean is used instead.
const MAX_REDRAWS: usize = 1000;

/// A non-empty set of equally weighted parameter draws.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterSamples {
    source: SampleSource,
    draws: Vec<ParameterSample>,
}

/// One draw of a world's parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ParameterSample {
    /// Latent factors; `None` keeps the scene's value.
    pub latents: Latents,
    /// Effects in addition to the scene's.
    pub effects: Vec<EffectTerm>,
    /// Number of effects, at the end of the list, that represent model discrepancy (a force without a named
    /// effect).
    #[serde(skip_serializing_if = "is_zero")]
    pub unnamed: usize,
}

fn is_zero(number: &usize) -> bool {
    *number == 0
}

/// Origin of a set of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SampleSource {
    /// A point estimate, or the truth (oracle).
    Point,
    /// Draws of the prior.
    Prior,
    /// Draws of the posterior.
    Posterior,
}

/// The fields of a posterior document that are read; other fields are ignored.
#[derive(Deserialize)]
struct PosteriorColumns {
    format: String,
    columns: BTreeMap<String, Vec<Option<f64>>>,
    #[serde(default)]
    effects: Vec<EffectTerm>,
    #[serde(default)]
    discrepancy: Vec<DiscrepancyForces>,
}

impl ParameterSample {
    /// A draw without discrepancy terms.
    pub fn new(latents: Latents, effects: Vec<EffectTerm>) -> ParameterSample {
        ParameterSample { latents, effects, unnamed: 0 }
    }

    /// The effects without the discrepancy terms.
    pub fn named_effects(&self) -> &[EffectTerm] {
        &self.effects[..self.effects.len().saturating_sub(self.unnamed)]
    }

    /// Errors name the invalid latent, effect or count.
    pub fn validate(&self) -> Result<()> {
        self.latents.validate()?;
        check_range("unnamed", self.unnamed as f64, 0.0, self.effects.len() as f64)?;
        effect::validate_terms(&self.effects)
    }

    /// Value of a latent (`friction`) or an effect's parameter (`linear_drag.c`); `None` if the draw does not
    /// have it.
    pub fn value(&self, name: &str) -> Option<f64> {
        if let Some(factor) = FACTORS.iter().position(|f| f.name == name) {
            return self.latents.values()[factor];
        }
        let (effect, parameter) = name.split_once('.')?;
        self.named_effects().iter().find(|e| e.name == effect)?.parameters.get(parameter).copied()
    }
}

impl ParameterSamples {
    /// A single draw.
    pub fn point(latents: Latents, effects: Vec<EffectTerm>) -> Result<ParameterSamples> {
        let world = ParameterSample::new(latents, effects);
        world.validate()?;
        Ok(ParameterSamples { source: SampleSource::Point, draws: vec![world] })
    }

    /// `count` draws of independent truncated normals, given as (mean, standard deviation) of density, friction
    /// and restitution. Every draw has the same `effects`.
    pub fn prior(
        prior: [(f64, f64); 3],
        effects: Vec<EffectTerm>,
        count: usize,
        seed: u64,
    ) -> Result<ParameterSamples> {
        effect::validate_terms(&effects)?;
        check_range("draws", count as f64, 1.0, MAX_DRAWS as f64)?;
        let mut normals = Vec::with_capacity(FACTORS.len());
        for (factor, (mean, sd)) in FACTORS.iter().zip(prior) {
            let normal = Normal::new(mean, sd).ok().filter(|_| mean.is_finite() && sd.is_finite());
            let allowed = "a finite mean and a finite, non-negative standard deviation";
            let refused =
                || Error::input(format!("prior.{}", factor.name), format!("({mean}, {sd})"), allowed);
            normals.push(normal.ok_or_else(refused)?);
        }
        let mut stream = rng::stream(seed, "belief prior");
        let mut draw = |i: usize| {
            let [low, high] = FACTORS[i].bounds;
            let mut drawn = (0..MAX_REDRAWS).map(|_| normals[i].sample(&mut stream));
            drawn.find(|v| (low..=high).contains(v)).unwrap_or(prior[i].0)
        };
        let draws = (0..count).map(|_| {
            let values = clamp(std::array::from_fn(&mut draw));
            ParameterSample::new(Latents::of(values), effects.clone())
        });
        Ok(ParameterSamples { source: SampleSource::Prior, draws: draws.collect() })
    }

    /// [`PRIOR_SAMPLE_COUNT`] draws of [`ParameterSamples::prior_over_sets`].
    pub fn standard_prior(
        prior: [(f64, f64); 3],
        sets: &[Vec<String>],
        seed: u64,
    ) -> Result<ParameterSamples> {
        ParameterSamples::prior_over_sets(prior, sets, PRIOR_SAMPLE_COUNT, seed)
    }

    /// `count` draws of the prior, each with one of several sets of effects in turn. Effect parameters are
    /// drawn from their own priors. Fails for an effect with parameters that have no prior because they depend
    /// on the scene.
    pub fn prior_over_sets(
        prior: [(f64, f64); 3],
        sets: &[Vec<String>],
        count: usize,
        seed: u64,
    ) -> Result<ParameterSamples> {
        for (i, set) in sets.iter().enumerate() {
            effect::validate_set(&format!("sets[{i}]"), set)?;
        }
        let mut belief = ParameterSamples::prior(prior, Vec::new(), count, seed)?;
        let mut stream = rng::stream(seed, "belief effects");
        for (i, draw) in belief.draws.iter_mut().enumerate() {
            let Some(set) = sets.get(i % sets.len().max(1)) else { break };
            for (k, name) in set.iter().enumerate() {
                let field = format!("sets[{}][{k}]", i % sets.len());
                draw.effects.push(sample_effect_size(&field, name, &mut stream)?);
            }
        }
        belief.draws.iter().take(sets.len()).try_for_each(|draw| effect::validate_terms(&draw.effects))?;
        Ok(belief)
    }

    /// Reads a posterior document (`iplw.posterior/2`).
    pub fn from_json(text: &str) -> Result<ParameterSamples> {
        ParameterSamples::from_document(crate::json::parse(text)?)
    }

    /// Reads a posterior document from a JSON value.
    pub fn from_value(value: serde_json::Value) -> Result<ParameterSamples> {
        ParameterSamples::from_document(crate::json::from_value(value)?)
    }

    fn from_document(document: PosteriorColumns) -> Result<ParameterSamples> {
        if document.format != POSTERIOR_FORMAT {
            let value = format!("{:?}", document.format);
            let allowed = match document.format == PREVIOUS_POSTERIOR_FORMAT {
                true => format!(
                    "{POSTERIOR_FORMAT:?}: convert the file with release/convert_names.py, or rename its field `unnamed` to `discrepancy`"
                ),
                false => format!("{POSTERIOR_FORMAT:?}"),
            };
            return Err(Error::input("format", value, allowed));
        }
        effect::validate_terms(&document.effects)?;
        let sizes = [
            ("columns", document.columns.len(), MAX_COLUMNS),
            ("effects", document.effects.len(), MAX_EFFECTS),
        ];
        for (field, size, most) in sizes {
            if size > most {
                return Err(Error::input(field, format!("{size} {field}"), format!("at most {most}")));
            }
        }
        let count = draw_count(&document.columns)?;
        let carried = document.discrepancy.iter().map(|u| u.term_count()).sum::<usize>();
        let terms = count * document.effects.len() + carried;
        if terms > MAX_TERMS_OVER_ALL_DRAWS {
            let field = if carried > 0 { "discrepancy" } else { "effects" };
            let value = format!("{terms} effects in {count} draws");
            return Err(Error::input(field, value, format!("at most {MAX_TERMS_OVER_ALL_DRAWS}")));
        }
        let mut draws =
            vec![ParameterSample { effects: document.effects, ..ParameterSample::default() }; count];
        for (name, values) in &document.columns {
            let column = ColumnTarget::parse(name)?;
            for (i, (draw, value)) in draws.iter_mut().zip(values).enumerate() {
                column.write(draw, *value, &format!("columns.{name}[{i}]"))?;
            }
        }
        for (i, forces) in document.discrepancy.iter().enumerate() {
            append_discrepancy_forces(&mut draws, forces)
                .map_err(|e| e.in_field(&format!("discrepancy[{i}]")))?;
        }
        Ok(ParameterSamples { source: SampleSource::Posterior, draws })
    }

    /// Posterior samples from draws that were read before.
    pub fn from_draws(draws: Vec<ParameterSample>) -> Result<ParameterSamples> {
        check_range("draws", draws.len() as f64, 1.0, MAX_DRAWS as f64)?;
        draws.iter().try_for_each(ParameterSample::validate)?;
        Ok(ParameterSamples { source: SampleSource::Posterior, draws })
    }

    /// Origin of the samples.
    pub fn source(&self) -> SampleSource {
        self.source
    }

    /// The draws in document order.
    pub fn draws(&self) -> &[ParameterSample] {
        &self.draws
    }

    /// A seeded permutation of the draws: a prefix is a sample without replacement.
    pub fn shuffled(&self, seed: u64) -> Vec<&ParameterSample> {
        let mut order: Vec<&ParameterSample> = self.draws.iter().collect();
        order.shuffle(&mut rng::stream(seed, "belief order"));
        order
    }
}

/// Appends discrepancy forces to the effects of the draws that have them.
fn append_discrepancy_forces(draws: &mut [ParameterSample], forces: &DiscrepancyForces) -> Result<()> {
    let count = draws.len();
    for (i, (draw, effects)) in forces.by_draw()?.into_iter().enumerate() {
        let Some(own) = draws.get_mut(draw).filter(|own| own.unnamed == 0) else {
            let allowed = format!("an index of a draw below {count}, each draw at most once");
            return Err(Error::input(format!("draws[{i}]"), draw.to_string(), allowed));
        };
        own.unnamed = effects.len();
        own.effects.extend(effects);
    }
    Ok(())
}

/// An effect with amplitudes drawn from their priors.
fn sample_effect_size(field: &str, name: &str, stream: &mut rng::Stream) -> Result<EffectTerm> {
    let effect = effect::find(name)?;
    let mut parameters = BTreeMap::new();
    for parameter in effect.parameters {
        if parameter.role != ParameterRole::Amplitude {
            let allowed = format!(
                "effects whose parameters are all amplitudes: {}.{} has no prior",
                effect.name, parameter.name
            );
            return Err(Error::input(field, format!("{name:?}"), allowed));
        }
        let [low, high] = parameter.bounds;
        let normal = Normal::new(parameter.weak_prior().0, parameter.weak_prior().1)
            .map_err(|e| Error::Failed(e.to_string()))?;
        let mut drawn = (0..MAX_REDRAWS).map(|_| normal.sample(stream));
        let value = drawn.find(|v| (low..=high).contains(v)).unwrap_or(parameter.neutral);
        parameters.insert(parameter.name.to_string(), value);
    }
    Ok(EffectTerm { name: effect.name.into(), parameters })
}

/// The quantity stored in a column.
enum ColumnTarget {
    Factor(usize),
    Parameter(EffectParameter),
}

impl ColumnTarget {
    fn parse(name: &str) -> Result<ColumnTarget> {
        if let Some(factor) = FACTORS.iter().position(|f| f.name == name) {
            return Ok(ColumnTarget::Factor(factor));
        }
        EffectParameter::parse(name).map(ColumnTarget::Parameter).map_err(|_| {
            let allowed = "names of latent factors (density, friction, restitution) or effect parameters (for example linear_drag.c)";
            Error::input(format!("columns.{name}"), "unknown", allowed)
        })
    }

    /// Writes a value into a draw; a missing effect parameter leaves the draw's effects unchanged.
    fn write(&self, draw: &mut ParameterSample, value: Option<f64>, field: &str) -> Result<()> {
        match (self, value) {
            (ColumnTarget::Factor(factor), Some(value)) => {
                let [low, high] = FACTORS[*factor].bounds;
                let value = Some(check_range(field, value, low, high)?);
                match factor {
                    0 => draw.latents.density = value,
                    1 => draw.latents.friction = value,
                    _ => draw.latents.restitution = value,
                }
            }
            (ColumnTarget::Factor(_), None) => {
                return Err(Error::input(field, "null", "a number: every draw needs its latent factors"));
            }
            (ColumnTarget::Parameter(parameter), Some(value)) => {
                let [low, high] = parameter.parameter().bounds;
                let value = check_range(field, value, low, high)?;
                EffectTerm::set_in(
                    &mut draw.effects,
                    parameter.effect.name,
                    parameter.parameter().name,
                    value,
                );
            }
            (ColumnTarget::Parameter(_), None) => {}
        }
        Ok(())
    }
}

/// The common length of all columns.
fn draw_count(columns: &BTreeMap<String, Vec<Option<f64>>>) -> Result<usize> {
    let Some((first, values)) = columns.iter().next() else {
        return Err(Error::input("columns", "empty", "at least one column of draws"));
    };
    for (name, other) in columns {
        let (found, wanted) = (other.len(), values.len());
        if found != wanted {
            let allowed = format!("{wanted} numbers, like columns.{first}");
            return Err(Error::input(format!("columns.{name}"), format!("{found} numbers"), allowed));
        }
    }
    if (1..=MAX_DRAWS).contains(&values.len()) {
        return Ok(values.len());
    }
    let value = format!("{} numbers", values.len());
    Err(Error::input(format!("columns.{first}"), value, format!("1 to {MAX_DRAWS} numbers")))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRIOR: [(f64, f64); 3] = [(1.0, 0.5), (0.5, 0.25), (0.9, 0.25)];

    #[test]
    fn prior_draws_respect_bounds_and_moments() {
        let belief = ParameterSamples::prior(PRIOR, vec![effect::damping(0.8)], 4000, 3).unwrap();
        let of = |factor: usize| belief.draws().iter().map(move |d| d.latents.values()[factor].unwrap());
        for (factor, row) in FACTORS.iter().enumerate() {
            let [low, high] = row.bounds;
            assert!(of(factor).all(|v| (low..=high).contains(&v)));
        }
        let mean = of(1).sum::<f64>() / 4000.0;
        // Normal with mean 0.5 and sd 0.25 truncated below 0: 0.5 + 0.25 phi(2) / Phi(2) = 0.5138.
        assert!((mean - 0.5138).abs() < 0.015, "{mean}");
        // Truncated mass does not accumulate at the bound.
        assert!(of(2).all(|v| v < 1.0));
        assert!(belief.draws().iter().all(|d| d.effects == [effect::damping(0.8)]));
        assert_eq!(belief, ParameterSamples::prior(PRIOR, vec![effect::damping(0.8)], 4000, 3).unwrap());
        assert_ne!(belief, ParameterSamples::prior(PRIOR, vec![effect::damping(0.8)], 4000, 4).unwrap());
    }

    #[test]
    fn shuffle_is_a_seeded_permutation() {
        let belief = ParameterSamples::prior(PRIOR, Vec::new(), 50, 0).unwrap();
        let (one, other) = (belief.shuffled(1), belief.shuffled(2));
        assert_ne!(one, other);
        let mut seen: Vec<f64> = one.iter().filter_map(|d| d.latents.friction).collect();
        seen.sort_by(f64::total_cmp);
        seen.dedup();
        assert_eq!(seen.len(), 50);
    }

    #[test]
    fn reads_columns_into_draws() {
        let text = r#"{"format": "iplw.posterior/2", "log_evidence": -3.5,
            "columns": {"friction": [0.2, 0.3], "linear_drag.c": [0.22, null], "gust.ax": [null, 1.5]},
            "effects": [{"name": "gust", "parameters": {"period": 2.0}}]}"#;
        let belief = ParameterSamples::from_json(text).unwrap();
        let [first, second] = belief.draws() else { panic!("{belief:?}") };
        assert_eq!(first.latents, Latents { friction: Some(0.2), ..Latents::default() });
        let names = |b: &ParameterSample| b.effects.iter().map(|e| e.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(first), ["gust", "linear_drag"]);
        assert_eq!(first.effects[1].parameters["c"], 0.22);
        assert_eq!(names(second), ["gust"]);
        assert_eq!(
            second.effects[0].parameters,
            BTreeMap::from([("ax".into(), 1.5), ("period".into(), 2.0)])
        );
    }

    /// Discrepancy forces follow the named effects, in the draws that have them.
    #[test]
    fn appends_discrepancy_forces_to_their_draws() {
        let of = |discrepancy: &str| {
            let text = format!(
                r#"{{"format": "iplw.posterior/2", "columns": {{"friction": [0.2, 0.3], "linear_drag.c": [0.1, 0.2]}}, "discrepancy": [{discrepancy}]}}"#
            );
            ParameterSamples::from_json(&text)
        };
        let forces = r#"{"set": 0, "over": "powers", "effects": [{"name": "monomial", "parameters": {"pvx": 1}}, {"name": "monomial",
            "parameters": {}}], "draws": [1], "amplitudes": [[-0.5, 0, 0.25, 2]]}"#;
        let belief = of(forces).unwrap();
        let [first, second] = belief.draws() else { panic!("{belief:?}") };
        assert_eq!((first.unnamed, first.effects.len(), second.unnamed), (0, 1, 2));
        assert_eq!(second.named_effects(), &second.effects[..1]);
        assert_eq!(second.effects[1].parameters["ax"], -0.5);
        assert_eq!(second.effects[2].parameters["ay"], 2.0);
        assert_eq!((second.value("linear_drag.c"), second.value("monomial.ax")), (Some(0.2), None));
        let refused = |forces: &str, field: &str| {
            let error = of(forces).unwrap_err().to_string();
            assert!(error.contains(field), "{forces}: {error}");
        };
        refused(&forces.replace("[1]", "[2]"), "discrepancy[0].draws[0]");
        refused(&forces.replace(", 2]]", "]]"), "discrepancy[0].amplitudes[0]");
        refused(&forces.replace("-0.5", "-5000"), "discrepancy[0].amplitudes[0][0]");
        refused(&forces.replace("[1]", "[0, 1]"), "discrepancy[0].amplitudes");
        refused(&forces.replace("monomial", "ether"), "ether");
        refused(&format!("{forces}, {forces}"), "discrepancy[1].draws[0]");
        refused(
            &forces.replace("monomial", "wind").replace(r#""pvx": 1"#, r#""ax": 1"#),
            "discrepancy[0].effects[0]",
        );
        refused(
            &forces.replace(r#""monomial", "parameters": {"pvx": 1}"#, r#""linear_drag", "parameters": {}"#),
            "effects[0]",
        );
        refused(
            &forces.replace(
                r#""monomial", "parameters": {"pvx": 1}"#,
                r#""placement_offset", "parameters": {}"#,
            ),
            "effects[0]",
        );
        let many = vec![r#"{"name": "monomial", "parameters": {}}"#; 129].join(",");
        refused(
            &format!(r#"{{"effects": [{many}], "draws": [], "amplitudes": []}}"#),
            "discrepancy[0].effects",
        );
    }

    #[test]
    fn prior_over_sets_cycles_and_draws_effect_sizes() {
        let sets = [vec![], vec!["linear_drag".to_string()], vec!["wind".into(), "lift".into()]];
        let belief = ParameterSamples::prior_over_sets(PRIOR, &sets, 300, 4).unwrap();
        let with = |set: &[String]| {
            let own = |d: &&ParameterSample| d.effects.iter().map(|e| &e.name).eq(set);
            belief.draws().iter().filter(own).count()
        };
        assert_eq!(sets.each_ref().map(|s| with(s)), [100; 3]);
        let drags: Vec<f64> =
            belief.draws().iter().skip(1).step_by(3).map(|d| d.effects[0].parameters["c"]).collect();
        assert!(drags.iter().all(|c| *c >= 0.0) && drags.windows(2).any(|w| w[0] != w[1]));
        let refused = |name: &str| {
            ParameterSamples::prior_over_sets(PRIOR, &[vec![name.to_string()]], 9, 4).unwrap_err().to_string()
        };
        assert!(refused("sticky_patch").contains("sticky_patch.x_min"), "{}", refused("sticky_patch"));
        assert!(refused("ether").contains("ether"));
        let twice =
            ParameterSamples::prior_over_sets(PRIOR, &[vec![], vec!["wind".into(), "wind".into()]], 9, 4)
                .unwrap_err();
        assert!(twice.to_string().contains("sets[1]"), "{twice}");
    }

    #[test]
    fn rejects_invalid_columns_by_name() {
        let of = |columns: &str| {
            let text = format!(r#"{{"format": "iplw.posterior/2", "columns": {columns}}}"#);
            ParameterSamples::from_json(&text).unwrap_err().to_string()
        };
        let bad = [
            ("{}", "columns"),
            (r#"{"friction": []}"#, "columns.friction"),
            (r#"{"friction": [0.1], "restitution": [0.1, 0.2]}"#, "columns.restitution"),
            (r#"{"friction": [0.1, -1]}"#, "columns.friction[1]"),
            (r#"{"friction": [null]}"#, "columns.friction[0]"),
            (r#"{"grip": [1]}"#, "columns.grip"),
            (r#"{"linear_drag.k": [1]}"#, "columns.linear_drag.k"),
            (r#"{"linear_drag.c": [-1]}"#, "columns.linear_drag.c[0]"),
            (r#"{"friction": ["0.1"]}"#, "columns.friction[0]"),
        ];
        for (columns, wanted) in bad {
            let error = of(columns);
            assert!(error.contains(wanted), "{columns}: {error}");
        }
        let other =
            ParameterSamples::from_json(r#"{"format": "iplw.posterior/9", "columns": {"friction": [1]}}"#);
        assert!(other.unwrap_err().to_string().contains("iplw.posterior/2"));
        let previous =
            ParameterSamples::from_json(r#"{"format": "iplw.posterior/1", "columns": {"friction": [1]}}"#);
        assert!(previous.unwrap_err().to_string().contains("convert_names.py"));
    }
}
