//! What reports of several experiments show, and the surface that several need.

use std::sync::Arc;

use iplw::error::Result;
use iplw::experiment::statistics::Claim;
use iplw::experiment::surface;
use iplw::explore::Importance;
use iplw::picture::Block;
use iplw::task::Family;

use crate::cli::output;

/// Claims for people, a line each.
pub fn claims_text(claims: &[Claim]) -> String {
    let line = |c: &Claim| format!("{:<15} {}: {}\n", c.verdict.title(), c.text, c.figure);
    format!("\nclaims\n{}", claims.iter().map(line).collect::<String>())
}

/// Claims as a table of a report; `small`: below what a difference that holds zero is small.
pub fn claims_table(claims: &[Claim], small: Option<f64>) -> Block {
    let small =
        small.map_or(String::new(), |s| format!("; small where it holds zero and lies within {s} of it"));
    Block::Table {
        columns: ["claim", "verdict", "figure"].map(String::from).to_vec(),
        rows: claims
            .iter()
            .map(|c| vec![c.text.clone(), c.verdict.title().into(), c.figure.clone()])
            .collect(),
        note: format!(
            "Paired by seed; undecided where the 95 % interval of the difference holds zero{small}."
        ),
    }
}

/// The performance surface that strategies need or use: one for all arms and seeds, found in related environments
/// before anything real is spent.
pub fn importance(family: &Family, needed: bool) -> Result<Option<Arc<dyn Importance>>> {
    if !needed {
        return Ok(None);
    }
    let bar = output::Bar::new();
    let found = surface::quick(family, &bar)?;
    bar.clear();
    Ok(Some(Arc::new(found)))
}
