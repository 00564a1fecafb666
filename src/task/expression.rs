//! Arithmetic expressions over named numbers, for derived values and rewards of tasks: `x1 + d1 / 2 + gap`.
//!
//! `+ - * /`, comparisons (1 if true, else 0), `and`, `or`, `not`, parentheses, `pi` and [`FUNCTIONS`]. There
//! are no loops, assignments or side effects: evaluation terminates, and results have the same bits on every
//! machine (`libm`, no fused products).

use crate::error::{Error, Result};

/// A parsed expression with resolved names.
#[derive(Clone, Debug)]
pub struct Expression(ExpressionNode);

/// Maximum length of an expression, bytes; also bounds its depth.
const MAX_EXPRESSION_BYTES: usize = 400;
/// Maximum nesting of parentheses, calls and signs.
const MAX_DEPTH: usize = 40;
/// Functions by name, with their number of arguments; `min` and `max` take two or more.
const FUNCTIONS: [(&str, Function); 8] = [
    ("min", Function::Two(f64::min)),
    ("max", Function::Two(f64::max)),
    ("sqrt", Function::One(f64::sqrt)),
    ("abs", Function::One(f64::abs)),
    ("floor", Function::One(f64::floor)),
    ("sin", Function::One(libm::sin)),
    ("cos", Function::One(libm::cos)),
    ("atan2", Function::Two(libm::atan2)),
];

#[derive(Clone, Copy, Debug)]
enum Function {
    One(fn(f64) -> f64),
    Two(fn(f64, f64) -> f64),
}

#[derive(Clone, Debug)]
enum ExpressionNode {
    Number(f64),
    /// Index of a name.
    Name(usize),
    One(fn(f64) -> f64, Box<ExpressionNode>),
    Two(fn(f64, f64) -> f64, Box<[ExpressionNode; 2]>),
}

impl Expression {
    /// Parses `text`, the value of `field`, over `names`; an error names the position.
    pub fn parse(field: &str, text: &str, names: &[String]) -> Result<Expression> {
        let refuse = |why: String| Error::input(field, format!("{text:?}"), format!("an expression ({why})"));
        if text.len() > MAX_EXPRESSION_BYTES {
            return Err(refuse(format!("at most {MAX_EXPRESSION_BYTES} bytes, this has {}", text.len())));
        }
        let mut parser = Parser { text, at: 0, names, depth: 0 };
        let term = parser.disjunction().map_err(refuse)?;
        parser.skip();
        match parser.rest() {
            "" => Ok(Expression(term)),
            _ => Err(refuse(parser.expected("an operator or the end"))),
        }
    }

    /// A constant expression.
    pub fn number(value: f64) -> Expression {
        Expression(ExpressionNode::Number(value))
    }

    /// Its cost: number of constants, names and operations.
    pub fn size(&self) -> usize {
        self.0.size()
    }

    /// Evaluates the expression; the result is not finite where it is undefined.
    pub fn value(&self, values: &[f64]) -> f64 {
        self.0.value(values)
    }
}

impl ExpressionNode {
    fn size(&self) -> usize {
        match self {
            ExpressionNode::Number(_) | ExpressionNode::Name(_) => 1,
            ExpressionNode::One(_, a) => 1 + a.size(),
            ExpressionNode::Two(_, ab) => 1 + ab[0].size() + ab[1].size(),
        }
    }

    fn value(&self, values: &[f64]) -> f64 {
        match self {
            ExpressionNode::Number(v) => *v,
            ExpressionNode::Name(i) => values.get(*i).copied().unwrap_or(f64::NAN),
            ExpressionNode::One(f, a) => f(a.value(values)),
            ExpressionNode::Two(f, ab) => f(ab[0].value(values), ab[1].value(values)),
        }
    }
}

