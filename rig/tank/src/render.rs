//! Draws a mechanism as a camera would see it.
//!
//! Every geom's outline in the plane of the picture is a convex polygon; `coverage` says what their union covers. Only the
//! mechanism's own rectangle is drawn again for each image. Noise is the camera's business, not the scene's.

use image::GrayImage;
use sim::Model;
use sim::math::{Mat3, Vec3};
use sim::model::{Geom, GeomKind};

use camera::calibration::{Plane, Px, View};
use camera::coverage::Coverage;

/// How a scene is lit and filmed.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// Image width \[px\].
    pub width_px: u32,
    /// Image height \[px\].
    pub height_px: u32,
    /// Grey of the empty tank in the middle of the picture, 0 to 255.
    pub water: f64,
    /// Grey of mechanism and scenery there, 0 to 255; above `water` for a bright mechanism.
    pub mechanism: f64,
    /// Blur of the lens, 1 sigma \[px\].
    pub blur_px: f64,
    /// Share of the light that is missing in the picture's corners.
    pub falloff: f64,
    /// Fixed objects in the tank: convex polygons in the picture \[px\].
    pub scenery: Vec<Vec<Px>>,
}

impl Look {
    /// A dark mechanism on evenly lit bright water, slightly blurred, without scenery.
    pub fn plain(width_px: u32, height_px: u32) -> Self {
        Self {
            width_px,
            height_px,
            water: 200.0,
            mechanism: 40.0,
            blur_px: 0.8,
            falloff: 0.0,
            scenery: Vec::new(),
        }
    }
}

/// Draws images of one scene.
#[derive(Debug, Clone)]
pub struct Renderer {
    look: Look,
    pub(super) plane: Plane,
    /// The scene without mechanism, shape (height, width).
    empty: Vec<f32>,
}

/// Corners of the polygon that approximates a circle, chosen: its sides are within 0.03 px of a circle of 40 px.
const CIRCLE_CORNERS: usize = 80;

impl Renderer {
    /// A camera that sees the plane of motion as `plane` says, in the light of `look`.
    pub fn new(plane: Plane, look: Look) -> Self {
        let (width, height) = (look.width_px as usize, look.height_px as usize);
        let lit = |i: usize| light(&look, i % width, i / width) * look.water;
        let empty = (0..width * height).map(|i| lit(i) as f32).collect();
        let mut renderer = Self { plane, empty, look };
        let scenery = renderer.look.scenery.clone();
        let mut empty = std::mem::take(&mut renderer.empty);
        renderer.paint(&scenery, &mut empty);
        renderer.empty = empty;
        renderer
    }

    /// The picture of `model` at the coordinates `qpos`, shape (nq).
    ///
    /// # Panics
    /// When `qpos` has another length than the model has coordinates.
    pub fn draw(&self, model: &Model, qpos: &[f64]) -> GrayImage {
        self.draw_polygons(&outlines(model, qpos, &self.plane))
    }

    /// The picture of convex polygons in the picture's own coordinates \[px\].
    pub fn draw_polygons(&self, polygons: &[Vec<Px>]) -> GrayImage {
        let mut grey = self.empty.clone();
        self.paint(polygons, &mut grey);
        let mut image = GrayImage::new(self.look.width_px, self.look.height_px);
        // Truncating after the half is rounding, and unlike `round` the compiler makes it many at once.
        image.iter_mut().zip(&grey).for_each(|(pixel, value)| *pixel = (value + 0.5) as u8);
        image
    }

    /// Where the static parts are: white, `margin_px` wider all round. For `vision::VisionConfig`.
    pub fn static_mask(&self, margin_px: usize) -> GrayImage {
        let (width, height) = (self.look.width_px, self.look.height_px);
        let mut mask = GrayImage::new(width, height);
        for polygon in &self.look.scenery {
            let Some(coverage) = Coverage::of(std::slice::from_ref(polygon), 0.0, width, height) else {
                continue;
            };
            for (x, y, cover) in coverage.pixels() {
                if cover <= 0.0 {
                    continue;
                }
                for row in y.saturating_sub(margin_px)..=(y + margin_px).min(height as usize - 1) {
                    for column in x.saturating_sub(margin_px)..=(x + margin_px).min(width as usize - 1) {
                        mask.put_pixel(column as u32, row as u32, image::Luma([255]));
                    }
                }
            }
        }
        mask
    }

    fn paint(&self, polygons: &[Vec<Px>], grey: &mut [f32]) {
        let (width, height) = (self.look.width_px, self.look.height_px);
        let Some(coverage) = Coverage::of(polygons, self.look.blur_px, width, height) else { return };
        let even = self.look.falloff == 0.0;
        for (x, y, cover) in coverage.pixels() {
            if cover > 0.0 {
                let light = if even { 1.0 } else { light(&self.look, x, y) };
                let pixel = &mut grey[y * width as usize + x];
                *pixel += cover * ((light * self.look.mechanism) as f32 - *pixel);
            }
        }
    }
}

