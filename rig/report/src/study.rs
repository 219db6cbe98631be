//! The page of a study: what many recordings say together of the same coefficients.
//!
//! [`StudyFindings`] is filled by who has the results; no number is made here.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::chart::{Chart, KEYPOINTS, MEASURED, SIMULATED, Series};
use super::format::{counted, significant, whole_percent};
use super::page::STYLE;
use super::study_findings::{CommonNumber, Sameness, StudyFindings};
use super::tone::Tone;

/// Plots of numbers that differ, at most: more are in the table.
const MOST_PLOTS: usize = 12;
/// Rows of a list, at most: all are in `findings.json`.
const MOST_ROWS: usize = 40;

/// The study's page as one self-contained HTML file.
pub fn render_study(found: &StudyFindings) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (found.name) " · rig study" }
                style { (PreEscaped(STYLE)) }
            }
            body { main {
                (heading(found))
                (numbers(found))
                (plots(found))
                (trends(found))
                (disagreements(found))
                (shifts(found))
                (twins(found))
                (verdicts(found))
                (set_aside(found))
            } }
        }
    }
    .into_string()
}

fn heading(found: &StudyFindings) -> Markup {
    let size = found.size;
    let of = |says: Sameness| found.common.iter().filter(|number| number.says == says).count();
    let (same, differs) = (of(Sameness::Same), of(Sameness::Differs));
    let missing = size.tasks - size.done;
    let is_as_hoped = missing == 0 && differs == 0 && found.warnings.is_empty();
    let tone = if is_as_hoped { Tone::Good } else { Tone::Caution };
    html! {
        p.kicker { "rig study" }
        h1 { (found.name) }
        p.lead {
            (counted(size.experiments, "experiment")) ", " (counted(size.variations, "variation")) ", "
            (counted(size.tasks, "task")) ", by rig " (found.rig_version) "."
        }
        div class={"verdict " (tone.class())} {
            p.line {
                (counted(same, "number")) " may be the same in all experiments that determine it, " (differs)
                @if differs == 1 { " differs." } @else { " differ." }
            }
            @if missing > 0 || !found.warnings.is_empty() {
                ul {
                    @if missing > 0 { li { (counted(missing, "task")) " of " (size.tasks) " have no result." } }
                    @for warning in &found.warnings { li { (warning) } }
                }
            }
        }
        @if !found.to_settle.is_empty() {
            div.note {
                h3 { "What would settle it" }
                ul {
                    @for step in &found.to_settle {
                        li { (step.question) @for command in &step.commands { br; code { (command) } } }
                    }
                }
            }
        }
    }
}

fn interval([low, high]: [f64; 2]) -> String {
    format!("{} to {}", significant(low), significant(high))
}

fn probability(p: f64) -> String {
    if p < 0.001 { "< 0.001".into() } else { format!("{p:.3}") }
}

fn numbers(found: &StudyFindings) -> Markup {
    if found.common.is_empty() {
        return html! {};
    }
    html! {
        section #numbers {
            h2 { "The same everywhere?" }
            p.lead {
                "Mean over the experiments with its 95 % interval; tau is how far the number differs from experiment to experiment beyond "
                "the experiments' own standard deviations, in its unit, and I² the share of the scatter that this is; p is the probability of "
                "as much scatter, were it one number, for all numbers of a variation together (Holm). Random effects by DerSimonian and "
                "Laird, the mean's interval by Hartung and Knapp, tau's by the profile of Q."
            }
            table {
                thead { tr {
                    th { "number" } th { "variation" } th { "unit" } th.number { "experiments" } th.number { "mean" } th.number { "95 %" }
                    th.number { "tau" } th.number { "95 %" } th.number { "I²" } th.number { "p" } th {}
                } }
                tbody { @for number in &found.common { (row(number)) } }
            }
        }
    }
}

