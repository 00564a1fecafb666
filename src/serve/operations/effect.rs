//! The library of effects beyond gravity and contact.

use serde::Serialize;
use utoipa::ToSchema;

use crate::error::Result;
use crate::serve::execution_class::ExecutionClass;
use crate::serve::operation::{Operation, Pagination, READ, get};
use crate::serve::request_context::RequestContext;
use crate::serve::wire::BinaryArrays;
use crate::world::effect::{Effect, REGISTRY};

/// Operations on effects.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_effects", "/v1/effects", "tasks", READ)
            .about(
                "Lists the effects beyond gravity and contact that worlds can have and diagnoses can find.",
            )
            .classified_handler(|_, _| ExecutionClass::Inline, list),
    ]
}

/// All effects.
#[derive(Serialize, ToSchema)]
struct EffectsPage {
    effects: Vec<EffectOut>,
    /// Cursor of the next page, if there is one.
    next: Option<String>,
}

/// An effect with its parameters.
#[derive(Serialize, ToSchema)]
struct EffectOut {
    name: &'static str,
    /// Where it acts: `motion`, `contact`, `region`, `sensor` or `action`.
    acts_on: &'static str,
    /// Equation in SI units.
    equation: &'static str,
    parameters: Vec<EffectParameterOut>,
}

/// A parameter of an effect.
#[derive(Serialize, ToSchema)]
struct EffectParameterOut {
    name: &'static str,
    unit: &'static str,
    /// Minimum and maximum.
    bounds: [f64; 2],
    /// Value at which the effect vanishes.
    neutral: f64,
}

impl BinaryArrays for EffectsPage {}

fn list(_: &RequestContext, page: Pagination) -> Result<EffectsPage> {
    let seen = page.after("effects")?.unwrap_or(0);
    let mut rows: Vec<(usize, &Effect)> =
        (1..).zip(REGISTRY.iter().copied()).skip(seen).take(page.fetch_limit()).collect();
    let next = page.truncate("effects", &mut rows, |r| r.0);
    Ok(EffectsPage { effects: rows.into_iter().map(|(_, e)| e.into()).collect(), next })
}

impl From<&Effect> for EffectOut {
    fn from(e: &Effect) -> EffectOut {
        let parameter = |p: &crate::world::effect::ParameterDeclaration| EffectParameterOut {
            name: p.name,
            unit: p.unit,
            bounds: p.bounds,
            neutral: p.neutral,
        };
        EffectOut {
            name: e.name,
            acts_on: e.target().name(),
            equation: e.equation,
            parameters: e.parameters.iter().map(parameter).collect(),
        }
    }
}
