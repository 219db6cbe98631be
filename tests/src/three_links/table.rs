//! The paper's Table I.

use std::fmt::Write as _;

use ident::fit::Fit;

use super::{CASES, Case};

/// What errors are stated in percent of \[mm\].
const LENGTH_MM: f64 = 80.0;

/// One way to a model, and how far off it is.
#[derive(Debug)]
pub struct Rung {
    /// What it is called.
    pub name: &'static str,
    /// The fit, with the errors of all runs.
    pub fit: Fit,
    /// From film to fit \[s\].
    pub wall_s: f64,
}

impl Rung {
    /// Mean errors of P1, P2 and P3 in `case` \[mm\].
    pub fn errors_mm(&self, case: &Case) -> Option<[f64; 3]> {
        let run = self.fit.runs.iter().find(|run| run.id == case.id)?;
        let error_mm = |name: &str| {
            let keypoint = run.keypoints.iter().find(|keypoint| keypoint.name == name)?;
            Some(1e3 * keypoint.mean_error_m)
        };
        Some([error_mm("P1")?, error_mm("P2")?, error_mm("P3")?])
    }
}

/// Mean errors by case and keypoint, of what was published and of the `rungs`, beside the noise of the keypoints \[mm\] by case.
pub fn table(rungs: &[Rung], noise_mm: &[Option<[f64; 3]>]) -> String {
    let mut text = "| mm (% of 80 mm) | P1, P2, P3 as published |".to_owned();
    for rung in rungs {
        let _ = write!(text, " {} |", rung.name);
    }
    text += " keypoint noise |\n| --- | --- |";
    text += &" --- |".repeat(rungs.len() + 1);
    for (case, noise_mm) in CASES.iter().zip(noise_mm) {
        let how = if case.held_out { "**predicted**" } else { "fitted" };
        let _ = write!(text, "\n| {}, {how} | {}", case.words, cell(Some(case.published_mm), 2));
        for rung in rungs {
            let _ = write!(text, " | {}", cell(rung.errors_mm(case), 3));
        }
        let _ = write!(text, " | {} |", cell(*noise_mm, 3));
    }
    text.push_str("\n| time, film to fit |  |");
    for rung in rungs {
        let _ = write!(text, " {:.1} s |", rung.wall_s);
    }
    text + "  |\n"
}

fn cell(errors_mm: Option<[f64; 3]>, digits: usize) -> String {
    let Some(errors) = errors_mm else { return "-".into() };
    let mm = errors.map(|mm| format!("{mm:.digits$}")).join(", ");
    let share = errors.map(|mm| format!("{:.digits$}", 100.0 * mm / LENGTH_MM)).join(", ");
    format!("{mm} ({share})")
}
