//! How good the diagnoses are: rates beside the bars, power curves, a confusion matrix. As Markdown.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use ground::statistics::median;

use super::cases::same;
use super::diagnose::{Named, Outcome};

/// Gaps to the noise floor below this say nothing about how much of them was closed \[m\].
const MIN_GAP_M: f64 = 3e-5;

/// Below this chi-square two causes count as indistinguishable.
const DISTINGUISHABLE_CHI_SQUARE: f64 = 30.0;

/// How a diagnosis compares with what was hidden.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Judgement {
    /// All that was hidden is named, and nothing else.
    Exact,
    /// Only causes that were hidden, but not all.
    Partly,
    /// A cause is named that was not hidden.
    Wrong,
    /// Nothing detectable.
    Nothing,
    /// It could be one of several.
    Ambiguous,
    /// Something is wrong, and it has no name.
    Unexplained,
    /// There is no diagnosis.
    Failed,
}

impl Outcome {
    fn hides(&self, cause: &Named) -> bool {
        self.truth.iter().any(|truth| truth.cause == cause.name || same(&truth.cause, &cause.name, false))
    }

    /// The judgement.
    pub fn judgement(&self) -> Judgement {
        let named = self.verdict == "cause" || self.verdict == "causes" || self.verdict == "suspected";
        match self.verdict.as_str() {
            "nothing-detectable" => Judgement::Nothing,
            "ambiguous" => Judgement::Ambiguous,
            "unexplained" => Judgement::Unexplained,
            _ if !named || self.causes.is_empty() => Judgement::Failed,
            _ if !self.causes.iter().all(|cause| self.hides(cause)) => Judgement::Wrong,
            _ if self.causes.len() < self.truth.len() => Judgement::Partly,
            _ => Judgement::Exact,
        }
    }

    /// Whether no bound of physics kept what it hides well below the size asked for.
    fn is_full_size(&self) -> bool {
        self.truth.iter().all(|truth| truth.times >= 0.9 * self.asked)
    }

    /// For each number of the sizes that is named as itself, whether its interval holds the truth.
    fn held(&self) -> Vec<bool> {
        let hidden = self.truth.iter().filter(|truth| truth.cause != "slosh").flat_map(|truth| &truth.size);
        let intervals = hidden.filter_map(|(name, value)| {
            let stated = self.causes.iter().flat_map(|cause| &cause.parameters);
            let (.., [low, high]) = stated.into_iter().find(|(stated, ..)| stated == name)?;
            Some((*low..=*high).contains(value))
        });
        intervals.collect()
    }

    /// What it was taken for, in a word.
    fn taken_for(&self) -> String {
        match self.judgement() {
            Judgement::Nothing => "(nothing)".into(),
            Judgement::Ambiguous => "(ambiguous)".into(),
            Judgement::Unexplained => "(unexplained)".into(),
            Judgement::Failed => "(failed)".into(),
            Judgement::Exact => "(exact)".into(),
            _ => {
                let names: Vec<&str> = self.causes.iter().map(|cause| cause.name.as_str()).collect();
                names.join("+")
            }
        }
    }
}

/// A count out of a number of cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rate {
    /// How many.
    pub hits: usize,
    /// Of how many.
    pub of: usize,
}

impl Rate {
    fn count<'a>(outcomes: impl Iterator<Item = &'a Outcome>, wanted: impl Fn(&Outcome) -> bool) -> Self {
        let mut rate = Self::default();
        for outcome in outcomes {
            rate.of += 1;
            rate.hits += usize::from(wanted(outcome));
        }
        rate
    }

    /// The share; 1 of no cases at all.
    pub fn share(self) -> f64 {
        if self.of == 0 { 1.0 } else { self.hits as f64 / self.of as f64 }
    }
}

impl std::fmt::Display for Rate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{} = {:.1} %", self.hits, self.of, 100.0 * self.share())
    }
}

