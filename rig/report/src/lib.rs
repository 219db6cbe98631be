//! What came out of a run or a fit, as one HTML file that needs nothing else.
//!
//! [`render`] is a pure function from [`ReportData`], which its caller fills with what there is; parts that
//! are missing are left out. Figures are inline SVG and pictures inline JPEG, the one script is part of it, so that
//! the file can be mailed, printed and kept. The figures follow the paper: initial pose measured and simulated, motion
//! superimposed, each keypoint over time measured (solid) and simulated (dashed), and Table I.
//!
//! - `data`: what a report is made of; `gather`: filled from a run folder
//! - `verdict`: colour and sentences at the top; `summary`: the same for a terminal
//! - `chart`, `figures`: plots; `picture`: images with what vision found in them
//! - `motion`: the mechanism in space, which `motion.js` turns and plays
//! - `refused`: images that were refused or doubted, by reason
//! - `strip`: filmed and simulated at the same instants
//! - `page`: the page as a whole; `sections`, `coefficients`: its parts
//! - `study`: the page of many experiments together
//! - `diagnosis`, `diagnosis_figures`, `diagnosis_text`: what the simulation gets wrong, on the page and in a terminal

#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make their files"))]

mod chart;
mod coefficients;
mod data;
mod diagnosis;
mod diagnosis_figures;
mod diagnosis_text;
mod figures;
mod format;
mod gather;
mod motion;
mod page;
mod picture;
mod refused;
mod sections;
mod strip;
mod study;
mod study_findings;
mod summary;
#[cfg(test)]
mod tests;
mod tone;
mod verdict;

pub use data::{
    ClockQuality, ImageQuality, Overlay, RefusedImages, ReportData, RunEnd, RunFigures, ServoTrace,
    StripImage,
};
pub use diagnosis_figures::DiagnosisFigures;
pub use diagnosis_text::diagnosis_summary;
pub use gather::GatherError;
pub use motion::Motion;
pub use page::render;
pub use study::render_study;
pub use study_findings::{
    CommonNumber, Disagreement, FollowedTrend, Sameness, SetAside, Shift, StudyFindings, StudySize, ToSettle,
    Twins, VerdictCount,
};
pub use summary::{summary, written};
pub use tone::Tone;
pub use verdict::{Findings, Headline, is_determined_alone};
