//! A smooth path through noisy measurements.

use nalgebra::{DMatrix, DVector};
use sim::BasePath;

/// Measurements this many times further off than is usual are set aside.
const FAR_OFF: f64 = 5.0;

/// Knots about `every_s` \[s\] apart from the first to the last of the rising `time_s`, and values there: those of the not-a-knot cubic spline with
/// the least squares to `values`, by which a base moves between its rows. What is far off is set aside once. `None` where there is too little for that.
pub fn smooth(time_s: &[f64], values: &[f64], every_s: f64) -> Option<(Vec<f64>, Vec<f64>)> {
    let (&first, &last) = time_s.first().zip(time_s.last())?;
    let pieces = ((last - first) / every_s).round().max(3.0);
    let knots: Vec<f64> = (0..=pieces as usize).map(|k| first + (last - first) * k as f64 / pieces).collect();
    let basis = basis(&knots, time_s)?;
    let all = vec![true; values.len()];
    let rough = fitted(&basis, values, &all)?;
    let off: Vec<f64> = (&basis * &rough).iter().zip(values).map(|(a, b)| (a - b).abs()).collect();
    let mut sorted = off.clone();
    sorted.sort_by(f64::total_cmp);
    let usual = 1.5 * sorted[sorted.len() / 2];
    let near: Vec<bool> = off.iter().map(|off| *off <= FAR_OFF * usual).collect();
    let values = fitted(&basis, values, &near)?;
    Some((knots, values.iter().copied().collect()))
}

/// What a spline through 1 at one knot and 0 at the others is at each time, shape (times, knots).
fn basis(knots: &[f64], time_s: &[f64]) -> Option<DMatrix<f64>> {
    let mut basis = DMatrix::zeros(time_s.len(), knots.len());
    for column in 0..knots.len() {
        let poses = (0..knots.len()).map(|row| [f64::from(u8::from(row == column)), 0.0, 0.0]).collect();
        let path = BasePath::new(knots.to_vec(), poses).ok()?;
        for (row, &time_s) in time_s.iter().enumerate() {
            basis[(row, column)] = path.at(time_s).pose[0];
        }
    }
    Some(basis)
}

fn fitted(basis: &DMatrix<f64>, values: &[f64], used: &[bool]) -> Option<DVector<f64>> {
    let rows: Vec<usize> = (0..values.len()).filter(|&row| used[row]).collect();
    let (basis, values) =
        (basis.select_rows(&rows), DVector::from_iterator(rows.len(), rows.iter().map(|&row| values[row])));
    Some(basis.tr_mul(&basis).cholesky()?.solve(&basis.tr_mul(&values)))
}
