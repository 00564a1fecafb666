//! What is believed of a world: equally likely draws of its latents and effects.
//!
//! A point, draws of a family's prior, or the draws of a posterior (`iplw.posterior/1`) are all such draws, so that whoever
//! plans under a belief need not know where it came from.
//!
//! Differences from the usual: the prior's normals are cut off at the factors' bounds (drawn again until they are within, as a
//! sampler that refuses would), so that no draw piles up at a bound.

use std::collections::BTreeMap;

use rand::seq::SliceRandom;
use rand_distr::{Distribution, Normal};
use serde::{Deserialize, Serialize};

use super::forces::UnnamedForces;
use crate::error::{Error, Result, within};
use crate::rng;
use crate::task::scene::EffectTerm;
use crate::world::effect::Role;
use crate::world::latent::{FACTORS, clamp};
use crate::world::{EffectParameter, Latents, effect};

/// The format of a posterior's document.
pub const POSTERIOR_FORMAT: &str = "iplw.posterior/1";
/// Draws that a prior is stood for by: more than a plan and its fresh draws ask for.
pub const PRIOR_DRAWS: usize = 1024;
/// Most draws, columns and effects of a posterior: a document of that many is read in a second.
pub const MOST_DRAWS: usize = 100_000;
const MOST_COLUMNS: usize = 64;
const MOST_EFFECTS: usize = 32;
/// Most effects beside their columns that draws have, all together.
const MOST_TERMS: usize = 400_000;
/// Draws of a normal outside its factor's bounds before the last is moved to the nearest bound.
const MOST_REDRAWN: usize = 1000;

/// Equally likely worlds; at least one.
#[derive(Clone, Debug, PartialEq)]
pub struct Belief {
    source: Source,
    draws: Vec<Believed>,
}

/// One world that may be.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Believed {
    /// Latent factors; `None` leaves the scene's own.
    pub latents: Latents,
    /// Beyond a scene's own.
    pub effects: Vec<EffectTerm>,
    /// How many of the effects, the last ones, stand for a force that no effect accounts for.
    #[serde(skip_serializing_if = "is_zero")]
    pub unnamed: usize,
}

fn is_zero(number: &usize) -> bool {
    *number == 0
}

/// Where a belief came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// A single world: an estimate, or the truth for an oracle.
    Point,
    /// What was believed of a family before anything was measured.
    Prior,
    /// Draws given measured trials.
    Posterior,
}

/// What of a posterior's document is read; other fields are not looked at.
#[derive(Deserialize)]
struct Document {
    format: String,
    columns: BTreeMap<String, Vec<Option<f64>>>,
    #[serde(default)]
    effects: Vec<EffectTerm>,
    #[serde(default)]
    unnamed: Vec<UnnamedForces>,
}

impl Believed {
    /// Latents and effects that have names.
    pub fn new(latents: Latents, effects: Vec<EffectTerm>) -> Believed {
        Believed { latents, effects, unnamed: 0 }
    }

    /// Effects that have a name.
    pub fn named(&self) -> &[EffectTerm] {
        &self.effects[..self.effects.len().saturating_sub(self.unnamed)]
    }

    /// Errors name the latent, the effect or the count that cannot be.
    pub fn validate(&self) -> Result<()> {
        self.latents.validate()?;
        within("unnamed", self.unnamed as f64, 0.0, self.effects.len() as f64)?;
        effect::check(&self.effects)
    }

    /// A latent (`friction`), or an effect's parameter (`linear_drag.c`); `None` where the world does not say it.
    pub fn number(&self, name: &str) -> Option<f64> {
        if let Some(factor) = FACTORS.iter().position(|f| f.name == name) {
            return self.latents.values()[factor];
        }
        let (effect, parameter) = name.split_once('.')?;
        self.named().iter().find(|e| e.name == effect)?.parameters.get(parameter).copied()
    }
}

impl Belief {
    /// One world, known for sure.
    pub fn point(latents: Latents, effects: Vec<EffectTerm>) -> Result<Belief> {
        let world = Believed::new(latents, effects);
        world.validate()?;
        Ok(Belief { source: Source::Point, draws: vec![world] })
    }

