//! The configuration of an experiment in its report.

use iplw::error::{Error, Result};
use iplw::picture::report::Block;
use serde::Serialize;

/// The configuration as JSON, collapsed.
pub fn configuration(config: &impl Serialize) -> Result<Block> {
    let json = serde_json::to_string_pretty(config).map_err(|e| Error::Failed(e.to_string()))?;
    Ok(Block::Details { summary: "Configuration".into(), blocks: vec![Block::Code(json)] })
}
