//! The fitted coefficients, and which of them the data determine.

use maud::{Markup, html};

use super::data::{FitSummary, Parameter, ReportData};
use super::format::{counted, significant};

/// Table of coefficients with the reserves in plain words.
pub(super) fn section(data: &ReportData) -> Markup {
    let Some(fit) = data.fit.as_ref().filter(|fit| !fit.parameters.is_empty()) else { return html! {} };
    html! {
        section #coefficients {
            h2 { "Coefficients" }
            p.lead {
                "Value ± one standard deviation, and where it lies between its bounds. Fluid coefficients have no unit; "
                "damping is in N·m·s/rad, friction loss in N·m, stiffness in N·m/rad."
            }
            table.coefficients {
                thead { tr {
                    th { "coefficient" } th.number { "value" } th.number { "std" } th.number { "lower" }
                    th { "between bounds" } th.number { "upper" } th { "what the data say" }
                } }
                @for (owner, parameters) in grouped(&fit.parameters) {
                    tbody {
                        @for parameter in parameters { (row(owner, parameter)) }
                    }
                }
            }
            (unidentifiable(fit))
        }
    }
}

/// Parameters that follow each other and share what stands before the slash.
fn grouped(parameters: &[Parameter]) -> Vec<(&str, &[Parameter])> {
    fn owner(p: &Parameter) -> &str {
        p.name.split_once('/').map_or("", |(owner, _)| owner)
    }
    parameters.chunk_by(|a, b| owner(a) == owner(b)).map(|chunk| (owner(&chunk[0]), chunk)).collect()
}

fn row(owner: &str, parameter: &Parameter) -> Markup {
    let own_name = parameter.name.strip_prefix(owner).unwrap_or(&parameter.name);
    html! {
        tr.loose[!parameter.determined] {
            td { span.owner { (owner) } (own_name) }
            td.number { (significant(parameter.value)) }
            td.number { (parameter.std.map_or("–".into(), significant)) }
            td.number { (significant(parameter.lower)) }
            td { (bar(parameter)) }
            td.number { (significant(parameter.upper)) }
            td { (remark(parameter)) }
        }
    }
}

fn remark(parameter: &Parameter) -> Markup {
    let side = if parameter.value - parameter.lower <= parameter.upper - parameter.value {
        "lower"
    } else {
        "upper"
    };
    html! {
        @if !parameter.determined { span.flag.caution { "left open" } " " }
        @if parameter.at_bound { span.flag.caution { "at its " (side) " bound" } " " }
        @if parameter.determined && !parameter.at_bound { span.flag.good { "determined" } }
    }
}

/// Where value and one sigma lie between the bounds, as a strip.
fn bar(parameter: &Parameter) -> Markup {
    let span = parameter.upper - parameter.lower;
    if !(span.is_finite() && span > 0.0 && parameter.value.is_finite()) {
        return html! {};
    }
    let place = |value: f64| ((value - parameter.lower) / span).clamp(0.0, 1.0) * 100.0;
    let std = parameter.std.filter(|s| s.is_finite()).unwrap_or(0.0);
    let (from, to) = (place(parameter.value - std), place(parameter.value + std));
    html! {
        svg.strip viewBox="-3 0 106 12" preserveAspectRatio="none" {
            rect.track x="0" y="5" width="100" height="2" {}
            rect.sigma x=(format!("{from:.2}")) y="3" width=(format!("{:.2}", to - from)) height="6" {}
            rect.value x=(format!("{:.2}", place(parameter.value) - 0.8)) y="1" width="1.6" height="10" {}
        }
    }
}

fn unidentifiable(fit: &FitSummary) -> Markup {
    if fit.unidentifiable.is_empty() {
        return html! {};
    }
    let (alone, together): (Vec<_>, Vec<_>) =
        fit.unidentifiable.iter().filter(|g| !g.is_empty()).partition(|group| group.len() == 1);
    html! {
        div.note {
            h3 { "What these runs cannot see" }
            @if !alone.is_empty() {
                p {
                    "No visible effect on the motion, so any value would do as well: "
                    @for (i, group) in alone.iter().enumerate() { @if i > 0 { ", " } code { (group[0]) } } "."
                }
            }
            @for group in &together {
                p {
                    "Of " @for (i, name) in group.iter().enumerate() { @if i > 0 { ", " } code { (name) } }
                    " only a combination shows: the " (counted(group.len(), "value"))
                    " can be traded against each other without changing what the camera sees."
                }
            }
            p { "Other motions (a faster stroke, another first pose, a further run) or a known value as a prior can settle them." }
        }
    }
}
