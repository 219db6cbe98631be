//! Whether a cause of one's own is what a diagnosis can work with: absent where its sizes are 0, felt as soon as they are not, and a
//! number everywhere.

use super::program::{Program, VARIABLES, Variable};
use super::{Acts, OwnCause, OwnCauseError};
use crate::dual::Dual;
use crate::scalar::Scalar;

/// A number with its derivative along one direction.
type Slope = Dual<f64, 1>;

/// Number of states in which an expression is tried (chosen), the first with everything at 0.
const EXPRESSION_TRIAL_COUNT: u32 = 64;
/// Value at sizes of 0, over that at typical sizes, that counts as rounding (chosen).
const ABSENT_ROUNDING_SHARE: f64 = 1e-12;

/// An instant, and the values of the parameters.
struct Trial {
    variables: [f64; VARIABLES],
    parameters: Vec<f64>,
}

impl Trial {
    /// The value and its derivative along the variable or the parameter at these places.
    fn slope(&self, program: &Program, along: (Option<usize>, Option<usize>)) -> Slope {
        let number = |x: f64, yes: bool| if yes { Slope::variable(x, 0) } else { Slope::constant(x) };
        let mut variables = [Slope::ZERO; VARIABLES];
        for (place, (to, from)) in variables.iter_mut().zip(self.variables).enumerate() {
            *to = number(from, along.0 == Some(place));
        }
        let parameters = self.parameters.iter().enumerate();
        let parameters: Vec<Slope> = parameters.map(|(i, &x)| number(x, along.1 == Some(i))).collect();
        program.value(&variables, &parameters)
    }

    fn value(&self, program: &Program) -> f64 {
        program.value(&self.variables, &self.parameters)
    }

    /// The instant as `q = 0.3, v = -1`, as far as `program` asks for it.
    fn described(&self, definition: &OwnCause, program: &Program) -> String {
        let asked = Variable::ALL.into_iter().filter(|variable| program.asks(*variable));
        let variables =
            asked.map(|variable| format!("{} = {:.3}", variable.name(), self.variables[variable as usize]));
        let parameters = definition.parameters.iter().zip(&self.parameters).enumerate();
        let parameters = parameters
            .filter(|(place, _)| program.asks_parameter(*place))
            .map(|(_, (parameter, value))| format!("{} = {value}", parameter.name));
        let all: Vec<String> = variables.chain(parameters).collect();
        if all.is_empty() { "always".into() } else { format!("at {}", all.join(", ")) }
    }
}

/// The `index`th number of van der Corput's sequence to `base`, between 0 and 1.
fn spread(mut index: u32, base: u32) -> f64 {
    let (mut sum, mut share) = (0.0, 1.0);
    while index > 0 {
        share /= f64::from(base);
        sum += share * f64::from(index % base);
        index /= base;
    }
    sum
}

/// The instants, spread evenly over what may be (Halton's sequence), with the sizes at `sizes` times what is typical.
fn trials(definition: &OwnCause, sizes: f64) -> Vec<Trial> {
    const PRIMES: [u32; 24] =
        [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89];
    let trial = |index: u32| {
        let mut variables = [0.0; VARIABLES];
        for (variable, base) in Variable::ALL.into_iter().zip(PRIMES) {
            let at = 2.0 * spread(index, base) - 1.0;
            // time does not run backward
            let at = if variable == Variable::T { at.abs() } else { at };
            variables[variable as usize] = if index == 0 { 0.0 } else { at * variable.reach() };
        }
        let parameters = definition.parameters.iter().zip(PRIMES[VARIABLES..].iter().cycle());
        let parameters = parameters.map(|(parameter, &base)| match parameter.hidden.first() {
            None if parameter.bounds[1] <= 0.0 => -sizes * parameter.typical,
            None => sizes * parameter.typical,
            Some(&start) if index == 0 => start,
            Some(_) => {
                let [lower, upper] = parameter.bounds;
                // not on the bounds, which may be where a formula ends
                lower + (upper - lower) * (0.02 + 0.96 * spread(index, base))
            }
        });
        Trial { variables, parameters: parameters.collect() }
    };
    (0..EXPRESSION_TRIAL_COUNT).map(trial).collect()
}

