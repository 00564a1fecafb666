//! A figure of a report with its caption.

use crate::picture::Block;

/// A figure of a report.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportFigure {
    /// File name without suffix.
    pub name: &'static str,
    pub caption: String,
    pub svg: String,
}

impl ReportFigure {
    /// As a block of the report.
    pub fn block(&self) -> Block {
        Block::Svg { svg: self.svg.clone(), caption: self.caption.clone() }
    }
}
