//! What the camera makes of the motion.

use super::*;

#[test]
fn camera_sees_points_where_they_are_when_it_looks() {
    let model = chain("passive");
    let start = [1.3, 0.2, -0.4];
    let times = grid(0.8, 0.05);
    let seen = |values: &[(&str, f64)], times: &[f64]| {
        run(&with(&model, values), &start, times, &rk4(0.005)).position_m
    };
    let delay = 0.0123;
    let later: Vec<f64> = times.iter().map(|t| t + delay).collect();
    // both are cubics between steps, one in angles, one in positions
    const BETWEEN_M: f64 = 1e-8;
    let worst = |a: &[[f64; 3]], b: &[[f64; 3]]| {
        let apart = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs());
        apart.fold(0.0, f64::max)
    };
    assert!(worst(&seen(&[("camera_delay/delay", delay)], &times), &seen(&[], &later)) < BETWEEN_M);
    // nothing moved before the start
    let still = seen(&[("camera_delay/delay", -0.06)], &[0.0, 0.05]);
    assert_eq!(still[..3], still[3..]);

    let slowness = 0.2;
    let rolled = seen(&[("rolling_shutter/slowness", slowness)], &times);
    let plain = seen(&[], &times);
    for (row, &time_s) in times.iter().enumerate().skip(4) {
        for point in 0..3 {
            let when = time_s + slowness * plain[3 * row + point][2];
            let expected = seen(&[], &[when])[point];
            assert!(worst(&[rolled[3 * row + point]], &[expected]) < BETWEEN_M, "{time_s} {point}");
        }
    }
    let turned = seen(
        &[
            ("camera_scale/scale", 0.02),
            ("camera_rotation/angle", 0.1),
            ("camera_tilt/x", 0.5),
            ("lens/radial", 3.0),
            ("camera_offset/x", 0.004),
            ("camera_offset/z", -0.003),
        ],
        &times,
    );
    for (ours, [x, y, z]) in turned.iter().zip(&plain) {
        let radial = 1.0 + 3.0 * (x * x + z * z);
        let (x, z) = (x * radial, z * radial);
        let tilt = (1.0 + 0.5 * x) * 1.02;
        let (x, z) = (x * tilt, z * tilt);
        let (sin, cos) = 0.1_f64.sin_cos();
        assert!(worst(&[*ours], &[[cos * x - sin * z + 0.004, *y, sin * x + cos * z - 0.003]]) < 1e-14);
    }
    let slipped = seen(&[("keypoint_slip/P3", 0.002)], &times);
    for (ours, plain) in slipped.chunks(3).zip(plain.chunks(3)) {
        let [a, b] = [ours[2], plain[2]].map(|p| (Vec3(p) - Vec3(plain[1])).norm());
        assert!((a - b - 0.002).abs() < 1e-12 && ours[..2] == plain[..2]);
    }
}
