//! Looking for the edges of a known outline across it, in what a picture shows beside the empty tank.

use crate::Mask;
use crate::background::Contrast;
use camera::calibration::Px;

/// A place on an outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rim {
    /// In the picture \[px\].
    pub(crate) at: Px,
    /// Away from the mechanism, of length 1.
    pub(crate) outward: Px,
    /// Which part of the mechanism it belongs to.
    pub(crate) part: usize,
}

/// What the picture shows at a place of the outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Seen {
    /// An edge so far outward \[px\].
    Edge(f64),
    /// None.
    Nothing,
    /// What lies there cannot be seen: the border, or something still that hides the mechanism or is as dark.
    Hidden,
}

/// Where no evidence is to be had, over the whole picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View<'a> {
    /// The picture beside the empty tank.
    pub(crate) contrast: &'a Contrast,
    /// White where the mechanism cannot be told, with a skirt of an edge's width around it.
    pub(crate) hidden: Option<&'a Mask>,
}

/// Both sides of an edge are looked at so far from it \[px\]: more than lenses blur.
const SIDES_PX: usize = 3;
/// The picture's border hides this much \[px\].
const BORDER_PX: f64 = 3.0;
/// Least step of an edge as a share of what the mechanism usually differs by; and in sigmas of the noise.
const LEAST_STEP: f64 = 0.35;
const LEAST_SIGMAS: f64 = 4.0;
/// A step this far off, at the end of the reach, must be stronger by this share to be taken for a nearer one.
const FAR_COST: f64 = 0.5;
/// Places that one look across can pass.
const MOST_PLACES: usize = 96;

impl View<'_> {
    /// What is seen across the outline at `rim`, no farther off than `reach` \[px\].
    pub(crate) fn look(&self, rim: &Rim, reach: f64) -> Seen {
        let Rim { at: [x, y], outward: [dx, dy], .. } = *rim;
        if self.is_hidden(rim.at) {
            return Seen::Hidden;
        }
        let half = ((reach.ceil() as usize) + SIDES_PX + 1).min(MOST_PLACES / 2 - 1);
        let count = 2 * half + 1;
        let mut profile = [0.0; MOST_PLACES];
        for (k, value) in profile[..count].iter_mut().enumerate() {
            let s = k as f64 - half as f64;
            *value = self.contrast.at([x + s * dx, y + s * dy]);
        }
        let least = (LEAST_STEP * f64::from(self.contrast.level))
            .max(LEAST_SIGMAS * f64::from(self.contrast.noise) / std::f64::consts::SQRT_2);
        let full = f64::from(self.contrast.level).max(least);
        let mut best: Option<(f64, f64)> = None;
        for k in SIDES_PX..count - SIDES_PX - 1 {
            let inside = (profile[k - SIDES_PX] + profile[k + 1 - SIDES_PX]) / 2.0;
            let outside = (profile[k + SIDES_PX] + profile[k + SIDES_PX + 1]) / 2.0;
            let (step, middle) = (inside - outside, (inside + outside) / 2.0);
            if step < least || profile[k] <= middle || profile[k + 1] > middle {
                continue;
            }
            let share = (profile[k] - middle) / (profile[k] - profile[k + 1]);
            let off = k as f64 + share - half as f64;
            let worth = (step / full).min(1.0) - FAR_COST * (off / reach).powi(2);
            if off.abs() <= reach && best.is_none_or(|(most, _)| worth > most) {
                best = Some((worth, off));
            }
        }
        match best {
            Some((_, off)) if self.is_hidden([x + off * dx, y + off * dy]) => Seen::Hidden,
            Some((_, off)) => Seen::Edge(off),
            None => Seen::Nothing,
        }
    }

    /// The slope of the edge `off` outward of `rim` as a share of its step, over two pixels \[1/px\]; none without a step.
    pub(crate) fn slope(&self, rim: &Rim, off: f64) -> Option<f64> {
        let at = |by: f64| self.contrast.at([0, 1].map(|axis| rim.at[axis] + (off + by) * rim.outward[axis]));
        let side = SIDES_PX as f64;
        let step = at(-side) - at(side);
        (step > LEAST_STEP * f64::from(self.contrast.level)).then(|| (at(-1.0) - at(1.0)) / 2.0 / step)
    }

    fn is_hidden(&self, [x, y]: Px) -> bool {
        let (right, bottom) = ((self.contrast.width - 1) as f64, (self.contrast.height - 1) as f64);
        // So written a place that is no number is hidden too.
        let inside = x >= BORDER_PX && y >= BORDER_PX && x <= right - BORDER_PX && y <= bottom - BORDER_PX;
        !inside || self.hidden.is_some_and(|mask| mask.at(x.round() as isize, y.round() as isize))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An upright edge at `edge`: mechanism on its left.
    fn picture(edge: f64, noise: f32) -> Contrast {
        let mut values = vec![0.0; 60 * 40];
        for (i, value) in values.iter_mut().enumerate() {
            let d = edge - (i % 60) as f64;
            *value = (100.0 * (0.5 + d / 2.4).clamp(0.0, 1.0)) as f32;
        }
        Contrast { width: 60, height: 40, values, level: 100.0, noise }
    }

    fn rim(x: f64) -> Rim {
        Rim { at: [x, 20.0], outward: [1.0, 0.0], part: 0 }
    }

    #[test]
    fn an_edge_is_found_where_it_is_and_not_beyond_the_reach() {
        for edge in [27.3, 30.0, 33.9] {
            let contrast = picture(edge, 0.3);
            let view = View { contrast: &contrast, hidden: None };
            let Seen::Edge(off) = view.look(&rim(30.0), 6.0) else { panic!("{edge}") };
            assert!((30.0 + off - edge).abs() < 0.03, "{off} {edge}");
            assert_eq!(view.look(&rim(edge - 12.0), 6.0), Seen::Nothing);
        }
    }

    #[test]
    fn an_edge_the_other_way_round_is_none() {
        let contrast = picture(30.0, 0.3);
        let view = View { contrast: &contrast, hidden: None };
        assert_eq!(view.look(&Rim { outward: [-1.0, 0.0], ..rim(30.0) }, 6.0), Seen::Nothing);
    }

    #[test]
    fn border_and_what_is_still_hide() {
        let contrast = picture(30.0, 0.3);
        let mut hidden = Mask::empty(0, 0, 60, 40);
        hidden.set(30, 20);
        let view = View { contrast: &contrast, hidden: Some(&hidden) };
        assert_eq!(view.look(&rim(29.0), 6.0), Seen::Hidden);
        assert_eq!(view.look(&rim(1.0), 6.0), Seen::Hidden);
        assert_eq!(view.look(&rim(f64::NAN), 6.0), Seen::Hidden);
    }
}