    /// `count` draws of independent normals, (mean, standard deviation) of density, friction and restitution, with the same
    /// `effects` in each.
    pub fn prior(
        prior: [(f64, f64); 3],
        effects: Vec<EffectTerm>,
        count: usize,
        seed: u64,
    ) -> Result<Belief> {
        effect::check(&effects)?;
        within("draws", count as f64, 1.0, MOST_DRAWS as f64)?;
        let mut normals = Vec::with_capacity(FACTORS.len());
        for (factor, (mean, sd)) in FACTORS.iter().zip(prior) {
            let normal = Normal::new(mean, sd).ok().filter(|_| mean.is_finite() && sd.is_finite());
            let allowed = "a finite mean and a finite standard deviation that is not negative";
            let refused =
                || Error::input(format!("prior.{}", factor.name), format!("({mean}, {sd})"), allowed);
            normals.push(normal.ok_or_else(refused)?);
        }
        let mut stream = rng::stream(seed, "belief prior");
        let mut draw = |i: usize| {
            let [low, high] = FACTORS[i].bounds;
            let mut drawn = (0..MOST_REDRAWN).map(|_| normals[i].sample(&mut stream));
            drawn.find(|v| (low..=high).contains(v)).unwrap_or(prior[i].0)
        };
        let draws = (0..count).map(|_| {
            let values = clamp(std::array::from_fn(&mut draw));
            Believed::new(Latents::of(values), effects.clone())
        });
        Ok(Belief { source: Source::Prior, draws: draws.collect() })
    }

    /// `count` draws of the prior with one of several sets of effects each, in turn: parameters as large as they usually are, within bounds.
    /// Errors name an effect that no size can be drawn of, since it depends on the scene where it acts.
    pub fn of_sets(prior: [(f64, f64); 3], sets: &[Vec<String>], count: usize, seed: u64) -> Result<Belief> {
        for (i, set) in sets.iter().enumerate() {
            effect::check_set(&format!("sets[{i}]"), set)?;
        }
        let mut belief = Belief::prior(prior, Vec::new(), count, seed)?;
        let mut stream = rng::stream(seed, "belief effects");
        for (i, draw) in belief.draws.iter_mut().enumerate() {
            let Some(set) = sets.get(i % sets.len().max(1)) else { break };
            for (k, name) in set.iter().enumerate() {
                let field = format!("sets[{}][{k}]", i % sets.len());
                draw.effects.push(usual(&field, name, &mut stream)?);
            }
        }
        belief.draws.iter().take(sets.len()).try_for_each(|draw| effect::check(&draw.effects))?;
        Ok(belief)
    }

    /// The draws of a posterior's document (`iplw.posterior/1`).
    pub fn from_json(text: &str) -> Result<Belief> {
        Belief::of_document(crate::json::parse(text)?)
    }

    /// The same of what is JSON already.
    pub fn from_value(value: serde_json::Value) -> Result<Belief> {
        Belief::of_document(crate::json::from_value(value)?)
    }

    fn of_document(document: Document) -> Result<Belief> {
        if document.format != POSTERIOR_FORMAT {
            let value = format!("{:?}", document.format);
            return Err(Error::input("format", value, format!("{POSTERIOR_FORMAT:?}")));
        }
        effect::check(&document.effects)?;
        let sizes = [
            ("columns", document.columns.len(), MOST_COLUMNS),
            ("effects", document.effects.len(), MOST_EFFECTS),
        ];
        for (field, size, most) in sizes {
            if size > most {
                return Err(Error::input(field, format!("{size} of them"), format!("at most {most}")));
            }
        }
        let count = length(&document.columns)?;
        let carried = document.unnamed.iter().map(|u| u.terms()).sum::<usize>();
        let terms = count * document.effects.len() + carried;
        if terms > MOST_TERMS {
            let field = if carried > 0 { "unnamed" } else { "effects" };
            let value = format!("{terms} effects over all of {count} draws");
            return Err(Error::input(field, value, format!("at most {MOST_TERMS}")));
        }
        let mut draws = vec![Believed { effects: document.effects, ..Believed::default() }; count];
        for (name, values) in &document.columns {
            let column = Column::named(name)?;
            for (i, (draw, value)) in draws.iter_mut().zip(values).enumerate() {
                column.write(draw, *value, &format!("columns.{name}[{i}]"))?;
            }
        }
        for (i, forces) in document.unnamed.iter().enumerate() {
            carry(&mut draws, forces).map_err(|e| e.under(&format!("unnamed[{i}]")))?;
        }
        Ok(Belief { source: Source::Posterior, draws })
    }

