//! Effects that a world may have beyond gravity and contact.

use serde::Serialize;
use utoipa::ToSchema;

use crate::error::Result;
use crate::serve::app::App;
use crate::serve::operation::{Operation, Page, READ, get};
use crate::serve::weight::Weight;
use crate::serve::wire::Bulk;
use crate::world::effect::{Effect, REGISTRY};

/// What can be asked about effects.
pub fn operations() -> Vec<Operation> {
    vec![
        get("list_effects", "/v1/effects", "tasks", READ)
            .about("Effects that a world may have beyond gravity and contact, and that a diagnosis may find.")
            .weighed(|_, _| Weight::Light, list),
    ]
}

/// All effects.
#[derive(Serialize, ToSchema)]
struct Effects {
    effects: Vec<EffectOut>,
    /// Cursor of the next page, if there is one.
    next: Option<String>,
}

/// An effect and what it takes.
#[derive(Serialize, ToSchema)]
struct EffectOut {
    name: &'static str,
    /// What it changes: `motion`, `contact`, `region`, `sensor` or `action`.
    acts_on: &'static str,
    /// In words and symbols, SI.
    equation: &'static str,
    parameters: Vec<EffectParameterOut>,
}

/// A parameter of an effect.
#[derive(Serialize, ToSchema)]
struct EffectParameterOut {
    name: &'static str,
    unit: &'static str,
    /// Least and largest value.
    bounds: [f64; 2],
    /// The value at which the effect vanishes.
    neutral: f64,
}

impl Bulk for Effects {}

fn list(_: &App, page: Page) -> Result<Effects> {
    let seen = page.after("effects")?.unwrap_or(0);
    let mut rows: Vec<(usize, &Effect)> =
        (1..).zip(REGISTRY.iter().copied()).skip(seen).take(page.fetch()).collect();
    let next = page.cut("effects", &mut rows, |r| r.0);
    Ok(Effects { effects: rows.into_iter().map(|(_, e)| e.into()).collect(), next })
}

impl From<&Effect> for EffectOut {
    fn from(e: &Effect) -> EffectOut {
        let parameter = |p: &crate::world::effect::Parameter| EffectParameterOut {
            name: p.name,
            unit: p.unit,
            bounds: p.bounds,
            neutral: p.neutral,
        };
        EffectOut {
            name: e.name,
            acts_on: e.acts_on().name(),
            equation: e.equation,
            parameters: e.parameters.iter().map(parameter).collect(),
        }
    }
}
