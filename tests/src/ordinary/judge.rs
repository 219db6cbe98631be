//! Has faults diagnosed, and says how near the diagnosis came.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::faults::{Fault, Faulty, Kind};
use crate::hidden::cases::{Case, Kind as Hides, Made, same};
use crate::hidden::diagnose::{Named, Outcome, judge};
use crate::hidden::write::{Film, write};

/// How near a diagnosis came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Nearness {
    /// All causes with their elements, and nothing else; nothing where there is nothing.
    Right,
    /// All causes, but not in which element.
    WithoutElement,
    /// One of several, all that is wrong among what is said.
    Ambiguous,
    /// A part of what is wrong, and nothing else.
    Partly,
    /// Something is wrong, and it has no name.
    Unexplained,
    /// Nothing is found though something is wrong.
    Missed,
    /// A cause is named that is not at work, or none of several is.
    Wrong,
    /// There is no diagnosis.
    Failed,
}

impl Nearness {
    /// All, best first.
    pub const ALL: [Self; 8] = [
        Self::Right,
        Self::WithoutElement,
        Self::Ambiguous,
        Self::Partly,
        Self::Unexplained,
        Self::Missed,
        Self::Wrong,
        Self::Failed,
    ];

    fn words(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::WithoutElement => "without element",
            Self::Ambiguous => "ambiguous, truth among them",
            Self::Partly => "partly",
            Self::Unexplained => "unexplained",
            Self::Missed => "missed",
            Self::Wrong => "wrong",
            Self::Failed => "no answer",
        }
    }
}

/// What became of a case.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Judged {
    /// The kind of fault, in words.
    pub kind: String,
    /// The mechanism.
    pub seed: u64,
    /// What is wrong.
    pub truth: Vec<Fault>,
    /// What the program says.
    pub outcome: Outcome,
}

/// Number of the case of `kind` on the mechanism of `seed`.
pub fn number(kind: Kind, seed: u64) -> u64 {
    let place = Kind::ALL.iter().position(|other| *other == kind).unwrap_or_default();
    seed * Kind::ALL.len() as u64 + place as u64
}

/// Has the fault of `kind` on the mechanism of `seed` diagnosed in `folder`, which is made.
///
/// # Panics
/// When files cannot be written or the program cannot be started.
pub fn diagnose(kind: Kind, seed: u64, folder: &Path) -> Judged {
    let Faulty { bench, hidden, truth } = Faulty::draw(kind, seed);
    let case = Case { id: format!("case-{:06}", number(kind, seed)), seed, kind: Hides::Nothing };
    let folder = folder.join(&case.id);
    std::fs::create_dir_all(&folder).expect("a folder for the case");
    let made = Made { bench, hidden, truth: Vec::new() };
    let experiment = write(&case, &made, Film::default(), &folder).expect("the case's files");
    let outcome = judge(&case, Vec::new(), &experiment, &folder.join("diagnosis"));
    Judged { kind: kind.words().into(), seed, truth, outcome }
}

impl Judged {
    fn holds(&self, name: &str) -> bool {
        self.truth.iter().any(|fault| is_cause(fault, name))
    }

    fn says_element(&self, cause: &Named) -> bool {
        let mut truth = self.truth.iter().filter(|fault| is_cause(fault, &cause.name));
        truth.any(|fault| fault.element == cause.element)
    }

    /// Whether what differs from run to run, and nothing else, is said to resemble what does: a force of another size in each run is not
    /// named, since it may stand in for anything.
    fn is_told_apart(&self) -> bool {
        let partial = &self.outcome.partial;
        !partial.is_empty()
            && self.truth.iter().all(|fault| fault.by_run)
            && partial.iter().all(|name| self.holds(name))
    }

    /// How near the diagnosis came.
    pub fn nearness(&self) -> Nearness {
        let Outcome { verdict, causes, alternatives, .. } = &self.outcome;
        let names = |set: &[String]| {
            set.len() == self.truth.len()
                && set.iter().all(|name| self.holds(name.split('/').next().unwrap_or(name)))
        };
        let leader: Vec<String> = causes.iter().map(|cause| cause.name.clone()).collect();
        match verdict.as_str() {
            "nothing-detectable" if self.truth.is_empty() => Nearness::Right,
            "nothing-detectable" => Nearness::Missed,
            "unexplained" if self.is_told_apart() => Nearness::Right,
            "unexplained" => Nearness::Unexplained,
            "ambiguous" if names(&leader) || alternatives.iter().any(|set| names(set)) => Nearness::Ambiguous,
            "ambiguous" => Nearness::Wrong,
            "cause" | "causes" | "suspected" => {
                if !causes.iter().all(|cause| self.holds(&cause.name)) {
                    Nearness::Wrong
                } else if causes.len() < self.truth.len() {
                    Nearness::Partly
                } else if causes.iter().all(|cause| self.says_element(cause)) {
                    Nearness::Right
                } else {
                    Nearness::WithoutElement
                }
            }
            _ => Nearness::Failed,
        }
    }

    /// What is wrong and what is said, in a line.
    pub fn line(&self) -> String {
        let of = |name: &str, element: &Option<String>| match element {
            Some(element) => format!("{name}/{element}"),
            None => name.to_owned(),
        };
        let truth: Vec<String> = self
            .truth
            .iter()
            .map(|fault| format!("{} {:.3e}", of(&fault.cause, &fault.element), fault.size))
            .collect();
        let said: Vec<String> =
            self.outcome.causes.iter().map(|cause| of(&cause.name, &cause.element)).collect();
        let others: Vec<String> = self.outcome.alternatives.iter().map(|set| set.join("+")).collect();
        format!(
            "{} | {} | {} {} [{}] | {:?} | {:.1} s",
            self.outcome.id,
            truth.join(" + "),
            self.outcome.verdict,
            if said.is_empty() { format!("({})", self.outcome.partial.join("+")) } else { said.join("+") },
            others.join("; "),
            self.nearness(),
            self.outcome.wall_s
        )
    }
}

fn is_cause(fault: &Fault, name: &str) -> bool {
    fault.cause == name || same(&fault.cause, name, false)
}

/// How many of each kind came how near, as Markdown.
pub fn table(list: &[Judged]) -> String {
    let mut text = String::from("| kind |");
    for nearness in Nearness::ALL {
        let _ = write!(text, " {} |", nearness.words());
    }
    let _ = writeln!(text, "\n| --- |{}", " --- |".repeat(Nearness::ALL.len()));
    let mut rows: Vec<(&str, BTreeMap<Nearness, usize>)> =
        Kind::ALL.iter().map(|kind| (kind.words(), BTreeMap::new())).collect();
    rows.push(("all", BTreeMap::new()));
    for judged in list {
        for (_, counts) in rows.iter_mut().filter(|(kind, _)| *kind == judged.kind || *kind == "all") {
            *counts.entry(judged.nearness()).or_default() += 1;
        }
    }
    for (kind, counts) in rows.iter().filter(|(_, counts)| !counts.is_empty()) {
        let _ = write!(text, "| {kind} |");
        for nearness in Nearness::ALL {
            let count = counts.get(&nearness).copied().unwrap_or(0);
            let _ = if count == 0 { write!(text, " |") } else { write!(text, " {count} |") };
        }
        text.push('\n');
    }
    text
}
