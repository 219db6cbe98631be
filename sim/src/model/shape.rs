//! Volume, inertia and semi-axes of the shapes.

use std::f64::consts::PI;

use super::GeomKind;
use crate::math::{Mat3, Quat, Sym3, Vec3};

/// Mass, centre, principal moments and their axes of one or several shapes, in a body's frame.
pub(crate) struct MassProperties {
    pub(crate) mass: f64,
    pub(crate) com: Vec3<f64>,
    pub(crate) inertia: Vec3<f64>,
    pub(crate) principal: Quat<f64>,
}

/// Volume \[m3\] of a solid shape.
pub(crate) fn volume(kind: GeomKind, [a, b, c]: [f64; 3]) -> f64 {
    match kind {
        GeomKind::Sphere => 4.0 / 3.0 * PI * a * a * a,
        GeomKind::Capsule => PI * a * a * (2.0 * b + 4.0 / 3.0 * a),
        GeomKind::Cylinder => PI * a * a * 2.0 * b,
        GeomKind::Ellipsoid => 4.0 / 3.0 * PI * a * b * c,
        GeomKind::Box => 8.0 * a * b * c,
        GeomKind::Plane => 0.0,
    }
}

/// Principal moments of inertia \[kg m2\] of a solid shape of that mass, about its centre.
pub(crate) fn inertia(kind: GeomKind, [a, b, c]: [f64; 3], mass: f64) -> Vec3<f64> {
    let of_squares = |x: f64, y: f64, z: f64, k: f64| Vec3([y + z, x + z, x + y].map(|s| s * mass * k));
    match kind {
        GeomKind::Sphere => Vec3([0.4 * mass * a * a; 3]),
        GeomKind::Ellipsoid => of_squares(a * a, b * b, c * c, 0.2),
        GeomKind::Box => of_squares(a * a, b * b, c * c, 1.0 / 3.0),
        GeomKind::Cylinder => {
            let across = mass * (3.0 * a * a + 4.0 * b * b) / 12.0;
            Vec3([across, across, 0.5 * mass * a * a])
        }
        GeomKind::Capsule => {
            // a cylinder and a ball cut in two, its halves moved out by b
            let ball = mass * 2.0 * a / (2.0 * a + 3.0 * b);
            let tube = mass - ball;
            let along = 0.5 * tube * a * a + 0.4 * ball * a * a;
            let across = tube * (3.0 * a * a + 4.0 * b * b) / 12.0
                + 0.4 * ball * a * a
                + ball * b * (3.0 * a + 4.0 * b) / 4.0;
            Vec3([across, across, along])
        }
        GeomKind::Plane => Vec3::ZERO,
    }
}

/// Semi-axes \[m\] of the ellipsoid that stands for the shape in the fluid model.
pub(crate) fn semi_axes(kind: GeomKind, [a, b, c]: [f64; 3]) -> [f64; 3] {
    match kind {
        GeomKind::Sphere => [a, a, a],
        GeomKind::Capsule => [a, a, a + b],
        GeomKind::Cylinder => [a, a, b],
        GeomKind::Ellipsoid | GeomKind::Box => [a, b, c],
        GeomKind::Plane => [0.0; 3],
    }
}

/// Several bodies rigidly joined, as one: (mass, centre, `frame_from_principal`, principal moments) each.
pub(crate) fn combine(parts: &[MassProperties]) -> MassProperties {
    if let [only] = parts {
        // the only shape keeps its own axes
        return MassProperties {
            mass: only.mass,
            com: only.com,
            inertia: only.inertia,
            principal: only.principal,
        };
    }
    let mass: f64 = parts.iter().map(|part| part.mass).sum();
    if mass == 0.0 {
        return MassProperties { mass, com: Vec3::ZERO, inertia: Vec3::ZERO, principal: Quat::IDENTITY };
    }
    let com = parts.iter().fold(Vec3::ZERO, |sum, part| sum + part.com * (part.mass / mass));
    let total = parts.iter().fold(Sym3::ZERO, |sum, part| {
        sum + Sym3::rotated_diagonal(&part.principal.matrix(), part.inertia)
            + Sym3::of_point(part.mass, part.com - com)
    });
    let (inertia, principal) = principal_axes(total);
    MassProperties { mass, com, inertia, principal }
}

/// Products of inertia below this share of the moments count as rounding (chosen).
const NEGLIGIBLE_PRODUCT_SHARE: f64 = 1e-14;
/// Most rotations of Jacobi's method (chosen), which needs a handful.
const JACOBI_ROTATIONS_MAX: usize = 500;

