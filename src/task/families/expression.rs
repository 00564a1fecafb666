//! Arithmetic over named numbers, as families of tasks say how one number follows from others: `x1 + d1 / 2 + gap`.
//!
//! `+ - * /`, comparisons (1 if they hold, else 0), `and`, `or`, `not`, parentheses, `pi` and [`FUNCTIONS`]. No loops, no
//! assignments, nothing outside: an expression ends, and gives the same bits everywhere (`libm`, no fused products).

use crate::error::{Error, Result};

/// An expression whose names have been looked up.
#[derive(Clone, Debug)]
pub struct Expression(Term);

/// Most bytes of an expression; bounds how deep it can be, too.
const MOST_BYTES: usize = 400;
/// Most parentheses, calls and signs within each other.
const DEEPEST: usize = 40;
/// What may be called, with the number of arguments; `min` and `max` take two or more.
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
enum Term {
    Number(f64),
    /// Index of a name.
    Name(usize),
    One(fn(f64) -> f64, Box<Term>),
    Two(fn(f64, f64) -> f64, Box<[Term; 2]>),
}

impl Expression {
    /// Parses `text`, the value of `field`, over `names`; the error says where it stops being one.
    pub fn parse(field: &str, text: &str, names: &[String]) -> Result<Expression> {
        let refuse = |why: String| Error::input(field, format!("{text:?}"), format!("an expression ({why})"));
        if text.len() > MOST_BYTES {
            return Err(refuse(format!("at most {MOST_BYTES} bytes, this has {}", text.len())));
        }
        let mut parser = Parser { text, at: 0, names, depth: 0 };
        let term = parser.either().map_err(refuse)?;
        parser.skip();
        match parser.rest() {
            "" => Ok(Expression(term)),
            _ => Err(refuse(parser.wanted("an operator or the end"))),
        }
    }

    /// A number that follows from nothing.
    pub fn number(value: f64) -> Expression {
        Expression(Term::Number(value))
    }

    /// How much there is to compute: numbers, names and operations.
    pub fn size(&self) -> usize {
        self.0.size()
    }

    /// What it gives for values of the names it was parsed over; not finite where it has none.
    pub fn value(&self, values: &[f64]) -> f64 {
        self.0.value(values)
    }
}

impl Term {
    fn size(&self) -> usize {
        match self {
            Term::Number(_) | Term::Name(_) => 1,
            Term::One(_, a) => 1 + a.size(),
            Term::Two(_, ab) => 1 + ab[0].size() + ab[1].size(),
        }
    }

    fn value(&self, values: &[f64]) -> f64 {
        match self {
            Term::Number(v) => *v,
            Term::Name(i) => values.get(*i).copied().unwrap_or(f64::NAN),
            Term::One(f, a) => f(a.value(values)),
            Term::Two(f, ab) => f(ab[0].value(values), ab[1].value(values)),
        }
    }
}

/// An operator and what it does.
type Operator = (&'static str, fn(f64, f64) -> f64);

const OR: [Operator; 1] = [("or", |a, b| truth(a != 0.0 || b != 0.0))];
const AND: [Operator; 1] = [("and", |a, b| truth(a != 0.0 && b != 0.0))];
/// Longer ones first: `<=` begins with `<`.
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

/// By recursive descent; each level binds tighter than the one before.
struct Parser<'a> {
    text: &'a str,
    at: usize,
    names: &'a [String],
    depth: usize,
}

type Parsed = std::result::Result<Term, String>;

impl Parser<'_> {
    fn either(&mut self) -> Parsed {
        self.chain(&OR, |p| p.chain(&AND, Self::negated))
    }

    fn negated(&mut self) -> Parsed {
        self.skip();
        if self.word() != "not" {
            return self.compared();
        }
        self.at += "not".len();
        Ok(Term::One(|a| truth(a == 0.0), Box::new(self.negated()?)))
    }

    /// One comparison, not a chain: `a < b < c` would not mean what it says.
    fn compared(&mut self) -> Parsed {
        let left = self.chain(&SUMS, |p| p.chain(&PRODUCTS, Self::signed))?;
        let Some(compare) = self.operator(&COMPARED) else { return Ok(left) };
        let right = self.chain(&SUMS, |p| p.chain(&PRODUCTS, Self::signed))?;
        Ok(Term::Two(compare, Box::new([left, right])))
    }

    fn chain(&mut self, operators: &[Operator], next: fn(&mut Self) -> Parsed) -> Parsed {
        let mut left = next(self)?;
        while let Some(operator) = self.operator(operators) {
            left = Term::Two(operator, Box::new([left, next(self)?]));
        }
        Ok(left)
    }

    fn signed(&mut self) -> Parsed {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(format!("at most {DEEPEST} parentheses, calls and signs within each other"));
        }
        let term = if self.takes("-") { Term::One(|a| -a, Box::new(self.signed()?)) } else { self.one()? };
        self.depth -= 1;
        Ok(term)
    }

    fn one(&mut self) -> Parsed {
        if self.takes("(") {
            let inner = self.either()?;
            return if self.takes(")") { Ok(inner) } else { Err(self.wanted("`)`")) };
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
            Some(index) => Term::Name(index),
            None if word == "pi" => Term::Number(std::f64::consts::PI),
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
        if !self.takes("(") {
            return Err(self.wanted("`(`"));
        }
        let mut arguments = vec![self.either()?];
        while self.takes(",") {
            arguments.push(self.either()?);
        }
        if !self.takes(")") {
            return Err(self.wanted("`,` or `)`"));
        }
        let several = arguments.len();
        match function {
            Function::One(f) if several == 1 => Ok(Term::One(f, Box::new(arguments.remove(0)))),
            Function::Two(f) if several >= 2 => {
                let folded = arguments.into_iter().reduce(|a, b| Term::Two(f, Box::new([a, b])));
                folded.ok_or_else(|| self.wanted("arguments"))
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
                Ok(Term::Number(v))
            }
            _ => Err(self.wanted("a number, a name or `(`")),
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

    fn takes(&mut self, sign: &str) -> bool {
        self.skip();
        let there = self.rest().starts_with(sign);
        self.at += if there { sign.len() } else { 0 };
        there
    }

    /// The name that begins here, or nothing.
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

    fn wanted(&self, what: &str) -> String {
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
    fn values_known_by_hand() {
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
    fn what_is_no_expression_is_refused_where_it_stops() {
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
