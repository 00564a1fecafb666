//! Numbers in attributes of XML elements.

use nalgebra::Vector3;
use roxmltree::Node;

use crate::error::{Error, Result};

/// The numbers of an attribute's text.
pub fn numbers(element: &str, name: &str, text: &str) -> Result<Vec<f64>> {
    let refuse = || Error::input(format!("{element}.{name}"), format!("{text:?}"), "numbers");
    text.split_whitespace()
        .map(|word| word.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(refuse))
        .collect()
}

/// One number.
pub fn number(element: &str, name: &str, text: &str) -> Result<f64> {
    match numbers(element, name, text)?.as_slice() {
        [one] => Ok(*one),
        _ => Err(Error::input(format!("{element}.{name}"), format!("{text:?}"), "one number")),
    }
}

/// Three numbers.
pub fn vector(element: &str, name: &str, text: &str) -> Result<Vector3<f64>> {
    match numbers(element, name, text)?.as_slice() {
        [x, y, z] => Ok(Vector3::new(*x, *y, *z)),
        _ => Err(Error::input(format!("{element}.{name}"), format!("{text:?}"), "three numbers")),
    }
}

/// A vector that is not zero, of unit length.
pub fn direction(element: &str, name: &str, text: &str) -> Result<Vector3<f64>> {
    let found = vector(element, name, text)?;
    match found.norm() > 1e-9 {
        true => Ok(found.normalize()),
        false => Err(Error::input(format!("{element}.{name}"), format!("{text:?}"), "a direction, not zero")),
    }
}

/// The children with this tag.
pub fn children<'a, 'b>(node: Node<'a, 'b>, tag: &'static str) -> impl Iterator<Item = Node<'a, 'b>> {
    node.children().filter(move |child| child.has_tag_name(tag))
}