/// Principal moments and `frame_from_principal` of a symmetric inertia, by Jacobi's method (1846): turns in the plane of the
/// largest product of inertia until none is left.
///
/// Where two moments are equal any axes between them would do, but the inertia-box fluid feels which: these are the ones that
/// MuJoCo takes.
pub(crate) fn principal_axes(inertia: Sym3<f64>) -> (Vec3<f64>, Quat<f64>) {
    let mut axes = Mat3::<f64>::IDENTITY;
    for _ in 0..JACOBI_ROTATIONS_MAX {
        let moment = |i: usize, j: usize| axes.column(i).dot(inertia.apply(axes.column(j)));
        let [xy, xz, yz] = [moment(0, 1), moment(0, 2), moment(1, 2)];
        let (i, j, product) = if xy.abs() > xz.abs() && xy.abs() > yz.abs() {
            (0, 1, xy)
        } else if xz.abs() > yz.abs() {
            (0, 2, xz)
        } else {
            (1, 2, yz)
        };
        // the smaller of the two angles whose turn makes the product vanish
        let steep = (moment(j, j) - moment(i, i)) / (2.0 * product);
        let tan = f64::copysign(1.0, steep) / (steep.abs() + steep.hypot(1.0));
        let cos = 1.0 / tan.hypot(1.0);
        if product.abs() <= NEGLIGIBLE_PRODUCT_SHARE * (moment(0, 0) + moment(1, 1) + moment(2, 2)) {
            break;
        }
        for row in &mut axes.0 {
            (row[i], row[j]) = (cos * (row[i] - tan * row[j]), cos * (row[j] + tan * row[i]));
        }
    }
    let moments = std::array::from_fn(|i| axes.column(i).dot(inertia.apply(axes.column(i))));
    (Vec3(moments), quat_of(&axes))
}

/// The unit quaternion of a rotation matrix.
pub(crate) fn quat_of(Mat3([[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]]): &Mat3<f64>) -> Quat<f64> {
    // the largest of the four squared components is at least 1/4: never divides by a small number
    let squares = [1.0 + xx + yy + zz, 1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz];
    let largest = (0..4).fold(0, |best, i| if squares[i] > squares[best] { i } else { best });
    let (wx, wy, wz) = (zy - yz, xz - zx, yx - xy);
    let (sxy, sxz, syz) = (xy + yx, xz + zx, yz + zy);
    let q = match largest {
        0 => [squares[0], wx, wy, wz],
        1 => [wx, squares[1], sxy, sxz],
        2 => [wy, sxy, squares[2], syz],
        _ => [wz, sxz, syz, squares[3]],
    };
    Quat(q).normalized()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROUNDING: f64 = 1e-12;

    #[test]
    fn a_capsule_without_straight_part_is_a_sphere() {
        let (capsule, sphere) = ([0.02, 0.0, 0.0], [0.02, 0.0, 0.0]);
        let ratio = volume(GeomKind::Capsule, capsule) / volume(GeomKind::Sphere, sphere);
        assert!((ratio - 1.0).abs() < ROUNDING);
        let (a, b) = (inertia(GeomKind::Capsule, capsule, 2.0), inertia(GeomKind::Sphere, sphere, 2.0));
        assert!((a - b).norm() < ROUNDING * b.norm());
    }

    #[test]
    fn two_halves_of_a_box_make_the_box() {
        let half = |z: f64| MassProperties {
            mass: 1.5,
            com: Vec3([0.0, 0.0, z]),
            inertia: inertia(GeomKind::Box, [0.1, 0.2, 0.15], 1.5),
            principal: Quat::IDENTITY,
        };
        let joined = combine(&[half(0.15), half(-0.15)]);
        let whole = inertia(GeomKind::Box, [0.1, 0.2, 0.3], 3.0);
        let back = Sym3::rotated_diagonal(&joined.principal.matrix(), joined.inertia);
        for (i, moment) in whole.0.iter().enumerate() {
            assert!((back.0[i] - moment).abs() < ROUNDING, "{back:?} {whole:?}");
        }
        assert!(joined.com.norm() < ROUNDING && (joined.mass - 3.0).abs() < ROUNDING);
    }

    #[test]
    fn principal_axes_diagonalise_and_stay_where_two_moments_are_equal() {
        let turn = Quat([0.3, -0.5, 0.7, 0.2]).normalized().matrix();
        for moments in [[3e-5, 2e-5, 1.5e-5], [2e-5, 2e-5, 1e-5], [1e-5, 3e-5, 3e-5], [2e-5; 3]] {
            let full = Sym3::rotated_diagonal(&turn, Vec3(moments));
            let (found, axes) = principal_axes(full);
            let back = Sym3::rotated_diagonal(&axes.matrix(), found);
            let worst = full.0.iter().zip(back.0).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst < NEGLIGIBLE_PRODUCT_SHARE * 6e-5, "{full:?} {back:?}");
        }
        assert_eq!(principal_axes(Sym3([2e-5, 2e-5, 1e-5, 0.0, 0.0, 0.0])).1, Quat::IDENTITY);
    }

    #[test]
    fn a_rotation_survives_the_way_through_matrix_and_back() {
        for q in [[0.1, 0.9, -0.3, 0.2], [0.8, 0.1, 0.1, 0.1], [0.1, 0.2, -0.9, 0.3], [0.0, 0.1, 0.2, 0.9]] {
            let q = Quat(q).normalized();
            let back = quat_of(&q.matrix());
            let dot: f64 = q.0.iter().zip(back.0).map(|(a, b)| a * b).sum();
            assert!((dot.abs() - 1.0).abs() < ROUNDING);
        }
    }
}
