//! Values that are chosen by name, as clap reads them.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use ground::choice::Choice;

/// Reads the name of one of the values of `T`, and lists them where it is none.
pub(super) fn choice<T: Choice>() -> impl TypedValueParser<Value = T> {
    let values = T::ALL.iter().map(|(_, name, what)| PossibleValue::new(*name).help(*what));
    PossibleValuesParser::new(values)
        .try_map(|name| T::of_name(&name).ok_or_else(|| format!("{name} is none of them")))
}
