//! Mixing rules for the coefficients of two surfaces in contact, and the restitution threshold.
//!
//! Source: Chipmunk2D multiplies both coefficients (`cpArbiter.c`), and every impact bounces: the default
//! here. Box2D takes the geometric mean of the frictions and the larger restitution (`b2MixFriction`,
//! `b2MixRestitution`), and treats impacts slower than 1 m/s as inelastic (`b2_velocityThreshold`).

pub use super::constants::MAX_RESTITUTION_THRESHOLD_M_S;
use serde::{Deserialize, Serialize};

use crate::error::{Result, check_range};

/// A scene's mixing rules.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ContactRules {
    /// Mixing rule for friction.
    pub friction: FrictionRule,
    /// Mixing rule for restitution.
    pub restitution: RestitutionRule,
    /// Approach speed below which a contact has no restitution, m/s; shorthand for the effect
    /// `restitution_threshold`.
    pub restitution_threshold: f64,
}

/// Mixing rule for two friction coefficients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FrictionRule {
    /// The product (Chipmunk).
    #[default]
    Product,
    /// The geometric mean (Box2D).
    GeometricMean,
}

/// Mixing rule for two restitution coefficients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RestitutionRule {
    /// The product (Chipmunk).
    #[default]
    Product,
    /// The larger one (Box2D).
    Max,
}

impl ContactRules {
    /// The rules of Box2D.
    pub const BOX2D: ContactRules = ContactRules {
        friction: FrictionRule::GeometricMean,
        restitution: RestitutionRule::Max,
        restitution_threshold: 1.0,
    };

    /// Friction and restitution of the contact of two surfaces, each given as [friction, restitution].
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

    /// Errors unless the threshold is within the bounds of the effect.
    pub(super) fn validate(&self) -> Result<()> {
        check_range(
            "contact_rules.restitution_threshold",
            self.restitution_threshold,
            0.0,
            MAX_RESTITUTION_THRESHOLD_M_S,
        )
        .map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mixes_coefficients_by_either_rule() {
        let (one, other) = ([0.5, 0.2], [0.08, 0.6]);
        let [friction, restitution] = ContactRules::default().of_contact(one, other);
        assert_eq!([friction, restitution], [0.5 * 0.08, 0.2 * 0.6]);
        let [friction, restitution] = ContactRules::BOX2D.of_contact(one, other);
        assert!((friction - 0.2).abs() < 1e-15, "sqrt(0.04), not {friction}");
        assert_eq!(restitution, 0.6);
    }

    #[test]
    fn defaults_missing_fields_and_rejects_unknown_values() {
        let rules: ContactRules = serde_json::from_str(r#"{"restitution": "max"}"#).unwrap();
        assert_eq!(rules, ContactRules { restitution: RestitutionRule::Max, ..ContactRules::default() });
        assert!(serde_json::from_str::<ContactRules>(r#"{"friction": "min"}"#).is_err());
        assert!(serde_json::from_str::<ContactRules>(r#"{"threshold": 1}"#).is_err());
        let fast = ContactRules { restitution_threshold: f64::NAN, ..ContactRules::default() };
        assert!(fast.validate().unwrap_err().to_string().contains("restitution_threshold"));
    }
}
