//! Forces on one link, in closed form.

use super::*;

#[test]
fn each_cause_exerts_its_closed_form_on_one_link() {
    let (q, w) = (0.7_f64, 3.0_f64);
    let held = 0.8 * LINK_KG;
    let cases: [(&str, Values, f64); 11] = [
        ("buoyancy", &[("buoyancy/scale", 0.1)], 0.1 * held * G * LEVER_M * q.sin()),
        ("link_mass", &[("link_mass/scale", 0.1)], -0.1 * LINK_KG * G * LEVER_M * q.sin()),
        ("joint_damping", &[("joint_damping/damping", 1e-6)], -1e-6 * w),
        ("stiffness", &[("stiffness/stiffness", 1e-4)], -1e-4 * q),
        ("one-sided stiffness", &[("one_sided_stiffness/stiffness", 1e-4)], -1e-4 * q),
        ("end stop", &[("end_stop/stiffness", 1e-3), ("end_stop/angle", 0.5)], -1e-3 * (q - 0.5)),
        (
            "end stop that loses energy",
            &[("end_stop/stiffness", 1e-3), ("end_stop/angle", 0.5), ("end_stop/loss", 0.2)],
            -1e-3 * (q - 0.5) * (1.0 + 0.2 * w),
        ),
        (
            "coulomb_friction",
            &[("coulomb_friction/torque", 2e-6), ("coulomb_friction/rate", 0.4)],
            -2e-6 * w / w.hypot(0.4),
        ),
        (
            "cob_offset",
            &[("cob_offset/along", 1e-3), ("cob_offset/across", 5e-4)],
            held * G * (1e-3 * q.sin() + 5e-4 * q.cos()),
        ),
        ("linear_drag", &[("linear_drag/drag", 1e-3)], -1e-3 * LEVER_M * LEVER_M * w),
        (
            "tether",
            &[("tether/stiffness", 0.01), ("tether/x", 0.05), ("tether/z", 0.02)],
            0.01 * TIP_M * (0.05 * q.cos() + 0.02 * q.sin()),
        ),
    ];
    for (what, values, expected) in cases {
        assert_close(torque(values, q, w), expected, 1e-9, what);
    }
    assert_eq!(torque(&[("one_sided_stiffness/stiffness", 1e-4)], -q, w), 0.0);
    assert_eq!(torque(&[("end_stop/stiffness", 1e-4), ("end_stop/angle", 0.8)], q, w), 0.0);
    let leaving: Values = &[("end_stop/stiffness", 1e-3), ("end_stop/angle", 0.5), ("end_stop/loss", 0.5)];
    assert_eq!(torque(leaving, q, -w), 0.0, "a stop does not hold back what leaves it");
}
