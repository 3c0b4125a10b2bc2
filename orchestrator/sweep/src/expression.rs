//! Expressions of a sweep: values computed from others (`m * r^2`), and criteria (`max < 0.03 and not lost`).
//!
//! All values are numbers: a comparison is 1 or 0, and any number but 0 is true. A chain such as `0 < x < 1` is true if every
//! comparison in it is. A missing value is NaN, and so is every result that depends on it: a comparison with a missing value is
//! missing, and neither it nor its negation is true. All functions are those of `libm`, so that samples do not depend on the
//! machine.

use std::fmt::{Display, Formatter};

/// Number of characters that an error shows on each side of its position.
const SHOWN: usize = 100;

/// Maximum nesting of brackets, signs and exponents: each is a step of a recursion.
const DEPTH_MAX: usize = 100;

/// Maximum number of operators: a long sum is a deeply nested tree.
const OPERATORS_MAX: usize = 1000;

/// An expression whose names are resolved to indices of a list of values.
#[derive(Clone, Debug, PartialEq)]
pub struct Expression(Node);

#[derive(Clone, Debug, PartialEq)]
enum Node {
    Number(f64),
    Value(usize),
    Negative(Box<Node>),
    Not(Box<Node>),
    Binary(Operator, Box<(Node, Node)>),
    /// Chained comparisons, each with the preceding value.
    Chain(Box<Node>, Vec<(Operator, Node)>),
    Call(Function, Vec<Node>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Operator {
    Or,
    And,
    Equal,
    NotEqual,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    Plus,
    Minus,
    Times,
    Over,
    Power,
}

/// Operators by precedence, the lowest first; all are left-associative.
const LEVELS: [&[(&str, Operator)]; 5] = [
    &[("or", Operator::Or)],
    &[("and", Operator::And)],
    &[
        ("==", Operator::Equal),
        ("!=", Operator::NotEqual),
        ("<=", Operator::LessOrEqual),
        (">=", Operator::GreaterOrEqual),
        ("<", Operator::Less),
        (">", Operator::Greater),
    ],
    &[("+", Operator::Plus), ("-", Operator::Minus)],
    &[("*", Operator::Times), ("/", Operator::Over)],
];

/// Level of the comparisons, which form chains.
const COMPARISONS: usize = 2;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Function {
    Abs,
    Cos,
    Exp,
    Ln,
    Max,
    Min,
    Sin,
    Sqrt,
}

/// Functions with the number of their arguments.
const FUNCTIONS: [(&str, Function, usize); 8] = [
    ("abs", Function::Abs, 1),
    ("cos", Function::Cos, 1),
    ("exp", Function::Exp, 1),
    ("ln", Function::Ln, 1),
    ("max", Function::Max, 2),
    ("min", Function::Min, 2),
    ("sin", Function::Sin, 1),
    ("sqrt", Function::Sqrt, 1),
];

/// Error of an invalid expression.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExpressionError {
    /// Text of the expression.
    pub text: String,
    /// Position of the error, bytes from the start.
    pub offset: usize,
    /// Reason and fix.
    pub reason: String,
}

impl Display for ExpressionError {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        let offset = self.text.floor_char_boundary(self.offset);
        let (before, after) = self.text.split_at(offset);
        let begin = before.char_indices().rev().take(SHOWN).last();
        let before = &before[begin.map_or(0, |(at, _)| at)..];
        let after: String = after.chars().take(SHOWN).collect();
        let mark = " ".repeat(before.chars().count());
        write!(formatter, "{}\n    {before}{after}\n    {mark}^", self.reason)
    }
}

impl std::error::Error for ExpressionError {}

impl Expression {
    /// Parses an expression; `index_of` returns the index of a name's value.
    ///
    /// # Errors
    /// [`ExpressionError`] with the position and the fix.
    pub fn parse(text: &str, index_of: impl Fn(&str) -> Option<usize>) -> Result<Self, ExpressionError> {
        let mut parser = Parser {
            text,
            offset: 0,
            index_of: &index_of,
            depth: 0,
            operators: 0,
        };
        let node = parser.level(0)?;
        parser.skip_blanks();
        if parser.offset < text.len() {
            return Err(parser.error("expected the end of the expression here"));
        }
        Ok(Self(node))
    }

    /// Returns the value.
    #[must_use]
    pub fn value(&self, values: &[f64]) -> f64 {
        self.0.value(values)
    }

    /// Returns whether it is true: neither 0 nor missing.
    #[must_use]
    pub fn is_true(&self, values: &[f64]) -> bool {
        is_true(self.value(values))
    }

    /// Returns the indices of all values in the expression.
    #[must_use]
    pub fn indices(&self) -> Vec<usize> {
        let mut indices = Vec::new();
        self.0.collect_indices(&mut indices);
        indices
    }
}

fn is_true(value: f64) -> bool {
    value != 0.0 && !value.is_nan()
}

