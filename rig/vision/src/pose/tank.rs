//! What the camera sees where the mechanism is not: learned from pictures in which fitted poses leave a pixel clear.

use rayon::prelude::*;

use camera::source::TimedImage;

use super::mechanism::Strips;
use super::view::Camera;

/// Brightness and colour as the camera coded them: Y, and Cb and Cr where there is colour; each row after row \[0..255\].
#[derive(Debug, Clone)]
pub(super) struct Planes {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) planes: Vec<Vec<u8>>,
}

/// Most planes that a picture has.
pub(super) const PLANES: usize = 3;

impl Planes {
    /// Of an image; none where it could not be read.
    pub(super) fn of(image: &TimedImage) -> Option<Self> {
        let grey = image.grey.as_ref().ok()?;
        let mut planes = vec![grey.as_raw().clone()];
        if let Some(chroma) = &image.chroma {
            planes.extend(chroma.iter().map(|plane| plane.as_raw().clone()));
        }
        Some(Self { width: grey.width() as usize, height: grey.height() as usize, planes })
    }

    /// Means of `by` x `by` pixels.
    pub(super) fn reduced(&self, by: usize) -> Reduced {
        let (width, height) = (self.width / by, self.height / by);
        let mean = |plane: &Vec<u8>| {
            let mut out = Vec::with_capacity(width * height);
            for row in 0..height {
                for column in 0..width {
                    let sum: u32 = (row * by..(row + 1) * by)
                        .flat_map(|y| {
                            &plane[y * self.width + column * by..y * self.width + (column + 1) * by]
                        })
                        .map(|&value| u32::from(value))
                        .sum();
                    out.push(sum as f32 / (by * by) as f32);
                }
            }
            out
        };
        Reduced { width, height, planes: self.planes.iter().map(mean).collect() }
    }
}

/// A picture at a lower resolution.
#[derive(Debug, Clone)]
pub(super) struct Reduced {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) planes: Vec<Vec<f32>>,
}

/// How an image's light differs from the tank's as learned: Y is this many times as much, Cb and Cr so much more.
pub(super) type Light = [f32; PLANES];

/// The light of the tank as learned.
pub(super) const SAME_LIGHT: Light = [1.0, 0.0, 0.0];

/// What is known of a pixel of the tank.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    /// Nothing: the mechanism never left it.
    Unknown,
    /// What the tank shows there.
    Known,
    /// Something stands before the mechanism.
    Before,
}

/// The tank without the mechanism.
#[derive(Debug, Clone)]
pub(super) struct Tank {
    pub(super) planes: Planes,
    pub(super) state: Vec<State>,
    /// Standard deviation of a clear pixel about the tank, by plane.
    pub(super) noise: [f32; PLANES],
}

/// Least noise that is believed, by plane, chosen: quantisation and compression.
const MIN_NOISE: [f32; PLANES] = [1.5, 0.8, 0.8];
/// Pixels between two that tell the light.
const LIGHT_STRIDE_PX: usize = 5;
/// A darker tank tells no brightness.
const MIN_TANK_GREY: u8 = 20;
/// From a median absolute deviation to a standard deviation of normal noise.
const STD_PER_MAD: f32 = 1.4826;