/// An operator and its function.
type Operator = (&'static str, fn(f64, f64) -> f64);

const OR: [Operator; 1] = [("or", |a, b| truth(a != 0.0 || b != 0.0))];
const AND: [Operator; 1] = [("and", |a, b| truth(a != 0.0 && b != 0.0))];
/// Longer ones first: `<=` starts with `<`.
const COMPARED: [Operator; 6] = [
    ("<=", |a, b| truth(a <= b)),
    (">=", |a, b| truth(a >= b)),
    ("==", |a, b| truth(a == b)),
    ("!=", |a, b| truth(a != b)),
    ("<", |a, b| truth(a < b)),
    (">", |a, b| truth(a > b)),
];
const SUMS: [Operator; 2] = [("+", |a, b| a + b), ("-", |a, b| a - b)];
const PRODUCTS: [Operator; 2] = [("*", |a, b| a * b), ("/", |a, b| a / b)];

fn truth(holds: bool) -> f64 {
    f64::from(u8::from(holds))
}

/// A recursive-descent parser; each level binds tighter than the previous one.
struct Parser<'a> {
    text: &'a str,
    at: usize,
    names: &'a [String],
    depth: usize,
}

type Parsed = std::result::Result<ExpressionNode, String>;

impl Parser<'_> {
    fn disjunction(&mut self) -> Parsed {
        self.chain(&OR, |p| p.chain(&AND, Self::negated))
    }

    fn negated(&mut self) -> Parsed {
        self.skip();
        if self.word() != "not" {
            return self.compared();
        }
        self.at += "not".len();
        Ok(ExpressionNode::One(|a| truth(a == 0.0), Box::new(self.negated()?)))
    }

    /// One comparison, not a chain: `a < b < c` would not have its mathematical meaning.
    fn compared(&mut self) -> Parsed {
        let left = self.chain(&SUMS, |p| p.chain(&PRODUCTS, Self::signed))?;
        let Some(compare) = self.operator(&COMPARED) else { return Ok(left) };
        let right = self.chain(&SUMS, |p| p.chain(&PRODUCTS, Self::signed))?;
        Ok(ExpressionNode::Two(compare, Box::new([left, right])))
    }

    fn chain(&mut self, operators: &[Operator], next: fn(&mut Self) -> Parsed) -> Parsed {
        let mut left = next(self)?;
        while let Some(operator) = self.operator(operators) {
            left = ExpressionNode::Two(operator, Box::new([left, next(self)?]));
        }
        Ok(left)
    }

    fn signed(&mut self) -> Parsed {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(format!("at most {MAX_DEPTH} parentheses, calls and signs within each other"));
        }
        let term = if self.consume("-") {
            ExpressionNode::One(|a| -a, Box::new(self.signed()?))
        } else {
            self.primary()?
        };
        self.depth -= 1;
        Ok(term)
    }

    fn primary(&mut self) -> Parsed {
        if self.consume("(") {
            let inner = self.disjunction()?;
            return if self.consume(")") { Ok(inner) } else { Err(self.expected("`)`")) };
        }
        let word = self.word().to_string();
        if word.is_empty() {
            return self.number();
        }
        if let Some((_, function)) = FUNCTIONS.iter().find(|(name, _)| *name == word) {
            self.at += word.len();
            return self.call(*function);
        }
        let found = match self.names.iter().position(|n| *n == word) {
            Some(index) => ExpressionNode::Name(index),
            None if word == "pi" => ExpressionNode::Number(std::f64::consts::PI),
            None => {
                let functions = FUNCTIONS.map(|f| f.0).join(", ");
                let names = self.names.join(", ");
                return Err(format!("`{word}` is not known here; names: {names}; functions: {functions}"));
            }
        };
        self.at += word.len();
        Ok(found)
    }

    fn call(&mut self, function: Function) -> Parsed {
        if !self.consume("(") {
            return Err(self.expected("`(`"));
        }
        let mut arguments = vec![self.disjunction()?];
        while self.consume(",") {
            arguments.push(self.disjunction()?);
        }
        if !self.consume(")") {
            return Err(self.expected("`,` or `)`"));
        }
        let several = arguments.len();
        match function {
            Function::One(f) if several == 1 => Ok(ExpressionNode::One(f, Box::new(arguments.remove(0)))),
            Function::Two(f) if several >= 2 => {
                let folded = arguments.into_iter().reduce(|a, b| ExpressionNode::Two(f, Box::new([a, b])));
                folded.ok_or_else(|| self.expected("arguments"))
            }
            Function::One(_) => Err(format!("one argument before character {}, not {several}", self.at)),
            Function::Two(_) => Err(format!("two arguments before character {}, not {several}", self.at)),
        }
    }

    fn number(&mut self) -> Parsed {
        let rest = self.rest().as_bytes();
        let digits = |from: usize| rest[from..].iter().take_while(|c| c.is_ascii_digit()).count();
        let mut end = digits(0);
        if rest.get(end) == Some(&b'.') {
            end += 1 + digits(end + 1);
        }
        if matches!(rest.get(end), Some(b'e' | b'E')) {
            let sign = usize::from(matches!(rest.get(end + 1), Some(b'+' | b'-')));
            end += 1 + sign + digits(end + 1 + sign);
        }
        match self.rest()[..end].parse::<f64>() {
            Ok(v) if v.is_finite() => {
                self.at += end;
                Ok(ExpressionNode::Number(v))
            }
            _ => Err(self.expected("a number, a name or `(`")),
        }
    }

    fn operator(&mut self, operators: &[Operator]) -> Option<fn(f64, f64) -> f64> {
        self.skip();
        let word = self.word();
        let found = operators.iter().find(|(sign, _)| {
            if sign.starts_with(char::is_alphabetic) { word == *sign } else { self.rest().starts_with(sign) }
        })?;
        self.at += found.0.len();
        Some(found.1)
    }

    fn consume(&mut self, sign: &str) -> bool {
        self.skip();
        let there = self.rest().starts_with(sign);
        self.at += if there { sign.len() } else { 0 };
        there
    }

    /// The name at the current position, or an empty string.
    fn word(&self) -> &str {
        let rest = self.rest();
        let end = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len());
        if rest.starts_with(|c: char| c.is_ascii_digit()) { "" } else { &rest[..end] }
    }

    fn skip(&mut self) {
        self.at += self.rest().len() - self.rest().trim_start().len();
    }

    fn rest(&self) -> &str {
        &self.text[self.at..]
    }

    fn expected(&self, what: &str) -> String {
        format!("{what} at character {}", self.text[..self.at].chars().count() + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names() -> Vec<String> {
        ["x", "d1", "order"].map(String::from).to_vec()
    }

    #[test]
    fn evaluates_known_values() {
        let check = |text: &str, wanted: f64| {
            let found = Expression::parse("f", text, &names()).unwrap().value(&[3.0, 0.5, 7.0]);
            assert_eq!(found.to_bits(), wanted.to_bits(), "{text}: {found} != {wanted}");
        };
        check("x + d1 * 2", 4.0);
        check("(x + d1) * 2", 7.0);
        check("x - d1 - 1", 1.5);
        check("12 / 2 / 3", 2.0);
        check("--x", 3.0);
        check("-x * -2", 6.0);
        check("max(x, order, 5) + min(1, 2)", 8.0);
        check("sqrt(0.5)", std::f64::consts::FRAC_1_SQRT_2);
        check("-pi / 4", -std::f64::consts::FRAC_PI_4);
        check("256 / 6", 256.0 / 6.0);
        check("1.5e-1", 0.15);
        check("order > 6 and not x == 4", 1.0);
        check("x < 1 or x >= 3", 1.0);
        check("x <= 1 or x != 3", 0.0);
        check("atan2(0, -1)", std::f64::consts::PI);
        check("floor(x / 2) + abs(0 - 1)", 2.0);
    }

    #[test]
    fn rejects_invalid_expressions_with_position() {
        let deep = format!("{}1{}", "(".repeat(60), ")".repeat(60));
        let long = "1 + ".repeat(200) + "1";
        for (text, wanted) in [
            ("", "a number, a name or `(` at character 1"),
            ("x +", "at character 4"),
            ("x 3", "an operator or the end at character 3"),
            ("x < 1 < 2", "an operator or the end at character 7"),
            ("y + 1", "`y` is not known here; names: x, d1, order; functions: min"),
            ("(x", "`)` at character 3"),
            ("max(x)", "two arguments"),
            ("sqrt(x, 1)", "one argument"),
            ("max x", "`(`"),
            ("x = 1", "an operator or the end"),
            ("1e999", "a number"),
            ("1e", "a number"),
            (".", "a number"),
            ("ä", "at character 1"),
            ("x ** 2", "at character 4"),
            (deep.as_str(), "at most 40"),
            (long.as_str(), "at most 400 bytes"),
        ] {
            let error = Expression::parse("require[0]", text, &names()).unwrap_err().to_string();
            assert!(error.contains(wanted) && error.starts_with("`require[0]` is"), "{text}: {error}");
        }
    }
}
