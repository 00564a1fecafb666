//! Claims in reports, and the performance surface of several experiments.

use std::sync::Arc;

use iplw::error::Result;
use iplw::experiment::statistics::Claim;
use iplw::experiment::surface;
use iplw::explore::Importance;
use iplw::picture::Block;
use iplw::task::Family;

use crate::cli::output;

/// Claims as text, one per line.
pub fn claims_text(claims: &[Claim]) -> String {
    let line = |c: &Claim| format!("{:<15} {}: {}\n", c.verdict.title(), c.text, c.figure);
    format!("\nclaims\n{}", claims.iter().map(line).collect::<String>())
}

/// Claims as a table of a report. `small`: bound below which a difference consistent with zero counts as small.
pub fn claims_table(claims: &[Claim], small: Option<f64>) -> Block {
    let small =
        small.map_or(String::new(), |s| format!("; small if it contains zero and lies within {s} of it"));
    Block::Table {
        columns: ["claim", "verdict", "figure"].map(String::from).to_vec(),
        rows: claims
            .iter()
            .map(|c| vec![c.text.clone(), c.verdict.title().into(), c.figure.clone()])
            .collect(),
        note: format!(
            "Paired by seed; undecided if the 95 % interval of the difference contains zero{small}."
        ),
    }
}

/// The performance surface for strategies that use it, computed once in related environments for all arms and seeds.
pub fn importance(family: &Family, needed: bool) -> Result<Option<Arc<dyn Importance>>> {
    if !needed {
        return Ok(None);
    }
    let bar = output::TerminalProgress::new();
    let found = surface::quick(family, &bar)?;
    bar.clear();
    Ok(Some(Arc::new(found)))
}
