//! Effects of scenes and joints by name, as in documents.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// An effect with its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(as = EffectIn)]
pub struct EffectTerm {
    /// `linear_drag`, ...; `iplw effects` lists all.
    pub name: String,
    /// Values in the effect's units; absent ones have their neutral value.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
}

impl EffectTerm {
    /// An effect with some of its parameters.
    pub fn new(name: &str, parameters: &[(&str, f64)]) -> EffectTerm {
        let parameters = parameters.iter().map(|(key, value)| (key.to_string(), *value)).collect();
        EffectTerm { name: name.into(), parameters }
    }

    /// Sets a parameter of the effect `name` in a list, which gets the effect if it lacks it.
    pub fn set_in(terms: &mut Vec<EffectTerm>, name: &str, parameter: &str, value: f64) {
        let at = terms.iter().position(|term| term.name == name).unwrap_or_else(|| {
            terms.push(EffectTerm::new(name, &[]));
            terms.len() - 1
        });
        terms[at].parameters.insert(parameter.into(), value);
    }
}