    /// Of draws that a posterior's document was read to before.
    pub fn of_draws(draws: Vec<Believed>) -> Result<Belief> {
        within("draws", draws.len() as f64, 1.0, MOST_DRAWS as f64)?;
        draws.iter().try_for_each(Believed::validate)?;
        Ok(Belief { source: Source::Posterior, draws })
    }

    /// Where it came from.
    pub fn source(&self) -> Source {
        self.source
    }

    /// The draws, in the order in which they came.
    pub fn draws(&self) -> &[Believed] {
        &self.draws
    }

    /// Every draw once, in an order that the seed decides: the first of them are draws without replacement.
    pub fn shuffled(&self, seed: u64) -> Vec<&Believed> {
        let mut order: Vec<&Believed> = self.draws.iter().collect();
        order.shuffle(&mut rng::stream(seed, "belief order"));
        order
    }
}

/// Puts forces without a name into the draws that have them, after the effects that have names.
fn carry(draws: &mut [Believed], forces: &UnnamedForces) -> Result<()> {
    let count = draws.len();
    for (i, (draw, effects)) in forces.by_draw()?.into_iter().enumerate() {
        let Some(own) = draws.get_mut(draw).filter(|own| own.unnamed == 0) else {
            let allowed = format!("the number of a draw, below {count}, that has no such force yet");
            return Err(Error::input(format!("draws[{i}]"), draw.to_string(), allowed));
        };
        own.unnamed = effects.len();
        own.effects.extend(effects);
    }
    Ok(())
}

/// An effect with amplitudes as large as they usually are.
fn usual(field: &str, name: &str, stream: &mut rng::Stream) -> Result<EffectTerm> {
    let effect = effect::find(name)?;
    let mut parameters = BTreeMap::new();
    for parameter in effect.parameters {
        if parameter.role != Role::Amplitude {
            let allowed = format!(
                "effects without a place, time or shape: {}.{} is not known before anything was measured",
                effect.name, parameter.name
            );
            return Err(Error::input(field, format!("{name:?}"), allowed));
        }
        let [low, high] = parameter.bounds;
        let normal = Normal::new(parameter.prior().0, parameter.prior().1)
            .map_err(|e| Error::Failed(e.to_string()))?;
        let mut drawn = (0..MOST_REDRAWN).map(|_| normal.sample(stream));
        let value = drawn.find(|v| (low..=high).contains(v)).unwrap_or(parameter.neutral);
        parameters.insert(parameter.name.to_string(), value);
    }
    Ok(EffectTerm { name: effect.name.into(), parameters })
}

/// What the numbers of a column are.
enum Column {
    Factor(usize),
    Parameter(EffectParameter),
}

impl Column {
    fn named(name: &str) -> Result<Column> {
        if let Some(factor) = FACTORS.iter().position(|f| f.name == name) {
            return Ok(Column::Factor(factor));
        }
        EffectParameter::parse(name).map(Column::Parameter).map_err(|_| {
            let allowed = "latent factors (density, friction, restitution) and parameters of effects, `linear_drag.c` say, as names";
            Error::input(format!("columns.{name}"), "unknown", allowed)
        })
    }

    /// Puts a draw's number where it belongs; a parameter without one leaves the draw's effects as they are.
    fn write(&self, draw: &mut Believed, value: Option<f64>, field: &str) -> Result<()> {
        match (self, value) {
            (Column::Factor(factor), Some(value)) => {
                let [low, high] = FACTORS[*factor].bounds;
                let value = Some(within(field, value, low, high)?);
                match factor {
                    0 => draw.latents.density = value,
                    1 => draw.latents.friction = value,
                    _ => draw.latents.restitution = value,
                }
            }
            (Column::Factor(_), None) => {
                return Err(Error::input(field, "null", "a number: every draw has its latent factors"));
            }
            (Column::Parameter(own), Some(value)) => {
                let [low, high] = own.parameter().bounds;
                let value = within(field, value, low, high)?;
                let name = own.effect.name;
                let at = draw.effects.iter().position(|term| term.name == name).unwrap_or_else(|| {
                    draw.effects.push(EffectTerm { name: name.into(), parameters: BTreeMap::new() });
                    draw.effects.len() - 1
                });
                draw.effects[at].parameters.insert(own.parameter().name.into(), value);
            }
            (Column::Parameter(_), None) => {}
        }
        Ok(())
    }
}

