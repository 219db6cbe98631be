//! The fitted coefficients, and which of them the data determine.

use ident::fit::{Combination, Fit, FittedParameter};
use ident::parameters::Scale;
use maud::{Markup, html};

use super::data::ReportData;
use super::format::{counted, significant};
use super::verdict::{is_combined, is_constant, is_determined_alone};

/// Table of coefficients, with remarks in plain words.
pub(super) fn section(data: &ReportData) -> Markup {
    let Some(fit) = data.fit.as_ref().filter(|fit| !fit.parameters.is_empty()) else { return html! {} };
    html! {
        section #coefficients {
            h2 { "Coefficients" }
            p.lead {
                "Value ± one standard deviation, and its place between its bounds. Fluid coefficients have no unit; "
                "damping is in N·m·s/rad, friction loss in N·m, stiffness in N·m/rad; their strips are logarithmic."
            }
            table.coefficients {
                thead { tr {
                    th { "coefficient" } th.number { "value" } th.number { "std" } th.number { "lower" }
                    th { "between bounds" } th.number { "upper" } th { "remarks" }
                } }
                @for (owner, parameters) in grouped(&fit.parameters) {
                    tbody {
                        @for parameter in parameters { (row(fit, owner, parameter)) }
                    }
                }
            }
            (unidentifiable(fit))
        }
    }
}

/// Parameters that follow each other and share what stands before the slash.
fn grouped(parameters: &[FittedParameter]) -> Vec<(&str, &[FittedParameter])> {
    fn owner(p: &FittedParameter) -> &str {
        p.name.split_once('/').map_or("", |(owner, _)| owner)
    }
    parameters.chunk_by(|a, b| owner(a) == owner(b)).map(|chunk| (owner(&chunk[0]), chunk)).collect()
}

fn row(fit: &Fit, owner: &str, parameter: &FittedParameter) -> Markup {
    let short_name = parameter.name.strip_prefix(owner).unwrap_or(&parameter.name);
    html! {
        tr.loose[!is_determined_alone(fit, parameter)] {
            td { span.owner { (owner) } (short_name) }
            td.number { (significant(parameter.value)) }
            td.number { (significant(parameter.std)) }
            td.number { (significant(parameter.lower)) }
            td { (bar(parameter)) }
            td.number { (significant(parameter.upper)) }
            td { (remark(fit, parameter)) }
        }
    }
}

fn remark(fit: &Fit, parameter: &FittedParameter) -> Markup {
    let side = if parameter.value - parameter.lower <= parameter.upper - parameter.value {
        "lower"
    } else {
        "upper"
    };
    html! {
        @if is_combined(fit, &parameter.name) { span.flag.caution { "only in combination" } " " }
        @else if !parameter.determined { span.flag.caution { "not determined" } " " }
        @if !is_constant(parameter) { span.flag.caution { "differs from run to run" } " " }
        @if let Some([lower, upper]) = parameter.ci95 {
            "95 %: " (significant(lower)) " to " (significant(upper)) " "
        }
        @if parameter.at_bound { span.flag.caution { "at its " (side) " bound" } " " }
        @if is_determined_alone(fit, parameter) && !parameter.at_bound { span.flag.good { "determined" } }
    }
}

/// Where value and one sigma lie between the bounds, as a strip on the scale that the fit searches.
fn bar(parameter: &FittedParameter) -> Markup {
    let (value, lower, upper) = (parameter.value, parameter.lower, parameter.upper);
    if !(value.is_finite() && (upper - lower).is_finite() && lower < upper) {
        return html! {};
    }
    let kind = parameter.name.rsplit('/').next().unwrap_or_default();
    let scale = match kind {
        "damping" | "frictionloss" | "stiffness" => Scale::with_knee(lower, upper),
        _ => Scale::new(lower, upper),
    };
    let std = if parameter.std.is_finite() { parameter.std } else { upper - lower };
    let place = |value: f64| scale.unit(value) * 100.0;
    let (from, to) = (place(value - std), place(value + std));
    html! {
        svg.strip viewBox="-3 0 106 12" preserveAspectRatio="none" {
            rect.track x="0" y="5" width="100" height="2" {}
            rect.sigma x=(format!("{from:.2}")) y="3" width=(format!("{:.2}", to - from)) height="6" {}
            rect.value x=(format!("{:.2}", place(value) - 0.8)) y="1" width="1.6" height="10" {}
        }
    }
}

/// A combination that the data determine, as a formula with its value.
pub(super) fn weighted_sum(combination: &Combination) -> Option<String> {
    let (value, std) = combination.value.zip(combination.std)?;
    let mut sum = String::new();
    for (name, &weight) in &combination.weights {
        let sign = match (sum.is_empty(), weight < 0.0) {
            (true, false) => "",
            (true, true) => "−",
            (false, false) => " + ",
            (false, true) => " − ",
        };
        let size = weight.abs();
        let factor = if size == 1.0 { String::new() } else { format!("{} ", significant(size)) };
        sum.push_str(&format!("{sign}{factor}{name}"));
    }
    Some(format!("{sum} = {} ± {}", significant(value), significant(std)))
}

fn unidentifiable(fit: &Fit) -> Markup {
    let together: Vec<_> = fit.unidentifiable.iter().filter(|group| group.len() > 1).collect();
    let alone: Vec<_> = fit
        .parameters
        .iter()
        .filter(|p| !p.determined && !together.iter().any(|group| group.contains(&p.name)))
        .collect();
    if alone.is_empty() && together.is_empty() {
        return html! {};
    }
    html! {
        div.note {
            h3 { "What these runs do not determine" }
            @if fit.effective_parameters > 0.0 {
                p {
                    "Together the runs determine about " (format!("{:.1}", fit.effective_parameters)) " of the "
                    (counted(fit.parameters.len(), "value")) "."
                }
            }
            @for group in &together {
                p {
                    "Of " @for (i, name) in group.iter().enumerate() { @if i > 0 { ", " } code { (name) } }
                    " only a combination is determined: the " (counted(group.len(), "value"))
                    " can be traded against each other without changing the keypoints."
                }
            }
            @for sum in fit.combinations.iter().filter_map(weighted_sum) { p { "The determined combination is " (sum) "." } }
            @if !alone.is_empty() {
                p {
                    "The motion hardly depends on "
                    @for (i, parameter) in alone.iter().enumerate() { @if i > 0 { ", " } code { (parameter.name) } }
                    ": other values fit nearly as well."
                }
            }
            p { "Other motions (a faster stroke, another first pose, a further run) or a known value as a prior can determine them." }
        }
    }
}