/// The figures that have a bar.
#[derive(Debug, Clone)]
pub struct Score {
    /// One cause at 5 times the limit and more: exact name up to declared aliases.
    pub strong: Rate,
    /// Those of them that no other cause imitates: a chi-square of more than 30 away from each.
    pub distinct: Rate,
    /// The same at 2 times.
    pub faint: Rate,
    /// One cause at 0.3 times: nothing detectable.
    pub hidden: Rate,
    /// Nothing hidden: something named, or called wrong.
    pub alarms: Rate,
    /// Outside the library: unexplained.
    pub outside: Rate,
    /// A wrong name accepted, over all cases.
    pub wrong: Rate,
    /// Pairs: both named.
    pub pairs: Rate,
    /// Median share of the closable held-out gap that was closed, over exactly named causes.
    pub closed: Option<f64>,
    /// 95 % intervals of named sizes that hold the truth.
    pub intervals: Rate,
    /// Median wall time \[s\].
    pub wall_s: f64,
    /// Threads that each diagnosis had, at most.
    pub threads: usize,
}

impl Score {
    /// Of `outcomes`.
    pub fn of(outcomes: &[Outcome]) -> Self {
        let exact = |outcome: &Outcome| outcome.judgement() == Judgement::Exact;
        let kind = |kind: &'static str| outcomes.iter().filter(move |outcome| outcome.kind == kind);
        let one = |low: f64, high: f64| {
            kind("one").filter(move |o| (low..high).contains(&o.asked) && o.is_full_size())
        };
        let gaps = outcomes.iter().filter(|outcome| exact(outcome)).filter_map(|outcome| {
            let [before, after, floor] = outcome.heldout_m?;
            (before - floor > MIN_GAP_M).then(|| (before - after) / (before - floor))
        });
        let held: Vec<bool> = outcomes.iter().filter(|o| exact(o)).flat_map(Outcome::held).collect();
        let distinct = |outcome: &&Outcome| {
            outcome.truth.iter().all(|truth| {
                truth.rival.as_ref().is_none_or(|(_, apart)| *apart > DISTINGUISHABLE_CHI_SQUARE)
            })
        };
        let mut wall_s: Vec<f64> = outcomes.iter().map(|outcome| outcome.wall_s).collect();
        Self {
            strong: Rate::count(one(4.0, f64::INFINITY), exact),
            distinct: Rate::count(one(4.0, f64::INFINITY).filter(distinct), exact),
            faint: Rate::count(one(1.0, 4.0), exact),
            hidden: Rate::count(one(0.0, 1.0), |o| o.judgement() == Judgement::Nothing),
            alarms: Rate::count(kind("nothing"), |o| o.judgement() != Judgement::Nothing),
            outside: Rate::count(kind("outside").filter(|o| o.is_full_size()), |o| {
                o.judgement() == Judgement::Unexplained
            }),
            wrong: Rate::count(outcomes.iter(), |o| o.judgement() == Judgement::Wrong),
            pairs: Rate::count(kind("pair"), exact),
            closed: median(&mut gaps.collect::<Vec<f64>>(), f64::total_cmp),
            intervals: Rate { hits: held.iter().filter(|held| **held).count(), of: held.len() },
            wall_s: median(&mut wall_s, f64::total_cmp).unwrap_or(0.0),
            threads: outcomes.iter().map(|outcome| outcome.threads).max().unwrap_or(0),
        }
    }
}

