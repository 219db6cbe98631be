//! Several arms on one free body, as an octopus has them: the body's place and heading, and each arm's keypoints.
//!
//! All geometry is the model's (`shape`). `hub` finds the body's ellipse by its free rim, `branch` how far each arm's joints have
//! turned, so that the outline laid out by the model meets the edges in the picture (`settle`). Which arm is which follows from
//! where it hangs on the body.
//!
//! A camera that looks along y does not see everything. Arms one before the other are read as one, as long as they lie together;
//! an arm whose plane the camera looks along shows no length, and only its root, which the body carries, is given. What is
//! not known to `MOST_STD_PX` is left out.

mod branch;
mod hub;
mod settle;
mod shape;

use nalgebra::DMatrix;
pub use shape::Swimmer;

use self::branch::{Band, Branch};
use self::hub::Hub;
use self::settle::Settled;
use super::Mask;
use super::figure::edges::View;
use super::keypoints::{Found, Sigma};
use super::rejection::Rejection;
use camera::calibration::{Plane, Px};

/// A swimmer through the images of a film.
#[derive(Debug, Default)]
pub(super) struct Swim {
    hub: Option<Vec<f64>>,
    /// Of each branch.
    turns: Vec<Option<Vec<f64>>>,
}

/// A swimmer in one image.
pub(super) struct Swimming {
    /// Those of the keypoints that are not seen are no numbers.
    pub(super) found: Found,
    /// The branches' lines, one after the other, there and back through the body \[px\].
    pub(super) line: Vec<Px>,
    pub(super) doubt: Option<String>,
}

/// Arms that are seen less open than this show too little of their length.
const LEAST_OPEN: f64 = 0.3;
/// No keypoint is given that is known less well \[px\].
const MOST_STD_PX: f64 = 2.0;
/// No sigma is smaller \[px\].
const LEAST_STD_PX: f64 = 0.1;
/// Arms one before the other lie together as long as their common outline is no wider than one's by so much on either side \[px\].
const TOGETHER_PX: f64 = 1.0;
/// So far around what is known a silhouette may reach, and so many of its pixels may lie farther off \[px\].
const KNOWN_PX: f64 = 3.0;
const MOST_UNKNOWN_PX: usize = 20;
/// Each branch is laid out again when all are known.
const ROUNDS: usize = 2;

