//! What a straight edge looks like in a picture: blurred by the lens, in light, which the camera turns into grey levels.

use std::sync::LazyLock;

use super::lines::{PLACES_PER_LINE, SAMPLES_PER_LINE, outward, place_px};
use super::rims::{DIRECTIONS, NO_RIM, Rim};

/// What is taken for the blur of a film before it tells, 1 sigma \[px\]: a sharp lens; chosen.
pub(super) const USUAL_BLUR_PX: f64 = 0.9;
/// Colour at half the resolution, 1 sigma at least \[px\]; chosen.
const COLOUR_BLUR_PX: f64 = 1.6;
/// The exponent from grey levels to light, that of sRGB about (IEC 61966-2-1).
const CAMERA_GAMMA: f32 = 2.2;
/// Entries of the tables between grey levels and light.
const TABLE_ENTRIES: usize = 4096;

static LIGHT_OF_GREY: LazyLock<Vec<f32>> = LazyLock::new(|| {
    (0..TABLE_ENTRIES).map(|i| (i as f32 / (TABLE_ENTRIES - 1) as f32).powf(CAMERA_GAMMA)).collect()
});
static GREY_OF_LIGHT: LazyLock<Vec<f32>> = LazyLock::new(|| {
    (0..=TABLE_ENTRIES).map(|i| 255.0 * (i as f32 / TABLE_ENTRIES as f32).powf(1.0 / CAMERA_GAMMA)).collect()
});

/// Light behind a grey level, from 0 to 1.
pub(super) fn light_of(grey: f32) -> f32 {
    LIGHT_OF_GREY[(grey.clamp(0.0, 255.0) * ((TABLE_ENTRIES - 1) as f32 / 255.0)) as usize]
}

/// The grey level of light, which may be a little outside of 0 to 1.
pub(super) fn grey_of(light: f32) -> f32 {
    GREY_OF_LIGHT[(light.clamp(0.0, 1.0) * TABLE_ENTRIES as f32) as usize]
}

/// The share of the normal distribution below `x`.
pub(super) fn normal_share(x: f64) -> f64 {
    0.5 * (1.0 + libm::erf(x / std::f64::consts::SQRT_2))
}

/// The tank's share at each sample of a line for each place of the edge, shape (SAMPLES_PER_LINE, PLACES_PER_LINE).
type Shares = Vec<f32>;

/// Shares for samples so far apart \[px\]: of the light by where the edge faces, and of the colour.
#[derive(Debug, Clone)]
struct Mixing {
    step_px: f64,
    light: [Shares; DIRECTIONS],
    colour: Shares,
}

/// What the edges of a film look like, wherever they face and however they are read.
#[derive(Debug, Clone)]
pub(super) struct Edges {
    /// Blur in brightness, 1 sigma \[px\].
    pub(super) blur_px: f64,
    pub(super) rims: [Rim; DIRECTIONS],
    mixings: [Mixing; STEPS_PX.len()],
}

/// Samples of a line are so far apart \[px\]: from a rough pose to a good one.
const STEPS_PX: [f64; 4] = [2.5, 2.0, 1.5, 1.0];

impl Edges {
    pub(super) fn new(blur_px: f64, rims: [Rim; DIRECTIONS]) -> Self {
        let mixing = |step_px: f64| {
            let plain = shares(step_px, &NO_RIM, blur_px);
            let light = rims.map(|rim| match rim == NO_RIM {
                true => plain.clone(),
                false => shares(step_px, &rim, blur_px),
            });
            Mixing { step_px, light, colour: shares(step_px, &NO_RIM, blur_px.max(COLOUR_BLUR_PX)) }
        };
        Self { blur_px, rims, mixings: STEPS_PX.map(mixing) }
    }

    /// The tank's share of the light, by direction class, and of the colour, for samples so far apart as the one of [`STEPS_PX`] that is nearest.
    pub(super) fn shares(&self, step_px: f64) -> (&[Shares; DIRECTIONS], &Shares) {
        let [first, others @ ..] = &self.mixings;
        let off = |mixing: &Mixing| (mixing.step_px - step_px).abs();
        let nearest = others.iter().fold(first, |best, one| if off(one) < off(best) { one } else { best });
        (&nearest.light, &nearest.colour)
    }
}

fn shares(step_px: f64, rim: &Rim, blur_px: f64) -> Shares {
    let share = |k: usize, j: usize| {
        let outside = outward(k) * step_px - place_px(j, step_px / 2.0);
        rim.tank_share(outside, blur_px) as f32
    };
    (0..SAMPLES_PER_LINE).flat_map(|k| (0..PLACES_PER_LINE).map(move |j| share(k, j))).collect()
}