impl Node {
    fn value(&self, values: &[f64]) -> f64 {
        match self {
            Self::Number(number) => *number,
            Self::Value(index) => values[*index],
            Self::Negative(node) => -node.value(values),
            Self::Not(node) => known(node.value(values)).map_or(f64::NAN, |known| truth(!known)),
            Self::Binary(operator, sides) => operator.apply(sides.0.value(values), sides.1.value(values)),
            Self::Chain(first, comparisons) => {
                let mut left = first.value(values);
                comparisons.iter().fold(1.0, |all, (operator, node)| {
                    let right = node.value(values);
                    let holds = operator.apply(left, right);
                    left = right;
                    Operator::And.apply(all, holds)
                })
            }
            Self::Call(function, arguments) => {
                let first = arguments[0].value(values);
                function.apply(
                    first,
                    arguments.get(1).map_or(first, |second| second.value(values)),
                )
            }
        }
    }

    fn collect_indices(&self, indices: &mut Vec<usize>) {
        match self {
            Self::Number(_) => {}
            Self::Value(index) => indices.push(*index),
            Self::Negative(node) | Self::Not(node) => node.collect_indices(indices),
            Self::Binary(_, sides) => {
                sides.0.collect_indices(indices);
                sides.1.collect_indices(indices);
            }
            Self::Chain(first, comparisons) => {
                first.collect_indices(indices);
                comparisons
                    .iter()
                    .for_each(|(_, node)| node.collect_indices(indices));
            }
            Self::Call(_, arguments) => arguments.iter().for_each(|node| node.collect_indices(indices)),
        }
    }
}

/// Returns whether a value is true; `None` if it is missing.
fn known(value: f64) -> Option<bool> {
    (!value.is_nan()).then_some(value != 0.0)
}

fn truth(is_true: bool) -> f64 {
    f64::from(u8::from(is_true))
}

impl Operator {
    #[expect(clippy::float_cmp, reason = "the user's expression compares exactly")]
    fn apply(self, a: f64, b: f64) -> f64 {
        let is_missing = a.is_nan() || b.is_nan();
        match self {
            // One side may determine the result even if the other one is missing.
            Self::Or if is_true(a) || is_true(b) => 1.0,
            Self::And if known(a) == Some(false) || known(b) == Some(false) => 0.0,
            _ if is_missing => f64::NAN,
            Self::Or => 0.0,
            Self::And => 1.0,
            Self::Equal => truth(a == b),
            Self::NotEqual => truth(a != b),
            Self::Less => truth(a < b),
            Self::LessOrEqual => truth(a <= b),
            Self::Greater => truth(a > b),
            Self::GreaterOrEqual => truth(a >= b),
            Self::Plus => a + b,
            Self::Minus => a - b,
            Self::Times => a * b,
            Self::Over => a / b,
            Self::Power => libm::pow(a, b),
        }
    }
}

impl Function {
    fn apply(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Abs => a.abs(),
            Self::Cos => libm::cos(a),
            Self::Exp => libm::exp(a),
            Self::Ln => libm::log(a),
            Self::Max | Self::Min if a.is_nan() || b.is_nan() => f64::NAN,
            Self::Max => a.max(b),
            Self::Min => a.min(b),
            Self::Sin => libm::sin(a),
            Self::Sqrt => a.sqrt(),
        }
    }
}

struct Parser<'a> {
    text: &'a str,
    offset: usize,
    index_of: &'a dyn Fn(&str) -> Option<usize>,
    /// Current nesting.
    depth: usize,
    operators: usize,
}

