//! The least of a quadratic form within bounds.

use nalgebra::{DMatrix, DVector};

/// Rounds in which bounds are taken up and let go (chosen): each costs a factor; what is not settled by then is a step, not an answer.
const MOST_ROUNDS: usize = 12;

/// Where x'Ax/2 - b'x is least with every x within its `bounds`, A being `products` and b `data`: what would lie beyond a bound is put on it, the
/// others are solved for again, and what a bound holds against its slope is let go. `None` where A has no factor.
///
/// # Source
/// C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23 (active sets).
pub(super) fn bounded(
    products: &DMatrix<f64>,
    data: &DVector<f64>,
    bounds: &[[f64; 2]],
) -> Option<DVector<f64>> {
    let count = data.len();
    let mut held: Vec<Option<f64>> =
        bounds.iter().map(|[lower, upper]| (lower >= upper).then_some(*lower)).collect();
    let mut found = DVector::zeros(count);
    for round in 0..MOST_ROUNDS {
        let free: Vec<usize> = (0..count).filter(|&place| held[place].is_none()).collect();
        let standing = DVector::from_iterator(count, held.iter().map(|held| held.unwrap_or(0.0)));
        let left = data - products * &standing;
        found = standing;
        if !free.is_empty() {
            let part = products.select_rows(&free).select_columns(&free);
            let solved = part.cholesky()?.solve(&left.select_rows(&free));
            for (&place, x) in free.iter().zip(solved.iter()) {
                found[place] = *x;
            }
        }
        let mut settled = true;
        for &place in &free {
            let [lower, upper] = bounds[place];
            if found[place] < lower || found[place] > upper {
                held[place] = Some(found[place].clamp(lower, upper));
                settled = false;
            }
        }
        if settled && 2 * round < MOST_ROUNDS {
            let slope = products * &found - data;
            for place in 0..count {
                let [lower, upper] = bounds[place];
                let wants = held[place].is_some_and(|at| {
                    lower < upper && (at <= lower && slope[place] < 0.0 || at >= upper && slope[place] > 0.0)
                });
                if wants {
                    held[place] = None;
                    settled = false;
                }
            }
        }
        if settled {
            break;
        }
    }
    for (x, [lower, upper]) in found.iter_mut().zip(bounds) {
        *x = x.clamp(*lower, *upper);
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_bound_stops_moves_the_others() {
        let products = DMatrix::from_row_slice(2, 2, &[2.0, 1.9, 1.9, 2.0]);
        // free: (10, -9); with the first at 1 the second is at 0
        let data = &products * DVector::from_vec(vec![10.0, -9.0]);
        let found = bounded(&products, &data, &[[0.0, 1.0], [-20.0, 20.0]]).expect("a factor");
        assert!((found[0] - 1.0).abs() < 1e-12, "{found}");
        assert!((found[1] - (data[1] - 1.9) / 2.0).abs() < 1e-12, "{found}");
    }
}