impl Tank {
    /// From pictures and where in each the mechanism may be; a pixel is known where at least `least` show it clear.
    pub(super) fn learn(pictures: &[(&Planes, Light)], masks: &[Vec<bool>], least: usize) -> Option<Self> {
        let first = pictures.first()?.0;
        let (width, height, count) = (first.width, first.height, first.planes.len());
        let rows: Vec<(Vec<[u8; PLANES]>, Vec<State>)> = (0..height)
            .into_par_iter()
            .map(|row| {
                let mut clear: Vec<(f32, usize)> = Vec::with_capacity(pictures.len());
                (0..width)
                    .map(|column| {
                        let at = row * width + column;
                        clear.clear();
                        for (k, (picture, light)) in pictures.iter().enumerate() {
                            if !masks[k][at] {
                                clear.push((f32::from(picture.planes[0][at]) / light[0], k));
                            }
                        }
                        if clear.is_empty() {
                            return ([0; PLANES], State::Unknown);
                        }
                        clear.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
                        let low = (clear.len() - 1) / 3;
                        let middle = &clear[low..clear.len() - low];
                        let mut sums = [0.0; PLANES];
                        for &(grey, k) in middle {
                            let (picture, light) = pictures[k];
                            sums[0] += grey;
                            for plane in 1..count {
                                sums[plane] += f32::from(picture.planes[plane][at]) - light[plane];
                            }
                        }
                        let value = sums.map(|sum| (sum / middle.len() as f32).round() as u8);
                        (value, if clear.len() >= least { State::Known } else { State::Unknown })
                    })
                    .unzip()
            })
            .collect();
        let mut planes = vec![Vec::with_capacity(width * height); count];
        let mut state = Vec::with_capacity(width * height);
        for (values, states) in rows {
            for (plane, out) in planes.iter_mut().enumerate() {
                out.extend(values.iter().map(|value| value[plane]));
            }
            state.extend(states);
        }
        let mut tank = Self { planes: Planes { width, height, planes }, state, noise: MIN_NOISE };
        tank.learn_noise(pictures, masks);
        Some(tank)
    }

    /// What no picture showed clear is as `empty` shows it, a picture of the tank without the mechanism.
    pub(super) fn fill(&mut self, empty: &Planes) {
        let light = self.light(empty);
        for at in 0..self.state.len() {
            if self.state[at] != State::Unknown {
                continue;
            }
            for (plane, (tank, seen)) in self.planes.planes.iter_mut().zip(&empty.planes).enumerate() {
                tank[at] = unlit(seen[at], plane, light);
            }
            self.state[at] = State::Known;
        }
    }

    /// How much clear pixels vary about it.
    fn learn_noise(&mut self, pictures: &[(&Planes, Light)], masks: &[Vec<bool>]) {
        const STRIDE: usize = 37;
        let mut by_picture: Vec<[f32; PLANES]> = Vec::new();
        for ((picture, _), mask) in pictures.iter().zip(masks).step_by(4) {
            let light = self.light(picture);
            let mut deviations: [Vec<f32>; PLANES] = Default::default();
            for at in
                (0..mask.len()).step_by(STRIDE).filter(|&at| !mask[at] && self.state[at] == State::Known)
            {
                for (plane, (tank, seen)) in self.planes.planes.iter().zip(&picture.planes).enumerate() {
                    let expected = lit(tank[at], plane, light);
                    deviations[plane].push((f32::from(seen[at]) - expected).abs());
                }
            }
            by_picture.push(deviations.map(|mut values| median(&mut values).unwrap_or(0.0) * STD_PER_MAD));
        }
        for plane in 0..PLANES {
            let mut values: Vec<f32> = by_picture.iter().map(|noise| noise[plane]).collect();
            self.noise[plane] = median(&mut values).unwrap_or(0.0).max(MIN_NOISE[plane]);
        }
    }

    /// The light of `picture`: medians over what is known, of which the mechanism hides but a little.
    pub(super) fn light(&self, picture: &Planes) -> Light {
        let mut ratios: [Vec<f32>; PLANES] = Default::default();
        for row in (0..self.planes.height).step_by(LIGHT_STRIDE_PX) {
            for column in (0..self.planes.width).step_by(LIGHT_STRIDE_PX) {
                let at = row * self.planes.width + column;
                if self.state[at] != State::Known || self.planes.planes[0][at] <= MIN_TANK_GREY {
                    continue;
                }
                ratios[0].push(f32::from(picture.planes[0][at]) / f32::from(self.planes.planes[0][at]));
                let planes = self.planes.planes.iter().zip(&picture.planes).zip(&mut ratios);
                for ((tank, seen), shifts) in planes.skip(1) {
                    shifts.push(f32::from(seen[at]) - f32::from(tank[at]));
                }
            }
        }
        let [grey, cb, cr] = ratios.map(|mut values| median(&mut values));
        [grey.unwrap_or(1.0), cb.unwrap_or(0.0), cr.unwrap_or(0.0)]
    }