/// # Errors
/// What the cause is not, and where.
pub(super) fn check(definition: &OwnCause, programs: &[(Acts, Program)]) -> Result<(), OwnCauseError> {
    let (absent, there) = (trials(definition, 0.0), trials(definition, 1.0));
    let sizes = definition.parameters.iter().filter(|parameter| parameter.is_size()).count();
    let several = match sizes {
        1 => "",
        _ => "; a parameter that only shapes the term gets `hidden`, its start values, and is no size then",
    };
    for ((acts, program), (_, text)) in programs.iter().zip(&definition.terms) {
        let name = acts.name();
        for trial in absent.iter().chain(&there) {
            is_number(definition, program, trial)
                .map_err(|what| definition.refused(text, format!("`{name}` {what}{several}")))?;
        }
        let scale = there.iter().map(|trial| trial.value(program).abs()).fold(0.0, f64::max);
        for trial in &absent {
            let left = trial.value(program);
            if left.abs() > ABSENT_ROUNDING_SHARE * scale {
                let sizes: Vec<String> = definition
                    .parameters
                    .iter()
                    .filter(|parameter| parameter.is_size())
                    .map(|parameter| format!("`{}`", parameter.name))
                    .collect();
                let reason = format!(
                    "`{name}` is {left:.3e} {}, with the size at 0: it must vanish there, so that a model without the cause is one \
                     with the size 0. Make {} a factor of every part; a number that only shapes the term gets `hidden`, its start \
                     values",
                    trial.described(definition, program),
                    sizes.join(" or ")
                );
                return Err(definition.refused(text, reason));
            }
        }
    }
    for (place, parameter) in definition.parameters.iter().enumerate() {
        let name = &parameter.name;
        if !programs.iter().any(|(_, program)| program.asks_parameter(place)) {
            let reason = format!("parameter `{name}` stands in no expression: use it, or remove it");
            return Err(definition.refused(name, reason));
        }
        let felt = |trial: &Trial| {
            programs.iter().any(|(_, program)| trial.slope(program, (None, Some(place))).partials[0] != 0.0)
        };
        if parameter.is_size() && !absent.iter().any(felt) {
            let reason = format!(
                "parameter `{name}` changes nothing to first order at 0, where a search for it begins: let the term grow in \
                 proportion to it, or give it `hidden`, its start values, if another size makes the term vanish"
            );
            return Err(definition.refused(name, reason));
        }
        if !parameter.is_size() && !there.iter().any(felt) {
            let reason = format!("parameter `{name}` changes nothing where the sizes are typical: remove it");
            return Err(definition.refused(name, reason));
        }
    }
    Ok(())
}

/// Whether value and derivatives of `program` are finite at `trial`; if not, which is not and where.
fn is_number(definition: &OwnCause, program: &Program, trial: &Trial) -> Result<(), String> {
    let described = || trial.described(definition, program);
    if !trial.value(program).is_finite() {
        return Err(format!(
            "is no finite number {}: it must be one wherever the mechanism may be, at rest too",
            described()
        ));
    }
    let variables = Variable::ALL.into_iter().filter(|variable| program.asks(*variable));
    let variables = variables.map(|variable| (variable.name().to_owned(), (Some(variable as usize), None)));
    let parameters = definition.parameters.iter().enumerate();
    let parameters = parameters.map(|(place, parameter)| (parameter.name.clone(), (None, Some(place))));
    for (name, along) in variables.chain(parameters) {
        if !trial.slope(program, along).partials[0].is_finite() {
            return Err(format!(
                "has no finite slope by `{name}` {}: smooth it there, as sqrt({name}^2 + 0.001^2) smooths abs({name})",
                described()
            ));
        }
    }
    Ok(())
}
