//! What came out of a run or a fit, as one HTML file that needs nothing else.
//!
//! [`render`] is a pure function from [`ReportData`], which its caller fills with what there is; parts that
//! are missing are left out. Figures are inline SVG and pictures inline JPEG, so that the file can be
//! mailed, printed and kept. The figures follow the paper: initial pose measured and simulated, motion
//! superimposed, each keypoint over time measured (solid) and simulated (dashed), and Table I.
//!
//! - `data`: what a report is made of; `gather`: filled from a run folder
//! - `verdict`: the sentences at the top; `summary`: the same for a terminal
//! - `chart`, `figures`: plots; `picture`: images with what vision found in them
//! - `sections`, `coefficients`: the page itself
//! - `diagnosis`, `diagnosis_figures`, `diagnosis_text`: what the simulation gets wrong, on the page and in a terminal

mod chart;
mod coefficients;
mod data;
mod diagnosis;
mod diagnosis_figures;
mod diagnosis_text;
mod figures;
mod format;
mod gather;
mod picture;
mod sections;
mod summary;
#[cfg(test)]
mod tests;
mod tone;
mod verdict;

pub use data::{ClockQuality, ImageQuality, Overlay, ReportData, RunEnd, RunFigures, ServoTrace};
pub use diagnosis_figures::DiagnosisFigures;
pub use diagnosis_text::diagnosis_summary;
pub use gather::GatherError;
pub use summary::{summary, written};

use maud::{DOCTYPE, PreEscaped, html};

/// The page's looks; colours of the figures are mapped there for dark screens.
const STYLE: &str = include_str!("style.css");

/// The report as one self-contained HTML file.
///
/// Every name and text in `data` is escaped: a run folder from elsewhere cannot bring a script along.
pub fn render(data: &ReportData) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (data.id) " · rig report" }
                style { (PreEscaped(STYLE)) }
            }
            body {
                main {
                    (sections::heading(data))
                    @if data.fit.is_none() { (diagnosis::section(data)) }
                    (sections::table_of_errors(data))
                    @for run in &data.runs { (sections::run(data, run)) }
                    (sections::pictures(data))
                    (coefficients::section(data))
                    @if data.fit.is_some() { (diagnosis::section(data)) }
                    (sections::servo(data))
                    (sections::quality(data))
                    (sections::timings(data))
                    (sections::provenance(data))
                }
            }
        }
    }
    .into_string()
}
