//! What is checked before a run, and by `rig doctor`: each check says what was found and what to do about it.

pub mod devices;
pub mod host;
pub mod picture;

use std::fmt;

/// How a check went.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Health {
    /// As it should be.
    Good,
    /// A run is possible; something will be worse than it could be.
    Doubtful,
    /// A run cannot work.
    Bad,
}

/// One thing looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct Check {
    /// What was looked at.
    pub subject: String,
    /// How it went.
    pub health: Health,
    /// What was found, with numbers, and what to do.
    pub finding: String,
}

impl Check {
    /// A check that went well.
    pub fn good(subject: impl Into<String>, finding: impl Into<String>) -> Self {
        Self { subject: subject.into(), health: Health::Good, finding: finding.into() }
    }

    /// A check that leaves doubt.
    pub fn doubtful(subject: impl Into<String>, finding: impl Into<String>) -> Self {
        Self { subject: subject.into(), health: Health::Doubtful, finding: finding.into() }
    }

    /// A check that forbids a run.
    pub fn bad(subject: impl Into<String>, finding: impl Into<String>) -> Self {
        Self { subject: subject.into(), health: Health::Bad, finding: finding.into() }
    }
}

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mark = match self.health {
            Health::Good => "ok  ",
            Health::Doubtful => "warn",
            Health::Bad => "FAIL",
        };
        write!(f, "{mark}  {:<16} {}", self.subject, self.finding)
    }
}
