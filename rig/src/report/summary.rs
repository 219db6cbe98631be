//! The report in a terminal: the verdict, the errors, the coefficients.

use std::fmt::Write as _;

use ident::experiment::Use;
use ident::fit::Fit;

use super::data::ReportData;
use super::format::{millimetres, percent, significant};
use super::verdict::{is_combined, verdict};

/// What came out, as lines for a terminal.
pub fn summary(data: &ReportData) -> String {
    let verdict = verdict(data);
    let mut text = format!("{}\n", verdict.line);
    for detail in &verdict.details {
        let _ = writeln!(text, "- {detail}");
    }
    if let Some(fit) = &data.fit {
        text.push('\n');
        text.push_str(&table(&errors(fit)));
        if !fit.parameters.is_empty() {
            text.push('\n');
            text.push_str(&table(&coefficients(fit)));
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
    rows
}

fn coefficients(fit: &Fit) -> Vec<Vec<String>> {
    let mut rows = vec![["coefficient", "value", "std", ""].map(String::from).to_vec()];
    for parameter in &fit.parameters {
        let combined = is_combined(fit, &parameter.name);
        let open = if combined { "only in combination" } else { "left open" };
        let mut remarks = Vec::new();
        if combined || !parameter.determined {
            remarks.push(open);
        }
        if parameter.at_bound {
            remarks.push("at bound");
        }
        rows.push(vec![
            parameter.name.clone(),
            significant(parameter.value),
            significant(parameter.std),
            remarks.join(", "),
        ]);
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
