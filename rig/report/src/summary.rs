//! The report in a terminal: the verdict, the errors, the coefficients.

use std::fmt::Write as _;
use std::path::Path;

use ident::experiment::Use;
use ident::fit::Fit;

use super::coefficients::weighted_sum;
use super::data::ReportData;
use super::diagnosis_text::diagnosis_lines;
use super::format::{millimetres, percent, significant};
use super::verdict::{is_combined, is_constant, verdict};
use record::folder::file;

/// The summary for a terminal, and the address of the whole report in `folder`.
pub fn written(data: &ReportData, folder: &Path) -> String {
    let report = folder.join(file::REPORT);
    let report = std::fs::canonicalize(&report).unwrap_or(report);
    format!("{}\nreport: file://{}", summary(data), report.display())
}

/// The result as lines for a terminal.
pub fn summary(data: &ReportData) -> String {
    let verdict = verdict(data);
    let mut text = format!("{}\n", verdict.headline.line);
    for detail in &verdict.details {
        let _ = writeln!(text, "- {detail}");
    }
    if let Some(fit) = &data.fit {
        text.push('\n');
        text.push_str("mean distance of keypoints (the paper's Table I)\n");
        text.push_str(&table(&errors(fit)));
        if !fit.parameters.is_empty() {
            text.push('\n');
            text.push_str(&table(&coefficients(fit)));
            for sum in fit.combinations.iter().filter_map(weighted_sum) {
                let _ = writeln!(text, "determined combination: {sum}");
            }
        }
        if let Some(figures) = &data.diagnosis {
            text.push('\n');
            text.push_str(&diagnosis_lines(&figures.diagnosis, None));
        }
    }
    text
}

fn errors(fit: &Fit) -> Vec<Vec<String>> {
    let mut names: Vec<&str> = Vec::new();
    for keypoint in fit.runs.iter().flat_map(|run| &run.keypoints) {
        if !names.contains(&keypoint.name.as_str()) {
            names.push(&keypoint.name);
        }
    }
    let title = |name: &&str| format!("{name} [mm] (%)");
    let mut rows =
        vec![["run".to_owned(), "use".into()].into_iter().chain(names.iter().map(title)).collect()];
    for run in &fit.runs {
        let usage = match run.usage {
            Use::Fit => "fitted",
            Use::Holdout => "held out",
        };
        let cell = |name: &&str| match run.keypoints.iter().find(|k| k.name == *name) {
            Some(k) => {
                let share = percent(k.mean_error_m, fit.characteristic_length_m);
                format!("{} ({share})", millimetres(k.mean_error_m))
            }
            None => "–".into(),
        };
        rows.push([run.id.clone(), usage.into()].into_iter().chain(names.iter().map(cell)).collect());
    }
    // Side by side: what was fitted, and what was only predicted.
    let uses = [(Use::Fit, "fitted"), (Use::Holdout, "held out")];
    if fit.runs.len() > 2 && uses.iter().all(|(usage, _)| fit.runs.iter().any(|run| run.usage == *usage)) {
        for (usage, name) in uses {
            let cell = |keypoint: &&str| match keypoint_error_m(fit, usage, keypoint) {
                Some(error_m) => {
                    format!("{} ({})", millimetres(error_m), percent(error_m, fit.characteristic_length_m))
                }
                None => "–".into(),
            };
            rows.push(["all".to_owned(), name.into()].into_iter().chain(names.iter().map(cell)).collect());
        }
    }
    rows
}

/// Mean of a keypoint's mean errors over the runs of one use \[m\].
fn keypoint_error_m(fit: &Fit, usage: Use, name: &str) -> Option<f64> {
    let runs = fit.runs.iter().filter(|run| run.usage == usage);
    let errors: Vec<f64> =
        runs.flat_map(|run| &run.keypoints).filter(|k| k.name == name).map(|k| k.mean_error_m).collect();
    (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64)
}

fn coefficients(fit: &Fit) -> Vec<Vec<String>> {
    let profiled = fit.parameters.iter().any(|parameter| parameter.ci95.is_some());
    let mut rows = vec![["coefficient", "value", "std", ""].map(String::from).to_vec()];
    if profiled {
        rows[0].insert(3, "95 %".into());
    }
    for parameter in &fit.parameters {
        let combined = is_combined(fit, &parameter.name);
        let open = if combined { "only in combination" } else { "not determined" };
        let mut remarks = Vec::new();
        if combined || !parameter.determined {
            remarks.push(open);
        }
        if parameter.at_bound {
            remarks.push("at bound");
        }
        if !is_constant(parameter) {
            remarks.push("differs from run to run");
        }
        rows.push(vec![
            parameter.name.clone(),
            significant(parameter.value),
            significant(parameter.std),
            remarks.join(", "),
        ]);
        if profiled && let Some(row) = rows.last_mut() {
            let interval =
                |[lower, upper]: [f64; 2]| format!("{} to {}", significant(lower), significant(upper));
            row.insert(3, parameter.ci95.map_or("–".into(), interval));
        }
    }
    rows
}

/// Columns padded to the widest cell, the first flush left, the others flush right.
fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for row in rows {
        let mut line = String::new();
        for (column, (cell, &width)) in row.iter().zip(&widths).enumerate() {
            let _ = match column {
                0 => write!(line, "{cell:<width$}"),
                _ => write!(line, "  {cell:>width$}"),
            };
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let rows = [["a", "1"], ["long", "22"]].map(|row| row.map(String::from).to_vec());
        assert_eq!(table(&rows), "a      1\nlong  22\n");
    }
}