/// The number of draws, which every column has.
fn length(columns: &BTreeMap<String, Vec<Option<f64>>>) -> Result<usize> {
    let Some((first, values)) = columns.iter().next() else {
        return Err(Error::input("columns", "empty", "at least one column of draws"));
    };
    for (name, other) in columns {
        let (found, wanted) = (other.len(), values.len());
        if found != wanted {
            let allowed = format!("{wanted} numbers, as columns.{first} has");
            return Err(Error::input(format!("columns.{name}"), format!("{found} numbers"), allowed));
        }
    }
    if (1..=MOST_DRAWS).contains(&values.len()) {
        return Ok(values.len());
    }
    let value = format!("{} numbers", values.len());
    Err(Error::input(format!("columns.{first}"), value, format!("1 to {MOST_DRAWS} numbers")))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRIOR: [(f64, f64); 3] = [(1.0, 0.5), (0.5, 0.25), (0.9, 0.25)];

    #[test]
    fn a_prior_s_draws_are_within_bounds_and_spread_as_it_says() {
        let belief = Belief::prior(PRIOR, vec![effect::damping(0.8)], 4000, 3).unwrap();
        let of = |factor: usize| belief.draws().iter().map(move |d| d.latents.values()[factor].unwrap());
        for (factor, row) in FACTORS.iter().enumerate() {
            let [low, high] = row.bounds;
            assert!(of(factor).all(|v| (low..=high).contains(&v)));
        }
        let mean = of(1).sum::<f64>() / 4000.0;
        // A normal of mean 0.5 and deviation 0.25 cut off below 0: 0.5 + 0.25 phi(2) / Phi(2) = 0.5138.
        assert!((mean - 0.5138).abs() < 0.015, "{mean}");
        // What is cut off does not pile up at the bound.
        assert!(of(2).all(|v| v < 1.0));
        assert!(belief.draws().iter().all(|d| d.effects == [effect::damping(0.8)]));
        assert_eq!(belief, Belief::prior(PRIOR, vec![effect::damping(0.8)], 4000, 3).unwrap());
        assert_ne!(belief, Belief::prior(PRIOR, vec![effect::damping(0.8)], 4000, 4).unwrap());
    }

    #[test]
    fn draws_come_without_replacement_in_an_order_of_the_seed() {
        let belief = Belief::prior(PRIOR, Vec::new(), 50, 0).unwrap();
        let (one, other) = (belief.shuffled(1), belief.shuffled(2));
        assert_ne!(one, other);
        let mut seen: Vec<f64> = one.iter().filter_map(|d| d.latents.friction).collect();
        seen.sort_by(f64::total_cmp);
        seen.dedup();
        assert_eq!(seen.len(), 50);
    }

    #[test]
    fn a_posterior_s_columns_become_worlds() {
        let text = r#"{"format": "iplw.posterior/1", "log_evidence": -3.5,
            "columns": {"friction": [0.2, 0.3], "linear_drag.c": [0.22, null], "gust.ax": [null, 1.5]},
            "effects": [{"name": "gust", "parameters": {"period": 2.0}}]}"#;
        let belief = Belief::from_json(text).unwrap();
        let [first, second] = belief.draws() else { panic!("{belief:?}") };
        assert_eq!(first.latents, Latents { friction: Some(0.2), ..Latents::default() });
        let names = |b: &Believed| b.effects.iter().map(|e| e.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(first), ["gust", "linear_drag"]);
        assert_eq!(first.effects[1].parameters["c"], 0.22);
        assert_eq!(names(second), ["gust"]);
        assert_eq!(
            second.effects[0].parameters,
            BTreeMap::from([("ax".into(), 1.5), ("period".into(), 2.0)])
        );
    }

    /// A force without a name comes after what has one, in those draws that have it.
    #[test]
    fn forces_without_a_name_are_in_the_draws_that_have_them() {
        let of = |unnamed: &str| {
            let text = format!(
                r#"{{"format": "iplw.posterior/1", "columns": {{"friction": [0.2, 0.3], "linear_drag.c": [0.1, 0.2]}}, "unnamed": [{unnamed}]}}"#
            );
            Belief::from_json(&text)
        };
        let forces = r#"{"set": 0, "over": "powers", "effects": [{"name": "monomial", "parameters": {"pvx": 1}}, {"name": "monomial",
            "parameters": {}}], "draws": [1], "amplitudes": [[-0.5, 0, 0.25, 2]]}"#;
        let belief = of(forces).unwrap();
        let [first, second] = belief.draws() else { panic!("{belief:?}") };
        assert_eq!((first.unnamed, first.effects.len(), second.unnamed), (0, 1, 2));
        assert_eq!(second.named(), &second.effects[..1]);
        assert_eq!(second.effects[1].parameters["ax"], -0.5);
        assert_eq!(second.effects[2].parameters["ay"], 2.0);
        assert_eq!((second.number("linear_drag.c"), second.number("monomial.ax")), (Some(0.2), None));
        let refused = |forces: &str, field: &str| {
            let error = of(forces).unwrap_err().to_string();
            assert!(error.contains(field), "{forces}: {error}");
        };
        refused(&forces.replace("[1]", "[2]"), "unnamed[0].draws[0]");
        refused(&forces.replace(", 2]]", "]]"), "unnamed[0].amplitudes[0]");
        refused(&forces.replace("-0.5", "-5000"), "unnamed[0].amplitudes[0][0]");
        refused(&forces.replace("[1]", "[0, 1]"), "unnamed[0].amplitudes");
        refused(&forces.replace("monomial", "ether"), "ether");
        refused(&format!("{forces}, {forces}"), "unnamed[1].draws[0]");
        refused(
            &forces.replace("monomial", "wind").replace(r#""pvx": 1"#, r#""ax": 1"#),
            "unnamed[0].effects[0]",
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
        refused(&format!(r#"{{"effects": [{many}], "draws": [], "amplitudes": []}}"#), "unnamed[0].effects");
    }

    #[test]
    fn sets_take_turns_and_their_effects_have_sizes() {
        let sets = [vec![], vec!["linear_drag".to_string()], vec!["wind".into(), "lift".into()]];
        let belief = Belief::of_sets(PRIOR, &sets, 300, 4).unwrap();
        let with = |set: &[String]| {
            let own = |d: &&Believed| d.effects.iter().map(|e| &e.name).eq(set);
            belief.draws().iter().filter(own).count()
        };
        assert_eq!(sets.each_ref().map(|s| with(s)), [100; 3]);
        let drags: Vec<f64> =
            belief.draws().iter().skip(1).step_by(3).map(|d| d.effects[0].parameters["c"]).collect();
        assert!(drags.iter().all(|c| *c >= 0.0) && drags.windows(2).any(|w| w[0] != w[1]));
        let refused =
            |name: &str| Belief::of_sets(PRIOR, &[vec![name.to_string()]], 9, 4).unwrap_err().to_string();
        assert!(refused("sticky_patch").contains("sticky_patch.x_min"), "{}", refused("sticky_patch"));
        assert!(refused("ether").contains("ether"));
        let twice = Belief::of_sets(PRIOR, &[vec![], vec!["wind".into(), "wind".into()]], 9, 4).unwrap_err();
        assert!(twice.to_string().contains("sets[1]"), "{twice}");
    }

    #[test]
    fn what_no_posterior_can_be_is_refused_by_name() {
        let of = |columns: &str| {
            let text = format!(r#"{{"format": "iplw.posterior/1", "columns": {columns}}}"#);
            Belief::from_json(&text).unwrap_err().to_string()
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
        let other = Belief::from_json(r#"{"format": "iplw.posterior/2", "columns": {"friction": [1]}}"#);
        assert!(other.unwrap_err().to_string().contains("iplw.posterior/1"));
    }
}
