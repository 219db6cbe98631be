use super::*;

/// Central differences of a smooth distance.
const DIFFERENCE: f64 = 1e-5;

fn chain(lengths: &[f64], overhang: f64) -> Chain {
    Chain {
        lengths: lengths.to_vec(),
        known: true,
        overhang,
        overhang_std: 0.0,
        tip_overhang: 0.0,
        rounding: 0.0,
        base: None,
    }
}

#[test]
fn slopes_agree_with_differences() {
    let chain =
        Chain { overhang_std: f64::INFINITY, known: false, rounding: 0.4, ..chain(&[1.0, 1.0, 1.2], 2.0) };
    let pose = Pose {
        base: [10.0, 20.0],
        angle: vec![0.3, 0.9, -0.2],
        half: vec![5.0, 6.0, 4.0],
        unit: 40.0,
        overhang: 2.0,
    };
    let corners = [[9.0, 27.0], [2.0, 14.0], [60.0, 80.0], [40.0, 23.0], [110.0, 52.0], [111.5, 58.0]];
    let edge: Vec<Px> =
        corners.iter().flat_map(|c| (0..4).map(|k| [c[0] + 0.3 * f64::from(k), c[1]])).collect();
    let rows = |pose: &Pose| chain.residuals(&edge, pose).unwrap();
    let links = chain.placed(&pose);
    let mut slope = [0.0; 10];
    let at = rows(&pose);
    for parameter in 0..10 {
        let step = |sign: f64| {
            let mut step = DVector::zeros(10);
            step[parameter] = sign * DIFFERENCE;
            rows(&pose.moved(&step, &chain))
        };
        let (up, down) = (step(1.0), step(-1.0));
        for (k, row) in at.iter().enumerate() {
            let difference = (up[k].value - down[k].value) / (2.0 * DIFFERENCE);
            chain.slope(row, &links, &mut slope);
            assert!((slope[parameter] - difference).abs() < 1e-5, "{parameter} {k}");
        }
    }
}

#[test]
fn chain_is_recovered_from_points_on_its_outline() {
    assert_recovered(&[0.2, 0.6, 1.3], [2.0, -1.5], 7.0);
}

#[test]
fn straight_chain_does_not_slide_along_its_line() {
    for bend in [0.0, 0.01] {
        for off in [-4.0, 2.0, 6.0] {
            assert_recovered(&[0.0, bend, -bend], [off, 0.0], 8.0);
        }
    }
}

/// A chain with links at `angle` is found by a fit that starts `off` \[px\], with links of half width `half`.
fn assert_recovered(angle: &[f64], off: Px, half: f64) {
    let chain = chain(&[50.0, 50.0, 55.0], 5.0);
    let half_widths = vec![8.0; 3];
    let truth =
        Pose { base: [30.0, 40.0], angle: angle.to_vec(), half: half_widths, unit: 1.0, overhang: 5.0 };
    let points = truth.points(&chain.lengths);
    let mut edge = Vec::new();
    for (i, (start, angle)) in points.iter().zip(&truth.angle).enumerate() {
        let (sin, cos) = angle.sin_cos();
        let along = |u: f64, v: f64| [start[0] + u * cos - v * sin, start[1] + u * sin + v * cos];
        edge.extend((0..100).map(|k| f64::from(k) / 2.0).flat_map(|u| [along(u, 8.0), along(u, -8.0)]));
        let cap = [Some(-5.0), None, Some(55.0)][i];
        edge.extend(
            cap.into_iter().flat_map(|u| (-8..=8).map(move |v| (u, f64::from(v)))).map(|(u, v)| along(u, v)),
        );
    }
    let start: Vec<Px> = points.iter().map(|p| [p[0] + off[0], p[1] + off[1]]).collect();
    let free = Chain { overhang: 1.0, overhang_std: f64::INFINITY, ..chain.clone() };
    for chain in [chain, free] {
        let fitted = chain.fit(&edge, &start, half).unwrap();
        for (a, b) in fitted.points.iter().zip(&points) {
            assert!(distance(*a, *b) < 0.01, "{a:?} {b:?}");
        }
        assert!((fitted.overhang.0 - 5.0).abs() < 0.01, "{:?}", fitted.overhang);
    }
}
