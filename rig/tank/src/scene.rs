//! A camera's view of the tank, as images.

use ground::strict::{Finite, Positive};
use image::GrayImage;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::Tank;
use super::causes::Optics;
use super::render::{Look, Renderer, corners, project};
use camera::CameraConfig;
use camera::calibration::Plane;
use camera::mock::{Scene, StampTruth};
use ground::clock::MonotonicNs;

/// A camera's view of the tank.
pub struct TankScene {
    tank: Tank,
    renderer: Renderer,
    optics: Optics,
    noise: Noise,
    exposure_s: f64,
    sync_led_px: Option<[f64; 2]>,
}

/// Radius of the dark holder around the sync LED in the picture \[px\], chosen.
const LED_RADIUS_PX: f64 = 8.0;
/// Grey of the holder, and of the LED when it is lit for all of an exposure, chosen.
const LED_GREY: [f64; 2] = [30.0, 235.0];

/// Draws the sync LED at `centre_px`, lit for `share` of the exposure: a spot that fades towards the rim of a dark holder.
fn glow(picture: &mut GrayImage, centre_px: [f64; 2], share: f64) {
    let (width, height) = picture.dimensions();
    let near = |centre: f64, side: u32| {
        let [from, to] = [centre - LED_RADIUS_PX, centre + LED_RADIUS_PX + 1.0].map(|px| px.max(0.0) as u32);
        from.min(side)..to.min(side)
    };
    for y in near(centre_px[1], height) {
        for x in near(centre_px[0], width) {
            let radius = (f64::from(x) - centre_px[0]).hypot(f64::from(y) - centre_px[1]) / LED_RADIUS_PX;
            if radius < 1.0 {
                let light = share * (-4.0 * radius * radius).exp();
                let grey = LED_GREY[0] + light * (LED_GREY[1] - LED_GREY[0]);
                picture.put_pixel(x, y, image::Luma([grey.round() as u8]));
            }
        }
    }
}

impl Scene for TankScene {
    fn picture(&mut self, at: MonotonicNs) -> Result<GrayImage, String> {
        let half_s = self.exposure_s / 2.0;
        let (opens, closes) = (at.plus_seconds(-half_s), at.plus_seconds(half_s));
        self.tank.await_pulses(closes);
        let mut shapes = self.corners(at)?;
        if self.optics.slowness != 0.0 {
            self.roll(&mut shapes, at)?;
        }
        shapes.iter_mut().flatten().for_each(|point| *point = self.optics.apparent(*point));
        let mut picture = self.renderer.draw_polygons(&project(&shapes, &self.renderer.plane));
        if let Some(centre_px) = self.sync_led_px {
            glow(&mut picture, centre_px, self.tank.lit_share(opens, closes));
        }
        self.noise.add(&mut picture, at);
        Ok(picture)
    }

    fn run_origin(&self) -> Option<MonotonicNs> {
        self.tank.run_origin()
    }
}

impl TankScene {
    fn corners(&self, at: MonotonicNs) -> Result<Vec<Vec<[f64; 2]>>, String> {
        let qpos = self.tank.qpos(at).map_err(|error| {
            let cause = std::error::Error::source(&error).map(|cause| format!(": {cause}"));
            format!("{error}{}", cause.unwrap_or_default())
        })?;
        Ok(corners(self.tank.model(), &qpos, self.renderer.plane.view()))
    }

    /// Moves each point to where it is when its row is exposed: on the parabola through three instants of the motion.
    fn roll(&self, shapes: &mut [Vec<[f64; 2]>], at: MonotonicNs) -> Result<(), String> {
        let far = shapes
            .iter()
            .flatten()
            .map(|point| point[1])
            .fold(0.0, |far: f64, z| if z.abs() > far.abs() { z } else { far });
        let span_s = self.optics.slowness * far;
        if span_s == 0.0 {
            return Ok(());
        }
        let (middle, end) =
            (self.corners(at.plus_seconds(0.5 * span_s))?, self.corners(at.plus_seconds(span_s))?);
        for (shape, (middle, end)) in shapes.iter_mut().zip(middle.iter().zip(&end)) {
            for (point, (middle, end)) in shape.iter_mut().zip(middle.iter().zip(end)) {
                let s = self.optics.slowness * point[1] / span_s;
                let weights = [(1.0 - s) * (1.0 - 2.0 * s), 4.0 * s * (1.0 - s), s * (2.0 * s - 1.0)];
                *point = std::array::from_fn(|axis| {
                    weights[0] * point[axis] + weights[1] * middle[axis] + weights[2] * end[axis]
                });
            }
        }
        Ok(())
    }
}