    /// Finds what stands before the mechanism: known tank that is seen where fitted poses would cover it. `inside`: pictures and where each
    /// shows the mechanism, its edge left out.
    pub(super) fn find_before(&mut self, inside: &[(&Planes, Vec<bool>)]) {
        /// So many pictures must say so, and this share of those in which it should be covered; chosen.
        const MIN_PICTURES: u16 = 3;
        const MIN_SHARE: f32 = 0.7;
        /// The tank is seen where a pixel differs by no more of its noise, chosen.
        const SAME_NOISE: f32 = 3.0;
        const GROWN_PX: usize = 2;
        let pixels = self.state.len();
        let (mut covered, mut same) = (vec![0u16; pixels], vec![0u16; pixels]);
        for (picture, inside) in inside {
            let light = self.light(picture);
            for at in (0..pixels).filter(|&at| inside[at]) {
                covered[at] += 1;
                let is_tank = (0..self.planes.planes.len()).all(|plane| {
                    let expected = lit(self.planes.planes[plane][at], plane, light);
                    let limit = SAME_NOISE * self.noise[plane] + 1.0;
                    (f32::from(picture.planes[plane][at]) - expected).abs() < limit
                });
                same[at] += u16::from(is_tank);
            }
        }
        let (width, height) = (self.planes.width, self.planes.height);
        let before: Vec<bool> = (0..pixels)
            .map(|at| {
                self.state[at] == State::Known
                    && covered[at] >= MIN_PICTURES
                    && f32::from(same[at]) > MIN_SHARE * f32::from(covered[at])
            })
            .collect();
        // single pixels are noise
        let at = |row: usize, column: usize| row < height && column < width && before[row * width + column];
        let sound: Vec<(usize, usize)> = (0..height.saturating_sub(1))
            .flat_map(|row| (0..width.saturating_sub(1)).map(move |column| (row, column)))
            .filter(|&(row, column)| {
                at(row, column) && at(row + 1, column) && at(row, column + 1) && at(row + 1, column + 1)
            })
            .collect();
        for (row, column) in sound {
            for y in row.saturating_sub(GROWN_PX)..(row + 2 + GROWN_PX).min(height) {
                for x in column.saturating_sub(GROWN_PX)..(column + 2 + GROWN_PX).min(width) {
                    self.state[y * width + x] = State::Before;
                }
            }
        }
    }

    /// What static masks cover stands before the mechanism.
    pub(super) fn block(&mut self, blocked: impl Fn(usize, usize) -> bool) {
        for (at, state) in self.state.iter_mut().enumerate() {
            if blocked(at % self.planes.width, at / self.planes.width) {
                *state = State::Before;
            }
        }
    }
}

/// A plane's value of the tank in another light.
pub(super) fn lit(value: u8, plane: usize, light: Light) -> f32 {
    if plane == 0 { f32::from(value) * light[0] } else { f32::from(value) + light[plane] }
}

/// The tank's value by that of a plane in another light.
fn unlit(value: u8, plane: usize, light: Light) -> u8 {
    let value = f32::from(value);
    (if plane == 0 { value / light[0].max(f32::MIN_POSITIVE) } else { value - light[plane] }).round() as u8
}

/// The middle one of `values`, which are put in another order.
pub(super) fn median(values: &mut [f32]) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// Where the mechanism is in the picture, `grown_px` wider on all sides; shape (height, width).
pub(super) fn painted(camera: &Camera, strips: &[Strips], grown_px: f64) -> Vec<bool> {
    let [width, height] = camera.size;
    let mut mask = vec![false; width * height];
    for strip in strips {
        let solid = camera.shows(*strip);
        let [a, b] = solid.axis;
        // to the corners of a square end
        let reach = std::f64::consts::SQRT_2 * (solid.half_width[0].max(solid.half_width[1]) + grown_px);
        if reach <= 0.0 {
            continue;
        }
        let clip = |value: f64, most: usize| value.clamp(0.0, most as f64) as usize;
        let (left, right) = (clip(a[0].min(b[0]) - reach, width), clip(a[0].max(b[0]) + reach + 2.0, width));
        let (top, bottom) =
            (clip(a[1].min(b[1]) - reach, height), clip(a[1].max(b[1]) + reach + 2.0, height));
        for row in top..bottom {
            for column in left..right {
                if solid.distance([column as f64, row as f64]) <= grown_px {
                    mask[row * width + column] = true;
                }
            }
        }
    }
    mask
}
