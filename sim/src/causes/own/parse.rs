//! From an expression as it is written to a program: a parser by binding power (Pratt), which says where it stumbled.

use super::program::{One, Op, Program, STACK_DEPTH, Two, Variable, WHOLE_POWER_MAX, one, power, two};

/// What an expression may speak of.
pub(super) struct Scope<'a> {
    /// What is known of the instant there.
    pub(super) variables: &'a [Variable],
    /// Why something that is known elsewhere is not known there.
    pub(super) lacking: &'a dyn Fn(Variable) -> String,
    /// Names of the cause's parameters.
    pub(super) parameters: &'a [String],
}

/// Where an expression is not understood, and why.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stumble {
    /// Characters before it.
    pub(super) at: usize,
    /// How many characters are meant, 1 at least.
    pub(super) width: usize,
    pub(super) reason: String,
    /// A name that is not known, and those that are.
    pub(super) unknown: Option<(String, Vec<String>)>,
}

/// Most characters of an expression (chosen).
const CHARACTERS_MAX: usize = 1000;
/// Most nested brackets, signs and powers (chosen).
const NESTING_MAX: usize = 100;

/// Functions of one argument.
const FUNCTIONS_OF_ONE: [(&str, One); 9] = [
    ("sin", One::Sin),
    ("cos", One::Cos),
    ("tan", One::Tan),
    ("exp", One::Exp),
    ("log", One::Log),
    ("sqrt", One::Sqrt),
    ("abs", One::Abs),
    ("sign", One::Sign),
    ("tanh", One::Tanh),
];
/// Functions of two arguments.
const FUNCTIONS_OF_TWO: [(&str, Two); 3] = [("min", Two::Min), ("max", Two::Max), ("atan2", Two::Atan2)];
const CONSTANTS: [(&str, f64); 1] = [("pi", std::f64::consts::PI)];

/// Names that no parameter may have: those of functions and numbers.
pub(super) fn reserved() -> impl Iterator<Item = &'static str> {
    let ones = FUNCTIONS_OF_ONE.iter().map(|(name, _)| *name);
    ones.chain(FUNCTIONS_OF_TWO.iter().map(|(name, _)| *name)).chain(CONSTANTS.iter().map(|(name, _)| *name))
}

/// Precedence of operators, the highest binds most: sum, product, unary sign, power.
const SUM_PRECEDENCE: u8 = 1;
const PRODUCT_PRECEDENCE: u8 = 2;
const SIGN_PRECEDENCE: u8 = 3;
const POWER_PRECEDENCE: u8 = 4;

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Number(f64),
    Name(String),
    Mark(char),
    End,
}

#[derive(Debug, Clone, PartialEq)]
struct Spot {
    token: Token,
    at: usize,
    width: usize,
}

impl Spot {
    fn syntax_error(&self, reason: String) -> Stumble {
        Stumble { at: self.at, width: self.width.max(1), reason, unknown: None }
    }

    /// As it is written.
    fn text(&self, source: &[char]) -> String {
        source[self.at..self.at + self.width].iter().collect()
    }
}

/// The program of `text`.
pub(super) fn parse(text: &str, scope: &Scope<'_>) -> Result<Program, Stumble> {
    let source: Vec<char> = text.chars().collect();
    if source.len() > CHARACTERS_MAX {
        let reason = format!("it has {} characters; the limit is {CHARACTERS_MAX}", source.len());
        return Err(Stumble { at: 0, width: 1, reason, unknown: None });
    }
    let spots = tokens(&source)?;
    let mut parser = Parser { source: &source, spots, next: 0, nested: 0, scope, ops: Vec::new() };
    parser.expression(0)?;
    let left = parser.peek().clone();
    match &left.token {
        Token::End => {}
        Token::Mark(')') => return Err(left.syntax_error("a `)` without its `(`".into())),
        Token::Mark(',') => return Err(left.syntax_error("a comma outside of a function".into())),
        _ => {
            let reason =
                format!("an operator is missing before `{}`: write `*` for a product", left.text(&source));
            return Err(left.syntax_error(reason));
        }
    }
    let program = Program { ops: parser.ops };
    let depth = program.depth();
    if depth > STACK_DEPTH {
        let reason =
            format!("{depth} numbers wait for one another; the limit is {STACK_DEPTH}: nest it less deeply");
        return Err(Stumble { at: 0, width: source.len().max(1), reason, unknown: None });
    }
    Ok(program)
}

