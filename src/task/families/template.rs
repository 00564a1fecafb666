//! Scene templates: an `iplw.scene/1` document in which `"= x1 + d1"` may replace any number.
//!
//! [`Scene`] alone defines the valid fields, so new shapes and goals can be used in families at once.

use serde_json::{Map, Number, Value};

use crate::error::{Error, Result};
use crate::task::expression::Expression;
use crate::task::scene::{FORMAT, Scene};

/// The scene template of a family's candidates.
#[derive(Debug)]
pub struct Template(Node);

#[derive(Debug)]
enum Node {
    Fixed(Value),
    Number(Expression),
    List(Vec<Node>),
    Fields(Vec<(String, Node)>),
}

/// Prefix of an expression.
const MARK: char = '=';

impl Template {
    /// Parses the table `scene`; expressions are over `names`. Errors name the path.
    pub fn new(table: &toml::Table, names: &[String]) -> Result<Template> {
        Ok(Template(fields("scene", table, names)?))
    }

    /// The scene for the values of the names, not yet validated. `name` is its default name.
    pub fn fill(&self, name: &str, values: &[f64]) -> Result<Scene> {
        let mut scene = self.0.fill(values);
        if let Value::Object(fields) = &mut scene {
            fields.entry("format").or_insert_with(|| FORMAT.into());
            fields.entry("name").or_insert_with(|| name.into());
        }
        crate::json::from_value(scene).map_err(|e| reword_for_toml(e.in_field("scene")))
    }
}

/// Rewords the error of a field for TOML files.
fn reword_for_toml(error: Error) -> Error {
    let allowed = format!("what {FORMAT} allows");
    error.map_input(|input| input.allowed = input.allowed.replace("valid JSON of this format", &allowed))
}

fn fields(path: &str, table: &toml::Table, names: &[String]) -> Result<Node> {
    let of = |(key, value): (&String, &toml::Value)| {
        Ok((key.clone(), node(&format!("{path}.{key}"), value, names)?))
    };
    let fields: Vec<(String, Node)> = table.iter().map(of).collect::<Result<_>>()?;
    // Subtrees without expressions are stored as one value.
    if !fields.iter().all(|(_, node)| matches!(node, Node::Fixed(_))) {
        return Ok(Node::Fields(fields));
    }
    Ok(Node::Fixed(fields.into_iter().map(|(key, node)| (key, node.fill(&[]))).collect::<Map<_, _>>().into()))
}

fn node(path: &str, value: &toml::Value, names: &[String]) -> Result<Node> {
    Ok(match value {
        toml::Value::String(text) => match text.trim_start().strip_prefix(MARK) {
            Some(expression) => Node::Number(Expression::parse(path, expression, names)?),
            None => Node::Fixed(text.as_str().into()),
        },
        toml::Value::Integer(v) => Node::Fixed((*v).into()),
        toml::Value::Float(v) if v.is_finite() => Node::Fixed(number(*v)),
        toml::Value::Boolean(v) => Node::Fixed((*v).into()),
        toml::Value::Array(items) => {
            let each = items.iter().enumerate().map(|(i, v)| node(&format!("{path}[{i}]"), v, names));
            let nodes: Vec<Node> = each.collect::<Result<_>>()?;
            if nodes.iter().all(|n| matches!(n, Node::Fixed(_))) {
                Node::Fixed(nodes.into_iter().map(|n| n.fill(&[])).collect())
            } else {
                Node::List(nodes)
            }
        }
        toml::Value::Table(table) => fields(path, table, names)?,
        toml::Value::Float(v) => return Err(Error::input(path, v, "a finite number")),
        toml::Value::Datetime(v) => return Err(Error::input(path, v, "a number, a text, a list or a table")),
    })
}

impl Node {
    fn fill(&self, values: &[f64]) -> Value {
        match self {
            Node::Fixed(value) => value.clone(),
            Node::Number(expression) => number(expression.value(values)),
            Node::List(items) => items.iter().map(|n| n.fill(values)).collect(),
            Node::Fields(fields) => {
                fields.iter().map(|(key, n)| (key.clone(), n.fill(values))).collect::<Map<_, _>>().into()
            }
        }
    }
}

/// A JSON number; whole numbers become integers so that they can be counts. Non-finite values become null,
/// which the parser rejects.
fn number(v: f64) -> Value {
    let whole = v.fract() == 0.0 && v.abs() <= 9e15 && v.to_bits() != (-0.0f64).to_bits();
    if whole { (v as i64).into() } else { Number::from_f64(v).map_or(Value::Null, Value::Number) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
        steps = "= 10 * n"
        [[bodies]]
        name = "ball"
        shape = { type = "disc", radius = "= r / 2" }
        position = [-0.0, "= r + 1"]
    "#;

    fn template(text: &str) -> Result<Template> {
        Template::new(&text.parse().unwrap(), &["r", "n"].map(String::from))
    }

    #[test]
    fn fills_expressions_and_keeps_other_fields() {
        let scene = template(TEXT).unwrap().fill("drop", &[0.3, 4.0]).unwrap();
        assert_eq!((scene.name.as_str(), scene.steps), ("drop", 40));
        assert_eq!(scene.bodies[0].shape.disc_radius(), Some(0.15));
        let [x, y] = scene.bodies[0].position.unwrap();
        assert_eq!((x.to_bits(), y), ((-0.0f64).to_bits(), 1.3));
    }

    #[test]
    fn errors_name_the_path() {
        let check = |from: &str, to: &str, wanted: &str| {
            let found = template(&TEXT.replace(from, to)).and_then(|t| t.fill("drop", &[0.3, 4.0]));
            let error = found.unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        };
        check("= r / 2", "= r /", "`scene.bodies[0].shape.radius` is \" r /\"");
        check(
            "= r + 1",
            "= q",
            "`scene.bodies[0].position[1]` is \" q\"; allowed: an expression (`q` is not",
        );
        check("-0.0", "nan", "`scene.bodies[0].position[0]` is NaN");
        check("-0.0", "2026-01-01", "`scene.bodies[0].position[0]` is 2026-01-01");
        check("radius", "raduis", "scene.bodies[0].shape");
        check("steps", "stesp", "`scene.stesp`");
        check("10 * n", "n / 3", "`scene.steps`");
        check("\"= 10 * n\"", "\"many\"", "`scene.steps`; allowed: what iplw.scene/1 allows");
    }
}