/// Share of the full light at a pixel.
fn light(look: &Look, x: usize, y: usize) -> f64 {
    let (u, v) =
        (2.0 * x as f64 / f64::from(look.width_px) - 1.0, 2.0 * y as f64 / f64::from(look.height_px) - 1.0);
    1.0 - look.falloff * (u * u + v * v) / 2.0
}

/// Outlines of a model's geoms in the picture \[px\], walls and floors left out.
pub fn outlines(model: &Model, qpos: &[f64], plane: &Plane) -> Vec<Vec<Px>> {
    project(&corners(model, qpos, plane.view()), plane)
}

/// For each geom, points \[m\] in the plane of `view` whose convex hull is its outline, walls and floors left out.
pub(super) fn corners(model: &Model, qpos: &[f64], view: View) -> Vec<Vec<[f64; 2]>> {
    let poses = model.poses(qpos);
    let geoms = model.geoms.iter().zip(poses.geom_pos.iter().zip(&poses.geom_rot));
    geoms.map(|(geom, (pos, rot))| outline(geom, *pos, rot, view)).filter(|p| !p.is_empty()).collect()
}

/// The outlines of geoms with these corners in the picture \[px\].
pub(super) fn project(corners: &[Vec<[f64; 2]>], plane: &Plane) -> Vec<Vec<Px>> {
    corners.iter().map(|points| hull(points.iter().map(|&p| plane.pixel(p)).collect())).collect()
}

/// Points \[m\] whose convex hull is what the camera sees of a geom at `pos`, turned by `rot`.
fn outline(geom: &Geom<f64>, pos: Vec3<f64>, rot: &Mat3<f64>, view: View) -> Vec<[f64; 2]> {
    let at = |local: [f64; 3]| view.seen((pos + rot.apply(Vec3(local))).0);
    let circle =
        || (0..CIRCLE_CORNERS).map(|i| (i as f64 * std::f64::consts::TAU / CIRCLE_CORNERS as f64).sin_cos());
    let [a, b, c] = geom.size;
    match geom.kind {
        GeomKind::Plane => Vec::new(),
        GeomKind::Box => {
            let sign = |corner: usize, axis: usize| if corner >> axis & 1 == 0 { 1.0 } else { -1.0 };
            (0..8).map(|i| at([a * sign(i, 0), b * sign(i, 1), c * sign(i, 2)])).collect()
        }
        GeomKind::Cylinder => {
            circle().flat_map(|(s, k)| [at([a * k, a * s, b]), at([a * k, a * s, -b])]).collect()
        }
        GeomKind::Sphere | GeomKind::Capsule => {
            let half = if geom.kind == GeomKind::Capsule { b } else { 0.0 };
            let ends = [at([0.0, 0.0, half]), at([0.0, 0.0, -half])];
            circle().flat_map(|(s, k)| ends.map(|[x, up]| [x + a * k, up + a * s])).collect()
        }
        GeomKind::Ellipsoid => {
            // The shadow of a ball put through M = rot diag(size) is an ellipse with the matrix M M' of its two
            // rows; its Cholesky factor turns a circle into it.
            let row = |i: usize| Vec3([rot.0[i][0] * a, rot.0[i][1] * b, rot.0[i][2] * c]);
            let [x, up] = view.seen_axes().map(|(axis, _)| row(axis));
            let first = x.norm();
            let cross = x.dot(up) / first;
            let second = (up.dot(up) - cross * cross).max(0.0).sqrt();
            let [x0, up0] = at([0.0; 3]);
            circle().map(|(s, k)| [x0 + first * k, up0 + cross * k + second * s]).collect()
        }
    }
}