/// The tables of `outcomes`, as Markdown.
pub fn tables(outcomes: &[Outcome]) -> String {
    let score = Score::of(outcomes);
    let mut text = format!("{} cases.\n\n| | found | wanted |\n| --- | --- | --- |\n", outcomes.len());
    let closed = score.closed.map_or("no such case".into(), |share| format!("{:.1} %", 100.0 * share));
    let wall = format!("{:.1} s, {} thread(s) each", score.wall_s, score.threads);
    for (what, found, wanted) in [
        ("one cause at 5 times the limit and more: exact name", score.strong.to_string(), "at least 97 %"),
        (
            "of these, where every other cause is a chi-square of 30 away",
            score.distinct.to_string(),
            "reported",
        ),
        ("one cause at 2 times the limit: exact name", score.faint.to_string(), "reported"),
        ("one cause at 0.3 times the limit: nothing detectable", score.hidden.to_string(), "at least 97 %"),
        ("nothing hidden: false alarms", score.alarms.to_string(), "0 of 300"),
        ("outside the library: unexplained", score.outside.to_string(), "at least 95 %"),
        ("a wrong name accepted, over all cases", score.wrong.to_string(), "at most 1 %"),
        ("pairs: both named", score.pairs.to_string(), "at least 90 %"),
        ("closable held-out gap closed, median", closed, "at least 95 %"),
        ("95 % interval of a named size holds the truth", score.intervals.to_string(), "90 to 98 %"),
        ("wall time of a diagnosis, median", wall, "about 1 s on two threads"),
    ] {
        let _ = writeln!(text, "| {what} | {found} | {wanted} |");
    }
    text.push_str("\nExactly named, by cause and size as a multiple of the limit (at 0.3: nothing detectable):\n\n| cause |");
    let one = || outcomes.iter().filter(|outcome| outcome.kind == "one");
    let mut sizes: Vec<f64> = one().map(|outcome| outcome.asked).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.dedup();
    for size in &sizes {
        let _ = write!(text, " {size} |");
    }
    let _ = writeln!(text, "\n| --- |{}", " --- |".repeat(sizes.len()));
    let mut causes: Vec<&str> =
        one().filter_map(|o| o.truth.first().map(|truth| truth.cause.as_str())).collect();
    causes.sort_unstable();
    causes.dedup();
    for cause in &causes {
        let _ = write!(text, "| {cause} |");
        for &size in &sizes {
            let wanted = if size < 1.0 { Judgement::Nothing } else { Judgement::Exact };
            let these = one().filter(|o| o.asked == size && o.truth.iter().any(|t| t.cause == *cause));
            let these: Vec<&Outcome> = these.collect();
            let clipped = these.iter().filter(|o| !o.is_full_size()).count();
            let rate = Rate::count(these.into_iter(), |o| o.judgement() == wanted);
            let note = if clipped > 0 { format!(" ({clipped} cut to a bound)") } else { String::new() };
            let _ = write!(text, " {}/{}{note} |", rate.hits, rate.of);
        }
        text.push('\n');
    }
    text.push_str("\nWhat was not named exactly:\n\n| hidden | taken for | cases |\n| --- | --- | --- |\n");
    let mut confusion: BTreeMap<(String, String), Vec<String>> = BTreeMap::new();
    for outcome in outcomes {
        let judgement = outcome.judgement();
        let as_wanted = match outcome.kind.as_str() {
            "nothing" => judgement == Judgement::Nothing,
            "outside" => judgement == Judgement::Unexplained,
            "one" if outcome.asked < 1.0 => judgement == Judgement::Nothing,
            _ => judgement == Judgement::Exact,
        };
        if !as_wanted {
            let hidden: Vec<&str> = outcome.truth.iter().map(|truth| truth.cause.as_str()).collect();
            let hidden = if hidden.is_empty() { "(nothing)".into() } else { hidden.join("+") };
            let near = outcome
                .truth
                .iter()
                .filter_map(|truth| truth.rival.as_ref())
                .filter(|r| r.1 < DISTINGUISHABLE_CHI_SQUARE);
            let near: Vec<String> =
                near.map(|(rival, apart)| format!(" ({rival} {apart:.0} away)")).collect();
            let id = format!("{}{}", outcome.id, near.join(""));
            confusion.entry((hidden, outcome.taken_for())).or_default().push(id);
        }
    }
    for ((hidden, taken), ids) in confusion {
        let _ = writeln!(text, "| {hidden} | {taken} | {} |", ids.join(" "));
    }
    text
}