impl Swim {
    /// The swimmer in the next image, whose silhouette is `mask`.
    ///
    /// # Errors
    /// [`Rejection::NoOutline`] where its body is not found.
    pub(super) fn take(
        &mut self,
        view: &View,
        mask: &Mask,
        swimmer: &Swimmer,
        plane: &Plane,
    ) -> Result<Swimming, Rejection> {
        let middle = mask.centroid().ok_or(Rejection::NothingThere { min_area_px: 0.0 })?;
        let hub = Hub::new(swimmer, plane, middle);
        let body = hub.find(view, mask, self.hub.as_deref());
        let body = body.ok_or(Rejection::NoOutline { part: None, found: 0, open: 0 });
        if body.is_err() {
            *self = Self::default();
        }
        let body = body?;
        self.hub = Some(body.pose.clone());
        let lists = swimmer.branches();
        self.turns.resize(lists.len(), None);
        let scale_m = plane.metres_per_pixel(middle);
        let branch = |list: &[usize], others: Vec<Band>| {
            let arm = &swimmer.arms[list[0]];
            let length: f64 = arm.lengths_m.iter().sum();
            let left = |k: usize| length - arm.lengths_m[..k].iter().sum::<f64>();
            let steps = (0..arm.lengths_m.len()).map(|k| scale_m / left(k)).collect();
            Branch { arm, plane, hub: (&hub, &body.pose), scale_m, others, steps }
        };
        let open: Vec<bool> =
            lists.iter().map(|list| swimmer.arms[list[0]].openness() >= LEAST_OPEN).collect();
        let mut settled: Vec<Option<Settled>> = vec![None; lists.len()];
        for round in 0..ROUNDS {
            for (i, list) in lists.iter().enumerate().filter(|(i, _)| open[*i]) {
                let others = (0..lists.len()).filter(|&other| other != i);
                let others = others.filter_map(|other| {
                    settled[other]
                        .as_ref()
                        .map(|settled| branch(&lists[other], Vec::new()).band(&settled.pose))
                });
                let before = match round {
                    0 => self.turns[i].clone(),
                    _ => settled[i].as_ref().map(|settled| settled.pose.clone()),
                };
                settled[i] = branch(list, others.collect()).find(view, before.as_deref());
            }
        }
        // Two that were laid on the same arm: neither is certain.
        let bands: Vec<Option<Band>> = lists
            .iter()
            .zip(&settled)
            .map(|(list, settled)| Some(branch(list, Vec::new()).band(&settled.as_ref()?.pose)))
            .collect();
        let same = |i: usize| {
            bands.iter().enumerate().any(|(other, band)| match (band, &bands[i]) {
                (Some(band), Some(own)) if other != i => own.lies_in(band) || band.lies_in(own),
                _ => false,
            })
        };
        let doubled: Vec<bool> = (0..lists.len()).map(same).collect();
        // Where arms before each other are apart, one of them lies where none is known.
        let known: Vec<Band> = lists
            .iter()
            .enumerate()
            .filter_map(
                |(i, list)| if open[i] { bands[i].clone() } else { Some(branch(list, Vec::new()).strip()) },
            )
            .collect();
        let unknown = |&(column, row): &(usize, usize)| {
            let px = [column as f64, row as f64];
            !hub.holds(&body.pose, px, KNOWN_PX * scale_m)
                && !known.iter().any(|band| band.holds(px, KNOWN_PX))
        };
        let unknown_px = mask.pixels().filter(unknown).count();
        let mut found = Found {
            points: vec![[f64::NAN; 2]; swimmer.keypoints.len()],
            sigmas: vec![Sigma::untold(f64::NAN); swimmer.keypoints.len()],
        };
        let (mut line, mut lost) = (Vec::new(), Vec::new());
        let steps = [scale_m, scale_m, scale_m / swimmer.axes_m[0]];
        let names = |list: &[usize]| {
            list.iter().map(|&arm| swimmer.arms[arm].name.as_str()).collect::<Vec<&str>>().join(" and ")
        };
        for (i, list) in lists.iter().enumerate() {
            let together = |settled: &&Settled| {
                list.len() == 1 || settled.outward_px < TOGETHER_PX && unknown_px <= MOST_UNKNOWN_PX
            };
            let own = settled[i].as_ref().filter(|_| !doubled[i]);
            if open[i] && own.is_none() {
                lost.push(format!("{} not found", names(list)));
            } else if own.is_some_and(|own| !together(&own)) {
                lost.push(format!("{} apart", names(list)));
            }
            let own = own.filter(together);
            self.turns[i] = own.map(|own| own.pose.clone());
            // Together they are as far apart as is not seen.
            let apart = own.filter(|_| list.len() > 1).map_or(0.0, |own| own.outward_px.abs());
            for &arm in list {
                let branch = branch(&[arm], Vec::new());
                for &(keypoint, segment, along) in &swimmer.arms[arm].keypoints {
                    let root = segment == 0 && along == 0.0;
                    if own.is_none() && !root {
                        continue;
                    }
                    let (at, std) = branch.placed((segment, along), own, (&body.covariance, &steps));
                    let std = std.hypot(LEAST_STD_PX).hypot(if root { 0.0 } else { apart });
                    if std <= MOST_STD_PX {
                        (found.points[keypoint], found.sigmas[keypoint]) = (at, Sigma::untold(std));
                    }
                }
            }
            if let (Some(_), Some(band)) = (own, &bands[i]) {
                line.extend(band.line().iter().copied());
                line.extend(band.line().iter().rev().copied());
            }
        }
        if let Some(origin) = swimmer.keypoints.iter().position(|name| name == "P0") {
            found.points[origin] = plane.pixel([body.pose[0], body.pose[1]]);
            found.sigmas[origin] = Sigma::untold(of_origin(&body.covariance, scale_m).hypot(LEAST_STD_PX));
        }
        let doubt = (!lost.is_empty()).then(|| format!("arms left out: {}", lost.join(", ")));
        Ok(Swimming { found, line, doubt })
    }
}

fn of_origin(covariance: &DMatrix<f64>, scale_m: f64) -> f64 {
    covariance[(0, 0)].max(covariance[(1, 1)]).sqrt() / scale_m
}