impl Parser<'_> {
    fn rest(&self) -> &str {
        &self.text[self.offset..]
    }

    fn skip_blanks(&mut self) {
        self.offset = self.text.len() - self.rest().trim_start().len();
    }

    fn error(&self, reason: impl Into<String>) -> ExpressionError {
        ExpressionError {
            text: self.text.to_owned(),
            offset: self.offset,
            reason: reason.into(),
        }
    }

    /// Consumes a symbol or a word, if it comes next.
    fn take(&mut self, symbol: &str) -> bool {
        self.skip_blanks();
        let Some(after) = self.rest().strip_prefix(symbol) else {
            return false;
        };
        let is_word = symbol.starts_with(char::is_alphabetic);
        if is_word && after.starts_with(is_part_of_name) {
            return false;
        }
        self.offset += symbol.len();
        true
    }

    /// Parses operators of this and higher precedence.
    fn level(&mut self, level: usize) -> Result<Node, ExpressionError> {
        let Some(operators) = LEVELS.get(level) else {
            return self.unary();
        };
        let mut left = self.level(level + 1)?;
        let mut comparisons = Vec::new();
        while let Some((_, operator)) = operators.iter().find(|(symbol, _)| self.take(symbol)) {
            self.operators += 1;
            if self.operators > OPERATORS_MAX {
                return Err(self.error(format!("an expression has at most {OPERATORS_MAX} operators")));
            }
            let right = self.level(level + 1)?;
            if level == COMPARISONS {
                comparisons.push((*operator, right));
            } else {
                left = Node::Binary(*operator, Box::new((left, right)));
            }
        }
        Ok(match comparisons.is_empty() {
            true => left,
            false => Node::Chain(Box::new(left), comparisons),
        })
    }

    fn unary(&mut self) -> Result<Node, ExpressionError> {
        if self.depth == DEPTH_MAX {
            let reason = format!("brackets, signs and exponents nest at most {DEPTH_MAX} deep");
            return Err(self.error(reason));
        }
        self.depth += 1;
        let node = self.signed()?;
        self.depth -= 1;
        Ok(node)
    }

    fn signed(&mut self) -> Result<Node, ExpressionError> {
        if self.take("-") {
            return Ok(Node::Negative(Box::new(self.unary()?)));
        }
        if self.take("not") {
            // `not a < b` is `not (a < b)`.
            return Ok(Node::Not(Box::new(self.level(COMPARISONS)?)));
        }
        let base = self.primary()?;
        if self.take("^") {
            let exponent = self.unary()?;
            return Ok(Node::Binary(Operator::Power, Box::new((base, exponent))));
        }
        Ok(base)
    }

    fn primary(&mut self) -> Result<Node, ExpressionError> {
        if self.take("(") {
            let node = self.level(0)?;
            return self.closed(node);
        }
        self.skip_blanks();
        let number = self.number_length();
        if number > 0 {
            let value = self.rest()[..number].parse();
            let value = value.map_err(|_| self.error("this is not a number"))?;
            self.offset += number;
            return Ok(Node::Number(value));
        }
        let name = self.rest()[..self.name_length()].to_owned();
        if name.is_empty() {
            return Err(self.error("expected a number, a name or a bracket here"));
        }
        self.named(&name)
    }

    fn named(&mut self, name: &str) -> Result<Node, ExpressionError> {
        let start = self.offset;
        self.offset += name.len();
        if self.take("(") {
            let Some(&(_, function, count)) = FUNCTIONS.iter().find(|(other, _, _)| *other == name) else {
                self.offset = start;
                let names = FUNCTIONS.map(|(name, _, _)| name).join(", ");
                return Err(self.error(format!("there is no function `{name}`; there are {names}")));
            };
            let mut arguments = vec![self.level(0)?];
            while self.take(",") {
                arguments.push(self.level(0)?);
            }
            if arguments.len() != count {
                self.offset = start;
                return Err(self.error(format!("`{name}` has {count} arguments, not {}", arguments.len())));
            }
            return self.closed(Node::Call(function, arguments));
        }
        match (self.index_of)(name) {
            Some(index) => Ok(Node::Value(index)),
            None => {
                self.offset = start;
                Err(self.error(format!("there is no value `{name}`")))
            }
        }
    }

    fn closed(&mut self, node: Node) -> Result<Node, ExpressionError> {
        if self.take(")") {
            Ok(node)
        } else {
            Err(self.error("expected `)` here"))
        }
    }

    /// Returns the length of the name at this position, including its dots: `vehicle.mass`, `vehicle.drag.0`.
    fn name_length(&self) -> usize {
        let rest = self.rest();
        let is_inside = |(at, character): (usize, char)| {
            let is_dot = at > 0 && character == '.' && rest[at + 1..].starts_with(is_part_of_name);
            is_dot || is_part_of_name(character)
        };
        let end = rest.char_indices().find(|&position| !is_inside(position));
        end.map_or(rest.len(), |(at, _)| at)
    }

    /// Returns the length of the number at this position; 0 if there is none.
    fn number_length(&self) -> usize {
        let bytes = self.rest().as_bytes();
        let digits = |from: usize| {
            let run = bytes[from..].iter().take_while(|byte| byte.is_ascii_digit());
            from + run.count()
        };
        let mut end = digits(0);
        if bytes.get(end) == Some(&b'.') {
            end = digits(end + 1);
        }
        if end == 0 || (end == 1 && bytes[0] == b'.') {
            return 0;
        }
        if let Some(b'e' | b'E') = bytes.get(end) {
            let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
            let exponent = digits(end + 1 + sign);
            if exponent > end + 1 + sign {
                end = exponent;
            }
        }
        end
    }
}

fn is_part_of_name(character: char) -> bool {
    character.is_alphanumeric() || character == '_'
}

/// Returns whether a text is a valid name in expressions.
#[must_use]
pub fn is_name(text: &str) -> bool {
    let is_word = LEVELS[..2]
        .iter()
        .flat_map(|level| level.iter())
        .any(|(word, _)| *word == text)
        || text == "not";
    text.starts_with(|character: char| character.is_alphabetic() || character == '_')
        && text.chars().all(is_part_of_name)
        && !is_word
}

#[cfg(test)]
mod tests;
