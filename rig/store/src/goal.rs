//! The goal of a campaign.

use std::fmt;
use std::str::FromStr;

use ident::fit::Fit;
use serde::{Deserialize, Serialize};

/// The goal at which a campaign ends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Goal {
    /// The diagnosis has one clear verdict, checked by a run that it was not made from.
    Resolve,
    /// Each of these parameters is known so well.
    Precision(Vec<Target>),
}

/// How well a fitted parameter is to be known, as one standard deviation: `g3/blunt 5%` of its value, or `q2/damping 1e-7` in its SI unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Target {
    /// The parameter.
    pub name: String,
    within: Within,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Within {
    Percent(f64),
    Absolute(f64),
}

/// How well a parameter is known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Known {
    /// The parameter.
    pub name: String,
    /// As fitted, SI.
    pub value: f64,
    /// One standard deviation.
    pub std: f64,
    /// The wanted standard deviation.
    pub wanted_std: f64,
}

impl Known {
    /// Ratio of the standard deviation to the wanted one: at most 1 where the goal is reached.
    pub fn ratio(&self) -> f64 {
        if self.std.is_finite() && self.wanted_std > 0.0 { self.std / self.wanted_std } else { f64::INFINITY }
    }
}

impl fmt::Display for Known {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, value, std, wanted_std } = self;
        write!(f, "{name} = {value:.4e} ± {std:.1e} (wanted ± {wanted_std:.1e})")
    }
}

impl Target {
    /// What `fit` says of it; `None` where it fits no such parameter.
    pub fn known(&self, fit: &Fit) -> Option<Known> {
        let parameter = fit.parameters.iter().find(|parameter| parameter.name == self.name)?;
        let wanted_std = match self.within {
            Within::Percent(percent) => percent / 100.0 * parameter.value.abs(),
            Within::Absolute(std) => std,
        };
        Some(Known { name: self.name.clone(), value: parameter.value, std: parameter.std, wanted_std })
    }
}

impl FromStr for Target {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "a goal is a parameter and one standard deviation of it, `g3/blunt 5%` or, in its SI unit, `q2/damping 1e-7`; not `{text}`"
            )
        };
        let (name, within) = text.trim().rsplit_once(char::is_whitespace).ok_or_else(wrong)?;
        let number = |text: &str| -> Result<f64, String> {
            text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0).ok_or_else(wrong)
        };
        let within = match within.strip_suffix('%') {
            Some(percent) => Within::Percent(number(percent)?),
            None => Within::Absolute(number(within)?),
        };
        Ok(Self { name: name.trim().into(), within })
    }
}

impl TryFrom<String> for Target {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.within {
            Within::Percent(percent) => write!(f, "{} {percent}%", self.name),
            Within::Absolute(std) => write!(f, "{} {std}", self.name),
        }
    }
}

impl From<Target> for String {
    fn from(target: Target) -> Self {
        target.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goals_are_shares_or_si_and_nothing_else() {
        for text in ["g3/blunt 5%", "q2/damping 0.0000001"] {
            assert_eq!(text.parse::<Target>().unwrap().to_string(), text);
        }
        for text in ["g3/blunt", "5%", "g3/blunt -5%", "g3/blunt 0", "g3/blunt inf", "g3/blunt five"] {
            let said = text.parse::<Target>().unwrap_err();
            assert!(said.contains("`g3/blunt 5%`") && said.contains(text), "{said}");
        }
    }
}