/// The convex hull, by rising angle.
///
/// # Source
/// Andrew's monotone chain, Inf. Process. Lett. 9 (1979) 216-219.
fn hull(mut points: Vec<Px>) -> Vec<Px> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let turns_left =
        |a: Px, b: Px, c: Px| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0;
    let mut chain: Vec<Px> = Vec::with_capacity(points.len() + 1);
    let mut add = |points: &mut dyn Iterator<Item = &Px>| {
        let base = chain.len();
        for &p in points {
            while chain.len() >= base + 2 && !turns_left(chain[chain.len() - 2], chain[chain.len() - 1], p) {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
    };
    add(&mut points.iter());
    add(&mut points.iter().rev());
    chain
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative tolerance of areas: eight sub-rows and 8-bit grey are good to a few hundredths of a pixel row.
    const AREA_TOLERANCE_SHARE: f64 = 0.005;

    fn inked(image: &GrayImage, look: &Look) -> (f64, Px) {
        let (mut area, mut moment) = (0.0, [0.0, 0.0]);
        for (x, y, pixel) in image.enumerate_pixels() {
            let cover = (look.water - f64::from(pixel.0[0])) / (look.water - look.mechanism);
            area += cover;
            moment = [moment[0] + cover * f64::from(x), moment[1] + cover * f64::from(y)];
        }
        (area, [moment[0] / area, moment[1] / area])
    }

    fn model(geom: &str) -> Model {
        Model::from_mjcf(&format!(
            "<mujoco><worldbody><body name='b'><joint name='q' type='hinge' axis='0 -1 0'/>{geom}</body></worldbody></mujoco>"
        ))
        .unwrap()
    }

    #[test]
    fn every_shape_covers_its_own_area_at_its_own_place() {
        let look = Look::plain(200, 160);
        let renderer = Renderer::new(Plane::square(0.001, [100.0, 80.0]), look.clone());
        let pi = std::f64::consts::PI;
        for (shape, area) in [
            ("type='box' size='0.01 0.004 0.03'", 20.0 * 60.0),
            ("type='sphere' size='0.02'", pi * 400.0),
            ("type='capsule' size='0.01 0.02'", pi * 100.0 + 20.0 * 40.0),
            ("type='cylinder' size='0.01 0.02'", 20.0 * 40.0),
            ("type='ellipsoid' size='0.03 0.01 0.02'", pi * 600.0),
        ] {
            let model = model(&format!("<geom {shape} pos='0.013 0.3 -0.007' mass='1'/>"));
            let (got, centre) = inked(&renderer.draw(&model, &[0.4]), &look);
            assert!((got / area - 1.0).abs() < AREA_TOLERANCE_SHARE, "{shape}: {got} {area}");
            // Positive is counter-clockwise as the camera sees it; rows grow downward.
            let (sin, cos) = 0.4f64.sin_cos();
            let wanted = [100.0 + 13.0 * cos + 7.0 * sin, 80.0 - (13.0 * sin - 7.0 * cos)];
            assert!(
                (centre[0] - wanted[0]).hypot(centre[1] - wanted[1]) < 0.02,
                "{shape}: {centre:?} {wanted:?}"
            );
        }
    }

    #[test]
    fn shapes_that_touch_leave_no_seam_and_shapes_that_overlap_do_not_add_up() {
        let look = Look { blur_px: 0.0, ..Look::plain(100, 60) };
        let renderer = Renderer::new(Plane::square(0.001, [50.0, 30.0]), look.clone());
        let bar = |x0: f64, x1: f64| vec![[x0, 10.3], [x1, 10.3], [x1, 30.8], [x0, 30.8]];
        let whole = renderer.draw_polygons(&[bar(10.2, 70.7)]);
        assert_eq!(renderer.draw_polygons(&[bar(10.2, 33.33), bar(33.33, 70.7)]), whole);
        assert_eq!(renderer.draw_polygons(&[bar(40.0, 70.7), bar(10.2, 50.0)]), whole);
    }

    #[test]
    fn what_leaves_the_picture_is_cut_and_what_is_outside_is_not_drawn() {
        let renderer = Renderer::new(Plane::square(0.001, [0.0, 0.0]), Look::plain(50, 40));
        let empty = renderer.draw_polygons(&[]);
        let square = |x: f64, y: f64| vec![[x, y], [x + 20.0, y], [x + 20.0, y + 20.0], [x, y + 20.0]];
        for (x, y) in [(-60.0, 5.0), (5.0, 90.0), (f64::NAN, 5.0)] {
            assert_eq!(renderer.draw_polygons(&[square(x, y)]), empty);
        }
        for (x, y) in [(-10.0, -10.0), (40.0, 30.0), (-200.0, -200.0)] {
            let size = if x < -100.0 { 1000.0 } else { 20.0 };
            let big = vec![[x, y], [x + size, y], [x + size, y + size], [x, y + size]];
            assert_ne!(renderer.draw_polygons(&[big]), empty);
        }
    }

    #[test]
    fn scenery_stays_and_its_mask_covers_it() {
        let scenery = vec![vec![[5.0, 5.0], [20.0, 5.0], [20.0, 12.0], [5.0, 12.0]]];
        let look = Look { scenery, falloff: 0.3, ..Look::plain(80, 60) };
        let renderer = Renderer::new(Plane::square(0.001, [0.0, 0.0]), look);
        let (picture, mask) = (renderer.draw_polygons(&[]), renderer.static_mask(3));
        assert!(picture.get_pixel(12, 8).0[0] < 60);
        let bare = Renderer::new(
            Plane::square(0.001, [0.0, 0.0]),
            Look { scenery: Vec::new(), falloff: 0.3, ..Look::plain(80, 60) },
        );
        for ((x, y, grey), empty) in picture.enumerate_pixels().zip(bare.draw_polygons(&[]).pixels()) {
            assert!(grey.0 == empty.0 || mask.get_pixel(x, y).0[0] == 255, "{x} {y}");
        }
    }
}