fn row(number: &CommonNumber) -> Markup {
    let text = |value: Option<f64>| value.map_or_else(|| "–".into(), significant);
    let tau_ci95 = number.tau_ci95.map_or_else(
        || "–".into(),
        |(low, high)| match high {
            Some(high) => interval([low, high]),
            None => format!("from {}", significant(low)),
        },
    );
    html! {
        tr {
            td.name { (number.name) } td { (number.variation) } td { (number.unit) }
            td.number { (number.count) @if number.left_out > 0 { " of " (number.count + number.left_out) } }
            td.number { (text(number.mean)) }
            td.number { (number.mean_ci95.map_or_else(|| "–".into(), interval)) }
            td.number { (text(number.tau)) }
            td.number { (tau_ci95) }
            td.number { (number.i2.map_or_else(|| "–".into(), |i2| format!("{} %", whole_percent(i2)))) }
            td.number { (number.p_same.map_or_else(|| "–".into(), probability)) }
            td { @match number.says {
                Sameness::Same => span.flag.good { "the same" },
                Sameness::Differs => span.flag.bad { "differs" },
                Sameness::Open => span.flag.caution { "not determined in two" },
            } }
        }
    }
}

fn plots(found: &StudyFindings) -> Markup {
    let differing: Vec<&CommonNumber> =
        found.common.iter().filter(|number| number.says == Sameness::Differs).take(MOST_PLOTS).collect();
    if differing.is_empty() {
        return html! {};
    }
    html! {
        section #plots {
            h2 { "What differs" }
            p.lead {
                "Each experiment's value with its 95 % interval, the first at the top; in red below them the mean of all with its interval."
            }
            div.plots { @for number in differing { (forest(number)) } }
        }
    }
}

fn forest(number: &CommonNumber) -> Markup {
    let count = number.each.len();
    let line = |y: f64, [low, high]: [f64; 2], colour| Series::line(vec![(low, y), (high, y)], colour);
    let height = |place: usize| (count - place) as f64;
    let half = |std: f64| ground::statistics::NORMAL_95 * std;
    let each = || number.each.iter().enumerate();
    let mut series: Vec<Series> = each()
        .map(|(place, (_, value, std))| {
            line(height(place), [value - half(*std), value + half(*std)], MEASURED)
        })
        .collect();
    series.extend(number.mean_ci95.map(|ci95| line(0.0, ci95, SIMULATED)));
    let dots = each().map(|(place, (_, value, _))| ((*value, height(place)), KEYPOINTS[0]));
    let mean = number.mean.map(|mean| ((mean, 0.0), SIMULATED));
    Chart {
        title: format!("{}, {}", number.name, number.variation),
        x_label: if number.unit == "1" { String::new() } else { number.unit.clone() },
        y_label: "experiment, from below".into(),
        size: (540, 150 + 12 * u32::try_from(count.min(60)).unwrap_or(60)),
        series,
        dots: dots.chain(mean).collect(),
        ..Chart::default()
    }
    .svg()
}

fn trends(found: &StudyFindings) -> Markup {
    if found.trends_sought == 0 {
        return html! {};
    }
    html! {
        section #trends {
            h2 { "What they follow" }
            p.lead {
                (counted(found.trends_sought, "trend")) " over time, temperature, tank and mechanism looked for; shown are those that chance makes in "
                "one study of twenty at most (Holm)."
            }
            @if found.trends.is_empty() { p { "None." } }
            @else { table {
                thead { tr { th { "number" } th { "variation" } th { "follows" } th.number { "slope" } th.number { "95 %" } th { "unit" } th.number { "p" } } }
                tbody { @for trend in found.trends.iter().take(MOST_ROWS) { tr {
                    td.name { (trend.name) } td { (trend.variation) } td { (trend.follows) }
                    td.number { (trend.slope.map_or_else(|| "–".into(), significant)) }
                    td.number { (trend.slope_ci95.map_or_else(|| "–".into(), interval)) }
                    td { (trend.unit) } td.number { (probability(trend.p)) }
                } } }
            } }
        }
    }
}