impl Tank {
    /// The scene that a camera configured as `camera` films.
    pub fn scene(&self, camera: &CameraConfig) -> TankScene {
        let view = &self.config().view;
        let plane =
            Plane::square(view.metres_per_pixel.get(), view.origin_px.map(Finite::get)).viewed(view.plane);
        let look = Look {
            water: view.water_grey.get(),
            mechanism: view.mechanism_grey.get(),
            blur_px: view.blur_px.get(),
            falloff: view.falloff.get(),
            ..Look::plain(camera.width_px, camera.height_px)
        };
        let noise = Noise::new(view.noise_grey.get(), self.config().seed);
        let optics = Optics::new(&self.config().causes);
        TankScene {
            tank: self.clone(),
            renderer: Renderer::new(plane, look),
            optics,
            noise,
            exposure_s: camera.exposure_s.map_or(0.0, Positive::get),
            sync_led_px: view.sync_led_px.map(|px| px.map(Finite::get)),
        }
    }

    /// The errors of a mock camera's stamps in this tank.
    pub fn stamp_truth(&self) -> StampTruth {
        let config = self.config();
        StampTruth {
            latency_s: config.view.stamp_latency_s.get() - Optics::new(&config.causes).delay_s,
            jitter_s: config.view.stamp_jitter_s.get(),
            seed: config.seed,
        }
    }
}

/// Length of the table that noise is taken from, chosen: a prime, so that it never lines up with the rows of a picture.
const NOISE_TABLE_LENGTH: usize = 1_048_573;

/// A sensor's noise: normal, independent from pixel to pixel. Drawn once into a table that each image enters at a place of
/// its own, since drawing 300 000 numbers for each image would take longer than the image's period.
struct Noise {
    table: Vec<i8>,
    seed: u64,
}

impl Noise {
    fn new(std_grey: f64, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut grey = || -> f64 { StandardNormal.sample(&mut random) };
        let table = if std_grey > 0.0 {
            (0..NOISE_TABLE_LENGTH).map(|_| (grey() * std_grey).round() as i8).collect()
        } else {
            Vec::new()
        };
        Self { table, seed }
    }

    fn add(&self, picture: &mut GrayImage, at: MonotonicNs) {
        if self.table.is_empty() {
            return;
        }
        let mut from = ChaCha8Rng::seed_from_u64(self.seed ^ at.0).random_range(0..NOISE_TABLE_LENGTH);
        let mut pixels: &mut [u8] = picture;
        while !pixels.is_empty() {
            // Slice by slice, which the compiler does for many pixels at once.
            let (now, later) = pixels.split_at_mut(pixels.len().min(NOISE_TABLE_LENGTH - from));
            for (pixel, &noise) in now.iter_mut().zip(&self.table[from..]) {
                *pixel = pixel.saturating_add_signed(noise);
            }
            pixels = later;
            from = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_the_stated_spread_and_differs_from_image_to_image() {
        let noise = Noise::new(3.0, 7);
        let picture = |at| {
            let mut picture = GrayImage::from_pixel(640, 480, image::Luma([100]));
            noise.add(&mut picture, MonotonicNs(at));
            picture
        };
        let first = picture(1);
        assert_eq!(first, picture(1));
        assert_ne!(first, picture(2));
        let count = 640.0 * 480.0;
        let deviations: Vec<f64> = first.iter().map(|&grey| f64::from(grey) - 100.0).collect();
        let mean = deviations.iter().sum::<f64>() / count;
        let variance = deviations.iter().map(|d| d * d).sum::<f64>() / count;
        // Rounding to whole levels adds a twelfth. Over 307 200 pixels the mean is good to 0.0055, the variance to
        // 0.023; five of each.
        assert!(mean.abs() < 0.03 && (variance - 9.083).abs() < 0.12, "{mean} {variance}");
    }

    const CHAIN: &str = r#"
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.001" gravity="0 0 -9.81" density="1000" viscosity="0.00095"/>
  <default>
    <geom type="box" density="1240" fluidshape="ellipsoid" size="0.005 0.0025 0.015" pos="0 0 -0.0125"/>
    <joint type="hinge" axis="0 -1 0" damping="1e-6" frictionloss="1e-6"/>
  </default>
  <worldbody>
    <body name="link1" gravcomp="0.8">
      <joint name="q1"/><geom name="g1"/>
      <body name="link2" pos="0 0 -0.025" gravcomp="0.8">
        <joint name="q2"/><geom name="g2"/>
        <body name="link3" pos="0 0 -0.025" gravcomp="0.8"><joint name="q3"/><geom name="g3"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>"#;

    const TANK: &str = "model = \"chain.xml\"\ninitial_qpos = [1.5, 0.0, 0.0]\nhold = \"release\"\n\
        [release]\nafter_s = 0.0\n[view]\nmetres_per_pixel = 0.00025\norigin_px = [320.0, 60.0]\n";

    #[test]
    fn clones_are_the_same_tank_and_the_camera_sees_it_let_go() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("chain.xml"), CHAIN).unwrap();
        std::fs::write(folder.path().join("tank.toml"), TANK).unwrap();
        let tank = Tank::read(folder.path()).unwrap();
        let mut scene = tank.scene(&CameraConfig::default());
        let begin = MonotonicNs::now();
        let at = |ms: u32| begin.plus_seconds(0.1 + 1e-3 * f64::from(ms));
        let (held, released) = (at(0), at(10));
        let first = scene.picture(held).unwrap();
        assert_eq!(first.dimensions(), (640, 480));
        tank.clone().ask_release(released);
        assert_eq!(tank.qpos(released).unwrap()[0], 1.5);
        let begun = std::time::Instant::now();
        for ms in 1..=100 {
            scene.picture(at(10 + 10 * ms)).unwrap();
        }
        // Printed and not asserted: it depends on what else the machine does.
        println!("100 images of 640x480 in {:?}", begun.elapsed());
        let angle = tank.qpos(at(1010)).unwrap()[0];
        assert!(angle < 1.0, "{angle}");
        // Where the first link was held out to the side there is water now.
        let (column, row) = (380, 60);
        let (before, after) =
            (first.get_pixel(column, row).0[0], scene.picture(at(1010)).unwrap().get_pixel(column, row).0[0]);
        assert!(before < 100 && after > 150, "{before} {after}");
    }

