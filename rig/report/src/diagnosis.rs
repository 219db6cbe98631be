//! The diagnosis on the page: verdict, causes, gain, residuals and next experiments.

use ident::diagnose::{Diagnosis, NamedCause, UnknownForce, Verdict, WorstInterval};
use maud::{Markup, html};

use super::data::ReportData;
use super::diagnosis_figures::{against, heat, spectrum, unknown_force};
use super::diagnosis_text::{details, value};
use super::format::{millimetres, significant};
use super::verdict::diagnosis_tone;

/// The sections of the diagnosis; nothing without one.
pub(super) fn section(data: &ReportData) -> Markup {
    let Some(figures) = &data.diagnosis else { return html! {} };
    let diagnosis = &figures.diagnosis;
    let (list, title) = match diagnosis.verdict {
        Verdict::Unexplained => (&diagnosis.partial, "Best description, not a named cause"),
        Verdict::Suspected => (&diagnosis.causes, "Suspected causes: not checked on other runs"),
        _ => (&diagnosis.causes, "Named causes"),
    };
    html! {
        @if data.fit.is_some() {
            h2 #diagnosis { "Diagnosis" }
            div class={ "verdict " (diagnosis_tone(diagnosis.verdict).class()) } {
                p.line { (diagnosis.sentence) }
                ul { @for detail in details(diagnosis) { li { (detail) } } }
            }
        }
        @if !diagnosis.established.is_empty() {
            (causes(diagnosis, &diagnosis.established, "established", "Established causes, although the rest is not explained"))
        }
        @if !list.is_empty() { (causes(diagnosis, list, "causes", title)) }
        @if let Some(force) = diagnosis.remainder.as_ref().and_then(|remainder| remainder.force.as_ref()) {
            (force_section(force))
        }
        (errors(diagnosis))
        (next(diagnosis))
        section #residuals {
            h2 { "Residuals over time" }
            p.lead {
                "Residuals (measured - simulated) of the fitted runs over time: pale is noise, dark six times the noise or more. \
                 Before: the fitted model. After: with the named causes."
            }
            (heat(figures))
            p.legend { span.key.measured {} "before" span.key.simulated {} "after" span.key.band {} "a quarter of the noise" }
            div.pair { (against(figures)) (spectrum(figures)) }
            (worst(diagnosis))
        }
        (detectable(diagnosis))
    }
}

fn force_section(force: &UnknownForce) -> Markup {
    html! {
        section #unknown-force {
            h2 { "Unknown force" }
            p.lead {
                "The part of the remaining residuals that a smooth force or torque, a function of each joint's own angle and rate, explains. \
                 First over the rate, a line for each of three angles: the least of the runs (blue), the middle (orange), and the greatest \
                 (green); then over the angle, at rest."
            }
            div.pair { @for joint in &force.joints { (unknown_force(joint)) } }
            @for joint in &force.joints {
                details {
                    summary { "as a [[cause]] on " (joint.joint) ": fit its size, or use it unchanged (1)" }
                    pre { (joint.to_cause()) }
                }
            }
        }
    }
}

/// No more than the search can say of sets of causes that nobody has written down.
const MOST_PROBABLE: f64 = 0.999;

fn probability(probability: f64) -> String {
    match probability {
        p if p > MOST_PROBABLE => format!("over {MOST_PROBABLE}"),
        p => format!("{p:.2}"),
    }
}

fn causes(diagnosis: &Diagnosis, list: &[NamedCause], id: &str, title: &str) -> Markup {
    html! {
        section id=(id) {
            h2 { (title) }
            table.coefficients {
                thead { tr { th { "cause" } th { "number" } th.number { "value (95 %)" } th { "by run" } } }
                @for cause in list {
                    tbody {
                        @for (row, parameter) in cause.parameters.iter().enumerate() {
                            tr {
                                td.name { @if row == 0 { strong { (cause.label()) } } }
                                td.name { code { (parameter.name) } }
                                td.number { (value(parameter)) }
                                td {
                                    @for run in cause.per_run.iter().filter(|run| run.parameter == parameter.name) {
                                        span.share { (run.run) " " (significant(run.value)) " ± " (significant(run.std)) } " "
                                    }
                                }
                            }
                        }
                        tr { td {} td colspan="3" {
                            (cause.sentence) ". " code { (cause.formula) } " Probability " (probability(cause.probability))
                            @if !cause.check.is_empty() { "; to check: " (cause.check) }
                            @if !cause.aliases.is_empty() { "; no video of these runs tells it from " (cause.aliases.join(", ")) }
                        } }
                    }
                }
            }
            @if !diagnosis.alternatives.is_empty() {
                h3 { "Other sets of causes that may be at work instead" }
                table.facts { @for other in &diagnosis.alternatives {
                    tr { th { (other.names.join(" + ")) } td { "probability " (probability(other.probability)) } }
                } }
            }
            @if !diagnosis.bent.is_empty() {
                h3 { "Coefficients that were biased without it" }
                table.facts {
                    tr { th { "coefficient" } th.number { "before" } th.number { "after" } th.number { "± 1 σ" } }
                    @for bent in &diagnosis.bent {
                        tr {
                            td { code { (bent.name) } }
                            td.number { (significant(bent.before)) } td.number { (significant(bent.after)) }
                            td.number { (significant(bent.std)) }
                        }
                    }
                }
            }
        }
    }
}