fn tokens(source: &[char]) -> Result<Vec<Spot>, Stumble> {
    let mut spots = Vec::new();
    let mut at = 0;
    while at < source.len() {
        let run = |from: usize, holds: &dyn Fn(char) -> bool| {
            source[from..].iter().take_while(|c| holds(**c)).count()
        };
        let first = source[at];
        let (token, width) = if first.is_whitespace() {
            at += 1;
            continue;
        } else if first.is_ascii_digit() || first == '.' {
            number(source, at)?
        } else if first.is_alphabetic() || first == '_' {
            let width = run(at, &|c| c.is_alphanumeric() || c == '_');
            (Token::Name(source[at..at + width].iter().collect()), width)
        } else if first == '*' && source.get(at + 1) == Some(&'*') {
            return Err(Stumble { at, width: 2, reason: "a power is written `^`".into(), unknown: None });
        } else if "+-*/^(),".contains(first) {
            (Token::Mark(first), 1)
        } else {
            let reason = match first {
                '−' | '–' => "a minus is written `-`".to_owned(),
                '·' | '×' => "a product is written `*`".to_owned(),
                _ => format!("`{first}` means nothing here"),
            };
            return Err(Stumble { at, width: 1, reason, unknown: None });
        };
        spots.push(Spot { token, at, width });
        at += width;
    }
    spots.push(Spot { token: Token::End, at: source.len(), width: 0 });
    Ok(spots)
}

/// The number at `at`: digits, a point, an exponent.
fn number(source: &[char], at: usize) -> Result<(Token, usize), Stumble> {
    let digits = |from: usize| source[from..].iter().take_while(|c| c.is_ascii_digit()).count();
    let mut end = at + digits(at);
    if source.get(end) == Some(&'.') {
        end += 1;
        end += digits(end);
    }
    if matches!(source.get(end), Some('e' | 'E')) {
        let sign = usize::from(matches!(source.get(end + 1), Some('+' | '-')));
        let exponent = if end + 1 + sign <= source.len() { digits(end + 1 + sign) } else { 0 };
        if exponent > 0 {
            end += 1 + sign + exponent;
        }
    }
    let text: String = source[at..end].iter().collect();
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok((Token::Number(number), end - at)),
        _ => {
            let reason = format!("`{text}` is no number");
            Err(Stumble { at, width: end - at, reason, unknown: None })
        }
    }
}

struct Parser<'a> {
    source: &'a [char],
    spots: Vec<Spot>,
    next: usize,
    nested: usize,
    scope: &'a Scope<'a>,
    ops: Vec<Op>,
}