fn disagreements(found: &StudyFindings) -> Markup {
    if found.pairs_compared == 0 {
        return html! {};
    }
    html! {
        section #disagreements {
            h2 { "Who disagrees with whom" }
            p.lead {
                (counted(found.pairs_compared, "pair")) " of experiments compared, number by number; shown are those that chance makes in one study of "
                "twenty at most (Holm), the farthest first."
            }
            @if found.disagreements.is_empty() { p { "Nobody." } }
            @else { table {
                thead { tr { th { "number" } th { "variation" } th { "one" } th.number { "says" } th { "other" } th.number { "says" } th.number { "apart, sigma" } th.number { "p" } } }
                tbody { @for pair in found.disagreements.iter().take(MOST_ROWS) { tr {
                    td.name { (pair.name) } td { (pair.variation) }
                    @for side in 0..2 {
                        td { (pair.experiments[side]) }
                        td.number { (significant(pair.values[side])) " ± " (significant(pair.stds[side])) }
                    }
                    td.number { (format!("{:.1}", pair.sigmas)) } td.number { (probability(pair.p)) }
                } } }
            } }
            @if found.disagreements.len() > MOST_ROWS { p.lead { "and " (found.disagreements.len() - MOST_ROWS) " more, in findings.json" } }
        }
    }
}

fn shifts(found: &StudyFindings) -> Markup {
    if found.shifts.is_empty() {
        return html! {};
    }
    html! {
        section #shifts {
            h2 { "What depends on the variation" }
            p.lead {
                "The same experiments, two variations: how far a number moves, in the larger of its standard deviations, for the experiment in the "
                "middle. Beyond 2 it is the choice of model or fit that says the number, not the recording."
            }
            table {
                thead { tr { th { "number" } th { "from" } th { "to" } th.number { "experiments" } th.number { "moves, sigma" } } }
                tbody { @for shift in found.shifts.iter().take(MOST_ROWS) { tr {
                    td.name { (shift.name) } td { (shift.variations[0]) } td { (shift.variations[1]) }
                    td.number { (shift.count) } td.number { (format!("{:.1}", shift.median_sigmas)) }
                } } }
            }
        }
    }
}

fn twins(found: &StudyFindings) -> Markup {
    if found.twins.is_empty() {
        return html! {};
    }
    html! {
        section #twins {
            h2 { "Two names for one thing" }
            p.lead { "Coefficients of which the data determine only a combination, and in how many fits." }
            table {
                thead { tr { th { "coefficients" } th { "variation" } th.number { "fits" } } }
                tbody { @for group in found.twins.iter().take(MOST_ROWS) { tr {
                    td { (group.names.join(", ")) } td { (group.variation) } td.number { (group.count) " of " (group.of) }
                } } }
            }
        }
    }
}

fn verdicts(found: &StudyFindings) -> Markup {
    if found.verdicts.is_empty() {
        return html! {};
    }
    html! {
        section #verdicts {
            h2 { "What the diagnoses say" }
            table {
                thead { tr { th { "variation" } th { "verdict" } th.number { "experiments" } } }
                tbody { @for verdict in &found.verdicts { tr {
                    td { (verdict.variation) } td { (verdict.verdict) } td.number { (verdict.count) }
                } } }
            }
        }
    }
}

fn set_aside(found: &StudyFindings) -> Markup {
    if found.set_aside.is_empty() {
        return html! {};
    }
    html! {
        section #set-aside {
            h2 { "Set aside" }
            p.lead { "Tasks that will not be tried again; what they printed is in the study's folder, logs/TASK.txt." }
            table {
                thead { tr { th { "task" } th { "what" } th { "why" } } }
                tbody { @for task in found.set_aside.iter().take(MOST_ROWS) { tr {
                    td.name { (task.task) } td { (task.words) } td { (task.why) }
                } } }
            }
        }
    }
}
