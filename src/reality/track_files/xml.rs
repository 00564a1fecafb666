//! XML documents of tracking programs.

use roxmltree::{Document, Node, ParsingOptions};

use super::track_rows::invalid_value;
use crate::error::Result;

/// Maximum number of elements and texts.
const MAX_NODES: u32 = 20_000_000;

/// Parses a document.
pub fn parse(text: &str) -> Result<Document<'_>> {
    let options = ParsingOptions { allow_dtd: true, nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    let text = text.trim_start_matches('\u{feff}');
    Document::parse_with_options(text, options)
        .map_err(|e| invalid_value(e.pos().row as usize, "", "", &format!("XML ({e}); is the file cut off?")))
}

/// Line of an element, from 1.
pub fn line(node: Node) -> usize {
    node.document().text_pos_at(node.range().start).row as usize
}

/// Children of an element called `name`.
pub fn children<'a, 'i: 'a>(node: Node<'a, 'i>, name: &'a str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |n| n.has_tag_name(name))
}

/// An attribute's text; an error if it is missing.
pub fn attribute<'a>(node: Node<'a, '_>, name: &str) -> Result<&'a str> {
    let missing = || {
        invalid_value(line(node), name, "missing", &format!("an attribute of <{}>", node.tag_name().name()))
    };
    node.attribute(name).ok_or_else(missing)
}

/// An attribute's number; an error if it is missing or not a number.
pub fn number(node: Node, name: &str) -> Result<f64> {
    let text = attribute(node, name)?;
    let number = text.trim().parse().ok().filter(|v: &f64| v.is_finite());
    number.ok_or_else(|| invalid_value(line(node), name, &format!("{text:?}"), "a number"))
}
