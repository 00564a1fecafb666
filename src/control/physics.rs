//! Physics of a control world beside its scene: effects with values or ranges, and noise.

use rand::RngExt;

use crate::error::{Error, Result};
use crate::rng::Stream;
use crate::task::control::{ControlReality, JointEffectRange};
use crate::task::scene::EffectTerm;
use crate::world::mechanism::effect::resolve;
use crate::world::mechanism::{JointTerm, Tree};

/// Maximum number of effects of a world.
const MAX_WORLD_EFFECTS: usize = 32;

/// Effects of a world and its noise.
#[derive(Clone)]
pub struct ControlPhysics {
    /// Lowest and highest values of each effect's parameters.
    low: Vec<JointTerm>,
    high: Vec<JointTerm>,
    /// Standard deviation of the noise of each joint's measured position, rad or m.
    pub noise: Vec<f64>,
}

impl ControlPhysics {
    /// Effects and noise of a document; `place` prefixes the field of an error.
    pub fn new(reality: &ControlReality, tree: &Tree, place: &str) -> Result<ControlPhysics> {
        let effects = &reality.effects;
        if effects.len() > MAX_WORLD_EFFECTS {
            let allowed = format!("at most {MAX_WORLD_EFFECTS}");
            return Err(Error::input(
                format!("{place}effects"),
                format!("{} effects", effects.len()),
                allowed,
            ));
        }
        reality.validate_noise(tree.names.iter(), place)?;
        let (mut low, mut high) = (Vec::new(), Vec::new());
        for (i, own) in effects.iter().enumerate() {
            let place = format!("{place}effects[{i}]");
            let joint = tree.joint(&own.joint).ok_or_else(|| {
                let allowed = format!("a joint: {}", tree.names.join(", "));
                Error::input(format!("{place}.joint"), own.joint.as_str(), allowed)
            })?;
            let [least, most] = [0, 1].map(|end| resolve(&term(own, end), joint, &place));
            let (least, most) = (least?, most?);
            let fits = least.effect.fits(
                tree.kinds[joint],
                tree.motors[joint].is_some(),
                tree.parents[joint].is_none(),
                tree.gravity != [0.0; 2],
            );
            if !fits {
                let allowed = format!("an effect that {} can have", own.joint);
                return Err(Error::input(format!("{place}.name"), own.name.as_str(), allowed));
            }
            if let Some(p) = (0..least.values.len()).find(|p| least.values[*p] > most.values[*p]) {
                let field = format!("{place}.parameters.{}", least.effect.parameters[p].name);
                return Err(Error::input(
                    field,
                    format!("{} to {}", least.values[p], most.values[p]),
                    "the lower number first",
                ));
            }
            low.push(least);
            high.push(most);
        }
        let noise = tree.names.iter().map(|name| reality.noise.get(name).copied().unwrap_or(0.0)).collect();
        Ok(ControlPhysics { low, high, noise })
    }

    /// The same without ranges: every parameter is drawn from its range.
    pub fn draw_once(&self, stream: &mut Stream) -> ControlPhysics {
        let terms = self.draw(stream);
        ControlPhysics { low: terms.clone(), high: terms, noise: self.noise.clone() }
    }

    /// Effects with every parameter drawn from its range.
    pub fn draw(&self, stream: &mut Stream) -> Vec<JointTerm> {
        let term = |(low, high): (&JointTerm, &JointTerm)| {
            let each = low.values.iter().zip(&high.values);
            let values = each.map(|(a, b)| if a < b { stream.random_range(*a..*b) } else { *a }).collect();
            JointTerm { values, ..low.clone() }
        };
        self.low.iter().zip(&self.high).map(term).collect()
    }
}

/// The effect with the lowest (0) or highest (1) values.
fn term(range: &JointEffectRange, end: usize) -> EffectTerm {
    let parameters = range.parameters.iter().map(|(key, value)| (key.clone(), value.bounds()[end])).collect();
    EffectTerm { name: range.name.clone(), parameters }
}
