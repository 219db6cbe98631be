//! The report's page.

use maud::{DOCTYPE, PreEscaped, html};

use super::data::ReportData;
use super::{coefficients, diagnosis, motion, refused, sections};

/// The page's looks; colours of the figures are mapped there for dark screens.
pub(super) const STYLE: &str = include_str!("style.css");

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
                    (motion::section(data))
                    @for run in &data.runs { (sections::run(data, run)) }
                    (sections::pictures(data))
                    (refused::section(data))
                    (coefficients::section(data))
                    @if data.fit.is_some() { (diagnosis::section(data)) }
                    (sections::servo(data))
                    (sections::quality(data))
                    (sections::timings(data))
                    (sections::provenance(data))
                }
                @if !data.motions.is_empty() { script { (PreEscaped(motion::SCRIPT)) } }
            }
        }
    }
    .into_string()
}
