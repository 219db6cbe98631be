//! Tests of the whole: that pictures show what the truth says.

use crate::optics::calibrate::Calibration;
use crate::optics::camera::Ray;
use crate::optics::mechanism::Kind;
use crate::optics::render::Renderer;
use crate::optics::setting::Setting;
use crate::optics::solids::{Shape, Solid};
use crate::optics::truth;
use crate::optics::vec::{V3, v3};
use crate::optics::world::{FOREIGN, Material, WALL};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn setting(kind: Kind, seed: u64, scene: &str) -> Setting {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut s = Setting::drawn(kind, seed, 20, (640, 480), &mut rng);
    crate::optics::scene::apply(scene, &mut s, &mut rng).unwrap();
    s.finish(&mut rng);
    s
}

/// A point of the plane is projected to the pixel whose ray goes through it.
#[test]
fn projection_inverts_the_ray() {
    let s = setting(Kind::Chain, 3, "clean");
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..200 {
        let (c, r) = (rng.random_range(0.0..639.0), rng.random_range(0.0..479.0));
        let y_m = rng.random_range(-0.05..0.1);
        let (x, z) = s.camera.on_plane(c, r, y_m);
        let (c1, r1) = s.camera.project(v3(x, y_m, z));
        assert!((c1 - c).hypot(r1 - r) < 1e-6, "{c} {r} came back as {c1} {r1}");
    }
}

/// Snell's law holds at the port, seen from directions alone.
#[test]
fn rays_obey_snell() {
    let s = setting(Kind::Arm, 2, "clean");
    for (c, r) in [(0.0, 0.0), (639.0, 10.0), (320.0, 400.0)] {
        let air = s.camera.direction_in_air(c, r);
        let water = s.camera.ray(c, r).along;
        let sine = |d: V3| d.x.hypot(d.z) / d.norm();
        assert!((sine(air) - 1.333 * sine(water)).abs() < 1e-12);
        assert!((water.norm() - 1.0).abs() < 1e-12);
    }
}

/// The handed out calibration gives back points of the plane, within what its own residual says.
#[test]
fn calibration_comes_back() {
    for seed in 1..20 {
        for kind in [Kind::Chain, Kind::Arm] {
            let s = setting(kind, seed, "clean");
            let c = Calibration::of(&s.camera);
            assert!(c.rms_px < 0.1, "{kind:?} {seed}: {} px rms, {} px at worst", c.rms_px, c.worst_px);
            for i in 0..20 {
                for k in s.keypoints(i as f64 / s.fps) {
                    let (column, row) = s.camera.project(k.at);
                    let (x, z) = c.metres(column, row);
                    let off_px = (x - k.at.x).hypot(z - k.at.z) * s.camera.scale_px_per_m(0.0);
                    assert!(off_px < c.worst_px.max(0.05), "{kind:?} {seed}: {off_px} px");
                }
            }
        }
    }
}

/// Small bright discs put at the keypoints are found where the truth says, through the whole renderer and the lens's blur.
#[test]
fn dots_are_where_the_truth_says() {
    for (kind, scene, seed) in
        [(Kind::Chain, "clean", 4), (Kind::Arm, "clean", 5), (Kind::Chain, "rolling", 6)]
    {
        let mut s = setting(kind, seed, scene);
        s.world.materials[WALL].albedo = V3::ZERO;
        s.world.haze = V3::ZERO;
        s.world.light.colour = V3::ZERO;
        s.world.light.ambient = V3::ZERO;
        let dot = s.material(Material::matte(V3::all(1.0), crate::optics::texture::Texture::Plain));
        s.mechanism.made = crate::optics::mechanism::Made::Dots {
            material: dot,
            radius_m: 1.6 / s.camera.scale_px_per_m(0.0),
        };
        let renderer = Renderer::new(&s);
        for image in [0, 7] {
            let mut sum = vec![(0.0, 0.0, 0.0); s.keypoints(0.0).len()];
            // Some renderings of other samples, so that the samples' own noise counts less.
            for pass in 0..6u32 {
                let picture = renderer.image_of_pass(image, true, pass).blurred(s.sensor.blur_px);
                for (k, truth) in truth::of_image(&s, image).iter().enumerate() {
                    let (tc, tr) = (truth.column.round() as i64, truth.row.round() as i64);
                    for r in tr - 9..=tr + 9 {
                        for c in tc - 9..=tc + 9 {
                            let v = picture.light[r as usize * 640 + c as usize][1] as f64;
                            sum[k] = (sum[k].0 + v, sum[k].1 + v * c as f64, sum[k].2 + v * r as f64);
                        }
                    }
                }
            }
            for (k, truth) in truth::of_image(&s, image).iter().enumerate() {
                let (c, r) = (sum[k].1 / sum[k].0, sum[k].2 / sum[k].0);
                let off = (c - truth.column).hypot(r - truth.row);
                println!(
                    "{kind:?} {scene} image {image} {}: off by {:.4} {:.4} px",
                    truth.name,
                    c - truth.column,
                    r - truth.row
                );
                assert!(off < 0.03, "{kind:?} {scene} image {image} {}: {off} px", truth.name);
            }
        }
    }
}

/// Where a ray enters a hull agrees with marching along it through the distance to the hull.
#[test]
fn hulls_are_entered_at_their_surface() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let (a, b, ra_m, rb_m) = (v3(0.0, 0.0, 0.0), v3(0.02, 0.0, -0.03), 0.008, 0.003);
    let solid = Solid::new(Shape::RoundCone { a, b, ra_m, rb_m, cut: None }, 0, FOREIGN);
    let inside = |p: V3| {
        // The hull is the union of the balls between its ends.
        (0..=2000).any(|i| {
            let s = i as f64 / 2000.0;
            (p - (a + (b - a) * s)).norm() < ra_m + (rb_m - ra_m) * s
        })
    };
    for _ in 0..200 {
        let from = v3(rng.random_range(-0.01..0.03), -0.1, rng.random_range(-0.04..0.01));
        let along = v3(rng.random_range(-0.1..0.1), 1.0, rng.random_range(-0.1..0.1)).unit();
        let ray = Ray { from, along };
        match solid.hit(&ray) {
            Some(h) => {
                assert!(
                    !inside(ray.at(h.t - 2e-5)) && inside(ray.at(h.t + 2e-4))
                        || h.normal.dot(along).abs() < 0.1
                );
                assert!((h.normal.norm() - 1.0).abs() < 1e-9 && h.normal.dot(along) <= 0.0);
            }
            None => assert!((0..400).all(|i| !inside(ray.at(0.08 + i as f64 * 1e-4)))),
        }
    }
}

/// A round arm ends at its tip: no part of it lies beyond the last node, nor before the root.
#[test]
fn arms_are_as_long_as_the_model() {
    let s = setting(Kind::Arm, 1, "clean");
    let pose = crate::optics::mechanism::Pose { angles_rad: vec![0.0; 8], ..Default::default() };
    let solids = s.mechanism.solids(&pose, 0, 0);
    let length_m = s.mechanism.length_m();
    let met = |z: f64| {
        let ray = Ray { from: v3(0.0, -0.1, z), along: v3(0.0, 1.0, 0.0) };
        solids.iter().any(|s| s.hit(&ray).is_some())
    };
    assert!(!met(1e-6) && met(-1e-6) && met(1e-6 - length_m) && !met(-1e-6 - length_m));
}
