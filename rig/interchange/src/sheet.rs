//! What tables of trackers have in common: their cells.

use ground::spreadsheet;
pub(super) use ground::spreadsheet::Row;

use super::InterchangeError;

/// A place farther off than this is in no picture \[px\].
const COORDINATE_LIMIT_PX: f64 = 1e6;
/// A film of more images than this would be of a year.
const FRAME_NUMBER_LIMIT: u64 = 1_000_000_000;

/// The rows of a table; without the column of row numbers that pandas puts before the others, under a title that is empty.
pub(super) fn rows(text: &str) -> Result<Vec<Row>, InterchangeError> {
    let mut rows = spreadsheet::rows(text)?;
    if rows
        .first()
        .is_some_and(|(_, header)| header.len() > 1 && header[0].is_empty() && !header[1].is_empty())
    {
        for (_, row) in &mut rows {
            *row = row.iter().skip(1).collect();
        }
    }
    Ok(rows)
}

/// Refuses a row that has another number of cells than its header.
pub(super) fn check_width((line, row): &Row, width: usize) -> Result<(), InterchangeError> {
    if row.len() == width {
        return Ok(());
    }
    let what = format!("{} cells under a header of {width}; is the file cut off?", row.len());
    Err(InterchangeError::line(*line, what))
}

/// A number, or none where the cell is empty or says NaN.
pub(super) fn number(cell: &str, line: u64, column: &str) -> Result<Option<f64>, InterchangeError> {
    if cell.is_empty() {
        return Ok(None);
    }
    let refuse = || InterchangeError::line(line, format!("{column}: `{cell}` is not a finite number"));
    match cell.parse::<f64>() {
        Ok(value) if value.is_nan() => Ok(None),
        Ok(value) if value.is_finite() => Ok(Some(value)),
        _ => Err(refuse()),
    }
}

/// A place along a side of the picture \[px\].
pub(super) fn coordinate(cell: &str, line: u64, column: &str) -> Result<Option<f64>, InterchangeError> {
    match number(cell, line, column)? {
        Some(value) if value.abs() > COORDINATE_LIMIT_PX => {
            let what = format!("{column}: {cell} px is in no picture (limit {COORDINATE_LIMIT_PX:.0})");
            Err(InterchangeError::line(line, what))
        }
        value => Ok(value),
    }
}

/// An image's number, where the cell is one.
pub(super) fn frame(cell: &str, line: u64) -> Result<Option<u64>, InterchangeError> {
    let refuse = |what: &str| Err(InterchangeError::line(line, format!("frame number {cell} {what}")));
    match cell.parse::<f64>() {
        Err(_) => Ok(None),
        Ok(value) if value.is_nan() => Ok(None),
        Ok(value) if value < 0.0 => refuse("is below 0; images are counted from 0"),
        Ok(value) if value > FRAME_NUMBER_LIMIT as f64 => {
            refuse(&format!("is beyond the limit of {FRAME_NUMBER_LIMIT}"))
        }
        Ok(value) if value.fract() != 0.0 => refuse("is not a whole number"),
        Ok(value) => Ok(Some(value as u64)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_numbers_gaps_or_refused() {
        assert_eq!(number(" ".trim(), 1, "a").unwrap(), None);
        assert_eq!(number("nan", 1, "a").unwrap(), None);
        assert_eq!(number("1e-3", 1, "a").unwrap(), Some(1e-3));
        for cell in ["inf", "-inf", "1,5", "x", "1e999"] {
            assert!(number(cell, 7, "a x").unwrap_err().to_string().starts_with("line 7: a x: "), "{cell}");
        }
        assert!(coordinate("1e7", 1, "a x").unwrap_err().to_string().contains("in no picture"));
    }

    #[test]
    fn frame_numbers_are_whole_and_not_below_0() {
        assert_eq!(
            (frame("12", 1).unwrap(), frame("12.0", 1).unwrap(), frame("a.png", 1).unwrap()),
            (Some(12), Some(12), None)
        );
        for (cell, wanted) in [("-1", "below 0"), ("1.5", "whole"), ("1e12", "limit"), ("inf", "limit")] {
            assert!(frame(cell, 1).unwrap_err().to_string().contains(wanted), "{cell}");
        }
    }
}
