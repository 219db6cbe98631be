//! Silhouettes that something else than the difference from the empty tank has found: they say which pixels are the mechanism's, but not
//! to the pixel. Where their edges lie, the picture says.

use std::collections::HashMap;

use ground::statistics::median;

use super::Mask;
use super::background::Contrast;

/// One silhouette for each image in which there is one.
#[derive(Debug, Clone, Default)]
pub struct Silhouettes {
    /// By the images' times, which all differ.
    by_time: HashMap<u64, Mask>,
    /// How far their edges may be off \[px\].
    blur_px: f64,
}

/// What differs by less than this many sigmas of noise has no edge that could be found.
const LEAST_LEVEL_SIGMAS: f32 = 4.0;

impl Silhouettes {
    /// None yet; their edges may be off by `blur_px`.
    pub fn new(blur_px: f64) -> Self {
        Self { by_time: HashMap::new(), blur_px }
    }

    /// That of the image taken at `time_s`.
    pub fn put(&mut self, time_s: f64, mask: Mask) {
        self.by_time.insert(time_s.to_bits(), mask);
    }

    /// That of the image taken at `time_s`.
    pub fn of(&self, time_s: f64) -> Option<&Mask> {
        self.by_time.get(&time_s.to_bits())
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.by_time.len()
    }

    /// That of the image taken at `time_s`, as a mask of the whole picture without what is `blocked`, its edges where the image's
    /// `contrast` passes half of what the mechanism differs by; empty where there is none. The contrast learns that level from it: what
    /// differs most in the picture may be something else.
    pub(super) fn seen(&self, time_s: f64, contrast: &mut Contrast, blocked: Option<&Mask>) -> Mask {
        let (width, height) = (contrast.width, contrast.height);
        let Some(found) = self.of(time_s) else { return Mask::empty(0, 0, width, height) };
        let mut whole = found.over(width, height);
        if let Some(blocked) = blocked {
            whole = whole.without(blocked);
        }
        let inside =
            whole.bits.iter().zip(&contrast.values).filter(|(bit, _)| **bit).map(|(_, value)| *value);
        let mut inside: Vec<f32> = inside.collect();
        let middle = median(&mut inside, f32::total_cmp).unwrap_or(0.0);
        inside.retain(|value| *value > middle / 2.0);
        let level = median(&mut inside, f32::total_cmp).unwrap_or(0.0);
        if level < LEAST_LEVEL_SIGMAS * contrast.noise {
            return whole;
        }
        contrast.level = level;
        let sharp = sharpened(&whole, contrast, self.blur_px.ceil() as usize).over(width, height);
        match blocked {
            Some(blocked) => sharp.without(blocked),
            None => sharp,
        }
    }
}

/// `mask` with each pixel within `reach` of its edge decided anew.
fn sharpened(mask: &Mask, contrast: &Contrast, reach: usize) -> Mask {
    let half = contrast.level / 2.0;
    let mut framed = mask.framed(reach + 1);
    let grown = mask.grown(reach);
    let outside = Mask { bits: framed.bits.iter().map(|bit| !bit).collect(), ..framed.clone() };
    let shell = outside.grown(reach);
    let (left, top, width) = (framed.left, framed.top, framed.width.max(1));
    for (i, bit) in framed.bits.iter_mut().enumerate() {
        let (x, y) = (left + i % width, top + i / width);
        if reach > 0 && x < contrast.width && y < contrast.height {
            let near = |of: &Mask| of.at(x as isize, y as isize);
            *bit = near(&grown) && (!near(&shell) || contrast.values[y * contrast.width + x] > half);
        }
    }
    framed
}

/// Silhouettes whose edges are where they should be.
impl FromIterator<(f64, Mask)> for Silhouettes {
    fn from_iter<I: IntoIterator<Item = (f64, Mask)>>(all: I) -> Self {
        let by_time = all.into_iter().map(|(time_s, mask)| (time_s.to_bits(), mask)).collect();
        Self { by_time, blur_px: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 60;

    /// Two discs: one of radius 12 that differs by 80, one of radius 20 that differs by 200.
    fn contrast(discs: [&Mask; 2]) -> Contrast {
        let value = |i: usize| {
            let at = |disc: &Mask| disc.at((i % SIDE) as isize, (i / SIDE) as isize);
            if at(discs[0]) {
                80.0
            } else if at(discs[1]) {
                200.0
            } else {
                0.0
            }
        };
        let values = (0..SIDE * SIDE).map(value).collect();
        Contrast { width: SIDE, height: SIDE, values, level: 200.0, noise: 1.0 }
    }

    fn disc(centre: [f64; 2], radius: f64) -> Mask {
        let mut mask = Mask::empty(0, 0, SIDE, SIDE);
        mask.draw_disc(centre, radius);
        mask
    }

    #[test]
    fn a_coarse_silhouette_gets_the_pictures_edges_and_the_mechanisms_own_level() {
        let (faint, dark) = (disc([16.0, 16.0], 12.0), disc([38.0, 38.0], 20.0));
        for off in [-2.0, 2.0] {
            let mut contrast = contrast([&faint, &dark]);
            let mut found = Silhouettes::new(2.5);
            found.put(0.1, disc([16.0 + off, 16.0 - off / 2.0], 12.0 + off / 2.0).framed(0));
            let seen = found.seen(0.1, &mut contrast, None);
            assert_eq!(contrast.level, 80.0);
            // The other one begins where this ends: a rim of it within reach of the coarse edge is all that may be added.
            let reachable = faint.grown(6).over(SIDE, SIDE);
            assert!(seen.pixels().all(|(x, y)| reachable.at(x as isize, y as isize)));
            let lost = faint.clone().without(&seen);
            assert_eq!(lost.area(), 0, "{off}");
            let free = seen.without(&dark);
            assert_eq!(free.without(&faint).area(), 0, "{off}");
        }
    }

    #[test]
    fn what_is_blocked_is_left_out_and_an_unknown_image_has_none() {
        let (faint, dark) = (disc([16.0, 16.0], 12.0), disc([45.0, 45.0], 10.0));
        let found: Silhouettes = [(0.1, faint.clone())].into_iter().collect();
        let mut contrast = contrast([&faint, &dark]);
        let mut blocked = Mask::empty(0, 0, SIDE, SIDE);
        blocked.draw_disc([16.0, 16.0], 4.0);
        let seen = found.seen(0.1, &mut contrast, Some(&blocked));
        assert_eq!(seen, faint.clone().without(&blocked));
        assert_eq!(found.seen(0.2, &mut contrast, None).area(), 0);
    }

    #[test]
    fn where_nothing_differs_the_silhouette_stays_as_it_is() {
        let disc = disc([30.0, 30.0], 9.0);
        let mut flat =
            Contrast { width: SIDE, height: SIDE, values: vec![0.5; SIDE * SIDE], level: 50.0, noise: 1.0 };
        let mut found = Silhouettes::new(3.0);
        found.put(0.0, disc.clone());
        assert_eq!(found.seen(0.0, &mut flat, None), disc);
        assert_eq!(flat.level, 50.0);
    }
}