/// Tables of residuals before and after, with the noise: of held-out runs where there are some, and of the fitted runs.
fn errors(diagnosis: &Diagnosis) -> Markup {
    let row = |id: &str, names: &[String], before: &[f64], after: &[f64], noise: &[f64]| {
        let cells: Vec<[String; 2]> = (0..names.len())
            .map(|k| {
                [format!("{} → {}", millimetres(before[k]), millimetres(after[k])), millimetres(noise[k])]
            })
            .collect();
        html! { tr { td { (id) } @for [change, noise] in cells { td.number { (change) span.share { " / " (noise) } } } } }
    };
    let heading = |names: &[String]| {
        html! { thead { tr { th { "run" } @for name in names { th.number { (name) " [mm] / noise" } } } } }
    };
    html! {
        @if let Some(heldout) = &diagnosis.heldout {
            section #gain {
                h2 { "Gain on runs not fitted to" }
                p.lead {
                    @if heldout.how == "holdout" { "Held-out runs" } @else { "Each run in turn left out of both fits" }
                    ": parameters frozen, pose from the still images alone. Root mean square per coordinate, before → after / noise alone."
                }
                table.errors {
                    @if let Some(run) = heldout.runs.first() { (heading(&run.keypoints)) }
                    tbody {
                        @for run in &heldout.runs {
                            (row(&run.id, &run.keypoints, &run.rms_before_m, &run.rms_after_m, &run.noise_floor_m))
                        }
                    }
                }
            }
        }
        section #fit-errors {
            h2 { "Residuals of the fitted runs" }
            p.lead {
                "Noise " (millimetres(diagnosis.floor_m())) " mm along an axis"
                @if let Some(pose_m) = diagnosis.noise.pose_std_m { ", of which " (millimetres(pose_m)) " mm follow the pose" }
                ", correlation " (format!("{:.2}", diagnosis.noise.correlation)) " from one image to the next. Source: "
                (diagnosis.noise.source) "."
            }
            table.errors {
                @if let Some(run) = diagnosis.residuals.rms.first() { (heading(&run.keypoints)) }
                tbody {
                    @for run in &diagnosis.residuals.rms {
                        (row(&run.id, &run.keypoints, &run.before_m, &run.after_m, &run.noise_m))
                    }
                }
            }
            table.facts {
                tr { th { "" } th.number { "before" } th.number { "after" } }
                tr { td { "slow residuals beyond noise [σ]" }
                    td.number { (format!("{:.1}", diagnosis.whiteness.before.z)) } td.number { (format!("{:.1}", diagnosis.whiteness.after.z)) } }
                tr { td { "chi-square per degree of freedom" }
                    td.number { (format!("{:.3}", diagnosis.whiteness.before.chi2 / diagnosis.whiteness.before.degrees)) }
                    td.number { (format!("{:.3}", diagnosis.whiteness.after.chi2 / diagnosis.whiteness.after.degrees)) } }
                tr { td { "correlation over eight lags, p" }
                    td.number { (significant(diagnosis.whiteness.before.portmanteau_p)) } td.number { (significant(diagnosis.whiteness.after.portmanteau_p)) } }
                tr { td { "share of the squared residuals beyond noise" }
                    td.number { (format!("{:.0} %", 100.0 * diagnosis.whiteness.explainable)) } td {} }
            }
        }
    }
}

fn next(diagnosis: &Diagnosis) -> Markup {
    html! {
        @if !diagnosis.next_experiments.is_empty() {
            section #next {
                h2 { "Next experiments" }
                table.facts {
                    tr { th { "experiment" } th { "tells apart, or checks" } th.number { "separation now [noise variances]" } th.number { "with it" } }
                    @for next in &diagnosis.next_experiments {
                        tr {
                            td { (next.what) @if !next.command.is_empty() { br; code { (next.command) } } } td { (next.separates.join(" / ")) }
                            td.number { @if next.after > 0.0 { (significant(next.before)) } }
                            td.number { @if next.after > 0.0 { (significant(next.after)) } }
                        }
                    }
                }
            }
        }
    }
}

fn worst(diagnosis: &Diagnosis) -> Markup {
    html! {
        h3 { "Largest residuals before" }
        table.facts {
            tr { th { "run" } th { "keypoint" } th.number { "time [s]" } th.number { "rms [mm]" } th.number { "place [mm]" } th.number { "speed [mm/s]" } }
            @for worst in &diagnosis.residuals.worst {
                tr {
                    td { (worst.run) } td { (worst.keypoint) }
                    td.number { (format!("{:.2}–{:.2}", worst.from_s, worst.to_s)) }
                    td.number { (millimetres(worst.rms_m)) }
                    td.number { (place(worst)) }
                    td.number { (format!("{:.0}", worst.speed_m_s * 1e3)) }
                }
            }
        }
    }
}

/// Place of a worst interval \[mm\], on the axes that were observed.
fn place(worst: &WorstInterval) -> String {
    let axes = [("x", worst.x_m), ("y", worst.y_m), ("z", worst.z_m)];
    let observed = axes.into_iter().filter_map(|(axis, metres)| Some(format!("{axis} {:.0}", metres? * 1e3)));
    observed.collect::<Vec<_>>().join(", ")
}

fn detectable(diagnosis: &Diagnosis) -> Markup {
    html! {
        section #detectable {
            h2 { "Detectable causes" }
            p.lead {
                "The smallest size of each cause that would have raised the cost by 30, with all fitted coefficients adjusted. \
                 A dash: not detectable in these runs."
                @if !diagnosis.fitted.is_empty() { " Fitted already, hence no candidates: " (diagnosis.fitted.join(", ")) "." }
            }
            div.columns {
                @for entry in &diagnosis.detectable {
                    div {
                        code { (entry.name) } " "
                        span.number {
                            @match entry.smallest {
                                Some(size) => { (significant(size)) @if entry.unit != "1" { " " (entry.unit) } },
                                None => "–",
                            }
                        }
                    }
                }
            }
        }
    }
}