    /// Where the mechanism's darkness lies in `picture` \[px\].
    fn centre(picture: &GrayImage) -> [f64; 2] {
        let (mut sum, mut at) = (0.0, [0.0, 0.0]);
        for (x, y, grey) in picture.enumerate_pixels() {
            let dark = 200.0 - f64::from(grey.0[0]);
            sum += dark;
            at = [at[0] + dark * f64::from(x), at[1] + dark * f64::from(y)];
        }
        [at[0] / sum, at[1] / sum]
    }

    #[test]
    fn hidden_camera_causes_are_in_the_picture() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("chain.xml"), CHAIN).unwrap();
        let quiet = format!("{TANK}noise_grey = 0.0\n");
        let tank = |causes: &str| {
            std::fs::write(folder.path().join("tank.toml"), format!("{quiet}[causes]\n{causes}")).unwrap();
            Tank::read(folder.path()).unwrap()
        };
        let seen = |tank: &Tank, later_s: f64| {
            let begin = MonotonicNs::now().plus_seconds(0.1);
            tank.ask_release(begin);
            centre(&tank.scene(&CameraConfig::default()).picture(begin.plus_seconds(later_s)).unwrap())
        };
        // the chain is held nearly level, its centre 38 mm to the right: a turn lifts it
        let (plain, turned) = (seen(&tank(""), 0.0), seen(&tank("camera_rotation = { angle = 0.1 }"), 0.0));
        let lift = (plain[1] - turned[1]) / (plain[0] - 320.0);
        assert!((lift - 0.1).abs() < 0.005, "{lift}");
        let smaller = seen(&tank("camera_scale = { scale = -0.05 }"), 0.0);
        let growth = (smaller[0] - 320.0) / (plain[0] - 320.0);
        assert!((growth - 0.95).abs() < 1e-3, "{growth}");
        // falling, what is lower is seen earlier where rows further down are taken earlier, so less far down
        let (still, rolled) =
            (seen(&tank(""), 0.1), seen(&tank("rolling_shutter = { slowness = 0.5 }"), 0.1));
        let behind = still[1] - rolled[1];
        assert!((0.5..10.0).contains(&behind), "{behind}");
        let truth = tank("camera_delay = { delay = -0.01 }").stamp_truth();
        assert!((truth.latency_s - 0.01).abs() < 1e-15);
    }

    #[test]
    fn no_noise_leaves_the_picture_alone() {
        let mut picture = GrayImage::from_pixel(4, 4, image::Luma([9]));
        Noise::new(0.0, 1).add(&mut picture, MonotonicNs(1));
        assert!(picture.iter().all(|&grey| grey == 9));
    }
}
