//! How two surfaces' coefficients make those of their contact, and when nothing bounces.
//!
//! Source: Chipmunk2D multiplies both (`cpArbiter.c`), and every approach bounces: the default here. Box2D takes the square root
//! of the product of frictions and the larger restitution (`b2MixFriction`, `b2MixRestitution`), and lets nothing bounce that
//! approaches slower than 1 m/s (`b2_velocityThreshold`).

use serde::{Deserialize, Serialize};

use crate::error::{Result, within};

/// A scene's choice of how surfaces meet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ContactRules {
    /// How two coefficients of friction make one.
    pub friction: FrictionRule,
    /// How two coefficients of restitution make one.
    pub restitution: RestitutionRule,
    /// Speed of approach below which nothing bounces, m/s; shorthand for the effect `restitution_threshold`.
    pub restitution_threshold: f64,
}

/// How two coefficients of friction make one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FrictionRule {
    /// Their product: Chipmunk's.
    #[default]
    Product,
    /// The square root of their product: Box2D's.
    GeometricMean,
}

/// How two coefficients of restitution make one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RestitutionRule {
    /// Their product: Chipmunk's.
    #[default]
    Product,
    /// The larger: Box2D's.
    Max,
}

impl ContactRules {
    /// Those of Box2D's worlds.
    pub const BOX2D: ContactRules = ContactRules {
        friction: FrictionRule::GeometricMean,
        restitution: RestitutionRule::Max,
        restitution_threshold: 1.0,
    };

    /// The coefficients (friction, restitution) of a contact of two surfaces with theirs.
    pub fn of_contact(&self, one: [f64; 2], other: [f64; 2]) -> [f64; 2] {
        let friction = match self.friction {
            FrictionRule::Product => one[0] * other[0],
            FrictionRule::GeometricMean => (one[0] * other[0]).sqrt(),
        };
        let restitution = match self.restitution {
            RestitutionRule::Product => one[1] * other[1],
            RestitutionRule::Max => one[1].max(other[1]),
        };
        [friction, restitution]
    }

    /// Errors unless the threshold is a speed that the effect takes.
    pub(super) fn validate(&self) -> Result<()> {
        within("contact_rules.restitution_threshold", self.restitution_threshold, 0.0, MOST_THRESHOLD)
            .map(|_| ())
    }
}

/// Highest threshold, m/s: nothing bounces at all.
pub const MOST_THRESHOLD: f64 = 100.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_mix_as_either_engine_has_it() {
        let (one, other) = ([0.5, 0.2], [0.08, 0.6]);
        let [friction, restitution] = ContactRules::default().of_contact(one, other);
        assert_eq!([friction, restitution], [0.5 * 0.08, 0.2 * 0.6]);
        let [friction, restitution] = ContactRules::BOX2D.of_contact(one, other);
        assert!((friction - 0.2).abs() < 1e-15, "sqrt(0.04), not {friction}");
        assert_eq!(restitution, 0.6);
    }

    #[test]
    fn what_is_left_out_is_the_default_and_what_is_unknown_is_refused() {
        let rules: ContactRules = serde_json::from_str(r#"{"restitution": "max"}"#).unwrap();
        assert_eq!(rules, ContactRules { restitution: RestitutionRule::Max, ..ContactRules::default() });
        assert!(serde_json::from_str::<ContactRules>(r#"{"friction": "min"}"#).is_err());
        assert!(serde_json::from_str::<ContactRules>(r#"{"threshold": 1}"#).is_err());
        let fast = ContactRules { restitution_threshold: f64::NAN, ..ContactRules::default() };
        assert!(fast.validate().unwrap_err().to_string().contains("restitution_threshold"));
    }
}