impl Parser<'_> {
    fn peek(&self) -> &Spot {
        // the last one is the end, which nothing goes beyond
        &self.spots[self.next.min(self.spots.len() - 1)]
    }

    fn take(&mut self) -> Spot {
        let spot = self.peek().clone();
        self.next += 1;
        spot
    }

    fn is_next(&self, mark: char) -> bool {
        self.peek().token == Token::Mark(mark)
    }

    /// Whatever binds more tightly than `least`.
    fn expression(&mut self, least: u8) -> Result<(), Stumble> {
        self.nested += 1;
        if self.nested > NESTING_MAX {
            return Err(self.peek().syntax_error(format!("it is nested deeper than {NESTING_MAX}")));
        }
        let begin = self.ops.len();
        self.operand()?;
        while let Token::Mark(mark) = self.peek().token {
            let (function, binds, right) = match mark {
                '+' => (Two::Add, SUM_PRECEDENCE, SUM_PRECEDENCE),
                '-' => (Two::Sub, SUM_PRECEDENCE, SUM_PRECEDENCE),
                '*' => (Two::Mul, PRODUCT_PRECEDENCE, PRODUCT_PRECEDENCE),
                '/' => (Two::Div, PRODUCT_PRECEDENCE, PRODUCT_PRECEDENCE),
                // from the right, and a sign may follow it
                '^' => (Two::Pow, POWER_PRECEDENCE, SIGN_PRECEDENCE),
                _ => break,
            };
            if binds <= least {
                break;
            }
            self.take();
            let middle = self.ops.len();
            self.expression(right)?;
            self.apply(function, begin, middle);
        }
        self.nested -= 1;
        Ok(())
    }

    fn operand(&mut self) -> Result<(), Stumble> {
        let spot = self.take();
        match &spot.token {
            Token::Number(number) => self.ops.push(Op::Constant(*number)),
            Token::Name(name) if self.is_next('(') => self.call(&spot, name)?,
            Token::Name(name) => {
                let op = self.name(&spot, name)?;
                self.ops.push(op);
            }
            Token::Mark('(') => {
                self.expression(0)?;
                self.close(&spot)?;
            }
            Token::Mark('-') => {
                let begin = self.ops.len();
                self.expression(SIGN_PRECEDENCE)?;
                self.apply_one(One::Neg, begin);
            }
            Token::Mark('+') => self.expression(SIGN_PRECEDENCE)?,
            Token::Mark(mark) => {
                let reason = format!("a number, a name or a `(` should stand here, not `{mark}`");
                return Err(spot.syntax_error(reason));
            }
            Token::End => {
                let reason = if self.source.iter().all(|c| c.is_whitespace()) {
                    "it is empty"
                } else {
                    "it ends where a number, a name or a `(` should stand"
                };
                return Err(spot.syntax_error(reason.into()));
            }
        }
        Ok(())
    }

    /// The `)` that `open` waits for.
    fn close(&mut self, open: &Spot) -> Result<(), Stumble> {
        if self.is_next(')') {
            self.take();
            return Ok(());
        }
        let next = self.peek();
        Err(match &next.token {
            Token::End => open.syntax_error("this `(` is never closed".into()),
            Token::Mark(mark) => next.syntax_error(format!("a `)` should stand here, not `{mark}`")),
            _ => {
                let text = next.text(self.source);
                next.syntax_error(format!("an operator is missing before `{text}`: write `*` for a product"))
            }
        })
    }

    fn call(&mut self, spot: &Spot, name: &str) -> Result<(), Stumble> {
        let open = self.take();
        let ones = FUNCTIONS_OF_ONE.iter().find(|(known, _)| *known == name).map(|(_, function)| *function);
        let twos = FUNCTIONS_OF_TWO.iter().find(|(known, _)| *known == name).map(|(_, function)| *function);
        if ones.is_none() && twos.is_none() {
            if self.name(spot, name).is_ok() {
                return Err(
                    spot.syntax_error(format!("`{name}` is no function: write `{name} * (` for a product"))
                );
            }
            let names = FUNCTIONS_OF_ONE
                .iter()
                .map(|(name, _)| *name)
                .chain(FUNCTIONS_OF_TWO.iter().map(|(name, _)| *name));
            return Err(self.unknown(spot, "function", name, names.map(str::to_owned).collect()));
        }
        let begin = self.ops.len();
        self.expression(0)?;
        if let Some(function) = ones {
            if self.is_next(',') {
                return Err(self.peek().syntax_error(format!("`{name}` takes one number")));
            }
            self.close(&open)?;
            self.apply_one(function, begin);
        } else if let Some(function) = twos {
            if !self.is_next(',') {
                return Err(self
                    .peek()
                    .syntax_error(format!("`{name}` takes two numbers, with a comma between")));
            }
            self.take();
            let middle = self.ops.len();
            self.expression(0)?;
            if self.is_next(',') {
                return Err(self.peek().syntax_error(format!("`{name}` takes two numbers")));
            }
            self.close(&open)?;
            self.apply(function, begin, middle);
        }
        Ok(())
    }

    fn name(&self, spot: &Spot, name: &str) -> Result<Op, Stumble> {
        if let Some(place) = self.scope.parameters.iter().position(|known| known == name) {
            return Ok(Op::Parameter(place));
        }
        if let Some(variable) = self.scope.variables.iter().find(|variable| variable.name() == name) {
            return Ok(Op::Variable(*variable as usize));
        }
        if let Some((_, number)) = CONSTANTS.iter().find(|(known, _)| *known == name) {
            return Ok(Op::Constant(*number));
        }
        if let Some(variable) = Variable::ALL.into_iter().find(|variable| variable.name() == name) {
            return Err(spot.syntax_error((self.scope.lacking)(variable)));
        }
        if reserved().any(|known| known == name) {
            return Err(spot.syntax_error(format!("the function `{name}` needs a `(` after it")));
        }
        let variables = self.scope.variables.iter().map(|variable| variable.name().to_owned());
        let constants = CONSTANTS.iter().map(|(name, _)| (*name).to_owned());
        let known = self.scope.parameters.iter().cloned().chain(variables).chain(constants).collect();
        Err(self.unknown(spot, "number", name, known))
    }

    fn unknown(&self, spot: &Spot, what: &str, name: &str, known: Vec<String>) -> Stumble {
        let reason = format!("there is no {what} called `{name}`");
        Stumble { unknown: Some((name.to_owned(), known)), ..spot.syntax_error(reason) }
    }

    /// Puts `function` after its operand, which begins at `begin`; of a constant it makes one.
    fn apply_one(&mut self, function: One, begin: usize) {
        match self.ops[begin..] {
            [Op::Constant(x)] => {
                self.ops.truncate(begin);
                self.ops.push(Op::Constant(one(function, x)));
            }
            _ => self.ops.push(Op::One(function)),
        }
    }

    /// Puts `function` after its operands, which begin at `begin` and `middle`; of constants it makes one.
    fn apply(&mut self, function: Two, begin: usize, middle: usize) {
        let constant = |ops: &[Op]| match *ops {
            [Op::Constant(x)] => Some(x),
            _ => None,
        };
        let (left, right) = (constant(&self.ops[begin..middle]), constant(&self.ops[middle..]));
        let whole = right.filter(|x| x.fract() == 0.0 && x.abs() <= f64::from(WHOLE_POWER_MAX));
        let op = match (function, whole, right) {
            (Two::Pow, Some(exponent), _) => Op::Power(exponent as i32),
            (Two::Pow, None, Some(0.5)) => Op::One(One::Sqrt),
            _ => Op::Two(function),
        };
        if !matches!(op, Op::Two(_)) {
            self.ops.truncate(middle);
        }
        let folded = match (op, left, right) {
            (Op::Two(function), Some(a), Some(b)) => Some(two(function, a, b)),
            (Op::Power(exponent), Some(a), _) => Some(power(a, exponent)),
            (Op::One(function), Some(a), _) => Some(one(function, a)),
            _ => None,
        };
        match folded {
            Some(number) => {
                self.ops.truncate(begin);
                self.ops.push(Op::Constant(number));
            }
            None => self.ops.push(op),
        }
    }
}
