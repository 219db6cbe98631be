//! Straight lines to straight lines: a map between two planes from points known in both.

use nalgebra::{DMatrix, Matrix3, Vector2, Vector3};

/// `map` applied to `point`.
pub(super) fn project(map: &Matrix3<f64>, point: Vector2<f64>) -> Vector2<f64> {
    let image = map * Vector3::new(point.x, point.y, 1.0);
    Vector2::new(image.x / image.z, image.y / image.z)
}

/// The homography that takes the first of each pair nearest to the second, in the algebraic sense; `None` for fewer than four pairs or
/// where all but one lie on a line.
///
/// # Source
/// R. Hartley, A. Zisserman, "Multiple View Geometry in Computer Vision", normalised direct linear transformation.
pub(super) fn homography(pairs: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Matrix3<f64>> {
    /// Smallest ratio of the second smallest singular value to the largest at which the map is unique (chosen).
    const SINGULAR_VALUE_RATIO_MIN: f64 = 1e-7;
    if pairs.len() < 4 {
        return None;
    }
    let from = normaliser(pairs.iter().map(|pair| pair.0))?;
    let to = normaliser(pairs.iter().map(|pair| pair.1))?;
    // The sum of the equations' squares: 9 x 9, whatever the number of pairs.
    let mut squares = DMatrix::zeros(9, 9);
    for &(a, b) in pairs {
        let (a, b) = (project(&from, a), project(&to, b));
        for (row, coordinate_there) in [(0, b.x), (3, b.y)] {
            let mut equation = DMatrix::zeros(9, 1);
            for (i, coordinate) in [a.x, a.y, 1.0].into_iter().enumerate() {
                equation[row + i] = coordinate;
                equation[6 + i] = -coordinate_there * coordinate;
            }
            squares += &equation * equation.transpose();
        }
    }
    let eigen = squares.symmetric_eigen();
    let mut order: Vec<usize> = (0..9).collect();
    order.sort_unstable_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let determined = eigen.eigenvalues[order[1]] > SINGULAR_VALUE_RATIO_MIN * eigen.eigenvalues[order[8]];
    if !determined {
        return None;
    }
    let least = eigen.eigenvectors.column(order[0]);
    let map = to.try_inverse()? * Matrix3::from_row_iterator(least.iter().copied()) * from;
    // The middle of the points is finite, and its sign makes that of the whole.
    let middle = from.try_inverse()? * Vector3::z();
    let scale = (map * middle / middle.z).z;
    (scale.is_finite() && scale != 0.0).then(|| map / scale)
}

/// Moves points to around 0 and to a mean distance of √2; `None` where they are all one.
fn normaliser(points: impl Iterator<Item = Vector2<f64>> + Clone) -> Option<Matrix3<f64>> {
    let count = points.clone().count() as f64;
    let middle = points.clone().sum::<Vector2<f64>>() / count;
    let distance = points.map(|point| (point - middle).norm()).sum::<f64>() / count;
    let s = std::f64::consts::SQRT_2 / distance;
    s.is_finite().then(|| Matrix3::new(s, 0.0, -s * middle.x, 0.0, s, -s * middle.y, 0.0, 0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs(points: &[[f64; 2]], map: &Matrix3<f64>) -> Vec<(Vector2<f64>, Vector2<f64>)> {
        points.iter().map(|&point| (point.into(), project(map, point.into()))).collect()
    }

    #[test]
    fn map_is_found_from_four_points_and_more() {
        let map = Matrix3::new(2e-4, 1e-6, -0.05, -2e-6, -2.1e-4, 0.06, 1e-5, 2e-5, 1.0);
        let points = [[100.0, 100.0], [900.0, 120.0], [130.0, 600.0], [1000.0, 650.0], [500.0, 300.0]];
        for count in [4, 5] {
            let found = homography(&pairs(&points[..count], &map)).unwrap();
            for point in points {
                let off = project(&found, point.into()) - project(&map, point.into());
                assert!(off.norm() < 1e-9, "{count} {point:?} {off}");
            }
        }
    }

    #[test]
    fn points_on_a_line_and_too_few_points_make_no_map() {
        let map = Matrix3::identity();
        let line: Vec<[f64; 2]> = (0..9).map(|i| [f64::from(i), 2.0 * f64::from(i)]).collect();
        assert_eq!(homography(&pairs(&line, &map)), None);
        assert_eq!(homography(&pairs(&[[1.0, 1.0]; 9], &map)), None);
        assert_eq!(homography(&pairs(&line[..3], &map)), None);
    }
}
